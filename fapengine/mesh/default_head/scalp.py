"""The scalp under the hair: the hairline, and the surface that locks are placed on."""

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from fapengine._arrays import Array
from fapengine.mesh.default_head.faces import normal, position
from fapengine.mesh.default_head.style import HeadStyle

HAIRLINE_DEG = (0, 18, 34, 46, 56, 64, 70, 76, 84, 96, 108, 120, 140, 180)
HAIRLINE_MM = (92, 94, 91, 79, 62, 48, 28, 16, 34, 44, 20, -28, -46, -50)
"""Height of the hairline, by angle from the front."""


def hairline(angle: Array) -> Array:
    """Height of the hairline, (...) mm, by angle from the front, (...) rad."""
    degrees = np.rad2deg(np.abs(angle))
    return np.asarray(PchipInterpolator(HAIRLINE_DEG, HAIRLINE_MM)(degrees), dtype=np.float64)


GOLDEN = 0.6180339887498949
"""Golden ratio; fractions of its multiples vary neighbouring locks without randomness."""


class Scalp:
    """The bare head as a point cloud for projections."""

    def __init__(self, style: HeadStyle) -> None:
        angle, y = np.meshgrid(np.linspace(-np.pi, np.pi, 181)[:-1], np.linspace(-60.0, 142.0, 90))
        points, normals = position(angle, y, style), normal(angle, y, style)
        self.points, self.normals = points.reshape(-1, 3), normals.reshape(-1, 3)
        self._tree = cKDTree(self.points)

    def under(self, points: Array) -> tuple[Array, Array]:
        """Project points, (N, 3) mm, onto the scalp: the feet and their normals, (N, 3) each."""
        distance, near = (np.asarray(result) for result in self._tree.query(points, k=6))
        weight = (1 / (distance + 0.5) ** 2)[..., None]
        normals = (self.normals[near] * weight).sum(axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        foot = (self.points[near] * weight).sum(axis=1) / weight.sum(axis=1)
        below: Array = points - ((points - foot) * normals).sum(axis=1, keepdims=True) * normals
        return below, normals
