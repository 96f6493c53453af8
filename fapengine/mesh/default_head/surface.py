"""The template of the bare head: a smooth surface, as distance from a vertical axis by angle and height.

Angles run from 0 (front) to pi (back), positive on the subject's left. Lips, lids, nostrils and ears are added by other
modules. The surface passes through :data:`SECTIONS`, horizontal cross-sections of an average adult head, measured on
the neutral head of ICT-FaceKit (University of Southern California, MIT licence), which averages scanned faces. Ears,
eye openings and lips are not in them. The head is symmetric, so one side is enough.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator, RectBivariateSpline
from scipy.ndimage import gaussian_filter1d

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head import nose
from fapengine.mesh.default_head.style import HeadStyle

AXIS_Z_MM = 10.0
"""Position of the vertical axis: x = 0, z = 10 mm."""

# fmt: off
ANGLES_DEG = (0, 4, 8, 12, 16, 20, 25, 30, 36, 42, 50, 58, 66, 75, 85, 95, 105, 115, 130, 145, 160, 180)
SECTIONS: tuple[tuple[int, tuple[int, ...]], ...] = (  # height y in mm, distances in mm
    (-102, ( 42,  42,  41,  41,  40,  40,  39,  39,  38,  38,  39,  41,  44,  48,  53,  57,  61,  66,  76,  79,  78,  78)),
    ( -90, ( 48,  48,  47,  47,  46,  45,  44,  43,  42,  41,  42,  43,  45,  49,  53,  56,  59,  62,  67,  70,  72,  73)),
    ( -84, ( 60,  58,  56,  54,  52,  50,  48,  47,  45,  44,  43,  44,  46,  49,  53,  57,  59,  61,  64,  68,  70,  71)),
    ( -78, ( 91,  90,  88,  83,  76,  67,  59,  54,  51,  48,  46,  46,  47,  50,  54,  57,  58,  60,  62,  66,  68,  69)),
    ( -72, ( 98,  97,  95,  92,  88,  82,  75,  68,  60,  55,  51,  49,  49,  51,  54,  57,  58,  59,  61,  64,  67,  68)),
    ( -66, (100, 100,  98,  95,  91,  87,  82,  77,  71,  64,  57,  53,  51,  52,  55,  57,  59,  59,  60,  63,  66,  67)),
    ( -60, (100, 100,  98,  95,  92,  89,  85,  81,  77,  72,  65,  59,  55,  54,  55,  58,  59,  59,  60,  63,  66,  67)),
    ( -54, ( 99,  99,  98,  96,  93,  91,  88,  84,  80,  76,  70,  65,  60,  57,  57,  58,  59,  59,  60,  63,  66,  67)),
    ( -48, (101, 101, 100,  97,  94,  92,  90,  87,  83,  79,  74,  69,  64,  60,  58,  59,  60,  60,  60,  63,  66,  67)),
    ( -42, (106, 105, 103,  99,  95,  94,  92,  89,  85,  81,  77,  72,  68,  63,  60,  60,  60,  61,  61,  63,  66,  67)),
    ( -36, (105, 104, 102,  97,  95,  95,  93,  90,  86,  83,  79,  75,  70,  65,  61,  61,  61,  62,  62,  64,  67,  68)),
    ( -30, (107, 106, 104, 101,  98,  96,  94,  91,  88,  85,  80,  76,  72,  67,  63,  61,  62,  63,  64,  66,  68,  69)),
    ( -24, (108, 107, 104, 101,  98,  96,  94,  92,  89,  86,  82,  77,  73,  69,  65,  62,  63,  64,  65,  67,  70,  71)),
    ( -18, (105, 105, 102,  99,  97,  96,  95,  93,  90,  87,  83,  78,  74,  71,  70,  69,  69,  68,  68,  70,  72,  73)),
    ( -12, (106, 104,  99,  96,  96,  96,  95,  94,  92,  89,  84,  79,  75,  72,  71,  71,  71,  70,  70,  72,  74,  76)),
    (  -6, (117, 102, 104,  95,  95,  96,  95,  95,  93,  90,  85,  80,  76,  73,  73,  73,  73,  73,  73,  75,  78,  79)),
    (   0, (121, 117, 109,  95,  95,  95,  95,  95,  94,  91,  86,  81,  77,  74,  74,  74,  75,  75,  75,  78,  81,  82)),
    (   6, (120, 116, 103,  95,  94,  94,  94,  94,  94,  92,  87,  82,  78,  75,  75,  76,  76,  77,  78,  81,  84,  85)),
    (  12, (116, 112,  99,  94,  92,  92,  93,  94,  93,  91,  87,  83,  79,  75,  76,  77,  78,  79,  80,  84,  86,  88)),
    (  18, (112, 106,  96,  91,  90,  90,  91,  92,  92,  90,  87,  83,  80,  76,  77,  78,  79,  80,  82,  86,  89,  90)),
    (  24, (107, 102,  92,  88,  88,  90,  91,  91,  89,  89,  86,  83,  80,  76,  78,  79,  81,  82,  84,  88,  91,  92)),
    (  30, (102,  97,  88,  86,  89,  91,  92,  92,  88,  88,  85,  82,  80,  77,  78,  80,  82,  83,  86,  90,  92,  94)),
    (  36, ( 98,  94,  87,  85,  91,  92,  93,  93,  90,  88,  85,  82,  79,  77,  79,  81,  83,  84,  87,  91,  94,  95)),
    (  42, ( 96,  94,  90,  88,  92,  93,  94,  95,  92,  89,  85,  81,  79,  77,  79,  81,  83,  85,  88,  92,  95,  96)),
    (  48, ( 97,  96,  95,  93,  93,  94,  96,  96,  94,  89,  84,  81,  79,  78,  78,  79,  81,  84,  89,  93,  95,  97)),
    (  54, ( 98,  97,  98,  98,  97,  97,  97,  96,  93,  89,  84,  81,  79,  78,  78,  79,  81,  84,  89,  93,  96,  97)),
    (  60, ( 97,  98,  98,  98,  98,  97,  96,  95,  91,  88,  84,  81,  79,  78,  78,  79,  82,  84,  89,  93,  96,  97)),
    (  66, ( 96,  97,  97,  97,  97,  96,  94,  92,  90,  87,  83,  81,  79,  78,  78,  79,  81,  84,  89,  93,  95,  96)),
    (  72, ( 95,  95,  95,  95,  95,  94,  92,  90,  88,  86,  83,  80,  78,  77,  77,  79,  81,  84,  88,  92,  95,  96)),
    (  78, ( 93,  93,  93,  93,  92,  92,  90,  89,  87,  84,  81,  79,  77,  77,  77,  78,  80,  83,  88,  91,  93,  94)),
    (  84, ( 91,  91,  91,  91,  90,  90,  89,  87,  85,  83,  80,  78,  76,  75,  76,  77,  79,  82,  86,  90,  92,  93)),
    (  90, ( 89,  89,  89,  89,  88,  88,  86,  85,  83,  80,  78,  76,  74,  74,  74,  76,  78,  81,  85,  88,  90,  91)),
    (  96, ( 86,  86,  86,  86,  85,  85,  83,  82,  80,  78,  75,  73,  72,  72,  72,  74,  76,  78,  83,  86,  88,  89)),
    ( 100, ( 84,  84,  83,  83,  83,  82,  81,  79,  77,  75,  73,  72,  70,  70,  70,  72,  74,  77,  81,  84,  86,  87)),
    ( 109, ( 77,  77,  77,  76,  76,  75,  74,  73,  71,  70,  68,  66,  65,  65,  66,  67,  69,  72,  76,  79,  81,  81)),
    ( 118, ( 69,  68,  68,  68,  67,  67,  66,  65,  63,  62,  60,  59,  58,  58,  59,  60,  62,  65,  69,  72,  74,  75)),
    ( 127, ( 57,  57,  56,  56,  56,  55,  54,  54,  52,  52,  50,  49,  49,  49,  49,  51,  53,  56,  60,  63,  64,  65)),
    ( 136, ( 39,  39,  39,  39,  39,  38,  38,  37,  37,  36,  36,  35,  35,  35,  36,  37,  39,  41,  45,  48,  50,  51)),
)
"""43 heights, each with the distances at 22 angles from the front (0 degrees) over the left ear (90) to the back (180).
"""
# fmt: on


def section_arrays() -> tuple[Array, Array, Array]:
    """Heights (Y,) mm, angles (A,) rad and distances (Y, A) mm."""
    heights = np.array([height for height, _ in SECTIONS], dtype=np.float64)
    distances = np.array([row for _, row in SECTIONS], dtype=np.float64)
    return heights, np.deg2rad(np.array(ANGLES_DEG, dtype=np.float64)), distances


BESIDE_NOSE_RAD = np.deg2rad(16.5)
TOP_MM = 145.0
"""Crown of the head; towards it distances shrink with the root of the remaining height, as on a sphere."""
CAP_FROM_MM = 127.0
NAPE_MM = 26.0
"""Height above the lowest section below which the neck keeps its thickness, at the sides and the back."""
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
    return r * np.sqrt(np.clip((TOP_MM - y) / (TOP_MM - CAP_FROM_MM), 0.0, 1.0))


@cache
def _rims() -> tuple[Array, Array]:
    """Distances over :data:`TABLE_RAD` above and below the lips."""
    return _bare(TABLE_RAD, np.full_like(TABLE_RAD, -17.0)), _bare(TABLE_RAD, np.full_like(TABLE_RAD, -58.0))


@cache
def _beside_nose() -> Array:
    """Distances over :data:`TABLE_MM` where the cheek begins."""
    return _bare(np.full_like(TABLE_MM, BESIDE_NOSE_RAD), TABLE_MM)


def _bump(x: Array, y: Array, centre: tuple[float, float], size: tuple[float, float]) -> Array:
    return np.exp(-(((x - centre[0]) / size[0]) ** 2) - ((y - centre[1]) / size[1]) ** 2)


def radius(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Distance of the skin from the axis, (...) mm, at angles (...) rad and heights (...) mm."""
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
    """Width of the head at a height, relative to the average."""
    lower = smoothstep((-16.0 - h) / 50.0) * smoothstep((h + 112.0) / 25.0)
    return (1.0 - (1.0 - style.jaw_width) * lower) * (1.0 - 0.09 * smoothstep((-74.0 - h) / 30.0))


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: a point of the bare head, including its nose."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    r = radius(a, h, style)
    points = np.stack([_narrowed(h, style) * r * np.sin(a), h, AXIS_Z_MM + r * np.cos(a)], axis=-1)
    return points + nose.displacement(points, style.nose_length, style.nose_width)


def angle_of(x: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """Angle, (...) rad, at which the front has ``x``, (...) mm, at height ``y``: inverse of :func:`position`."""
    target, h = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    target = target / _narrowed(h, style)
    angle = np.asarray(target / 100.0, dtype=np.float64)
    for _ in range(7):
        angle = np.arcsin(np.clip(target / radius(angle, h, style), -1.0, 1.0))
    return angle


def normal(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3): outward unit normal of the bare head."""
    step = 1e-3
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    across = position(a + step, h, style) - position(a - step, h, style)
    along = position(a, h + 0.5, style) - position(a, h - 0.5, style)
    n = np.cross(across, along)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)
