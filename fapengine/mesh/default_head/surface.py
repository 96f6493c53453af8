"""The template of the bare head: a smooth surface, as distance from a vertical axis by angle and height, and its nose.

Theory of operation
-------------------
Angles run from 0 (front) to pi (back), positive on the subject's left. Lips, lids and ears are added by other modules.
The surface passes through the horizontal cross-sections of an average adult head in ``sections.npz``, measured without
ears, eye openings and lips on the neutral head of ICT-FaceKit (University of Southern California, MIT licence), which
averages scanned faces. The head is symmetric, so one side is enough.

The nose is added to the bare face: a point moves outwards by the nose's height there, and down by :data:`TILT` times as
much, so that the underside of the nose still has room for rows of vertices. Heights are sums of a ridge along the
middle and Gaussian bumps for wings, grooves and nostrils; positions refer to points of the bare face before they move.
They were fitted to the same head and rounded.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator, RectBivariateSpline
from scipy.ndimage import gaussian_filter1d

from fapengine._arrays import Array, read_table
from fapengine.geometry.smooth import smoothstep, spot
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.default_head.style import HeadStyle

AXIS_Z_MM = 10.0
"""Position of the vertical axis: x = 0, z = 10 mm."""
BESIDE_NOSE_RAD = np.deg2rad(16.5)
TOP_MM = 145.0
"""Crown of the head; towards it distances shrink with the root of the remaining height, as on a sphere."""
CAP_FROM_MM = 127.0
NAPE_MM = 26.0
"""Height above the lowest section below which the neck keeps its thickness, at the sides and the back."""
TABLE_RAD, TABLE_MM = np.linspace(0.0, np.pi, 721), np.linspace(-140.0, 145.0, 571)

TILT = 0.35
RIDGE_MM = PchipInterpolator(
    (-14.0, -11.6, -8.8, -6.5, -4.2, -0.9, 1.7, 4.3, 7.0, 10.5, 13.5, 18.0, 23.0, 28.0, 33.0, 38.0, 44.0),
    (0.0, 0.8, 3.2, 6.6, 10.4, 15.0, 18.0, 20.4, 22.2, 23.4, 23.6, 21.4, 18.0, 14.0, 8.8, 3.4, 0.0),
)
"""Height of the ridge of the nose above the bare face, by y from the lip up to the root."""
HALF_WIDTH_MM = PchipInterpolator((-9.0, -4.0, 3.0, 9.0, 15.0, 23.0, 33.0), (4.8, 6.6, 10.0, 10.8, 9.6, 8.6, 9.2))
"""Half of the width of the nose, by y."""
NOSE_BUMPS = (
    (10.0, (12.6, 2.4), (4.6, 5.8), 2.5),  # wing
    (-3.2, (19.6, 2.0), (2.5, 8.0), 2.0),  # crease between wing and cheek
    (-1.2, (10.8, 6.0), (1.8, 4.0), 2.0),  # between tip and wing
)
"""Height, centre, size and power of each bump beside the ridge, mm."""
NOSTRIL_AT, NOSTRIL_SIZE = (7.2, -4.6), (2.6, 2.0)
NOSTRIL_DEPTH = 2.4


@cache
def _sections() -> tuple[Array, Array, Array]:
    """Heights (Y,) mm, angles (A,) rad and distances from the axis (Y, A) mm."""
    table = read_table(__package__, "sections.npz")
    return table["heights_mm"], np.deg2rad(table["angles_deg"]), table["distances_mm"].astype(np.float64)


@cache
def _spline() -> RectBivariateSpline:
    heights, angles, distances = _sections()
    # Between sections no higher and no lower than they are (below the chin a cubic would swing), then softened.
    fine_heights = np.arange(heights[0], heights[-1] + 0.5, 1.5)
    rows = gaussian_filter1d(PchipInterpolator(heights, distances)(fine_heights), 2.2, axis=0, mode="nearest")
    # No slope at front and back, where the other half is the mirror image.
    fine_angles = np.deg2rad(np.arange(0.0, 181.0, 1.5))
    rows = CubicSpline(angles, rows, axis=1, bc_type="clamped")(fine_angles)
    # The neck's own furrows are noise at this resolution.
    neck = smoothstep((-72.0 - fine_heights) / 14.0)[:, None]
    rows = rows + neck * (gaussian_filter1d(rows, 7.0, axis=1, mode="reflect") - rows)
    whole = np.concatenate([-fine_angles[20:0:-1], fine_angles, 2 * np.pi - fine_angles[-2:-22:-1]])
    rows = np.concatenate([rows[:, 20:0:-1], rows, rows[:, -2:-22:-1]], axis=1)
    return RectBivariateSpline(fine_heights, whole, gaussian_filter1d(rows, 1.3, axis=1), kx=3, ky=3, s=0)


def above_nape(angle: Array, y: Array, lowest_mm: float) -> Array:
    """Heights not below the lowest known one, at the sides and the back not below the nape, (...) mm."""
    return np.maximum(y, lowest_mm + NAPE_MM * smoothstep((np.abs(angle) - np.pi / 4) / (np.pi / 4)))


def _bare(angle: Array, y: Array) -> Array:
    # Below the nape the measured neck spreads into shoulders; the template continues into its collar.
    known = np.minimum(above_nape(angle, y, _sections()[0][0]), CAP_FROM_MM)
    cap = np.sqrt(np.clip((TOP_MM - y) / (TOP_MM - CAP_FROM_MM), 0.0, 1.0))
    return _spline().ev(known, angle) * cap


@cache
def _edges() -> tuple[Array, Array, Array]:
    """Distances over :data:`TABLE_RAD` above and below the lips, and over :data:`TABLE_MM` where the cheek begins."""
    above, below = (_bare(TABLE_RAD, np.full_like(TABLE_RAD, height)) for height in (-17.0, -58.0))
    return above, below, _bare(np.full_like(TABLE_MM, BESIDE_NOSE_RAD), TABLE_MM)


def radius(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Distance of the skin from the axis, (...) mm, at angles (...) rad and heights (...) mm."""
    a, h = np.broadcast_arrays(np.abs(angle), y)
    r = _bare(a, h)
    x = np.where(a < np.pi / 2, r * np.sin(a), 1000.0)  # everything below concerns the face
    over_lips, under_lips, cheek = _edges()

    # The template has lips of its own: bridge over the measured ones, from below the nose to the chin.
    inside = smoothstep((38.0 - x) / 18.0) * smoothstep((h + 61.0) / 13.0) * smoothstep((-15.0 - h) / 10.0)
    above, below = np.interp(a, TABLE_RAD, over_lips), np.interp(a, TABLE_RAD, under_lips)
    share = np.clip((h + 58.0) / 41.0, 0.0, 1.0)
    bridge = below + (above - below) * share - 0.5 * np.sin(np.pi * share)
    r = r + inside * (bridge - r)

    # And a nose of its own: bridge over the measured one, from cheek to cheek.
    arch = np.interp(h, (-16.0, 6.0, 30.0), (10.6, 7.0, 3.5)) * np.exp(-((x / 12.5) ** 2))
    inside = smoothstep((27.0 - x) / 9.0) * smoothstep((h + 19.0) / 6.0) * smoothstep((38.0 - h) / 9.0)
    r = r + inside * (np.interp(h, TABLE_MM, cheek) + arch - r)

    # Lips are on a bulge over the teeth, eyes in sockets under a ridge; the sections are too coarse for either.
    r = r + 2.2 * np.exp(-((x / 27.0) ** 4) - (np.abs(h + 33.0) / 16.0) ** 3)
    r = r - 3.6 * spot(x, h, (31.0, 36.0), (19.0, 10.0)) + 1.6 * spot(x, h, (32.0, 53.0), (24.0, 5.5))
    r = r + style.cheek_fullness_mm * spot(x, h, (44.0, -2.0), (20.0, 20.0))
    r = r + style.chin_mm * spot(x, h, (0.0, -68.0), (20.0, 11.0))
    # Two muscles run from behind the ears to the notch above the breastbone, with the larynx between them.
    towards_notch = np.interp(h, (-128.0, -30.0), np.deg2rad((13.0, 92.0)))
    r = r + 2.6 * (1 - 0.8 * style.childlike) * np.exp(-(((a - towards_notch) / 0.21) ** 2)) * smoothstep(
        (-48.0 - h) / 34.0
    )
    larynx = 2.0 * spot(x, h, (0.0, -98.0), (9.0, 11.0)) - 3.0 * spot(x, h, (0.0, -122.0), (10.0, 12.0))
    r = r + (1 - 0.7 * style.childlike) * larynx
    # With age a fold forms from the nose's wing past the corner of the mouth, and a groove under the eye.
    fold = spot(x + 0.42 * (h + 12.0), h, (24.0, -26.0), (3.0, 18.0))
    swell = spot(x + 0.42 * (h + 12.0), h, (31.0, -24.0), (5.0, 16.0))
    groove = spot(x - 0.25 * (x - 31.0), h + 0.02 * (x - 31.0) ** 2, (30.0, 21.0), (12.0, 2.6))
    return r + ((0.1 + 1.5 * style.age) * (0.8 * swell - fold) - (0.1 + 1.3 * style.age) * groove)


def _narrowed(h: Array, style: HeadStyle) -> Array:
    """Width of the head at a height, relative to the average."""
    lower = smoothstep((-16.0 - h) / 50.0) * smoothstep((h + 112.0) / 25.0)
    return (1.0 - (1.0 - style.jaw_width) * lower) * (1.0 - 0.09 * smoothstep((-74.0 - h) / 30.0))


def nostril(x: Array, y: Array, width: float) -> Array:
    """Depth of a nostril, (...), 0 on skin to 1 at its centre, at ``x`` and ``y``, (...) mm, of the bare face."""
    return spot(np.abs(x) / width, y, NOSTRIL_AT, NOSTRIL_SIZE, 2.5)


def _nose_height(x: Array, y: Array, style: HeadStyle) -> Array:
    """Height of the nose above the bare face, (...) mm, at ``x`` and ``y``, (...) mm; ``x`` of either sign."""
    across = np.abs(x) / style.nose_width
    ridge, half = (by_y(np.clip(y, by_y.x[0], by_y.x[-1])) for by_y in (RIDGE_MM, HALF_WIDTH_MM))
    out = ridge * np.exp(-((across / half) ** 2))
    for height, centre, size, power in NOSE_BUMPS:
        out += height * spot(across, y, centre, size, power)
    return style.nose_length * out


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: a point of the bare head, including its nose."""
    a, h = np.broadcast_arrays(angle, y)
    r = radius(a, h, style)
    x, z = _narrowed(h, style) * r * np.sin(a), AXIS_Z_MM + r * np.cos(a)
    nose = _nose_height(x, h, style) * (z > 60)
    hole = NOSTRIL_DEPTH * nostril(x, h, style.nose_width) * (z > 60)
    return np.stack([x, h + (-TILT * nose + 0.75 * hole), z + (nose - 0.55 * hole)], axis=-1)


def angle_of(x: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Angle, (...) rad, at which the front has ``x``, (...) mm, at height ``y``: inverse of :func:`position`."""
    target, h = np.broadcast_arrays(x, y)
    target = target / _narrowed(h, style)
    angle = target / 100.0
    for _ in range(7):
        angle = np.arcsin(np.clip(target / radius(angle, h, style), -1.0, 1.0))
    return angle


def normal(
    angle: ArrayLike, y: ArrayLike, style: HeadStyle, at: Callable[[Array, Array, HeadStyle], Array] = position
) -> Array:
    """(..., 3): outward unit normal of the bare head, or of another surface over the same angles and heights."""
    a, h = np.broadcast_arrays(angle, y)
    across = at(a + 1e-3, h, style) - at(a - 1e-3, h, style)
    along = at(a, h + 0.5, style) - at(a, h - 0.5, style)
    return unit_vectors(np.cross(across, along))
