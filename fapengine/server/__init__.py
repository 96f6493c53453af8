"""The running server: sockets and time around the pure engine. One event loop; voices run in processes of their own."""
