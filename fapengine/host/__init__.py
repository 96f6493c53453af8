"""Hosts of the engine: speech, recognition and playback of faces, frame by frame; the clock is an argument."""
