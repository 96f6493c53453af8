"""The nose: a ridge, two wings and two nostrils, added to a bare face without one.

Theory of operation
-------------------
A point of the bare face moves outwards by the nose's height there, and down by :data:`TILT` times as much. So the
underside of the nose still has room for rows of vertices. Heights are sums of a ridge along the middle and Gaussian
bumps for wings, grooves and nostrils. Values in millimetres refer to points of the bare face before they move; they
were fitted to the neutral head of ICT-FaceKit (University of Southern California, MIT licence) and rounded.
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

from fapengine._arrays import Array

TILT = 0.35
RIDGE_Y = (-14.0, -11.6, -8.8, -6.5, -4.2, -0.9, 1.7, 4.3, 7.0, 10.5, 13.5, 18.0, 23.0, 28.0, 33.0, 38.0, 44.0)
RIDGE_HEIGHT = (0.0, 0.8, 3.2, 6.6, 10.4, 15.0, 18.0, 20.4, 22.2, 23.4, 23.6, 21.4, 18.0, 14.0, 8.8, 3.4, 0.0)
"""Height of the ridge above the bare face, from the lip up to the root."""
WIDTH_Y = (-9.0, -4.0, 3.0, 9.0, 15.0, 23.0, 33.0)
HALF_WIDTH = (4.8, 6.6, 10.0, 10.8, 9.6, 8.6, 9.2)
WING_AT, WING_SIZE, WING_HEIGHT = (12.6, 2.6), (4.6, 6.0), 9.4
GROOVE_AT, GROOVE_SIZE, GROOVE_DEPTH = (19.8, 2.0), (2.4, 8.0), 2.2
"""The crease between wing and cheek."""
NOSTRIL_AT, NOSTRIL_SIZE = (7.4, -4.4), (3.1, 2.8)
NOSTRIL_DEPTH = 3.0


def _bump(x: Array, y: Array, at: tuple[float, float], size: tuple[float, float], power: float = 2.0) -> Array:
    return np.exp(-(np.abs((x - at[0]) / size[0]) ** power) - np.abs((y - at[1]) / size[1]) ** power)


def height(x: Array, y: Array, length: float, width: float) -> Array:
    """Height of the nose above the bare face, (...) mm, at ``x`` and ``y``, (...) mm; ``x`` of either sign."""
    across = np.abs(x) / width
    ridge = PchipInterpolator(RIDGE_Y, RIDGE_HEIGHT)(np.clip(y, RIDGE_Y[0], RIDGE_Y[-1]))
    half = PchipInterpolator(WIDTH_Y, HALF_WIDTH)(np.clip(y, WIDTH_Y[0], WIDTH_Y[-1]))
    out = ridge * np.exp(-((across / half) ** 2))
    out += WING_HEIGHT * _bump(across, y, WING_AT, WING_SIZE, 2.3)
    out -= GROOVE_DEPTH * _bump(across, y, GROOVE_AT, GROOVE_SIZE)
    out -= 1.2 * _bump(across, y, (10.8, 6.0), (1.8, 4.0))  # between tip and wing
    return length * out


def nostril(x: Array, y: Array, width: float) -> Array:
    """Depth of a nostril, (...), 0 on skin to 1 at its centre, at ``x`` and ``y``, (...) mm, of the bare face."""
    return _bump(np.abs(x) / width, y, NOSTRIL_AT, NOSTRIL_SIZE, 2.5)


def displacement(points: Array, length: float, width: float) -> Array:
    """(..., 3) mm: displacement of points of the bare face by the nose."""
    x, y = points[..., 0], points[..., 1]
    out = height(x, y, length, width) * (points[..., 2] > 60)
    hole = NOSTRIL_DEPTH * nostril(x, y, width) * (points[..., 2] > 60)
    return np.stack([np.zeros_like(out), -TILT * out + 0.75 * hole, out - 0.55 * hole], axis=-1)
