"""How skin outside the lips follows the feature points of the lower face, learned from a real one.

Theory of operation
-------------------
``design/learn_skin.py`` finds, for places of a real face, the displacement that goes with each FAP while the others
stand still: dense modes driven by feature points, as in paper 003, section 4, made local by a ridge. Here the places
are carried to another head: feature points that both have span a smooth warp, and the displacements, millimetres for
millimetres, are interpolated between the places by a thin-plate spline.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.skin_table import ANCHORS_MM, MOVES

Array = NDArray[np.float64]

FAPS = (3, 16, 17, 39, 40, 41, 42, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60)
"""FAPs that move skin of the lower face far and wide. Chin boss and nose have small motions of their own, of which
speech shows little; the inner lips move no skin, and FAP 14 and 15 are the jaw's alone."""
TWINS = {39: 40, 41: 42, 53: 54, 55: 56, 57: 58, 59: 60}
ANCHORS = (
    "2.1", "2.10", "2.13", "2.14", "3.7", "3.8", "3.11", "3.12", "4.1", "4.2", "4.5", "4.6", "5.1", "5.2", "5.3", "5.4",
    "8.1", "8.2", "8.3", "8.4", "8.5", "8.6", "8.7", "8.8", "9.1", "9.2", "9.3", "9.12", "9.15",
)  # fmt: skip
"""Feature points that two heads are laid over each other by."""
MIRRORED = np.array([-1.0, 1.0, 1.0])
SMOOTHING = 1.0
FADE_IN = (0.03, 0.16)
"""Motion in millimetres per millimetre: skin below the first stands still, from the second on it moves fully. Every
field costs time in the vertex shader, and what is left out here nobody sees."""
REACH_MM = (12.0, 30.0)
"""Distances from the nearest place of the table: up to the first it counts fully, from the second on not at all."""

_SWAP = [FAPS.index(({**TWINS, **{b: a for a, b in TWINS.items()}}).get(number, number)) for number in FAPS]


def mirror(moves: Array) -> Array:
    """(..., F, 3): displacements of the other half of a face."""
    turned: Array = moves[..., _SWAP, :] * MIRRORED
    return turned


def read_fields(places_mm: Array, moves: Array, points_mm: Array) -> Array:
    """Interpolate between places of the left half, (P, 3) and (P, F, 3), and their mirrors: (V, F, 3)."""
    aside = places_mm[:, 0] > 0
    places = np.concatenate([places_mm, places_mm[aside] * MIRRORED])
    values = np.concatenate([moves, mirror(moves[aside])])
    near = 1 - smoothstep((cKDTree(places).query(points_mm)[0] - REACH_MM[0]) / (REACH_MM[1] - REACH_MM[0]))
    fields = np.zeros((len(points_mm), len(FAPS), 3))
    reached = near > 0
    spline = RBFInterpolator(places, values.reshape(len(places), -1), smoothing=3.0 * SMOOTHING)
    fields[reached] = spline(points_mm[reached]).reshape(-1, len(FAPS), 3) * near[reached, None, None]
    return fields


def skin_fields(points_mm: ArrayLike, feature_points_mm: Mapping[str, ArrayLike]) -> dict[int, Array]:
    """Interpolate the skin's motion for one millimetre of each FAP.

    Parameters
    ----------
    points_mm : (V, 3) array_like, mm
        Skin of any head, in head axes.
    feature_points_mm : mapping of str to (3,) array_like, mm
        At least :data:`ANCHORS`, of the same head.

    Returns
    -------
    dict of int to (V, 3) float64
        Millimetres per millimetre, by FAP number.
    """
    points = np.asarray(points_mm, dtype=np.float64)
    anchors = np.array([feature_points_mm[name] for name in ANCHORS], dtype=np.float64)
    table_anchors = np.array([ANCHORS_MM[name] for name in ANCHORS])
    warped = RBFInterpolator(anchors, table_anchors, smoothing=SMOOTHING)(points)
    places = np.array([place for place, _ in MOVES])
    moves = np.zeros((len(places), len(FAPS), 3))
    for row, (_, by_fap) in zip(moves, MOVES, strict=True):
        for number, move in by_fap.items():
            row[FAPS.index(number)] = move
    fields = read_fields(places, moves, warped)
    size = np.linalg.norm(fields, axis=-1, keepdims=True)
    fields *= smoothstep((size - FADE_IN[0]) / (FADE_IN[1] - FADE_IN[0]))
    return dict(zip(FAPS, np.moveaxis(fields, 1, 0), strict=True))
