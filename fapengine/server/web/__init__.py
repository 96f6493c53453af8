"""The web page: its messages, and the web server."""
