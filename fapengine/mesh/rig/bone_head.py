"""A head without blendshapes, moved by its bones alone: it nods and turns, and its jaw and eyes go where it has bones.

Nothing tells where such a face's lips are. So it is laid on the standard's head by its bones: the head's joint is the
pivot, up is the scene's y, the face looks where the eyes lie before the joint (else along z, as glTF has it), and the
top of what the bone carries is as high as ours. Lips and brows stay.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.mesh.colours import TEETH, Palette
from fapengine.mesh.face_mesh import Bone, DeformationBasis, FaceMesh, Material
from fapengine.mesh.rig import surfaces
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.import_head import ImportedHead
from fapengine.mesh.rig.placed_mesh import KEPT_BELOW_CHIN_MM, KEPT_BESIDE_MM, PlacedMesh, find_parts
from fapengine.mpeg4 import fap

Array = NDArray[np.float64]

HEAD, JAW, EYES = "head", "jaw", ("left eye", "right eye")
HEAD_FAPS, JAW_FAPS = (48, 49, 50), (3, 14, 15)
EYE_FAPS = {"left eye": (23, 25, 27), "right eye": (24, 26, 28)}
MIN_WEIGHT = 0.5
"""Share of a vertex from which it is a bone's."""
CHIN = "2.1"
UP = np.array([0.0, 1.0, 0.0])


def can_follow_bones(mesh: BlendshapeMesh) -> bool:
    """Tell whether a mesh has a bone that carries a head."""
    return HEAD in mesh.bones and bool((mesh.bones[HEAD].weight > MIN_WEIGHT).any())


def head_of_bones(mesh: BlendshapeMesh, standard: FaceMesh) -> ImportedHead:
    """Make a head that its bones move.

    Parameters
    ----------
    mesh : BlendshapeMesh
        Its bones must hold a head; its up is y.
    standard : FaceMesh
        Gives size, place and units.

    Raises
    ------
    DataError
        If no bone carries a head, or nothing of it lies above its joint.
    """
    if not can_follow_bones(mesh):
        raise DataError("bones: got no head that carries vertices, expected one")
    placed = _place(mesh, standard)
    moving = {name: mesh.bones[name].weight[placed.kept] for name in (JAW, *EYES) if name in mesh.bones}
    moving = {name: weight for name, weight in moving.items() if (weight > MIN_WEIGHT).any()}
    bone, weight = _bones(moving, len(placed.kept))
    material = surfaces.choose_materials(placed, {}, {})
    material[np.isin(bone, (Bone.LEFT_EYE, Bone.RIGHT_EYE))] = Material.BALL
    normals = surfaces.smooth_normals(placed)
    pivots = {name: placed.to_head_space(mesh.bones[name].joint) for name in moving}
    numbers = {*HEAD_FAPS, *(JAW_FAPS if JAW in moving else ())}
    numbers |= {number for eye in EYES if eye in moving for number in EYE_FAPS[eye]}
    head = FaceMesh(
        vertices_mm=placed.vertices_mm.astype(np.float32),
        normals=normals.astype(np.float32),
        uv=surfaces.texture_coordinates(placed, {}).astype(np.float32),
        albedo=_colours(placed, material),
        material=material,
        occlusion=surfaces.ambient_light(placed, normals, material),
        bone=bone,
        bone_weight=weight.astype(np.float32),
        head_weight=mesh.bones[HEAD].weight[placed.kept].astype(np.float32),
        triangles=placed.triangles.astype(np.int32),
        feature_points=placed.points,
        jaw_pivot_mm=pivots.get(JAW, standard.jaw_pivot_mm),
        head_pivot_mm=placed.to_head_space(mesh.bones[HEAD].joint),
        eye_pivots_mm=np.stack([pivots.get(eye, standard.eye_pivots_mm[row]) for row, eye in enumerate(EYES)]),
        fapu=standard.fapu,
        basis=DeformationBasis(
            channels=(),
            offsets=np.zeros(len(placed.kept) + 1, np.int32),
            entry_channels=np.zeros(0, np.int32),
            entry_mm=np.zeros((0, 3), np.float32),
        ),
        texture=mesh.texture,
    )
    moves = ", ".join([HEAD, *moving])
    return ImportedHead(
        mesh=head,
        moved=tuple(sorted(numbers)),
        missing=tuple(row.number for row in fap.FAPS if row.number > 2 and row.number not in numbers),
        scale=placed.scale,
        notes=(*mesh.notes, f"no blendshape has a name that is known: bones alone move it ({moves}), lips stay"),
        used=(),
        unused=tuple(mesh.blendshapes),
        placed=placed,
    )


def _place(mesh: BlendshapeMesh, standard: FaceMesh) -> PlacedMesh:
    """Lay it on the standard's head, and keep head and shoulders."""
    carried, joint = mesh.bones[HEAD].weight > MIN_WEIGHT, mesh.bones[HEAD].joint
    height = float((mesh.vertices[carried] - joint).max(axis=0)[1])
    if not height > 0:
        raise DataError("bones: got nothing of the head above its joint, expected a head with y up")
    axes = _axes(mesh)
    wanted = float(standard.vertices_mm[standard.head_weight > MIN_WEIGHT, 1].max() - standard.head_pivot_mm[1])
    scale = wanted / height
    vertices = scale * (mesh.vertices - joint) @ axes.T + standard.head_pivot_mm
    chin = standard.point_mm(CHIN)
    inside = (vertices[:, 1] > chin[1] - KEPT_BELOW_CHIN_MM) & (np.abs(vertices[:, 0]) < KEPT_BESIDE_MM)
    kept, corners = np.unique(mesh.triangles[inside[mesh.triangles].all(axis=1)], return_inverse=True)
    triangles = corners.reshape(-1, 3).astype(np.int64)
    node, part = find_parts(vertices[kept], triangles)
    nearest = int(np.linalg.norm(vertices[kept] - chin, axis=1).argmin())
    return PlacedMesh(
        source=mesh, vertices_mm=vertices[kept], triangles=triangles, kept=kept.astype(np.int64),
        points={CHIN: nearest}, scale=scale, rotation=axes, node=node, part=part,
    )  # fmt: skip


def _axes(mesh: BlendshapeMesh) -> Array:
    """(3, 3): rows are the subject's left, up and ahead."""
    left = np.array([1.0, 0.0, 0.0])
    if all(eye in mesh.bones for eye in EYES):
        across = (mesh.bones[EYES[0]].joint - mesh.bones[EYES[1]].joint) * (1.0, 0.0, 1.0)
        if np.linalg.norm(across) > 0:
            left = across / np.linalg.norm(across)
    return np.stack([left, UP, np.cross(left, UP)])


def _bones(moving: Mapping[str, Array], count: int) -> tuple[NDArray[np.uint8], Array]:
    """(V,) bone and (V,) weight: each vertex goes with the one that takes most of it."""
    bone, weight = np.zeros(count, np.uint8), np.zeros(count)
    kinds = {JAW: Bone.JAW, EYES[0]: Bone.LEFT_EYE, EYES[1]: Bone.RIGHT_EYE}
    for name, share in moving.items():
        more = share > weight
        bone[more], weight[more] = kinds[name], share[more]
    return bone, np.clip(weight, 0.0, 1.0)


def _colours(placed: PlacedMesh, material: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(V, 3) linear RGB: the file's colours; where it says none, those of what a surface's name tells, else of skin."""
    source = placed.source
    albedo = None if source.albedo is None else source.albedo[placed.kept]
    if albedo is not None and (source.texture is not None or np.ptp(albedo, axis=0).max(initial=0.0) > 0):
        return np.asarray(np.clip(albedo, 0, 1), np.float32)
    painted = np.array(Palette.of().skin(placed.vertices_mm))
    for kind, colour in {**surfaces.PAINTS, Material.TEETH: TEETH}.items():
        painted[material == kind] = colour
    return np.asarray(np.clip(painted, 0, 1), np.float32)
