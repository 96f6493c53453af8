"""Mathematics of (..., 3) points: rotations, splines. Not a face word in it."""
