"""Axes and size of a face: eyes are where blendshapes close lids, the mouth is where they open the jaw."""

from collections.abc import Mapping, Sequence

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

LEFT, RIGHT, JAW = "left lid", "right lid", "jaw"
ROLES = (LEFT, RIGHT, JAW)
BOTH = "lids"
"""Role of a blendshape that closes both eyes, instead of the first two."""
EYE_SHARE = 0.3
"""Radius of the region of an eye, relative to the distance between the bones of the eyes."""


def face_axes(
    mesh: BlendshapeMesh, moves: Mapping[str, Array], separation_mm: float
) -> tuple[dict[str, Array], tuple[Array, Array, float], dict[str, Array]]:
    """Find the axes of a face.

    Parameters
    ----------
    mesh : BlendshapeMesh
    moves : mapping of str to (V, 3) array
        Motion by role, as for :func:`fapengine.mesh.rig.feature_points.locate`.
    separation_mm : float
        Eye distance to scale to.

    Returns
    -------
    dict of str to (V, 3)
        Motion by role, with a blink of both eyes split.
    (3,), (3, 3), float
        The midpoint between the eyes, rows of axes (the subject's left, up, ahead), and mm per unit of the mesh.
    dict of str to (V,)
        Weight of each vertex in a role; bones replace missing lids.

    Raises
    ------
    DataError
        If a role is missing or its blendshape moves nothing, or if left and right are exchanged.
    """
    if BOTH in moves and not (LEFT in moves and RIGHT in moves):
        moves = dict(moves) | _halves(mesh, moves[BOTH], moves.get(JAW))
    moves = {role: move for role, move in moves.items() if np.abs(move).max(initial=0.0) > 0}
    amounts = {role: np.linalg.norm(move, axis=1) for role, move in moves.items()} | _round_bones(mesh, moves)
    missing = [role for role in ROLES if role not in amounts]
    if missing:
        raise DataError(
            f"blendshapes: missing for {', '.join(missing)}; name those that close the lids of each eye and open the"
            " jaw (eyeBlinkLeft, eyeBlinkRight, jawOpen) in a mapping file, or give the feature points"
        )
    return dict(moves), _axes(mesh, amounts, separation_mm, [role for role in ROLES[:2] if role in moves]), amounts


def _round_bones(mesh: BlendshapeMesh, moves: Mapping[str, Array]) -> dict[str, Array]:
    """(V,) by role: the vertices around the bones of both eyes, instead of lids that no blendshape moves."""
    joints = [mesh.bones[name].joint for name in ("left eye", "right eye") if name in mesh.bones]
    if len(joints) < 2:
        return {}
    reach = EYE_SHARE * float(np.linalg.norm(joints[0] - joints[1]))
    near = [(np.linalg.norm(mesh.vertices - joint, axis=1) < reach).astype(np.float64) for joint in joints]
    return {role: eye for role, eye in zip((LEFT, RIGHT), near, strict=True) if role not in moves and eye.any()}


def _axes(
    mesh: BlendshapeMesh, amounts: Mapping[str, Array], separation_mm: float, lids: Sequence[str]
) -> tuple[Array, Array, float]:
    """Midpoint between the eyes, rows of axes, and mm per unit.

    The sides of ``lids`` are known from their blendshapes and checked by the direction they face; bones have names.
    """
    left, right, jaw = (_centroid(mesh.vertices, amounts[role]) for role in ROLES)
    middle = (left + right) / 2
    across = left - right
    size = float(np.linalg.norm(across))
    up = middle - jaw
    up = up - across * (up @ across) / max(size, 1e-12) ** 2
    if not (size > 0 and np.linalg.norm(up) > 0.1 * size):
        raise DataError("blendshapes: lids and jaw move the same place, expected two eyes above a mouth")
    x, y = across / size, up / np.linalg.norm(up)
    axes = np.stack([x, y, np.cross(x, y)])
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    if sum(_facing(normals, amounts[role], axes[2]) for role in lids) < 0:
        raise DataError("blendshapes: left and right are exchanged, or triangles face inwards (left is the subject's)")
    return middle, axes, separation_mm / size


def _facing(normals: Array, weight: Array, ahead: Array) -> float:
    """Mean cosine between a direction and the normals of the moving vertices."""
    return float(weight @ (normals @ ahead)) / max(float(weight.sum()), 1e-12)


def _halves(mesh: BlendshapeMesh, lids: Array, jaw: Array | None) -> dict[str, Array]:
    """Split a blink of both eyes at the middle between them; the left one is where the face then faces outwards."""
    size = np.linalg.norm(lids, axis=1)
    moved = size > 0.05 * size.max(initial=0.0)
    if jaw is None or not moved.any():
        return {}
    middle = mesh.vertices[moved].mean(axis=0)
    across = np.linalg.svd(mesh.vertices[moved] - middle, full_matrices=False)[2][0]
    side = (mesh.vertices - middle) @ across > 0
    halves = [np.where(half[:, None], lids, 0.0) for half in (side, ~side)]
    up = middle - _centroid(mesh.vertices, np.linalg.norm(jaw, axis=1))
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    roles = (LEFT, RIGHT) if _facing(normals, size, np.cross(across, up)) > 0 else (RIGHT, LEFT)
    return dict(zip(roles, halves, strict=True))


def _centroid(vertices: Array, weight: Array) -> Array:
    weight = np.where(weight > 0.5 * weight.max(), weight, 0.0)
    return weight @ vertices / weight.sum()
