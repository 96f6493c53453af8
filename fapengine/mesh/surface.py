"""The bare head as a smooth surface: distance from a vertical axis as a function of angle and height.

Angles run from 0 (front) to pi (back), positive on the subject's left. Lips, lids, nostrils and ears are put on it
elsewhere.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator, RectBivariateSpline
from scipy.ndimage import gaussian_filter1d

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.sections import AXIS_Z_MM, section_arrays

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HeadShape:
    """Proportions with a meaning; 1 or 0 is the average adult of :mod:`fapengine.mesh.sections`."""

    jaw_width: float = 0.97
    """Width of the lower face."""
    nose_length: float = 0.93
    """How far the nose stands out."""
    eye_opening_mm: float = 12.0
    """Distance of the lids in the middle; the iris is as wide (the standard's neutral face)."""
    lip_fullness: float = 1.0
    cheek_fullness_mm: float = 1.5


TOP_MM = 145.0
"""Crown of the head; towards it distances shrink with the root of the height left, as on a sphere."""
CAP_FROM_MM = 127.0


@cache
def _spline() -> RectBivariateSpline:
    heights, angles, distances = section_arrays()
    # Between sections no higher and no lower than they are (below the chin a cubic would swing), then softened.
    fine_heights = np.arange(heights[0], heights[-1] + 0.5, 1.5)
    rows = gaussian_filter1d(PchipInterpolator(heights, distances)(fine_heights), 2.2, axis=0, mode="nearest")
    # Round the head: no slope at front and back, where the other half is the mirror image.
    fine_angles = np.deg2rad(np.arange(0.0, 181.0, 1.5))
    rows = CubicSpline(angles, rows, axis=1, bc_type="clamped")(fine_angles)
    whole = np.concatenate([-fine_angles[20:0:-1], fine_angles, 2 * np.pi - fine_angles[-2:-22:-1]])
    rows = np.concatenate([rows[:, 20:0:-1], rows, rows[:, -2:-22:-1]], axis=1)
    return RectBivariateSpline(fine_heights, whole, gaussian_filter1d(rows, 1.3, axis=1), kx=3, ky=3, s=0)


def _bare(angle: Array, y: Array) -> Array:
    heights, _, _ = section_arrays()
    r = np.asarray(_spline().ev(np.clip(y, heights[0], CAP_FROM_MM), angle), dtype=np.float64)
    cap: Array = r * np.sqrt(np.clip((TOP_MM - y) / (TOP_MM - CAP_FROM_MM), 0.0, 1.0))
    return cap


def _bell(x: Array, y: Array, centre: tuple[float, float], size: tuple[float, float]) -> Array:
    bell: Array = np.exp(-(((x - centre[0]) / size[0]) ** 2) - ((y - centre[1]) / size[1]) ** 2)
    return bell


def radius(angle: ArrayLike, y: ArrayLike, shape: HeadShape) -> Array:
    """Distance of the skin from the axis, mm."""
    a, h = np.broadcast_arrays(np.abs(np.asarray(angle, dtype=np.float64)), np.asarray(y, dtype=np.float64))
    r = _bare(a, h)
    x = r * np.sin(a)

    # The lips are ours: bridge over the measured ones, from below the nose to the chin.
    inside = smoothstep((38.0 - x) / 18.0) * smoothstep((h + 61.0) / 13.0) * smoothstep((-15.0 - h) / 10.0)
    above = _bare(a, np.full_like(h, -17.0))
    below = _bare(a, np.full_like(h, -58.0))
    share = np.clip((h + 58.0) / 41.0, 0.0, 1.0)
    bridge = below + (above - below) * share - 0.5 * np.sin(np.pi * share)
    r = r + inside * (bridge - r)

    nose = _bell(x, h, (0.0, 8.0), (15.0, 22.0))
    r = r - (1.0 - shape.nose_length) * 26.0 * nose
    r = r - 4.5 * _bell(x, h, (31.0, 36.0), (19.0, 10.0))  # the sockets, which the sections bridge over
    r = r + shape.cheek_fullness_mm * _bell(x, h, (44.0, -2.0), (20.0, 20.0))
    lower = smoothstep((-20.0 - h) / 50.0) * smoothstep((h + 110.0) / 25.0) * smoothstep((x - 5.0) / 40.0)
    return r * (1.0 - (1.0 - shape.jaw_width) * lower)


def position(angle: ArrayLike, y: ArrayLike, shape: HeadShape) -> Array:
    """(..., 3) mm: a point of the bare head."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    r = radius(a, h, shape)
    return np.stack([r * np.sin(a), h, AXIS_Z_MM + r * np.cos(a)], axis=-1)


def angle_of(x: ArrayLike, y: ArrayLike, shape: HeadShape) -> Array:
    """Angle at which the front of the head has this x, rad; the inverse of :func:`position` for a given height."""
    target, h = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    angle = target / 100.0
    for _ in range(12):
        angle = angle + 0.8 * (target - radius(angle, h, shape) * np.sin(angle)) / 100.0
    return angle


def normal(angle: ArrayLike, y: ArrayLike, shape: HeadShape) -> Array:
    """(..., 3): unit normal of the bare head, outwards."""
    step = 1e-3
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    across = position(a + step, h, shape) - position(a - step, h, shape)
    along = position(a, h + 0.5, shape) - position(a, h - 0.5, shape)
    n = np.cross(across, along)
    unit: Array = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return unit
