"""Hosts of the engine: what a face says, hears and plays, frame by frame, on a clock that is an argument."""
