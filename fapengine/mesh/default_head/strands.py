"""Hair: layers of strands, and locks and single hairs over them.

A layer covers the surface of a haircut (:mod:`.haircuts`) with strands side by side, some higher than their neighbours
and joined to them by steps until they taper; layers lie over each other and never cross. Locks are single arched
blades that overlap; single hairs soften the edges. Nothing is random: strands vary by fractions of multiples of the
golden ratio.
"""

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.haircuts import CUTS, Cut, Fall, Layer, lay_fall
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, resampled, strand_uv
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import Material

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
NEAR_FACE = 3
"""Strands next to those at the face that the camera sees from inside, past the forehead."""
STEP_MM, ROUND_MM, TIP_ROUND_MM = 2.2, 1.6, 2.2
"""Height of upper strands above lower ones; height of a strand's middle above its edges, and what tips add to it."""
PARTING_MM = (0.5, 2.8)
"""How far hair of either side goes beyond the parting, and its depth there."""
VALLEY_AT, VALLEY = (0.0, 0.05, 0.16), (0.72, 0.86, 1.0)
"""Light on hair along ``t``: it dips to the parting in a soft shadow."""
STREAKS, STREAK = ((3.0, 0.4, 0.6), (5.7, 2.0, -0.8), (9.1, 4.1, 1.0)), 0.09
"""Broad strands in lighter and darker hair: cycles per ``s``, phases and turns along ``t``, rad; and their contrast."""
WANDER = 0.018
"""How far the border between two strands wanders sideways, in ``s``."""
TAPER_AT, TAPER = (0.0, 0.3, 0.65, 1.0), (1.0, 1.1, 0.62, 0.07)
"""Width of a strand along its tip: it lies over its neighbours, then ends in a point. Narrower ends flicker."""
LOCK_ROWS, MAX_LOCK_DETAIL = 6, 1.4
"""Rows of a lock without length, six more per ``t``; locks are not divided further at the finest levels."""
LOCK_AT, LOCK = (0.0, 0.25, 0.45, 0.7, 0.85, 1.0), (0.3, 0.85, 1.0, 0.80, 0.48, 0.03)
"""Width of a lock along its length."""
HAIR_ROWS, PAINTED, TILT = 3, 1.0, 0.7
"""Points of a single hair without length, two more per ``t``; its light, near that of painted strands; how far its
ribbon is turned towards the outside, so that it is seen from the side, too.
"""
LOCK_TINT, LOCK_ROOTS = (1.03, 0.94), ((0.0, 0.3, 1.0), (0.97, 1.0, 1.03))
"""Light on a lock's middle and edges, and along it."""
ARCH = 0.42
"""Height of a lock's middle above its edges, in halves of its width."""
EVEN_NORMALS, EVEN_LOCKS = 1.6, 1.2
"""Weight of the normals of the surface relative to those of strands and of locks, so that hair is lit as one body."""
LIT_INSIDE = np.array([0.0, -0.5, 0.0])
"""Normal of the layer that is seen from inside: no lamp shines there."""
SHEEN_FROM = unit_vectors(np.array([[-0.24, 0.44, 0.87], [-0.75, 0.55, 0.25], [0.75, 0.55, 0.25]]))
"""Half way between a lamp and a camera in front or at a side: hair across it is bright, as a bundle of cylinders is."""
SHEEN, SHEEN_POWER, LOCK_SHEEN = np.array([3.4, 2.2, 2.8]), 32.0, 1.1
"""Additional light on hair at its brightest, by direction; how narrow the bands are; and how much brighter on locks."""
GROUPED = 0.35
"""How much lighter groups of hair are in their middle, and darker between them."""
THROUGH = 1.0
"""Additional light on hair that faces away from the camera in front: some comes through."""
EVEN_LIGHT_HAIR = 3.6
"""Fraction of the contrast that hair loses per unit of its mean linear RGB: light hair looked dyed."""


def build_strands(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add all layers; returns their indices, (N,), and last that of the top of the hair in the middle."""
    cut, detail = CUTS[style.haircut], min(detail, MAX_DETAIL)
    fall = lay_fall(style, cut)
    added = [_add_layer(builder, fall, cut, seed, palette, detail) for seed in range(len(cut.layers))]
    added += [_add_locks(builder, fall, cut, seed, palette, detail) for seed in range(len(cut.locks))]
    middle = fall.points[np.abs(fall.points[..., 0]) < 4.0]
    top = builder.add(middle[middle[:, 1].argmax()] * [0.0, 1.0, 1.0], albedo=palette.hair, material=Material.HAIR)
    return np.append(np.concatenate(added), top)


def _add_layer(builder: MeshBuilder, fall: Fall, cut: Cut, seed: int, palette: Palette, detail: float) -> Indices:
    """Add the strands of a layer, which is also the seed of their variation; returns their indices, (N,)."""
    layer = cut.layers[seed]
    number, lead = np.arange(layer.strands) + 5 * seed, len(layer.lead)
    rows = round(cut.rows * max(detail, MIN_ROWS) * (layer.last - layer.first))
    share = np.linspace(
        0, 1, max(7, rows) + 2 * (not layer.first)
    )  # denser at the tips, and where hair bends over the crown
    share = 1 - (1 - share) ** 1.15 if layer.first else share - DENSER * np.sin(2 * np.pi * share) / (2 * np.pi)
    across = resampled(ACROSS, max(detail, MIN_ACROSS[layer.first > 0]))
    side = 2 * across - 1
    level = np.where(number % 2, 0.45, 0.0) + 0.55 * golden(number, 2.3)
    t, s, wide = _places(layer, fall, number, level, share, side)
    level, t = level[:, None, None], t[..., None]
    points, out = fall.at(s, t)

    # Where layers lie over each other, strands are nearly level; the front edge is on the skin.
    apart = smoothstep((share - 0.5) / 0.4) if layer.first else 1 - 0.7 * smoothstep((share - 0.3) / 0.5)
    step = STEP_MM * apart[:, None]
    edges = (wide * (ROUND_MM + TIP_ROUND_MM * smoothstep((share - 0.55) / 0.3)))[..., None] * side**2
    first_mm, last_mm = layer.up_mm
    up = first_mm + (last_mm - first_mm) * smoothstep((share - 0.4) / 0.6)[:, None] + step * level - edges
    raised = smoothstep((t - 0.02) / 0.2)
    edge = 1.0 if cut.ends_mm is None else smoothstep((1 - np.abs(s)) / 0.04)
    points = points + (raised * up * edge)[..., None] * out
    if not layer.first and cut.ends_mm is not None:  # both sides of the parting cross in its depth
        over = np.array([1.0, 0.0, 0.0]) - out[:, 0, :, :1] * out[:, 0]
        points[:, 0] -= PARTING_MM[1] * out[:, 0] + PARTING_MM[0] * np.sign(s[:, 0, :, None]) * unit_vectors(over, 1e-6)
    own = _outwards(points, out)
    normals = 0.4 * out + LIT_INSIDE if layer.is_inside else own + EVEN_NORMALS * out

    tint = np.interp(side**2, (0, 1), (1.03, 0.95)) * (1 - 0.25 * (1 - level) * side**2)
    tint = tint * (0.90 + 0.15 * level + 0.07 * golden(number, 1.9)[:, None, None])
    tint = (1 + raised * (tint - 1)) * _streaked(fall, s, t, layer.shade**4)
    shade = layer.shade * tint * np.interp(share, (0, 0.85, 1), (1, 1, 0.9))[:, None]
    albedo = _tinted(palette, shade, out)
    grid = builder.add(
        points,
        albedo=albedo,
        material=Material.HAIR,
        uv=strand_uv((0.05 + 0.65 * golden(number, 3.1))[:, None, None] + 0.25 * across, 0.05 + 0.9 * t),
        normal=unit_vectors(normals, 1e-6),
        head_weight=_head_weight(points, cut),
    )
    whole = int(np.searchsorted(share, layer.tapers_from + 0.04))
    _join(builder, grid)
    _join(builder, np.stack([grid[:-1, :whole, -1], grid[1:, :whole, 0]], axis=-1))
    # Tips, strands at and near the face and the inside are seen from behind, too.
    tips, front = 0 if layer.is_inside else share.size // 3, lead + NEAR_FACE * (lead > 0)
    _join(builder, grid[front : layer.strands - front, tips:, ::-1])
    _join(builder, grid[np.r_[:front, layer.strands - front : layer.strands], :, ::-1])
    return grid.ravel()


def _places(
    layer: Layer, fall: Fall, number: Indices, level: Array, share: Array, side: Array
) -> tuple[Array, Array, Array]:
    """``t``, (N, R), and ``s``, (N, R, C), of strands at shares of their length, (R,), and across, (C,), -1 to 1.

    Last comes their width relative to that above their tips, (N, R).
    """
    lead, tapers_from = len(layer.lead), np.full(len(number), layer.tapers_from)
    width = 0.6 + 0.6 * golden(number, 3.7) + 0.3 * level
    own = golden(number, 2.9) + 0.5 * (1 - level)
    if fall.cut.groups:  # groups end in points
        middle = layer.reach * (2 * (np.cumsum(width) - width / 2) / width.sum() - 1)
        own = 0.2 * own + 0.5 * (1 - fall.crest(middle, np.ones(len(number))))
    length = layer.last * (1 - layer.uneven * own)
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
    wide = np.maximum(np.interp(on_tip, TAPER_AT, TAPER), layer.tips)
    aside = LEAN * (2 * golden(number, 6.3) - 1)[:, None] * on_tip**2
    if lead:  # tips at the face lie over their neighbours, so that no skin shows between them
        wide[:lead], wide[-lead:] = np.minimum(wide[:lead], 1.0), np.minimum(wide[-lead:], 1.0)
        over = (1 - wide) / 2 + OVER * smoothstep(on_tip / 0.3)
        aside[:lead], aside[-lead:] = over[:lead], -over[-lead:]
    middle = (low + high) / 2 + aside * (high - low)
    return t, middle[..., None] + ((high - low) / 2 * wide)[..., None] * side, wide


def _add_locks(builder: MeshBuilder, fall: Fall, cut: Cut, seed: int, palette: Palette, detail: float) -> Indices:
    """Add locks or single hairs; returns their indices, (N,)."""
    locks, detail = cut.locks[seed], min(detail, MAX_LOCK_DETAIL)
    number = np.arange(locks.blades) + 7 * seed
    place, wild = np.linspace(0, 1, locks.blades)[:, None], 2 * golden(number)[:, None] - 1
    aside, longer = (2 * golden(number, factor)[:, None] - 1 for factor in (2.9, 5.3))
    root, tip = (first + place * (last - first) for first, last in (np.array(locks.root), np.array(locks.tip)))
    root_t, tip_t = root[:, 1:], tip[:, 1:]
    length = float(np.abs(tip_t - root_t).max())
    share = np.linspace(
        0, 1, HAIR_ROWS + round(2 * length) if locks.is_single else max(6, round((LOCK_ROWS + 6 * length) * detail))
    )
    side = 2 * resampled(ACROSS, max(detail, 0.67)) - 1
    root_s, tip_s = root[:, :1] + 0.3 / locks.blades * wild, tip[:, :1] + 0.35 / locks.blades * aside
    tip_s = tip_s + locks.stray * (2 * golden(number, 3.3)[:, None] - 1)
    s = root_s + (tip_s - root_s) * share**1.3 + locks.bow * np.sin(np.pi * share) * (1 + 0.5 * longer)
    t = root_t + (tip_t + locks.uneven * longer - root_t) * share
    middle, out = fall.at(s, t)
    up = np.interp(share, (0, 0.5, 1), locks.up_mm) + 0.9 * smoothstep(share / 0.3) * aside
    first, last = locks.width_mm
    half = 0.5 * (first + (last - first) * place) * (1 + 0.35 * wild)
    across = unit_vectors(np.cross(np.gradient(middle, axis=1), out), 1e-6)
    if locks.is_single:
        spine = middle + up[..., None] * out
        shine = _streaked(fall, s, t, LOCK_SHEEN)
        return builder.strands(
            spine,
            half * np.interp(share, (0, 0.5, 1), (1, 0.8, 0.1)),
            unit_vectors(across + TILT * out, 1e-6),
            albedo=_tinted(palette, PAINTED * locks.shade * (0.95 + 0.2 * longer) * shine, out),
            head_weight=_head_weight(spine, cut),
            normal=out,
        ).ravel()
    half = half * np.interp(share, LOCK_AT, LOCK)
    out = out[:, :, None]
    points = middle[:, :, None] + (half[..., None] * side)[..., None] * across[:, :, None]
    points = points + (up[..., None] - ARCH * half[..., None] * side**2)[..., None] * out
    own = _outwards(points, out)
    tint = np.interp(side**2, (0, 1), LOCK_TINT) * (0.97 + 0.06 * longer[..., None])
    tint = tint * np.interp(share, *LOCK_ROOTS)[:, None] * _streaked(fall, s, t, LOCK_SHEEN)[..., None]
    grid = builder.add(
        points,
        albedo=_tinted(palette, locks.shade * tint, out),
        material=Material.HAIR,
        uv=strand_uv(
            (0.05 + 0.65 * golden(number, 3.1))[:, None, None] + 0.12 * (side + 1), (0.1 + 0.85 * t)[..., None]
        ),
        normal=unit_vectors(own + EVEN_LOCKS * out, 1e-6),
        head_weight=_head_weight(points, cut),
    )
    _join(builder, grid)
    if locks.up_mm[-1] > 0:  # lifted tips are seen from behind, too
        _join(builder, grid[:, share.size // 3 :, ::-1])
    return grid.ravel()


def _outwards(points: Array, out: Array) -> Array:
    """(N, R, C, 3): normals of strands, (N, R, C, 3) mm, on the side of outward directions."""
    own = unit_vectors(np.cross(np.gradient(points, axis=2), np.gradient(points, axis=1)), 1e-6)
    return np.where((own * out).sum(axis=-1, keepdims=True) < 0, -own, own)


def _tinted(palette: Palette, shade: Array, out: Array) -> Array:
    """(..., 3) linear RGB of hair at shades, (...), by outward directions, (..., 3); light hair has less contrast."""
    shade = shade * (1 + THROUGH * smoothstep((0.7 - out[..., 2]) / 1.0))
    even = min(EVEN_LIGHT_HAIR * float(palette.hair.mean()), 0.93)
    return palette.hair * (shade + even * (0.9 - shade))[..., None]


def _head_weight(points: Array, cut: Cut) -> Array:
    return np.asarray(1 - FREE_ENDS * smoothstep((FREE_FROM_MM - points[..., 1]) / 110.0) * (cut.ends_mm is not None))


def _streaked(fall: Fall, s: Array, t: Array, shiny: float) -> Array:
    """(...): light on hair at places, (...) each: the valley of the parting, streaks, groups, and a band of sheen.

    It is a function of the place alone, so that locks agree with what they lie on.
    """
    s, t = np.broadcast_arrays(s, t)
    (here, out), (there, _) = fall.at(s, np.maximum(t - 0.02, 0.0)), fall.at(s, np.minimum(t + 0.02, 1.0))
    across = np.clip(1 - (unit_vectors(there - here, 1e-6) @ SHEEN_FROM.T) ** 2, 0, 1)
    sheen = (across**SHEEN_POWER * np.clip(0.25 + out @ SHEEN_FROM.T, 0, 1)) @ SHEEN
    streaks = sum(np.sin(2 * np.pi * cycles * s + phase + turn * t) for cycles, phase, turn in STREAKS)
    valley = 1.0 if fall.cut.ends_mm is None else np.interp(t, VALLEY_AT, VALLEY)
    return np.asarray(valley * (1 + STREAK * streaks) * (1 + GROUPED * fall.crest(s, t)) * (1 + shiny * sheen))


def _join(builder: MeshBuilder, grids: Indices) -> None:
    """Join grids of vertices, (N, R, C): from outside, rows run down and columns to the right."""
    a, b, c, d = grids[:, :-1, :-1], grids[:, :-1, 1:], grids[:, 1:, 1:], grids[:, 1:, :-1]
    builder.loose(np.stack([a, b, c], axis=-1))
    builder.loose(np.stack([a, c, d], axis=-1))
