"""Speech to motion: keyframes, splines, expressions, gestures."""
