"""Edge: sound devices and their clocks, queues of samples, the mixer, and the player of sounds."""
