"""Hair over the cap, in three lengths: one mass that falls from a side parting, and locks over it that end in points.

Theory of operation
-------------------
:class:`_Fall` is a smooth surface over two coordinates: ``s`` runs from the right temple (-1) round the back (0) to the
left temple (1); ``t`` runs from the parting (0) to the ends (1). Short hair ends at the hairline; longer hair is at the
height of the ears at ``t`` = 0.5 and hangs from there. The mass is that surface, with a groove between one strand of
hair and the next. Locks follow it from where they rise out of it, swing from side to side, and taper to points at
uneven heights. Normals are mostly those of the surface, so that hair is lit as one body. Nothing is random: locks vary
by fractions of multiples of the golden ratio.
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

LAST = 1.15
"""Locks end beyond the mass, at up to this ``t``."""
TOP_MM = 144.0
"""Height above which the scalp is not measured."""
EARS_MM = 36.0
"""Height from which long hair hangs."""
FRONT_MM = 5.0
"""Additional height of short hair over the forehead."""
EAR_MM, CLOSE_SIDES = 7.0, 0.5
"""Additional height of hanging hair over an ear; fraction of its height that short hair loses there."""
FORWARD_MM, BACKWARD_MM = 32.0, 8.0
"""Distances by which long hair falls before and behind the shoulder."""
SWING_MM, WAVE_MM = (3.0, 1.5), 95.0
"""Swing of hanging hair to the sides and outwards, and its wave length."""
MAX_DETAIL = 2.0
"""Hair is not divided further at level ``finest``."""
STRANDS, GROOVE_MM = 9, 2.6
"""Strands of the mass on either side, and depth of the grooves between them."""
# fmt: off
MASS_ROWS = (
    0, 0.025, 0.06, 0.10, 0.15, 0.20, 0.25, 0.30, 0.36, 0.42, 0.48, 0.54, 0.61, 0.68, 0.75, 0.82, 0.88, 0.94, 1.0,
)
# fmt: on
"""Rows of the mass: ``t`` of the longest strand."""
LINED_FROM = 0.36
"""``t`` from which the mass of hanging hair has an inside."""
INSIDE, INSIDE_MM = 0.45, 2.5
"""Shade of the inside, and the thickness of the mass."""
TAPER_AT, TAPER = (0, 0.2, 0.45, 0.75, 0.9, 1), (0.35, 0.85, 1.0, 0.92, 0.62, 0.12)
"""Width of a lock along its length. Narrower tips flicker in video."""
ROOT_MM, EDGE_MM = 5.0, 1.4
"""Depth of a lock's root and of its edges below the mass."""
FRAMING = 0.93
"""Locks farther from the back, 0..1, frame the face; they do not swing towards it."""
SHEEN_FROM = np.array([-0.24, 0.44, 0.87])
"""Half way between the key lamp and a camera in front: hair across it is bright, as a bundle of cylinders is."""
SHEEN, SHEEN_POWER = 1.3, 18.0
"""Additional light on hair at its brightest, and how narrow the band is."""
EVEN_LIGHT_HAIR = 2.8
"""Fraction of the contrast that hair loses per unit of its mean linear RGB: light hair looked dyed."""

Table = tuple[tuple[float, ...], tuple[float, ...]]
"""Places and values between which is interpolated."""


class _Layer(NamedTuple):
    """Locks of one kind on either side."""

    places: Array
    """(N,): distance from the back of the head, 0..1."""
    first: float
    last: float
    """``t`` where they rise out of the mass and where they end."""
    uneven: float
    """Unevenness of the ends."""
    width_mm: float
    height_mm: float
    """Height above the mass."""


class _Cut(NamedTuple):
    """What distinguishes a haircut; tables over ``u`` run from the back of the head, 0, to the temple, 1."""

    bend: tuple[tuple[float, ...], tuple[float, ...]]
    """Angle from the front, degrees, and height, mm, at :data:`BEND_AT`, to which lines bend on their way."""
    rise: Table
    """Height of the mass above the scalp, mm, over the share of the way on the head."""
    layers: tuple[_Layer, ...]
    ends_mm: Table | None = None
    """Height of the ends over ``u``; None if hair ends at the hairline."""
    outwards_mm: Table | None = None
    """Distance outwards, mm, over the distance below the ears."""


BEND_AT = (0.0, 0.5, 0.8, 1.0)
HANGING_BEND = ((180.0, 112.0, 66.0, 50.0), (112.0, 124.0, 112.0, 88.0))
HANGING_RISE: Table = ((0, 0.08, 0.25, 0.6, 1), (0.6, 4.9, 8.9, 9.9, 9.4))
FRINGE = np.array([0.955, 0.89])
CUTS = {
    "short": _Cut(
        bend=((180.0, 116.0, 72.0, 48.0), (96.0, 98.0, 100.0, 90.0)),
        rise=((0, 0.06, 0.2, 0.5, 0.8, 1), (0.6, 6.0, 8.4, 7.6, 5.6, 1.8)),
        layers=(
            _Layer(np.linspace(0.05, 0.90, 9), 0.16, 0.96, 0.03, 26.0, 1.8),
            _Layer(np.linspace(0.02, 0.84, 7), 0.40, 0.98, 0.03, 22.0, 2.0),
            _Layer(np.linspace(0.45, 0.90, 5), 0.05, 0.68, 0.10, 24.0, 2.8),
        ),
    ),
    "bob": _Cut(
        bend=HANGING_BEND,
        rise=HANGING_RISE,
        layers=(
            _Layer(np.linspace(0.06, 0.93, 9), 0.36, 1.0, 0.03, 32.0, 2.4),
            _Layer(np.linspace(0.03, 0.88, 8), 0.26, 0.96, 0.05, 22.0, 4.2),
            _Layer(FRINGE, 0.06, 1.0, 0.03, 24.0, 3.4),
        ),
        ends_mm=((0.0, 0.5, 1.0), (-58.0, -64.0, -76.0)),
        outwards_mm=((0, 25, 60, 85, 110), (0.0, 4.0, 3.0, -4.0, -16.0)),
    ),
    "long": _Cut(
        bend=HANGING_BEND,
        rise=HANGING_RISE,
        layers=(
            _Layer(np.linspace(0.06, 0.93, 9), 0.36, 1.02, 0.07, 30.0, 2.4),
            _Layer(np.linspace(0.03, 0.88, 9), 0.26, 0.92, 0.09, 20.0, 4.2),
            _Layer(FRINGE, 0.06, 0.98, 0.05, 24.0, 3.4),
        ),
        # Above the shoulders it is shorter.
        ends_mm=((0.0, 0.3, 0.5, 0.6, 0.75, 1.0), (-144.0, -142.0, -135.0, -134.0, -138.0, -146.0)),
        outwards_mm=((0, 25, 60, 100, 140, 180), (0.0, 2.0, -1.0, -6.0, -8.0, -7.0)),
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Fall:
    """The surface."""

    points: Array
    """(S, T, 3) mm: ``s`` from -1 to 1, ``t`` from 0 to :data:`LAST`."""
    outs: Array
    """(S, T, 3): outward unit normals."""

    def at(self, s: Array, t: Array) -> tuple[Array, Array]:
        """(..., 3) mm and (..., 3): points and outward unit normals at places, (...) each."""
        rows, columns = self.points.shape[:2]
        where = np.stack(np.broadcast_arrays((s + 1) / 2 * (rows - 1), t / LAST * (columns - 1)))
        point, out = (
            np.stack([map_coordinates(field[..., axis], where, order=1, mode="nearest") for axis in range(3)], axis=-1)
            for field in (self.points, self.outs)
        )
        return point, unit_vectors(out, 1e-6)


def _fall(style: HeadStyle, cut: _Cut) -> _Fall:
    """Lay the surface over a person's head."""
    s, t = np.linspace(-1, 1, 97), np.linspace(0, LAST, 70)
    if cut.ends_mm is None:
        lines, outs = _on_head(style, cut, s, t)
    else:
        on_head = t <= 0.5
        lines, outs = _on_head(style, cut, s, 2 * t[on_head])
        lines += _hanging(cut, s, 2 * t[~on_head] - 1, lines[-1], outs[-1], style.haircut == "long")
        outs += [unit_vectors(outs[-1] * [1.0, 0.0, 1.0], 1e-6)] * int((~on_head).sum())
    points, rough = np.stack(lines, axis=1), np.stack(outs, axis=1)
    normals = unit_vectors(np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0)), 1e-6)
    normals = np.where(((normals * rough).sum(axis=-1) > 0.3)[..., None], normals, rough)
    return _Fall(points, unit_vectors(gaussian_filter(normals, (2, 2, 0), mode="nearest"), 1e-6))


def _on_head(style: HeadStyle, cut: _Cut, s: Array, shares: Array) -> tuple[list[Array], list[Array]]:
    """Lines of hair on the scalp: (S, 3) mm and outward normals at each share of the way from the parting."""
    scalp, u, side = Scalp(style), np.abs(s), np.where(s < 0, -1.0, 1.0)

    def place(degrees: ArrayLike, y: ArrayLike) -> Array:
        return position(np.deg2rad(degrees), np.asarray(y, dtype=np.float64), style)

    # Each line is a parabola, laid on the scalp.
    first, top = place(11.0, hairline(np.deg2rad(11.0)) + 0.5), place(20.0, 132.0)
    crown = np.array([5.0, TOP_MM, -28.0])
    along = np.clip((u - 0.22) / 0.78, 0, 1)[:, None]
    start = (1 - along) ** 2 * crown + 2 * along * (1 - along) * top + along**2 * first
    bend = place(np.interp(u, BEND_AT, cut.bend[0]) * side, np.interp(u, BEND_AT, cut.bend[1]))
    if cut.ends_mm is None:
        last = np.interp(u, (0, 0.5, 0.68, 0.84, 1), (180, 122, 96, 75, 56))
        end = place(last * side, hairline(np.deg2rad(last)) + 1.0)
    else:
        end = place(np.interp(u, (0, 0.5, 1), (180, 118, 67)) * side, np.full(len(s), EARS_MM))
    edge = np.sqrt(smoothstep((1 - u) / 0.12))
    lines, outs = [], []
    for share in shares:
        line = (1 - share) ** 2 * start + 2 * share * (1 - share) * bend + share**2 * end
        foot, out = scalp.under(np.minimum(line, TOP_MM))
        angle = np.arctan2(foot[:, 0], foot[:, 2] - AXIS_Z_MM)
        degrees = np.rad2deg(np.abs(angle))
        # The first line is the hairline, lower at the temples, and none is below it.
        least = hairline(angle) + 1.0 - 10.0 * smoothstep((degrees - 24.0) / 22.0)
        y = np.maximum(least, foot[:, 1] + smoothstep((u - 0.88) / 0.12) * (least - foot[:, 1]))
        before = smoothstep((68.0 - degrees) / 10.0)[:, None]
        foot = foot + before * (position(angle, y, style) - foot)
        rise = np.interp(share, *cut.rise) * (0.12 + 0.88 * edge)
        if cut.ends_mm is None:
            # It is high over the forehead and close at the sides.
            on_way = np.interp(share, (0, 0.15, 0.5, 0.7), (0, 1, 1, 0))
            rise += FRONT_MM * on_way * edge * np.exp(-(((u - 0.82) / 0.15) ** 2))
            beside = np.exp(-(((degrees - 92.0) / 30.0) ** 2)) * smoothstep((115.0 - foot[:, 1]) / 40.0)
            rise *= 1 - CLOSE_SIDES * beside
        else:
            over_ear = smoothstep((degrees - 58.0) / 18.0) * smoothstep((140.0 - degrees) / 26.0)
            rise += EAR_MM * over_ear * smoothstep((90.0 - foot[:, 1]) / 50.0) * (0.3 + 0.7 * edge)
        lines.append(foot + (0.2 + rise)[:, None] * out)
        outs.append(out)
    return lines, outs


def _hanging(cut: _Cut, s: Array, shares: Array, ears: Array, outs: Array, is_long: bool) -> list[Array]:
    """Lines of hair that hangs from (S, 3) mm: (S, 3) mm at each share of the way to the ends."""
    assert cut.ends_mm is not None
    assert cut.outwards_mm is not None
    u, flat = np.abs(s), unit_vectors(outs * [1.0, 0.0, 1.0], 1e-6)
    across = flat[:, ::-1] * [1.0, 0.0, -1.0]
    length, lines = ears[:, 1] - np.interp(u, *cut.ends_mm), []
    for share in shares:
        down = share * length
        swing, phase = smoothstep((down - 10.0) / 70.0), 2 * np.pi * down / WAVE_MM + 5.0 * s
        line = ears + (SWING_MM[0] * swing * np.sin(phase))[:, None] * across
        line += (np.interp(down, *cut.outwards_mm) + SWING_MM[1] * swing * np.cos(phase))[:, None] * flat
        line[:, 1] = ears[:, 1] - down
        if is_long:
            line[:, 2] += FORWARD_MM * smoothstep((u - 0.38) / 0.5) * smoothstep((down - 30.0) / 110.0)
            line[:, 2] -= BACKWARD_MM * smoothstep((0.6 - u) / 0.4) * smoothstep((down - 60.0) / 90.0)
        lines.append(line)
    return lines


def build_clumps(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add mass and locks; returns their indices, (N,)."""
    cut, detail = CUTS[style.haircut], min(detail, MAX_DETAIL)
    fall = _fall(style, cut)
    return np.concatenate(
        [_add_mass(builder, fall, cut, palette, detail), _add_locks(builder, fall, cut, palette, detail)]
    )


def _add_mass(builder: MeshBuilder, fall: _Fall, cut: _Cut, palette: Palette, detail: float) -> Indices:
    """Add the mass and the inside of what hangs; returns their indices, (N,)."""
    number = np.arange(STRANDS)
    edges = np.cumsum([0.0, *(0.65 + 0.7 * golden(number, 3.7))])
    step = np.linspace(0, 1, max(2, round(3.6 * detail)) + 1)[:-1]
    u = np.append((edges[:-1, None] + np.diff(edges)[:, None] * step).ravel(), edges[-1]) / edges[-1]
    valley = np.append(np.tile(np.abs(2 * step - 1), STRANDS), 1.0)
    strand = np.append(np.repeat(number, len(step)), STRANDS - 1)
    s, valley = np.concatenate([-u[:0:-1], u])[:, None], np.concatenate([valley[:0:-1], valley])[:, None]
    strand = np.concatenate([strand[:0:-1] + STRANDS, strand])[:, None]
    share = resampled(MASS_ROWS, detail)
    inner = np.abs(s) < 0.999
    length = 0.96 - 0.05 * valley**2 * inner + 0.03 * (2 * golden(strand, 2.9) - 1)
    t = share * (1 + (length - 1) * np.clip(2 * share - 1, 0, 1))
    wander = 0.010 * np.sin(2.6 * np.pi * share + 9 * s) * smoothstep((share - 0.15) / 0.4) * inner
    points, out = fall.at(np.clip(s + wander, -1, 1), t)
    points -= (GROOVE_MM * smoothstep((share - 0.03) / 0.22) * valley**2)[..., None] * out
    tint = np.interp(valley, (0, 0.5, 1), (1.12, 1.0, 0.52)) ** smoothstep((share - 0.02) / 0.2)
    tint = tint * (0.84 + 0.32 * golden(strand, 1.9)) * (1 + _sheen(points, out))
    tint = tint * np.interp(share, (0, 0.03, 0.1, 0.85, 1), (0.45, 0.7, 1, 0.95, 0.8))
    outside = _add(builder, points, out, palette, tint, 0.5 + 0.45 * s, t)
    if cut.ends_mm is None:
        return outside
    lining = points - INSIDE_MM * out
    lining[[0, -1]] = points[[0, -1]]
    low = np.s_[::-2, np.searchsorted(share, LINED_FROM) :]
    inside = _add(builder, lining[low], -out[low], palette, INSIDE, 0.5 + 0.45 * s[::-2], t[low])
    return np.concatenate([outside, inside])


def _add_locks(builder: MeshBuilder, fall: _Fall, cut: _Cut, palette: Palette, detail: float) -> Indices:
    """Add the locks; returns their indices, (N,)."""
    share, across = np.linspace(0, 1, max(5, round(12 * detail))), np.linspace(-1, 1, 4 if detail >= 1 else 3)
    added = []
    for layer, (places, first, last, uneven, width, height) in enumerate(cut.layers):
        number = np.arange(2 * len(places)) + 5 * layer
        side = np.repeat([1.0, -1.0], len(places))[:, None]
        one, two, three = (2 * golden(number + 3, factor)[:, None] - 1 for factor in (1.0, 2.7, 4.3))
        begins = first * (1 + 0.25 * two)
        t = begins + (last + uneven * three - begins) * share
        sway = np.sin(1.7 * np.pi * share + 2 * np.pi * golden(number, 5.1)[:, None]) * smoothstep(share / 0.5)
        place = np.tile(places, 2)[:, None]
        place = place + (0.025 * one + 0.010 * sway) * (place < FRAMING)
        middle, out = fall.at(side * np.clip(place, 0, 0.975), t)
        rise = np.interp(share, (0, 0.12, 0.4, 0.8, 1), (-ROOT_MM, -1.5, height, height, height - 1.0))
        middle += rise[:, None] * out
        aside = unit_vectors(np.cross(np.gradient(middle, axis=1), out), 1e-6)
        half = 0.5 * width * (1 + 0.2 * two) * np.interp(share, TAPER_AT, TAPER)
        points = middle[:, :, None] + (half[..., None] * across)[..., None] * aside[:, :, None]
        points -= ((np.maximum(rise, 0) + EDGE_MM)[:, None] * across**2)[..., None] * out[:, :, None]
        tint = (1 + 0.14 * three[..., None]) * np.interp(np.abs(across), (0, 0.5, 1), (1.12, 1.0, 0.74))
        tint = 1 + smoothstep(share / 0.4)[:, None] * (tint - 1)  # a root is as light as the mass
        lit = np.interp(share, (0, 0.3, 0.9, 1), (0.9, 1.0, 1.05, 1.05)) * (1 + _sheen(middle, out))
        normals = out[:, :, None] + 0.5 * across[:, None] * aside[:, :, None]
        strip = 0.10 + 0.8 * golden(number, 3.1)[:, None, None] + 0.075 * across
        hangs = cut.ends_mm is not None
        added.append(
            _add(builder, points, normals, palette, tint * lit[..., None], strip, t[..., None], both_sides=hangs)
        )
    return np.concatenate(added)


def _sheen(points: Array, out: Array) -> Array:
    """(N, S): light on lines of hair, (N, S, 3) mm with outward directions, as on bundles of shiny cylinders."""
    along = unit_vectors(np.gradient(points, axis=1), 1e-6)
    across = np.clip(1 - (along @ SHEEN_FROM) ** 2, 0, 1)
    return np.asarray(SHEEN * across**SHEEN_POWER * np.clip(0.25 + out @ SHEEN_FROM, 0, 1))


def _add(
    builder: MeshBuilder,
    points: Array,
    normals: Array,
    palette: Palette,
    tint: ArrayLike,
    across: ArrayLike,
    along: ArrayLike,
    *,
    both_sides: bool = False,
) -> Indices:
    """Add a grid, (S, C, 3) mm, or locks, (N, S, C, 3), with soft normals; returns their indices.

    ``tint`` is the light relative to the hair's colour, ``across`` and ``along`` are places among the painted strands;
    they broadcast. Of locks the last third is seen from both sides with ``both_sides``.
    """
    even = min(EVEN_LIGHT_HAIR * float(palette.hair.mean()), 0.9)
    shade = np.asarray(tint, dtype=np.float64)
    lit = shade + even * (0.9 - shade)
    grid = builder.add(
        points,
        albedo=palette.hair * lit[..., None],
        material=Material.HAIR,
        uv=strand_uv(across, 0.05 + 0.9 * np.asarray(along)),
        normal=unit_vectors(normals, 1e-6),
    )
    a, b, c, d = grid[..., :-1, :-1], grid[..., :-1, 1:], grid[..., 1:, 1:], grid[..., 1:, :-1]
    if points.ndim == 3:  # a grid's columns run along the hair
        b, d = d, b
    builder.loose(np.stack([a, b, c], axis=-1))
    builder.loose(np.stack([a, c, d], axis=-1))
    if both_sides:
        ends = np.s_[:, 2 * points.shape[1] // 3 :]
        builder.loose(np.stack([c, b, a], axis=-1)[ends])
        builder.loose(np.stack([d, c, a], axis=-1)[ends])
    return grid.ravel()
