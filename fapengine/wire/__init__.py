"""Packets, without a socket or a clock: OSC and its framing, speech in, FAP frames, VMC, VRChat and Live Link out."""
