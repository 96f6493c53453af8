"""OSC in, without a socket or a clock: what senders say becomes commands of the engine, and what it answers packets."""
