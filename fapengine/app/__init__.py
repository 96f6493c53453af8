"""What the commands do, for Python too: without options and printing; progress goes to a callback."""
