"""Cheeks without dents: the motion of the skin beside the mouth, evened out.

Theory of operation
-------------------
Near the lips skin follows the rings round them, farther away the fields of real skin. The rings pass from an oval to
the rectangle of their block, and the mixture has the block's corners in it: a smile, which moves the corners of the
lips by 7 mm, had a dent there. So what each FAP does to this skin is averaged over neighbours. Lips and feature points
keep their motion, which is promised. A lifted cheek likewise goes on below the lower lid, whose margin rests:
it rose by 10 mm where the lid stood still 6 mm above, and went over it with an edge.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.head_parts import HeadParts
from fapengine.mesh.default_head.skin import FAPS
from fapengine.mesh.face_mesh import DeformationBasis
from fapengine.mpeg4 import fap

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ROUNDS = 8
"""Averages over neighbours at level ``normal``; a finer mesh takes as many more as its neighbours are nearer."""
LIPS_MM, POINT_MM = 3.0, 4.0
"""Distance from the lips, and from a feature point, at which skin is free."""
TOP, BOTTOM, FADE_MM = 6.0, -74.0, 8.0
"""Heights between which it is, and over how much it becomes so."""
LIFTS, TOP_OF_LIFTS = (41, 42), 34.0
MARGIN_MM, ROUNDS_OF_LIFTS = 5.0, 24
"""The same of lifted cheeks: height, distance from the lids' margins, averages."""
FRONT_MM = 55.0
OWNERS, REACH_MM = (39, 40, 41, 42), 18.0
"""FAPs whose points lie on the cheeks, where averages are put right along each one's direction, and how far around."""


def even_out(
    basis: DeformationBasis,
    points: Array,
    triangles: Indices,
    head: HeadParts,
    feature_points: Mapping[str, int],
    detail: float,
) -> DeformationBasis:
    """Average what the skin's FAPs do to the cheeks.

    Parameters
    ----------
    basis : DeformationBasis
    points : (V, 3) float64, mm
    triangles : (F, 3)
    head : HeadParts
    feature_points : mapping of str to int
        Their vertices.
    detail : float
        Of the skin, as of :data:`fapengine.mesh.default_head.style.LEVELS`.
    """
    mouth = head.mouth
    lips = np.unique(mouth.indices[mouth.level <= 1])
    rings = [rings.indices[rings.level > 1].ravel() for rings in (mouth, *(eye.lids for eye in head.eyes))]
    skin = np.unique(np.concatenate([head.grid.ravel(), *rings]))
    owners = {number: feature_points[fap.spec(number).point] for number in OWNERS}
    held = np.setdiff1d([*feature_points.values()], [*lips, *owners.values()])
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
    evened = _averaged(basis, triangles, speech, every, round(ROUNDS * detail**2))
    evened = _averaged(evened, triangles, lift, LIFTS, round(ROUNDS_OF_LIFTS * detail**2))
    return _put_right(evened, basis, points, owners)


def _put_right(
    evened: DeformationBasis, basis: DeformationBasis, points: Array, owners: Mapping[int, int]
) -> DeformationBasis:
    """Let points of the cheeks go along their own FAPs' directions as before; ``owners`` are vertices by FAP."""
    entries = evened.entry_mm.copy()
    owner = np.repeat(np.arange(len(points)), np.diff(basis.offsets))
    for number, vertex in owners.items():
        direction = np.array(fap.HEAD_AXES[fap.spec(number).positive], dtype=np.float64)
        of_point = slice(basis.offsets[vertex], basis.offsets[vertex + 1])
        lost = np.zeros(basis.width)
        lost[basis.entry_channels[of_point]] = (basis.entry_mm[of_point] - entries[of_point]) @ direction
        away = np.linalg.norm(points - points[vertex], axis=1)
        bump = np.clip(1 - (away / REACH_MM) ** 2, 0, None) ** 2
        entries += ((lost[basis.entry_channels] * bump[owner])[:, None] * direction).astype(np.float32)
    return replace(evened, entry_mm=entries)


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
