"""Parts of a placed mesh: eyeballs; lashes, brows and beards that follow the skin; tongue and gums; fields of the skin.

Theory of operation
-------------------
Files often keep tongue and gums as one part. The tongue is found by the distance from its tip (feature point 6.1) along
the surface: a part that extends in front of the tip again is no longer tongue there. Gums belong to a jaw by height.

On the skin each feature point has a field that is 1 there, 0 at every other point and far away, and bends least between
them (bilaplacian of the mesh). It stops at an open mouth or lid, where the mesh has a gap. So each FAP moves its own
point by exactly its step and no other point. Followers of the skin get the weights of the nearest skin vertex.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import continue_smoothly, edges_of
from fapengine.mesh.rig.placed_mesh import PlacedMesh

EYE_CORNERS = {"3.5": ("3.7", "3.11"), "3.6": ("3.8", "3.12")}
"""Feature points of the outer and the inner corner of each eye, by its pupil."""
EYE_BONES = {"3.5": "left eye", "3.6": "right eye"}
"""Name of each eye's bone, by its pupil."""
EYE_DEPTH_MM = 11.0
"""Distance from the midpoint of the corners of the eye back to the centre of the ball."""
MAX_BALL_MM = 25.0
"""Radius beyond which an eye is not a ball."""
MAX_SHELL_RATIO = 1.2
"""Radii of an eyeball within which a whole part (cornea, tear film, the ball itself) belongs to the eye."""
MIN_BONE_WEIGHT = 0.5
"""Weight of the eye's bone from which a vertex belongs to the eyeball."""
LID_AND_BROW_POINTS = ("3.1", "3.2", "3.3", "3.4", "3.7", "3.8", "3.11", "3.12", *(f"4.{n}" for n in range(1, 7)))
MAX_FOLLOWER_MM = 14.0
"""Distance from lids and brows within which a whole part grows there."""
FOLLOWING_WORDS = ("lash", "brow", "beard", "mustache", "moustache", "stubble")
"""Words in the names of surfaces that follow the skin below them."""


class Eyeball(NamedTuple):
    """One eye of a placed mesh."""

    vertices: Indices
    """(N,), may be empty."""
    centre_mm: Array
    """(3,) mm, head space."""


Eyes = dict[str, Eyeball]
"""Eyeballs by the feature point of their pupil."""


def find_eyes(mesh: PlacedMesh) -> Eyes:
    """Find the eyeballs: by their bones, else around the pupils, else behind the corners of the eyes."""
    eyes = {pupil: eye for pupil in EYE_CORNERS if (eye := _eye_by_shape(mesh, pupil)) is not None}
    for pupil, name in EYE_BONES.items():
        if name in mesh.source.bones:
            bone = mesh.source.bones[name]
            ball = np.flatnonzero(bone.weight[mesh.kept] > MIN_BONE_WEIGHT)
            if len(ball):
                eyes[pupil] = Eyeball(ball, mesh.to_head_space(bone.joint))
    return eyes


def _eye_by_shape(mesh: PlacedMesh, pupil: str) -> Eyeball | None:
    """Find an eyeball around its pupil or behind its corners, with the shells around it; None without such points."""
    part, vertices = mesh.part, mesh.vertices_mm
    corners = [vertices[mesh.points[name]] for name in EYE_CORNERS[pupil] if name in mesh.points]
    if pupil in mesh.points and part[mesh.points[pupil]] != mesh.skin_part:
        ball = np.flatnonzero(part == part[mesh.points[pupil]])
        centre = _sphere_centre(vertices[ball])
        radius = np.linalg.norm(vertices[ball] - centre, axis=1).max()
    elif len(corners) == 2:
        ball, centre = np.zeros(0, np.int64), np.mean(corners, axis=0) - [0.0, 0.0, EYE_DEPTH_MM]
        radius = 1.5 * EYE_DEPTH_MM
    else:
        return None
    near = np.linalg.norm(vertices - centre, axis=1) < MAX_SHELL_RATIO * radius
    shells = [number for number in np.unique(part[near]) if number != mesh.skin_part and near[part == number].all()]
    return Eyeball(np.union1d(ball, np.flatnonzero(np.isin(part, shells))).astype(np.int64), centre)


def _sphere_centre(points: Array) -> Array:
    """Fit a sphere to (N, 3): |p|^2 = 2 c.p + k, linear in centre and k; a cap of the ball is enough."""
    middle = points.mean(axis=0)
    arm = points - middle
    solution, *_ = np.linalg.lstsq(np.column_stack([2 * arm, np.ones(len(arm))]), (arm**2).sum(axis=1), rcond=None)
    return middle + solution[:3]


def turning_share(mesh: PlacedMesh, eye: Eyeball) -> float:
    """Share of a gaze by which an eye turns; below 1 for a flat eye, as VRoid's, whose joint is far behind it."""
    distance = np.linalg.norm(mesh.vertices_mm[eye.vertices] - eye.centre_mm, axis=1)
    return MAX_BALL_MM / max(float(np.median(distance)), MAX_BALL_MM) if len(distance) else 1.0


def find_followers(mesh: PlacedMesh, eyes: Eyes) -> tuple[Indices, Indices]:
    """Find lashes, brows and beards that are not part of the skin, and the skin vertex that each follows.

    They are found by the names of their surfaces, and small parts at lids and brows by their place.

    Returns
    -------
    (M,) int64
        Vertices that follow.
    (M,) int64
        Index in :attr:`PlacedMesh.skin` of the nearest vertex to each.
    """
    vertices, skin = mesh.vertices_mm, mesh.skin
    free = mesh.part != mesh.skin_part
    for eye in eyes.values():
        free[eye.vertices] = False
    follows = free & mesh.source.on_surfaces(FOLLOWING_WORDS)[mesh.kept]
    hair_points = [vertices[index] for name, index in mesh.points.items() if name in LID_AND_BROW_POINTS]
    if hair_points:
        near = cKDTree(np.stack(hair_points)).query(vertices)[0] < MAX_FOLLOWER_MM
        wholly_near = np.bincount(mesh.part, near) == np.bincount(mesh.part)
        follows |= free & wholly_near[mesh.part]
    followers = np.flatnonzero(follows)
    return followers, np.asarray(cKDTree(vertices[skin]).query(vertices[followers])[1], np.int64)


IN_FRONT_MM = 2.0
"""Distance in front of the tip from which a surface is not tongue."""
FRONT_MM, BOTH_JAWS_MM = 10.0, 10.0
"""Depth of the front of a part, and its reach above and below the mouth line from which it belongs to both jaws."""
BETWEEN_JAWS_MM = 6.0
"""Distance from the mouth line at which a part of both jaws follows the lower one fully, or not at all."""
ROOT_SHARE = 0.25
"""Position from root to tip from which a tongue follows the lower jaw fully."""


@dataclass(frozen=True, slots=True, eq=False)
class Tongue:
    """Vertices of a tongue and of connected gums, and the fraction of the tip's motion that they follow."""

    vertices: Indices
    """(N,): those of the part with the tip."""
    share: Array
    """(N,): position from root, 0, to tip, 1; 0 on gums."""


def find_tongue(mesh: PlacedMesh) -> Tongue | None:
    """Find the tongue by its tip; None if that is unknown or on the skin."""
    if "6.1" not in mesh.points or mesh.part[mesh.points["6.1"]] == mesh.skin_part:
        return None
    tip = mesh.points["6.1"]
    vertices = np.flatnonzero(mesh.part == mesh.part[tip])
    distance = _distances(mesh, tip)[vertices]
    in_front = mesh.vertices_mm[vertices, 2] > mesh.vertices_mm[tip, 2] + IN_FRONT_MM
    root = max(float(np.min(distance, where=in_front, initial=distance.max())), 1.0)
    return Tongue(vertices, np.clip(1.0 - distance / root, 0.0, 1.0))


def _distances(mesh: PlacedMesh, start: int) -> Array:
    """(V,) mm: distance along the edges from a vertex; infinite on other parts."""
    place = mesh.nodes_mm
    edges = np.unique(np.sort(edges_of(mesh.node[mesh.triangles])), axis=0)
    long_mm = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1).clip(min=1e-6)
    links = csr_array((long_mm, (edges[:, 0], edges[:, 1])), shape=(len(place), len(place)))
    return dijkstra(links, directed=False, indices=mesh.node[[start]])[0, mesh.node]


def share_of_lower_jaw(mesh: PlacedMesh, tongue: Tongue | None, part: Indices) -> Array | None:
    """(N,) 0..1: fraction by which vertices of a part, (N,), follow the lower jaw; None if it is not of both jaws."""
    place, mouth_line = mesh.vertices_mm[part], mesh.mouth_line_mm
    front = place[place[:, 2] > place[:, 2].max() - FRONT_MM, 1] - mouth_line
    if min(front.max(), -front.min()) < BOTH_JAWS_MM:
        return None
    lower = smoothstep(0.5 + (mouth_line - place[:, 1]) / (2 * BETWEEN_JAWS_MM))
    if tongue is None or tongue.vertices[0] not in part:
        return lower
    return np.maximum(lower, smoothstep(tongue.share / ROOT_SHARE))


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
