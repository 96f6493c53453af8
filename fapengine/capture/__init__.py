"""Recordings of faces: bytes to MarkerTrack."""
