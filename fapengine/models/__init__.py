"""What is learned from capture: viseme spaces, marker subsets, dense modes."""
