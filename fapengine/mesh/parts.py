"""What is neither skin nor eye: brows, ears, teeth, tongue, hair, and the shirt that ends the neck."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh import colours
from fapengine.mesh.face_mesh import Bone, Material
from fapengine.mesh.patch import MeshBuilder
from fapengine.mesh.surface import HeadShape, angle_of, normal, position

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

BROW = np.array([[9.5, 55.0], [20.0, 58.0], [33.0, 60.5], [44.0, 58.5], [54.0, 52.5]])
"""Middle line of the left brow, (x, y) mm, from the nose outwards (feature points 4.1, 4.3, 4.5)."""
BROW_HALF_WIDTH = np.array([3.0, 3.9, 3.3, 2.3, 0.5])


def build_brow(builder: MeshBuilder, shape: HeadShape, side: float) -> Indices:
    """Add a strip just above the skin; returns (rows, columns) indices."""
    share = np.linspace(0, 1, 26)
    knots = np.linspace(0, 1, len(BROW))
    middle = np.stack([np.interp(share, knots, BROW[:, 0]), _smooth_interp(share, knots, BROW[:, 1])], axis=-1)
    half = _smooth_interp(share, knots, BROW_HALF_WIDTH)
    across = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    flat = middle + across[:, None, None] * half[:, None] * np.array([0.15, 1.0])
    angle = angle_of(flat[..., 0], flat[..., 1], shape)
    crown = 0.35 + 1.0 * (1 - across[:, None] ** 2) * smoothstep(share / 0.08) * smoothstep((1 - share) / 0.15)
    points = position(angle, flat[..., 1], shape) + crown[..., None] * normal(angle, flat[..., 1], shape)
    points *= [side, 1, 1]
    edge = (1 - np.abs(across[:, None]) ** 3) * smoothstep((share + 0.02) / 0.14) * smoothstep((1.02 - share) / 0.2)
    streaks = 0.94 + 0.06 * np.sin(share * 70.0 + across[:, None] * 2.0)
    albedo = colours.skin(points) + (0.92 * edge * streaks)[..., None] * (colours.HAIR - colours.skin(points))
    grid = builder.add(points, albedo=albedo, material=Material.SKIN)
    builder.quads(grid if side > 0 else grid[:, ::-1])
    return grid


def _smooth_interp(x: Array, knots: Array, values: Array) -> Array:
    return np.asarray(PchipInterpolator(knots, values)(x))


def build_ear(builder: MeshBuilder, side: float) -> Indices:
    """Add a shell of rings from the canal over the rim to the head; returns (rings, segments) indices."""
    around = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    up, back = np.cos(around), np.sin(around)
    outline = 1 + 0.16 * up - 0.07 * np.cos(2 * around) + 0.05 * back * up
    half = np.stack([31.0 * outline * up - 1.0, 16.5 * outline * back * (1 + 0.12 * up)], axis=-1)
    lobe = smoothstep((-up - 0.45) / 0.5)
    rings, shades = [], []
    for share, height, shine in (
        (0.06, -2.0, 0.55), (0.22, -1.5, 0.62), (0.4, 0.5, 0.75), (0.55, 3.4, 0.95), (0.68, 3.6, 0.95),
        (0.78, 2.6, 0.85), (0.88, 4.6, 1.0), (0.95, 5.6, 1.05), (1.0, 4.6, 1.0), (0.99, 2.2, 0.9), (0.9, -2.5, 0.7),
        (0.7, -9.0, 0.6),
    ):  # fmt: skip
        front = smoothstep((back + 0.9) / 0.5)
        rise = height * (0.45 + 0.55 * front) * (1 - 0.5 * lobe * (height > 3))
        rings.append(np.concatenate([half * share, rise[:, None]], axis=-1))
        shades.append(shine)
    local = np.stack(rings)  # (rings, segments, (up, back, out))
    up_axis, back_axis = np.array([0.08, 0.98, -0.20]), np.array([0.42, -0.16, -0.89])
    out_axis = np.cross(back_axis, up_axis)
    points = np.array([82.0, 9.0, 0.0]) + local @ np.stack([up_axis, back_axis, out_axis])
    points = points * [side, 1, 1]
    shade = np.broadcast_to(np.array(shades)[:, None, None], (*points.shape[:-1], 1))
    albedo = (colours.skin(points) + 0.35 * (colours.BLUSH - colours.skin(points))) * shade
    grid = builder.add(points, albedo=albedo)
    builder.quads(grid if side > 0 else grid[:, ::-1], closed=True)
    return grid


def _arch(share: Array, half_width: float, front_z: float, depth: float) -> tuple[Array, Array]:
    """Dental arch: (N, 2) x and z for share -1..1, and its outward normals."""
    x = half_width * np.sin(share * np.pi / 2 * 0.98)
    z = front_z - depth * np.abs(share) ** 2.2
    tangent = np.gradient(np.stack([x, z], axis=-1), axis=0)
    outward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return np.stack([x, z], axis=-1), outward


def build_teeth(builder: MeshBuilder, *, upper: bool) -> Indices:
    """Add one row of 14 teeth with its gum; returns (rows, columns) indices, the gum's end first."""
    teeth, each = 14, 6
    half_width, front_z = (24.5, 103.6) if upper else (22.5, 101.6)
    edge_y, gum_y = (-35.0, -25.5) if upper else (-35.2, -44.0)
    share = np.linspace(-1, 1, teeth * each + 1)
    arch, outward = _arch(share, half_width, front_z, 36.0)
    in_tooth = (np.arange(len(share)) % each) / each
    round_off = np.abs(np.sin(np.pi * in_tooth)) ** 0.4
    number = np.abs(share) * teeth / 2
    length = 1.0 - 0.10 * smoothstep((number - 0.9) / 1.5) - 0.12 * smoothstep((number - 3.5) / 2.0)
    direction = np.sign(edge_y - gum_y)
    rows, looks = [], []
    for height, out, is_gum in (
        (-0.9, -1.0, True), (-0.45, 0.6, True), (-0.05, 0.9, True), (0.0, 0.55, False), (0.3, 0.9, False),
        (0.7, 0.75, False), (0.94, 0.35, False), (1.0, -0.5, False), (0.92, -1.6, False), (0.2, -3.2, False),
        (-0.4, -4.0, True),
    ):  # fmt: skip
        stands_out = out - 0.55 * (1 - round_off) * (not is_gum)
        xz = arch + stands_out[:, None] * outward
        tip = length * (1 - 0.05 * (1 - round_off))
        scallop = 0.10 * (1 - round_off) * (abs(height) < 0.1)
        y = gum_y + direction * abs(edge_y - gum_y) * (np.where(height > 0, height * tip, height) + scallop)
        rows.append(np.stack([xz[:, 0], y, xz[:, 1]], axis=-1))
        gap = 0.55 + 0.45 * round_off
        far = 1 - 0.45 * smoothstep((np.abs(share) - 0.35) / 0.6)
        colour = colours.GUM if is_gum else colours.TEETH * gap[:, None]
        looks.append(np.broadcast_to(colour, rows[-1].shape) * far[:, None])
    points, albedo = np.stack(rows), np.stack(looks)
    kinds = np.array([Material.GUM] * 3 + [Material.TEETH] * 7 + [Material.GUM])[:, None]
    bone = Bone.NONE if upper else Bone.JAW
    grid = builder.add(points, albedo=albedo, material=kinds, bone=bone, bone_weight=float(not upper))
    builder.quads(grid if not upper else grid[:, ::-1])
    return grid


TONGUE_TIP = np.array([0.0, -40.0, 96.0])


def build_tongue(builder: MeshBuilder) -> Indices:
    """Add a flattened tube from root to tip; returns its indices, the tip last."""
    share = np.linspace(0, 1, 14)
    around = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    half_width = 18.5 * (1 - 0.35 * share**2) * np.sqrt(np.clip(1 - share**6, 0, 1)) + 0.4
    half_height = 7.5 * (1 - 0.45 * share) * np.sqrt(np.clip(1 - share**5, 0, 1)) + 0.3
    y = -45.0 + 5.5 * np.sin(np.pi * (0.15 + 0.7 * share)) - 0.8 * share
    z = 52.0 + (TONGUE_TIP[2] - 52.0) * share
    height = np.sin(around) * half_height[:, None]
    groove = -1.2 * np.exp(-((np.cos(around) / 0.35) ** 2)) * (np.sin(around) > 0) * (1 - share[:, None] ** 3)
    points = np.stack(
        [np.cos(around) * half_width[:, None], y[:, None] + height + groove, np.broadcast_to(z[:, None], height.shape)],
        axis=-1,
    )
    shade = (0.45 + 0.55 * share)[:, None, None]

    def add(where: Array, albedo: Array) -> Indices:
        return builder.add(where, albedo=albedo, material=Material.TONGUE, bone=Bone.JAW, bone_weight=1.0)

    grid = add(points, colours.TONGUE * shade)
    tip = add(points[-1].mean(axis=0) + np.array([0, 0, 0.6]), colours.TONGUE)
    builder.quads(grid, closed=True)
    builder.fan(grid[-1], int(tip))
    return np.append(grid.ravel(), tip)


def hairline(angle: Array) -> Array:
    """Height at which hair begins, mm, by angle from the front."""
    degrees = np.rad2deg(np.abs(angle))
    knots = [0, 18, 34, 46, 56, 64, 70, 76, 84, 96, 108, 120, 140, 180]
    heights = [95, 97, 93, 80, 63, 50, 26, 20, 38, 44, 20, -28, -46, -50]
    return _smooth_interp(degrees, np.array(knots, dtype=float), np.array(heights, dtype=float))


def build_hair(builder: MeshBuilder, shape: HeadShape) -> Indices:
    """Add a short cut with a side parting, a shell over the scalp in locks; returns its indices."""
    angle = np.linspace(-np.pi, np.pi, 121)[:-1]
    line = hairline(angle)
    share = np.array([-0.03, 0.0, 0.02, 0.05, 0.1, 0.17, 0.26, 0.36, 0.48, 0.6, 0.71, 0.81, 0.89, 0.95, 0.985])
    y = line + np.clip(share, -1, 1)[:, None] * (144.0 - line)
    wide = np.broadcast_to(angle, y.shape)
    base, out = position(wide, y, shape), normal(wide, y, shape)
    s = share[:, None]
    front = np.exp(-((np.abs(angle) / 0.8) ** 2))
    quiff = 5.0 * front * smoothstep((s + 0.02) / 0.30) * np.exp(-((s / 0.6) ** 2)) * (1 + 0.4 * np.sin(angle - 0.6))
    parting = -4.0 * np.exp(-(((angle - 0.5) / 0.07) ** 2)) * smoothstep((s - 0.06) / 0.1) * smoothstep((0.8 - s) / 0.4)
    volume = 0.6 + 8.5 * smoothstep((s + 0.02) / (0.20 + 0.16 * front))
    volume = volume * (1 - 0.45 * smoothstep((np.abs(angle) - 0.9) / 0.5) * smoothstep((0.75 - s) / 0.5))
    sweep = angle * 24 + 6.0 * s + 2.5 * np.sin(3 * angle)
    locks = (0.7 * np.sin(sweep) + 0.45 * np.sin(2.3 * sweep + 1.3)) * smoothstep(s / 0.1) * smoothstep((1 - s) / 0.3)
    thickness = np.where(s < 0, -3.0, volume + quiff + parting + locks)
    points = base + thickness[..., None] * out
    streak = 1 + 0.30 * np.sin(sweep * 1.7 + 0.8) * np.sin(sweep * 0.61) + 0.4 * front * smoothstep((s - 0.05) / 0.3)
    albedo = colours.HAIR * streak[..., None]
    root = (1 - smoothstep(s / 0.03))[..., None]
    albedo = albedo + 0.25 * root * (colours.skin(base) - albedo)
    grid = builder.add(points, albedo=albedo, material=Material.HAIR)
    builder.quads(grid, closed=True)
    crown = builder.add(points[-1].mean(axis=0) + np.array([0, 3.0, 0]), albedo=colours.HAIR, material=Material.HAIR)
    builder.fan(grid[-1], int(crown))
    return np.append(grid.ravel(), crown)


def build_shirt(builder: MeshBuilder) -> Indices:
    """Add collar and shoulders, which stay where they are when the head turns."""
    around = np.linspace(-np.pi, np.pi, 73)[:-1]
    # fmt: off
    rows = (  # height, half width, half depth, drop at the front
        (-112, 54, 60, 12), (-110, 57, 63, 12), (-113, 61, 67, 13), (-120, 66, 70, 14), (-126, 84, 74, 16),
        (-134, 112, 78, 18), (-145, 142, 82, 18), (-160, 166, 86, 16), (-182, 182, 92, 12), (-215, 190, 98, 8),
        (-300, 192, 102, 0),
    )
    # fmt: on
    table = np.array(rows, dtype=np.float64)[:, :, None]
    x = table[:, 1] * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.9
    z = -8.0 + table[:, 2] * np.cos(around)
    y = table[:, 0] - table[:, 3] * np.maximum(np.cos(around), 0)
    folds = 1 + 0.04 * np.sin(around * 9 + table[:, 0] * 0.08)
    points = np.stack([x, y, z], axis=-1)
    albedo = colours.CLOTH * (folds[..., None] * np.where(np.arange(len(rows)) < 3, 0.72, 1.0)[:, None, None])
    grid = builder.add(points, albedo=albedo, material=Material.CLOTH, head_weight=0.0)
    builder.quads(grid[::-1], closed=True)
    return grid
