"""A mesh aligned with the standard's face by its feature points (rotation, translation, scale).

After this the units and axes of the file do not matter, and cameras and shading fit. Vertices at one position form one
node; connected nodes form one part. Geometry far below the chin or beside the face is removed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fapengine._arrays import Array, Indices
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import fit_rigid
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

NEEDED_POINTS = ("8.1", "8.2", "8.3", "8.4", "2.1")
"""Feature points that every face needs: the outer lips and the chin."""
MIN_POINTS = 8
LEFT_TO_RIGHT = (("3.7", "3.11"), ("3.8", "3.12"), ("4.5", "4.1"), ("4.2", "4.6"))
"""Corners of each eye and ends of each brow, the one to the subject's left first: of the right eye it is the inner."""
MAX_MIRROR_RATIO = 0.6
"""Residual of the mirrored face, relative to the face itself, below which left and right are exchanged."""
NODE_SIZE_MM = 1e-3
"""Edge of the cells that vertices of one node share."""
MIN_NODE_COSINE = 0.3
"""Cosine between the normals of vertices at one position, below which they are two nodes: lips or lids that touch."""
MIN_EXTENT = 1e-9
KEPT_BELOW_CHIN_MM = 190.0
"""Height kept below the chin: neck and shoulders."""
KEPT_BESIDE_MM = 320.0
"""Half width kept, from the middle line."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlacedMesh:
    """The kept part of a mesh, in head space."""

    source: BlendshapeMesh
    vertices_mm: Array
    """(V, 3) mm, head space."""
    triangles: Indices
    """(F, 3)."""
    kept: Indices
    """(V,): index of the vertex in the source."""
    points: Mapping[str, int]
    """Vertices by feature point."""
    scale: float
    """Millimetres of the standard's face for one unit of the source."""
    rotation: Array
    """(3, 3): axes of the source to those of head space."""
    node: Indices
    """(V,): node of each vertex; copies along a seam share one."""
    part: Indices
    """(V,): connected part of each vertex."""

    @property
    def positions(self) -> dict[str, Array]:
        """Position of each feature point, (3,) mm."""
        return {name: self.vertices_mm[index] for name, index in self.points.items()}

    @property
    def skin(self) -> Indices:
        """(S,): vertices of the part with the lips."""
        return np.flatnonzero(self.part == self.skin_part)

    @property
    def skin_part(self) -> int:
        """Number of the part with the lips."""
        return int(self.part[self.points["8.1"]])

    @property
    def mouth_line_mm(self) -> float:
        """Height of the line between the lips."""
        upper, lower = (self.vertices_mm[self.points[name]] for name in ("8.1", "8.2"))
        return float((upper[1] + lower[1]) / 2)

    @property
    def nodes_mm(self) -> Array:
        """(nodes, 3) mm: position of each node."""
        positions = np.zeros((self.node.max() + 1, 3))
        positions[self.node] = self.vertices_mm
        return positions

    def turned(self, moves: Array) -> Array:
        """(..., 3) mm: displacements of the source, (..., 3), in head space."""
        return np.asarray(self.scale * moves @ self.rotation.T)

    def to_head_space(self, position: Array) -> Array:
        """(3,) mm: a position of the source, (3,), in head space."""
        arm = position - self.source.vertices[self.kept[0]]
        return self.vertices_mm[0] + self.scale * arm @ self.rotation.T


def place_mesh(mesh: BlendshapeMesh, points: Mapping[str, int], standard: FaceMesh) -> PlacedMesh:
    """Align a mesh with the standard's face and remove geometry far from it.

    Parameters
    ----------
    mesh : BlendshapeMesh
    points : mapping of str to int
        Vertex of each known feature point.
    standard : FaceMesh
        Defines scale and axes.

    Raises
    ------
    DataError
        If too few points are known, two share a vertex, one is not a vertex or far from the face, or left and right are
        exchanged, of the face or of an eye or a brow.
    """
    check_points(points, mesh)
    placed, scale, rotation = _fit(mesh.vertices, points, standard)
    for left, right in LEFT_TO_RIGHT:
        if {left, right} <= points.keys() and placed[points[left], 0] < placed[points[right], 0]:
            raise DataError(
                f"feature points: {left} and {right} are exchanged; {left} is further to the subject's left"
            )
    return cut_out(mesh, placed, points, placed[points["2.1"]], scale, rotation)


def cut_out(
    mesh: BlendshapeMesh,
    placed: Array,
    points: Mapping[str, int],
    chin: NDArray[np.floating],
    scale: float,
    rotation: Array,
) -> PlacedMesh:
    """Keep what is near the chin, (3,) mm, of a mesh whose vertices are at ``placed``, (V, 3) mm.

    Raises
    ------
    DataError
        If a needed point is far from the face.
    """
    inside = (placed[:, 1] > chin[1] - KEPT_BELOW_CHIN_MM) & (np.abs(placed[:, 0] - chin[0]) < KEPT_BESIDE_MM)
    kept, corners = np.unique(mesh.triangles[inside[mesh.triangles].all(axis=1)], return_inverse=True)
    index = {vertex: number for number, vertex in enumerate(kept.tolist())}
    lost = sorted(name for name, vertex in points.items() if vertex not in index)
    if set(lost) & set(NEEDED_POINTS):
        raise DataError(f"feature points: got {', '.join(lost)} far from the face")
    vertices, triangles = placed[kept], corners.reshape(-1, 3).astype(np.int64)
    node, part = find_parts(vertices, triangles)
    inner = {name: index[vertex] for name, vertex in points.items() if vertex in index}
    return PlacedMesh(
        source=mesh, vertices_mm=vertices, triangles=triangles, kept=kept.astype(np.int64),
        points=inner, scale=scale, rotation=rotation, node=node, part=part,
    )  # fmt: skip


def check_points(points: Mapping[str, int], mesh: BlendshapeMesh) -> None:
    """Reject too few points, points that share a vertex, and vertices without a triangle.

    Raises
    ------
    DataError
        For the first of these.
    """
    missing = [name for name in NEEDED_POINTS if name not in points]
    if missing or len(points) < MIN_POINTS:
        raise DataError(
            f"feature points: got {len(points)} ({', '.join(sorted(points))}), expected at least {MIN_POINTS} with"
            f" {', '.join(NEEDED_POINTS)} among them"
        )
    if not len(mesh.triangles):
        raise DataError("triangles: got 0, expected at least one")
    count = len(mesh.vertices)
    names: dict[int, str] = {}
    for name, vertex in points.items():
        if not 0 <= vertex < count or not (mesh.triangles == vertex).any():
            raise DataError(f"feature point {name}: got vertex {vertex}, expected one of a triangle, 0 to {count - 1}")
        if vertex in names:
            raise DataError(f"feature points {names[vertex]} and {name}: got one vertex for both, {vertex}")
        names[vertex] = name


def _fit(vertices: Array, points: Mapping[str, int], standard: FaceMesh) -> tuple[Array, float, Array]:
    """(V, 3) mm vertices aligned with the standard's face, mm for one unit, and the rotation, (3, 3)."""
    common = [name for name in points if name in standard.feature_points]
    ours = vertices[[points[name] for name in common]]
    theirs = np.stack([standard.point_mm(name) for name in common]).astype(np.float64)
    centre, goal = ours.mean(axis=0), theirs.mean(axis=0)
    ours, theirs = ours - centre, theirs - goal
    size = float(np.sqrt((ours**2).sum()))
    if not size > MIN_EXTENT:
        raise DataError(f"feature points: got all within {size:.3g} units, expected a face")
    scale = float(np.sqrt((theirs**2).sum())) / size

    def residual(face: Array) -> tuple[Array, float]:
        try:
            motion = fit_rigid(scale * face, theirs)
        except UsageError as error:
            raise DataError(f"feature points: {error}") from error
        return motion.rotation, float(np.linalg.norm(motion.apply(scale * face) - theirs))

    rotation, off_mm = residual(ours)
    if residual(ours * [-1.0, 1.0, 1.0])[1] < MAX_MIRROR_RATIO * off_mm:
        raise DataError("feature points: left and right are exchanged (left is the subject's)")
    return scale * (vertices - centre) @ rotation.T + goal, scale, rotation


def find_parts(vertices_mm: Array, triangles: Indices) -> tuple[Indices, Indices]:
    """Merge vertices at one position into nodes, and nodes into connected parts.

    Copies along a seam are one node; lips or lids that touch are not, because they face each other. Takes vertices, (V,
    3) mm, and triangles, (F, 3); returns the node and the part of each vertex, (V,) int64 each.
    """
    _, first, cell = np.unique(
        np.round(vertices_mm / NODE_SIZE_MM).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    normals = vertex_normals(vertices_mm, triangles)
    faces_away = (normals * normals[first[cell.ravel()]]).sum(axis=1) < MIN_NODE_COSINE
    node = np.unique(2 * cell.ravel() + faces_away, return_inverse=True)[1].ravel()
    corners = node[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    count = int(node.max()) + 1
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return node, connected_components(links, directed=False)[1][node].astype(np.int64)
