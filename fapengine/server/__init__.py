"""The running server: sockets and time around the pure engine. One event loop, one thread; voices speak in another."""
