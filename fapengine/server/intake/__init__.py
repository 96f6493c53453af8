"""Sockets, limits on connections, and packets on their way to the receiver."""
