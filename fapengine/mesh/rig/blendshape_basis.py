"""From each FAP to the blendshapes of a rig plus a correction: the deformation basis of an imported head.

Theory of operation
-------------------
The blendshapes' motion of the feature points, measured on the mesh itself, is a matrix ``S`` (blendshapes x FAPs, mm).
A FAP asks its own point to move a step and all others to stay: ``e``. The weights ``a`` of the blendshapes are the
least squares solution

    minimise  |a S - e|^2 / noise^2 + |a|^2 / usual^2,

where ``noise`` is the tolerance of a feature point (mm) and ``usual`` a typical weight of a blendshape. The rest,
``e - a S``, is added by the fields of least bending of :mod:`fapengine.mesh.rig.parts`. So every FAP moves its
own point by exactly its step and no other point, and looks like the rig as far as the rig allows; and FAPs that come
from a pose of the rig reproduce that pose, because everything is linear. Weights may be negative: bounded ones leave
more to the fields (``design/tried.md``).

The renderer sums blendshapes and fields, not FAPs: a vertex has fewer of them. Their weights are sums of the channels
(``DeformationBasis.mix``). Lids slide over their eyeball by further channels with the
deviation of a sliding vertex from the straight line.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.mesh.face_mesh import Channel, DeformationBasis, gather
from fapengine.mesh.rig.parts import Eyes, PointFields, find_tongue
from fapengine.mesh.rig.placed_mesh import PlacedMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

NOISE_MM, USUAL_WEIGHT = 1.5, 0.3
MIN_MOTION_SHARE = 0.02
"""Motion of a blendshape, relative to the FAP's own, below which it is dropped from the FAP."""
MIN_JAW_MM = 4.0
"""Motion of the chin from which a blendshape opens the jaw."""
ROW_FAPU = 1000.0
"""Weight that the displacements of a row refer to: a blendshape at full weight, as FAPs are of this order there."""
NEGLIGIBLE_MM = 0.1
"""Displacement, at that weight, below which a vertex is dropped from a row."""
MAX_ROWS = 128
"""Rows that fit into the shaders."""
JAW_FAPS = (3, 14, 15)
EYE_THRUST_FAPS = (27, 28)
CHIN_FAP = 18
"""FAP that moves the chin relative to the jaw: both refer to point 2.1."""
TONGUE_FAPS = (43, 44, 45, 46, 47)
TONGUE_SHIFTS = (43, 44, 45)
"""FAPs that move a tongue without blendshapes."""
TONGUE_STIFFNESS = 1.6
"""Exponent of the position from root (0) to tip (1) by which vertices of a tongue move."""


PUPILS = {19: "3.5", 20: "3.6", 21: "3.5", 22: "3.6"}
"""Pupil of the eye of each lid's FAP."""
KNOTS = (0.0, 341.0, 683.0, 1024.0, 1100.0)
"""Values of the FAP, FAPU, between which vertices of a lid move in straight lines."""
SHUT, WIDE_OPEN = 1024.0, -600.0
"""Values of the FAP, FAPU, that close a lid and open it wide."""
SAMPLES, SAMPLED_SHARE = 240, 1.3
"""Number of samples of a lid's path, and the fraction of it that they cover."""
MIN_CLEARANCE_RATIO = 1.02
"""Distance from the centre of the eye, in radii, that a closing lid keeps."""
MAX_RISE_RATIO = 1.03
"""Distance from the centre of the eye, relative to rest, that a closing lid does not exceed."""
USUAL_RADIUS_MM = 12.0
"""Radius of an eye without a ball."""
SLIDING_RADII, STRAIGHT_RADII = 1.35, 1.9
"""Distance from the centre of the eye, in radii, up to which skin slides over the ball, and from which it moves
straight.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinate:
    """One FAP as the direction of a feature point's motion."""

    number: int
    point: str
    vertex: int
    axis: Array
    """(3,), of unit length."""


def coordinates(points: Mapping[str, int], jaw: bool) -> list[Coordinate]:
    """FAPs that shift a point of the skin, by the vertices of its feature points; those of the jaw only if ``jaw``."""
    shifted = []
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.unit is fap.FapUnit.AU or row.point not in points or row.number in TONGUE_FAPS:
            continue
        if row.number in EYE_THRUST_FAPS or (row.number in JAW_FAPS and not jaw):
            continue
        shifted.append(Coordinate(row.number, row.point, points[row.point], np.array(axis, dtype=np.float64)))
    return shifted


def blend(moves: Array, faps: Sequence[Coordinate], chin: int, demanded: Array) -> tuple[Array, Array]:
    """Solve for the blendshapes of each FAP.

    Parameters
    ----------
    moves : (B, V, 3) mm
        Motion by each blendshape at full weight.
    faps : sequence of Coordinate
        N of them.
    chin : int
        Vertex of feature point 2.1.
    demanded : (N, B)
        Weight of blendshapes for 1 mm of each coordinate that a mapping prescribes; NaN in the column of a free one.

    Returns
    -------
    (N, B)
        Weight of each blendshape for 1 mm of each coordinate.
    (N, N)
        Remaining error of each FAP in its own and the other coordinates, mm for 1 mm.
    """
    shifts = np.stack([_shift(moves, coordinate, chin) for coordinate in faps], axis=1)
    free = np.isnan(demanded).all(axis=0)
    weights = np.where(free, 0.0, demanded)
    wanted = np.eye(len(faps)) - weights @ shifts
    ridge = (NOISE_MM / USUAL_WEIGHT) ** 2 * np.eye(int(free.sum()))
    weights[:, free] = np.linalg.solve(shifts[free] @ shifts[free].T + ridge, shifts[free] @ wanted.T).T
    farthest = np.linalg.norm(moves, axis=2).max(axis=1)
    weights[np.abs(weights) * farthest < MIN_MOTION_SHARE] = 0.0
    errors: Array = np.eye(len(faps)) - weights @ shifts
    return weights, errors


def _shift(moves: Array, coordinate: Coordinate, chin: int) -> Array:
    """(B,) mm: motion along a coordinate by each blendshape."""
    motion = moves[:, coordinate.vertex] - (moves[:, chin] if coordinate.number == CHIN_FAP else 0.0)
    return motion @ coordinate.axis


class RowCollector:
    """Collects channels, and rows of displacements weighted by them, into a basis.

    Stateful.
    """

    def __init__(self, vertex_count: int) -> None:
        self._count = vertex_count
        self.channels: list[Channel] = []
        self._rows: list[tuple[Indices, Array, dict[int, float]]] = []

    def channel(self, channel: Channel) -> int:
        """Find or add a channel; returns its index."""
        if channel not in self.channels:
            self.channels.append(channel)
        return self.channels.index(channel)

    def add(self, vertices: Indices, moves: Array, weights: Mapping[int, float]) -> None:
        """Add a row: displacements (N, 3) mm of vertices (N,) at a weight of 1000 FAPU, and each channel's weight."""
        kept = np.abs(moves).max(axis=1, initial=0.0) > NEGLIGIBLE_MM
        weights = {channel: weight for channel, weight in weights.items() if weight}
        if kept.any() and weights:
            self._rows.append((vertices[kept], moves[kept] / ROW_FAPU, weights))

    def basis(self) -> DeformationBasis:
        """Return the basis; of more than :data:`MAX_ROWS` rows those that move most are kept."""
        if not self._rows:
            return DeformationBasis(
                channels=(), offsets=np.zeros(self._count + 1, np.int32), entry_channels=np.zeros(0, np.int32),
                entry_mm=np.zeros((0, 3), np.float32),
            )  # fmt: skip
        reach = [float(np.abs(moves).max()) * max(map(abs, weights.values())) for _, moves, weights in self._rows]
        kept = [self._rows[row] for row in sorted(np.argsort(reach)[-MAX_ROWS:].tolist())]
        mix = np.zeros((len(kept), len(self.channels)), np.float32)
        for row, (_, _, weights) in zip(mix, kept, strict=True):
            row[list(weights)] = list(weights.values())
        entries = [(vertices, row, moves) for row, (vertices, moves, _) in enumerate(kept)]
        return gather(self._count, self.channels, entries, mix)[0]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rig:
    """The moving parts of a placed mesh: blendshapes, skin and eyes."""

    mesh: PlacedMesh
    moves: Array
    """(B, V, 3) mm: motion by each blendshape at full weight."""
    own_faps: Sequence[Mapping[int, float] | None]
    """(B,): a blendshape's own FAPs, FAPU at full weight; None for a free one."""
    fields: PointFields
    eyes: Eyes

    @property
    def chin(self) -> int:
        """Vertex of feature point 2.1."""
        return self.mesh.points["2.1"]

    @property
    def carried_mm(self) -> Array:
        """(V,) mm: largest motion of each vertex by a blendshape."""
        return np.linalg.norm(self.moves, axis=2).max(axis=0, initial=0.0)

    @property
    def opens_jaw(self) -> bool:
        """Whether a blendshape opens the jaw."""
        return bool(np.linalg.norm(self.moves[:, self.chin], axis=1).max(initial=0.0) > MIN_JAW_MM)


def build_basis(rig: Rig, fapu: Fapu) -> tuple[DeformationBasis, list[int]]:
    """Make the basis of a rig, and return the FAPs that move it by more than bones."""
    collector = RowCollector(len(rig.mesh.vertices_mm))
    faps = coordinates(rig.fields.points, rig.opens_jaw)
    _add_coordinates(collector, rig, faps, fapu)
    moved = [coordinate.number for coordinate in faps]
    moved += [number for own_faps in rig.own_faps for number in own_faps or ()]
    moved += _add_tongue(collector, rig.mesh, fapu, without=moved)
    return collector.basis(), moved


def _add_coordinates(collector: RowCollector, rig: Rig, faps: Sequence[Coordinate], fapu: Fapu) -> None:
    """Add the blendshapes, and the fields for the remaining error, for all coordinates."""
    steps = np.array([fapu.unit(fap.spec(coordinate.number).unit) for coordinate in faps])
    weights, errors = blend(rig.moves, faps, rig.chin, _demanded(rig, faps, steps))
    signed = [_signed_channels(collector, coordinate, rig.eyes) for coordinate in faps]

    def mixed(per_mm: Array) -> dict[int, float]:
        """Weight of each channel in a row, from the row's weight for 1 mm of each coordinate, (N,)."""
        return {
            channel: float(ROW_FAPU * per_mm[row] * steps[row] * sign)
            for row, channels in enumerate(signed)
            for channel, sign in channels
        }

    everything = np.arange(len(rig.mesh.vertices_mm))
    for column, moves in enumerate(rig.moves):
        own = _own_weights(collector, rig.own_faps[column], faps)
        collector.add(everything, moves, mixed(weights[:, column]) | own)
    for column, coordinate in enumerate(faps):
        collector.add(rig.fields.vertices, _field_moves(rig, coordinate), mixed(errors[:, column]))
    for row, coordinate in enumerate(faps):
        if _slides(coordinate.number, rig.eyes):
            straight = np.tensordot(weights[row], rig.moves, axes=1)
            for column, other in enumerate(faps):
                straight[rig.fields.vertices] += errors[row, column] * _field_moves(rig, other)
            for channel, vertices, moves in _bend(rig, coordinate, steps[row], straight * steps[row]):
                per_row = ROW_FAPU * moves / (channel.stop - channel.start)
                collector.add(vertices, per_row, {collector.channel(channel): 1.0})


def _field_moves(rig: Rig, coordinate: Coordinate) -> Array:
    """(S + M, 3): motion of the skin for 1 mm of a coordinate that no blendshape produces."""
    share = rig.fields.jaw if coordinate.number in JAW_FAPS else rig.fields.shares[coordinate.point]
    return share[:, None] * coordinate.axis


def _demanded(rig: Rig, faps: Sequence[Coordinate], steps: Array) -> Array:
    """(N, B): weights for 1 mm that a mapping prescribes; NaN for blendshapes that it does not name."""
    weights = np.full((len(faps), len(rig.moves)), np.nan)
    for column, own_faps in enumerate(rig.own_faps):
        if own_faps is not None:
            shared = {row: own_faps[c.number] for row, c in enumerate(faps) if c.number in own_faps}
            weights[:, column] = 0.0
            for row, value in shared.items():
                weights[row, column] = 1.0 / (value * steps[row] * len(shared))
    return weights


def _own_weights(
    collector: RowCollector, own_faps: Mapping[int, float] | None, faps: Sequence[Coordinate]
) -> dict[int, float]:
    """Weights of a blendshape's own FAPs that no feature point measures."""
    shown = {coordinate.number for coordinate in faps}
    return {
        collector.channel(Channel(number, 0.0, float(np.copysign(np.inf, value)))): ROW_FAPU / abs(value)
        for number, value in (own_faps or {}).items()
        if number not in shown
    }


def _signed_channels(collector: RowCollector, coordinate: Coordinate, eyes: Eyes) -> list[tuple[int, float]]:
    """Channels of a FAP and their signs; those of a lid stop where it is closed."""
    if not _slides(coordinate.number, eyes):
        return [(collector.channel(Channel(coordinate.number, -np.inf, np.inf)), 1.0)]
    return [
        (collector.channel(Channel(coordinate.number, 0.0, KNOTS[-1])), 1.0),
        (collector.channel(Channel(coordinate.number, 0.0, WIDE_OPEN)), -1.0),
    ]


def _add_tongue(collector: RowCollector, mesh: PlacedMesh, fapu: Fapu, without: Sequence[int]) -> list[int]:
    """Move a tongue separate from the skin, most at its tip, not at its root, by FAPs that do not move it yet."""
    tongue = find_tongue(mesh)
    if tongue is None:
        return []
    share = tongue.share**TONGUE_STIFFNESS
    moved = [number for number in TONGUE_SHIFTS if number not in without]
    for number in moved:
        row = fap.spec(number)
        moves = share[:, None] * (fapu.unit(row.unit) * np.array(fap.HEAD_AXES[row.positive]))
        collector.add(tongue.vertices, ROW_FAPU * moves, {collector.channel(Channel(number, -np.inf, np.inf)): 1.0})
    return moved


def _slides(number: int, eyes: Eyes) -> bool:
    """Whether a FAP moves a lid of a known eye."""
    return number in PUPILS and PUPILS[number] in eyes


def _bend(rig: Rig, lid: Coordinate, step_mm: float, motion: Array) -> Iterator[tuple[Channel, Indices, Array]]:
    """Lead a lid around its eyeball, piece by piece, its point moving up or down by exactly the FAP's steps.

    ``motion`` is the straight motion for one FAPU, (V, 3) mm, which exists already. Yields a channel, its vertices,
    (N,), and the displacement over the whole piece from the straight path to the one around the ball, (N, 3) mm.
    """
    ball, centre = rig.eyes[PUPILS[lid.number]]
    arm = rig.mesh.vertices_mm - centre
    radius = float(np.median(np.linalg.norm(arm[ball], axis=1))) if len(ball) else USUAL_RADIUS_MM
    inside = np.linalg.norm(arm, axis=1) < STRAIGHT_RADII * radius
    near = np.flatnonzero(inside & (np.abs(motion).max(axis=1) > 0))
    arm, closing = arm[near], motion[near] * SHUT
    own = np.flatnonzero(near == lid.vertex)
    if not len(own):
        return
    shares = np.linspace(0.0, SAMPLED_SHARE, SAMPLES)
    path = np.stack([_round_ball(arm[own], closing[own], share, radius)[0] for share in shares])
    reached = (path - path[0]) @ lid.axis
    top = int(reached.argmax()) + 1
    bent = []
    for knot in KNOTS:
        share = float(np.interp(knot * step_mm, reached[:top], shares[:top]))
        bent.append(_round_ball(arm, closing, share, radius) - arm - closing * (knot / SHUT))
    for (start, before), (stop, after) in pairwise(zip(KNOTS, bent, strict=True)):
        yield Channel(lid.number, start, stop), near, after - before


def _round_ball(arm: Array, closing: Array, share: float, radius: float) -> Array:
    """(N, 3): vertices after a fraction of their path, at a distance from the eye's centre between its ends."""
    straight = arm + share * closing
    first, last, now = (np.linalg.norm(end, axis=1) for end in (arm, arm + closing, straight))
    last = np.clip(last, np.minimum(first, MIN_CLEARANCE_RATIO * radius), MAX_RISE_RATIO * first)
    wanted = first + min(share, 1.0) * (last - first)
    slides_by = (STRAIGHT_RADII - first / radius) / (STRAIGHT_RADII - SLIDING_RADII)
    stretch = 1.0 + np.clip(slides_by, 0.0, 1.0) * (wanted / np.maximum(now, 1e-9) - 1.0)
    return straight * stretch[:, None]
