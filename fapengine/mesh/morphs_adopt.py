"""Anybody's head with morph targets: its own shapes, blended so that each FAP moves its own point and no other.

The mesh is laid onto the standard's face by its feature points, as :mod:`fapengine.mesh.adopted` does with any mesh;
what lies far below the chin is left out. Eyes turn by the rig's bones or about their balls; the jaw goes by the shapes
that open it, or by its bone; the neck follows the head as its skin weights say.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.adopted import (
    BONE_FAPS,
    CHIN,
    NECK_MM,
    Adopted,
    bind_bones,
    boneless,
    continued,
    move_tongue,
    point_fields,
    with_followers,
)
from fapengine.mesh.adopted_parts import (
    Eyes,
    check,
    find_eyes,
    followers,
    iris_plane,
    measure,
    occlusion,
    paint,
    parts,
    place,
    smooth_normals,
)
from fapengine.mesh.face_mesh import Bone, FaceMesh, Material
from fapengine.mesh.morphs import MorphMesh
from fapengine.mesh.morphs_basis import JAW_FAPS, Mixer, Rig, add_shapes, coordinates
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KEPT_BELOW_MM = 190.0
"""Below the chin, what is kept: neck and shoulders."""
KEPT_BESIDE_MM = 320.0
"""From the middle line."""
OPENS_MM = 4.0
"""A shape that carries the chin so far opens the jaw."""
IRIS = 0.93
"""Cosine of the angle, about 22 degrees, at which an iris ends."""
ON_BALL = 0.03
"""Vertices whose distance from the eye's centre differs more are of a lid, a lash or a tear duct."""
PATTERN = 0.15
"""Colours of an eyeball that differ by so much show an iris; one is drawn on others."""
EYE_LIMBS = {"3.5": "left eye", "3.6": "right eye"}
FOLLOWING = ("lash", "brow", "beard", "mustache", "moustache", "stubble")
"""Words in the names of surfaces that go with the skin below them."""
SURFACES = (
    (("tooth", "teeth"), Material.TEETH), (("tongue",), Material.TONGUE), (("gum",), Material.GUM),
    (("lash",), Material.LASH), (("hair", "brow", "beard"), Material.HAIR),
    (("cloth", "shirt", "outfit", "dress", "top", "body_suit"), Material.CLOTH),
)  # fmt: skip
"""Words in the names of surfaces that say what they are made of."""


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """The kept part of a mesh, on the standard's face."""

    place: Array
    triangles: Indices
    moves: Array
    """(B, V, 3) mm."""
    kept: Indices
    """Of the source's vertices."""
    points: dict[str, int]
    scale: float
    rotation: Array


def adopt_morphs(
    mesh: MorphMesh,
    shapes: Sequence[str],
    points: Mapping[str, int],
    standard: FaceMesh,
    given: Mapping[str, Mapping[int, float]] | None = None,
) -> Adopted:
    """Make a head of a mesh with shapes.

    Parameters
    ----------
    mesh : MorphMesh
    shapes : sequence of str
        Which of its shapes to blend; with none, the fields of its feature points do all. Shapes of gaze do not
        belong here: eyes turn.
    points : mapping of str to int
        Vertex of each feature point, by hand or from :func:`fapengine.mesh.morphs_locate.locate`.
    standard : FaceMesh
        Gives scale and axes, and what a face without that point has.
    given : mapping of str to FAPs, optional
        Further shapes that mean FAPs by themselves: FAP number to FAPU at full weight, not 0.

    Raises
    ------
    DataError
        As :func:`fapengine.mesh.adopted.adopt`; or if a shape is not there.
    """
    alone = dict(given or {})
    shapes = [name for name in shapes if name not in alone]
    unknown = [name for name in (*shapes, *alone) if name not in mesh.shapes]
    if unknown:
        raise DataError(f"shapes: got {unknown[:3]}, expected some of {', '.join(list(mesh.shapes)[:12])}")
    check(points, len(mesh.vertices), mesh.triangles)
    laid = _lay(mesh, [*shapes, *alone], points, standard)
    at = {name: laid.place[index] for name, index in laid.points.items()}
    node, part = parts(laid.place, laid.triangles)
    notes: list[str] = list(mesh.notes)
    fapu = measure(at, standard, notes)
    skin = np.flatnonzero(part == part[laid.points["8.1"]])
    eyes = _eyes(mesh, laid, part, at, skin)
    for ball, _ in eyes.values():
        laid.moves[:, ball] = 0.0
    chin = laid.points["2.1"]
    jaw_moves = bool(np.linalg.norm(laid.moves[:, chin], axis=1).max(initial=0.0) > OPENS_MM)
    on_skin = {name: index for name, index in laid.points.items() if part[index] == part[laid.points["8.1"]]}
    fields = point_fields(laid.place, laid.triangles, node, skin, on_skin)
    with_chin = np.array([[float(name in CHIN)] for name in on_skin])
    jaw = np.clip(continued(laid.place, laid.triangles, node, skin, on_skin, with_chin)[:, 0], 0.0, 1.0)
    called = np.flatnonzero(mesh.named(FOLLOWING)[laid.kept])
    hangers, nearest = followers(laid.place, part, at, skin, eyes, called)
    covered, fields = with_followers(skin, fields, hangers, nearest)
    meant = [*[None] * len(shapes), *alone.values()]
    rig = Rig(laid.place, laid.moves, covered, fields, np.concatenate([jaw, jaw[nearest]]), chin, eyes, meant)
    asked = coordinates(on_skin, jaw_moves)
    mixer = Mixer(len(laid.place))
    add_shapes(mixer, rig, asked, fapu)
    moved = [one.number for one in asked] + [number for faps in alone.values() for number in faps]
    moved += move_tongue(mixer.one, laid.place, part, laid.points, at, fapu, without=moved)
    bone, weight = bind_bones(laid.place, part, laid.points, skin, on_skin, at, eyes, laid.triangles, node)
    bone[hangers], weight[hangers] = bone[skin[nearest]], weight[skin[nearest]]
    pivot = standard.jaw_pivot_mm
    if jaw_moves:
        _free_from_jaw(laid, bone, weight, covered)
    elif "jaw" in mesh.limbs:
        limb = mesh.limbs["jaw"]
        bone[:] = np.where((bone == Bone.JAW) | (bone == Bone.NONE), Bone.JAW, bone)
        weight = np.where(bone == Bone.JAW, limb.weight[laid.kept], weight)
        pivot = _there(limb.joint, mesh, laid)
    face = _finish(mesh, laid, standard, at, node, skin, eyes, bone, weight, pivot, mixer, fapu)
    reached = set(moved) | {number for number in BONE_FAPS if number not in boneless(eyes)}
    if not jaw_moves and not (face.bone == Bone.JAW).any():
        reached -= set(JAW_FAPS)
    missing = tuple(row.number for row in fap.FAPS if row.number > 2 and row.number not in reached)
    used = (*shapes, *alone)
    unused = tuple(name for name in mesh.shapes if name not in set(used))
    return Adopted(face, tuple(sorted(reached)), missing, laid.scale, tuple(notes), used, unused)


def _lay(mesh: MorphMesh, shapes: Sequence[str], points: Mapping[str, int], standard: FaceMesh) -> _Placed:
    """Lay the mesh onto the standard's face and leave out what is far from it."""
    placed, scale, rotation = place(mesh.vertices, points, standard)
    chin = placed[points["2.1"]]
    inside = (placed[:, 1] > chin[1] - KEPT_BELOW_MM) & (np.abs(placed[:, 0] - chin[0]) < KEPT_BESIDE_MM)
    triangles = mesh.triangles[inside[mesh.triangles].all(axis=1)]
    kept, numbered = np.unique(triangles, return_inverse=True)
    lost = [name for name, index in points.items() if index not in set(kept.tolist())]
    if any(name in ("8.1", "8.2", "8.3", "8.4", "2.1") for name in lost):
        raise DataError(f"feature points: got {', '.join(lost)} far from the face")
    moves = np.zeros((len(shapes), len(kept), 3))
    for number, name in enumerate(shapes):
        shape = mesh.shapes[name]
        where = np.searchsorted(kept, shape.vertices).clip(max=len(kept) - 1)
        mine = kept[where] == shape.vertices
        moves[number, where[mine]] = scale * shape.moves[mine] @ rotation.T
    return _Placed(
        placed[kept], numbered.reshape(-1, 3).astype(np.int64), moves, kept.astype(np.int64),
        {name: int(np.searchsorted(kept, index)) for name, index in points.items() if name not in lost},
        scale, rotation,
    )  # fmt: skip


def _there(place_in_file: Array, mesh: MorphMesh, laid: _Placed) -> Array:
    """Where a place of the file lies on the standard's face."""
    there: Array = laid.place[0] + laid.scale * (place_in_file - mesh.vertices[laid.kept[0]]) @ laid.rotation.T
    return there


def _eyes(mesh: MorphMesh, laid: _Placed, part: Indices, at: Mapping[str, Array], skin: Indices) -> Eyes:
    """Eyeballs by their bones, else by their shape."""
    eyes = find_eyes(laid.place, part, laid.points, at, skin)
    for pupil, name in EYE_LIMBS.items():
        if name in mesh.limbs:
            ball = np.flatnonzero(mesh.limbs[name].weight[laid.kept] > 0.5)
            if len(ball):
                eyes[pupil] = (ball, _there(mesh.limbs[name].joint, mesh, laid))
    return eyes


def _free_from_jaw(laid: _Placed, bone: NDArray[np.uint8], weight: Array, skin: Indices) -> None:
    """Leave to the jaw's bone only what no shape moves."""
    carried = np.linalg.norm(laid.moves, axis=2).max(axis=0) > 1.0
    carried[skin] = True
    free = carried & (bone == Bone.JAW)
    bone[free], weight[free] = Bone.NONE, 0.0


def _finish(
    mesh: MorphMesh, laid: _Placed, standard: FaceMesh, at: Mapping[str, Array], node: Indices, skin: Indices,
    eyes: Eyes, bone: NDArray[np.uint8], weight: Array, jaw_pivot: Array, mixer: Mixer, fapu: Fapu,
) -> FaceMesh:  # fmt: skip
    """Put together what the renderer takes."""
    normals = smooth_normals(laid.place, laid.triangles, node)
    head = mesh.limbs.get("head")
    follows = np.asarray(smoothstep((laid.place[:, 1] - at["2.1"][1] + sum(NECK_MM)) / NECK_MM[1]), np.float64)
    pivot = np.asarray(at.get("7.1", standard.head_pivot_mm), np.float64)
    if head is not None and (head.weight[laid.kept] > 0).any() and (head.weight[laid.kept] < 1).any():
        follows = head.weight[laid.kept]
        pivot = _there(head.joint, mesh, laid)
    coloured = mesh.texture is not None or _painted(mesh)
    uv = mesh.uv[laid.kept] if mesh.uv is not None and coloured else np.zeros((len(laid.kept), 2))
    blank = {pupil: eye for pupil, eye in eyes.items() if len(eye[0]) and not _has_iris(mesh, laid, eye)}
    for ball, _ in blank.values():
        uv[ball] = iris_plane(laid.place, blank)[ball]
    material = _materials(mesh, laid, eyes, blank)
    albedo = mesh.albedo[laid.kept] if mesh.albedo is not None and coloured else None
    centres = [
        eyes[name][1] if name in eyes else standard.eye_pivots_mm[index] for index, name in enumerate(("3.5", "3.6"))
    ]
    return FaceMesh(
        vertices_mm=laid.place.astype(np.float32),
        normals=normals.astype(np.float32),
        uv=uv.astype(np.float32),
        albedo=paint(laid.place, albedo, at, skin, laid.triangles, material),
        material=material,
        occlusion=occlusion(laid.place, normals, laid.triangles, material),
        bone=bone,
        bone_weight=np.clip(weight, 0.0, 1.0).astype(np.float32),
        head_weight=follows.astype(np.float32),
        triangles=laid.triangles.astype(np.int32),
        feature_points=laid.points,
        jaw_pivot_mm=jaw_pivot,
        head_pivot_mm=pivot,
        eye_pivots_mm=np.stack(centres),
        fapu=fapu,
        basis=mixer.basis(),
        texture=mesh.texture,
    )


def _painted(mesh: MorphMesh) -> bool:
    """Whether the file's colours say more than one default for all."""
    return mesh.albedo is not None and len(mesh.albedo) > 0 and bool(np.ptp(mesh.albedo, axis=0).max() > 0.0)


def _has_iris(mesh: MorphMesh, laid: _Placed, eye: tuple[Indices, Array]) -> bool:
    """Whether an eyeball's own colours differ between its front and what is round it."""
    ball = laid.kept[eye[0]]
    arm = laid.place[eye[0]] - eye[1]
    radius = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
    ahead = np.where(np.abs(radius / np.median(radius) - 1.0) < ON_BALL, arm[:, 2] / radius, -1.0)
    iris, white = ahead > IRIS, (ahead < IRIS) & (ahead > 0.5)
    colours = np.ones((len(ball), 3)) if mesh.albedo is None else mesh.albedo[ball]
    if mesh.texture is not None and mesh.uv is not None:
        height, width = mesh.texture.shape[:2]
        column, row = (mesh.uv[ball] * (width, height)).astype(int).clip(0, (width - 1, height - 1)).T
        colours = colours * mesh.texture[row, column, :3] / 255.0
    if not iris.any() or not white.any():
        return bool(np.ptp(colours, axis=0).max(initial=0.0) > PATTERN)
    return bool(np.abs(colours[iris].mean(axis=0) - colours[white].mean(axis=0)).max() > PATTERN)


def _materials(mesh: MorphMesh, laid: _Placed, eyes: Eyes, blank: Eyes) -> NDArray[np.uint8]:
    material = np.full(len(laid.kept), Material.SKIN, np.uint8)
    for words, kind in SURFACES:
        material[mesh.named(words)[laid.kept]] = kind
    for pupil, (ball, _) in eyes.items():
        material[ball] = Material.EYE if pupil in blank else Material.BALL
    return material
