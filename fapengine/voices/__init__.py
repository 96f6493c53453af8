"""Voices: text to audio and timed phones."""
