"""Which part of the face each primary marker moves, and which way: paper 000, section 4, figure 4.

A subset's weights are known at markers; between them they are interpolated over the face by cubic radial functions. The
region of a primary marker is where its weight is notable; a negative subregion moves against it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import Delaunay

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.models.subset import MarkerSubset

SAME_PLACE_DIGITS = 3
"""Digits of a millimetre to which markers at one place agree, such as those of lips that are shut."""


@dataclass(frozen=True, slots=True, eq=False)
class KinematicRegions:
    """Weights of k primary markers at N points of the face. Arrays are read-only."""

    weights: NDArray[np.float64]
    """(k, N)."""
    inside: NDArray[np.bool_]
    """(N,): within the hull of the markers; beyond it the weights are a guess."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", frozen(self.weights, "weights", ("k", "N"), np.float64))
        object.__setattr__(self, "inside", frozen(self.inside, "inside", (self.weights.shape[1],), np.bool_))

    def signs(self, notable: float = 0.1) -> NDArray[np.int8]:
        """(k, N): +1 moves with the primary marker, -1 against it, 0 hardly (below ``notable``) or outside."""
        signs = np.where(np.abs(self.weights) >= notable, np.sign(self.weights), 0) * self.inside
        return signs.astype(np.int8)

    def displace(self, primary_mm: ArrayLike) -> NDArray[np.float64]:
        """Motion of the N points: displacements (..., k, 3) mm of the primary markers -> (..., N, 3) mm (section 5)."""
        driven = frozen(primary_mm, "primary_mm", ("...", len(self.weights), 3), np.float64)
        moved: NDArray[np.float64] = self.weights.T @ driven
        return moved


def interpolate_regions(subset: MarkerSubset, markers_mm: ArrayLike, points_mm: ArrayLike) -> KinematicRegions:
    """Extend a subset's weights to any points of the face.

    Parameters
    ----------
    subset : MarkerSubset
    markers_mm : (M, 3) array_like, mm
        All markers in the neutral pose; +z points out of the face. Those at one place count by their mean weights.
    points_mm : (N, 3) array_like, mm
        Interpolation is over the frontal plane (x, y), as in the paper's figure.

    Raises
    ------
    UsageError
        If there are other than M markers, or fewer than 4 places.

    Notes
    -----
    Cubic, degree 1, no smoothing: on a test with known weights it was nearest to the truth (0.43 mm against 0.41 for
    the weights themselves, 0.55 linear), and unlike Clough-Tocher it answers outside of the hull.
    """
    count = subset.weights.shape[1]
    markers = frozen(markers_mm, "markers_mm", (count, 3), np.float64)
    points = frozen(points_mm, "points_mm", ("N", 3), np.float64)
    _, first, at = np.unique(markers[:, :2].round(SAME_PLACE_DIGITS), axis=0, return_index=True, return_inverse=True)
    flat = markers[first, :2]
    if len(flat) < 4:
        raise UsageError(f"markers_mm: got {count} markers at {len(flat)} places, expected at least 4")
    own = np.zeros((len(flat), len(subset.weights)))
    np.add.at(own, at, subset.weights.T)
    own /= np.bincount(at)[:, None]
    weights = RBFInterpolator(flat, own, kernel="cubic", degree=1)(points[:, :2])
    return KinematicRegions(weights.T, Delaunay(flat).find_simplex(points[:, :2]) >= 0)
