"""A head with more vertices, for measuring: its longest edges are halved until there are enough.

Theory of operation
-------------------
A round halves the marked edges of all triangles at once, so that neighbours stay joined. Every new vertex is the mean
of two old ones: one sparse matrix carries positions, colours and displacements alike. The surface does not get
smoother; only its cost grows. The product's own levels of detail have other numbers of vertices than the papers.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh

# Corners 0, 1, 2; middles of the edges 01, 12, 20 are 3, 4, 5. Row: which edges are halved, as bits 1, 2, 4.
PATTERNS = (
    ((0, 1, 2),),
    ((0, 3, 2), (3, 1, 2)),
    ((0, 1, 4), (0, 4, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((0, 1, 5), (5, 1, 2)),
    ((0, 3, 5), (3, 1, 2), (3, 2, 5)),
    ((5, 4, 2), (0, 1, 4), (0, 4, 5)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)


def finer(mesh: FaceMesh, vertex_count: int) -> FaceMesh:
    """Halve the longest edges until there are ``vertex_count`` vertices."""
    while len(mesh.vertices_mm) < vertex_count:
        mesh = _halve(mesh, vertex_count - len(mesh.vertices_mm))
    return mesh


def only_faps(mesh: FaceMesh, numbers: set[int]) -> FaceMesh:
    """Leave out the channels of all other FAPs; bones stay."""
    basis = mesh.basis
    kept = np.array([channel.fap in numbers for channel in basis.channels])[basis.entry_channels]
    counted = np.concatenate([[0], np.cumsum(kept)])
    return replace(
        mesh,
        folds=None,
        basis=DeformationBasis(
            channels=basis.channels,
            offsets=counted[basis.offsets],
            entry_channels=basis.entry_channels[kept],
            entry_mm=basis.entry_mm[kept],
        ),
    )


def _halve(mesh: FaceMesh, wanted: int) -> FaceMesh:
    count, triangles = len(mesh.vertices_mm), mesh.triangles
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    edges, edge_of_side = np.unique(sides, axis=0, return_inverse=True)
    length = np.linalg.norm(mesh.vertices_mm[edges[:, 0]] - mesh.vertices_mm[edges[:, 1]], axis=1)
    marked = np.zeros(len(edges), dtype=bool)
    marked[np.argsort(-length, kind="stable")[:wanted]] = True
    number = np.where(marked, count - 1 + np.cumsum(marked), -1)[edge_of_side.reshape(-1, 3)]
    corners = np.concatenate([triangles, number], axis=1)
    pattern = (number >= 0) @ np.array([1, 2, 4])
    pieces = [corners[pattern == bits][:, np.array(rows)].reshape(-1, 3) for bits, rows in enumerate(PATTERNS)]
    return _carried(mesh, edges[marked], np.concatenate(pieces))


def _carried(mesh: FaceMesh, parents: NDArray[np.int32], triangles: NDArray[np.int64]) -> FaceMesh:
    """``mesh`` with a vertex more in the middle of each pair of ``parents``."""
    count, basis = len(mesh.vertices_mm), mesh.basis
    rows = np.repeat(np.arange(len(parents)), 2)
    means = sparse.csr_array((np.full(2 * len(parents), 0.5), (rows, parents.ravel())), shape=(len(parents), count))
    spread = sparse.vstack([sparse.eye_array(count), means], format="csr")

    def carried(column: NDArray[np.float32]) -> NDArray[np.float32]:
        return (spread @ column.astype(np.float64)).astype(np.float32)

    vertex = np.repeat(np.arange(count), np.diff(basis.offsets))
    shape = (count, len(basis.channels))
    axes = [spread @ sparse.csr_array((basis.entry_mm[:, k], (vertex, basis.entry_channels)), shape) for k in range(3)]
    moved = sum(abs(axis) for axis in axes).tocsr()
    moved.sort_indices()
    owner = np.repeat(np.arange(moved.shape[0]), np.diff(moved.indptr))
    entry_mm = np.stack([np.asarray(axis[owner, moved.indices]).ravel() for axis in axes], axis=-1)
    stronger = np.where(mesh.bone_weight[parents[:, 0]] >= mesh.bone_weight[parents[:, 1]], *parents.T)
    normals = carried(mesh.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    folded = np.broadcast_to(np.float32([0, 0, 1]), normals.shape)  # the two sides of a hair's ribbon may face away
    return replace(
        mesh,
        vertices_mm=carried(mesh.vertices_mm),
        normals=np.divide(normals, length, out=folded.copy(), where=length > 1e-6),
        uv=carried(mesh.uv),
        albedo=carried(mesh.albedo),
        material=np.concatenate([mesh.material, mesh.material[parents[:, 0]]]),
        occlusion=carried(mesh.occlusion),
        bone=np.concatenate([mesh.bone, mesh.bone[stronger]]),
        bone_weight=carried(mesh.bone_weight),
        head_weight=carried(mesh.head_weight),
        triangles=triangles,
        folds=None,
        basis=DeformationBasis(
            channels=basis.channels, offsets=moved.indptr, entry_channels=moved.indices, entry_mm=entry_mm
        ),
    )
