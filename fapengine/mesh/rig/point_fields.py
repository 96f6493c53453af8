"""Fields of the feature points: how far the skin around a point follows it.

Theory of operation
-------------------
On the skin each feature point has a field that is 1 there, 0 at every other point and far away, and bends least between
them (bilaplacian of the mesh). It stops at an open mouth or lid, where the mesh has a gap. So each FAP moves its own
point by exactly its step and no other point. Followers of the skin (lashes, brows, beards) get the weights of the
nearest skin vertex.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices
from fapengine.geometry.surface import continue_smoothly
from fapengine.mesh.rig.parts import Eyes, find_followers
from fapengine.mesh.rig.placed_mesh import PlacedMesh

MAX_REACH_MM = 34.0
"""Distance from every feature point beyond which skin does not move."""
MIN_SHARE = 0.004
"""Weight below which motion is not visible."""
CHIN_POINTS = ("2.1", "2.10", "2.11", "2.12")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointFields:
    """The skin, its followers, and the weight of each in the motion of every feature point on it."""

    points: dict[str, int]
    """Vertices of the feature points on the skin."""
    skin: Indices
    """(S,): vertices of the skin."""
    followers: Indices
    """(M,): vertices that follow the skin."""
    nearest: Indices
    """(M,): skin vertex that each follows."""
    vertices: Indices
    """(S + M,): those of the skin, then its followers."""
    shares: dict[str, Array]
    """(S + M,) by feature point: 1 at the point, 0 at the others."""
    jaw: Array
    """(S + M,): weight in the chin's motion, 0..1."""


def fit_point_fields(mesh: PlacedMesh, eyes: Eyes) -> PointFields:
    """Extend the motion of each feature point, and of the chin, over the skin of a placed mesh."""
    points = {name: index for name, index in mesh.points.items() if mesh.part[index] == mesh.skin_part}
    skin, (followers, nearest) = mesh.skin, find_followers(mesh, eyes)
    shares = _continued(mesh, points, np.eye(len(points)))
    shares[np.abs(shares) < MIN_SHARE] = 0.0
    at_chin = np.array([[float(name in CHIN_POINTS)] for name in points])
    jaw = np.clip(_continued(mesh, points, at_chin)[:, 0], 0.0, 1.0)
    with_followers = np.concatenate([np.arange(len(skin)), nearest])
    return PointFields(
        points=points, skin=skin, followers=followers, nearest=skin[nearest],
        vertices=np.concatenate([skin, followers]),
        shares={name: share[with_followers] for name, share in zip(points, shares.T, strict=True)},
        jaw=jaw[with_followers],
    )  # fmt: skip


def _continued(mesh: PlacedMesh, points: dict[str, int], values: Array) -> Array:
    """(S, C): values at the feature points, (P, C), extended over the skin; 0 far from all of them."""
    skin, anchors = mesh.skin, list(points.values())
    nodes = np.unique(mesh.node[skin])
    local = np.full(mesh.node.max() + 1, -1)
    local[nodes] = np.arange(len(nodes))
    position = np.zeros((len(nodes), 3))
    position[local[mesh.node[skin]]] = mesh.vertices_mm[skin]
    fixed = np.asarray(cKDTree(mesh.vertices_mm[anchors]).query(position)[0] > MAX_REACH_MM)
    fixed[local[mesh.node[anchors]]] = True
    fixed_values = np.zeros((len(nodes), values.shape[1]))
    fixed_values[local[mesh.node[anchors]]] = values
    corners = local[mesh.node[mesh.triangles]]
    continued = continue_smoothly(fixed_values, fixed, corners[(corners >= 0).all(axis=1)])
    return continued[local[mesh.node[skin]]]
