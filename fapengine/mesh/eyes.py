"""Eyeballs and lids. Lids lie on a sphere a little larger than the eyeball, so that they can slide over it.

Theory of operation
-------------------
The lid rings of :func:`build_lids` run from the border of the block (level 2) over the crease to the margin (level 1)
and round its edge inwards (below 1). A lid moves by turning about the eyeball's horizontal axis:
:func:`lid_displacement` turns the margin from its neutral height to a given one and the rings behind it by a share
that falls to zero at the crease, so skin folds there and slides over the ball below.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh import colours
from fapengine.mesh.face_mesh import Bone, Material
from fapengine.mesh.patch import MeshBuilder
from fapengine.mesh.rings import Block, Rings
from fapengine.mesh.surface import HeadShape, angle_of, normal, position

Array = NDArray[np.float64]

RADIUS = 14.2
CENTRE = np.array([31.4, 36.0, 81.2])
"""Left eyeball; the right one is its mirror."""
LID_THICKNESS = 1.15
INNER_CORNER, OUTER_CORNER = np.array([18.6, 32.6]), np.array([44.6, 34.4])
OUTSIDE = (1.85, 1.7, 1.56, 1.44, 1.34, 1.25, 1.16, 1.08, 1.0)
CREASE = 1.4
EDGE = ((0.9, 0.35, 0.985), (0.75, 0.06, 0.96), (0.5, -1.2, 1.12))
"""Round the margin: level, height above the eyeball, size of the opening."""


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """One eye."""

    lids: Rings
    ball: NDArray[np.int64]
    centre: Array
    side: float
    """1 left, -1 right."""
    angles: Array
    """(N,) rad: neutral elevation of each margin vertex, seen from the eyeball's centre."""
    closed: Array
    """(N,) rad: elevation of the other lid's margin at the same place along the eye."""


def _margin(t: Array, upper: NDArray[np.bool_], shape: HeadShape) -> Array:
    """(N, 2): the rim of the opening; t is 1 at the outer corner."""
    share = (1 + t) / 2
    corner_line = INNER_CORNER + share[:, None] * (OUTER_CORNER - INNER_CORNER)
    half = shape.eye_opening_mm / 2
    middle_y = (INNER_CORNER[1] + OUTER_CORNER[1]) / 2
    skewed = np.clip(t + 0.1 * (1 - t**2), -1, 1)
    rise = (CENTRE[1] + half - middle_y) * (1 - np.abs(skewed) ** 2.5) ** 0.85
    sink = (middle_y - CENTRE[1] + half) * (1 - np.abs(t) ** 2.6) ** 0.95
    margin: Array = corner_line + np.stack([0 * t, np.where(upper, rise, -sink)], axis=-1)
    return margin


def _on_sphere(flat: Array, centre: Array, radius: float) -> Array:
    offset = flat - centre[:2]
    depth = np.sqrt(np.maximum(radius**2 - (offset**2).sum(axis=-1), 1.0))
    return np.concatenate([flat, (centre[2] + depth)[:, None]], axis=-1)


def build_lids(builder: MeshBuilder, border: NDArray[np.int64], block: Block, shape: HeadShape, side: float) -> Eye:
    """Add the lids and the ball of one eye inside a block whose border vertices exist already."""
    along, upper = block.along()
    t = side * along  # 1 at the outer corner on both sides
    at_border = builder.column("points_mm")[border]
    mirror = np.array([side, 1.0])
    margin = _margin(t, upper, shape) * mirror
    centre = CENTRE * [side, 1, 1]
    reach_mm = np.linalg.norm(at_border[:, :2] - margin, axis=1)
    grids, levels = [border], [2.0]
    for level in OUTSIDE:
        flat = margin + (level - 1) * (at_border[:, :2] - margin)
        angle = angle_of(flat[:, 0], flat[:, 1], shape)
        face = position(angle, flat[:, 1], shape)
        on_ball = _on_sphere(flat, centre, RADIUS + LID_THICKNESS + 1.2 * (level - 1))
        towards_face = smoothstep(((level - 1) * reach_mm - 0.8) / 7.0)
        points = on_ball + towards_face[:, None] * (face - on_ball)
        fold = np.exp(-(((level - CREASE) / 0.07) ** 2)) * np.where(upper, 1.0, 0.3) * (1 - np.abs(t) ** 4)
        points -= 0.7 * fold[:, None] * normal(angle, flat[:, 1], shape)
        shade = 1 - 0.22 * fold - 0.06 * (level < CREASE)
        albedo = colours.skin(points) * shade[:, None]
        lash = (level <= 1.0) * upper
        albedo = np.where(lash[:, None], colours.LASH, albedo)
        material = np.where(lash, Material.LASH, Material.SKIN)
        grids.append(builder.add(points, albedo=albedo, material=material))
        levels.append(level)
    for level, height, size in EDGE:
        flat = centre[:2] + size * (margin - centre[:2])
        points = _on_sphere(flat, centre, RADIUS + height)
        lash = upper & (level > 0.8)
        albedo = np.where(lash[:, None], colours.LASH, colours.skin(points) * [0.95, 0.72, 0.70])
        grids.append(builder.add(points, albedo=albedo, material=np.where(lash, Material.LASH, Material.SKIN)))
        levels.append(level)
    rings = np.stack(grids)
    builder.quads(rings, closed=True)
    ball = _build_ball(builder, centre, side)
    angles = np.arctan2(margin[:, 1] - centre[1], _on_sphere(margin, centre, RADIUS + LID_THICKNESS)[:, 2] - centre[2])
    return Eye(Rings(rings, np.array(levels), t, upper), ball, centre, side, angles, _other_lid(t, upper, angles))


def _other_lid(t: Array, upper: NDArray[np.bool_], angles: Array) -> Array:
    other = np.empty_like(angles)
    corners = np.abs(t) > 0.9999
    for mine, theirs in ((upper, ~upper | corners), (~upper, upper)):
        order = np.argsort(t[theirs])
        other[mine] = np.interp(t[mine], t[theirs][order], angles[theirs][order])
    return other


def _build_ball(builder: MeshBuilder, centre: Array, side: float) -> NDArray[np.int64]:
    polar = np.deg2rad(np.array([4.0, 9, 14, 19, 24, 30, 37, 46, 58, 72, 88]))[::-1]
    around = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    unit = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(around),
            np.sin(polar)[:, None] * np.sin(around),
            np.broadcast_to(np.cos(polar)[:, None], (len(polar), len(around))),
        ],
        axis=-1,
    )
    bone = Bone.LEFT_EYE if side > 0 else Bone.RIGHT_EYE

    def add(unit: Array) -> NDArray[np.int64]:
        where, uv = centre + RADIUS * unit, 0.5 + 0.5 * unit[..., :2]
        return builder.add(where, uv=uv, albedo=colours.EYE, material=Material.EYE, bone=bone, bone_weight=1.0)

    grid, pole = add(unit), add(np.array([0.0, 0.0, 1.0]))
    builder.quads(grid, closed=True)
    builder.fan(grid[-1], int(pole))
    return np.append(grid.ravel(), pole)


def lid_displacement(points: Array, eye: Eye, turn: Array) -> Array:
    """(levels, N, 3) mm: lid vertices turned about the eyeball's horizontal axis.

    Parameters
    ----------
    points : (levels, N, 3) mm
        Neutral lid vertices.
    eye : Eye
        Whose lids.
    turn : (N,) rad
        How far each margin vertex turns, upwards positive.
    """
    level = eye.lids.level
    share = np.where(level >= 1, 1 - smoothstep((level - 1) / (CREASE + 0.12 - 1)), 1.0)
    angle = share[:, None] * turn
    offset = points - eye.centre
    cosine, sine = np.cos(angle), np.sin(angle)
    y = offset[..., 1] * cosine + offset[..., 2] * sine
    z = offset[..., 2] * cosine - offset[..., 1] * sine
    return np.stack([np.zeros_like(y), y - offset[..., 1], z - offset[..., 2]], axis=-1)
