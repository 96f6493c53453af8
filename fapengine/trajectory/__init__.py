"""Speech to motion: keyframes, splines, expressions, blinks."""
