"""Haircuts: the surface over which hair falls, and the layers and locks that lie on it.

Theory of operation
-------------------
:class:`Fall` is a smooth surface over two coordinates: ``t`` runs from where hair begins (0) to its ends (1), ``s``
round the back (0) to either side. Short hair begins at the crown and falls to the hairline all round, over the forehead
to the right: ``s`` is 1 or -1 in front. Longer hair begins at a side parting: ``s`` runs from the right temple (-1) to
the left one (1). It is at the height of the ears at ``t`` = 0.5 and hangs from there; below the front edge its surface
goes on over the skin, up to ``s`` of :data:`BEYOND`. :mod:`.strands` covers the surface with layers of strands and lays
locks and single hairs over it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.default_head.faces import hairline, position, under_hair
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM

TOP_MM = 144.0
"""Height above which the scalp is not measured."""
EARS_MM = 36.0
"""Height from which long hair hangs."""
EAR_MM = 6.0
"""Additional height of hanging hair over an ear."""
WAVE_MM = 150.0
"""Wave length of hanging hair."""
FRONT_MM = (22.0, 76.0)
"""How far below the hairline, and down to what height, the surface is continued in front."""
TURN, TURN_STEPS = 0.35, 4.0
"""How far hanging hair is smoothed where it turns down beside the face, and over how many steps of ``t``."""
RELIEF_MM = 4.5
"""Half the difference in height between the middles and the borders of groups of hair."""
BEYOND, BEYOND_MM = 1.25, 72.0
"""How far the surface is continued below the front edge, in ``s``, and how low one step of ``s`` is there."""
Table = tuple[tuple[float, ...], tuple[float, ...]]
"""Places and values between which is interpolated."""


class Layer(NamedTuple):
    """Strands side by side."""

    strands: int
    first: float
    last: float
    """``t`` where they begin and where the longest ends."""
    uneven: float
    """Unevenness of the ends."""
    tapers_from: float
    """Share of a strand's length from which it tapers."""
    up_mm: tuple[float, float]
    """Height above the surface at first and at the tips."""
    lead: tuple[tuple[float, float], ...] = ()
    """``t`` where the strands nearest to the face end, and their widths; others have 0.6 to 1.5."""
    reach: float = 1.0
    """Greatest distance from the back of the head."""
    shade: float = 1.0
    is_inside: bool = False
    tips: float = 0.0
    """Least width of the tips, relative to that above them."""


class Locks(NamedTuple):
    """Locks side by side, arched and pointed: values of the first and the last, between which the others lie."""

    blades: int
    root: tuple[tuple[float, float], tuple[float, float]]
    """``s`` and ``t`` where the first and the last begin."""
    tip: tuple[tuple[float, float], tuple[float, float]]
    width_mm: tuple[float, float]
    up_mm: tuple[float, float, float]
    """Height above the surface at the root, half way and at the tip."""
    bow: float = 0.0
    """How far they bend sideways, in ``s``."""
    uneven: float = 0.08
    """Unevenness of the tips, in ``t``."""
    stray: float = 0.0
    """Unevenness of the tips, in ``s``."""
    shade: float = 1.0
    is_single: bool = False
    """Single hairs, ``Material.STRAND``, as wide as given at their roots."""


class Cut(NamedTuple):
    """What distinguishes a haircut; tables over ``u`` run from the back of the head, 0, to the temple, 1."""

    rows: int
    """Rows of a strand from ``t`` = 0 to 1."""
    layers: tuple[Layer, ...]
    locks: tuple[Locks, ...] = ()
    close: float = 0.0
    """How much closer to the head short hair is, and how much shorter its fringe: 0 to 1."""
    ends_mm: Table | None = None
    """Height of the ends over ``u``; None if hair falls from the crown to the hairline."""
    outwards_mm: Table = ((0.0,), (0.0,))
    """Distance outwards, mm, over the distance below the ears."""
    waves: float = 0.0
    groups: int = 0
    """Groups of hair on either side."""
    gather: float = 0.85
    """How closely groups gather towards their ends, 0 to 1."""
    forward_mm: float = 0.0
    backward_mm: float = 0.0
    """Distances of the ends to the front and to the back over the shoulders."""


BEND_AT = (0.0, 0.5, 0.8, 1.0)
BEND = (180.0, 112.0, 66.0, 50.0), (112.0, 124.0, 112.0, 88.0)
"""Angle from the front, degrees, and height, mm, to which lines of hanging hair bend on their way, over ``u``."""
RISE = (0, 0.25, 0.6, 1), (12.0, 14.0, 12.0, 7.4)
"""Height of hanging hair above the scalp, mm, over the share of the way on the head."""
FRONT = (-66, -50, -30, -8, 8, 18, 27, 36, 50, 66), (16.0, 20.0, 17.0, 11.0, 7.0, 4.5, 4.0, 6.0, 14.0, 14.0)
"""Depth of its front edge below the hairline, mm, by angle from the front, degrees."""
LEFT_EDGE_MM = 0.0
"""Its height above the skin from the parting to the left temple: no gap shows there from the right."""
PARTING_DEG = 28.0
"""Angle at which the parting begins."""
CROWN_MM = 14.0, 144.0, -30.0
"""Where short hair begins."""
TO_RIGHT_DEG, FROM_LEFT_DEG, SWEPT_DEG = 62.0, 22.0, 56.0
"""Angles by which short hair in front ends farther to the right than it begins, and bends to the left before; and the
angle from the front at which it does so less.
"""
FRINGE_MM, FRINGE_RIGHT_MM, FRINGE_AT_DEG = 17.0, 9.0, (-32.0, 30.0, 42.0)
"""How far a fringe falls below the hairline, and how much farther at the right; where that is, its width, and that of
the fringe.
"""
MIN_FRINGE_MM = 75.0
"""Height below which no fringe falls over the forehead."""
SHORT_DEG = 0, 40, 60, 80, 100, 120, 150, 180
BENDS_MM, ENDS_MM = (130, 122, 112, 104, 98, 96, 94, 92), (0, 4, 12, 0, 0, 8, 3, 0)
"""Heights to which short hair bends on its way, and of its ends above the hairline, by angle from the front. At the
temples painted roots show below the ends: a soft edge.
"""
SHORT_AT = 0, 0.2, 0.45, 0.7, 0.85, 1
SHORT_RISE = (11, 17, 22, 22, 12.5, 3.5), (11, 12, 10, 5, 1.8, -0.4), (11, 10, 8, 5, 2.5, 0.2)
"""Height of short hair above the scalp, mm, over the share of its way: in front, at the sides and at the back."""
SIDES_DEG, SIDES_WIDE_DEG = 95.0, 36.0
"""Angle of the sides from the front, and their width."""
# fmt: off
FRINGE = (
    Locks(22, ((0.70, 0.45), (1.05, 0.45)), ((0.72, 0.97), (1.06, 1.0)), (16, 18), (-6.0, 2.2, 1.0), uneven=0.03,
          stray=0.015),
    Locks(7, ((0.79, 0.16), (1.12, 0.16)), ((0.83, 0.84), (1.16, 0.94)), (30, 36), (-7, 4.2, 1.0), uneven=0.05),
)
"""Locks over the forehead, and over them."""
SWEPT = (
    Locks(7, ((-0.90, 0.06), (-0.74, 0.03)), ((-1.00, 0.60), (-0.92, 0.66)), (22, 32), (-3.0, 4.5, 0.3), uneven=0.03),
    Locks(8, ((-0.92, 0.03), (-0.40, 0.03)), ((-0.98, 0.60), (-0.64, 0.62)), (34, 38), (-4.5, 5.0, 0.3), uneven=0.04),
    Locks(4, ((0.90, 0.03), (0.76, 0.03)), ((0.91, 0.50), (0.78, 0.58)), (22, 30), (-2.0, 3.0, 0.3), uneven=0.04),
    *(Locks(5, ((0.79 * side, 0.10), (0.50 * side, 0.16)), ((0.84 * side, 0.50), (0.58 * side, 0.60)), (20, 22),
            (-3.0, 3.5, 0.3), bow=-0.03 * side, stray=0.01) for side in (-1, 1)),
    *(Locks(9, ((0.97 * side, 0.16), (0.96 * side, 0.30)), ((1.02 * side, 0.27), (1.02 * side, 0.42)), (0.6, 0.6),
            (-1.5, 0.2, 0.2), uneven=0.03, stray=0.01, is_single=True) for side in (-1, 1)),
)
"""Locks of bob and long hair: from the parting over the forehead to the right temple, over them, to the left, and over
the outline of either side; and single hairs that soften the hairline.
"""
CUTS = {
    "short": Cut(
        rows=12,
        layers=(
            Layer(23, 0.0, 0.86, 0.12, 0.70, (-1.0, -2.6), shade=0.93),
            Layer(30, 0.42, 0.97, 0.05, 0.74, (-3.2, -1.6), shade=0.91),
        ),
        locks=(
            Locks(9, ((-0.95, 0.03), (0.87, 0.03)), ((-0.95, 0.50), (0.87, 0.50)), (30, 30), (-2.5, 2.5, 0.5)),
            Locks(14, ((-0.40, 0.75), (0.40, 0.75)), ((-0.40, 0.99), (0.40, 0.99)), (1.2, 1.2), (-3.0, -0.6, -0.4),
                  uneven=0.05, stray=0.03, is_single=True),
            *FRINGE,
        ),
    ),
    "cropped": Cut(
        rows=12,
        layers=(
            Layer(23, 0.0, 0.84, 0.14, 0.66, (1.0, 1.4), shade=0.95),
            Layer(36, 0.42, 0.98, 0.05, 0.88, (-0.4, 1.0), shade=0.93),
        ),
        locks=(Locks(9, ((-0.95, 0.05), (0.95, 0.05)), ((-0.95, 0.52), (0.95, 0.52)), (30, 30), (-1.5, 3.0, 1.5)),),
        close=0.6,
    ),
    "bob": Cut(
        rows=22,
        groups=3,
        layers=(
            Layer(19, 0.0, 0.97, 0.03, 0.90, (1.2, 0.0), lead=((0.84, 0.3), (0.90, 0.36), (0.94, 0.42)), tips=0.75),
            Layer(16, 0.40, 0.99, 0.02, 0.93, (-1.2, -1.6), reach=0.97, shade=0.85, tips=0.75),
            Layer(9, 0.42, 0.97, 0.05, 0.88, (-5.0, -5.0), reach=0.95, shade=0.8, is_inside=True),
        ),
        locks=SWEPT,
        ends_mm=((0.0, 0.5, 1.0), (-58.0, -64.0, -76.0)),
        outwards_mm=((0, 25, 55, 80, 110), (0.0, 4.0, 3.5, -1.0, -9.0)),
        waves=0.2,
        forward_mm=20.0,
        gather=0.3,
    ),
    "long": Cut(
        rows=22,
        groups=3,
        layers=(
            Layer(19, 0.0, 0.98, 0.03, 0.76, (1.2, -0.2), lead=((0.88, 0.35), (0.92, 0.42), (0.95, 0.46))),
            Layer(15, 0.40, 0.99, 0.04, 0.82, (-3.2, -6.0), reach=0.95),
            Layer(9, 0.42, 0.92, 0.10, 0.92, (-5.8, -11.0), reach=0.86, shade=0.8, is_inside=True),
        ),
        locks=SWEPT,
        ends_mm=((0.0, 0.5, 1.0), (-166.0, -154.0, -144.0)),
        outwards_mm=((0, 30, 70, 110, 150, 190), (0.0, 5.0, 11.0, 13.0, 9.0, 3.0)),
        waves=2.1,
        gather=0.6,
        forward_mm=40.0,
        backward_mm=20.0,
    ),
}
# fmt: on


@dataclass(frozen=True, slots=True, eq=False)
class Fall:
    """The surface."""

    points: Array
    """(S, T, 3) mm: ``s`` from -:data:`BEYOND` to :data:`BEYOND`, ``t`` from 0 to 1."""
    outs: Array
    """(S, T, 3): outward unit normals."""
    cut: Cut

    def crest(self, s: Array, t: Array) -> Array:
        """(...): 1 in the middle of a group of hanging hair, -1 between two, 0 above them, at places, (...) each."""
        return _grouped(self.cut, t) * np.cos(_phase(self.cut, s))

    def at(self, s: Array, t: Array) -> tuple[Array, Array]:
        """(..., 3) mm and (..., 3): points and outward unit normals at places, (...) each."""
        rows, columns = self.points.shape[:2]
        where = np.stack(np.broadcast_arrays((s / BEYOND + 1) / 2 * (rows - 1), t * (columns - 1)))
        point, out = (
            np.stack([map_coordinates(field[..., axis], where, order=1, mode="nearest") for axis in range(3)], axis=-1)
            for field in (self.points, self.outs)
        )
        return point, unit_vectors(out, 1e-6)


def lay_fall(style: HeadStyle, cut: Cut) -> Fall:
    """Lay the surface over a person's head."""
    s, t = np.linspace(-BEYOND, BEYOND, 121), np.linspace(0, 1, 61)
    if cut.ends_mm is None:
        points, rough = _from_crown(style, cut, s, t)
    else:
        on_head, rough = _on_head(style, s, 2 * t[t <= 0.5])
        flat = unit_vectors(rough[:, -1:] * [1.0, 0.0, 1.0], 1e-6)
        hanging = _hanging(cut, s, 2 * t[t > 0.5] - 1, on_head[:, -1], flat[:, 0])
        points = np.concatenate([on_head, hanging], axis=1)
        rough = np.concatenate([rough, np.broadcast_to(flat, hanging.shape)], axis=1)
        # Beside the face it turns gently.
        turn = TURN * smoothstep((np.abs(s) - 0.65) / 0.25)[:, None] * np.exp(-(((t - 0.52) / 0.1) ** 2))
        points += turn[..., None] * (gaussian_filter1d(points, TURN_STEPS, axis=1, mode="nearest") - points)
    points[:, 1:] = gaussian_filter(points, (1.5, 1.5, 0), mode="nearest")[:, 1:]
    normals = unit_vectors(np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0)), 1e-6)
    normals = np.where(((normals * rough).sum(axis=-1) > 0.3)[..., None], normals, rough)
    outs = unit_vectors(gaussian_filter(normals, (2, 2, 0), mode="nearest"), 1e-6)
    if not cut.groups:
        return Fall(points, outs, cut)
    # Hair gathers in groups towards its ends.
    gathered = s[:, None] - cut.gather * _grouped(cut, t) * (np.sin(_phase(cut, s)) / (2 * np.pi * cut.groups))[:, None]
    rows = (gathered / BEYOND + 1) / 2 * (len(s) - 1), np.broadcast_to(np.arange(len(t)), gathered.shape)
    points, outs = (
        np.stack([map_coordinates(field[..., axis], rows, order=1, mode="nearest") for axis in range(3)], axis=-1)
        for field in (points, outs)
    )
    crest = _grouped(cut, t) * np.cos(_phase(cut, s))[:, None]
    points += (RELIEF_MM * (crest - 0.3 * np.abs(crest)) * smoothstep((1.05 - np.abs(s)) / 0.1)[:, None])[
        ..., None
    ] * outs
    return Fall(points, outs, cut)


def _phase(cut: Cut, s: Array) -> Array:
    """(...) rad: place in a group of hair."""
    u = np.minimum(np.abs(s), 1.0)
    return np.asarray(2 * np.pi * cut.groups * (u + 0.035 * np.sin(2 * np.pi * u) + 0.03 * np.sin(np.pi * s)))


def _grouped(cut: Cut, t: Array) -> Array:
    """(...): how far hair has gathered in groups, 0 to 1."""
    return np.asarray(smoothstep((t - 0.2) / 0.8) * (cut.groups > 0))


def _on_head(style: HeadStyle, s: Array, shares: Array) -> tuple[Array, Array]:
    """Lines of hair on the scalp: (S, T, 3) mm and outward normals at shares of the way from the parting, (T,)."""
    u, side = np.abs(s), np.where(s < 0, -1.0, 1.0)

    def place(degrees: ArrayLike, y: ArrayLike) -> Array:
        return position(np.deg2rad(degrees), np.asarray(y, dtype=np.float64), style)

    # Each line is a parabola, laid on the scalp.
    parting = PARTING_DEG
    first, top = place(parting, hairline(np.deg2rad(parting)) + 0.5), place(1.5 * parting, 132.0)
    crown = np.array([5.0, TOP_MM, -28.0])
    along = np.clip((u - 0.22) / 0.78, 0, 1)[:, None]
    start = (1 - along) ** 2 * crown + 2 * along * (1 - along) * top + along**2 * first
    bend = place(np.interp(u, BEND_AT, BEND[0]) * side, np.interp(u, BEND_AT, BEND[1]))
    end = place(np.interp(u, (0, 0.5, 1, BEYOND), (180, 118, 67, 54)) * side, np.full(len(s), EARS_MM))
    foot, out = under_hair(np.minimum(_parabola(start, bend, end, shares), TOP_MM), style)
    s, u, edge = s[:, None], u[:, None], smoothstep((1 - u) / 0.22)[:, None]
    angle = np.arctan2(foot[..., 0], foot[..., 2] - AXIS_Z_MM)
    degrees = np.rad2deg(np.abs(angle))
    # The first line is near the hairline, and none is below it.
    least = hairline(angle) + 1.0 - np.interp(np.rad2deg(angle), *FRONT)
    lowest = np.maximum(hairline(angle) - FRONT_MM[0], FRONT_MM[1] - 40.0 * smoothstep((degrees - 36.0) / 4.0))
    lowest = np.minimum(least, lowest - 80.0 * smoothstep((degrees - 45.0) / 10.0))
    least = np.maximum(least - BEYOND_MM * np.clip(u - 1, 0, None), lowest)
    y = np.maximum(least, foot[..., 1] + smoothstep((u - 0.88) / 0.12) * (least - foot[..., 1]))
    before = smoothstep((68.0 - degrees) / 10.0)[..., None]
    foot = foot + before * (position(angle, y, style) - foot)
    rise = np.interp(shares, *RISE) * (0.2 + 0.8 * edge)
    over_ear = smoothstep((degrees - 58.0) / 18.0) * smoothstep((140.0 - degrees) / 26.0)
    rise = rise + EAR_MM * over_ear * smoothstep((90.0 - foot[..., 1]) / 50.0) * (0.3 + 0.7 * edge)
    height = 1.0 + 1.2 * smoothstep((36.0 - degrees) / 20.0) + rise
    at_left = (1 - edge) * smoothstep((s - 0.8) / 0.2) * smoothstep(shares / 0.05) * smoothstep((0.75 - shares) / 0.2)
    return _even(foot + (height + at_left * (LEFT_EDGE_MM - height))[..., None] * out, out, shares)


def _parabola(start: Array, bend: Array, end: Array, shares: Array) -> Array:
    """(S, T, 3) mm: lines from their starts to their ends, (S, 3) each, at shares of the way, (T,)."""
    share = shares[:, None]
    return (1 - share) ** 2 * start[:, None] + 2 * share * (1 - share) * bend[:, None] + share**2 * end[:, None]


def _even(lines: Array, outs: Array, shares: Array) -> tuple[Array, Array]:
    """Make steps even along each line, so that no chord of a strand cuts into the forehead: as :func:`_on_head`."""
    fields = np.concatenate([lines, outs], axis=2)
    way = np.cumsum(np.linalg.norm(np.diff(lines, axis=1, prepend=lines[:, :1]), axis=2), axis=1)
    for line, own in zip(fields, way, strict=True):
        line[:] = np.stack([np.interp(shares * own[-1], own, column) for column in line.T], axis=1)
    return fields[..., :3], unit_vectors(fields[..., 3:], 1e-6)


def _from_crown(style: HeadStyle, cut: Cut, s: Array, shares: Array) -> tuple[Array, Array]:
    """Lines of short hair from the crown to their ends, as :func:`_on_head`; those of ``s`` and ``s`` + 2 are one."""
    degrees = (180.0 * (1 - s) + 180.0) % 360.0 - 180.0
    before = (1 - cut.close) * np.exp(-((degrees / SWEPT_DEG) ** 2))
    last = degrees - TO_RIGHT_DEG * before
    most, width, wide = FRINGE_AT_DEG
    fringe = (1 - cut.close) * (FRINGE_MM + FRINGE_RIGHT_MM * np.exp(-(((last - most) / width) ** 2)))
    low = (
        hairline(np.deg2rad(last))
        + np.interp(np.abs(last), SHORT_DEG, ENDS_MM)
        - fringe * np.exp(-((last / wide) ** 4))
    )
    lowest = MIN_FRINGE_MM - 60.0 * smoothstep((np.abs(last) - 36.0) / 20.0)
    end = position(np.deg2rad(last), np.where(np.abs(degrees) < 60.0, np.maximum(low, lowest), low), style)
    bends = np.interp(np.abs(degrees), SHORT_DEG, BENDS_MM)
    bend = position(np.deg2rad(degrees + FROM_LEFT_DEG * before), bends, style)
    lines = _parabola(np.broadcast_to(CROWN_MM, end.shape), bend, end, shares)
    foot, out = under_hair(np.minimum(lines, TOP_MM), style)
    angle = np.arctan2(foot[..., 0], foot[..., 2] - AXIS_Z_MM)
    on_face = smoothstep((68.0 - np.rad2deg(np.abs(angle))) / 10.0)[..., None]
    foot = foot + on_face * (position(angle, foot[..., 1], style) - foot)
    now = np.abs(degrees[:, None] + shares * (last - degrees)[:, None])
    front, side = np.exp(-((now / SWEPT_DEG) ** 2)), np.exp(-(((now - SIDES_DEG) / SIDES_WIDE_DEG) ** 2))
    parts = np.stack([front, side, np.maximum(1 - front - side, 0.0)])
    rises = np.stack([np.interp(shares, SHORT_AT, part) for part in SHORT_RISE])[:, None]
    rise = (rises * (parts / parts.sum(axis=0))).sum(axis=0)
    return _even(foot + (1.0 + (1 - cut.close) * rise)[..., None] * out, out, shares)


def _hanging(cut: Cut, s: Array, shares: Array, ears: Array, flat: Array) -> Array:
    """(S, T, 3) mm: hair that hangs from (S, 3) mm, with level outward normals, at shares of the way to its ends."""
    assert cut.ends_mm is not None
    u, across = np.abs(s), flat[:, ::-1] * [1.0, 0.0, -1.0]
    before, behind = smoothstep((u - 0.70) / 0.3), smoothstep((0.75 - u) / 0.3)
    length, lines = ears[:, 1] - np.interp(u, *cut.ends_mm), []
    for share in shares:
        down = share * length
        swing, phase = cut.waves * smoothstep((down - 10.0) / 90.0), 2 * np.pi * down / WAVE_MM + 3.0 * u
        # It follows the nape.
        outwards = np.interp(down, *cut.outwards_mm) - 8.0 * behind * np.sin(np.pi * np.clip(down / 130.0, 0, 1))
        line = ears + (6.0 * swing * np.sin(phase))[:, None] * across
        line += (outwards + 5.0 * swing * np.cos(phase))[:, None] * flat
        line[:, 1] = ears[:, 1] - down
        # The front turns to the cheek.
        line[:, 0] -= np.sign(s) * 20.0 * before**2 * smoothstep(down / 60.0)
        line[:, 2] += 6.0 * before * smoothstep(down / 60.0)
        line[:, 2] += cut.forward_mm * before * smoothstep((down - 50.0) / 140.0)
        line[:, 2] -= cut.backward_mm * smoothstep((0.62 - u) / 0.4) * smoothstep((down - 60.0) / 90.0)
        lines.append(line)
    return np.stack(lines, axis=1)
