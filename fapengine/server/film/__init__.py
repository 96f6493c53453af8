"""A session as pictures and sound that belong together, for those who cannot draw: calls, cameras, streams."""
