"""The one object that ticks, the engine as the server observes it, and the pacer that tells when frames are due."""
