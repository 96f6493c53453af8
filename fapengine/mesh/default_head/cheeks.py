"""Cheeks without dents: the motion of the skin beside the mouth, evened out.

Theory of operation
-------------------
Near the lips skin follows the rings round them, farther away the fields of real skin. The rings pass from an oval to
the rectangle of their block, and the mixture has the block's corners in it: a smile, which moves the corners of the
lips by 7 mm, had a dent there. So what each FAP does to this skin is averaged over neighbours. Lips and feature points
keep their motion, which is promised. A lifted cheek likewise goes on below the lower lid, whose margin rests:
it rose by 10 mm where the lid stood still 6 mm above, and went over it with an edge.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.head_parts import HeadParts
from fapengine.mesh.default_head.skin import FAPS
from fapengine.mesh.face_mesh import DeformationBasis

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ROUNDS = 8
"""Averages over neighbours at level ``normal``; a finer mesh takes as many more as its neighbours are nearer."""
LIPS_MM, POINT_MM = 7.0, 4.0
"""Distance from the lips, and from a feature point, at which skin is free."""
TOP, BOTTOM, FADE_MM = 6.0, -74.0, 8.0
"""Heights between which it is, and over how much it becomes so."""
LIFTS, TOP_OF_LIFTS = (41, 42), 34.0
MARGIN_MM, ROUNDS_OF_LIFTS = 5.0, 24
"""The same of lifted cheeks: height, distance from the lids' margins, averages."""
FRONT_MM = 55.0


def even_out(
    basis: DeformationBasis,
    points: Array,
    triangles: Indices,
    head: HeadParts,
    feature_points: Iterable[int],
    detail: float,
) -> DeformationBasis:
    """Average what the skin's FAPs do to the cheeks.

    Parameters
    ----------
    basis : DeformationBasis
    points : (V, 3) float64, mm
    triangles : (F, 3)
    head : HeadParts
    feature_points : iterable of int
        Their vertices.
    detail : float
        Of the skin, as of :data:`fapengine.mesh.default_head.style.LEVELS`.
    """
    mouth = head.mouth
    lips = np.unique(mouth.indices[mouth.level <= 1])
    rings = [rings.indices[rings.level > 1].ravel() for rings in (mouth, *(eye.lids for eye in head.eyes))]
    skin = np.unique(np.concatenate([head.grid.ravel(), *rings]))
    held = np.setdiff1d(list(feature_points), lips)
    at = points[skin]
    lids = np.concatenate([eye.lids.indices[eye.lids.level <= 1].ravel() for eye in head.eyes])
    resting = (
        smoothstep((at[:, 1] - BOTTOM) / FADE_MM)
        * smoothstep((at[:, 2] - FRONT_MM) / FADE_MM)
        * smoothstep(cKDTree(points[lips]).query(at)[0] / LIPS_MM)
        * smoothstep(cKDTree(points[np.setdiff1d(held, lids)]).query(at)[0] / POINT_MM)
    )
    speech, lift = np.zeros(len(points)), np.zeros(len(points))
    speech[skin] = resting * smoothstep((TOP - at[:, 1]) / FADE_MM)
    to_margin = smoothstep(cKDTree(points[lids]).query(at)[0] / MARGIN_MM)
    lift[skin] = resting * smoothstep((TOP_OF_LIFTS - at[:, 1]) / FADE_MM) * to_margin
    every = [number for number in FAPS if number not in LIFTS]
    basis = _averaged(basis, triangles, speech, every, round(ROUNDS * detail**2))
    return _averaged(basis, triangles, lift, LIFTS, round(ROUNDS_OF_LIFTS * detail**2))


def _averaged(
    basis: DeformationBasis, triangles: Indices, free: Array, faps: Iterable[int], rounds: int
) -> DeformationBasis:
    """Average over neighbours, where vertices are ``free``, (V,) 0..1, and have entries."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = edges[(free[edges] > 0).any(axis=1)]
    near, ends = np.unique(edges, return_inverse=True)
    first, second = ends.reshape(edges.shape).T
    degree = np.maximum(np.bincount(ends.ravel(), minlength=len(near)), 1)[:, None]
    share = 0.5 * free[near][:, None]
    owner = np.repeat(np.arange(len(free)), np.diff(basis.offsets))
    place = np.searchsorted(near, owner)
    here = near[np.minimum(place, len(near) - 1)] == owner
    entries = basis.entry_mm.copy()
    for number, channel in enumerate(basis.channels):
        if channel.fap not in faps:
            continue
        mine = np.flatnonzero(here & (basis.entry_channels == number))
        moves = np.zeros((len(near), 3))
        moves[place[mine]] = entries[mine]
        for _ in range(rounds):
            around = np.stack(
                [
                    np.bincount(first, moves[second, axis], len(near))
                    + np.bincount(second, moves[first, axis], len(near))
                    for axis in range(3)
                ],
                axis=-1,
            )
            moves += share * (around / degree - moves)
        entries[mine] = moves[place[mine]]
    return replace(basis, entry_mm=entries)
