"""Glasses: two rims, a bridge and two temples that rest on the ears, as tubes laid before this head's face.

The rims keep clear of brows, lashes and cheeks; lenses are as good as clear and are not drawn.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.mesh_builder import MeshBuilder
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import angle_of
from fapengine.mesh.face_mesh import Material

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FRAME = np.array([0.016, 0.012, 0.011])
"""Linear RGB: dark horn."""
RIM_MIDDLE, RIM_HALF = np.array([32.0, 32.5]), np.array([24.0, 19.0])
RIM_SQUARENESS = 2.7
WRAP_PER_MM = 0.0042
"""Bend of the front round the face."""
CLEAR_MM, SIDE_CLEAR_MM = 2.6, 3.0
EAR_Z_MM, EAR_Y_MM = 2.0, 36.0
"""Place where a temple rests on the ear, and bends."""


def build_glasses(builder: MeshBuilder, style: HeadStyle, detail: float) -> Indices:
    """Add glasses; returns their indices, (N,). They go with the head and with nothing else."""
    around = np.linspace(0, 2 * np.pi, max(24, round(36 * detail)), endpoint=False)
    cosine, sine = np.cos(around), np.sin(around)
    rounded = np.stack([cosine, sine], axis=-1) * (np.abs(cosine) ** RIM_SQUARENESS + np.abs(sine) ** RIM_SQUARENESS)[
        :, None
    ] ** (-1 / RIM_SQUARENESS)
    flat = RIM_MIDDLE + rounded * RIM_HALF * [1.0, 1.0]
    flat[:, 0] -= 0.06 * (flat[:, 1] - RIM_MIDDLE[1]) * (flat[:, 0] < RIM_MIDDLE[0])  # wider apart below, for the nose
    front = float(np.max(_depth(flat, style) + WRAP_PER_MM * flat[:, 0] ** 2)) + CLEAR_MM

    def before(where: Array) -> Array:
        return np.concatenate([where, (front - WRAP_PER_MM * where[:, :1] ** 2)], axis=1)

    rim = before(flat)
    inner = np.array([flat[:, 0].min(), RIM_MIDDLE[1] + 5.0])
    across = np.linspace(-1, 1, max(5, round(7 * detail)))
    bridge = before(np.stack([inner[0] * across, inner[1] + 2.2 * (1 - across**2)], axis=-1))
    temple = _temple(rim[np.abs(around - 0.3).argmin()], style, max(8, round(10 * detail)))
    mirror = np.array([-1.0, 1.0, 1.0])
    parts = [
        _tube(builder, rim, 1.15, closed=True),
        _tube(builder, (rim * mirror)[::-1], 1.15, closed=True),
        _tube(builder, bridge, 1.15),
        _tube(builder, temple, 1.2),
        _tube(builder, temple * mirror, 1.2),
    ]
    return np.concatenate(parts)


def _depth(flat: Array, style: HeadStyle) -> Array:
    """(N,) mm: how far out the face stands at places seen from the front."""
    depth: Array = faces.position(angle_of(flat[:, 0], flat[:, 1], style), flat[:, 1], style)[:, 2]
    return depth


def _temple(start: Array, style: HeadStyle, count: int) -> Array:
    """(count, 3) mm: from the rim past the temple to the ear and down behind it."""
    share = np.linspace(0, 1, count)
    z = start[2] + (EAR_Z_MM - 20.0 - start[2]) * share
    y = start[1] + (EAR_Y_MM - start[1]) * np.clip(share / 0.7, 0, 1) - 16.0 * smoothstep((EAR_Z_MM + 2.0 - z) / 24.0)
    beside = faces.position(np.arctan2(80.0, z - 10.0), np.full(count, EAR_Y_MM), style)[:, 0] + SIDE_CLEAR_MM
    x = start[0] + np.clip(beside - start[0], 0, None) * smoothstep(share / 0.4)
    return np.stack([x, y, z], axis=-1)


def _tube(builder: MeshBuilder, path: Array, radius_mm: float, *, closed: bool = False) -> Indices:
    """Add a tube of six sides round a path, (N, 3) mm; returns its indices."""
    along = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0) if closed else np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, np.where(np.abs(along[:, 2:]) > 0.8, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    over = np.cross(aside, along)
    turn = np.linspace(0, 2 * np.pi, 6, endpoint=False)[:, None, None]
    rings = path + radius_mm * (np.cos(turn) * aside + np.sin(turn) * over)
    grid = builder.add(rings, albedo=FRAME, material=Material.CLOTH)
    rows = np.concatenate([grid, grid[:1]])
    builder.quads(rows, closed=closed)
    return grid.ravel()
