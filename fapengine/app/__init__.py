"""What the verbs of the command line do, for Python too: no options, no printing; progress goes to a callback."""
