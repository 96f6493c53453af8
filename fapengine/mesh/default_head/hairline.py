"""Where hair begins."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]

HAIRLINE_DEG = (0, 18, 34, 46, 56, 64, 70, 76, 84, 96, 108, 120, 140, 180)
HAIRLINE_MM = (92, 94, 91, 79, 62, 48, 28, 16, 34, 44, 20, -28, -46, -50)
"""Height at which hair begins, by angle from the front."""


def hairline(angle: Array) -> Array:
    """Height at which hair begins, (...) mm, by angle from the front, (...) rad."""
    degrees = np.rad2deg(np.abs(angle))
    return np.asarray(PchipInterpolator(HAIRLINE_DEG, HAIRLINE_MM)(degrees), dtype=np.float64)
