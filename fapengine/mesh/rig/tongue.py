"""The tongue of a placed mesh, and gums of both jaws that hang together with it or with each other.

Files keep tongue and gums as one part as often as not. What a tongue is, is told by the way from its tip (feature
point 6.1) along the surface: a part that comes out in front of the tip again has ceased to be a tongue on the way
there. What jaw a gum is of is told by its height.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.rig.placed_mesh import PlacedMesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

IN_FRONT_MM = 2.0
"""Distance in front of the tip from which a surface is no tongue."""
FRONT_MM, BOTH_JAWS_MM = 10.0, 10.0
"""Depth of a part's front, and its reach above and below the mouth line from which the part is of both jaws."""
BETWEEN_JAWS_MM = 6.0
"""Distance from the mouth line at which a part of both jaws goes wholly with the lower one, or not at all."""
ROOT_SHARE = 0.25
"""Share of the way from root to tip from which a tongue goes wholly with the lower jaw."""


@dataclass(frozen=True, slots=True, eq=False)
class Tongue:
    """Vertices of a tongue, and of gums that hang together with it, and their share in the motion of its tip."""

    vertices: Indices
    """(N,): those of the part that bears the tip."""
    share: Array
    """(N,): way from root, 0, to tip, 1; 0 on gums."""


def find_tongue(mesh: PlacedMesh) -> Tongue | None:
    """Find the tongue by its tip; None if that is unknown or lies on the skin."""
    if "6.1" not in mesh.points or mesh.part[mesh.points["6.1"]] == mesh.skin_part:
        return None
    tip = mesh.points["6.1"]
    vertices = np.flatnonzero(mesh.part == mesh.part[tip])
    way = _ways(mesh, tip)[vertices]
    in_front = mesh.vertices_mm[vertices, 2] > mesh.vertices_mm[tip, 2] + IN_FRONT_MM
    root = max(float(np.min(way, where=in_front, initial=way.max())), 1.0)
    return Tongue(vertices, np.clip(1.0 - way / root, 0.0, 1.0))


def _ways(mesh: PlacedMesh, start: int) -> Array:
    """(V,) mm: way along the edges from a vertex; infinite on other parts."""
    first = np.zeros(mesh.node.max() + 1, np.int64)
    first[mesh.node] = np.arange(len(mesh.node))
    place, corners = mesh.vertices_mm[first], mesh.node[mesh.triangles]
    edges = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])), axis=0)
    long_mm = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1).clip(min=1e-6)
    links = csr_array((long_mm, (edges[:, 0], edges[:, 1])), shape=(len(first), len(first)))
    ways: Array = dijkstra(links, directed=False, indices=mesh.node[[start]])[0, mesh.node]
    return ways


def share_of_lower_jaw(mesh: PlacedMesh, tongue: Tongue | None, part: Indices) -> Array | None:
    """(N,) 0..1: how far vertices of a part, (N,), go with the lower jaw; None if it is not of both jaws."""
    positions, place = mesh.positions, mesh.vertices_mm[part]
    mouth_line = (positions["8.1"][1] + positions["8.2"][1]) / 2
    front = place[place[:, 2] > place[:, 2].max() - FRONT_MM, 1] - mouth_line
    if min(front.max(), -front.min()) < BOTH_JAWS_MM:
        return None
    lower = np.asarray(smoothstep(0.5 + (mouth_line - place[:, 1]) / (2 * BETWEEN_JAWS_MM)), np.float64)
    if tongue is None or tongue.vertices[0] not in part:
        return lower
    return np.maximum(lower, np.asarray(smoothstep(tongue.share / ROOT_SHARE), np.float64))
