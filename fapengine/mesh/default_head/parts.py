"""Teeth, tongue, and the shirt that ends the neck."""

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh import colours
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.mesh_builder import MeshBuilder
from fapengine.mesh.default_head.rings import resampled
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import Bone, Material

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def _arch(share: Array, half_width: float, front_z: float, depth: float) -> tuple[Array, Array]:
    """Dental arch: (N, 2) x and z for share -1..1, and its outward normals."""
    x = half_width * np.sin(share * np.pi / 2 * 0.98)
    z = front_z - depth * np.abs(share) ** 2.2
    tangent = np.gradient(np.stack([x, z], axis=-1), axis=0)
    outward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return np.stack([x, z], axis=-1), outward


CROWNS = slice(3, 10)
"""Rows of teeth that are no gum."""
UPPER_WIDTHS_MM = (8.5, 6.5, 7.5, 7.0, 7.0, 10.0, 9.0)
LOWER_WIDTHS_MM = (5.0, 5.5, 7.0, 7.0, 7.0, 11.0, 10.5)
"""Widths of crowns from the middle to the back, as tables of dental anatomy have them. Their ratios count."""
GAP_POWER = 2.5
"""Power that crowds columns at the gaps between teeth; 1 spreads them evenly."""


def build_teeth(builder: MeshBuilder, detail: float, *, upper: bool) -> Indices:
    """Add one row of 14 teeth with its gum; returns indices, (R, C): rows by columns, the gum's end first."""
    teeth, each = 14, max(3, round(3 * detail))
    half_width, front_z = (27.5, 103.6) if upper else (25.5, 100.3)
    edge_y, gum_y = (-35.2, -25.5) if upper else (-32.7, -42.2)
    in_tooth = (np.arange(teeth * each + 1) % each) / each
    # Columns stand close to the gaps, so that a gap is a line and a tooth is flat.
    in_tooth = np.where(in_tooth < 0.5, 0.5 * (2 * in_tooth) ** GAP_POWER, 1 - 0.5 * (2 - 2 * in_tooth) ** GAP_POWER)
    number = np.abs(np.repeat(np.arange(teeth + 1), each)[: teeth * each + 1] + in_tooth - teeth / 2)
    edges = np.cumsum([0.0, *(UPPER_WIDTHS_MM if upper else LOWER_WIDTHS_MM)])
    share = np.interp(number, np.arange(teeth // 2 + 1), edges / edges[-1])
    share *= np.sign(np.arange(teeth * each + 1) - teeth * each / 2)
    arch, outward = _arch(share, half_width, front_z, 36.0)
    round_off = np.abs(np.sin(np.pi * in_tooth)) ** 0.4
    length = 1.0 - (0.10 * smoothstep((number - 0.9) / 1.5) + 0.12 * smoothstep((number - 3.5) / 2.0)) * upper
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
        far = 1 - 0.38 * smoothstep((np.abs(share) - 0.40) / 0.6)
        # A smile shows the light half above the upper edges; lower teeth come out of the lip's shadow.
        shade = 1.5 - 0.7 * np.clip(height, 0, 1) if upper else 0.54
        colour = colours.GUM if is_gum else colours.TEETH * (shade * gap)[:, None]
        looks.append(np.broadcast_to(colour, rows[-1].shape) * far[:, None])
    points, albedo = np.stack(rows), np.stack(looks)
    kinds = np.full((len(rows), 1), Material.GUM)
    kinds[CROWNS] = Material.TEETH
    bone = Bone.NONE if upper else Bone.JAW
    grid = builder.add(points, albedo=albedo, material=kinds, bone=bone, bone_weight=float(not upper))
    builder.quads(grid if not upper else grid[:, ::-1])
    return grid


TONGUE_TIP = np.array([0.0, -36.0, 97.0])
"""Place of the tip at rest: behind the edge between upper and lower teeth, where the standard's neutral face has it."""


TONGUE_RISE_MM = 4.5
"""Height of the tongue's back over its tip."""
BACK_ON_JAW = 0.5
"""Share of the jaw's turn with which the tongue's back goes; the tip, behind the lower teeth, goes with them."""


def build_tongue(builder: MeshBuilder, detail: float) -> Indices:
    """Add a flattened tube from root to tip; returns its indices, (N,), the tip last."""
    share = 1 - (1 - np.linspace(0, 1, max(9, round(13 * detail)))) ** 1.5  # rings stand closer at the tip
    around = np.linspace(0, 2 * np.pi, 4 * max(3, round(4 * detail)), endpoint=False)
    half_width = 18.5 * (1 - 0.35 * share**2) * np.sqrt(np.clip(1 - share**9, 0, 1)) + 0.4
    half_height = 7.5 * (1 - 0.45 * share) * np.sqrt(np.clip(1 - share**9, 0, 1)) + 0.3
    y = TONGUE_TIP[1] + TONGUE_RISE_MM * np.sin(np.pi * np.clip(1.12 * (1 - share), 0, 1) ** 0.8) - 2.0 * (1 - share)
    z = 52.0 + (TONGUE_TIP[2] - 52.0) * share
    height = np.sin(around) * half_height[:, None]
    groove = -1.2 * np.exp(-((np.cos(around) / 0.35) ** 2)) * (np.sin(around) > 0) * (1 - share[:, None] ** 3)
    points = np.stack(
        [np.cos(around) * half_width[:, None], y[:, None] + height + groove, np.broadcast_to(z[:, None], height.shape)],
        axis=-1,
    )
    shade = (0.45 + 0.55 * share)[:, None, None]

    def add(where: Array, albedo: Array) -> Indices:
        weight = 1 - (1 - BACK_ON_JAW) * smoothstep((TONGUE_TIP[2] - where[..., 2] - 3.0) / 22.0)
        return builder.add(where, albedo=albedo, material=Material.TONGUE, bone=Bone.JAW, bone_weight=weight)

    grid = add(points, colours.TONGUE * shade)
    tip = add(points[-1].mean(axis=0) + np.array([0, 0, 0.6]), colours.TONGUE)
    builder.quads(grid, closed=True)
    builder.fan(grid[-1], int(tip))
    return np.append(grid.ravel(), tip)


def build_shirt(builder: MeshBuilder, style: HeadStyle, detail: float) -> Indices:
    """Add collar and shoulders, (N,) indices, which stay where they are when the head turns.

    The collar lies round the neck of this head.
    """
    around = np.linspace(-np.pi, np.pi, max(32, round(44 * detail)) + 1)[:-1]
    # fmt: off
    rows = (  # height, half width, half depth, drop at the front; distance from the neck, share of the shoulders
        (-112, 52, 58, 15, 1.5, 0.0), (-107.5, 56, 62, 15, 2.6, 0.0),
        (-107, 58, 64, 15, 4.4, 0.0), (-109, 60, 66, 15, 5.8, 0.0), (-116, 64, 68, 15.5, 7.2, 0.05),
        (-116.6, 66, 70, 16, 6.0, 0.1), (-121, 78, 74, 17, 9.0, 0.6), (-128, 100, 78, 18, 12, 1.0),
        (-140, 132, 81, 18, 0, 1.0), (-160, 168, 86, 16, 0, 1.0),
        (-195, 186, 95, 10, 0, 1.0), (-300, 192, 102, 0, 0, 1.0),
    )
    # fmt: on
    table = resampled(rows, max(1.0, detail))[:, :, None]
    table[0, 4] -= 6.0 * max(0.0, 1.0 - detail)  # a coarse neck is narrower between its columns
    y = table[:, 0] - table[:, 3] * np.maximum(np.cos(around), 0)
    shoulders = np.stack(
        [
            table[:, 1] * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.9,
            y,
            -8.0 + table[:, 2] * np.cos(around),
        ],
        axis=-1,
    )
    angle = np.broadcast_to(around, y.shape)
    outwards = faces.normal(angle, y, style) * [1.0, 0.0, 1.0]
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    collar = faces.position(angle, y, style) + table[:, 4][..., None] * outwards
    points = collar + table[:, 5][..., None] * (shoulders - collar)
    folds = 1 + 0.04 * np.sin(around * 9 + table[:, 0] * 0.08)
    band = np.where(table[:, 0] > -116.3, 0.72 + 0.05 * np.cos(36 * around), 1.0)
    albedo = colours.CLOTH * (folds * band)[..., None]
    grid = builder.add(points, albedo=albedo, material=Material.CLOTH, head_weight=0.0)
    builder.quads(grid[::-1], closed=True)
    return grid
