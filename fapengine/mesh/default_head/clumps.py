"""Hair in sculpted clumps, in three lengths: short hair with a side parting and a front swept up, a bob, and long hair.

Theory of operation
-------------------
A clump is an arched blade that follows the scalp at a height above it, from its root to its tip. Groups say where
clumps begin, their directions at the root and at the tip, how long and wide they are and how high they rise. Later
groups lie over earlier ones. Clumps of a bob or of long hair leave the head at the height of the ears and hang from
there. Nothing is random: clumps vary by fractions of multiples of the golden ratio.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.faces import Scalp, hairline, position
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, strand_uv
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.face_mesh import Material

ENDS_MM = {"long": -122.0, "bob": -64.0}
"""Height of the ends of hair that hangs, by haircut."""
HANGS_BELOW_MM, ON_HEAD = 34.0, 0.56
"""Height below which hair hangs, and the fraction of a hanging clump's points above it."""
SHADES = (0.50, 0.85, 1.12, 0.90, 0.55)
"""Shade across a clump: dark where it goes below its neighbours."""
TAPER_AT, TAPER = (0.0, 0.15, 0.45, 0.75, 0.92, 1.0), (0.62, 0.95, 1.0, 0.78, 0.40, 0.03)
HANGING_TAPER = (0.5, 0.9, 1.0, 1.0, 0.93, 0.5)
ARCH, HANGING_ARCH, LINING_ARCH = 0.55, 0.26, 0.20
"""Depth of the edges of a clump below its middle, relative to its half width."""
TOP_MM = 142.5
"""Height of the measured part of the scalp."""
WHORL_AT = np.array([0.0, 0.0, -10.0])
"""Middle of the whorl at the crown, mm."""
CLOSE_SIDES = 0.5
"""Fraction of their height that clumps of short hair lose at the sides, so that hair is no helmet."""
EAR_MM = 7.0
"""Additional distance of hanging hair over an ear."""
SHEEN_FROM = np.array([-0.24, 0.44, 0.87])
"""Half way between the key lamp and a camera in front: hair across it is bright, as a bundle of cylinders is."""
SHEEN, SHEEN_POWER, SHEEN_UNEVEN = 0.9, 14.0, 0.14
"""Additional light on hair at its brightest, and how narrow and uneven the band is."""
INSIDE = 0.45
"""Shade of the inside of hanging hair."""
EVEN_LIGHT_HAIR = 2.8
"""Fraction of the contrast between clumps that hair loses per unit of its mean linear RGB: light hair looked dyed."""


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Clumps that go one way."""

    roots: Array
    """(N, 2): angle from the front, degrees, and height on the scalp, mm."""
    first: tuple[float, float, float]
    """Direction at the root; zero: away from the whorl at the crown."""
    last: tuple[float, float, float]
    length_mm: float
    width_mm: float
    rise_mm: tuple[float, float, float, float]
    """Height above the scalp at the root, at a third, at two thirds and at the tip."""
    fine: float = 1.0
    """Relative width at the root. Finer clumps frame the face, with more points, and single hairs at their tips."""
    end_mm: float | None = None
    """Height at which hanging clumps end; None if they do not hang."""
    is_lining: bool = False
    """Whether these are the lowest clumps of hanging hair, whose inside shows beside the neck."""

    def shape(self, detail: float) -> tuple[int, int]:
        """Points along and across."""
        along, across = (16, 5) if self.end_mm is not None else (9, 5) if self.fine < 1 else (6, 3)
        return max(4, round(along * detail)), across if detail >= 1 else 3


def _line(start: tuple[float, float], end: tuple[float, float], count: int) -> Array:
    return np.linspace(start, end, count)


def _short_groups() -> list[_Group]:
    groups = []
    for side in (1.0, -1.0):  # back and sides, lowest first
        groups += [
            _Group(_line((178 * side, -12), (124 * side, 8), 6), (0, -1, 0), (0, -1, 0.05), 38, 18, (2.5, 4, 4, 0.5)),
            _Group(_line((180 * side, 20), (112 * side, 42), 7), (0, -1, 0), (0, -1, 0.05), 54, 19, (3, 6, 5, 1)),
            _Group(_line((178 * side, 60), (98 * side, 68), 8), (0, -1, -0.2), (0, -1, 0), 62, 20, (4, 8, 7, 1.5)),
            _Group(_line((88 * side, 62), (60 * side, 66), 5), (0, -1, -0.35), (0, -1, -0.5), 42, 13, (1.5, 4, 4, 1.5)),
            _Group(_line((176 * side, 98), (86 * side, 94), 9), (0, -1, -0.3), (0, -1, 0), 68, 20, (5, 9, 8, 2)),
            _Group(_line((84 * side, 88), (50 * side, 84), 6), (0, -0.9, -0.5), (0, -1, -0.6), 50, 15, (2, 6, 6, 1.5)),
            _Group(_line((170 * side, 124), (70 * side, 116), 8), (0, -0.8, -0.5), (0, -1, 0), 70, 21, (6, 10, 9, 3)),
        ]
    whorl = np.stack([np.linspace(-250, 70, 17), np.tile([140.5, 142.0], 9)[:17]], axis=-1)
    part = np.array([[27, 98], [30, 107], [34, 115], [41, 123], [53, 130], [76, 136]], dtype=float)
    groups += [
        _Group(whorl, (0, 0, 0), (0, -1, -0.1), 70, 20, (8, 10, 8, 3)),
        _Group(_line((-235, 143.4), (-95, 143.4), 6), (-0.1, 0, -1), (0, -1, -0.1), 56, 24, (5, 10, 9, 4)),
        _Group(part, (0.9, -0.3, -0.5), (0.2, -1, -0.45), 74, 17, (1, 8, 9, 6), fine=0.6),
        _Group(part[-2::-1], (-1, 0.3, -0.45), (-0.25, -1, -0.6), 116, 21, (1, 10, 10, 4), fine=0.6),
        # The front rises and falls to the right.
        _Group(_line((-62, 66), (-36, 91), 5), (-0.2, 0.9, -0.1), (-0.1, -0.8, -1), 72, 15, (0.3, 7, 8, 4), 0.7),
        _Group(_line((-40, 90), (-4, 95), 7), (-0.35, 0.95, 0.35), (-0.45, -0.25, -1), 100, 20, (0.3, 13, 15, 9), 0.7),
        _Group(_line((-12, 95), (25, 95), 7), (-0.45, 0.9, 0.55), (-0.7, -0.2, -0.9), 106, 21, (0.3, 14.5, 15, 8), 0.7),
    ]
    return groups


def _hanging_groups(end_mm: float) -> list[_Group]:
    groups = []
    for side in (1.0, -1.0):
        ring = _line((178 * side, 60), (66 * side, 64), 9)
        middle = _line((176 * side, 104), (56 * side, 88), 9)
        # From the front of the parting to the crown, then down the back of the head.
        parting = np.array(
            [[1.5, 97], [2.5, 105], [4, 112], [5, 120], [6, 128], [10, 135], [30, 140], [110, 141], [160, 138]]
        )
        parting = parting * [side, 1.0]
        down = (0.0, -1.0, 0.0)
        groups += [
            _Group(ring, down, down, 0, 34, (1, 2, 2, 1), end_mm=end_mm + 6, is_lining=True),
            _Group(middle, (0.3 * side, -1, -0.1), down, 0, 30, (2, 5, 5, 4.5), end_mm=end_mm),
            _Group(parting, (side, -0.15, -0.3), down, 0, 31, (1.5, 8.5, 10.5, 10.5), fine=0.7, end_mm=end_mm - 4),
        ]
    return groups


def build_clumps(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add all clumps and the single hairs at tips that frame the face; returns their indices, (N,)."""
    scalp, added, tips = Scalp(style), [], []
    groups = _hanging_groups(ENDS_MM[style.haircut]) if style.haircut in ENDS_MM else _short_groups()
    for number, group in enumerate(groups):
        points, aside, out = _laid(group, scalp, style, number, detail)
        added.append(_add(builder, points, palette, number, sheen=_sheen(points, out, number)))
        if group.is_lining or (group.end_mm is not None and group.fine < 1):
            seen = slice(None) if group.is_lining else slice(3)  # of the upper clumps, those beside the face
            inside = (points - 1.5 * out[:, :, None])[seen, ..., ::-1, :]
            added.append(_add(builder, inside, palette, number, shade=INSIDE))
        if group.fine < 1 and group.end_mm is None:
            tips.append((points, aside))
    return np.concatenate([*added, _add_hairs(builder, tips, palette)] if tips else added)


def _laid(group: _Group, scalp: Scalp, style: HeadStyle, seed: int, detail: float) -> tuple[Array, Array, Array]:
    """A group's clumps, (N, S, C, 3) mm, and the directions across them and outwards, (N, S, 3) each."""
    number = np.arange(len(group.roots))
    wild, other = 2 * golden(number + 7 * seed) - 1, 2 * golden(number + 3 * seed, 5.77) - 1
    steps, wide = group.shape(detail)
    if group.end_mm is None:
        middle, out = _on_scalp(group, scalp, style, wild, other, steps)
        taper, arch = (TAPER[0] * group.fine, *TAPER[1:]), ARCH
    else:
        middle, out = _hung(group, scalp, style, wild, other, steps)
        taper = (HANGING_TAPER[0] * group.fine, *HANGING_TAPER[1:])
        arch = LINING_ARCH if group.is_lining else HANGING_ARCH
    aside = unit_vectors(np.cross(np.gradient(middle, axis=1), out), 1e-6)
    half = 0.5 * group.width_mm * (1 + 0.15 * other)[:, None] * np.interp(np.linspace(0, 1, steps), TAPER_AT, taper)
    across = np.linspace(-1.0, 1.0, wide)
    points = middle[:, :, None] + (half[..., None] * across)[..., None] * aside[:, :, None]
    points -= (arch * half[..., None] * across**2)[..., None] * out[:, :, None]
    return points, aside, out


def _start(group: _Group, style: HeadStyle, wild: Array) -> Array:
    """(N, 3) mm: roots on the scalp, on the forehead behind an uneven hairline."""
    angle, y = np.deg2rad(group.roots[:, 0]), group.roots[:, 1]
    at_line = (np.abs(angle) < np.deg2rad(50)) & (y < 98)
    y = np.where(at_line, np.maximum(y, hairline(angle) + 0.5), y) + (group.fine < 0.5) * (0.5 + 2.5 * wild)
    return position(angle, y, style)


def _way(group: _Group, foot: Array, out: Array, share: float) -> Array:
    """(N, 3): unit direction of clumps along the scalp, ``share`` of the way from root to tip."""
    blend = smoothstep(share / 0.9)
    away = unit_vectors((foot - WHORL_AT) * [1.0, 0.0, 1.0], 1e-6)
    first = unit_vectors(np.array(group.first)) if any(group.first) else away
    way = (1 - blend) * first + blend * unit_vectors(np.array(group.last))
    return unit_vectors(way - (way * out).sum(axis=1, keepdims=True) * out, 1e-6)


def _on_scalp(
    group: _Group, scalp: Scalp, style: HeadStyle, wild: Array, other: Array, steps: int
) -> tuple[Array, Array]:
    """(N, S, 3) mm and (N, S, 3): the middles of clumps of a fixed length, and outward normals there."""
    at, middles, outs = _start(group, style, wild), [], []
    length = group.length_mm * (1 + 0.10 * wild)
    for share in np.linspace(0, 1, steps):
        foot, out = scalp.under(np.minimum(at, [np.inf, TOP_MM, np.inf]))
        way = _way(group, foot, out, share)
        # Above an ear a clump ends on the head, or it would hang through it.
        low = 53.0 + 4.0 * other - foot[:, 1]
        clear = 1 - smoothstep(low / 9.0) * smoothstep((33.0 - np.abs(foot[:, 2] + 8.0)) / 9.0)
        rise = np.interp(share, (0, 1 / 3, 2 / 3, 1), group.rise_mm) * (1 + 0.10 * wild) * (0.4 + 0.6 * clear)
        angle = np.rad2deg(np.abs(np.arctan2(foot[:, 0], foot[:, 2] - AXIS_Z_MM)))
        rise = rise * (
            1 - CLOSE_SIDES * np.exp(-(((angle - 92.0) / 30.0) ** 2)) * smoothstep((115.0 - foot[:, 1]) / 40.0)
        )
        middles.append(foot + rise[:, None] * out)
        outs.append(out)
        at = foot + (clear * length / (steps - 1))[:, None] * (way + 0.10 * other[:, None] * np.cross(way, out))
    return np.stack(middles, axis=1), np.stack(outs, axis=1)


def _hung(group: _Group, scalp: Scalp, style: HeadStyle, wild: Array, other: Array, steps: int) -> tuple[Array, Array]:
    """(N, S, 3) mm and (N, S, 3): the middles of clumps that hang, and outward directions there."""
    at, middles, outs, on_head = _start(group, style, wild), [], [], round(ON_HEAD * steps)
    for number in range(on_head):
        share = number / (on_head - 1)
        foot, out = scalp.under(np.minimum(at, [np.inf, TOP_MM, np.inf]))
        way = _way(group, foot, out, share)
        angle = np.rad2deg(np.abs(np.arctan2(foot[:, 0], foot[:, 2] - AXIS_Z_MM)))
        over_ear = smoothstep((angle - 58.0) / 18.0) * smoothstep((140.0 - angle) / 26.0)
        rise = np.interp(share, (0, 1 / 3, 2 / 3, 1), group.rise_mm) * (1 + 0.06 * wild)
        rise = rise + EAR_MM * over_ear * smoothstep((80.0 - foot[:, 1]) / 40.0)
        middles.append(foot + rise[:, None] * out)
        outs.append(out)
        left = np.maximum(foot[:, 1] - HANGS_BELOW_MM, 0.0) / np.maximum(-way[:, 1], 0.35)
        at = foot + (left / max(on_head - 1 - number, 1))[:, None] * way
    flat = unit_vectors(outs[-1] * [1.0, 0.0, 1.0], 1e-6)
    start = middles[-1]
    end_mm = group.end_mm + 9.0 * wild  # type: ignore[operator]  # hanging groups have one
    for share in np.linspace(0, 1, steps - on_head + 1)[1:]:
        inwards = 10.0 * smoothstep(share) + 1.0 * other * np.sin(3.0 * share)
        hangs = start - inwards[:, None] * flat
        hangs[:, 1] = start[:, 1] + share * (end_mm - start[:, 1])
        middles.append(hangs)
        outs.append(unit_vectors(outs[-1] + 0.5 * (flat - outs[-1])))
    return np.stack(middles, axis=1), np.stack(outs, axis=1)


def _sheen(points: Array, out: Array, seed: int) -> Array:
    """(N, S): light on clumps, (N, S, C, 3) mm with outward directions (N, S, 3), as on bundles of shiny cylinders."""
    along = unit_vectors(np.gradient(points[:, :, points.shape[2] // 2], axis=1), 1e-6)
    uneven = SHEEN_UNEVEN * (2 * golden(np.arange(len(points)) + 5 * seed, 2.3) - 1)
    across = np.clip(1 - (along @ SHEEN_FROM + uneven[:, None]) ** 2, 0, 1)
    return np.asarray(SHEEN * across**SHEEN_POWER * np.clip(0.25 + out @ SHEEN_FROM, 0, 1))


def _add(
    builder: MeshBuilder, points: Array, palette: Palette, seed: int, *, shade: float = 1.0, sheen: ArrayLike = 0.0
) -> Indices:
    """Add clumps, (N, S, C, 3) mm; ``sheen``, (N, S), is additional light. Returns their indices."""
    count, steps, wide = points.shape[:3]
    across = np.linspace(-1.0, 1.0, wide)
    number = np.arange(count) + 11 * seed
    vary, share = 2 * golden(number) - 1, np.linspace(0, 1, steps)
    shine = 0.62 + 0.55 * np.sin(np.pi * np.clip(share * 1.15, 0, 1)) ** 1.4
    lit = np.asarray(shine + np.asarray(sheen))[..., None]
    tint = (1 + 0.12 * vary)[:, None, None] * lit * np.interp(across, np.linspace(-1, 1, 5), SHADES)
    even = min(EVEN_LIGHT_HAIR * float(palette.hair.mean()), 0.9)
    tint = shade * (tint + even * (0.9 - tint))
    strip = 0.10 + 0.8 * golden(number, 3.1)[:, None, None] + 0.075 * across
    uv = strand_uv(strip, 0.05 + 0.5 * share[:, None] + 0.4 * golden(number, 1.7)[:, None, None])
    grid = builder.add(points, albedo=palette.hair * tint[..., None], material=Material.HAIR, uv=uv)
    a, b = grid[:, :-1, :-1], grid[:, :-1, 1:]
    c, d = grid[:, 1:, 1:], grid[:, 1:, :-1]
    builder.loose(np.stack([a, b, c], axis=-1))
    builder.loose(np.stack([a, c, d], axis=-1))
    return grid.ravel()


def _add_hairs(builder: MeshBuilder, tips: list[tuple[Array, Array]], palette: Palette) -> Indices:
    """Add hairs beyond the tips of clumps, (N, S, C, 3) mm with the directions across them; returns their indices."""
    spines, asides, tints = [], [], []
    for group, (points, aside) in enumerate(tips):
        number = np.arange(len(points))
        middle = points.shape[2] // 2
        along = points[:, -1, middle] - points[:, -4, middle]
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        for at in range(middle - 1, middle + 2):
            wild = np.sin(7.1 * at + 3.7 * number + group)[:, None]
            start = points[:, -4, at]
            tip = start + (1.15 + 0.2 * wild) * along + 0.08 * wild * length * aside[:, -1]
            spines.append(np.stack([start, start + 0.6 * along, tip], axis=1))
            asides.append(aside[:, -2])
            tints.append((0.8 + 0.35 * np.abs(wild)) * palette.hair)
    half_width = np.array([0.35, 0.25, 0.06])
    return builder.strands(
        np.concatenate(spines), half_width, np.concatenate(asides), albedo=np.concatenate(tints)
    ).ravel()
