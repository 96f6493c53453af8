"""Shapes that a rig lacks, made from those of the built-in head: deformation transfer.

Theory of operation
-------------------
The built-in head is fitted to the mesh (:func:`fapengine.models.adapted_head.adapt_head`), so each of its shapes is a
motion of a surface that lies on the mesh's skin. A vertex of the skin moves as the nearest places of that surface do.
Lips touch and move apart, so vertices near the mouth follow places on their own side of the line between the lips
only. Sumner and Popovic 2004, "Deformation transfer for triangle meshes", transfer gradients instead: fitted surfaces
have the same size, so displacements suffice. Lashes and brows follow the skin below.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Mask
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh
from fapengine.mesh.rig.parts import find_eyes, find_followers
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.models.adapted_head import adapt_head, scan_surface

NEIGHBOURS = 4
"""Places that a vertex follows, weighted by the inverse of their distance."""
NEAR_MM, FAR_MM = 6.0, 16.0
"""Distances from the fitted head between which the motion fades."""
SEAM = 0.47
"""Where lips meet, from the upper outline to the lower one: the lower lip is the fuller one."""
DEPTH_MM = 0.5
"""Depth below the skin at which the sides of lips that touch are known."""
MIN_MOTION_MM = 0.05
"""Largest motion of a vertex that is left out."""
CORNERS = (("2.4", "8.3"), ("2.5", "8.4"))
"""Feature points of each corner of the lips: the inner one, or the outer one where it is unknown."""


def complete_rig(
    mesh: BlendshapeMesh, points: Mapping[str, int], shapes: Mapping[str, Array], standard: FaceMesh
) -> tuple[BlendshapeMesh, float]:
    """Add shapes to a mesh.

    Parameters
    ----------
    mesh : BlendshapeMesh
        Lips and lids are open cuts.
    points : mapping of str to int
        Vertex of each feature point.
    shapes : mapping of str to (68,) FAPU
        FAPs of each new shape. It replaces one of the same name.
    standard : FaceMesh
        Defines scale and axes.

    Returns
    -------
    BlendshapeMesh
    float
        Mean distance of the fitted head's front from the mesh, mm of the standard's face.

    Raises
    ------
    DataError
        As :func:`fapengine.mesh.rig.placed_mesh.place_mesh`, or if the head cannot be fitted.
    """
    placed = place_mesh(mesh, points, standard)
    head, nearness = adapt_head(scan_surface(placed), placed.positions)
    ours = np.flatnonzero(np.isin(head.material, (Material.SKIN, Material.LIP)))
    skin, (followers, nearest) = placed.skin, find_followers(placed, find_eyes(placed))
    nodes_mm = placed.vertices_mm[skin]
    chosen, share = np.zeros((len(skin), NEIGHBOURS), np.int64), np.zeros((len(skin), NEIGHBOURS))
    normals = vertex_normals(placed.vertices_mm, placed.triangles)
    theirs_above = _above_lips(nodes_mm - DEPTH_MM * normals[skin], placed.positions)
    inside_mm = head.vertices_mm[ours] - DEPTH_MM * head.normals[ours]
    own_above = _above_lips(inside_mm, {name: head.point_mm(name).astype(np.float64) for name in head.feature_points})
    for side in (False, True):
        mine, candidates = theirs_above == side, ours[own_above == side]
        tree = cKDTree(head.vertices_mm[candidates])
        away_mm, found = map(np.asarray, tree.query(nodes_mm[mine], NEIGHBOURS))
        weight = 1.0 / np.maximum(away_mm, 1e-6)
        fade = 1.0 - np.asarray(smoothstep((away_mm[:, :1] - NEAR_MM) / (FAR_MM - NEAR_MM)))
        chosen[mine], share[mine] = candidates[found], fade * weight / weight.sum(axis=1, keepdims=True)
    made = {}
    vertices = placed.kept[np.concatenate([skin, followers])]
    for name, faps in shapes.items():
        gone = deform(head, faps) - head.vertices_mm
        moves = np.einsum("vn,vnc->vc", share, gone[chosen])
        moves = np.concatenate([moves, moves[nearest]])
        kept = np.linalg.norm(moves, axis=1) > MIN_MOTION_MM
        made[name] = Blendshape(vertices[kept], moves[kept] @ placed.rotation / placed.scale)
    return replace(mesh, blendshapes={**mesh.blendshapes, **made}), nearness.front_mm[1]


def _above_lips(places_mm: Array, points_mm: Mapping[str, Array]) -> Mask:
    """(N,): whether places, (N, 3) mm, are above the line between the lips and its continuation."""
    middle = points_mm["2.2"] if "2.2" in points_mm else (1 - SEAM) * points_mm["8.1"] + SEAM * points_mm["8.2"]
    line = sorted(place[:2].tolist() for place in (middle, *(points_mm.get(i, points_mm[o]) for i, o in CORNERS)))
    across, height = zip(*line, strict=True)
    return np.asarray(places_mm[:, 1] > np.interp(places_mm[:, 0], across, height))
