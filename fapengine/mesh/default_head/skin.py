"""How skin outside the lips follows the feature points of the lower face, learned from a real one.

Theory of operation
-------------------
``design/learn_skin.py`` finds, for every vertex of a real face, the displacement that goes with each FAP while the
others stand still: dense modes driven by feature points, as in paper 003, section 4, made local by a ridge. The
registration of ``design/learn_faces.py`` carries them to a grid of places on our template (:mod:`.faces`), so that the
fold beside the nose and the cheek above it lie where they lie on the face that they were learned from.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head import skin_table
from fapengine.mesh.default_head.faces import unpacked

Array = NDArray[np.float64]

FAPS = (3, 16, 17, 39, 40, 41, 42, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60)
"""FAPs that move skin of the lower face far and wide. Chin boss and nose have small motions of their own, of which
speech shows little; the inner lips move no skin, and FAP 14 and 15 are the jaw's alone."""
TWINS = {39: 40, 41: 42, 53: 54, 55: 56, 57: 58, 59: 60}
FADE_IN = (0.03, 0.16)
"""Motion in millimetres per millimetre: skin below the first stands still, from the second on it moves fully. Every
field costs time in the vertex shader, and what is left out here nobody sees."""

_SWAP = [FAPS.index(({**TWINS, **{b: a for a, b in TWINS.items()}}).get(number, number)) for number in FAPS]


def mirror(moves: Array) -> Array:
    """(..., F, 3): displacements of the other half of a face."""
    turned: Array = moves[..., _SWAP, :] * [-1.0, 1.0, 1.0]
    return turned


@cache
def _splines() -> tuple[RectBivariateSpline, ...]:
    """Three of each of :data:`FAPS`, over angle, rad, and height, mm, of the left half."""
    angles, heights = np.deg2rad(skin_table.ANGLES_DEG), np.array(skin_table.HEIGHTS_MM)
    tables = unpacked(skin_table.MOVES).reshape(len(angles), len(heights), -1)
    return tuple(RectBivariateSpline(angles, heights, tables[..., i]) for i in range(tables.shape[-1]))


def skin_fields(places: ArrayLike) -> dict[int, Array]:
    """Interpolate the skin's motion for one millimetre of each FAP.

    Parameters
    ----------
    places : (V, 2) array_like
        Angle, rad, and height, mm, on the template.

    Returns
    -------
    dict of int to (V, 3) float64
        Millimetres per millimetre, by FAP number.
    """
    angle, height = np.asarray(places, dtype=np.float64).T
    low, high, widest = skin_table.HEIGHTS_MM[0], skin_table.HEIGHTS_MM[-1], np.deg2rad(skin_table.ANGLES_DEG[-1])
    fields = np.zeros((len(angle), len(FAPS), 3))
    on = np.flatnonzero((np.abs(angle) <= widest) & (height >= low) & (height <= high))
    values = np.stack([spline.ev(np.abs(angle[on]), height[on]) for spline in _splines()], axis=-1)
    left = values.reshape(len(on), len(FAPS), 3)
    fields[on] = np.where((angle[on] < 0)[:, None, None], mirror(left), left)
    size = np.linalg.norm(fields, axis=-1, keepdims=True)
    fields *= smoothstep((size - FADE_IN[0]) / (FADE_IN[1] - FADE_IN[0]))
    return dict(zip(FAPS, np.moveaxis(fields, 1, 0), strict=True))
