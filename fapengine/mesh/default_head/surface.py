"""The template of the bare head as a smooth surface: distance from a vertical axis as a function of angle and height.

Angles run from 0 (front) to pi (back), positive on the subject's left. Lips, lids, nostrils and ears are put on it
elsewhere.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator, RectBivariateSpline
from scipy.ndimage import gaussian_filter1d

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head import nose
from fapengine.mesh.default_head.sections import AXIS_Z_MM, section_arrays
from fapengine.mesh.default_head.style import HeadStyle

Array = NDArray[np.float64]


BESIDE_NOSE_RAD = np.deg2rad(16.5)
TOP_MM = 145.0
"""Crown of the head; towards it distances shrink with the root of the height left, as on a sphere."""
CAP_FROM_MM = 127.0
NAPE_MM = 26.0
"""Height over the lowest section from which the neck is as thick downwards, at the sides and behind."""
TABLE_RAD, TABLE_MM = np.linspace(0.0, np.pi, 721), np.linspace(-140.0, 145.0, 571)


@cache
def _spline() -> RectBivariateSpline:
    heights, angles, distances = section_arrays()
    # Between sections no higher and no lower than they are (below the chin a cubic would swing), then softened.
    fine_heights = np.arange(heights[0], heights[-1] + 0.5, 1.5)
    rows = gaussian_filter1d(PchipInterpolator(heights, distances)(fine_heights), 2.2, axis=0, mode="nearest")
    # Round the head: no slope at front and back, where the other half is the mirror image.
    fine_angles = np.deg2rad(np.arange(0.0, 181.0, 1.5))
    rows = CubicSpline(angles, rows, axis=1, bc_type="clamped")(fine_angles)
    # The neck's own furrows are noise at this resolution.
    neck = smoothstep((-72.0 - fine_heights) / 14.0)[:, None]
    rows = rows + neck * (gaussian_filter1d(rows, 7.0, axis=1, mode="reflect") - rows)
    whole = np.concatenate([-fine_angles[20:0:-1], fine_angles, 2 * np.pi - fine_angles[-2:-22:-1]])
    rows = np.concatenate([rows[:, 20:0:-1], rows, rows[:, -2:-22:-1]], axis=1)
    return RectBivariateSpline(fine_heights, whole, gaussian_filter1d(rows, 1.3, axis=1), kx=3, ky=3, s=0)


def _bare(angle: Array, y: Array) -> Array:
    heights, _, _ = section_arrays()
    # Below the nape the measured neck spreads into shoulders; ours goes on into its collar.
    lowest = heights[0] + NAPE_MM * smoothstep((np.abs(angle) - np.pi / 4) / (np.pi / 4))
    r = np.asarray(_spline().ev(np.clip(y, lowest, CAP_FROM_MM), angle), dtype=np.float64)
    cap: Array = r * np.sqrt(np.clip((TOP_MM - y) / (TOP_MM - CAP_FROM_MM), 0.0, 1.0))
    return cap


@cache
def _rims() -> tuple[Array, Array]:
    """Distances over :data:`TABLE_RAD` above and below the lips."""
    return _bare(TABLE_RAD, np.full_like(TABLE_RAD, -17.0)), _bare(TABLE_RAD, np.full_like(TABLE_RAD, -58.0))


@cache
def _beside_nose() -> Array:
    """Distances over :data:`TABLE_MM` where the cheek begins."""
    return _bare(np.full_like(TABLE_MM, BESIDE_NOSE_RAD), TABLE_MM)


def _bump(x: Array, y: Array, centre: tuple[float, float], size: tuple[float, float]) -> Array:
    bump: Array = np.exp(-(((x - centre[0]) / size[0]) ** 2) - ((y - centre[1]) / size[1]) ** 2)
    return bump


def radius(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Distance of the skin from the axis, (...) mm, at angles, (...) rad, and heights, (...) mm."""
    a, h = np.broadcast_arrays(np.abs(np.asarray(angle, dtype=np.float64)), np.asarray(y, dtype=np.float64))
    r = _bare(a, h)
    x = np.where(a < np.pi / 2, r * np.sin(a), 1000.0)  # everything below concerns the face

    # The lips are ours: bridge over the measured ones, from below the nose to the chin.
    inside = smoothstep((38.0 - x) / 18.0) * smoothstep((h + 61.0) / 13.0) * smoothstep((-15.0 - h) / 10.0)
    above, below = (np.interp(a, TABLE_RAD, row) for row in _rims())
    share = np.clip((h + 58.0) / 41.0, 0.0, 1.0)
    bridge = below + (above - below) * share - 0.5 * np.sin(np.pi * share)
    r = r + inside * (bridge - r)

    # The nose is ours too: bridge over the measured one, from cheek to cheek.
    beside = np.interp(h, TABLE_MM, _beside_nose())
    arch = np.interp(h, (-16.0, 6.0, 30.0), (10.6, 7.0, 3.5)) * np.exp(-((x / 12.5) ** 2))
    inside = smoothstep((27.0 - x) / 9.0) * smoothstep((h + 19.0) / 6.0) * smoothstep((38.0 - h) / 9.0)
    r = r + inside * (beside + arch - r)

    # Lips lie on a bulge over the teeth, eyes in sockets under a ridge; the sections are too coarse for either.
    r = r + 2.2 * np.exp(-((x / 27.0) ** 4) - (np.abs(h + 33.0) / 16.0) ** 3)
    r = r - 3.6 * _bump(x, h, (31.0, 36.0), (19.0, 10.0)) + 1.6 * _bump(x, h, (32.0, 53.0), (24.0, 5.5))
    r = r + style.cheek_fullness_mm * _bump(x, h, (44.0, -2.0), (20.0, 20.0))
    r = r + style.chin_mm * _bump(x, h, (0.0, -68.0), (20.0, 11.0))
    # With age a fold forms from the nose's wing past the corner of the mouth, and a groove under the eye.
    fold = _bump(x + 0.42 * (h + 12.0), h, (24.0, -26.0), (3.0, 18.0))
    swell = _bump(x + 0.42 * (h + 12.0), h, (31.0, -24.0), (5.0, 16.0))
    below = _bump(x - 0.25 * (x - 31.0), h + 0.02 * (x - 31.0) ** 2, (30.0, 21.0), (12.0, 2.6))
    r += (0.1 + 2.3 * style.age) * (0.8 * swell - fold) - (0.1 + 1.3 * style.age) * below
    return np.asarray(r, dtype=np.float64)


def _narrowed(h: Array, style: HeadStyle) -> Array:
    """Width of the head at a height, as a share of the average."""
    lower = smoothstep((-16.0 - h) / 50.0) * smoothstep((h + 112.0) / 25.0)
    share: Array = (1.0 - (1.0 - style.jaw_width) * lower) * (1.0 - 0.09 * smoothstep((-74.0 - h) / 30.0))
    return share


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: a point of the bare head, with its nose."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    r = radius(a, h, style)
    points = np.stack([_narrowed(h, style) * r * np.sin(a), h, AXIS_Z_MM + r * np.cos(a)], axis=-1)
    return points + nose.displacement(points, style.nose_length, style.nose_width)


def angle_of(x: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Angle, (...) rad, where the front of the head has ``x``, (...) mm, at height ``y``: :func:`position` inverted."""
    target, h = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    target = target / _narrowed(h, style)
    angle = np.asarray(target / 100.0, dtype=np.float64)
    for _ in range(7):
        angle = np.arcsin(np.clip(target / radius(angle, h, style), -1.0, 1.0))
    return angle


def normal(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3): unit normal of the bare head, outwards."""
    step = 1e-3
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    across = position(a + step, h, style) - position(a - step, h, style)
    along = position(a, h + 0.5, style) - position(a, h - 0.5, style)
    n = np.cross(across, along)
    unit: Array = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return unit
