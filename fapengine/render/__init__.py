"""Edge: OpenGL. FAP frames to pictures."""
