"""A face's motion as an animation in an existing glTF scene, or as a VRM animation in a file of its own.

Theory of operation
-------------------
Nothing else in a scene changes. Morph targets get weights by their names (:mod:`fapengine.retarget.rig_weights`), one
channel for each node that shows them. Bones of head and eyes turn about the face's own axes, ``local = parent' turn
parent rest``; the jaw's bone turns only if no shape opens the mouth, the eyes' only if no shape turns them. What never
moves gets no channel.

A scene's face looks along +z as glTF requires, along -z in VRM 0.x, and otherwise as its eyes show: its left is where
its left eye is.

VRM animations are ``VRMC_vrm_animation`` 1.0, for any VRM avatar: an expression's weight is the x of a node's
translation, the gaze is the rotation of a node at the eyes, and bones are nodes whose rest pose has no rotations.
Presets are VRM's; ``arkit`` writes ARKit's 52 shapes as custom expressions, which avatars with "Perfect Sync" have.
https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError, ResourceError, UnsupportedError
from fapengine.files.gltf import scene
from fapengine.files.gltf.document import (
    BINARY_CHUNK,
    JSON_CHUNK,
    MAGIC,
    MESHOPT,
    Fetch,
    Gltf,
    Item,
    fetch_uri,
    parse_gltf,
    split_glb,
)
from fapengine.files.gltf.writing import Curves, Row, Writer, quaternions_of
from fapengine.geometry.rigid import rotations_about
from fapengine.models.via_points import STRAIGHT
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.rig_weights import Meanings, by_role, is_arkit, plain, rig_weights, viseme
from fapengine.retarget.visemes import SHOWN, VRM1_NAMES, approximate_presets, gaze_of

EYES = ("left eye", "right eye")
MOVED, MOVED_SHARE = 1e-5, 0.2
"""Least displacement of an eyeball by a shape that turns the eye: in the file's unit, and relative to its mesh's."""
MEDIA_TYPES = {"jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp", "ktx2": "image/ktx2"}
"""Media type by a file's ending; others are PNG."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FaceMotion:
    """Motion of a face, for any rig."""

    faps: Array
    """(T, 68) FAPU, T >= 1, one row per frame."""
    turns: Mapping[str, Array]
    """(T, 3, 3) rotations of ``jaw``, ``left eye`` and ``right eye`` in head space (x the subject's left, y up, z
    forward), and of ``head`` in world space."""
    rate_hz: float
    name: str = "face"
    """Title of the animation."""


@dataclass(frozen=True, slots=True)
class Reached:
    """Parts of a rig that a motion moves."""

    shapes: tuple[str, ...]
    """Names of shapes whose weight is not always 0."""
    bones: tuple[str, ...]
    keys: int
    """Number of keys of all curves."""


def add_clip(
    data: bytes, fetch: Fetch, motion: FaceMotion, *, keys: str = STRAIGHT, meanings: Meanings | None = None
) -> tuple[bytes, Reached]:
    """Add an animation to a scene.

    Parameters
    ----------
    data : bytes
        A GLB (also a VRM) or a glTF document.
    fetch : callable
        Reads files that the document names; those of a document that is not a GLB are embedded in the result.
    motion : FaceMotion
    keys : str
        ``"linear"`` or ``"cubic"``: see :func:`fapengine.models.via_points.key_curve`.
    meanings : mapping, optional
        Meaning of shapes with other names.

    Returns
    -------
    bytes
        A GLB. Rows and bytes of a GLB keep their places; new ones follow.
    Reached

    Raises
    ------
    DataError
        If it is not glTF, or contains no shape or bone of a face that is known.
    """
    rig = _Rig.of(parse_gltf(data, fetch, every_extension=False))
    weights, used = _shape_weights(rig, motion, meanings)
    turned = _turned_bones(rig, motion, used)
    if not weights and not turned:
        raise DataError(
            "rig: contains no shape named as in ARKit, Oculus or VRM, and no bone of a head, eye or jaw; say what its"
            " shapes mean (mapping=FILE)"
        )
    writer, others = _opened(data, fetch)
    curves = Curves(writer, motion.rate_hz, keys)
    for node in rig.world:
        if "mesh" in rig.nodes[node]:
            number = rig.gltf.index(rig.nodes[node], "mesh", "meshes")
            if number in weights:
                curves.add(node, "weights", weights[number])
    for bone, node in turned.items():
        row = writer.document["nodes"][node]
        _decompose(row)
        rest = scene.rotation_of(np.array(row.get("rotation", (0.0, 0.0, 0.0, 1.0))))
        curves.add(node, "rotation", rig.local_turns(node, rest, motion.turns[bone]))
    writer.row("animations", curves.row(motion.name))
    return writer.glb(*others), Reached(used, tuple(turned), curves.count)


@dataclass(frozen=True, slots=True, eq=False)
class _Rig:
    """A scene and the nodes of its face."""

    gltf: Gltf
    nodes: list[Item]
    parents: Mapping[int, int]
    world: dict[int, Array]
    """(4, 4) world matrix of each node that is shown."""
    children: list[list[int]]
    bones: Mapping[str, int]

    @classmethod
    def of(cls, gltf: Gltf) -> "_Rig":
        world, children = scene.world_transforms(gltf)
        parents = {child: node for node, below in enumerate(children) for child in below}
        return cls(gltf, gltf.rows["nodes"], parents, world, children, scene.find_bones(gltf, world))

    def local_turns(self, node: int, rest: Array, turns: Array) -> Array:
        """(T, 4) quaternions x y z w of a node, turned by ``rest`` at rest, for rotations in head space, (T, 3, 3)."""
        above = self.world[self.parents[node]][:3, :3] if node in self.parents else np.eye(3)
        outer, facing = scene.nearest_rotation(above), self._facing()
        return quaternions_of(outer.T @ facing @ turns @ facing.T @ outer @ rest)

    def _facing(self) -> Array:
        """(3, 3): from head space to scene space, a multiple of a quarter turn about y."""
        left = np.array([-1.0 if "VRM" in self.gltf.root.item("extensions") else 1.0, 0.0, 0.0])
        if all(eye in self.bones for eye in EYES):
            one, other = (self.world[self.bones[eye]][:3, 3] for eye in EYES)
            apart = (one - other) * (1.0, 0.0, 1.0)
            if np.abs(apart).max() > 0:
                left = np.zeros(3)
                left[np.abs(apart).argmax()] = np.sign(apart[np.abs(apart).argmax()])
        up = np.array([0.0, 1.0, 0.0])
        return np.stack([left, up, np.cross(left, up)], axis=1)


def _shape_weights(
    rig: _Rig, motion: FaceMotion, meanings: Meanings | None
) -> tuple[dict[int, Array], tuple[str, ...]]:
    """Weights of morph targets, (T, targets), by the index of a mesh, and the names of the shapes that move.

    They follow the targets' names if these are ARKit's or the file is not a VRM, else VRM's expressions.
    """
    faps = motion.faps
    titles = [_titles(rig.gltf, mesh) for mesh in rig.gltf.rows["meshes"]]
    bound = scene.bindings(rig.gltf)
    looks = not any(eye in rig.bones for eye in EYES)
    by_mesh = {number: np.zeros((len(faps), len(names))) for number, names in enumerate(titles)}
    used: dict[str, None] = {}
    named = [[name for name in names if name] for names in titles]
    if not bound or is_arkit(by_role([name for names in named for name in names], {})):
        for number, weights in enumerate(rig_weights(named, faps, meanings, looks=looks, rate_hz=motion.rate_hz)):
            for name, weight in weights.items():
                by_mesh[number][:, titles[number].index(name)] = weight
                used |= {name: None} if weight.any() else {}
    else:
        for name, weight in rig_weights([bound], faps, meanings, looks=looks, rate_hz=motion.rate_hz)[0].items():
            for bind in bound[name]:
                by_mesh[bind.mesh][:, bind.target] += bind.weight * weight
            used |= {name: None} if bound[name] and weight.any() else {}
    return {number: weights for number, weights in by_mesh.items() if weights.any()}, tuple(used)


def _titles(gltf: Gltf, mesh: Item) -> list[str]:
    """Names of a mesh's targets, which all its primitives share; empty for one that moves nothing."""
    titles: list[str] = []
    for item in mesh.items("primitives"):
        named = scene.named_targets(gltf, mesh, item)
        titles += [""] * (len(named) - len(titles))
        for place, (name, target) in enumerate(named):
            titles[place] = titles[place] or (name if _moves(gltf, target) else "")
    return titles


def _moves(gltf: Gltf, target: Item) -> bool:
    """Whether a target moves anything, by the bounds that its accessor states: avatars have empty ones."""
    if "POSITION" not in target:
        return False
    row = gltf.row(target, "POSITION", "accessors")
    return not ("min" in row and "max" in row) or any((*row.numbers("min", [0.0] * 3), *row.numbers("max", [0.0] * 3)))


def _turned_bones(rig: _Rig, motion: FaceMotion, used: tuple[str, ...]) -> dict[str, int]:
    """Nodes to turn, by bone."""
    left_to_shapes = {"jaw"} if any(plain(name) == "jawopen" or viseme(name) for name in used) else set()
    left_to_shapes |= {bone for bone in EYES if bone in rig.bones and _shapes_turn(rig, rig.bones[bone])}
    return {
        bone: node
        for bone, node in rig.bones.items()
        if bone in motion.turns and bone not in left_to_shapes and (motion.turns[bone] != np.eye(3)).any()
    }


def _shapes_turn(rig: _Rig, eye: int) -> bool:
    """Whether a shape that looks down moves what is attached to an eye's bone.

    If that cannot be known (the data are damaged, or compressed and not read here), it does: shapes are more usual.
    """
    below = scene.subtree(eye, rig.children)
    for number in rig.world:
        node = rig.nodes[number]
        if "mesh" not in node:
            continue
        mesh = rig.gltf.row(node, "mesh", "meshes")
        for primitive in mesh.items("primitives"):
            for name, target in scene.named_targets(rig.gltf, mesh, primitive):
                if not plain(name).startswith("eyelookdown") or "POSITION" not in target:
                    continue
                try:
                    rig.gltf.unpack_draco(primitive)
                except (DataError, ResourceError):
                    return True
                try:
                    moves = rig.gltf.numbers(target, "POSITION")
                    carry = scene.carrier(rig.gltf, number, primitive.item("attributes"), len(moves), rig.world)
                except (UnsupportedError, ResourceError):
                    return True
                far = np.linalg.norm(moves, axis=1)
                if far[carry.share(below) > 0.5].max(initial=0.0) > max(MOVED_SHARE * far.max(initial=0.0), MOVED):
                    return True
    return False


def _decompose(node: Row) -> None:
    """Replace a node's matrix with translation, rotation and scale, as animation requires (glTF 2.0, 3.5.3)."""
    if "matrix" not in node:
        return
    matrix = np.array(node.pop("matrix")).reshape(4, 4).T
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    scale[0] *= np.sign(np.linalg.det(matrix[:3, :3])) or 1.0
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(matrix[:3, :3] / np.where(scale == 0, 1.0, scale))
    node |= {"translation": matrix[:3, 3].tolist(), "rotation": turn.as_quat().tolist(), "scale": scale.tolist()}


def _opened(data: bytes, fetch: Fetch) -> tuple[Writer, list[tuple[int, bytes]]]:
    """Return a writer of an existing document, and further chunks of its GLB."""
    if data[:4] != MAGIC:
        return Writer(_with_own_buffer(json.loads(data), fetch)), []
    chunks = split_glb(data)
    first = dict(reversed(chunks))
    document = json.loads(first[JSON_CHUNK])
    if not document.get("buffers") or "uri" in document["buffers"][0]:
        return Writer(_with_own_buffer(document, fetch)), []
    others = [chunk for chunk in chunks if chunk[0] not in (JSON_CHUNK, BINARY_CHUNK)]
    return Writer(document, first.get(BINARY_CHUNK, b"")[: document["buffers"][0]["byteLength"]]), others


def _with_own_buffer(document: Row, fetch: Fetch) -> Row:
    """Insert an empty first buffer into a document, and embed the files that it names."""
    for kind, media in (("buffers", "application/octet-stream"), ("images", "")):
        for row in document.get(kind, []):
            uri = row.get("uri", "data:")
            if not uri.startswith("data:"):
                ending = uri.rpartition(".")[2].lower()
                media_type = media or row.get("mimeType") or MEDIA_TYPES.get(ending, "image/png")
                content = base64.b64encode(fetch_uri(uri, fetch, kind)).decode()
                row["uri"] = f"data:{media_type};base64,{content}"
    for row in document.get("bufferViews", []):
        row["buffer"] += 1
        compressed = row.get("extensions", {}).get(MESHOPT)
        if compressed:
            compressed["buffer"] += 1
    document["buffers"] = [{}, *document.get("buffers", [])]
    return document


EXTENSION, SPECIFICATION = "VRMC_vrm_animation", "1.0"
BONES = (("hips", 0.9), ("spine", 1.0), ("chest", 1.2), ("neck", 1.4), ("head", 1.5))
"""Bones from the hips upwards, and their height above the ground, m."""
EYES_M = (0.0, 0.07, 0.08)
"""Position of the eyes relative to the joint of the head."""
PRESETS, CUSTOM = "vrm1", "arkit"
SETS = (PRESETS, CUSTOM)


def format_vrma(motion: FaceMotion, *, shapes: str = PRESETS) -> bytes:
    """Write a motion as a VRM animation (GLB).

    Parameters
    ----------
    motion : FaceMotion
    shapes : str
        ``"vrm1"``: the presets except looks, which the gaze gives; ``"arkit"``: ARKit's 52 as custom expressions.
    """
    writer = Writer({"asset": {"version": "2.0", "generator": "fapengine"}, "extensionsUsed": [EXTENSION]})
    curves = Curves(writer, motion.rate_hz, STRAIGHT)
    head = len(BONES) - 1
    for number, (name, height) in enumerate(BONES):
        below = BONES[number - 1][1] if number else 0.0
        node: Row = {"name": name, "translation": [0.0, height - below, 0.0]}
        writer.row("nodes", node | ({"children": [number + 1]} if number < head else {}))
    gaze = writer.row("nodes", {"name": "lookAt", "translation": list(EYES_M)})
    writer.document["nodes"][head]["children"] = [gaze]
    shown = [0]
    curves.add(head, "rotation", quaternions_of(motion.turns["head"]))
    curves.add(gaze, "rotation", quaternions_of(_gaze(motion.faps)))
    expressions: Row = {}
    if shapes == CUSTOM:
        named = zip(ARKIT_NAMES, approximate_arkit(motion.faps).T, strict=True)
    else:
        named = zip(VRM1_NAMES[:SHOWN], approximate_presets(motion.faps, motion.rate_hz).T[:SHOWN], strict=True)
    for name, weights in named:
        if weights.any():
            node_number = writer.row("nodes", {"name": name})
            shown.append(node_number)
            expressions[name] = {"node": node_number}
            curves.add(node_number, "translation", weights[:, None] * [1.0, 0.0, 0.0])
    writer.document["scenes"] = [{"nodes": shown}]
    writer.document["scene"] = 0
    writer.row("animations", curves.row(motion.name))
    writer.document["extensions"] = {
        EXTENSION: {
            "specVersion": SPECIFICATION,
            "humanoid": {"humanBones": {name: {"node": number} for number, (name, _) in enumerate(BONES)}},
            "expressions": {"preset" if shapes == PRESETS else "custom": expressions},
            "lookAt": {"node": gaze, "offsetFromHeadBone": list(EYES_M)},
        }
    }
    return writer.glb()


def _gaze(faps: Array) -> Array:
    """(T, 3, 3): mean rotation of both eyes, from FAPs (T, 68)."""
    return rotations_about("YX", np.stack(gaze_of(faps), axis=1))
