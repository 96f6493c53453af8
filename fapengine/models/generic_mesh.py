"""A generic mesh fitted to a scan, and a lip mesh between its contours: paper 004, "Face and lip mesh adaptation".

Theory of operation
-------------------
Feature contours (eyes, nose, jaw, outer lips) are known on the generic mesh and on the scan. Both are sampled at
equal fractions of their length, so that samples correspond. Samples and marker places are anchors. Their displacement
is spread over the mesh in two parts:

1. a wide field of radial functions. On one face it should be cubic, on another hardly more than an affine map: points
   that people mark on two faces differ by millimetres at random, and an exact field turns that into waves. So the field
   is the one of :data:`FIELDS` that best predicts left-out anchors, whole stretches of a contour at a time;
2. the residual at the anchors, falling off around them within :data:`REACH_MM`, as the paper's "field morphing" does,
   so that contours and markers are met.

Then :mod:`.adapted_head` lays the skin onto the scan's surface.

The lips are a mesh of their own: a third contour half way between outer and inner one, on the scan; cubic splines
across the three give rows of nodes.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, RBFInterpolator
from scipy.spatial.distance import cdist

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError
from fapengine.geometry.surface import Surface

SAMPLES = 24
"""Samples of a contour that serve as anchors."""
SAME_MM = 1.0
"""Anchors nearer to each other become one, their mean: contours have common ends, and people mark points no finer."""
REACH_MM = 10.0
"""Distance in which the narrow field falls to 1/e."""
Kernel = Literal["none", "linear", "thin_plate_spline", "cubic"]
FIELDS: tuple[tuple[Kernel, float], ...] = (
    ("none", 0.0), ("linear", 0.0), ("linear", 30.0), ("linear", 1e3), ("thin_plate_spline", 0.0),
    ("thin_plate_spline", 1e3), ("thin_plate_spline", 1e5), ("cubic", 0.0),
)  # fmt: skip
"""Radial function and smoothing of the wide fields, with an affine part; "linear" is the biharmonic of 3-D."""
STRETCH, FOLDS = 6, 8
"""Samples of a contour that are left out together, and number of parts in which all anchors are left out."""


def sample_contour(contour_mm: ArrayLike, count: int, *, closed: bool) -> Array:
    """Points at equal fractions of a polyline's length: (N, 3) mm -> (count, 3) mm.

    Parameters
    ----------
    contour_mm : (N, 3) array_like, mm
        At least 2 points; a closed one does not repeat its first.
    count : int
        At least 2.
    closed : bool
        Of a closed contour the first sample is its first point, the last one stops short of it.
    """
    points = frozen(contour_mm, "contour_mm", ("N", 3), np.float64)
    if len(points) < 2 or count < 2:
        raise UsageError(f"contour_mm: got {len(points)} points and {count} samples, expected at least 2 of each")
    if closed:
        points = np.concatenate([points, points[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if not length[-1] > 0:
        raise UsageError("contour_mm: got one point repeated, expected a line")
    at = np.linspace(0.0, length[-1], count + 1)[:-1] if closed else np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(at, length, column) for column in points.T], axis=-1)


def adapt_mesh(
    vertices_mm: ArrayLike,
    contours_mm: Sequence[tuple[ArrayLike, ArrayLike, bool]],
    markers_mm: tuple[ArrayLike, ArrayLike],
) -> Array:
    """Move a generic mesh so that its contours and markers meet those of a scanned face.

    Parameters
    ----------
    vertices_mm : (V, 3) array_like, mm
    contours_mm : sequence of (generic (N, 3), scanned (L, 3), closed)
        The same feature contours on the mesh and on the scan, in the same direction from the same start.
    markers_mm : (generic (M, 3), scanned (M, 3))
        Marker places; M may be 0.

    Returns
    -------
    (V, 3) float64, mm
    """
    vertices = frozen(vertices_mm, "vertices_mm", ("V", 3), np.float64)
    source = [frozen(markers_mm[0], "markers_mm[0]", ("M", 3), np.float64)]
    target = [frozen(markers_mm[1], "markers_mm[1]", (len(source[0]), 3), np.float64)]
    stretch = [np.arange(len(source[0]))]
    for generic, scanned, closed in contours_mm:
        source.append(sample_contour(generic, SAMPLES, closed=closed))
        target.append(sample_contour(scanned, SAMPLES, closed=closed))
        stretch.append(stretch[-1][-1:].max(initial=-1) + 1 + np.arange(SAMPLES) // STRETCH)
    anchors, goals, stretches = _merge(np.concatenate(source), np.concatenate(target), np.concatenate(stretch))
    if len(anchors) < 4 or np.linalg.matrix_rank(anchors - anchors.mean(axis=0), tol=0.01) < 3:
        raise UsageError(f"anchors: needs at least 4, not all in one plane, got {len(anchors)}")
    field = min(FIELDS, key=lambda field: _left_out_mm(field, anchors, goals, stretches % FOLDS))
    return _morph(field, anchors, goals, vertices)


def _merge(anchors: Array, goals: Array, stretches: NDArray[np.intp]) -> tuple[Array, Array, NDArray[np.intp]]:
    """Anchors close together become one, at their mean, with the mean of their goals."""
    left = np.ones(len(anchors), bool)
    groups: list[NDArray[np.intp]] = []
    for index, near in enumerate(cdist(anchors, anchors) < SAME_MM):
        if left[index]:
            groups.append(np.flatnonzero(near & left))
            left[groups[-1]] = False
    merged, aims = (np.array([places[group].mean(axis=0) for group in groups]) for places in (anchors, goals))
    return merged, aims, stretches[[group[0] for group in groups]]


def _morph(field: tuple[Kernel, float], anchors: Array, goals: Array, points: Array) -> Array:
    """Move points by a wide field, and by its residual at the anchors, falling off around them."""
    kernel, smoothing = field
    moved, left = points, goals - anchors
    if kernel != "none":
        wide = RBFInterpolator(anchors, left, kernel=kernel, degree=1, smoothing=smoothing)
        moved, left = points + wide(points), left - wide(anchors)
    return np.asarray(moved + spread(anchors, left, points, REACH_MM))


def spread(anchors: Array, values: Array, points: Array, reach_mm: float, noise: float = 0.0) -> Array:
    """Spread values of anchors, (N, C) at (N, 3) mm, over points, (P, 3) mm -> (P, C); to 1/e within ``reach_mm``.

    ``noise`` is the variance of the values' errors over that of the values: above 0 they are smoothed (kriging).
    """
    near = np.exp(-cdist(anchors, anchors) / reach_mm) + noise * np.eye(len(anchors))
    return np.asarray(np.exp(-cdist(points, anchors) / reach_mm) @ np.linalg.solve(near, values))


def _left_out_mm(field: tuple[Kernel, float], anchors: Array, goals: Array, folds: NDArray[np.intp]) -> float:
    """Mean distance of anchors from their goals, each fold moved by the others; infinite where those are in a plane."""
    misses = []
    for fold in np.unique(folds):
        out = folds == fold
        try:
            guess = _morph(field, anchors[~out], goals[~out], anchors[out])
        except (ValueError, np.linalg.LinAlgError):
            return np.inf if field[0] != "none" else float(np.linalg.norm(goals - anchors, axis=1).mean())
        misses.append(np.linalg.norm(guess - goals[out], axis=1))
    return float(np.concatenate(misses).mean())


def lip_nodes(outer_mm: ArrayLike, inner_mm: ArrayLike, scan: Surface, *, rows: int = 15) -> Array:
    """Put rows of nodes on cubic splines from an outer over a middle to an inner contour.

    Parameters
    ----------
    outer_mm, inner_mm : (N, 3) array_like, mm
        Samples that belong to each other.
    scan : Surface
        The middle contour is laid onto it.
    rows : int
        At least 2.

    Returns
    -------
    (rows, N, 3) float64
    """
    outer = frozen(outer_mm, "outer_mm", ("N", 3), np.float64)
    inner = frozen(inner_mm, "inner_mm", (len(outer), 3), np.float64)
    middle = scan.closest((outer + inner) / 2)[0]
    across = CubicSpline([0.0, 0.5, 1.0], np.stack([outer, middle, inner]), axis=0, bc_type="natural")
    return np.asarray(across(np.linspace(0.0, 1.0, rows)))


def spline_contour(points_mm: ArrayLike, corner: int, at: ArrayLike) -> Array:
    """Draw a closed contour with two corners through points, as two cubic splines.

    Parameters
    ----------
    points_mm : (N, 3) array_like, mm
        In order; the first one is a corner.
    corner : int
        Index of the other corner, 1..N-1.
    at : (K,) array_like
        Places on it, 0 to N: 2.25 is between the points 2 and 3, at a quarter of the distance.

    Returns
    -------
    (K, 3) float64, mm
    """
    points = frozen(points_mm, "points_mm", ("N", 3), np.float64)
    places = frozen(at, "at", ("K",), np.float64)
    if not 0 < corner < len(points):
        raise UsageError(f"corner: must be 1 to {len(points) - 1}, got {corner}")
    points = np.concatenate([points, points[:1]])
    drawn = np.empty((len(places), 3))
    for first, last in ((0, corner), (corner, len(points) - 1)):
        part = points[first : last + 1]
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(part, axis=0), axis=1) + 1e-9)])
        inside = (places >= first) & (places <= last)
        along = np.interp(places[inside] - first, np.arange(len(part)), length)
        drawn[inside] = CubicSpline(length, part, bc_type="natural")(along)
    return drawn
