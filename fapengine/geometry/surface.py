"""Triangle surfaces: normals, closest points, ray intersections, ambient light, averages and smooth continuation.

Candidates for the closest triangle come from a kd-tree over the triangles' centres; among them the answer is exact. On
meshes whose triangles are of similar size, as scans are, the nearest triangle is among the eight nearest centres.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, Indices, Mask, frozen
from fapengine.errors import UsageError

if TYPE_CHECKING:
    from scipy.sparse import csr_array

CANDIDATES = 8
TINY = 1e-30


class Surface:
    """A triangle mesh prepared for queries. Arrays are read-only; the kd-tree is built once.

    Parameters
    ----------
    vertices_mm : (V, 3) array_like, mm
        May contain vertices that no triangle uses.
    triangles : (F, 3) array_like of int
        Counter-clockwise seen from outside.

    Raises
    ------
    UsageError
        If there is no triangle, or a vertex index is out of range.
    """

    vertices_mm: Array
    triangles: Indices

    def __init__(self, vertices_mm: ArrayLike, triangles: ArrayLike) -> None:
        self.vertices_mm = frozen(vertices_mm, "vertices_mm", ("V", 3), np.float64)
        self.triangles = frozen(triangles, "triangles", ("F", 3), np.int64)
        count = len(self.vertices_mm)
        if not len(self.triangles) or self.triangles.min() < 0 or self.triangles.max() >= count:
            raise UsageError(f"triangles: must be one or more, with vertex indices 0 to {count - 1}")
        from scipy.spatial import cKDTree  # late: a video of FAPs loads this module and does not need it

        self._corners = self.vertices_mm[self.triangles]
        self._tree = cKDTree(self._corners.mean(axis=1))
        self.normals = vertex_normals(self.vertices_mm, self.triangles)
        """(V, 3): unit length."""
        edges, uses = np.unique(np.sort(edges_of(self.triangles), axis=1), axis=0, return_counts=True)
        self._rim = np.zeros(count, dtype=bool)
        self._rim[edges[uses == 1]] = True

    def closest(self, points_mm: ArrayLike) -> tuple[Array, Array, Mask]:
        """Find the closest points on the surface.

        Parameters
        ----------
        points_mm : (N, 3) array_like, mm

        Returns
        -------
        places_mm : (N, 3) float64
        normals : (N, 3) float64
            Interpolated between vertices, unit length.
        on_rim : (N,) bool
            The point is on the edge of a hole or of the whole surface, so it is probably not the true counterpart.
        """
        triangle, weight, places = self._nearest(frozen(points_mm, "points_mm", ("N", 3), np.float64))
        normals = unit_vectors(np.einsum("nc,nca->na", weight, self.normals[triangle]), TINY)
        on_rim: Mask = np.all((weight < 1e-9) | self._rim[triangle], axis=1)
        return places, normals, on_rim

    def carry(self, values: ArrayLike, points_mm: ArrayLike) -> Array:
        """Interpolate vertex values, such as texture coordinates, at the closest points: (V, C) -> (N, C)."""
        field = frozen(values, "values", (len(self.vertices_mm), "C"), np.float64)
        triangle, weight, _ = self._nearest(frozen(points_mm, "points_mm", ("N", 3), np.float64))
        return np.asarray(np.einsum("nc,ncd->nd", weight, field[triangle]))

    def distances_along(self, points_mm: ArrayLike) -> Array:
        """Lengths of the shortest paths along edges to every vertex, from the vertices nearest to points, (N, 3) mm.

        Returns
        -------
        (N, V) float64, mm
            Infinite where no path exists.
        """
        from scipy.sparse.csgraph import dijkstra
        from scipy.spatial import cKDTree

        vertices = self.vertices_mm
        start = np.asarray(cKDTree(vertices).query(frozen(points_mm, "points_mm", ("N", 3), np.float64))[1])
        paths = mesh_links(self.triangles, len(vertices)).tocoo()
        first, second = paths.coords
        paths.data = np.linalg.norm(vertices[first] - vertices[second], axis=1) + TINY
        return np.asarray(dijkstra(paths.tocsr(), indices=start))

    def meet(self, points_mm: ArrayLike, directions: ArrayLike, reach_mm: float) -> tuple[Array, Mask]:
        """Intersect lines through points with the surface; the hit nearest to the point counts, on either side of it.

        Parameters
        ----------
        points_mm, directions : (N, 3) array_like
        reach_mm : float
            Greatest distance between a point and its hit.

        Returns
        -------
        places_mm : (N, 3) float64
            The hit, or the point itself without one.
        met : (N,) bool
        """
        points = frozen(points_mm, "points_mm", ("N", 3), np.float64)
        along = unit_vectors(frozen(directions, "directions", (len(points), 3), np.float64), TINY)
        foot = self.closest(points)[0]
        # The nearest place guides the candidates: on a smooth surface the line meets it close by.
        guess = points + along * ((foot - points) * along).sum(axis=1, keepdims=True)
        near = np.concatenate([self._candidates(guess), self._candidates(foot)], axis=1)
        distance = _line_distance(points[:, None], along[:, None], self._corners[near])
        best = np.abs(distance).argmin(axis=1)
        nearest = distance[np.arange(len(points)), best]
        met = np.abs(nearest) <= reach_mm
        return points + np.where(met, nearest, 0.0)[:, None] * along, met

    def _nearest(self, points: Array) -> tuple[Indices, Array, Array]:
        """Corners (N, 3) of the nearest triangle, barycentric weights (N, 3) and the place (N, 3)."""
        near = self._candidates(points)
        weights = _closest_barycentric(points[:, None], self._corners[near])
        places = np.einsum("nkc,nkca->nka", weights, self._corners[near])
        best = ((places - points[:, None]) ** 2).sum(axis=-1).argmin(axis=1)
        rows = np.arange(len(points))
        return self.triangles[near[rows, best]], weights[rows, best], places[rows, best]

    def _candidates(self, points: Array) -> NDArray[np.intp]:
        count = min(CANDIDATES, len(self.triangles))
        return np.asarray(self._tree.query(points, k=count)[1], dtype=np.intp).reshape(len(points), count)


def edges_of(triangles: ArrayLike) -> Indices:
    """(3 F, 2): the edges of all triangles, (F, 3); two triangles that share an edge give it once each."""
    corners = np.asarray(triangles)
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])


def unit_vectors(vectors: NDArray[np.floating], least: float = 0.0) -> Array:
    """(..., 3): vectors scaled to length 1; those shorter than ``least`` become shorter."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), least))


def vertex_normals(vertices: NDArray[np.floating], triangles: ArrayLike) -> Array:
    """(..., V, 3) vertices -> unit normals, weighted by triangle area; (0, 0, 1) for vertices without a triangle."""
    return unit_normals(summed_normals(vertices, triangles))


def summed_normals(vertices: NDArray[np.floating], triangles: ArrayLike) -> Array:
    """(..., V, 3) vertices -> sums of the normals of their triangles, each twice as long as its area."""
    corner, places = np.asarray(triangles), np.ravel(triangles)
    a, b, c = (vertices[..., corner[:, index], :] for index in range(3))
    normals, summed = np.cross(b - a, c - a), np.zeros(vertices.shape)
    for column in np.ndindex(*vertices.shape[:-2], 3):
        one = (*column[:-1], slice(None), column[-1])
        summed[one] = np.bincount(places, np.repeat(normals[one], 3), vertices.shape[-2])
    return summed


def unit_normals(summed: Array) -> Array:
    """(..., 3): normals of length 1; (0, 0, 1) for those without a length."""
    length = np.linalg.norm(summed, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 1e-12, summed / np.maximum(length, TINY), [0.0, 0.0, 1.0]))


def _closest_barycentric(points: Array, corners: Array) -> Array:
    """Barycentric weights of the closest point: (..., 3) and (..., 3 corners, 3) -> (..., 3)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    inside = _plane_barycentric(points, corners)
    options = [inside]
    for start, stop, first, second in ((a, b, 0, 1), (b, c, 1, 2), (c, a, 2, 0)):
        edge = stop - start
        share = np.clip(((points - start) * edge).sum(-1) / ((edge**2).sum(-1) + TINY), 0.0, 1.0)
        weight = np.zeros(inside.shape)
        weight[..., first], weight[..., second] = 1.0 - share, share
        options.append(weight)
    stacked = np.stack(options, axis=-2)
    off = np.einsum("...oc,...ca->...oa", stacked, corners) - points[..., None, :]
    far = (off**2).sum(-1)
    far[..., 0] = np.where((inside >= 0).all(-1), far[..., 0], np.inf)
    best = far.argmin(-1)[..., None, None]
    return np.take_along_axis(stacked, best, axis=-2)[..., 0, :]


def _plane_barycentric(points: Array, corners: Array) -> Array:
    """Barycentric coordinates of the foot of the perpendicular in the triangle's plane; may be negative."""
    a = corners[..., 0, :]
    u, v, w = corners[..., 1, :] - a, corners[..., 2, :] - a, points - a
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    wu, wv = (w * u).sum(-1), (w * v).sum(-1)
    area = uu * vv - uv * uv + TINY
    second, third = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    return np.stack(np.broadcast_arrays(1.0 - second - third, second, third), axis=-1)


def _line_distance(points: Array, along: Array, corners: Array) -> Array:
    """Signed distance along unit lines to triangles, infinite where they miss (Möller and Trumbore 1997)."""
    a = corners[..., 0, :]
    u, v = corners[..., 1, :] - a, corners[..., 2, :] - a
    p = np.cross(along, v)
    det = (u * p).sum(-1)
    safe = np.where(np.abs(det) > TINY, det, 1.0)
    s = points - a
    q = np.cross(s, u)
    second, third = (s * p).sum(-1) / safe, (along * q).sum(-1) / safe
    hit = (np.abs(det) > TINY) & (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)
    return np.where(hit, (v * q).sum(-1) / safe, np.inf)


def sphere_directions(count: int) -> Array:
    """(count, 3): unit vectors spread evenly over a sphere, along a spiral."""
    index = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * index / count), np.pi * (1 + 5**0.5) * index
    return np.stack([np.cos(azimuth) * np.sin(polar), np.cos(polar), np.sin(azimuth) * np.sin(polar)], axis=-1)


def ambient_light(
    points_mm: Array, normals: Array, of: Indices | slice = slice(None), *, directions: int = 60, cell_mm: float = 5.0
) -> Array:
    """(N,): fraction of ambient light that reaches vertices, from depth maps in many directions.

    For each direction the vertices are sorted into the cells of a map; a vertex more than two cells behind the nearest
    one of its cell is in shadow. Cosine-weighted over the vertex's hemisphere. ``of`` are the vertices asked for, all
    by default.
    """
    normals = normals[of]
    light, total = np.zeros(len(normals)), np.zeros(len(normals))
    rays = sphere_directions(directions)
    sides = unit_vectors(np.cross(rays, [0.3, 0.8, 0.52]))
    for ray, side, up in zip(rays, sides, np.cross(rays, sides), strict=True):
        cosine = np.clip(normals @ ray, 0.0, None)
        if not cosine.any():
            continue
        cells = np.floor(np.stack([points_mm @ side, points_mm @ up]) / cell_mm).astype(np.int64)
        cells -= cells.min(axis=1, keepdims=True)
        key = cells[0] * (cells[1].max() + 1) + cells[1]
        depth = points_mm @ ray
        nearest = np.full(key.max() + 1, -np.inf)
        np.maximum.at(nearest, key, depth)
        light += cosine * (depth[of] > nearest[key[of]] - 2.0 * cell_mm)
        total += cosine
    return light / np.maximum(total, 1e-9)


def mesh_links(triangles: ArrayLike, count: int) -> "csr_array[np.float64]":
    """(V, V) sparse: number of triangles, (F, 3), at the edge between two of ``count`` vertices."""
    from scipy.sparse import csr_array

    edges = edges_of(triangles)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))


def average_over_mesh(values: Array, links: "csr_array[np.float64]", rounds: int, weight: float | Array = 0.5) -> Array:
    """(V, ...): values that move towards the mean of their neighbours in each round, by ``weight``, one or (V,).

    ``links`` are those of :func:`mesh_links`.
    """
    degree: Array = links.sum(axis=1)
    share = np.broadcast_to(weight * (degree > 0), len(values))[:, None]
    average = values.reshape(len(values), math.prod(values.shape[1:])).copy()
    moving = np.flatnonzero(share)
    links, share, degree = links[moving], share[moving], np.maximum(degree[moving], 1)[:, None]
    for _ in range(rounds):
        mean = np.asarray(links @ average)
        average[moving] += share * (mean / degree - average[moving])
    return average.reshape(values.shape)


def continue_smoothly(values: ArrayLike, known: ArrayLike, triangles: Indices) -> Array:
    """Extend values of known vertices, (V, C), over a mesh with least bending (graph bilaplacian).

    A connected part without a known vertex gets the mean value.

    Raises
    ------
    UsageError
        If no vertex is known.
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    field = frozen(values, "values", ("V", "C"), np.float64)
    mask = np.asarray(known, dtype=bool)
    if not mask.any():
        raise UsageError("known: contains no vertex")
    if mask.all():
        return field.copy()
    links = mesh_links(triangles, len(field))
    links.data[:] = 1.0
    degree: Array = links.sum(axis=1)
    laplacian = diags_array((degree > 0).astype(float)) - diags_array(1.0 / np.maximum(degree, 1.0)) @ links
    # A trace of pull to the mean keeps parts without a known vertex solvable.
    mean = field[mask].mean(axis=0)
    free = np.flatnonzero(~mask)
    energy = (laplacian.T @ laplacian + 1e-9 * diags_array(np.ones(len(field)))).tocsr()
    right = -(energy[free] @ np.where(mask[:, None], field - mean, 0.0))
    result = field.copy()
    result[free] = mean + splu(energy[free][:, free].tocsc()).solve(np.ascontiguousarray(right))
    return result
