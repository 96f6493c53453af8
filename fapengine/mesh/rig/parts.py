"""Parts of a placed mesh that are no skin: eyeballs, and lashes, brows and beards that follow the skin below them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.mesh.rig.placed_mesh import PlacedMesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

EYE_CORNERS = {"3.5": ("3.7", "3.11"), "3.6": ("3.8", "3.12")}
"""Feature points of the outer and the inner corner of each eye, by its pupil."""
EYE_BONES = {"3.5": "left eye", "3.6": "right eye"}
"""Name of each eye's bone, by its pupil."""
EYE_DEPTH_MM = 11.0
"""Distance from the middle of the eye's corners back to the ball's centre."""
MAX_SHELL_RATIO = 1.2
"""Radii of an eyeball within which a whole part (cornea, tear film, the ball itself) belongs to the eye."""
MIN_BONE_WEIGHT = 0.5
"""Weight of an eye's bone from which a vertex belongs to the eyeball."""
LID_AND_BROW_POINTS = ("3.1", "3.2", "3.3", "3.4", "3.7", "3.8", "3.11", "3.12", *(f"4.{n}" for n in range(1, 7)))
MAX_FOLLOWER_MM = 14.0
"""Distance from lids and brows within which a whole part grows there."""
FOLLOWING_WORDS = ("lash", "brow", "beard", "mustache", "moustache", "stubble")
"""Words in the names of surfaces that follow the skin below them."""


class Eyeball(NamedTuple):
    """One eye of a placed mesh."""

    vertices: Indices
    """(N,), possibly none."""
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
    """Find an eyeball around its pupil or behind its corners, with the shells round it; None without such points."""
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
    centre: Array = middle + solution[:3]
    return centre


def find_followers(mesh: PlacedMesh, eyes: Eyes) -> tuple[Indices, Indices]:
    """Find lashes, brows and beards that are no part of the skin, and the skin vertex that each follows.

    Surfaces called so are found by their name, small parts at lids and brows by their place.

    Returns
    -------
    (M,) int64
        Vertices that follow.
    (M,) int64
        Index in :attr:`PlacedMesh.skin` of the vertex that is nearest to each.
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
