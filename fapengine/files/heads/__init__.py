"""Heads as files: imported, saved and loaded by name."""
