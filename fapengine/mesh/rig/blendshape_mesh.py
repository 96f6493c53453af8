"""A mesh with named blendshapes (glTF's morph targets) and bones, as read from a file.

Axes and size of its face: eyes are where blendshapes close lids, the mouth is where they open the jaw.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices, Mask, freeze
from fapengine.errors import DataError, UsageError
from fapengine.geometry.surface import vertex_normals

HEAD = "head"
BONE_NAMES = (HEAD, "jaw", "left eye", "right eye")
"""Bones of a rig that an imported head uses."""
MIN_WEIGHT = 0.5
"""Weight from which a vertex belongs to a bone."""


@dataclass(frozen=True, slots=True, eq=False)
class Blendshape:
    """Displacements of some vertices at full weight. Arrays are read-only."""

    vertices: Indices
    """(N,) int64, no vertex twice."""
    moves: Array
    """(N, 3) float64: displacements, in the mesh's unit and axes."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, vertices=("N",))
        freeze(self, moves=(len(self.vertices), 3))


@dataclass(frozen=True, slots=True, eq=False)
class RigBone:
    """A bone: the weights of its vertices, and its joint."""

    weight: Array
    """(V,) float64, 0..1: weight of each vertex on the bone and its children."""
    joint: Array
    """(3,) float64, in the mesh's unit and axes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BlendshapeMesh:
    """A neutral mesh and its blendshapes, in any unit and axes. Arrays are read-only.

    Raises
    ------
    UsageError
        If an array has another shape, a vertex index is out of range, or a bone has an unknown name.
    """

    vertices: Array
    """(V, 3) float64."""
    triangles: Indices
    """(F, 3) int64, counter-clockwise from outside."""
    blendshapes: Mapping[str, Blendshape]
    """Blendshapes by the names in the file, in its order."""
    uv: Array | None = None
    """(V, 2) float64: texture coordinates, (0, 0) the top left corner; None without a texture."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 4) uint8: base colour of the whole mesh, sRGB and straight alpha."""
    albedo: Array | None = None
    """(V, 3) float64, linear RGB, 0..1: multiplies the texture, if there is one; None if the file has none."""
    surfaces: tuple[str, ...] = ()
    """Names of the mesh's surfaces, such as ``"Teeth"``, ``"Hair / HairMaterial"``."""
    surface: Indices | None = None
    """(V,) int64: index in ``surfaces`` of each vertex."""
    bones: Mapping[str, RigBone] = field(default_factory=dict)
    """Bones by :data:`BONE_NAMES`."""
    faces_back: bool = False
    """Whether a face without eye bones looks along -z, as of VRM 0.x."""
    notes: tuple[str, ...] = ()
    """Sentences about parts of the file that were left out."""

    def __post_init__(self) -> None:
        freeze(self, vertices=("V", 3))
        freeze(self, np.int64, triangles=("F", 3))
        count = len(self.vertices)
        if len(self.triangles) and not 0 <= self.triangles.min() <= self.triangles.max() < count:
            raise UsageError(f"triangles: vertices must be 0 to {count - 1}")
        for name, shape, dtype in (
            ("uv", (count, 2), np.float64),
            ("albedo", (count, 3), np.float64),
            ("surface", (count,), np.int64),
            ("texture", ("H", "W", 4), np.uint8),
        ):
            if getattr(self, name) is not None:
                freeze(self, dtype, **{name: shape})
        for name, blendshape in self.blendshapes.items():
            moved = blendshape.vertices
            if len(moved) and not 0 <= moved.min() <= moved.max() < count:
                raise UsageError(f"blendshape {name}: vertices must be 0 to {count - 1}")
        if unknown := set(self.bones) - set(BONE_NAMES):
            raise UsageError(f"bones: got {sorted(unknown)}, expected some of {', '.join(BONE_NAMES)}")
        object.__setattr__(self, "blendshapes", MappingProxyType(dict(self.blendshapes)))
        object.__setattr__(self, "bones", MappingProxyType(dict(self.bones)))

    def dense(self, name: str) -> Array:
        """(V, 3) float64: displacement of every vertex by one blendshape at full weight.

        Raises
        ------
        UsageError
            If there is no blendshape of that name.
        """
        if name not in self.blendshapes:
            raise UsageError(f"blendshape: got {name!r}, this mesh has {', '.join(list(self.blendshapes)[:12])}")
        moves = np.zeros_like(self.vertices)
        moves[self.blendshapes[name].vertices] = self.blendshapes[name].moves
        return moves

    def on_surfaces(self, words: Sequence[str]) -> Mask:
        """(V,) bool: vertices of surfaces with one of these words in their names."""
        if self.surface is None:
            return np.zeros(len(self.vertices), bool)
        chosen = [number for number, name in enumerate(self.surfaces) if any(word in name.lower() for word in words)]
        return np.isin(self.surface, chosen)


LEFT, RIGHT, JAW = "left lid", "right lid", "jaw"
ROLES = (LEFT, RIGHT, JAW)
BOTH = "lids"
"""Role of a blendshape that closes both eyes, instead of the first two."""
EYE_SHARE = 0.3
"""Radius of the region of an eye, relative to the distance between the bones of the eyes."""


def can_follow_bones(mesh: BlendshapeMesh) -> bool:
    """Whether a mesh has a bone with the vertices of a head."""
    return HEAD in mesh.bones and bool((mesh.bones[HEAD].weight > MIN_WEIGHT).any())


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
