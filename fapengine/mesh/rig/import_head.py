"""Heads from meshes: each FAP moves its own point only, by blendshapes or fields; or bones alone move them.

The mesh is aligned with the standard's face (:mod:`~fapengine.mesh.rig.placed_mesh`); eyes and followers of the skin
are found, and the skin gets a field for each feature point (:mod:`~fapengine.mesh.rig.parts`); blendshapes, fields and
lids become a basis (:mod:`~fapengine.mesh.rig.blendshape_basis`); the rest moves by bones
(:mod:`~fapengine.mesh.rig.bones`). A mesh without blendshapes is moved by its fields and bones.

Without blendshapes and feature points the position of the lips is unknown, and :func:`head_of_bones` aligns the mesh by
its bones: the head's joint is the pivot, up is the scene's y, the face looks where the eyes are relative to the joint
(else along z, as in glTF), and the height above the joint is the standard's. It nods and turns, and jaw and eyes move
if they have bones; lips and brows do not.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError, UsageError
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.face_mesh import Bone, Channel, DeformationBasis, FaceMesh
from fapengine.mesh.rig import parts
from fapengine.mesh.rig.blendshape_basis import ROW_FAPU, SHUT, Rig, RowCollector, build_basis
from fapengine.mesh.rig.blendshape_mesh import HEAD, MIN_WEIGHT, BlendshapeMesh, can_follow_bones
from fapengine.mesh.rig.bones import EYE_SIDES, Bones, bind_bones
from fapengine.mesh.rig.parts import Eyeball, Eyes, find_eyes, fit_point_fields
from fapengine.mesh.rig.placed_mesh import PlacedMesh, cut_out, place_mesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu


@dataclass(frozen=True, slots=True, eq=False)
class ImportedHead:
    """A head made from a mesh."""

    mesh: FaceMesh
    moved: tuple[int, ...]
    """FAPs that move it."""
    missing: tuple[int, ...]
    """Low-level FAPs that do not, because their point is unknown."""
    scale: float
    """Millimetres of the standard's face for one unit of the file."""
    notes: tuple[str, ...]
    """Sentences about parts that were left out or replaced."""
    used: tuple[str, ...]
    """Blendshapes of the file that FAPs blend."""
    unused: tuple[str, ...]
    """Blendshapes of the file that no FAP blends."""
    placed: PlacedMesh
    """The mesh aligned with the standard's face."""


def import_head(
    mesh: BlendshapeMesh,
    blendshapes: Sequence[str],
    points: Mapping[str, int],
    standard: FaceMesh,
    own_faps: Mapping[str, Mapping[int, float]] | None = None,
) -> ImportedHead:
    """Make a head from a mesh.

    Parameters
    ----------
    mesh : BlendshapeMesh
    blendshapes : sequence of str
        Names of those to blend; without any, the fields of the feature points do everything. Leave out blendshapes of
        gaze: the eyes are bones.
    points : mapping of str to int
        Vertex of each feature point, set by hand or from :func:`fapengine.mesh.rig.feature_points.locate`.
    standard : FaceMesh
        Defines scale and axes, and replaces missing points.
    own_faps : mapping of str to FAPs, optional
        Further blendshapes with their own FAPs: FAP number to FAPU at full weight, not 0.

    Raises
    ------
    DataError
        As :func:`fapengine.mesh.rig.placed_mesh.place_mesh`; or if a blendshape does not exist.
    """
    own_faps = own_faps or {}
    chosen = {name: None for name in blendshapes if name not in own_faps} | dict(own_faps)
    unknown = [name for name in chosen if name not in mesh.blendshapes]
    if unknown:
        raise DataError(f"blendshapes: got {unknown[:3]}, expected some of {', '.join(list(mesh.blendshapes)[:12])}")
    placed = place_mesh(mesh, points, standard)
    rig = _make_rig(placed, chosen)
    fapu, notes = _measure(placed, standard)
    closing, closed = _close_mouth(rig)
    basis, moved = build_basis(rig, fapu)
    bones = bind_bones(placed, rig.fields, rig.eyes, rig.carried_mm, rig.opens_jaw, standard)
    reached = set(moved) | bones.reached(rig.eyes, rig.opens_jaw)
    blank = parts.blank_eyes(placed, rig.eyes)
    head = _make_mesh(placed, rig.eyes, blank, bones, fapu, basis)
    head = replace(head, vertices_mm=(placed.vertices_mm + closing).astype(np.float32))
    return _head(head, placed, reached, [*notes, *closed], chosen)


def _head(
    mesh: FaceMesh, placed: PlacedMesh, reached: Collection[int], notes: Sequence[str], used: Collection[str]
) -> ImportedHead:
    return ImportedHead(
        mesh=mesh,
        moved=tuple(sorted(reached)),
        missing=tuple(row.number for row in fap.FAPS if row.number > 2 and row.number not in reached),
        scale=placed.scale,
        notes=(*placed.source.notes, *notes),
        used=tuple(used),
        unused=tuple(name for name in placed.source.blendshapes if name not in used),
        placed=placed,
    )


def _make_rig(mesh: PlacedMesh, chosen: Mapping[str, Mapping[int, float] | None]) -> Rig:
    """Collect the moving parts of the mesh; eyeballs turn, and no blendshape moves them."""
    eyes = find_eyes(mesh)
    moves = np.zeros((len(chosen), len(mesh.kept), 3))
    for row, name in zip(moves, chosen, strict=True):
        blendshape = mesh.source.blendshapes[name]
        index = np.searchsorted(mesh.kept, blendshape.vertices).clip(max=len(mesh.kept) - 1)
        kept = mesh.kept[index] == blendshape.vertices
        row[index[kept]] = mesh.turned(blendshape.moves[kept])
    for eye in eyes.values():
        moves[:, eye.vertices] = 0.0
    fields = fit_point_fields(mesh, eyes)
    return Rig(mesh=mesh, moves=moves, own_faps=tuple(chosen.values()), fields=fields, eyes=eyes)


PLAUSIBLE_FAPU = {"ens0_mm": (0.4, 1.1), "mns0_mm": (0.22, 0.5), "mw0_mm": (0.4, 1.3)}
"""Bounds of the neutral face's distances, relative to that of the eyes (ES0). Between mouth and nose our head has 0.34,
four avatars of Ready Player Me 0.27 to 0.36, and one of VRoid, whose nose has no base, 0.20. The others are wide.
"""


def _measure(mesh: PlacedMesh, standard: FaceMesh) -> tuple[Fapu, list[str]]:
    """Measure the units of the face; without their points, and out of bounds, it gets the standard's, and notes."""
    positions = mesh.positions
    try:
        measured, notes = Fapu.measure(positions), []
    except UsageError as error:
        measured = replace(standard.fapu, mw0_mm=float(positions["8.3"][0] - positions["8.4"][0]))
        notes = [f"FAPU: {error}; used are those of the standard face with the width of this mouth"]
    for name, (low, high) in PLAUSIBLE_FAPU.items():
        length, eyes = getattr(measured, name), measured.es0_mm
        if not low <= length / eyes <= high:
            expected = eyes * getattr(standard.fapu, name) / standard.fapu.es0_mm
            unit = name.removesuffix("_mm").upper()
            notes.append(
                f"FAPU: {unit} is {length:.1f} mm, expected {low * eyes:.0f} to {high * eyes:.0f} mm between eyes"
                f" {eyes:.0f} mm apart; used is {expected:.1f} mm, as on the standard face"
            )
            measured = replace(measured, **{name: expected})
    return measured, notes


MAX_REST_GAP_MM = (0.3, 4.0)
"""Gap between the inner lips at rest from which, and up to which, the mouth is closed."""
LIP_PAIRS = (("2.2", "2.3"), ("2.6", "2.8"), ("2.7", "2.9"))
"""Feature points of the inner upper and lower lip: middle, left and right."""


def _close_mouth(rig: Rig) -> tuple[Array, list[str]]:
    """(V, 3) mm, and a note: motion that joins lips apart at rest, because a neutral face has them closed."""
    mesh, points, fields = rig.mesh, rig.mesh.points, rig.fields
    moves = np.zeros((len(mesh.kept), 3))
    gaps = [
        float(mesh.vertices_mm[points[upper], 1] - mesh.vertices_mm[points[lower], 1])
        if {upper, lower} <= set(fields.points) else 0.0
        for upper, lower in LIP_PAIRS
    ]  # fmt: skip
    if not MAX_REST_GAP_MM[0] < gaps[0] < MAX_REST_GAP_MM[1]:
        return moves, []
    for (upper, lower), gap in zip(LIP_PAIRS, np.clip(gaps, 0.0, gaps[0]), strict=True):
        if gap:
            moves[fields.vertices, 1] += gap / 2 * (fields.shares[lower] - fields.shares[upper])
    return moves, [f"mouth: the lips were {gaps[0]:.1f} mm apart at rest and are closed, as FAPs expect"]


def _make_mesh(
    placed: PlacedMesh, eyes: Eyes, blank: Eyes, bones: Bones, fapu: Fapu, basis: DeformationBasis
) -> FaceMesh:
    """Assemble the mesh for the renderer; ``blank`` eyes get an iris drawn."""
    normals = parts.smooth_normals(placed)
    material = parts.choose_materials(placed, eyes, blank)
    return FaceMesh(
        vertices_mm=placed.vertices_mm.astype(np.float32),
        normals=normals.astype(np.float32),
        uv=parts.texture_coordinates(placed, blank).astype(np.float32),
        albedo=parts.choose_colours(placed, material),
        material=material,
        occlusion=parts.baked_light(placed, normals, material),
        bone=bones.bone,
        bone_weight=bones.weight.astype(np.float32),
        head_weight=bones.head_weight.astype(np.float32),
        triangles=placed.triangles.astype(np.int32),
        feature_points=placed.points,
        jaw_pivot_mm=bones.jaw_pivot_mm,
        head_pivot_mm=bones.head_pivot_mm,
        eye_pivots_mm=bones.eye_pivots_mm,
        fapu=fapu,
        basis=basis,
        texture=placed.source.texture,
    )


BONES = {"jaw": Bone.JAW, "left eye": Bone.LEFT_EYE, "right eye": Bone.RIGHT_EYE}
"""Bones below the head's, by name."""
CHIN = "2.1"
UP = np.array([0.0, 1.0, 0.0])


def head_of_bones(
    mesh: BlendshapeMesh,
    standard: FaceMesh,
    opener: str | None = None,
    blinks: Mapping[str, Sequence[int]] | None = None,
) -> ImportedHead:
    """Make a head that bones move, and whole shapes; the mesh has y up, and the standard defines size, place and units.

    Parameters
    ----------
    mesh : BlendshapeMesh
    standard : FaceMesh
    opener : str, optional
        Blendshape that opens a mouth whose lips are unknown, as of a drawn one: it follows the opening of the lips.
    blinks : mapping of str to FAPs, optional
        Blendshapes that close lids, and the FAPs of these lids.

    Raises
    ------
    DataError
        If no bone has the vertices of a head, or none of them is above its joint.
    """
    if not can_follow_bones(mesh):
        raise DataError("bones: no head bone has vertices")
    placed = _place(mesh, standard)
    bone, weight = np.zeros(len(placed.kept), np.uint8), np.zeros(len(placed.kept))
    pivots = dict(zip(BONES.values(), (standard.jaw_pivot_mm, *standard.eye_pivots_mm), strict=True))
    moving = {name: mesh.bones[name].weight[placed.kept] for name in BONES if name in mesh.bones}
    moving = {name: share for name, share in moving.items() if (share > MIN_WEIGHT).any()}
    for name, carried in moving.items():
        pivots[BONES[name]] = placed.to_head_space(mesh.bones[name].joint)
        more = carried > weight  # each vertex follows the bone with the largest weight
        bone[more], weight[more] = BONES[name], carried[more]
    bones = Bones(
        bone=bone,
        weight=np.clip(weight, 0.0, 1.0),
        head_weight=mesh.bones[HEAD].weight[placed.kept],
        jaw_pivot_mm=pivots[Bone.JAW],
        head_pivot_mm=placed.to_head_space(mesh.bones[HEAD].joint),
        eye_pivots_mm=np.stack([pivots[Bone.LEFT_EYE], pivots[Bone.RIGHT_EYE]]),
    )
    eyes = {pupil: Eyeball(np.flatnonzero(bone == kind), pivots[kind]) for pupil, kind, _ in EYE_SIDES}
    collector, reached = RowCollector(len(placed.kept)), bones.reached(eyes, jaw_opens=False)
    for name, faps in (blinks or {}).items():
        reached |= set(faps)
        share = 2.0 / len(faps)  # a lid goes its own part of the way, and the other lid the rest
        channels = {collector.channel(Channel(number, 0.0, SHUT)): share * ROW_FAPU / SHUT for number in faps}
        collector.add(np.arange(len(placed.kept)), placed.turned(mesh.dense(name)[placed.kept]), channels)
    moves = ", ".join([HEAD, *moving])
    note = f"no blendshape has a known name: only bones move it ({moves}), the lips do not move"
    if opener is not None:
        reached |= set(LIP_FAPS)
        channels = {collector.channel(Channel(number, -np.inf, np.inf)): -ROW_FAPU / WIDE_FAPU for number in LIP_FAPS}
        collector.add(np.arange(len(placed.kept)), placed.turned(mesh.dense(opener)[placed.kept]), channels)
        note = f"no lips part on the skin: {opener!r} as a whole opens the mouth, and bones move the rest ({moves})"
    used = (*(blinks or {}), *filter(None, [opener]))
    head = _make_mesh(placed, eyes, {}, bones, standard.fapu, collector.basis())
    return _head(head, placed, reached, [note], used)


LIP_FAPS, WIDE_FAPU = (4, 5), 550.0
"""FAPs of the inner lips, and their sum on an ah, at which a shape that opens the mouth has full weight."""


def _place(mesh: BlendshapeMesh, standard: FaceMesh) -> PlacedMesh:
    """Align it with the standard's head, and keep head and shoulders."""
    carried, joint = mesh.bones[HEAD].weight > MIN_WEIGHT, mesh.bones[HEAD].joint
    height = float((mesh.vertices[carried] - joint).max(axis=0)[1])
    if not height > 0:
        raise DataError("bones: no vertex of the head is above its joint, expected a head with y up")
    axes = _axes(mesh)
    wanted = float(standard.vertices_mm[standard.head_weight > MIN_WEIGHT, 1].max() - standard.head_pivot_mm[1])
    scale = wanted / height
    chin = standard.point_mm(CHIN)
    placed = cut_out(mesh, scale * (mesh.vertices - joint) @ axes.T + standard.head_pivot_mm, {}, chin, scale, axes)
    return replace(placed, points={CHIN: int(np.linalg.norm(placed.vertices_mm - chin, axis=1).argmin())})


def _axes(mesh: BlendshapeMesh) -> Array:
    """(3, 3): rows are the subject's left, up and ahead."""
    left = np.array([1.0, 0.0, 0.0])
    if mesh.faces_back:
        left = -left
    if "left eye" in mesh.bones and "right eye" in mesh.bones:
        across = (mesh.bones["left eye"].joint - mesh.bones["right eye"].joint) * (1.0, 0.0, 1.0)
        if across.any():
            left = unit_vectors(across)
    return np.stack([left, UP, np.cross(left, UP)])
