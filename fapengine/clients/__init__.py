"""Edge: the other end of the wire: a sender of speech, and viewers of a face over WebSocket and OSC."""
