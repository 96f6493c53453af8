"""Eyeballs, lids and lashes. Lids are on a sphere slightly larger than the eyeball, so that they can slide over it.

Theory of operation
-------------------
The lid rings of :func:`build_lids` run from the border of the block (level 2) over the crease to the margin (level 1)
and around its edge inwards (below 1). A lid moves by turning about the horizontal axis of the eyeball:
:func:`lid_displacement` turns the margin from its neutral height to a given one and the rings behind it by a fraction
that falls to zero at the crease, so skin folds there and slides over the ball below. Lashes turn with their root.
"""

from dataclasses import dataclass, replace

import numpy as np

from fapengine._arrays import Array, Indices, Mask
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh import colours
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.mesh_builder import Block, MeshBuilder, Rings, golden, resampled, skin_uv
from fapengine.mesh.default_head.style import Detail, HeadStyle, palette_of
from fapengine.mesh.default_head.surface import angle_of, normal, position
from fapengine.mesh.face_mesh import Bone, Material

RADIUS = 14.2
CENTRE = np.array([31.4, 36.0, 81.2])
"""Left eyeball; the right one is its mirror image."""
LID_THICKNESS = 1.15
OPENED_BY_CHARM_MM = 2.6
"""Additional lid distance at charm 1; the iris, as high as the opening, grows with it."""
INNER_CORNER, OUTER_CORNER = np.array([17.9, 32.6]), np.array([45.2, 35.7])
OUTSIDE = (1.82, 1.66, 1.52, 1.42, 1.36, 1.32, 1.24, 1.14, 1.0)
CREASE, LINE = 1.32, 1.14
"""Levels of the crease, and of the edge of the line of lashes, which a closing lid does not stretch."""
EDGE = ((0.93, 0.42, 0.99), (0.8, 0.04, 0.965), (0.5, -1.2, 1.12))
"""Around the margin: level, height above the eyeball, size of the opening."""
STRETCH_ROUNDS, STRETCH_COLUMNS = 7, 58
"""Rounds of averaging of a closed lid, for so many columns."""
DOME, DOME_RAD = 0.077, (-0.02, 0.30)
"""Height of a closed lid over its margin's distance from the ball's centre, as a share of it; elevation, seen from
there, of its middle, and half width.
"""
FURROW, FURROW_RAD = 0.144, (0.47, 0.13)
"""The same of the furrow above it: depth; elevation at the middle of the eye, and half width."""
CLEAR = 0.98
"""Least distance of the lid's skin from the ball's centre, as a share of its margin's."""
LASH_SWING = 1.85
"""Turn of a lash about its root, relative to that of its lid."""
LASH_DOWN_RAD, LASH_TO_MIDDLE, LASH_CORNER_LIFT = 1.6, 0.45, 0.8
"""Lashes at the corners of a closed eye, where lids hardly turn, point down as well: least turn of a lash; part of its
reach to the side by which it goes down instead; least turn for its lift, rad."""
LASH_OUT_MM, LASH_LIFT_MM = 0.6, 0.9
"""How far upper lashes are rooted before the margin, and how far a turn of 1 rad lifts them: they overlap the line of a
closed eye, which has no gaps so.
"""
DARK_FROM = -0.74
"""Place along the upper lid, -1 at the inner corner, from which its edge is as dark as its lashes."""
POLAR_DEG = (88.0, 66, 50, 38, 30, 23, 17, 11, 5)


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """Vertices and angles of one eye."""

    lids: Rings
    ball: Indices
    lashes: Indices
    """(L, 6): two at the root, two half way, two at the tip."""
    lash_roots: Indices
    """(L,): index of each lash's root on the ring."""
    centre: Array
    side: float
    """1 left, -1 right."""
    angles: Array
    """(N,) rad: neutral elevation of each margin vertex, seen from the centre of the eyeball."""
    closed: Array
    """(N,) rad: elevation of the other lid's margin at the same position along the eye."""


def margin(t: Array, upper: Mask, style: HeadStyle) -> Array:
    """(N, 2): rim of the opening; t is 1 at the outer corner."""
    share = (1 + t) / 2
    corner_line = INNER_CORNER + share[:, None] * (OUTER_CORNER - INNER_CORNER)
    half = (style.eye_opening_mm + OPENED_BY_CHARM_MM * style.charm) / 2
    middle_y = (INNER_CORNER[1] + OUTER_CORNER[1]) / 2
    above, below = np.clip(t + 0.06 * (1 - t**2), -1, 1), np.clip(t - 0.16 * (1 - t**2), -1, 1)
    rise = (CENTRE[1] + half - middle_y) * (1 - np.abs(above) ** 2.25) ** 0.92
    sink = (middle_y - CENTRE[1] + half) * (1 - np.abs(below) ** 2.2)
    return corner_line + np.stack([0 * t, np.where(upper, rise, -sink)], axis=-1)


def _on_sphere(flat: Array, centre: Array, radius: float) -> Array:
    offset = flat - centre[:2]
    depth = np.sqrt(np.maximum(radius**2 - (offset**2).sum(axis=-1), 1.0))
    return np.concatenate([flat, (centre[2] + depth)[:, None]], axis=-1)


def _forward(t: Array, level: float) -> Array:
    """(N,) mm: offset of the inner corner in front of the ball, over the tear duct."""
    return 3.8 * smoothstep((-t - 0.58) / 0.42) * smoothstep((level - 0.45) / 0.3)


def _around_eye(rim: Array, border: Array, t: Array, level: float) -> Array:
    """(N, 2) mm: the ring of a level from 1, the rim, to 2, the border of the block.

    Rings between them are almonds that meet at the corners of the eye; only the outer ones become the block's
    rectangle. So the crease, and with it a closed lid, has no square corners.
    """
    out, share = border - rim, level - 1
    arch = (1 - np.abs(t) ** 2.0) ** 1.15
    middle = np.abs(t) < 0.5
    rise, sink = (out[middle & (np.sign(out[:, 1]) == sign), 1].mean() for sign in (1.0, -1.0))
    height = np.where(out[:, 1] > 0, rise, sink)
    almond = np.stack([out[:, 0] * (0.55 + 0.45 * arch), height * arch + 0.12 * out[:, 1] * (1 - arch)], axis=-1)
    towards_block = smoothstep((share - 0.4) / 0.6)
    return rim + share * (almond + towards_block * (out - almond))


def build_lids(
    builder: MeshBuilder, border: Indices, block: Block, style: HeadStyle, side: float, divided: Detail
) -> Eye:
    """Add lids, ball and lashes of one eye inside a block with existing border vertices, (N,) indices."""
    detail = divided.skin
    along, upper = block.along()
    t = side * along  # 1 at the outer corner on both sides
    palette = palette_of(style)
    at_border = builder.column("points_mm")[border]
    rim_flat = margin(t, upper, style) * np.array([side, 1.0])
    centre = CENTRE * [side, 1, 1]
    reach_mm = np.linalg.norm(at_border[:, :2] - rim_flat, axis=1)
    middle = (1 - t**2) ** 0.8
    grids, levels = [border], [2.0]
    outside = resampled(OUTSIDE, detail)
    outside[-2] = min(outside[-2], LINE)  # or a closing lid stretches the line of lashes
    flats = np.stack([_around_eye(rim_flat, at_border[:, :2], t, level) for level in outside])
    around = angle_of(flats[..., 0], flats[..., 1], style)  # all rings at once, which takes a third of the time
    faces, outs = position(around, flats[..., 1], style), normal(around, flats[..., 1], style)
    for level, flat, angle, face, out in zip(outside, flats, around, faces, outs, strict=True):
        on_ball = _on_sphere(flat, centre, RADIUS + LID_THICKNESS + 1.2 * (level - 1))
        on_ball[:, 2] += _forward(t, level)
        towards_face = smoothstep(((level - 1) * reach_mm - 0.6) / (7.0 + 0.5 * middle))
        points = on_ball + towards_face[:, None] * (face - on_ball)
        crease = np.exp(-(((level - CREASE) / 0.055) ** 2)) * np.where(upper, 1.0, 0.12) * middle
        hood = np.exp(-(((level - 1.6) / 0.15) ** 2)) * np.where(upper, 0.5, 0.05 + 0.9 * style.age) * middle
        points += (hood - 0.50 * crease)[:, None] * out
        shade = 1 - 0.20 * crease - np.where(upper, 0.05, 0.04) * smoothstep((CREASE + 0.1 - level) / 0.45)
        lash = (level <= 1.0) * upper & (t > DARK_FROM)
        shade *= 1 - 0.3 * (level <= 1.0) * middle  # lashes of the lower lid
        albedo = np.where(lash[:, None], colours.LASH, palette.skin(points) * shade[:, None])
        kind, uv = np.where(lash, Material.LASH, Material.SKIN), skin_uv(angle, flat[:, 1])
        place = np.stack([angle, flat[:, 1]], axis=-1)
        grids.append(builder.add(points, albedo=albedo, material=kind, uv=uv, place=place))
        levels.append(float(level))
    rim = points
    for level, height, size in EDGE:
        flat = centre[:2] + size * (rim_flat - centre[:2])
        points = _on_sphere(flat, centre, RADIUS + height)
        points[:, 2] += _forward(t, level)
        lash = upper & (level > 0.8) & (t > DARK_FROM)
        wet = palette.skin(points) * [0.98, 0.74, 0.72] * (0.75 if level > 0.9 else 1.0)  # dark between lashes
        albedo = np.where(lash[:, None], colours.LASH, wet)
        grids.append(builder.add(points, albedo=albedo, material=np.where(lash, Material.LASH, Material.LIP)))
        levels.append(level)
    rings = np.stack(grids)
    builder.quads(rings, closed=True)
    lashes, roots = _build_lashes(builder, rim, t, upper, centre, side, palette.base, divided.hair)
    _build_caruncle(builder, palette, side, detail)
    ball = _build_ball(builder, centre, side, detail)
    angles = np.arctan2(rim[:, 1] - centre[1], rim[:, 2] - centre[2])
    closed = _other_lid(t, upper, angles)
    return Eye(Rings(rings, np.array(levels), t, upper), ball, lashes, roots, centre, side, angles, closed)


def _other_lid(t: Array, upper: Mask, angles: Array) -> Array:
    other = np.empty_like(angles)
    corners = np.abs(t) > 0.9999
    for mine, theirs in ((upper, ~upper | corners), (~upper, upper)):
        order = np.argsort(t[theirs])
        other[mine] = np.interp(t[mine], t[theirs][order], angles[theirs][order])
    return other


def moved_eye(eye: Eye, centre: Array, before: Array, after: Array) -> Eye:
    """Return an eye with its ball and lids at another place.

    ``centre`` is the new centre of the ball, (3,) mm; ``before`` and ``after`` are the lid margin, (N, 3) mm each.
    """
    was, now = before - eye.centre, after - centre
    angles = eye.angles + np.arctan2(now[:, 1], now[:, 2]) - np.arctan2(was[:, 1], was[:, 2])
    closed = _other_lid(eye.lids.t, eye.lids.upper, angles)
    return replace(eye, centre=centre, angles=angles, closed=closed)


def _build_lashes(
    builder: MeshBuilder, rim: Array, t: Array, upper: Mask, centre: Array, side: float, skin: Array, detail: float
) -> tuple[Indices, Indices]:
    """Strands on the lids' margins in groups whose tips meet, the upper ones longer and bent upwards."""
    order = np.argsort(t)
    spines, half_widths, albedo, roots = [], [], [], []
    for is_upper, count, length_mm in ((True, 32, 2.3), (False, 8, 1.2)):
        mine = order[(upper[order] == is_upper) & (np.abs(t[order]) < 1)]
        number = np.arange(max(5, round(count * min(detail, 1.5))))
        at = -0.74 + 1.68 * (number + 0.35 * (golden(number) - 0.5)) / (len(number) - 1)
        group = (number + 1) // 3
        tips = np.bincount(group, at)[group] / np.bincount(group)[group]
        tips = at + (0.55 if is_upper else 0.3) * (tips - at)
        full = smoothstep((at + 1.0) / 1.5) * (1 - 0.35 * smoothstep((at - 0.75) / 0.25))
        length = (
            length_mm * (0.3 + 0.7 * full) * (0.72 + 0.28 * golden(number, 5.3)) * (0.85 + 0.3 * golden(group, 3.1))
        )

        def on_rim(where: Array, mine: Indices = mine) -> Array:
            return np.stack([np.interp(where, t[mine], rim[mine, axis]) for axis in range(3)], axis=-1)

        base = on_rim(at)
        outwards = unit_vectors(base - centre)
        base = base + LASH_OUT_MM * (1.0 if is_upper else 0.4) * outwards
        # They lean away from the middle of the eye, and together within a group.
        aside = (on_rim(tips) - on_rim(at)) / length[:, None] + (0.12 + 0.60 * at)[:, None] * [side, 0.0, 0.0]
        lift = np.array([0.0, 0.62 if is_upper else -0.62, 0.0])
        middle = base + length[:, None] * (0.5 * outwards + 0.45 * aside + 0.32 * lift)
        tip = base + length[:, None] * (0.88 * outwards + aside + lift)
        spines.append(np.stack([base, middle, tip], axis=1))
        widths = [0.40, 0.20, 0.02] if is_upper else [0.08, 0.05, 0.01]
        half_widths.append((0.4 + 0.6 * full)[:, None] * widths)
        fade = np.array([[0.0], [0.1], [0.3]] if is_upper else [[0.35]])  # to the skin's colour, towards the tip
        albedo.append(np.broadcast_to(colours.LASH + fade * (skin - colours.LASH), (len(at), 3, 3)))
        roots.append(mine[np.abs(t[mine] - at[:, None]).argmin(axis=1)])
    spine = np.concatenate(spines)
    way = spine[:, 2] - spine[:, 0]
    asides = unit_vectors(np.stack([way[:, 1], -way[:, 0], 0 * way[:, 0]], axis=-1))  # ribbons face forwards
    lashes = builder.strands(spine, np.concatenate(half_widths), asides[:, None], albedo=np.concatenate(albedo))
    return lashes, np.concatenate(roots)


def _dome(polar: Array, quarter: int) -> Array:
    """(R, 4 Q, 3): points of the unit sphere at angles (R,) from the z axis, Q in each quarter around it."""
    around = np.linspace(0, 2 * np.pi, 4 * quarter, endpoint=False)
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    return np.stack([sine * np.cos(around), sine * np.sin(around), cosine + 0 * around], axis=-1)


def _build_caruncle(builder: MeshBuilder, palette: Palette, side: float, detail: float) -> None:
    """Add the pink tissue in the inner corner, over the tear duct."""
    unit = _dome(np.linspace(0.35, 1.7, max(3, round(4 * detail)))[::-1], max(2, round(2.5 * detail)))
    middle, size = np.array([INNER_CORNER[0] + 1.9, INNER_CORNER[1] + 0.5, 86.6]), np.array([2.6, 2.0, 3.4])
    pink = palette.blush * np.array([1.0, 0.95, 0.9])
    mirror = np.array([side, 1.0, 1.0])
    grid = builder.add((middle + size * unit) * mirror, albedo=pink, material=Material.LIP)
    builder.quads(grid if side > 0 else grid[:, ::-1], closed=True)
    pole = builder.add((middle + size * [0, 0, 1]) * mirror, albedo=pink, material=Material.LIP)
    builder.fan(grid[-1] if side > 0 else grid[-1, ::-1], int(pole))


def _build_ball(builder: MeshBuilder, centre: Array, side: float, detail: float) -> Indices:
    unit = _dome(np.deg2rad(resampled(POLAR_DEG, detail)), max(4, round(7 * detail)))
    bone = Bone.LEFT_EYE if side > 0 else Bone.RIGHT_EYE

    def add(unit: Array) -> Indices:
        where, uv = centre + RADIUS * unit, 0.5 + 0.5 * unit[..., :2]
        return builder.add(where, uv=uv, albedo=colours.EYE, material=Material.EYE, bone=bone, bone_weight=1.0)

    grid, pole = add(unit), add(np.array([0.0, 0.0, 1.0]))
    builder.quads(grid, closed=True)
    builder.fan(grid[-1], int(pole))
    return np.append(grid.ravel(), pole)


def turned(points: Array, centre: Array, angle: Array) -> Array:
    """(..., 3) mm: displacement by a turn about the horizontal axis of the eyeball, ``angle`` (...) rad upwards."""
    offset = points - centre
    cosine, sine = np.cos(angle), np.sin(angle)
    y = offset[..., 1] * cosine + offset[..., 2] * sine
    z = offset[..., 2] * cosine - offset[..., 1] * sine
    return np.stack([np.zeros_like(y), y - offset[..., 1], z - offset[..., 2]], axis=-1)


def lid_displacement(points: Array, eye: Eye, turn: Array, shut: float = 0.0) -> Array:
    """(levels, N, 3) mm: displacement of lid vertices turned about the horizontal axis of the eyeball.

    ``points`` are the neutral lid vertices, (levels, N, 3) mm; ``turn`` is the turn of each margin vertex, (N,) rad,
    upwards positive. ``shut`` is how far the lid is closed, 0..1: the skin of a closed one is stretched smoothly from
    its margin to the brow.
    """
    level = eye.lids.level
    edge = LINE if shut > 0 else 1.0
    share = 1 - smoothstep((level - edge) / (CREASE + 0.12 - edge))
    moves = turned(points, eye.centre, share[:, None] * turn)
    return moves + shut * (_stretched(points + moves, eye) - points - moves) if shut > 0 else moves


def _stretched(points: Array, eye: Eye) -> Array:
    """(levels, N, 3) mm: the skin of an upper lid, averaged over neighbours: a dome, a furrow above."""
    level = eye.lids.level[:, None]
    free = smoothstep((level - LINE) / 0.1) * smoothstep((1.9 - level) / 0.3)
    free = (free * eye.lids.upper * (1 - np.abs(eye.lids.t) ** 6))[..., None]
    moved = points.copy()
    for _ in range(round(STRETCH_ROUNDS * (points.shape[1] / STRETCH_COLUMNS) ** 2)):
        beside = np.roll(moved, 1, axis=1) + np.roll(moved, -1, axis=1)
        above, below = moved[[0, *range(len(moved) - 1)]], moved[[*range(1, len(moved)), -1]]
        moved += free * ((beside + above + below) / 4 - moved)
    off = moved - eye.centre
    distance = np.linalg.norm(off, axis=-1, keepdims=True)
    margin = points[np.flatnonzero(eye.lids.level == 1.0)[0]] - eye.centre
    clear = CLEAR * np.linalg.norm(margin, axis=-1).min()
    elevation = np.arctan2(off[..., 1:2], off[..., 2:])
    across = (1 - eye.lids.t**2)[:, None]
    high = DOME * np.exp(-(((elevation - DOME_RAD[0]) / DOME_RAD[1]) ** 2))
    high -= FURROW * np.exp(-(((elevation - FURROW_RAD[0] * (0.5 + 0.5 * across)) / FURROW_RAD[1]) ** 2))
    shaped = np.maximum(distance + free * across * high * clear / CLEAR, clear)
    return np.where(free > 0, eye.centre + off * shaped / distance, points)


def lash_displacement(lashes: Array, eye: Eye, turn: Array) -> Array:
    """(L, 6, 3) mm: displacement of lashes, which swing farther than the lid: those of a shut eye point down.

    ``lashes`` are neutral, (L, 6, 3) mm; ``turn`` is that of each root, (L,) rad.
    """
    root = lashes[:, :2].mean(axis=1, keepdims=True)
    whole = (eye.closed - eye.angles)[eye.lash_roots]
    shut = np.where(whole < 0, np.clip(turn / np.minimum(whole, -0.01), 0, 1), 0.0)
    down = LASH_SWING * turn
    down = np.where(shut > 0, np.minimum(down, -LASH_DOWN_RAD * shut), down)
    swing = turned(lashes, root, down[:, None])
    spine = np.repeat((lashes[:, ::2] + lashes[:, 1::2]) / 2, 2, axis=1) - root
    aside = LASH_TO_MIDDLE * shut[:, None] * spine[..., 0]
    swing += np.stack([-aside, -np.abs(aside), 0 * aside], axis=-1)
    beside = unit_vectors(root[:, 0] - eye.centre)[:, 0] ** 3
    up = LASH_LIFT_MM * np.maximum(-turn, LASH_CORNER_LIFT * shut)
    lift = np.stack([-LASH_OUT_MM * beside * shut, up, 0 * turn], axis=-1)[:, None]
    return turned(root, eye.centre, turn[:, None]) + swing + lift
