"""Sessions in real time; the edge is the network and the sound card."""
