"""From each FAP to the shapes of a rig, and what they lack: the deformation basis of a mesh with morph targets.

Theory of operation
-------------------
The shapes' motion of the feature points, measured on the mesh itself, is a matrix ``S`` (shapes x FAPs, mm). A FAP
asks its own point to go a step and all others to stay: ``e``. Shapes ``a`` answer with least squares,

    minimise  |a S - e|^2 / noise^2 + |a|^2 / usual^2,

where ``noise`` is what a feature point may be off (mm) and ``usual`` a shape's usual weight. What remains,
``e - a S``, is made up for by the fields of least bending that :mod:`fapengine.mesh.adopted` gives any mesh. So every
FAP moves its own point by exactly its step and no other point, in the rig's own manner as far as the rig knows one;
and FAPs that come from a pose of the rig give that pose back, because all of it is linear.

The renderer adds up shapes and fields, not FAPs: a vertex has fewer of them. Their weights are sums of the channels
(``DeformationBasis.mix``). Lids follow their eyeball by further channels that say how far a vertex that slides over it
is from the straight line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.mesh.adopted import LIDS, Fields
from fapengine.mesh.adopted_parts import Eyes
from fapengine.mesh.face_mesh import Channel, DeformationBasis
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NOISE_MM, USUAL = 1.5, 0.3
FAINT = 0.02
"""Shapes that move nothing farther than this share of the FAP's own motion are left out of it."""
UNIT = 1000.0
"""A row's displacements are given for so many FAPU: a shape at full weight, as FAPs are large there."""
NEGLIGIBLE_MM = 0.1
"""Displacements below this, at that weight, are left out."""
MOST_ROWS = 128
"""Room in the shaders."""
JAW_FAPS = (3, 14, 15)
CHIN_FAP = 18
"""Moves the chin against the jaw: both are counted from point 2.1."""
TONGUE_FAPS = (43, 44, 45, 46, 47)
LID_KNOTS = (0.0, 341.0, 683.0, 1024.0, 1100.0)
LID_OPEN = -600.0
SAMPLES = 240
CLEARANCE, SWELLING = 1.02, 1.03
"""A lid that shuts comes no nearer to the eye's centre than the first, in radii, and is raised no more than by the
second, in its distance at rest."""
BALL_MM = 12.0
"""Radius of an eye whose ball is not there."""
LID_REACH = (1.35, 1.9)
"""In radii of the eyeball: skin nearer than the first slides over it, skin beyond the second moves straight."""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinate:
    """One FAP as a direction in which a feature point goes."""

    number: int
    point: str
    vertex: int
    axis: Array
    """(3,), of unit length."""


def coordinates(points: Mapping[str, int], jaw: bool) -> list[Coordinate]:
    """FAPs that shift a point of the skin, the jaw's too where shapes move it."""
    found = []
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.unit is fap.FapUnit.AU or row.point not in points or row.number in TONGUE_FAPS:
            continue
        if row.number in (27, 28) or (row.number in JAW_FAPS and not jaw):
            continue
        found.append(Coordinate(row.number, row.point, points[row.point], np.array(axis, dtype=np.float64)))
    return found


def blend(moves: Array, asked: Sequence[Coordinate], chin: int, given: Array) -> tuple[Array, Array]:
    """Solve for the shapes of each FAP.

    Parameters
    ----------
    moves : (B, V, 3) mm
        Of the shapes at full weight.
    asked : sequence of Coordinate
    chin : int
        Vertex of feature point 2.1.
    given : (N, B)
        Weight of shapes for 1 mm of each coordinate that a mapping demands; NaN in a shape's column that is free.

    Returns
    -------
    (N, B)
        Weight of each shape for 1 mm of each coordinate.
    (N, N)
        What each FAP's own and the others' coordinates then lack, mm for 1 mm.
    """
    seen = np.stack([_seen(moves, one, chin) for one in asked], axis=1)
    free = np.isnan(given).all(axis=0)
    demanded = np.where(free, 0.0, given)
    wanted = np.eye(len(asked)) - demanded @ seen
    ridge = (NOISE_MM / USUAL) ** 2 * np.eye(int(free.sum()))
    weights = demanded.copy()
    weights[:, free] = np.linalg.solve(seen[free] @ seen[free].T + ridge, seen[free] @ wanted.T).T
    farthest = np.linalg.norm(moves, axis=2).max(axis=1)
    weights[np.abs(weights) * farthest < FAINT] = 0.0
    lacks: Array = np.eye(len(asked)) - weights @ seen
    return weights, lacks


def _seen(moves: Array, one: Coordinate, chin: int) -> Array:
    """(B,) mm: how far each shape carries a coordinate."""
    shift = moves[:, one.vertex] - (moves[:, chin] if one.number == CHIN_FAP else 0.0)
    gone: Array = shift @ one.axis
    return gone


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """What a mesh with shapes brings to its basis."""

    place: Array
    """(V, 3) mm."""
    moves: Array
    """(B, V, 3) mm, of the shapes at full weight."""
    skin: Indices
    """(S,): vertices of the skin."""
    fields: Fields
    """By point: (S,) what is 1 there and 0 at the others."""
    jaw: Array
    """(S,): how much of the skin goes with the chin."""
    chin: int
    """Vertex of feature point 2.1."""
    eyes: Eyes
    """Centres that lids turn about."""
    given: Sequence[Mapping[int, float] | None]
    """(B,): FAPs that a shape means by itself, FAPU at full weight; None for one that is free."""


class Mixer:
    """Stateful: gathers channels, and rows of displacements that they weigh."""

    def __init__(self, vertex_count: int) -> None:
        self._count = vertex_count
        self.channels: list[Channel] = []
        self._entries: list[tuple[Indices, Array]] = []
        self._weights: list[dict[int, float]] = []

    def channel(self, channel: Channel) -> int:
        """Find or add a channel."""
        if channel not in self.channels:
            self.channels.append(channel)
        return self.channels.index(channel)

    def add(self, vertices: Indices, moves: Array, weights: Mapping[int, float]) -> None:
        """Add a row: what moves, (N, 3) mm at a weight of 1000 FAPU, and what each channel weighs in it."""
        kept = np.abs(moves).max(axis=1, initial=0.0) > NEGLIGIBLE_MM
        weights = {channel: weight for channel, weight in weights.items() if weight}
        if kept.any() and weights:
            self._entries.append((vertices[kept], moves[kept] / UNIT))
            self._weights.append(weights)

    def one(self, channel: Channel, vertices: Indices, displacement_mm: Array) -> None:
        """Add a channel of its own: vertices (N,) and their displacement (N, 3) mm per FAPU."""
        self.add(vertices, UNIT * displacement_mm, {self.channel(channel): 1.0})

    def basis(self) -> DeformationBasis:
        """Sort what was added by vertex."""
        if len(self._entries) > MOST_ROWS:
            self._leave_out_weakest()
        mix = np.zeros((len(self._weights), len(self.channels)))
        for row, weights in enumerate(self._weights):
            mix[row, list(weights)] = list(weights.values())
        vertices = np.concatenate([np.zeros(0, np.int64), *(entry[0] for entry in self._entries)])
        rows = np.repeat(np.arange(len(self._entries)), [len(entry[0]) for entry in self._entries])
        moves = np.concatenate([np.zeros((0, 3)), *(entry[1] for entry in self._entries)])
        order = np.argsort(vertices, kind="stable")
        return DeformationBasis(
            channels=tuple(self.channels),
            offsets=np.concatenate([[0], np.cumsum(np.bincount(vertices, minlength=self._count))]).astype(np.int32),
            entry_channels=rows[order].astype(np.int32),
            entry_mm=moves[order].astype(np.float32),
            mix=mix.astype(np.float32),
        )

    def _leave_out_weakest(self) -> None:
        """Keep the rows that move most."""
        reach = [
            float(np.abs(moves).max()) * max(map(abs, weights.values()))
            for (_, moves), weights in zip(self._entries, self._weights, strict=True)
        ]
        kept = sorted(np.argsort(reach)[-MOST_ROWS:].tolist())
        self._entries = [self._entries[row] for row in kept]
        self._weights = [self._weights[row] for row in kept]


def add_shapes(mixer: Mixer, rig: Rig, asked: Sequence[Coordinate], fapu: Fapu) -> None:
    """Add the shapes, and the fields of what they lack, for all coordinates."""
    steps = np.array([fapu.unit(fap.spec(one.number).unit) for one in asked])
    weights, lacks = blend(rig.moves, asked, rig.chin, _demanded(rig, asked, steps))
    sides = [_sides(mixer, one, rig.eyes) for one in asked]

    def mixed(per_mm: Array) -> dict[int, float]:
        """Weigh channels by what a row takes of each coordinate."""
        return {
            channel: float(UNIT * per_mm[row] * steps[row] * sign)
            for row, channels in enumerate(sides)
            for channel, sign in channels
        }

    everything = np.arange(len(rig.place))
    for shape, moves in enumerate(rig.moves):
        mixer.add(everything, moves, mixed(weights[:, shape]) | _alone(mixer, rig.given[shape], asked))
    for column, one in enumerate(asked):
        share = rig.jaw if one.number in JAW_FAPS else rig.fields[one.point]
        mixer.add(rig.skin, share[:, None] * one.axis, mixed(lacks[:, column]))
    for row, one in enumerate(asked):
        if _slides(one, rig.eyes):
            straight = np.tensordot(weights[row], rig.moves, axes=1)
            for column, other in enumerate(asked):
                share = rig.jaw if other.number in JAW_FAPS else rig.fields[other.point]
                straight[rig.skin] += lacks[row, column] * share[:, None] * other.axis
            _lead_lid(mixer, rig, one, straight * steps[row], steps[row])


def _demanded(rig: Rig, asked: Sequence[Coordinate], steps: Array) -> Array:
    """(N, B): weights for 1 mm that a mapping says; NaN for shapes of which it says nothing."""
    found = np.full((len(asked), len(rig.moves)), np.nan)
    for shape, faps in enumerate(rig.given):
        if faps is not None:
            shared = {row: faps[one.number] for row, one in enumerate(asked) if one.number in faps}
            found[:, shape] = 0.0
            for row, value in shared.items():
                found[row, shape] = 1.0 / (value * steps[row] * len(shared))
    return found


def _alone(mixer: Mixer, faps: Mapping[int, float] | None, asked: Sequence[Coordinate]) -> dict[int, float]:
    """Weights of the FAPs that a shape means and no feature point shows."""
    shown = {one.number for one in asked}
    return {
        mixer.channel(Channel(number, 0.0, float(np.copysign(np.inf, value)))): UNIT / abs(value)
        for number, value in (faps or {}).items()
        if number not in shown
    }


def _slides(one: Coordinate, eyes: Eyes) -> bool:
    return one.number in LIDS and LIDS[one.number][1] in eyes


def _sides(mixer: Mixer, one: Coordinate, eyes: Eyes) -> list[tuple[int, float]]:
    """Channels of a FAP and their signs: a lid's stop where it is shut."""
    if not _slides(one, eyes):
        return [(mixer.channel(Channel(one.number, -np.inf, np.inf)), 1.0)]
    return [
        (mixer.channel(Channel(one.number, 0.0, LID_KNOTS[-1])), 1.0),
        (mixer.channel(Channel(one.number, 0.0, LID_OPEN)), -1.0),
    ]


def _lead_lid(mixer: Mixer, rig: Rig, lid: Coordinate, motion: Array, step: float) -> None:
    """Lead a lid round its eyeball, in pieces, its point going down (up) by exactly the FAP's steps.

    The straight motion, (V, 3) mm per FAPU, is there already; what is added is the way from it to the round one.
    """
    ball, centre = rig.eyes[LIDS[lid.number][1]]
    radius = float(np.median(np.linalg.norm(rig.place[ball] - centre, axis=1))) if len(ball) else BALL_MM
    shut = LID_KNOTS[-2]
    rest = rig.place - centre
    inside = np.linalg.norm(rest, axis=1) < LID_REACH[1] * radius
    near = np.flatnonzero(inside & (np.abs(motion).max(axis=1) > 0))
    rest, way = rest[near], motion[near] * shut
    own = np.flatnonzero(near == lid.vertex)
    if not len(own):
        return
    gone = np.linspace(0.0, 1.3, SAMPLES)
    path = np.stack([_round(rest[own], way[own], share, radius)[0] for share in gone])
    reached = (path - path[0]) @ lid.axis
    top = int(reached.argmax()) + 1
    bent = []
    for knot in LID_KNOTS:
        share = float(np.interp(knot * step, reached[:top], gone[:top]))
        bent.append(_round(rest, way, share, radius) - rest - way * (knot / shut))
    for first, last, one, following in zip(LID_KNOTS, LID_KNOTS[1:], bent, bent[1:], strict=False):
        channel = mixer.channel(Channel(lid.number, first, last))
        mixer.add(near, UNIT * (following - one) / (last - first), {channel: 1.0})


def _round(rest: Array, way: Array, share: float, radius: float) -> Array:
    """(N, 3): vertices after a share of their way, as far from the eye's centre as lies between its two ends."""
    there = rest + share * way
    first, last, now = (np.linalg.norm(place, axis=1) for place in (rest, rest + way, there))
    last = np.clip(last, np.minimum(first, CLEARANCE * radius), SWELLING * first)
    wanted = first + min(share, 1.0) * (last - first)
    near, far = LID_REACH
    slides = np.clip((far - first / radius) / (far - near), 0.0, 1.0)[:, None]
    led: Array = there * (1.0 + slides * (wanted / np.maximum(now, 1e-9) - 1.0)[:, None])
    return led
