"""The scene of a glTF or VRM file as one mesh with blendshapes: nodes, skins in rest pose, morph targets, colours.

Vertices are in scene space: transformed by their node or, where they are skinned, by their joints (glTF 2.0, 3.7.3: the
node's own transform is then ignored). Morph targets of several meshes with the same name form one blendshape.

VRM adds expressions, which combine morph targets. VRM 0.x: ``extensions.VRM.blendShapeMaster.blendShapeGroups``,
weights 0 to 100, bound to meshes. VRM 1.0: ``extensions.VRMC_vrm.expressions``, weights 0 to 1, bound to nodes. An
expression has the name in the file; a preset has the name of the preset.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.errors import DataError
from fapengine.files.gltf.document import MAX_NUMBER, Gltf, Item
from fapengine.files.gltf.textures import Atlas, Look
from fapengine.geometry.rigid import rotations_from_quaternions
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh, RigBone

BONES = {"head": "head", "jaw": "jaw", "leftEye": "left eye", "rightEye": "right eye"}
UNKNOWN = "unknown"
"""Preset of expressions that VRM 0.x does not define."""
TRIANGLES, STRIP, FAN = 4, 5, 6
MAX_VERTICES = 2_000_000
"""Vertices of the scene; a mesh counts once for each node that shows it. Each takes about 500 bytes of memory."""
MAX_PARTS = 5_000
"""Parts of the scene: primitives, once for each node that shows them. Each takes 0.3 ms, even of one triangle."""
MIN_MOTION_SHARE = 1e-7
"""Displacement by a morph target, as a fraction of the mesh's size, that is more than rounding."""
JOINT_NAMES = {
    "head": "head", "jaw": "jaw", "lefteye": "left eye", "eyeleft": "left eye", "eyel": "left eye", "leye": "left eye",
    "righteye": "right eye", "eyeright": "right eye", "eyer": "right eye", "reye": "right eye",
}  # fmt: skip
"""Bone of a rig by the name of its joint: letters and digits only, after prefixes such as ``mixamorig:``."""


@dataclass(slots=True)
class _Parts:
    """Vertices of a scene, mesh by mesh. Stateful."""

    count: int = 0
    vertices: list[Array] = field(default_factory=list)
    triangles: list[Indices] = field(default_factory=list)
    uv: list[Array] = field(default_factory=list)
    albedo: list[Array] = field(default_factory=list)
    surface: list[Indices] = field(default_factory=list)
    surfaces: list[str] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    moves: dict[tuple[int, int], list[tuple[Indices, Array]]] = field(default_factory=dict)
    """Vertices and displacements, by the indices of mesh and morph target."""
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    bones: dict[str, list[tuple[Indices, Array]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_scene(gltf: Gltf) -> BlendshapeMesh:
    """Join everything that the scene shows.

    Raises
    ------
    DataError
        If the document contradicts itself, or shows no triangle.
    """
    nodes = gltf.rows["nodes"]
    world, children = world_transforms(gltf)
    bones = find_bones(gltf, world)
    below = {name: subtree(node, children) for name, node in bones.items()}
    parts, atlas = _Parts(), Atlas(gltf)
    for node in world:
        if "mesh" in nodes[node]:
            _add_mesh(gltf, node, world, below, parts, atlas)
    if not parts.count or not sum(map(len, parts.triangles)):
        raise DataError("scene: contains no triangle", where="scenes")
    texture, uv = atlas.build(parts.looks, parts.uv)
    joints = {name: world[node][:3, 3] for name, node in bones.items()}
    return BlendshapeMesh(
        vertices=np.concatenate(parts.vertices),
        triangles=np.concatenate(parts.triangles),
        blendshapes=_blendshapes(gltf, parts),
        uv=uv,
        texture=texture,
        albedo=np.concatenate(parts.albedo),
        surfaces=tuple(parts.surfaces),
        surface=np.concatenate(parts.surface),
        bones={name: RigBone(_spread(entries, parts.count), joints[name]) for name, entries in parts.bones.items()},
        faces_back="VRM" in gltf.root.item("extensions"),
        notes=(*parts.notes, *atlas.notes),
    )


def world_transforms(gltf: Gltf) -> tuple[dict[int, Array], list[list[int]]]:
    """(4, 4) world matrix of each node that the scene shows, and the children of every node."""
    nodes = gltf.rows["nodes"]
    children = [node.indices("children", len(nodes)) for node in nodes]
    parents: dict[int, int] = {}
    for parent, below in enumerate(children):
        for child in below:
            if child in parents or child == parent:
                raise DataError(f"node {child}: got two parents, expected one", where=nodes[parent].where)
            parents[child] = parent
    roots = [node for node in range(len(nodes)) if node not in parents]
    if scenes := gltf.rows["scenes"]:
        roots = scenes[gltf.root.index("scene", len(scenes), 0)].indices("nodes", len(nodes))
    waiting = deque((node, np.eye(4)) for node in roots)
    world: dict[int, Array] = {}
    while waiting:
        node, above = waiting.popleft()
        if node in world:
            raise DataError(f"node {node}: got it twice in the scene, expected a tree", where=nodes[node].where)
        with np.errstate(all="ignore"):
            world[node] = above @ local_transform(nodes[node])
        if not (np.abs(world[node]) < MAX_NUMBER).all():
            raise DataError(f"node {node}: got a transform beyond {MAX_NUMBER:g} in all", where=nodes[node].where)
        waiting += [(child, world[node]) for child in children[node]]
    return world, children


def local_transform(node: Item) -> Array:
    """(4, 4): transform of a node to its parent's space."""
    if "matrix" in node:
        return np.array(node.numbers("matrix", [0.0] * 16)).reshape(4, 4).T
    quaternion = np.array(node.numbers("rotation", [0.0, 0.0, 0.0, 1.0]))
    if not quaternion.any():
        raise node.fail("rotation", "a quaternion that is not 0")
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(quaternion) * node.numbers("scale", [1.0] * 3)
    matrix[:3, 3] = node.numbers("translation", [0.0] * 3)
    return matrix


def rotation_of(quaternion: Array) -> Array:
    """(3, 3): rotation of a quaternion, (4,) x y z w, of any length but 0."""
    shorter = quaternion / np.abs(quaternion).max()
    return rotations_from_quaternions(np.roll(shorter / np.linalg.norm(shorter), 1))


def nearest_rotation(matrix: Array) -> Array:
    """(3, 3): the rotation, or mirrored rotation, that is nearest to a matrix."""
    one, _, other = np.linalg.svd(matrix)
    return np.asarray(one @ other)


def find_bones(gltf: Gltf, world: dict[int, Array]) -> dict[str, int]:
    """Node of each bone of the face that is shown, by VRM's humanoid or by the node's name; ``world``: (4, 4) each."""
    nodes, joints = gltf.rows["nodes"], humanoid(gltf)
    for node in world:
        name = nodes[node].string("name", "").rpartition(":")[2]
        bone = JOINT_NAMES.get("".join(character for character in name.lower() if character.isalnum()))
        if bone and bone not in joints and "mesh" not in nodes[node]:
            joints[bone] = node
    return {bone: node for bone, node in joints.items() if node in world}


def subtree(root: int, children: list[list[int]]) -> set[int]:
    """Find a node and all its descendants."""
    inside, waiting = {root}, [root]
    while waiting:
        below = [child for child in children[waiting.pop()] if child not in inside]
        inside.update(below)
        waiting += below
    return inside


def _add_mesh(
    gltf: Gltf, node: int, world: dict[int, Array], below: dict[str, set[int]], parts: _Parts, atlas: Atlas
) -> None:
    shown = gltf.rows["nodes"][node]
    number = gltf.index(shown, "mesh", "meshes")
    mesh = gltf.rows["meshes"][number]
    for item in mesh.items("primitives"):
        mode = item.index("mode", 7, TRIANGLES)
        if mode < TRIANGLES:
            continue  # points and lines
        gltf.unpack_draco(item)
        attributes = item.item("attributes")
        local = gltf.numbers(attributes, "POSITION", (None, 3))
        if parts.count + len(local) > MAX_VERTICES:
            raise DataError(
                f"vertices: got {parts.count + len(local)} in all, expected at most {MAX_VERTICES}", where=item.where
            )
        if len(parts.vertices) >= MAX_PARTS:
            raise DataError(f"scene: got more than {MAX_PARTS} parts", where=item.where)
        titles = (shown.string("name", ""), mesh.string("name", ""))
        look = atlas.material(item)
        if look.hidden:
            parts.notes.append(f"{' / '.join(filter(None, (*titles, look.name)))}: left out, as it is translucent")
            continue
        carry = carrier(gltf, node, attributes, len(local), world)
        placed = np.einsum("vij,vj->vi", carry.matrix[:, :3, :3], local) + carry.matrix[:, :3, 3]
        first = parts.count + np.arange(len(local))
        _add_look(gltf, attributes, look, titles, len(local), parts)
        parts.triangles.append(_triangles(gltf, item, mode, len(local), carry.mirrored) + parts.count)
        parts.vertices.append(placed)
        parts.count += len(local)
        for name, inside in below.items():
            parts.bones.setdefault(name, []).append((first, carry.share(inside)))
        size = MIN_MOTION_SHARE * float(np.linalg.norm(np.ptp(local, axis=0))) if len(local) else 0.0
        for target, (name, attribute) in enumerate(named_targets(gltf, mesh, item)):
            parts.names.setdefault((number, target), name)
            if "POSITION" not in attribute:
                continue
            moves = gltf.numbers(attribute, "POSITION", local.shape)
            kept = np.flatnonzero(np.abs(moves).max(axis=1, initial=0.0) > size)
            turned = np.einsum("vij,vj->vi", carry.matrix[kept, :3, :3], moves[kept])
            parts.moves.setdefault((number, target), []).append((first[kept], turned))


def named_targets(gltf: Gltf, mesh: Item, primitive: Item) -> list[tuple[str, Item]]:
    """Morph targets of a primitive and their names, which the primitive, its mesh or their accessors state."""
    given = primitive.extras().strings("targetNames") or mesh.extras().strings("targetNames")
    named = []
    for number, target in enumerate(primitive.items("targets")):
        if number < len(given):
            name = given[number]
        else:  # some exporters name the accessor
            row = gltf.row(target, "POSITION", "accessors") if "POSITION" in target else Item({}, "")
            name = row.string("name", "") or f"target {number}"
        named.append((name, target))
    return named


@dataclass(frozen=True, slots=True)
class Carrier:
    """Transform of each vertex to scene space."""

    matrix: Array
    """(V, 4, 4)."""
    joints: Indices
    """(V, J): nodes that move each vertex."""
    weights: Array
    """(V, J): weights of these nodes."""

    @property
    def mirrored(self) -> bool:
        """Whether it reverses the orientation of triangles."""
        return bool(len(self.matrix)) and float(np.linalg.det(self.matrix[:, :3, :3].mean(axis=0))) < 0

    def share(self, nodes: set[int]) -> Array:
        """(V,): total weight of some nodes."""
        return np.asarray((self.weights * np.isin(self.joints, list(nodes))).sum(axis=1))


def carrier(gltf: Gltf, number: int, attributes: Item, count: int, world: dict[int, Array]) -> Carrier:
    """Transforms of ``count`` vertices of a mesh: its node's, or those of its skin's joints; ``world``: (4, 4) each."""
    node = gltf.rows["nodes"][number]
    if "skin" not in node or "JOINTS_0" not in attributes:
        still = np.broadcast_to(world[number], (count, 4, 4))
        return Carrier(still, np.full((count, 1), number), np.ones((count, 1)))
    skin = gltf.row(node, "skin", "skins")
    bones = skin.indices("joints", len(gltf.rows["nodes"]))
    lost = [bone for bone in bones if bone not in world]
    if lost or not bones:
        raise DataError(f"joints: got {lost[:1] or 'none'}, expected nodes of the scene", where=skin.where)
    bind = np.broadcast_to(np.eye(4), (len(bones), 4, 4))
    if "inverseBindMatrices" in skin:
        given = gltf.numbers(skin, "inverseBindMatrices", (None, 16))
        if len(given) < len(bones):
            raise DataError(f"inverseBindMatrices: got {len(given)}, expected {len(bones)}", where=skin.where)
        bind = given[: len(bones)].reshape(-1, 4, 4).transpose(0, 2, 1)
    matrices = np.stack([world[bone] for bone in bones]) @ bind
    joints, weights = _influences(gltf, attributes, count)
    if joints.max(initial=0) >= len(bones):
        raise DataError(f"JOINTS: got {joints.max()}, expected 0 to {len(bones) - 1}", where=attributes.where)
    total = weights.sum(axis=1, keepdims=True)
    if (weights < 0).any() or (total <= 0).any():
        raise DataError("WEIGHTS: got a vertex with negative weights or none", where=attributes.where)
    weights = weights / total
    matrix = np.zeros((count, 4, 4))
    for joint, weight in zip(joints.T, weights.T, strict=True):  # one by one, to save memory
        matrix += weight[:, None, None] * matrices[joint]
    return Carrier(matrix, np.array(bones)[joints], weights)


def _influences(gltf: Gltf, attributes: Item, count: int) -> tuple[Indices, Array]:
    joints, weights = [], []
    for index in range(4):
        if f"JOINTS_{index}" not in attributes:
            break
        joints.append(gltf.numbers(attributes, f"JOINTS_{index}", (count, 4)))
        weights.append(gltf.numbers(attributes, f"WEIGHTS_{index}", (count, 4)))
    together = np.concatenate(joints, axis=1)
    if (together < 0).any() or (together != np.round(together)).any():
        raise DataError("JOINTS: got numbers that are not indices", where=attributes.where)
    return together.astype(np.int64), np.concatenate(weights, axis=1)


def _triangles(gltf: Gltf, item: Item, mode: int, count: int, mirrored: bool) -> Indices:
    order = gltf.indices(item, count) if "indices" in item else np.arange(count)
    if mode == TRIANGLES:
        corners = order[: len(order) // 3 * 3].reshape(-1, 3)
    elif mode == STRIP:
        corners = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        corners[1::2] = corners[1::2, ::-1]
    else:
        corners = np.stack([np.broadcast_to(order[:1], order[2:].shape), order[1:-1], order[2:]], axis=1)
    first, second, third = corners.T
    corners = corners[(first != second) & (second != third) & (first != third)]
    return np.ascontiguousarray(corners[:, ::-1] if mirrored else corners)


def _add_look(gltf: Gltf, attributes: Item, look: Look, titles: tuple[str, str], count: int, parts: _Parts) -> None:
    colour = np.tile(np.array(look.factor), (count, 1))
    if "COLOR_0" in attributes:
        given = gltf.numbers(attributes, "COLOR_0")
        if given.shape[0] != count or given.shape[1] < 3:
            raise DataError(f"COLOR_0: got shape {given.shape}, expected ({count}, 3 or 4)", where=attributes.where)
        colour = colour * given[:, :3]
    uv = np.zeros((count, 2))
    if look.image is not None and f"TEXCOORD_{look.channel}" in attributes:
        uv = gltf.numbers(attributes, f"TEXCOORD_{look.channel}", (count, 2))
    parts.albedo.append(np.clip(colour, 0.0, 1.0))
    parts.uv.append(look.place(uv))
    parts.surface.append(np.full(count, len(parts.surfaces)))
    parts.looks.append(look)
    parts.surfaces.append(" / ".join(dict.fromkeys(filter(None, (*titles, look.name)))))


def _blendshapes(gltf: Gltf, parts: _Parts) -> dict[str, Blendshape]:
    """Blendshapes by name: the morph targets, then VRM's expressions, which combine several."""
    sums: dict[str, list[tuple[Indices, Array]]] = {}
    for key, name in parts.names.items():
        sums.setdefault(name, []).extend(parts.moves.get(key, []))
    for name, binds in bindings(gltf).items():
        if name in sums:
            continue
        sums[name] = []
        for bind in binds:
            for vertices, moves in parts.moves.get((bind.mesh, bind.target), []):
                gltf.elements.take(len(vertices), "extensions")
                sums[name].append((vertices, bind.weight * moves))
    return {name: _sum(entries) for name, entries in sums.items()}


def _sum(entries: list[tuple[Indices, Array]]) -> Blendshape:
    if not entries:
        return Blendshape(np.zeros(0, np.int64), np.zeros((0, 3)))
    vertices, back = np.unique(np.concatenate([entry[0] for entry in entries]), return_inverse=True)
    moves = np.zeros((len(vertices), 3))
    np.add.at(moves, back, np.concatenate([entry[1] for entry in entries]))
    return Blendshape(vertices, moves)


def _spread(entries: list[tuple[Indices, Array]], count: int) -> Array:
    weight = np.zeros(count)
    for vertices, share in entries:
        weight[vertices] = share
    return np.clip(weight, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Binding:
    """Weight of a morph target in an expression."""

    mesh: int
    target: int
    weight: float


def bindings(gltf: Gltf) -> dict[str, list[Binding]]:
    """Morph targets of each expression; empty for a file that is not a VRM.

    Raises
    ------
    DataError
        If an expression binds a target that does not exist.
    """
    extensions = gltf.root.item("extensions")
    bound: dict[str, list[Binding]] = {}
    for group in extensions.item("VRM").item("blendShapeMaster").items("blendShapeGroups"):
        preset = group.string("presetName", UNKNOWN)
        name = group.string("name", "") if preset.lower() == UNKNOWN else preset
        bound[name] = [_bind(gltf, bind, bind, bind.number("weight", 100.0) / 100.0) for bind in group.items("binds")]
    expressions = extensions.item("VRMC_vrm").item("expressions")
    for kind in ("preset", "custom"):
        group = expressions.item(kind)
        for name in group:
            bound[name] = [
                _bind(gltf, bind, gltf.row(bind, "node", "nodes"), bind.number("weight", 1.0))
                for bind in group.item(name).items("morphTargetBinds")
            ]
    return bound


def humanoid(gltf: Gltf) -> dict[str, int]:
    """Node of each bone of the face that a VRM names."""
    extensions = gltf.root.item("extensions")
    bound = {}
    for bone in extensions.item("VRM").item("humanoid").items("humanBones"):
        if limb := BONES.get(bone.string("bone", "")):
            bound[limb] = gltf.index(bone, "node", "nodes")
    bones = extensions.item("VRMC_vrm").item("humanoid").item("humanBones")
    return bound | {
        limb: gltf.index(bones.item(name), "node", "nodes") for name, limb in BONES.items() if name in bones
    }


def _bind(gltf: Gltf, bind: Item, owner: Item, weight: float) -> Binding:
    """Bind a target of the mesh that ``owner`` refers to."""
    mesh = gltf.index(owner, "mesh", "meshes")
    most = max((len(item.items("targets")) for item in gltf.rows["meshes"][mesh].items("primitives")), default=0)
    return Binding(mesh, bind.index("index", max(most, 1)), weight)
