"""A head for other programs: parts with materials, named shapes, and a few joints.

Theory of operation
-------------------
FAPs deform a :class:`~fapengine.mesh.face_mesh.FaceMesh` by channels and bones; other programs use blendshapes and
skins. So the FAPs of each shape are applied to the head and the displacements stored: ARKit's 52 and Oculus' 15
visemes, jaw and eyeballs included, as usual for avatars. Moving the shapes alone gives the whole face.

The joints are additional: ``Head`` on ``Neck``, and on it ``Jaw``, ``LeftEye`` and ``RightEye``. A vertex that turns
partly with the jaw and partly with the head gets the jaw's weight, the rest of the head's weight, and the remainder for
the neck; for one rotation at a time this is exact. A head on a body (:mod:`.skeleton`) stands on the ground, and the
chest moves what lies below the neck.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, freeze
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import PUPIL_SHARE, Bone, FaceMesh, Material, iris_share
from fapengine.retarget.rig_weights import OCULUS, OCULUS_SPELLINGS
from fapengine.retarget.skeleton import CHEST, FACE, Joint, arkit_shapes, face_joints, on_body, rest_matrices
from fapengine.retarget.visemes import oculus_map

METRES_PER_MM = 1e-3
NECK, HEAD, JAW, LEFT_EYE, RIGHT_EYE = range(5)
JOINTS = tuple(FACE)
"""Names of the head's own joints."""
BONES = {"head": HEAD, "jaw": JAW, "left eye": LEFT_EYE, "right eye": RIGHT_EYE}
PARTS: Mapping[str, tuple[float, tuple[Material, ...]]] = {
    "Face": (0.5, (Material.SKIN, Material.LIP)),
    "Eyes": (0.08, (Material.EYE, Material.BALL)),
    "Teeth": (0.25, (Material.TEETH, Material.GUM)),
    "Tongue": (0.35, (Material.TONGUE,)),
    "Mouth": (0.6, (Material.MOUTH,)),
    "Hair": (0.65, (Material.HAIR,)),
    "Brows": (0.8, (Material.STRAND, Material.LASH)),
    "Clothes": (0.9, (Material.CLOTH,)),
}
"""Roughness and materials of each part."""
DOUBLE_SIDED = ("Hair", "Brows")
INSIDE = ("Teeth", "Tongue", "Mouth")
"""Parts with the mouth's ambient occlusion baked into their colours, as other programs do not have it."""
NEGLIGIBLE_MM, NEGLIGIBLE_TURN = 0.02, 0.01
"""Displacement, and change of a normal, below which a shape skips a vertex."""
COLLAR_M = (-0.04, 0.04)
"""Height over the neck's joint up to which the chest of a body moves a still vertex, and from which the neck does."""
TOES, SPECK_M = ("LeftToeBase", "RightToeBase"), 1e-4
EYE_TEXELS = 256
SCLERA, VEINS = np.array([0.72, 0.67, 0.64]), np.array([0.92, 0.68, 0.62])


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Displacements of a part's vertices by one shape at full weight. Arrays are read-only."""

    moves: NDArray[np.float32]
    """(V, 3), m."""
    turns: NDArray[np.float32]
    """(V, 3): change of the normals."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """A piece of a head of one material. Arrays are read-only."""

    name: str
    vertices: NDArray[np.float32]
    """(V, 3), m; x the subject's left, y up, z forward."""
    normals: NDArray[np.float32]
    """(V, 3), of unit length."""
    uv: NDArray[np.float32]
    """(V, 2); (0, 0) is the texture's top left corner."""
    colours: NDArray[np.float32]
    """(V, 3), linear RGB, 0..1; multiplies the texture."""
    triangles: NDArray[np.uint32]
    """(F, 3)."""
    weights: NDArray[np.float32]
    """(V, J): weights of the first joints of the skeleton, at least :data:`JOINTS`; each row adds up to 1."""
    shapes: Mapping[str, Shape]
    """Shapes that move this part, by their names."""
    texture: NDArray[np.uint8] | None
    """(H, W, 3 or 4), sRGB."""
    roughness: float

    def __post_init__(self) -> None:
        three = ("V", 3)
        freeze(self, np.float32, vertices=three, normals=three, uv=("V", 2), colours=three, weights=("V", "J"))
        freeze(self, np.uint32, triangles=("F", 3))

    def influences(self) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Joints and weights, (V, 4) each, of the four joints that move each vertex most; weights add up to 1."""
        order = np.argsort(-self.weights, axis=1, kind="stable")[:, :4]
        weights = np.take_along_axis(self.weights, order, axis=1)
        return order, weights / weights.sum(axis=1, keepdims=True)


@dataclass(frozen=True, slots=True, eq=False)
class Puppet:
    """A head for other programs."""

    parts: tuple[Part, ...]
    skeleton: tuple[Joint, ...]
    """Its joints; the first are :data:`JOINTS`."""

    @property
    def joints(self) -> Array:
        """(J, 3), m: position of each joint."""
        return rest_matrices(self.skeleton)[:, :3, 3]

    def on_body(self) -> "Puppet":
        """Put the head on a body of joints that stands on the ground."""
        names = [joint.name for joint in self.skeleton]
        body = on_body(self.skeleton)
        chest = [joint.name for joint in body].index(CHEST)
        up = rest_matrices(body)[NECK, :3, 3] - self.joints[NECK]
        low, high = self.joints[NECK, 1] + np.array(COLLAR_M)
        parts = []
        for part in self.parts:
            weights = np.zeros((len(part.vertices), chest + 1), np.float32)
            weights[:, : len(names)] = part.weights
            lower = np.clip((high - part.vertices[:, 1]) / (high - low), 0.0, 1.0)
            weights[:, chest] = lower * part.weights[:, NECK]
            weights[:, NECK] -= weights[:, chest]
            parts.append(replace(part, vertices=(part.vertices + up).astype(np.float32), weights=weights))
        return Puppet((*parts, _feet(body)), body)


def _feet(body: tuple[Joint, ...]) -> Part:
    """A speck on the ground below each toe joint: TalkingHead puts the lowest point of all meshes on the ground."""
    toes = [number for number, joint in enumerate(body) if joint.name in TOES]
    corners = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) * SPECK_M
    below = rest_matrices(body)[toes, :3, 3] * (1.0, 0.0, 1.0)
    weights = np.zeros((6, len(body)), np.float32)
    weights[np.arange(6), np.repeat(toes, 3)] = 1.0
    return Part(
        name="Feet",
        vertices=(below[:, None] + corners).reshape(-1, 3).astype(np.float32),
        normals=np.tile(np.array([0.0, 1.0, 0.0], np.float32), (6, 1)),
        uv=np.zeros((6, 2), np.float32),
        colours=np.ones((6, 3), np.float32),
        triangles=np.arange(6, dtype=np.uint32).reshape(2, 3),
        weights=weights,
        shapes={},
        texture=None,
        roughness=0.9,
    )


def make_puppet(
    mesh: FaceMesh,
    modes_mm: Mapping[str, NDArray[np.float32]] | None = None,
    shape_faps: Mapping[str, Array] | None = None,
) -> Puppet:
    """Convert a head, built-in or imported.

    ``modes_mm`` and ``shape_faps`` are further shapes: displacements of the vertices at full weight, (V, 3) each, and
    (68,) FAPU.
    """
    rest = _narrowed(mesh)
    normals = vertex_normals(rest, mesh.triangles)
    moved = {}
    for name, moves in _displacements(mesh, modes_mm or {}, _shape_faps() | dict(shape_faps or {})):
        moves[np.abs(moves).max(axis=1) < NEGLIGIBLE_MM] = 0.0
        turns = vertex_normals(rest + moves, mesh.triangles) - normals
        turns[~moves.any(axis=1) | (np.abs(turns).max(axis=1) < NEGLIGIBLE_TURN)] = 0.0
        moved[name] = Shape((METRES_PER_MM * moves).astype(np.float32), turns.astype(np.float32))
    parts = [_part(mesh, name, rest, moved) for name in PARTS]
    neck = np.array([0.0, float(mesh.point_mm("2.1")[1]) - 90.0, float(mesh.head_pivot_mm[2])])
    joints = np.stack([neck, mesh.head_pivot_mm, mesh.jaw_pivot_mm, *mesh.eye_pivots_mm])
    return Puppet(tuple(part for part in parts if part is not None), face_joints(METRES_PER_MM * joints))


def _displacements(
    mesh: FaceMesh, modes_mm: Mapping[str, NDArray[np.float32]], shape_faps: Mapping[str, Array]
) -> Iterator[tuple[str, Array]]:
    """Name of each shape and the displacement of all vertices, (V, 3) mm: those of FAPs, then the modes."""
    for name, faps in shape_faps.items():
        yield name, deform(mesh, faps) - mesh.vertices_mm
    for name, moves in modes_mm.items():
        yield name, np.array(moves, np.float64)


@cache
def _shape_faps() -> dict[str, Array]:
    """(68,) FAPU of each shape at full weight: ARKit's 52, then the visemes in the spelling of avatars."""
    oculus = oculus_map()
    visemes = {OCULUS_SPELLINGS[name.lower()]: row for name, row in zip(oculus.names, oculus.faps, strict=True)}
    return arkit_shapes() | {f"viseme_{name}": visemes.get(name, np.zeros(68)) for name in OCULUS}


def _part(mesh: FaceMesh, name: str, rest: Array, moved: Mapping[str, Shape]) -> Part | None:
    """Cut out one part; None if the head has none."""
    roughness, materials = PARTS[name]
    triangles = mesh.triangles[np.isin(mesh.material[mesh.triangles[:, 0]], materials)]
    if not len(triangles):
        return None
    used, corners = np.unique(triangles, return_inverse=True)
    colours = mesh.albedo[used].astype(np.float64)
    if name in INSIDE:
        colours *= mesh.occlusion[used, None]
    texture = mesh.texture
    if Material.STRAND in mesh.material[used]:
        texture = None  # texture coordinates of strands are their widths
    elif Material.EYE in mesh.material[used]:
        texture = eye_texture(mesh)
    return Part(
        name=name,
        vertices=(METRES_PER_MM * rest[used]).astype(np.float32),
        normals=_unit(mesh.normals[used]),
        uv=mesh.uv[used],
        colours=np.clip(colours, 0.0, 1.0).astype(np.float32),
        triangles=corners.reshape(-1, 3).astype(np.uint32),
        weights=_weights(mesh)[used],
        shapes={
            title: Shape(shape.moves[used], shape.turns[used])
            for title, shape in moved.items()
            if shape.moves[used].any() or (title == "viseme_sil" and name == "Face")
        },
        texture=texture,
        roughness=roughness,
    )


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0]).astype(np.float32)


def _narrowed(mesh: FaceMesh) -> Array:
    """(V, 3) mm: vertices, with ribbons of single hairs as narrow as the hairs.

    Both vertices at a point of a hair are adjacent, in the order of the built-in heads.
    """
    vertices = mesh.vertices_mm.astype(np.float64)
    pairs = np.flatnonzero(mesh.material == Material.STRAND).reshape(-1, 2)
    middle = vertices[pairs].mean(axis=1, keepdims=True)
    off = vertices[pairs] - middle
    scale = mesh.uv[pairs][..., 1:] / np.maximum(np.linalg.norm(off, axis=-1, keepdims=True), 1e-6)
    vertices[pairs] = middle + scale * off
    return vertices


def _weights(mesh: FaceMesh) -> NDArray[np.float32]:
    """(V, 5): weights of the joints."""
    weights = np.zeros((len(mesh.vertices_mm), len(JOINTS)), np.float32)
    for bone, joint in ((Bone.JAW, JAW), (Bone.LEFT_EYE, LEFT_EYE), (Bone.RIGHT_EYE, RIGHT_EYE)):
        weights[:, joint] = np.where(mesh.bone == bone, np.minimum(mesh.bone_weight, mesh.head_weight), 0.0)
    weights[:, HEAD] = mesh.head_weight - weights.sum(axis=1)
    weights[:, NECK] = 1.0 - weights.sum(axis=1)
    return np.clip(weights, 0.0, 1.0)


def eye_texture(mesh: FaceMesh) -> NDArray[np.uint8]:
    """(256, 256, 3) sRGB: white, iris and pupil as seen along the gaze, as drawn by the eye shader."""
    axis = (np.arange(EYE_TEXELS) + 0.5) / EYE_TEXELS * 2 - 1
    x, y = np.meshgrid(axis, axis)
    radius, around = np.hypot(x, y), np.arctan2(y, x)
    iris = iris_share(mesh)
    pupil = iris * PUPIL_SHARE
    share = radius / iris
    fibres = 0.5 + 0.5 * np.sin(around * 37 + 3 * np.sin(around * 11)) * np.sin(around * 23 + share * 9)
    light = (1 - 0.68 * _step(0.35, 0.92, share)) * (0.72 + 0.56 * fibres)
    light *= 1 + 0.85 * _step(-0.15, 0.9, -y / iris)
    light *= 1 - 0.85 * _step(0.74, 1.0, share)
    ring = _step(pupil - 0.02, pupil + 0.02, radius)[..., None]
    coloured = 0.003 * (1 - ring) + mesh.iris_albedo * light[..., None] * ring
    white = SCLERA * (1 + (VEINS - 1) * _step(0.35, 0.95, np.abs(x))[..., None])
    outer = _step(iris - 0.045, iris + 0.035, radius)[..., None]
    linear = np.clip(coloured * (1 - outer) + white * outer, 0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * srgb), np.uint8)


def _step(first: float, last: float, at: Array) -> Array:
    fraction = np.clip((at - first) / (last - first), 0.0, 1.0)
    return np.asarray(fraction * fraction * (3 - 2 * fraction))
