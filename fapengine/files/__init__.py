"""Edge: paths to values and back. Nothing else opens a file."""
