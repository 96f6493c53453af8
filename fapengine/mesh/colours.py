"""Colours of the default head, linear RGB; painted per vertex."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SKIN = np.array([0.72, 0.42, 0.30])
BLUSH = np.array([0.72, 0.27, 0.20])
LIP = np.array([0.56, 0.17, 0.155])
MOUTH = np.array([0.10, 0.018, 0.016])
GUM = np.array([0.52, 0.16, 0.15])
TONGUE = np.array([0.55, 0.17, 0.16])
TEETH = np.array([0.82, 0.76, 0.65])
EYE = np.array([0.86, 0.82, 0.78])
HAIR = np.array([0.070, 0.034, 0.018])
LASH = np.array([0.045, 0.022, 0.014])
CLOTH = np.array([0.045, 0.11, 0.20])


def _spot(points: Array, centre: tuple[float, float], size: tuple[float, float]) -> Array:
    x = (np.abs(points[..., 0]) - centre[0]) / size[0]
    y = (points[..., 1] - centre[1]) / size[1]
    spot: Array = (np.exp(-(x**2) - y**2) * (points[..., 2] > 30))[..., None]
    return spot


def skin(points: Array) -> Array:
    """(..., 3) skin colour: blush on cheeks, nose and chin, shade round the eyes, lighter bridge and forehead."""
    colour = np.broadcast_to(SKIN, points.shape).copy()
    colour += 0.55 * _spot(points, (46, -4), (20, 17)) * (BLUSH - colour)
    colour += 0.40 * _spot(points, (0, 2), (13, 10)) * (BLUSH - colour)
    colour += 0.15 * _spot(points, (0, -63), (14, 10)) * (BLUSH - colour)
    colour *= 1 - 0.10 * _spot(points, (30, 35), (22, 14))
    colour *= 1 + 0.06 * _spot(points, (0, 70), (40, 22))
    return colour


def lip(points: Array, t: Array, level: float) -> Array:
    """(..., 3) lip colour, darker at the mouth line and at the corners."""
    shade = (0.72 + 0.28 * min(level / 0.3, 1.0)) * (1 - 0.2 * np.abs(t) ** 4)
    return LIP * np.broadcast_to(shade[..., None], points.shape)
