"""What comes in: sockets, limits of connections, and packets on their way to the receiver."""
