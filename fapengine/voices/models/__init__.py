"""Voices that are models of the user's own, with the times of their phones: Piper's and Kokoro's."""
