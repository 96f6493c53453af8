"""A generic mesh fitted to a scan, and a lip mesh between its contours: paper 004, "Face and lip mesh adaptation".

Theory of operation
-------------------
Feature contours (eyes, nose, jaw, outer lips) are known on the generic mesh and on the scan. Both are sampled at
equal shares of their length, so that samples correspond. Samples and marker places are anchors; the displacement that
they need is spread over the whole mesh by cubic radial functions, the field of the paper's "field morphing" without
its falloff to tune: it is exact at the anchors and, having the least curvature of all that are, quiet between them.
Then the vertices, anchors excepted, are laid onto the scan's surface.

The lips are a mesh of their own: a third contour half way between outer and inner one, on the scan; cubic splines
across the three give rows of nodes.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, RBFInterpolator

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.geometry.surface import Surface

SAMPLES = 24
"""Samples of a contour that serve as anchors."""
SAME_MM = 0.01
"""Anchors nearer to each other are one: contours share their ends."""


def sample_contour(contour_mm: ArrayLike, count: int, *, closed: bool) -> NDArray[np.float64]:
    """Points at equal shares of a polyline's length: (N, 3) mm -> (count, 3) mm.

    Parameters
    ----------
    contour_mm : (N, 3) array_like, mm
        At least 2 points; a closed one does not repeat its first.
    count : int
        At least 2.
    closed : bool
        Of a closed contour the first sample is its first point, the last one stops short of it.

    Raises
    ------
    UsageError
        If there are too few points or samples, or the contour has no length.
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
    scan: Surface | None = None,
    *,
    reach_mm: float = 5.0,
) -> NDArray[np.float64]:
    """Fit a generic mesh to a scanned face.

    Parameters
    ----------
    vertices_mm : (V, 3) array_like, mm
    contours_mm : sequence of (generic (N, 3), scanned (L, 3), closed)
        The same feature contours on the mesh and on the scan, running the same way from the same start.
    markers_mm : (generic (M, 3), scanned (M, 3))
        Marker places; M may be 0.
    scan : Surface, optional
        Vertices are laid onto it where it is within ``reach_mm`` and not at the rim of a hole.

    Returns
    -------
    (V, 3) float64, mm

    Raises
    ------
    UsageError
        If the anchors are fewer than 4 or lie in one plane, or shapes differ.
    """
    vertices = frozen(vertices_mm, "vertices_mm", ("V", 3), np.float64)
    source = [frozen(markers_mm[0], "markers_mm[0]", ("M", 3), np.float64)]
    target = [frozen(markers_mm[1], "markers_mm[1]", (len(source[0]), 3), np.float64)]
    for generic, scanned, closed in contours_mm:
        source.append(sample_contour(generic, SAMPLES, closed=closed))
        target.append(sample_contour(scanned, SAMPLES, closed=closed))
    anchors, goals = np.concatenate(source), np.concatenate(target)
    _, kept = np.unique(np.round(anchors / SAME_MM), axis=0, return_index=True)
    anchors, goals = anchors[kept], goals[kept]
    if len(anchors) < 4 or np.linalg.matrix_rank(anchors - anchors.mean(axis=0), tol=SAME_MM) < 3:
        raise UsageError(f"anchors: got {len(anchors)}, expected at least 4, not all in one plane")
    field = RBFInterpolator(anchors, goals - anchors, kernel="cubic", degree=1)
    moved: NDArray[np.float64] = vertices + field(vertices)
    if scan is None:
        return moved
    places, _, on_rim = scan.closest(moved)
    anchored = np.linalg.norm(vertices[:, None] - anchors, axis=-1).min(axis=1) < SAME_MM
    lay = ~on_rim & ~anchored & (np.linalg.norm(places - moved, axis=1) <= reach_mm)
    moved[lay] = places[lay]
    return moved


def lip_mesh(
    outer_mm: ArrayLike, inner_mm: ArrayLike, scan: Surface | None = None, *, count: int = 40, rows: int = 15
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Fill the lips between their contours.

    Parameters
    ----------
    outer_mm, inner_mm : (N, 3) array_like, mm
        Closed, counter-clockwise seen from +z, both from the same corner of the mouth.
    scan : Surface, optional
        The middle contour is laid onto it; without it the lips are flat across.
    count, rows : int
        Nodes around and across; the paper's 600 nodes are 40 x 15.

    Returns
    -------
    vertices_mm : (rows * count, 3) float64
        Row by row, the outer contour first.
    triangles : (2 * (rows - 1) * count, 3) int64
        Counter-clockwise seen from +z.

    Raises
    ------
    UsageError
        If ``count`` or ``rows`` is below 3, or a contour is none.
    """
    if count < 3 or rows < 3:
        raise UsageError(f"count, rows: got {count} and {rows}, expected at least 3")
    outer = sample_contour(outer_mm, count, closed=True)
    inner = sample_contour(inner_mm, count, closed=True)
    middle = (outer + inner) / 2
    if scan is not None:
        middle = scan.closest(middle)[0]
    across = CubicSpline([0.0, 0.5, 1.0], np.stack([outer, middle, inner]), axis=0, bc_type="natural")
    vertices = across(np.linspace(0.0, 1.0, rows)).reshape(-1, 3)
    at = np.arange(rows * count).reshape(rows, count)
    here, ahead = at, np.roll(at, -1, axis=1)
    quads = np.stack([here[:-1], ahead[:-1], ahead[1:], here[1:]], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
