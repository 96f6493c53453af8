"""Mathematics of (..., 3) points: rigid motions, smooth functions, surfaces. Nothing here is specific to faces."""
