"""Dense modes from sparse ones: paper 003 (Berger, Ponroy, Wrobel-Dautcourt), section 4.

Theory of operation
-------------------
1. Each scanned posture gets the weights ``z`` of the sparse model that lays itself onto it (:mod:`.scans`).
2. The scans get common vertices. A vertex M of the reference scan belongs to a facet ABC of the sparse mesh: its foot
   H has coordinates (a, b, c) there, and HM runs along ``a Na + b Nb + c Nc``. In another posture the same
   coordinates and normals give another line; M' is where it meets that scan. Lips that touch are near through the air
   and far along the skin: a facet counts as farther by the detour that the way along the scan takes to its corners.
3. Where the line meets nothing (holes, the inside of the lips, outside of the markers) the vertex follows its
   neighbours on the reference mesh: their displacement is continued as smoothly as the mesh allows. The mesh is slit
   at the mouth, so upper and lower lip are continued apart.
4. ``X_i = mean + sum_k z_ik u_k`` over the postures i (equation 3) is solved by least squares for mean and modes.
   Fifteen postures hardly determine eight unknowns, hence a ridge on the modes, never on the mean; its size minimises
   the error of each posture predicted from the others.

From a few markers to a dense face, linearly: paper 004 (Kuratate, Yehia, Vatikiotis-Bateson), equations 1 to 15.
``F`` holds S faces as columns, ``P`` their markers, both without their means. The left singular vectors ``U`` of
``F`` are the modes; ``a = U^T F`` are the faces' coefficients (equation 7). ``a = A P`` is solved for ``A`` by least
squares and a new face is ``mean + U A (p - mean p)`` (equation 15).

Equation 12, ``A = a P^T (P P^T)^-1``, cannot be computed from eight scans: ``P P^T`` is 54 x 54 and of rank 7
(computed all the same, it answers 53 mm off, without an exception). Of all ``A`` that satisfy ``A P = a`` the pseudo-
inverse is the shortest: marker motion that no scan has shown moves nothing. Markers with noise, or from another
instrument than the scans, need more: with ``noise_mm`` the estimator is ``A = a P^T (P P^T + S noise^2
I)^-1``, the minimum of the expected error, which trusts a direction by how far the scans moved in it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay
from scipy.spatial.distance import cdist

from fapengine._arrays import Array, Indices, Mask, freeze, frozen
from fapengine.errors import DataError, UsageError
from fapengine.geometry.surface import Surface, continue_smoothly, unit_vectors, vertex_normals
from fapengine.models.viseme_space import signs

NEAR_FACETS = 12
OUTSIDE = 0.5
"""Distance outside of its facet, in barycentric units, at which a vertex is still bound to it."""
AROUND, FAR_MM = 1.3, 100.0
"""Ratio of the ways along the edges and through the air above which the rest is a detour, and the largest detour."""
BLOCK = 4096
"""Vertices that are compared with all facets at once."""
DETOUR = 0.05
"""Cost of a detour of 1 mm, in barycentric units outside of a facet."""
RIDGES = (0.0, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
THINNEST = 0.02
"""Height of a facet over its longest edge, as a fraction of it; thinner ones are on the outline and have no
direction."""
MAX_STRETCH, MAX_EDGE_MM = 2.0, 45.0
"""Largest ratio of an edge's lengths in two postures, and largest length of an edge."""
REACH_MM = 4.0
"""Largest distance of a scan from where the height of the reference puts a vertex."""
NEWTON_STEPS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Binding:
    """Vertices tied to facets of a sparse mesh. Arrays are read-only."""

    facets: Indices
    """(V, 3): markers of each vertex's facet."""
    weights: Array
    """(V, 3): a, b, c; they add up to 1."""
    height_mm: Array
    """(V,): from the foot to the vertex, along the unit normal there."""
    bound: Mask
    """(V,): false for a vertex too far outside of every facet."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, facets=("V", 3))
        freeze(self, weights=(len(self.facets), 3), height_mm=(len(self.facets),))
        freeze(self, np.bool_, bound=(len(self.facets),))

    def lines(self, points_mm: Array, triangles: ArrayLike) -> tuple[Array, Array]:
        """Feet (V, 3) and unit directions (V, 3) in another posture of the sparse mesh, markers at (M, 3)."""
        normals = vertex_normals(points_mm, triangles)
        feet, directions = (np.einsum("vc,vca->va", self.weights, at[self.facets]) for at in (points_mm, normals))
        return feet, unit_vectors(directions)


@dataclass(frozen=True, slots=True, eq=False)
class DenseModes:
    """Mean and modes of all vertices, driven by the sparse model's weights. Arrays are read-only."""

    mean_mm: Array
    """(V, 3)."""
    modes_mm: Array
    """(K, V, 3), mm per standard deviation of the sparse weight."""
    ridge: float
    """Ridge that was chosen, in squared weights."""
    left_out_mm: float
    """Mean square root of the squared distance of a vertex, each posture predicted from the others."""

    def __post_init__(self) -> None:
        freeze(self, mean_mm=("V", 3), modes_mm=("K", "V", 3))

    def faces_mm(self, scores: ArrayLike) -> Array:
        """Equation 3: (..., K) -> (..., V, 3)."""
        z = frozen(scores, "scores", ("...", len(self.modes_mm)), np.float64)
        return self.mean_mm + np.tensordot(z, self.modes_mm, axes=1)


def sparse_facets(postures_mm: ArrayLike) -> Indices:
    """Triangles between markers that move together: (P, M, 3) postures -> (F, 3), counter-clockwise seen from +z.

    A Delaunay triangulation of the mean posture, unrolled about the vertical axis. An edge whose length changes by a
    factor of more than :data:`MAX_STRETCH` between postures, or exceeds :data:`MAX_EDGE_MM`, bridges an opening such as
    the mouth: its triangles are left out.
    """
    postures = frozen(postures_mm, "postures_mm", ("P", "M", 3), np.float64)
    mean = postures.mean(axis=0)
    axis = mean[:, 2].min() - np.ptp(mean[:, 0]) / 4
    radius = np.hypot(mean[:, 0], mean[:, 2] - axis).mean()
    unrolled = np.stack([radius * np.arctan2(mean[:, 0], mean[:, 2] - axis), mean[:, 1]], axis=1)
    triangles = Delaunay(unrolled).simplices.astype(np.int64)
    a, b, c = (unrolled[triangles[:, index]] for index in range(3))
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    corners = postures[:, triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=2), axis=-1)  # (P, F, 3)
    good = (edges.max(axis=0) <= MAX_STRETCH * edges.min(axis=0)) & (edges.max(axis=0) <= MAX_EDGE_MM)
    flat = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    slender = np.linalg.norm(flat, axis=-1) < THINNEST * edges.max(axis=-1) ** 2
    kept: Indices = triangles[good.all(axis=1) & ~slender.any(axis=0)]
    if not len(kept):
        raise DataError(f"markers: none of {len(triangles)} facets stays together")
    return kept


def bind(reference: Surface, points_mm: ArrayLike, triangles: ArrayLike) -> Binding:
    """Find facet, coordinates and height of each vertex of the reference scan (step 2).

    Parameters
    ----------
    reference : Surface
        V vertices.
    points_mm : (M, 3) array_like, mm
        The sparse mesh in the reference posture.
    triangles : (F, 3) array_like of int
        From :func:`sparse_facets`.
    """
    vertices = reference.vertices_mm
    points = frozen(points_mm, "points_mm", ("M", 3), np.float64)
    corner = frozen(triangles, "triangles", ("F", 3), np.int64)
    normals = vertex_normals(points, corner)
    count = min(NEAR_FACETS, len(corner))
    along = reference.distances_along(points).T
    near, detour = np.empty((len(vertices), count), np.int64), np.empty((len(vertices), count))
    for rows in np.array_split(np.arange(len(vertices)), len(vertices) // BLOCK + 1):
        away = np.clip(along[rows] - AROUND * cdist(vertices[rows], points), 0.0, FAR_MM)[:, corner].max(axis=2)
        far = cdist(vertices[rows], points[corner].mean(axis=1)) + away
        near[rows] = np.argpartition(far, count - 1, axis=1)[:, :count]
        detour[rows] = np.take_along_axis(away, near[rows], axis=1)
    facets = corner[near]  # (V, N, 3)
    weights, height, off = _coordinates(vertices[:, None], points[facets], normals[facets])
    outside = np.maximum(-weights.min(axis=-1), 0.0)
    cost = np.where(off < 1e-6, outside + 1e-3 * np.abs(height), np.inf)
    cost += DETOUR * detour
    best = cost.argmin(axis=1)
    rows = np.arange(len(vertices))
    bound = outside[rows, best] <= OUTSIDE
    bound &= np.isfinite(cost[rows, best])
    weight = np.where(bound[:, None], weights[rows, best], 1 / 3)
    return Binding(facets[rows, best], weight, np.where(bound, height[rows, best], 0.0), bound)


def remesh(
    binding: Binding, reference: Surface, scan: Surface, points_mm: ArrayLike, triangles: ArrayLike
) -> tuple[Array, Mask]:
    """Find the reference's vertices on a scan (steps 2 and 3).

    Parameters
    ----------
    binding : Binding
        Of ``reference``'s vertices.
    reference, scan : Surface
        In one space: lay the scan into the model's first (:attr:`.scans.ScanFit.scan_from_model`).
    points_mm : (M, 3) array_like, mm
        The sparse mesh, fitted to ``scan``.
    triangles : (F, 3) array_like of int
        Facets of the sparse mesh.

    Returns
    -------
    vertices_mm : (V, 3) float64
    met : (V,) bool
        The line met the scan; the others were continued from their neighbours.
    """
    feet, directions = binding.lines(frozen(points_mm, "points_mm", ("M", 3), np.float64), triangles)
    guess = feet + binding.height_mm[:, None] * directions
    places, met = scan.meet(guess, directions, REACH_MM)
    met &= binding.bound
    if met.sum() < 0.1 * max(binding.bound.sum(), 1):
        raise DataError(f"scan: only {met.sum()} of {binding.bound.sum()} vertices are on it, requires a tenth")
    return reference.vertices_mm + continue_smoothly(places - reference.vertices_mm, met, reference.triangles), met


def fit_dense_modes(faces_mm: ArrayLike, scores: ArrayLike) -> DenseModes:
    """Solve equation 3 for mean and modes, with the one of :data:`RIDGES` that predicts left-out postures best.

    Parameters
    ----------
    faces_mm : (P, V, 3) array_like, mm
        Postures with common vertices.
    scores : (P, K) array_like
        Weights of the sparse model in each.
    """
    faces = frozen(faces_mm, "faces_mm", ("P", "V", 3), np.float64)
    z = frozen(scores, "scores", (len(faces), "K"), np.float64)
    if len(faces) < 2:
        raise UsageError(f"faces_mm: needs at least 2 postures, got {len(faces)}")
    flat = faces.reshape(len(faces), -1)
    centre = flat.mean(axis=0)
    off = flat - centre
    design = np.concatenate([z, np.ones((len(z), 1))], axis=1)
    products = off @ off.T
    error, chosen = min((_left_out(design, products, ridge), ridge) for ridge in RIDGES)
    solved = _solver(design, chosen) @ off
    modes = solved[:-1].reshape(z.shape[1], -1, 3)
    mean = (solved[-1] + centre).reshape(-1, 3)
    return DenseModes(mean, modes, chosen, float(np.sqrt(error / (len(faces) * faces.shape[1]))))


def _solver(design: Array, ridge: float) -> Array:
    """(K + 1, P): postures to parameters; the last row, the mean, is not shrunk."""
    square = design.T @ design
    square[range(len(square) - 1), range(len(square) - 1)] += ridge
    return np.asarray(np.linalg.pinv(square, rcond=1e-10, hermitian=True) @ design.T)


def _left_out(design: Array, products: Array, ridge: float) -> float:
    """Sum of squared errors of each posture predicted from the others; from the P x P products alone (PRESS)."""
    hat = design @ _solver(design, ridge)
    stay = np.eye(len(hat)) - hat
    left = np.maximum(np.diag(stay @ products @ stay.T), 0.0)
    free = 1.0 - np.diag(hat)
    return float((left / np.maximum(free, 1e-12) ** 2).sum()) if (free > 1e-6).all() else np.inf


def _coordinates(vertices: Array, corners: Array, normals: Array) -> tuple[Array, Array, Array]:
    """Solve ``foot(a, b, c) + height * unit(normal(a, b, c)) = vertex`` by Newton: weights, height, residual."""
    shape = np.broadcast_shapes(vertices.shape[:-1], corners.shape[:-2])
    first = corners[..., 0, :]
    u, v = corners[..., 1, :] - first, corners[..., 2, :] - first
    flat = unit_vectors(np.cross(u, v))
    start = np.linalg.solve(np.stack([u, v, flat], axis=-1), (vertices - first)[..., None])[..., 0]
    unknown = np.broadcast_to(start, (*shape, 3)).copy()  # b, c, height
    slope = np.stack([normals[..., 1, :] - normals[..., 0, :], normals[..., 2, :] - normals[..., 0, :]], axis=-1)
    for _ in range(NEWTON_STEPS):
        b, c, height = np.moveaxis(unknown, -1, 0)[..., None]
        raw = normals[..., 0, :] + b * slope[..., 0] + c * slope[..., 1]
        length = np.maximum(np.linalg.norm(raw, axis=-1, keepdims=True), 1e-9)
        unit = raw / length
        left = first + b * u + c * v + height * unit - vertices
        bend = (slope - unit[..., None] * (unit[..., None, :] @ slope)) / length[..., None]
        jacobian = np.concatenate([np.stack([u, v], axis=-1) + height[..., None] * bend, unit[..., None]], axis=-1)
        jacobian += 1e-12 * np.eye(3)
        unknown -= np.clip(np.linalg.solve(jacobian, left[..., None])[..., 0], -50, 50)
    b, c, height = np.moveaxis(unknown, -1, 0)
    off = np.linalg.norm(left, axis=-1)
    return np.stack([1 - b - c, b, c], axis=-1), height, np.where(np.isfinite(off), off, np.inf)


RANK_TOLERANCE = 1e-9
"""Singular values below this fraction of the largest are rounding."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinearEstimator:
    """Markers to modes to faces. Arrays are read-only."""

    mean_markers_mm: Array
    """(M, 3)."""
    mean_face_mm: Array
    """(V, 3)."""
    modes: Array
    """(K, V, 3): orthonormal rows ``U^T``; in each the entry of largest magnitude is positive."""
    variances: Array
    """(K,), mm^2: of the training faces along each mode, falling."""
    matrix: Array
    """(K, 3M): ``A``, mm of a mode for each mm of a marker coordinate."""

    def __post_init__(self) -> None:
        freeze(self, mean_markers_mm=("M", 3), mean_face_mm=("V", 3), variances=("K",), modes=("K", "V", 3))
        freeze(self, matrix=(len(self.variances), self.mean_markers_mm.size))

    def coefficients(self, markers_mm: ArrayLike) -> Array:
        """Equation 11: (..., M, 3) mm -> (..., K) mm."""
        markers = frozen(markers_mm, "markers_mm", ("...", len(self.mean_markers_mm), 3), np.float64)
        off = (markers - self.mean_markers_mm).reshape(*markers.shape[:-2], -1)
        return np.asarray(off @ self.matrix.T)

    def faces_mm(self, markers_mm: ArrayLike) -> Array:
        """Equation 15: (..., M, 3) mm -> (..., V, 3) mm."""
        return self.mean_face_mm + np.tensordot(self.coefficients(markers_mm), self.modes, axes=1)


def fit_estimator(scans_mm: ArrayLike, markers_mm: ArrayLike, *, noise_mm: float = 0.0) -> LinearEstimator:
    """Learn from a few scans, as the paper does; K is what they span, at most S - 1.

    Parameters
    ----------
    scans_mm : (S, V, 3) array_like, mm
        At least 2 faces, vertices in correspondence, head motion removed.
    markers_mm : (S, M, 3) array_like, mm
        Marker places in the same postures: vertices of the scans, or better the recording's own markers.
    noise_mm : float
        Standard deviation of a marker coordinate against the scans; see the theory of operation.
    """
    scans = frozen(scans_mm, "scans_mm", ("S", "V", 3), np.float64)
    markers = frozen(markers_mm, "markers_mm", (len(scans), "M", 3), np.float64)
    if len(scans) < 2:
        raise UsageError(f"scans_mm: needs at least 2 scans, got {len(scans)}")
    if not noise_mm >= 0:
        raise UsageError(f"noise_mm: must be 0 or more, got {noise_mm}")
    mean_face, mean_markers = scans.mean(axis=0), markers.mean(axis=0)
    left, lengths, rows = np.linalg.svd((scans - mean_face).reshape(len(scans), -1), full_matrices=False)
    if not lengths[0] > 0:
        raise DataError("scans: all are the same face, requires different postures")
    count = int((lengths > RANK_TOLERANCE * lengths[0]).sum())
    coefficients = (left * lengths)[:, :count]
    matrix = _solve((markers - mean_markers).reshape(len(scans), -1), coefficients, noise_mm)
    sign = signs(rows[:count])[:, None]
    return LinearEstimator(
        mean_markers_mm=mean_markers,
        mean_face_mm=mean_face,
        modes=(sign * rows[:count]).reshape(count, -1, 3),
        variances=lengths[:count] ** 2 / len(scans),
        matrix=sign * matrix,
    )


def _solve(p: Array, a: Array, noise_mm: float) -> Array:
    """(S, 3M) markers and (S, K) coefficients, both centred -> (K, 3M)."""
    left, lengths, right = np.linalg.svd(p, full_matrices=False)
    kept = lengths > RANK_TOLERANCE * max(lengths[0], np.finfo(float).tiny)
    gain = lengths[kept] / (lengths[kept] ** 2 + len(p) * noise_mm**2)
    return np.asarray((a.T @ left[:, kept] * gain) @ right[kept], dtype=np.float64)
