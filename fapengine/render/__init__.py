"""FAP frames to images, by OpenGL."""
