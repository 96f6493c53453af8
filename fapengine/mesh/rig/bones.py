"""Bones of an imported head: the vertices that turn with jaw, eyes and head, and the joints.

Eyes turn by the rig's bones or about their balls. Parts below the mouth line inside the head follow the jaw, and so
does the lower half of a part of both jaws; skin follows by its weight in the chin's motion. Blendshapes that open the
jaw take precedence. The neck follows the head by its skin weights, or fades below the chin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.face_mesh import Bone, FaceMesh
from fapengine.mesh.rig.parts import MIN_SHARE, Eyes, PointFields, find_tongue, share_of_lower_jaw, turning_share
from fapengine.mesh.rig.placed_mesh import PlacedMesh

BONE_FAPS = (3, 14, 15, 23, 24, 25, 26, 27, 28, 48, 49, 50)
EYE_SIDES = (("3.5", Bone.LEFT_EYE, (23, 25, 27)), ("3.6", Bone.RIGHT_EYE, (24, 26, 28)))
"""Pupil, bone and FAPs of each eye."""
LOWER_MOUTH_POINTS = ("9.9", "9.11", "6.1", "6.2")
"""Feature points of the lower teeth and the tongue."""
INSIDE_MM = 20.0
"""Height above the mouth line up to which the middle of a part attached to both jaws may be."""
NECK_MM = (45.0, 75.0)
"""Distance below the chin from which the head's motion fades, and the length of the fade."""
MIN_CARRIED_MM = 1.0
"""Motion by a blendshape from which a vertex is left to it, not to the jaw's bone."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bones:
    """Bone and weights of each vertex, and the joints, for :class:`fapengine.mesh.face_mesh.FaceMesh`."""

    bone: NDArray[np.uint8]
    """(V,): :class:`fapengine.mesh.face_mesh.Bone`."""
    weight: Array
    """(V,), 0..1."""
    head_weight: Array
    """(V,), 0..1."""
    jaw_pivot_mm: Array
    """(3,)."""
    head_pivot_mm: Array
    """(3,)."""
    eye_pivots_mm: Array
    """(2, 3): left, right."""

    def reached(self, eyes: Eyes, jaw_opens: bool) -> set[int]:
        """FAPs moved by these bones, or by the blendshapes that open the jaw."""
        faps = set(BONE_FAPS)
        for pupil, _, numbers in EYE_SIDES:
            if pupil not in eyes or not len(eyes[pupil].vertices):
                faps -= set(numbers)
        if not jaw_opens and not (self.bone == Bone.JAW).any():
            faps -= {3, 14, 15}
        return faps


def bind_bones(
    mesh: PlacedMesh, fields: PointFields, eyes: Eyes, carried_mm: Array, jaw_opens: bool, standard: FaceMesh
) -> Bones:
    """Choose what each vertex turns with, and how much.

    Parameters
    ----------
    mesh : PlacedMesh
    fields : PointFields
        Its skin.
    eyes : Eyes
        Its eyeballs.
    carried_mm : (V,) mm
        How far blendshapes move each vertex at most.
    jaw_opens : bool
        Whether blendshapes open the jaw.
    standard : FaceMesh
        Gives the joints that the mesh does not have.
    """
    bone, weight = _nearest_bones(mesh, fields, eyes)
    jaw_pivot = standard.jaw_pivot_mm
    if jaw_opens:
        left_to_shapes = carried_mm > MIN_CARRIED_MM
        left_to_shapes[fields.vertices] = True
        left_to_shapes &= bone == Bone.JAW
        bone[left_to_shapes], weight[left_to_shapes] = Bone.NONE, 0.0
    elif "jaw" in mesh.source.bones:
        jaw = mesh.source.bones["jaw"]
        bone[bone == Bone.NONE] = Bone.JAW
        weight = np.where(bone == Bone.JAW, jaw.weight[mesh.kept], weight)
        jaw_pivot = mesh.to_head_space(jaw.joint)
    head_weight, head_pivot = _head(mesh, standard)
    eye_pivots = [
        eyes[pupil].centre_mm if pupil in eyes else standard.eye_pivots_mm[index]
        for index, (pupil, _, _) in enumerate(EYE_SIDES)
    ]
    return Bones(
        bone=bone, weight=np.clip(weight, 0.0, 1.0), head_weight=head_weight, jaw_pivot_mm=jaw_pivot,
        head_pivot_mm=head_pivot, eye_pivots_mm=np.stack(eye_pivots),
    )  # fmt: skip


def _nearest_bones(mesh: PlacedMesh, fields: PointFields, eyes: Eyes) -> tuple[NDArray[np.uint8], Array]:
    """(V,) bone and (V,) weight: parts of the lower mouth, skin, eyeballs, then followers of the skin."""
    bone, weight = np.zeros(len(mesh.vertices_mm), np.uint8), np.zeros(len(mesh.vertices_mm))
    tongue = find_tongue(mesh)
    for part, goes_down in _inside_of_mouth(mesh):
        lower = share_of_lower_jaw(mesh, tongue, part)
        if lower is not None or goes_down:
            bone[part], weight[part] = Bone.JAW, 1.0 if lower is None else lower
    share = fields.jaw[: len(fields.skin)]
    bone[fields.skin[share > MIN_SHARE]] = Bone.JAW
    weight[fields.skin] = np.where(share > MIN_SHARE, share, 0.0)
    for pupil, side, _ in EYE_SIDES:
        if pupil in eyes:
            ball = eyes[pupil].vertices
            bone[ball], weight[ball] = side, turning_share(mesh, eyes[pupil])
    bone[fields.followers], weight[fields.followers] = bone[fields.nearest], weight[fields.nearest]
    return bone, weight


def _inside_of_mouth(mesh: PlacedMesh) -> list[tuple[Indices, bool]]:
    """Vertices, (N,), of each part inside the head near the mouth, and whether it is below the mouth line."""
    positions, mouth_line = mesh.positions, mesh.mouth_line_mm
    named = {mesh.part[mesh.points[name]] for name in LOWER_MOUTH_POINTS if name in mesh.points}
    parts = []
    for number in np.unique(mesh.part[mesh.part != mesh.skin_part]):
        part = np.flatnonzero(mesh.part == number)
        x, y, z = mesh.vertices_mm[part].mean(axis=0)
        inside = abs(x) < 45 and positions["2.1"][1] - 10 < y < mouth_line + INSIDE_MM and z > 0
        if inside or number in named:
            parts.append((part, bool(number in named or y < mouth_line)))
    return parts


def _head(mesh: PlacedMesh, standard: FaceMesh) -> tuple[Array, Array]:
    """(V,) weight of the head's bone and (3,) its joint."""
    if "head" in mesh.source.bones:
        head = mesh.source.bones["head"]
        weight = head.weight[mesh.kept]
        if (weight > 0).any() and (weight < 1).any():
            return weight, mesh.to_head_space(head.joint)
    positions = mesh.positions
    height = mesh.vertices_mm[:, 1] - positions["2.1"][1] + sum(NECK_MM)
    weight = np.asarray(smoothstep(height / NECK_MM[1]), np.float64)
    return weight, np.asarray(positions.get("7.1", standard.head_pivot_mm), np.float64)
