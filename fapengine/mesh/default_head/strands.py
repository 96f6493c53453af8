"""Hair in three lengths: layers of strands that fall from a side parting and end in points.

Theory of operation
-------------------
:class:`_Fall` is a smooth surface over two coordinates: ``s`` runs from the right temple (-1) round the back (0) to the
left temple (1); ``t`` runs from the parting (0) to the ends (1). Short hair ends at the hairline; longer hair is at the
height of the ears at ``t`` = 0.5 and hangs from there. A layer covers the surface with strands side by side, some
higher than their neighbours and joined to them by steps until they taper; layers lie over each other and never cross.
Nothing is random: strands vary by fractions of multiples of the golden ratio.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, map_coordinates

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.faces import Scalp, hairline, position
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, resampled, strand_uv
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.face_mesh import Material

TOP_MM = 144.0
"""Height above which the scalp is not measured."""
EARS_MM = 36.0
"""Height from which long hair hangs."""
FRONT_MM = 4.0
"""Additional height of short hair over the forehead."""
ENDS_MM = (0.0, 0.28, 0.42, 0.55, 0.64, 0.76, 0.84, 0.92, 1.0), (-1.0, 0.0, 10.0, 18.0, 12.0, 0.0, -14.0, 0.0, -1.0)
"""Height of the ends of short hair above the hairline over ``u``: higher behind the ears, lower before them."""
EAR_MM, CLOSE_SIDES = 6.0, 0.7
"""Additional height of hanging hair over an ear; fraction of its height that short hair loses there."""
WAVE_MM = 115.0
"""Wave length of hanging hair."""
FREE_FROM_MM, FREE_ENDS = -30.0, 0.55
"""Height below which hanging hair follows the head less, and share of its rotation that the ends do not follow."""
MAX_DETAIL, MIN_ROWS = 2.0, 0.8
"""Hair is not divided further at level ``finest``, and has no fewer rows at ``coarse``."""
ACROSS, MIN_ACROSS = (0.0, 0.5, 1.0), (0.75, 0.67)
"""Columns across a strand, and their smallest detail in the upper layer and in those below it."""
DENSER = 0.35
"""How much closer than on average the first and the last rows of strands are."""
LEAN, OVER = 0.25, 0.45
"""How far tips lean to a side at most, and those at the face over their neighbours, in widths of a strand."""
STEP_MM, ROUND_MM, TIP_ROUND_MM = 2.2, 1.6, 2.2
"""Height of upper strands above lower ones; height of a strand's middle above its edges, and what tips add to it."""
PARTING_MM = (1.2, 1.5)
"""How far hair of either side goes beyond the parting, and its depth there."""
WANDER = 0.018
"""How far the border between two strands wanders sideways, in ``s``."""
TAPER_AT, TAPER = (0.0, 0.3, 0.7, 1.0), (1.0, 1.12, 0.8, 0.07)
"""Width of a strand along its tip: it lies over its neighbours, then ends in a point. Narrower ends flicker."""
EVEN_NORMALS = 0.9
"""Weight of the normals of the surface relative to those of strands, so that hair is lit as one body."""
LIT_INSIDE = np.array([0.0, -1.0, 0.0])
"""Normal of the layer that is seen from inside: no lamp shines there."""
SHEEN_FROM = unit_vectors(np.array([[-0.24, 0.44, 0.87], [-0.75, 0.55, 0.25], [0.75, 0.55, 0.25]]))
"""Half way between a lamp and a camera in front or at a side: hair across it is bright, as a bundle of cylinders is."""
SHEEN, SHEEN_POWER = np.array([1.6, 1.0, 1.0]), 18.0
"""Additional light on hair at its brightest, by direction, and how narrow the bands are."""
EVEN_LIGHT_HAIR = 2.8
"""Fraction of the contrast that hair loses per unit of its mean linear RGB: light hair looked dyed."""

Table = tuple[tuple[float, ...], tuple[float, ...]]
"""Places and values between which is interpolated."""


class _Layer(NamedTuple):
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


class _Cut(NamedTuple):
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
    layers: tuple[_Layer, ...]
    ends_mm: Table | None = None
    """Height of the ends over ``u``; None if hair ends at the hairline."""
    outwards_mm: Table = ((0.0,), (0.0,))
    """Distance outwards, mm, over the distance below the ears."""
    waves: float = 0.0
    forward_mm: float = 0.0
    backward_mm: float = 0.0
    """Distances of the ends to the front and to the back over the shoulders."""


BEND_AT = (0.0, 0.5, 0.8, 1.0)
HANGING = _Cut(
    bend=((180.0, 112.0, 66.0, 50.0), (112.0, 124.0, 112.0, 88.0)),
    rise=((0, 0.08, 0.25, 0.6, 1), (0.6, 5.0, 7.6, 8.4, 7.4)),
    front=((-66, -50, -30, -8, 8, 20, 34, 50, 66), (14.0, 22.0, 22.0, 14.0, 6.0, 1.5, 9.0, 18.0, 14.0)),
    parting_deg=20.0,
    rows=20,
    layers=(),
)
"""What bob and long hair share."""
WISPS = ((0.36, 0.14), (0.44, 0.18), (0.54, 0.18), (0.66, 0.24))
"""Fine strands at the front edge of hanging hair, as in ``lead``."""
CUTS = {
    "short": _Cut(
        bend=((180.0, 116.0, 72.0, 48.0), (96.0, 98.0, 100.0, 90.0)),
        rise=((0, 0.06, 0.2, 0.5, 0.8, 1), (0.6, 5.8, 8.4, 9.6, 5.6, 0.4)),
        front=(
            (-66, -50, -34, -16, 0, 12, 20, 32, 44, 54, 66),
            (0.0, 12.0, 18.0, 16.0, 10.0, 5.0, 1.5, 6.0, 10.0, 9.0, 0.0),
        ),
        parting_deg=19.0,
        rows=20,
        layers=(
            _Layer(26, 0.0, 0.78, 0.16, 0.70, (1.2, 0.2), lead=((0.58, 0.4), (0.70, 0.5), (0.76, 0.6))),
            _Layer(26, 0.3, 1.0, 0.10, 0.80, (-1.2, -1.6), reach=0.96),
        ),
    ),
    "bob": HANGING._replace(
        layers=(
            _Layer(28, 0.0, 0.96, 0.08, 0.80, (1.2, 0.0), lead=(*WISPS, (0.78, 0.35), (0.86, 0.45), (0.92, 0.5))),
            _Layer(28, 0.40, 0.99, 0.06, 0.88, (-1.2, -1.6), reach=0.97, shade=0.85),
            _Layer(16, 0.42, 0.97, 0.05, 0.88, (-5.0, -5.0), reach=0.95, shade=0.6, is_inside=True),
        ),
        ends_mm=((0.0, 0.5, 1.0), (-58.0, -64.0, -76.0)),
        outwards_mm=((0, 25, 55, 80, 110), (0.0, 4.0, 3.5, -1.0, -9.0)),
        waves=0.2,
        forward_mm=20.0,
    ),
    "long": HANGING._replace(
        layers=(
            _Layer(27, 0.0, 0.95, 0.16, 0.72, (1.2, -0.2), lead=(*WISPS, (0.75, 0.35), (0.83, 0.45), (0.90, 0.5))),
            _Layer(24, 0.40, 0.99, 0.09, 0.78, (-1.2, -1.6), reach=0.97, shade=0.9),
            _Layer(14, 0.42, 0.92, 0.08, 0.80, (-5.0, -5.0), reach=0.93, shade=0.6, is_inside=True),
        ),
        ends_mm=((0.0, 0.3, 0.55, 0.68, 0.85, 1.0), (-170.0, -166.0, -150.0, -142.0, -158.0, -150.0)),
        outwards_mm=((0, 25, 60, 100, 140, 180), (0.0, 3.0, 4.0, 2.0, -3.0, -8.0)),
        waves=1.0,
        forward_mm=40.0,
        backward_mm=26.0,
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Fall:
    """The surface."""

    points: Array
    """(S, T, 3) mm: ``s`` from -1 to 1, ``t`` from 0 to 1."""
    outs: Array
    """(S, T, 3): outward unit normals."""

    def at(self, s: Array, t: Array) -> tuple[Array, Array]:
        """(..., 3) mm and (..., 3): points and outward unit normals at places, (...) each."""
        rows, columns = self.points.shape[:2]
        where = np.stack(np.broadcast_arrays((s + 1) / 2 * (rows - 1), t * (columns - 1)))
        point, out = (
            np.stack([map_coordinates(field[..., axis], where, order=1, mode="nearest") for axis in range(3)], axis=-1)
            for field in (self.points, self.outs)
        )
        return point, unit_vectors(out, 1e-6)


def _fall(style: HeadStyle, cut: _Cut) -> _Fall:
    """Lay the surface over a person's head."""
    s, t = np.linspace(-1, 1, 97), np.linspace(0, 1, 61)
    if cut.ends_mm is None:
        points, rough = _on_head(style, cut, s, t)
    else:
        on_head, rough = _on_head(style, cut, s, 2 * t[t <= 0.5])
        flat = unit_vectors(rough[:, -1:] * [1.0, 0.0, 1.0], 1e-6)
        hanging = _hanging(cut, s, 2 * t[t > 0.5] - 1, on_head[:, -1], flat[:, 0])
        points = np.concatenate([on_head, hanging], axis=1)
        rough = np.concatenate([rough, np.broadcast_to(flat, hanging.shape)], axis=1)
    points[:, 1:] = gaussian_filter(points, (1.5, 1.5, 0), mode="nearest")[:, 1:]
    normals = unit_vectors(np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0)), 1e-6)
    normals = np.where(((normals * rough).sum(axis=-1) > 0.3)[..., None], normals, rough)
    return _Fall(points, unit_vectors(gaussian_filter(normals, (2, 2, 0), mode="nearest"), 1e-6))


def _on_head(style: HeadStyle, cut: _Cut, s: Array, shares: Array) -> tuple[Array, Array]:
    """Lines of hair on the scalp: (S, T, 3) mm and outward normals at shares of the way from the parting, (T,)."""
    scalp, u, side = Scalp(style), np.abs(s), np.where(s < 0, -1.0, 1.0)

    def place(degrees: ArrayLike, y: ArrayLike) -> Array:
        return position(np.deg2rad(degrees), np.asarray(y, dtype=np.float64), style)

    # Each line is a parabola, laid on the scalp.
    parting = cut.parting_deg
    first, top = place(parting, hairline(np.deg2rad(parting)) + 0.5), place(1.8 * parting, 132.0)
    crown = np.array([5.0, TOP_MM, -28.0])
    along = np.clip((u - 0.22) / 0.78, 0, 1)[:, None]
    start = (1 - along) ** 2 * crown + 2 * along * (1 - along) * top + along**2 * first
    bend = place(np.interp(u, BEND_AT, cut.bend[0]) * side, np.interp(u, BEND_AT, cut.bend[1]))
    if cut.ends_mm is None:
        last = np.interp(u, (0, 0.5, 0.68, 0.84, 1), (180, 122, 96, 75, 56))
        end = place(last * side, hairline(np.deg2rad(last)) + np.interp(u, *ENDS_MM))
    else:
        end = place(np.interp(u, (0, 0.5, 1), (180, 118, 67)) * side, np.full(len(s), EARS_MM))
    edge = smoothstep((1 - u) / 0.22)
    lines, outs = [], []
    for share in shares:
        line = (1 - share) ** 2 * start + 2 * share * (1 - share) * bend + share**2 * end
        foot, out = scalp.under(np.minimum(line, TOP_MM))
        angle = np.arctan2(foot[:, 0], foot[:, 2] - AXIS_Z_MM)
        degrees = np.rad2deg(np.abs(angle))
        # The first line is near the hairline, and none is below it.
        least = hairline(angle) + 1.0 - np.interp(np.rad2deg(angle), *cut.front)
        y = np.maximum(least, foot[:, 1] + smoothstep((u - 0.88) / 0.12) * (least - foot[:, 1]))
        before = smoothstep((68.0 - degrees) / 10.0)[:, None]
        foot = foot + before * (position(angle, y, style) - foot)
        rise = np.interp(share, *cut.rise) * (0.2 + 0.8 * edge)
        if cut.ends_mm is None:
            # It is high over the forehead and close at the sides.
            on_way = np.interp(share, (0, 0.15, 0.5, 0.7), (0, 1, 1, 0))
            rise += FRONT_MM * on_way * edge * np.exp(-(((u - 0.82) / 0.15) ** 2))
            beside = np.exp(-(((degrees - 92.0) / 30.0) ** 2)) * smoothstep((115.0 - foot[:, 1]) / 40.0)
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


def _hanging(cut: _Cut, s: Array, shares: Array, ears: Array, flat: Array) -> Array:
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


def build_strands(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add all layers; returns their indices, (N,), and last that of the top of the hair in the middle."""
    cut, detail = CUTS[style.haircut], min(detail, MAX_DETAIL)
    fall = _fall(style, cut)
    added = [_add_layer(builder, fall, cut, seed, palette, detail) for seed in range(len(cut.layers))]
    middle = fall.points[np.abs(fall.points[..., 0]) < 4.0]
    top = builder.add(middle[middle[:, 1].argmax()] * [0.0, 1.0, 1.0], albedo=palette.hair, material=Material.HAIR)
    return np.append(np.concatenate(added), top)


def _add_layer(builder: MeshBuilder, fall: _Fall, cut: _Cut, seed: int, palette: Palette, detail: float) -> Indices:
    """Add the strands of a layer, which is also the seed of their variation; returns their indices, (N,)."""
    layer = cut.layers[seed]
    number, lead = np.arange(layer.strands) + 5 * seed, len(layer.lead)
    rows = round(cut.rows * max(detail, MIN_ROWS) * (layer.last - layer.first))
    share = np.linspace(0, 1, max(7, rows))  # denser at the tips, and where hair bends over the crown
    share = 1 - (1 - share) ** 1.15 if layer.first else share - DENSER * np.sin(2 * np.pi * share) / (2 * np.pi)
    across = resampled(ACROSS, max(detail, MIN_ACROSS[layer.first > 0]))
    side = 2 * across - 1
    level = np.where(number % 2, 0.45, 0.0) + 0.55 * golden(number, 2.3)
    t, s, wide = _places(layer, number, level, share, side)
    level, t = level[:, None, None], t[..., None]
    points, out = fall.at(s, t)

    # Where layers lie over each other, strands are nearly level; the front edge is on the skin.
    apart = smoothstep((share - 0.5) / 0.4) if layer.first else 1 - 0.7 * smoothstep((share - 0.3) / 0.5)
    step = STEP_MM * apart[:, None]
    edges = (wide * (ROUND_MM + TIP_ROUND_MM * smoothstep((share - 0.55) / 0.3)))[..., None] * side**2
    first_mm, last_mm = layer.up_mm
    up = first_mm + (last_mm - first_mm) * smoothstep((share - 0.4) / 0.6)[:, None] + step * level - edges
    raised = smoothstep((t - 0.02) / 0.2)
    points = points + (raised * up * smoothstep((1 - np.abs(s)) / 0.04))[..., None] * out
    if not layer.first:  # both sides of the parting cross in its depth
        points[:, 0] -= PARTING_MM[1] * out[:, 0] + PARTING_MM[0] * np.sign(s[:, 0, :, None]) * [1.0, 0.0, 0.0]
    own = unit_vectors(np.cross(np.gradient(points, axis=2), np.gradient(points, axis=1)), 1e-6)
    normals = 0.4 * out + LIT_INSIDE if layer.is_inside else own + EVEN_NORMALS * out

    tint = np.interp(side**2, (0, 1), (1.05, 0.87)) * (1 - 0.2 * (1 - level) * side**2)
    tint = tint * (0.9 + 0.14 * level + 0.1 * golden(number, 1.9)[:, None, None])
    tint = (1 + raised * (tint - 1)) * np.interp(t, (0, 0.03, 0.1), (0.45, 0.7, 1)) * (1 + raised * _sheen(points, out))
    shade = layer.shade * tint * np.interp(share, (0, 0.85, 1), (1, 1, 0.9))[:, None]
    even = min(EVEN_LIGHT_HAIR * float(palette.hair.mean()), 0.9)
    grid = builder.add(
        points,
        albedo=palette.hair * (shade + even * (0.9 - shade))[..., None],
        material=Material.HAIR,
        uv=strand_uv((0.05 + 0.65 * golden(number, 3.1))[:, None, None] + 0.25 * across, 0.05 + 0.9 * t),
        normal=unit_vectors(normals, 1e-6),
        head_weight=1 - FREE_ENDS * smoothstep((FREE_FROM_MM - points[..., 1]) / 110.0) * (cut.ends_mm is not None),
    )
    whole = int(np.searchsorted(share, layer.tapers_from + 0.04))
    _join(builder, grid)
    _join(builder, np.stack([grid[:-1, :whole, -1], grid[1:, :whole, 0]], axis=-1))
    # Tips, strands at the face and the inside are seen from behind, too.
    tips = 0 if layer.is_inside else 2 * share.size // 3
    _join(builder, grid[lead : layer.strands - lead, tips:, ::-1])
    _join(builder, grid[np.r_[:lead, layer.strands - lead : layer.strands], :, ::-1])
    return grid.ravel()


def _places(layer: _Layer, number: Indices, level: Array, share: Array, side: Array) -> tuple[Array, Array, Array]:
    """``t``, (N, R), and ``s``, (N, R, C), of strands at shares of their length, (R,), and across, (C,), -1 to 1.

    Last comes their width relative to that above their tips, (N, R).
    """
    lead, tapers_from = len(layer.lead), np.full(len(number), layer.tapers_from)
    width = 0.6 + 0.6 * golden(number, 3.7) + 0.3 * level
    length = layer.last * (1 - layer.uneven * (golden(number, 2.9) + 0.5 * (1 - level)))
    if lead:
        ends, widths = np.array(layer.lead).T
        width[:lead], width[: -lead - 1 : -1] = widths, widths
        length[:lead], length[: -lead - 1 : -1] = ends, ends + 0.04
        # Where the tip of one ends, that of the next begins.
        tapers_from[1:lead] = tapers_from[-2 : -lead - 1 : -1] = ends[:-1] / ends[1:]
    t = layer.first + share * (length[:, None] - layer.first)
    borders = np.concatenate([[0.0], np.cumsum(width)])
    borders = layer.reach * (2 * borders / borders[-1] - 1)
    phase = 2 * np.pi * golden(np.append(number, number[-1] + 1), 5.1)
    still = np.abs(borders) > 0.999 * layer.reach

    def wandering(which: slice) -> Array:
        way = np.where(still[which], 0.0, WANDER)[:, None] * smoothstep((t - 0.08) / 0.4)
        return np.asarray(borders[which, None] + way * np.sin(2.2 * np.pi * t + phase[which, None]))

    low, high = wandering(np.s_[:-1]), wandering(np.s_[1:])
    on_tip = np.clip((share - tapers_from[:, None]) / (1 - tapers_from[:, None]), 0, 1)
    wide = np.interp(on_tip, TAPER_AT, TAPER)
    aside = LEAN * (2 * golden(number, 6.3) - 1)[:, None] * on_tip**2
    if lead:  # tips at the face lie over their neighbours, so that no skin shows between them
        wide[:lead], wide[-lead:] = np.minimum(wide[:lead], 1.0), np.minimum(wide[-lead:], 1.0)
        over = (1 - wide) / 2 + OVER * smoothstep(on_tip / 0.3)
        aside[:lead], aside[-lead:] = over[:lead], -over[-lead:]
    middle = (low + high) / 2 + aside * (high - low)
    return t, middle[..., None] + ((high - low) / 2 * wide)[..., None] * side, wide


def _sheen(points: Array, out: Array) -> Array:
    """(N, R, C): light on strands, (N, R, C, 3) mm with outward directions, as on bundles of shiny cylinders."""
    along = unit_vectors(np.gradient(points, axis=1), 1e-6)
    across = np.clip(1 - (along @ SHEEN_FROM.T) ** 2, 0, 1)
    return np.asarray((across**SHEEN_POWER * np.clip(0.25 + out @ SHEEN_FROM.T, 0, 1)) @ SHEEN)


def _join(builder: MeshBuilder, grids: Indices) -> None:
    """Join grids of vertices, (N, R, C): from outside, rows run down and columns to the right."""
    a, b, c, d = grids[:, :-1, :-1], grids[:, :-1, 1:], grids[:, 1:, 1:], grids[:, 1:, :-1]
    builder.loose(np.stack([a, b, c], axis=-1))
    builder.loose(np.stack([a, c, d], axis=-1))
