"""Which way a face looks and how large it is: eyes are where shapes shut lids, the mouth where they open the jaw."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.mesh.morphs import MorphMesh
from fapengine.mesh.patch import vertex_normals

Array = NDArray[np.float64]

LEFT, RIGHT, JAW = "left lid", "right lid", "jaw"
ROLES = (LEFT, RIGHT, JAW)
BOTH = "lids"
"""Instead of the first two: a shape that closes both eyes."""
EYE_SHARE = 0.3
"""Of the distance between the eyes' bones: how far round one the eye reaches."""


def face_axes(
    mesh: MorphMesh, moves: Mapping[str, Array], separation_mm: float
) -> tuple[dict[str, Array], tuple[Array, Array, float], dict[str, Array]]:
    """Find a face's axes.

    Parameters
    ----------
    mesh : MorphMesh
    moves : mapping of str to (V, 3) array
        By role, as :func:`fapengine.mesh.morphs_locate.locate` takes them.
    separation_mm : float
        How far apart the eyes shall be.

    Returns
    -------
    dict of str to (V, 3)
        What moves, a blink of both eyes parted.
    (3,), (3, 3), float
        The middle between the eyes, rows of axes (the subject's left, up, ahead), and mm per unit of the mesh.
    dict of str to (V,)
        How much each vertex shows of a role; bones stand in for lids.

    Raises
    ------
    DataError
        If a role is missing or its shape moves nothing, or if left and right are exchanged.
    """
    if BOTH in moves and not (LEFT in moves and RIGHT in moves):
        moves = dict(moves) | _halves(mesh, moves[BOTH], moves.get(JAW))
    moves = {role: move for role, move in moves.items() if np.abs(move).max(initial=0.0) > 0}
    shown = {role: np.linalg.norm(move, axis=1) for role, move in moves.items()} | _round_bones(mesh, moves)
    lacking = [role for role in ROLES if role not in shown]
    if lacking:
        raise DataError(
            f"shapes: got none for {', '.join(lacking)}, expected shapes that close the lids of each eye and open the"
            " jaw (eyeBlinkLeft, eyeBlinkRight, jawOpen); name them in a mapping file, or give the feature points"
        )
    return dict(moves), _axes(mesh, shown, separation_mm), shown


def _round_bones(mesh: MorphMesh, moves: Mapping[str, Array]) -> dict[str, Array]:
    """(V,) by role: instead of lids that no shape moves, what lies round the bones of both eyes."""
    joints = [mesh.limbs[name].joint for name in ("left eye", "right eye") if name in mesh.limbs]
    if len(joints) < 2:
        return {}
    reach = EYE_SHARE * float(np.linalg.norm(joints[0] - joints[1]))
    near = [(np.linalg.norm(mesh.vertices - joint, axis=1) < reach).astype(np.float64) for joint in joints]
    return {role: one for role, one in zip((LEFT, RIGHT), near, strict=True) if role not in moves and one.any()}


def _axes(mesh: MorphMesh, shown: Mapping[str, Array], separation_mm: float) -> tuple[Array, Array, float]:
    """Middle between the eyes, rows of axes, and mm per unit."""
    left, right, jaw = (_centroid(mesh.vertices, shown[role]) for role in ROLES)
    middle = (left + right) / 2
    across = left - right
    size = float(np.linalg.norm(across))
    up = middle - jaw
    up = up - across * (up @ across) / max(size, 1e-12) ** 2
    if not (size > 0 and np.linalg.norm(up) > 0.1 * size):
        raise DataError("shapes: got lids and jaw that move one place, expected two eyes above a mouth")
    x, y = across / size, up / np.linalg.norm(up)
    axes = np.stack([x, y, np.cross(x, y)])
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    if sum(_facing(normals, shown[role], axes[2]) for role in ROLES[:2]) < 0:
        raise DataError("shapes: left and right are exchanged, or triangles face inwards (left is the subject's)")
    return middle, axes, separation_mm / size


def _facing(normals: Array, weight: Array, ahead: Array) -> float:
    """Mean cosine between a direction and the normals of what moves."""
    return float(weight @ (normals @ ahead)) / max(float(weight.sum()), 1e-12)


def _halves(mesh: MorphMesh, lids: Array, jaw: Array | None) -> dict[str, Array]:
    """Part a blink of both eyes at the middle between them; the left one is where the face then looks outwards."""
    size = np.linalg.norm(lids, axis=1)
    moved = size > 0.05 * size.max(initial=0.0)
    if jaw is None or not moved.any():
        return {}
    spread = mesh.vertices[moved] - mesh.vertices[moved].mean(axis=0)
    across = np.linalg.svd(spread, full_matrices=False)[2][0]
    side = (mesh.vertices - mesh.vertices[moved].mean(axis=0)) @ across > 0
    halves = [np.where(one[:, None], lids, 0.0) for one in (side, ~side)]
    up = mesh.vertices[moved].mean(axis=0) - _centroid(mesh.vertices, np.linalg.norm(jaw, axis=1))
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    ahead = np.cross(across, up)
    return dict(zip((LEFT, RIGHT) if _facing(normals, size, ahead) > 0 else (RIGHT, LEFT), halves, strict=True))


def _centroid(vertices: Array, weight: Array) -> Array:
    weight = np.where(weight > 0.5 * weight.max(), weight, 0.0)
    centre: Array = weight @ vertices / weight.sum()
    return centre
