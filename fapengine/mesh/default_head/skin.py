"""Skin of the lower face: how it follows the feature points, learned from a real face, and how it is evened out.

Theory of operation
-------------------
``design/learn_skin.py`` finds, for every vertex of a real face, its displacement for each FAP while the others are 0:
dense modes driven by feature points, as in paper 003, section 4, made local by a ridge penalty. The registration of
``design/learn_faces.py`` maps them to a grid of places on the template (:mod:`.faces`), so that nasolabial fold and
cheek are where they were on that face.

Near the lips skin follows the rings around them, farther away these fields. The rings change from an oval to the
rectangle of their block, and the mixture shows the block's corners: a smile, which moves the corners of the lips by
7 mm, had a dent there. So :func:`even_out` averages the displacements of this skin over neighbours. Lips and feature
points keep their motion. A lifted cheek likewise continues below the lower lid, which does not move at its margin.

The table, ``skin.npz``, comes from ICT-FaceKit (MIT licence, University of Southern California, Institute for Creative
Technologies) and from speech of the GRID corpus (Cooke et al. 2006), through the points of ISO/IEC 14496-2.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import NdBSpline
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from fapengine._arrays import Array, read_table
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import average_over_mesh
from fapengine.mesh.default_head.faces import STEP_MM, cubic_surface
from fapengine.mesh.default_head.points import HeadParts
from fapengine.mesh.face_mesh import DeformationBasis
from fapengine.mpeg4 import fap

FAPS = (3, 16, 17, 39, 40, 41, 42, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60)
"""FAPs that move large areas of the lower face. Chin boss and nose have small motions of their own, which speech hardly
shows; the inner lips move no skin, and FAP 14 and 15 are the jaw's alone.
"""
TWINS = {39: 40, 41: 42, 53: 54, 55: 56, 57: 58, 59: 60}
FADE_IN = (0.03, 0.16)
"""Motion in millimetres per millimetre: below the first value skin is still, from the second on it moves fully. Every
field costs time in the vertex shader, and the motion left out is not visible.
"""

_SWAP = [FAPS.index(({**TWINS, **{b: a for a, b in TWINS.items()}}).get(number, number)) for number in FAPS]


def mirror(moves: Array) -> Array:
    """(..., F, 3): displacements of the other half of a face."""
    return moves[..., _SWAP, :] * [-1.0, 1.0, 1.0]


@cache
def skin_table() -> tuple[Array, Array, Array]:
    """Read ``skin.npz``: angles, (A,) rad, heights, (Y,) mm, and displacements of the left half, (A, Y, F * 3) mm."""
    table = read_table(__package__, "skin.npz")
    return np.deg2rad(table["angles_deg"]), table["heights_mm"], STEP_MM * table["moves"]


@cache
def _spline() -> NdBSpline:
    """Displacements, (..., F * 3) mm, over angle, rad, and height, mm, of the left half."""
    return cubic_surface(*skin_table())


def skin_fields(places: ArrayLike) -> dict[int, Array]:
    """Interpolate the displacement of the skin for one millimetre of each FAP.

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
    angles, heights, _ = skin_table()
    fields = np.zeros((len(angle), len(FAPS), 3))
    on = np.flatnonzero((np.abs(angle) <= angles[-1]) & (height >= heights[0]) & (height <= heights[-1]))
    left = _spline()(np.stack([np.abs(angle[on]), height[on]], axis=-1)).reshape(len(on), len(FAPS), 3)
    fields[on] = np.where((angle[on] < 0)[:, None, None], mirror(left), left)
    size = np.linalg.norm(fields, axis=-1, keepdims=True)
    fields *= smoothstep((size - FADE_IN[0]) / (FADE_IN[1] - FADE_IN[0]))
    return dict(zip(FAPS, np.moveaxis(fields, 1, 0), strict=True))


ROUNDS = 12
"""Rounds of averaging at level ``normal``; a finer mesh needs more, as its neighbours are closer."""
LIPS_MM, POINT_MM = 3.0, 4.0
"""Distances from the lips and from a feature point beyond which skin is averaged."""
TOP, BOTTOM, FADE_MM = 6.0, -74.0, 8.0
"""Heights between which skin is averaged, and the length of the transition."""
LIFTS, TOP_OF_LIFTS = (41, 42), 34.0
MARGIN_MM, ROUNDS_OF_LIFTS = 5.0, 24
"""The same for lifted cheeks: upper height, distance from the lid margins, rounds."""
FRONT_MM = 55.0
OWNERS, REACH_MM = (39, 40, 41, 42), 18.0
"""FAPs with points on the cheeks, where averages are corrected along each one's direction, and the reach of the
correction.
"""


def even_out(
    basis: DeformationBasis,
    points: Array,
    links: "csr_array[np.float64]",
    head: HeadParts,
    feature_points: Mapping[str, int],
    detail: float,
) -> DeformationBasis:
    """Average the displacements of the cheeks over neighbours.

    Points are (V, 3) mm, ``links`` those of :func:`fapengine.geometry.surface.mesh_links`, feature points vertices by
    name; ``detail`` is that of the skin, see :data:`fapengine.mesh.default_head.style.LEVELS`.
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
    evened = _averaged(basis, links, speech, every, round(ROUNDS * detail**2))
    evened = _averaged(evened, links, lift, LIFTS, round(ROUNDS_OF_LIFTS * detail**2))
    return _put_right(evened, basis, points, owners)


def _put_right(
    evened: DeformationBasis, basis: DeformationBasis, points: Array, owners: Mapping[int, int]
) -> DeformationBasis:
    """Restore the motion of points on the cheeks along their own FAPs' directions; ``owners`` are vertices by FAP."""
    entries = evened.entry_mm.copy()
    owner = basis.entry_vertices
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
    basis: DeformationBasis, links: "csr_array[np.float64]", free: Array, faps: Iterable[int], rounds: int
) -> DeformationBasis:
    """Average the displacements of some FAPs over neighbours, where there are entries, weighted by ``free``, (V,).

    They fade to 0 at the last vertices with entries, or skin would have a step there.
    """
    chosen = np.array([number for number, channel in enumerate(basis.channels) if channel.fap in faps])
    mine = np.isin(basis.entry_channels, chosen)
    at = basis.entry_vertices[mine], np.searchsorted(chosen, basis.entry_channels[mine])
    moves = np.zeros((len(free), len(chosen), 4))  # the last is 1 at an entry
    moves[at] = np.insert(basis.entry_mm[mine], 3, 1.0, axis=1)
    evened = average_over_mesh(moves, links, rounds, 0.5 * free)[at]
    entries = basis.entry_mm.copy()
    entries[mine] = evened[:, :3] * np.clip(2 * evened[:, 3:] - 1, 0, 1)
    return replace(basis, entry_mm=entries)
