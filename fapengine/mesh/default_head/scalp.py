"""The scalp as hair sees it: points to which locks are laid."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.mesh.default_head.faces import normal, position
from fapengine.mesh.default_head.style import HeadStyle

Array = NDArray[np.float64]

GOLDEN = 0.6180339887498949
"""Fractions of its multiples vary what lies side by side."""


class Scalp:
    """The bare head as points to which others are laid."""

    def __init__(self, style: HeadStyle) -> None:
        angle, y = np.meshgrid(np.linspace(-np.pi, np.pi, 181)[:-1], np.linspace(-60.0, 142.0, 90))
        points, normals = position(angle, y, style), normal(angle, y, style)
        self.points, self.normals = points.reshape(-1, 3), normals.reshape(-1, 3)
        self._tree = cKDTree(self.points)

    def under(self, points: Array) -> tuple[Array, Array]:
        """(N, 3) each: the scalp below points, and its normal."""
        distance, near = (np.asarray(result) for result in self._tree.query(points, k=6))
        weight = (1 / (distance + 0.5) ** 2)[..., None]
        normals = (self.normals[near] * weight).sum(axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        foot = (self.points[near] * weight).sum(axis=1) / weight.sum(axis=1)
        below: Array = points - ((points - foot) * normals).sum(axis=1, keepdims=True) * normals
        return below, normals
