"""A face's motion as an animation inside somebody's glTF scene, of which nothing else is changed.

Theory of operation
-------------------
Morph targets get weights by their names (:mod:`fapengine.retarget.rig_weights`), one channel for each node that shows
them. Bones of head and eyes turn about the face's own axes, ``local = parent' turn parent rest``; the jaw's bone turns
where no shape opens the mouth, the eyes' where no shape turns them. What never leaves its rest gets no channel.

A scene's face looks along +z as glTF asks for, along -z in VRM 0.x, and else wherever its eyes say: its left is where
its left eye is.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UnsupportedError
from fapengine.files.gltf.document import (
    BINARY_CHUNK,
    JSON_CHUNK,
    MAGIC,
    Fetch,
    Gltf,
    fetch_uri,
    parse_gltf,
    split_glb,
)
from fapengine.files.gltf.json_cursor import Item
from fapengine.files.gltf.scene import (
    carrier,
    children_of,
    find_bones,
    local_transform,
    subtree,
    target_names,
    world_transforms,
)  # fmt: skip
from fapengine.files.gltf.vrm import bindings
from fapengine.files.gltf.writing import Curves, Row, Writer, quaternions_of
from fapengine.models.via_points import STRAIGHT
from fapengine.retarget.blendshape_names import plain, viseme
from fapengine.retarget.rig_weights import Meanings, has_arkit, rig_weights

Array = NDArray[np.float64]

EYES = ("left eye", "right eye")
MOVED, MOVED_SHARE = 1e-5, 0.2
"""Motion of an eyeball, in the file's unit and as a share of what its mesh does, from which a shape turns the eye."""
MEDIA_TYPES = {
    "jpg": "image/jpeg",
    "jpeg": "image/jpeg",
    "png": "image/png",
    "webp": "image/webp",
    "ktx2": "image/ktx2",
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FaceMotion:
    """What a face does, for any rig."""

    faps: Array
    """(T, 68) FAPU, T >= 1, a row a frame."""
    turns: Mapping[str, Array]
    """(T, 3, 3) rotations of ``head``, ``jaw``, ``left eye`` and ``right eye``, in the space of the head: x its left,
    y up, z forward; the head's in the world's."""
    rate_hz: float
    name: str = "face"
    """Title of the animation."""


@dataclass(frozen=True, slots=True)
class Reached:
    """What of a rig a motion moves."""

    shapes: tuple[str, ...]
    """Names of shapes that leave 0 at some time."""
    bones: tuple[str, ...]
    keys: int
    """Keys of all curves."""


def add_clip(
    data: bytes, fetch: Fetch, motion: FaceMotion, *, keys: str = STRAIGHT, meanings: Meanings | None = None
) -> tuple[bytes, Reached]:
    """Put an animation into a scene.

    Parameters
    ----------
    data : bytes
        A GLB (also a VRM) or a glTF document.
    fetch : callable
        Reads files that the document names; of a document that is no GLB they go into the result.
    motion : FaceMotion
    keys : str
        ``"linear"`` or ``"cubic"``: see :func:`fapengine.models.via_points.key_curve`.
    meanings : mapping, optional
        What shapes of other names mean.

    Returns
    -------
    bytes
        A GLB. All rows and bytes of a GLB stay; new ones stand behind them.
    Reached

    Raises
    ------
    DataError
        If it is no glTF, or nothing in it is known to be a face's.
    """
    rig = _Rig.of(parse_gltf(data, fetch, every_extension=False))
    shapes = _shape_weights(rig, motion.faps, meanings)
    turned = _turned_bones(rig, motion, shapes.used)
    if not shapes.by_mesh and not turned:
        raise DataError(
            "rig: got no shape named as ARKit's, Oculus' or VRM's, and no bone of a head, eye or jaw; expected some,"
            " or what its shapes mean (mapping=FILE)"
        )
    writer, others = _opened(data, fetch)
    curves = Curves(writer, motion.rate_hz, keys)
    for node in rig.world:
        if "mesh" in rig.nodes[node]:
            curves.add_weights(node, shapes.by_mesh.get(rig.mesh_of(rig.nodes[node])))
    for bone, node in turned.items():
        _take_apart(writer.document["nodes"][node])
        curves.add_turns(node, rig.local_turns(node, motion.turns[bone]))
    writer.row("animations", curves.row(motion.name))
    return writer.glb(*others), Reached(shapes.used, tuple(turned), curves.count)


@dataclass(frozen=True, slots=True, eq=False)
class _Rig:
    """A scene and the nodes of its face."""

    gltf: Gltf
    nodes: list[Item]
    parents: Mapping[int, int]
    world: dict[int, Array]
    """World matrix of each node that is shown."""
    bones: Mapping[str, int]

    @classmethod
    def of(cls, gltf: Gltf) -> "_Rig":
        nodes = gltf.rows["nodes"]
        children = children_of(nodes)
        world = world_transforms(gltf, nodes, children)
        parents = {child: node for node, below in enumerate(children) for child in below}
        return cls(gltf, nodes, parents, world, find_bones(gltf, nodes, world))

    def mesh_of(self, node: Item) -> int:
        """Find the number of the mesh that a node shows."""
        return node.index("mesh", len(self.gltf.rows["meshes"]))

    def local_turns(self, node: int, turns: Array) -> Array:
        """(T, 4) quaternions x y z w of a node that shows turns of the head's space, (T, 3, 3)."""
        above = self.world[self.parents[node]][:3, :3] if node in self.parents else np.eye(3)
        outer, rest = _rotation(above), _rotation(local_transform(self.nodes[node])[:3, :3])
        facing = self._facing()
        matrices = outer.T @ facing @ turns @ facing.T @ outer @ rest
        return quaternions_of(matrices)

    def _facing(self) -> Array:
        """(3, 3): from the head's axes to the scene's, a quarter turn about y or none."""
        left = np.array([-1.0 if "VRM" in self.gltf.root.item("extensions") else 1.0, 0.0, 0.0])
        if all(eye in self.bones for eye in EYES):
            one, other = (self.world[self.bones[eye]][:3, 3] for eye in EYES)
            apart = (one - other) * (1.0, 0.0, 1.0)
            if np.abs(apart).max() > 0:
                left = np.zeros(3)
                left[np.abs(apart).argmax()] = np.sign(apart[np.abs(apart).argmax()])
        up = np.array([0.0, 1.0, 0.0])
        return np.stack([left, up, np.cross(left, up)], axis=1)


def _rotation(matrix: Array) -> Array:
    """(3, 3): the rotation, or mirrored rotation, that is nearest to a matrix."""
    one, _, other = np.linalg.svd(matrix)
    return np.asarray(one @ other)


@dataclass(frozen=True, slots=True, eq=False)
class _Shapes:
    """Weights of morph targets."""

    by_mesh: dict[int, Array]
    """(T, targets) by the number of a mesh, of meshes with some that move."""
    used: tuple[str, ...]


def _shape_weights(rig: _Rig, faps: Array, meanings: Meanings | None) -> _Shapes:
    """Weights by the meshes' own names if these are ARKit's, or no VRM says more; else by the VRM's expressions."""
    titles = [_titles(rig.gltf, mesh) for mesh in rig.gltf.rows["meshes"]]
    bound = bindings(rig.gltf, rig.nodes)
    looks = not any(eye in rig.bones for eye in EYES)
    by_mesh = {number: np.zeros((len(faps), len(names))) for number, names in enumerate(titles)}
    used: dict[str, None] = {}
    named = [[name for name in names if name] for names in titles]
    if not bound or has_arkit(name for names in named for name in names):
        for number, weights in enumerate(rig_weights(named, faps, meanings, looks=looks)):
            for name, weight in weights.items():
                by_mesh[number][:, titles[number].index(name)] = weight
                used |= {name: None} if weight.any() else {}
    else:
        for name, weight in rig_weights([bound], faps, meanings, looks=looks)[0].items():
            for bind in bound[name]:
                by_mesh[bind.mesh][:, bind.target] += bind.weight * weight
            used |= {name: None} if weight.any() else {}
    return _Shapes({number: weights for number, weights in by_mesh.items() if weights.any()}, tuple(used))


def _titles(gltf: Gltf, mesh: Item) -> list[str]:
    """Names of a mesh's targets, of which all its primitives have the same; of one that moves nothing, none."""
    titles: list[str] = []
    for item in mesh.items("primitives"):
        names, targets = target_names(gltf, mesh, item), item.items("targets")
        titles += [""] * (len(names) - len(titles))
        for place, (name, target) in enumerate(zip(names, targets, strict=True)):
            titles[place] = titles[place] or (name if _moves(gltf, target) else "")
    return titles


def _moves(gltf: Gltf, target: Item) -> bool:
    """Tell whether a target moves anything, by the bounds that its accessor states: avatars have empty ones."""
    if "POSITION" not in target:
        return False
    row = gltf.accessors[target.index("POSITION", len(gltf.accessors))]
    return not ("min" in row and "max" in row) or any((*row.numbers("min", [0.0] * 3), *row.numbers("max", [0.0] * 3)))


def _turned_bones(rig: _Rig, motion: FaceMotion, used: tuple[str, ...]) -> dict[str, int]:
    """Nodes to turn, by their bones."""
    left_to_shapes = {"jaw"} if any(plain(name) == "jawopen" or viseme(name) for name in used) else set()
    left_to_shapes |= {bone for bone in EYES if bone in rig.bones and _shapes_turn(rig, rig.bones[bone])}
    return {
        bone: node
        for bone, node in rig.bones.items()
        if bone in motion.turns and bone not in left_to_shapes and (motion.turns[bone] != np.eye(3)).any()
    }


def _shapes_turn(rig: _Rig, eye: int) -> bool:
    """Tell whether a shape that looks down moves what hangs on an eye's bone."""
    below = subtree(eye, children_of(rig.nodes))
    for number in rig.world:
        node = rig.nodes[number]
        if "mesh" not in node:
            continue
        mesh = rig.gltf.rows["meshes"][rig.mesh_of(node)]
        for primitive in mesh.items("primitives"):
            targets = zip(target_names(rig.gltf, mesh, primitive), primitive.items("targets"), strict=True)
            for name, target in targets:
                if not plain(name).startswith("eyelookdown") or "POSITION" not in target:
                    continue
                try:
                    rig.gltf.unpack_draco(primitive)
                except (DataError, ResourceError):  # damaged, or without DracoPy: shapes are the usual way
                    return True
                try:
                    moves = rig.gltf.accessor(target.index("POSITION", len(rig.gltf.accessors)))
                    share = carrier(rig.gltf, node, primitive.item("attributes"), len(moves), rig.world, number).share(
                        below
                    )
                except (
                    UnsupportedError,
                    ResourceError,
                ):  # packed, and nothing here unpacks it: shapes are the usual way
                    return True
                far = np.linalg.norm(moves, axis=1)
                if far[share > 0.5].max(initial=0.0) > max(MOVED_SHARE * far.max(initial=0.0), MOVED):
                    return True
    return False


def _take_apart(node: Row) -> None:
    """Give a node translation, rotation and scale in place of a matrix, as one that moves must (glTF 2.0, 3.5.3)."""
    if "matrix" not in node:
        return
    matrix = np.array(node.pop("matrix")).reshape(4, 4).T
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    scale[0] *= np.sign(np.linalg.det(matrix[:3, :3])) or 1.0
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(matrix[:3, :3] / np.where(scale == 0, 1.0, scale))
    node |= {"translation": matrix[:3, 3].tolist(), "rotation": turn.as_quat().tolist(), "scale": scale.tolist()}


def _opened(data: bytes, fetch: Fetch) -> tuple[Writer, list[tuple[int, bytes]]]:
    """Make a writer of a document as it is, and the chunks that are neither it nor its first buffer."""
    if data[:4] == MAGIC:
        chunks = split_glb(data)
        text = next(content for kind, content in chunks if kind == JSON_CHUNK)
        binary = next((content for kind, content in chunks if kind == BINARY_CHUNK), b"")
        document = json.loads(text)
        if document.get("buffers") and "uri" not in document["buffers"][0]:
            others = [chunk for chunk in chunks if chunk[0] not in (JSON_CHUNK, BINARY_CHUNK)]
            return Writer(document, binary[: document["buffers"][0]["byteLength"]]), others
    else:
        document = json.loads(data)
    return Writer(_with_own_buffer(document, fetch)), []


def _with_own_buffer(document: Row, fetch: Fetch) -> Row:
    """Put an empty buffer in front of a document's others, and the files that it names into it."""
    for kind, media in (("buffers", "application/octet-stream"), ("images", "")):
        for row in document.get(kind, []):
            uri = row.get("uri", "data:")
            if not uri.startswith("data:"):
                media_type = (
                    media or row.get("mimeType") or MEDIA_TYPES.get(uri.rpartition(".")[2].lower(), "image/png")
                )
                content = base64.b64encode(fetch_uri(uri, fetch, kind)).decode()
                row["uri"] = f"data:{media_type};base64,{content}"
    for row in document.get("bufferViews", []):
        row["buffer"] += 1
        compressed = row.get("extensions", {}).get("EXT_meshopt_compression")
        if compressed:
            compressed["buffer"] += 1
    document["buffers"] = [{}, *document.get("buffers", [])]
    return document
