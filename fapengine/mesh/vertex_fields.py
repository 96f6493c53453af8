"""Values at the vertices of any mesh: normals, ambient occlusion, averages over neighbours."""

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array


def vertex_normals(points_mm: Array, triangles: NDArray[np.integer]) -> Array:
    """(V, 3): unit normals, weighted by triangle area."""
    corners = points_mm[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(points_mm)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.tile([0.0, 0.0, 1.0], (len(normals), 1)), where=length > 1e-12)


def bake_occlusion(points_mm: Array, normals: Array, *, directions: int = 60, cell_mm: float = 5.0) -> Array:
    """(V,): fraction of ambient light that reaches each vertex, from depth maps in many directions.

    For each direction the vertices are sorted into the cells of a map; a vertex more than two cells behind the nearest
    one of its cell is in shadow. Cosine-weighted over the vertex's hemisphere.
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
    """(V,): repeated averages over neighbours."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    degree = np.bincount(edges.ravel(), minlength=len(values))
    for _ in range(rounds):
        around = np.bincount(edges[:, 0], values[edges[:, 1]], len(values))
        around += np.bincount(edges[:, 1], values[edges[:, 0]], len(values))
        values = 0.5 * values + 0.5 * np.where(degree > 0, around / np.maximum(degree, 1), values)
    return values
