"""Profiles: the data that make one face speak one language."""
