"""Haircuts: the surface over which hair falls from a side parting, and the layers and locks that lie on it.

Theory of operation
-------------------
:class:`Fall` is a smooth surface over two coordinates: ``s`` runs from the right temple (-1) round the back (0) to the
left temple (1); ``t`` runs from the parting (0) to the ends (1). Short hair ends at the hairline; longer hair is at the
height of the ears at ``t`` = 0.5 and hangs from there. Below the front edge the surface goes on over the skin, up to
``s`` of :data:`BEYOND`. :mod:`.strands` covers it with layers of strands and lays locks and single hairs over it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.default_head.faces import Scalp, hairline, position
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM

TOP_MM = 144.0
"""Height above which the scalp is not measured."""
EARS_MM = 36.0
"""Height from which long hair hangs."""
FRONT_MM, SWEPT = 3.8, 0.25
"""Additional height of short hair over the forehead; fraction of its height that moves over the parting to the right.
"""
LOW_TOP, CLOSE_NAPE = 0.3, 0.75
"""Fractions of its height that hair loses at the top, and short hair at the nape."""
ENDS_MM = (0.0, 0.28, 0.42, 0.55, 0.64, 0.76, 0.84, 0.92, 1.0), (4.0, 5.0, 8.0, 8.0, 3.0, 3.0, 6.0, 4.0, -1.0)
"""Height of the ends of short hair above the hairline over ``u``: higher behind the ears, lower before them."""
EAR_MM, CLOSE_SIDES = 6.0, 0.84
"""Additional height of hanging hair over an ear; fraction of its height that short hair loses there."""
WAVE_MM = 115.0
"""Wave length of hanging hair."""
FRINGE_MM = (22.0, 76.0)
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

    bend: tuple[tuple[float, ...], tuple[float, ...]]
    """Angle from the front, degrees, and height, mm, at :data:`BEND_AT`, to which lines bend on their way."""
    rise: Table
    """Height of the surface above the scalp, mm, over the share of the way on the head."""
    front: Table
    """Depth of the front edge below the hairline, mm, by angle from the front, degrees."""
    parting_deg: float
    """Angle at which the parting begins."""
    rows: int
    """Rows of a strand from ``t`` = 0 to 1."""
    layers: tuple[Layer, ...]
    locks: tuple[Locks, ...] = ()
    ends_mm: Table | None = None
    """Height of the ends over ``u``; None if hair ends at the hairline."""
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
HANGING = Cut(
    bend=((180.0, 112.0, 66.0, 50.0), (112.0, 124.0, 112.0, 88.0)),
    rise=((0, 0.06, 0.25, 0.6, 1), (2.6, 7.0, 11.0, 11.0, 7.4)),
    front=((-66, -50, -30, -8, 8, 18, 27, 36, 50, 66), (14.0, 20.0, 20.0, 14.0, 8.0, 5.0, 1.5, 6.0, 15.0, 14.0)),
    parting_deg=28.0,
    rows=20,
    groups=3,
    layers=(),
    locks=(
        # Before the cheeks.
        Locks(3, ((-0.84, 0.04), (-0.78, 0.04)), ((-1.04, 0.70), (-0.97, 0.88)), (17, 20), (-1, 4.6, 5.6), bow=0.085),
        Locks(3, ((0.86, 0.04), (0.80, 0.04)), ((1.03, 0.66), (0.97, 0.88)), (17, 20), (-1, 4.6, 5.6), bow=-0.07),
        # Over the outline of either side.
        Locks(
            5,
            ((-0.80, 0.10), (-0.50, 0.16)),
            ((-0.86, 0.56), (-0.62, 0.80)),
            (20, 22),
            (-1.0, 4.0, 3.0),
            bow=0.03,
            stray=0.03,
        ),
        Locks(
            5,
            ((0.78, 0.10), (0.50, 0.16)),
            ((0.84, 0.60), (0.62, 0.84)),
            (20, 22),
            (-1.0, 4.0, 3.0),
            bow=-0.03,
            stray=0.03,
        ),
        # Single hairs: along the front edge of either side, and over the top.
        Locks(
            5,
            ((-0.92, 0.04), (-0.93, 0.24)),
            ((-1.05, 0.24), (-1.00, 0.52)),
            (13, 15),
            (-1.0, 3.6, 0.4),
            bow=0.015,
            uneven=0.05,
            stray=0.02,
        ),
        Locks(
            12,
            ((-0.97, 0.0), (-0.98, 0.30)),
            ((-1.08, 0.20), (-1.10, 0.60)),
            (0.6, 0.9),
            (0.4, 2.6, 0.8),
            uneven=0.05,
            stray=0.05,
            is_single=True,
        ),
        Locks(
            5,
            ((0.93, 0.04), (0.94, 0.26)),
            ((1.09, 0.24), (1.07, 0.54)),
            (11, 13),
            (-1.0, 3.2, 0.4),
            bow=-0.015,
            uneven=0.05,
            stray=0.04,
        ),
        Locks(
            12,
            ((0.97, 0.0), (0.98, 0.34)),
            ((1.16, 0.14), (1.07, 0.54)),
            (0.7, 0.9),
            (0.6, 2.4, 1.0),
            uneven=0.05,
            stray=0.04,
            is_single=True,
        ),
        Locks(
            10,
            ((-0.75, 0.1), (0.75, 0.1)),
            ((-0.80, 0.38), (0.80, 0.38)),
            (0.7, 0.7),
            (0.0, 2.4, 4.0),
            uneven=0.05,
            stray=0.04,
            is_single=True,
        ),
    ),
)
"""What bob and long hair share."""
CUTS = {
    "short": Cut(
        bend=((180.0, 116.0, 72.0, 48.0), (96.0, 98.0, 100.0, 90.0)),
        rise=((0, 0.06, 0.2, 0.5, 0.8, 1), (2.6, 7.5, 10.2, 10.4, 5.6, 0.4)),
        front=(
            (-66, -50, -34, -16, 0, 16, 28, 36, 44, 54, 66),
            (0.0, 6.0, 10.0, 10.0, 7.0, 4.0, 1.5, 4.0, 8.0, 8.0, 0.0),
        ),
        parting_deg=29.0,
        rows=12,
        layers=(Layer(12, 0.0, 0.90, 0.06, 0.84, (0.0, -0.6), lead=((0.80, 0.4), (0.84, 0.6))),),
        locks=(
            # Nape and back of the head; sides, combed behind the ears; crown; left of the parting.
            Locks(
                13,
                ((-0.60, 0.60), (0.60, 0.60)),
                ((-0.44, 0.90), (0.44, 0.90)),
                (16, 16),
                (-1, 0.4, -1.6),
                uneven=0.05,
                shade=0.86,
            ),
            Locks(11, ((-0.62, 0.42), (0.62, 0.42)), ((-0.52, 0.80), (0.52, 0.80)), (20, 20), (-0.5, 2, 0), shade=0.94),
            Locks(
                7,
                ((-0.62, 0.60), (-0.99, 0.50)),
                ((-0.56, 0.93), (-0.90, 0.93)),
                (13, 10),
                (-1, 0.4, -1),
                uneven=0.04,
                shade=0.9,
            ),
            Locks(
                7,
                ((0.62, 0.60), (0.93, 0.50)),
                ((0.56, 0.93), (0.82, 0.97)),
                (13, 10),
                (-1, 0.4, -1),
                uneven=0.04,
                shade=0.9,
            ),
            Locks(
                6, ((-0.66, 0.30), (-0.98, 0.34)), ((-0.56, 0.84), (-0.80, 0.91)), (20, 12), (-0.5, 1.6, 0), shade=0.95
            ),
            Locks(6, ((0.66, 0.30), (0.98, 0.34)), ((0.56, 0.84), (0.80, 0.91)), (20, 12), (-0.5, 1.6, 0), shade=0.95),
            Locks(10, ((-0.66, 0.20), (0.66, 0.20)), ((-0.60, 0.66), (0.56, 0.66)), (27, 27), (-0.5, 1.8, -0.8)),
            Locks(8, ((-0.40, 0.0), (0.60, 0.0)), ((-0.44, 0.42), (0.58, 0.46)), (26, 22), (-2.5, 3, 0.6), bow=0.02),
            Locks(8, ((0.94, 0.0), (0.58, 0.0)), ((0.90, 0.80), (0.56, 0.66)), (13, 20), (-2.5, 1.8, 0.8), bow=-0.01),
            # The fringe, and over it.
            Locks(5, ((-0.78, 0.25), (-0.95, 0.30)), ((-0.74, 0.92), (-0.98, 0.84)), (15, 12), (-0.5, 2.5, 0.8)),
            Locks(
                8,
                ((-0.94, 0.0), (-0.90, 0.0)),
                ((-1.06, 0.34), (-1.08, 0.82)),
                (9, 13),
                (-2.5, 4.6, 1.0),
                bow=0.015,
                uneven=0.04,
                stray=0.055,
            ),
            Locks(
                7, ((-0.52, 0.0), (-0.94, 0.0)), ((-0.60, 0.84), (-1.05, 0.62)), (25, 15), (-2.5, 4.6, 0.8), bow=0.03
            ),
            Locks(
                9,
                ((-0.93, 0.06), (-0.90, 0.30)),
                ((-1.10, 0.34), (-1.15, 0.90)),
                (12, 15),
                (-1.0, 4.4, 0.6),
                bow=0.02,
                uneven=0.05,
                stray=0.045,
            ),
            # Lifted tips at the crown and at the sides.
            Locks(
                9,
                ((-0.70, 0.10), (0.10, 0.04)),
                ((-0.80, 0.56), (0.16, 0.40)),
                (15, 15),
                (-1.0, 5.4, 5.0),
                bow=0.03,
                uneven=0.08,
                stray=0.05,
            ),
            Locks(
                6,
                ((0.30, 0.04), (0.92, 0.10)),
                ((0.40, 0.46), (0.96, 0.60)),
                (15, 12),
                (-1.0, 4.0, 4.0),
                bow=-0.03,
                uneven=0.08,
                stray=0.05,
            ),
            # Single hairs: below the fringe, beside the parting, at the temples and over the nape.
            Locks(
                12,
                ((-0.99, 0.10), (-1.0, 0.68)),
                ((-1.08, 0.30), (-1.14, 0.90)),
                (0.5, 0.5),
                (0.4, 3.4, 0.8),
                bow=0.01,
                uneven=0.06,
                stray=0.055,
                is_single=True,
            ),
            Locks(
                6,
                ((0.97, 0.16), (0.97, 0.6)),
                ((1.06, 0.44), (1.05, 0.92)),
                (2.2, 2.6),
                (0.2, 2.0, 0.5),
                bow=-0.01,
                uneven=0.05,
                stray=0.03,
                is_single=True,
            ),
            Locks(
                14,
                ((0.98, 0.04), (0.98, 0.78)),
                ((1.06, 0.22), (1.03, 0.97)),
                (0.5, 0.5),
                (0.4, 1.4, 0.5),
                uneven=0.06,
                stray=0.04,
                is_single=True,
            ),
            Locks(
                9,
                ((-0.42, 0.78), (0.42, 0.78)),
                ((-0.36, 0.95), (0.36, 0.95)),
                (2.6, 2.6),
                (0.4, 0.6, 0.3),
                uneven=0.05,
                stray=0.03,
                is_single=True,
            ),
            Locks(
                9,
                ((-0.75, 0.2), (0.70, 0.2)),
                ((-0.80, 0.5), (0.76, 0.5)),
                (0.7, 0.7),
                (0.0, 2.8, 5.0),
                bow=0.01,
                uneven=0.15,
                stray=0.05,
                is_single=True,
            ),
        ),
    ),
    "bob": HANGING._replace(
        layers=(
            Layer(28, 0.0, 0.97, 0.03, 0.90, (1.2, 0.0), lead=((0.78, 0.35), (0.86, 0.45), (0.92, 0.5))),
            Layer(25, 0.40, 0.99, 0.02, 0.93, (-1.2, -1.6), reach=0.97, shade=0.85),
            Layer(14, 0.42, 0.97, 0.05, 0.88, (-5.0, -5.0), reach=0.95, shade=0.6, is_inside=True),
        ),
        ends_mm=((0.0, 0.5, 1.0), (-58.0, -64.0, -76.0)),
        outwards_mm=((0, 25, 55, 80, 110), (0.0, 4.0, 3.5, -1.0, -9.0)),
        waves=0.2,
        forward_mm=20.0,
        gather=0.3,
    ),
    "long": HANGING._replace(
        layers=(
            Layer(27, 0.0, 0.98, 0.20, 0.84, (1.2, -0.2), lead=((0.75, 0.35), (0.83, 0.45), (0.90, 0.5))),
            Layer(22, 0.40, 0.99, 0.14, 0.86, (-1.2, -1.6), reach=0.95, shade=0.9),
            Layer(12, 0.42, 0.92, 0.10, 0.92, (-5.8, -7.8), reach=0.86, shade=0.8, is_inside=True),
        ),
        ends_mm=((0.0, 0.3, 0.55, 0.68, 0.85, 1.0), (-170.0, -166.0, -150.0, -142.0, -158.0, -150.0)),
        outwards_mm=((0, 25, 60, 100, 140, 180), (0.0, 3.0, 4.5, 3.5, -2.0, -12.0)),
        waves=1.6,
        forward_mm=40.0,
        backward_mm=26.0,
    ),
}


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
        points, rough = _on_head(style, cut, s, t)
    else:
        on_head, rough = _on_head(style, cut, s, 2 * t[t <= 0.5])
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


def _on_head(style: HeadStyle, cut: Cut, s: Array, shares: Array) -> tuple[Array, Array]:
    """Lines of hair on the scalp: (S, T, 3) mm and outward normals at shares of the way from the parting, (T,)."""
    scalp, u, side = Scalp(style), np.abs(s), np.where(s < 0, -1.0, 1.0)

    def place(degrees: ArrayLike, y: ArrayLike) -> Array:
        return position(np.deg2rad(degrees), np.asarray(y, dtype=np.float64), style)

    # Each line is a parabola, laid on the scalp.
    parting = cut.parting_deg
    first, top = place(parting, hairline(np.deg2rad(parting)) + 0.5), place(1.5 * parting, 132.0)
    crown = np.array([5.0, TOP_MM, -28.0])
    along = np.clip((u - 0.22) / 0.78, 0, 1)[:, None]
    start = (1 - along) ** 2 * crown + 2 * along * (1 - along) * top + along**2 * first
    bend = place(np.interp(u, BEND_AT, cut.bend[0]) * side, np.interp(u, BEND_AT, cut.bend[1]))
    if cut.ends_mm is None:
        last = np.interp(u, (0, 0.5, 0.68, 0.84, 1), (180, 122, 96, 75, 56))
        end = place(last * side, hairline(np.deg2rad(last)) + np.interp(u, *ENDS_MM))
    else:
        end = place(np.interp(u, (0, 0.5, 1, BEYOND), (180, 118, 67, 54)) * side, np.full(len(s), EARS_MM))
    edge = smoothstep((1 - u) / 0.22)
    lines, outs = [], []
    for share in shares:
        line = (1 - share) ** 2 * start + 2 * share * (1 - share) * bend + share**2 * end
        foot, out = scalp.under(np.minimum(line, TOP_MM))
        angle = np.arctan2(foot[:, 0], foot[:, 2] - AXIS_Z_MM)
        degrees = np.rad2deg(np.abs(angle))
        # The first line is near the hairline, and none is below it.
        least = hairline(angle) + 1.0 - np.interp(np.rad2deg(angle), *cut.front)
        lowest = np.maximum(hairline(angle) - FRINGE_MM[0], FRINGE_MM[1] - 40.0 * smoothstep((degrees - 36.0) / 4.0))
        lowest = np.minimum(least, lowest - 80.0 * smoothstep((degrees - 45.0) / 10.0))
        least = np.maximum(least - BEYOND_MM * np.clip(u - 1, 0, None), lowest)
        y = np.maximum(least, foot[:, 1] + smoothstep((u - 0.88) / 0.12) * (least - foot[:, 1]))
        before = smoothstep((68.0 - degrees) / 10.0)[:, None]
        foot = foot + before * (position(angle, y, style) - foot)
        rise = np.interp(share, *cut.rise) * (0.2 + 0.8 * edge)
        rise *= 1 - LOW_TOP * smoothstep((foot[:, 1] - 128.0) / 16.0)
        rise *= 1 - SWEPT * side * smoothstep((u - 0.1) / 0.4) * smoothstep((1.05 - share) / 0.5)
        if cut.ends_mm is None:
            # It is high over the forehead and close at the sides.
            on_way = np.interp(share, (0, 0.15, 0.5, 0.7), (0, 1, 1, 0))
            rise *= 1 - CLOSE_NAPE * smoothstep((degrees - 100.0) / 40.0) * smoothstep((16.0 - foot[:, 1]) / 50.0)
            rise += FRONT_MM * on_way * edge * np.exp(-(((u - 0.82) / 0.15) ** 2))
            beside = np.exp(-(((degrees - 98.0) / 38.0) ** 2)) * smoothstep((122.0 - foot[:, 1]) / 62.0)
            rise *= 1 - CLOSE_SIDES * beside
        else:
            over_ear = smoothstep((degrees - 58.0) / 18.0) * smoothstep((140.0 - degrees) / 26.0)
            rise += EAR_MM * over_ear * smoothstep((90.0 - foot[:, 1]) / 50.0) * (0.3 + 0.7 * edge)
        lines.append(foot + (1.0 + 1.2 * smoothstep((36.0 - degrees) / 20.0) + rise)[:, None] * out)
        outs.append(out)
    # Steps are even along each line, so that no chord of a strand cuts into the forehead.
    fields = np.concatenate([np.stack(lines, axis=1), np.stack(outs, axis=1)], axis=2)
    way = np.cumsum(np.linalg.norm(np.diff(fields[..., :3], axis=1, prepend=fields[:, :1, :3]), axis=2), axis=1)
    for line, own in zip(fields, way, strict=True):
        line[:] = np.stack([np.interp(shares * own[-1], own, column) for column in line.T], axis=1)
    return fields[..., :3], unit_vectors(fields[..., 3:], 1e-6)


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
