"""Building a mesh part by part: grids and rings of quads, with everything that a vertex carries."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.mesh.atlas import PLAIN_UV
from fapengine.mesh.face_mesh import Bone, Material

Array = NDArray[np.float64]


@dataclass(slots=True)
class MeshBuilder:
    """Stateful: collects parts; vertex indices are those of the finished mesh."""

    count: int = 0
    _fields: dict[str, list[NDArray[np.generic]]] = field(default_factory=dict)
    _triangles: list[NDArray[np.int64]] = field(default_factory=list)

    def add(
        self,
        points_mm: Array,
        *,
        albedo: ArrayLike,
        material: ArrayLike = Material.SKIN,
        bone: ArrayLike = Bone.NONE,
        bone_weight: ArrayLike = 0.0,
        head_weight: ArrayLike = 1.0,
        uv: ArrayLike = PLAIN_UV,
    ) -> NDArray[np.int64]:
        """Add vertices, (..., 3) mm; everything else broadcasts. Returns their indices, of shape (...)."""
        shape = points_mm.shape[:-1]
        size = int(np.prod(shape))
        for name, value, tail in (
            ("points_mm", points_mm, (3,)),
            ("albedo", albedo, (3,)),
            ("material", material, ()),
            ("bone", bone, ()),
            ("bone_weight", bone_weight, ()),
            ("head_weight", head_weight, ()),
            ("uv", uv, (2,)),
        ):
            spread = np.broadcast_to(np.asarray(value), (*shape, *tail)).reshape(size, *tail)
            self._fields.setdefault(name, []).append(np.array(spread))
        indices = self.count + np.arange(size).reshape(shape)
        self.count += size
        return indices

    def quads(self, grid: NDArray[np.int64], *, closed: bool = False, keep: NDArray[np.bool_] | None = None) -> None:
        """Join a (rows, columns) grid of vertices; ``closed`` joins the last column to the first.

        The outside is where rows run up and columns to the right. ``keep`` leaves out cells: (rows - 1, columns or
        columns - 1) bool.
        """
        if closed:
            grid = np.concatenate([grid, grid[:, :1]], axis=1)
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        cells = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=-2)
        if keep is not None:
            cells = cells[keep]
        triangles = cells.reshape(-1, 3)
        self._triangles.append(
            triangles[
                (triangles[:, 0] != triangles[:, 1])
                & (triangles[:, 1] != triangles[:, 2])
                & (triangles[:, 0] != triangles[:, 2])
            ]
        )

    def fan(self, ring: NDArray[np.int64], centre: int) -> None:
        """Close a ring with a centre; the outside is where the ring runs counter-clockwise."""
        self._triangles.append(np.stack([ring, np.roll(ring, -1), np.full(len(ring), centre)], axis=-1))

    def loose(self, triangles: NDArray[np.int64]) -> None:
        """Add triangles, (F, 3), counter-clockwise from outside."""
        self._triangles.append(triangles)

    def column(self, name: str) -> NDArray[Any]:
        """All values of one field so far."""
        return np.concatenate(self._fields[name])

    def triangles(self) -> NDArray[np.int64]:
        """(F, 3), counter-clockwise from outside."""
        return np.concatenate(self._triangles)


def vertex_normals(points_mm: Array, triangles: NDArray[np.integer]) -> Array:
    """(V, 3): unit normals, triangles weighted by area; vertices at the same place share theirs."""
    corners = points_mm[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(points_mm)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Array = np.divide(normals, length, out=np.tile([0.0, 0.0, 1.0], (len(normals), 1)), where=length > 1e-12)
    return unit


def bake_occlusion(points_mm: Array, normals: Array, *, directions: int = 60, cell_mm: float = 5.0) -> Array:
    """(V,): share of ambient light that reaches each vertex, by depth maps from many directions.

    For each direction the vertices are sorted into cells of a map; one that lies behind the nearest of its cell by more
    than a cell is in shadow. Cosine-weighted over the vertex's hemisphere.
    """
    index = np.arange(directions) + 0.5
    polar, azimuth = np.arccos(1 - 2 * index / directions), np.pi * (1 + 5**0.5) * index
    rays = np.stack([np.cos(azimuth) * np.sin(polar), np.cos(polar), np.sin(azimuth) * np.sin(polar)], axis=-1)
    light, total = np.zeros(len(points_mm)), np.zeros(len(points_mm))
    for ray in rays:
        side = np.cross(ray, [0.3, 0.8, 0.52])
        side /= np.linalg.norm(side)
        cells = np.floor(np.stack([points_mm @ side, points_mm @ np.cross(ray, side)]) / cell_mm).astype(np.int64)
        cells -= cells.min(axis=1, keepdims=True)
        key = cells[0] * (cells[1].max() + 1) + cells[1]
        depth = points_mm @ ray
        nearest = np.full(key.max() + 1, -np.inf)
        np.maximum.at(nearest, key, depth)
        cosine = np.clip(normals @ ray, 0.0, None)
        light += cosine * (depth > nearest[key] - 2.0 * cell_mm)
        total += cosine
    return light / np.maximum(total, 1e-9)


def smooth_over_mesh(values: Array, triangles: NDArray[np.integer], rounds: int) -> Array:
    """(V,): averages of neighbours, repeated."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    degree = np.bincount(edges.ravel(), minlength=len(values))
    for _ in range(rounds):
        around = np.bincount(edges[:, 0], values[edges[:, 1]], len(values))
        around += np.bincount(edges[:, 1], values[edges[:, 0]], len(values))
        values = 0.5 * values + 0.5 * np.where(degree > 0, around / np.maximum(degree, 1), values)
    return values
