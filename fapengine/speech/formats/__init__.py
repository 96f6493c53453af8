"""Timing formats: one reader a family, found by content."""
