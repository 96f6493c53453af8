"""A session as images and audio in sync, for calls, cameras and streams."""
