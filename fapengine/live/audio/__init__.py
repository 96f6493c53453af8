"""Edge: sound devices and their clocks, the mixer, and playback that tells the face where its sound is."""
