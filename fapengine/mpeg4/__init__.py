"""The standard as data: FAPs, FAPU, feature points, visemes, expressions, and ``FapTrack``."""
