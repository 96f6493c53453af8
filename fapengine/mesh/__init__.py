"""The head: its surface, its feature points, and how FAPs deform it."""
