"""The page in a browser: what it is sent, what it may say, and the web server's part of it."""
