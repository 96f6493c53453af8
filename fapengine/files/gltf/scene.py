"""The scene of a glTF or VRM file as one mesh with blendshapes: nodes, skins in rest pose, morph targets, colours.

Vertices are given in the scene's space: through the transforms of their node, or, where they are skinned, of their
joints (glTF 2.0, 3.7.3: the node's own transform then counts nothing). Morph targets of one name in several meshes
are one blendshape.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.files.gltf.document import Gltf
from fapengine.files.gltf.json_cursor import MAX_NUMBER, Item
from fapengine.files.gltf.textures import Atlas, Look
from fapengine.files.gltf.vrm import Binding, bindings, humanoid
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh, RigBone

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TRIANGLES, STRIP, FAN = 4, 5, 6
MAX_VERTICES = 2_000_000
"""Vertices of the scene; a mesh counts once for each node that shows it. Each takes some 500 bytes on its way."""
MIN_MOTION_SHARE = 1e-7
"""Motion of a vertex by a morph target, as a share of the mesh's size, that is more than rounding."""
JOINT_NAMES = {
    "head": "head", "jaw": "jaw", "lefteye": "left eye", "eyeleft": "left eye", "eyel": "left eye", "leye": "left eye",
    "righteye": "right eye", "eyeright": "right eye", "eyer": "right eye", "reye": "right eye",
}  # fmt: skip
"""Bone of a rig by the name of its joint: letters and digits alone, behind prefixes such as ``mixamorig:``."""


@dataclass(slots=True)
class _Parts:
    """Vertices of a scene, mesh by mesh.

    Stateful.
    """

    count: int = 0
    vertices: list[Array] = field(default_factory=list)
    triangles: list[Indices] = field(default_factory=list)
    uv: list[Array] = field(default_factory=list)
    albedo: list[Array] = field(default_factory=list)
    surface: list[Indices] = field(default_factory=list)
    surfaces: list[str] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    moves: dict[tuple[int, int], list[tuple[Indices, Array]]] = field(default_factory=dict)
    """Displacements by the numbers of mesh and morph target."""
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    bones: dict[str, list[tuple[Indices, Array]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_scene(gltf: Gltf) -> BlendshapeMesh:
    """Join all that the scene shows.

    Raises
    ------
    DataError
        If the document contradicts itself, or shows no triangle.
    """
    nodes = gltf.rows["nodes"]
    children = children_of(nodes)
    world = world_transforms(gltf, nodes, children)
    bones = find_bones(gltf, nodes, world)
    below = {name: subtree(node, children) for name, node in bones.items()}
    parts, atlas = _Parts(), Atlas(gltf)
    for node in world:
        if "mesh" in nodes[node]:
            _add_mesh(gltf, nodes, node, world, below, parts, atlas)
    if not parts.count or not sum(map(len, parts.triangles)):
        raise DataError("scene: got no triangle, expected a face", where="scenes")
    texture, uv = atlas.build(parts.looks, parts.uv)
    joints = {name: world[node][:3, 3] for name, node in bones.items()}
    return BlendshapeMesh(
        vertices=np.concatenate(parts.vertices),
        triangles=np.concatenate(parts.triangles),
        blendshapes=_blendshapes(gltf, parts, bindings(gltf, nodes)),
        uv=uv,
        texture=texture,
        albedo=np.concatenate(parts.albedo),
        surfaces=tuple(parts.surfaces),
        surface=np.concatenate(parts.surface),
        bones={name: RigBone(_spread(entries, parts.count), joints[name]) for name, entries in parts.bones.items()},
        notes=(*parts.notes, *atlas.notes),
    )


def children_of(nodes: list[Item]) -> list[list[int]]:
    """Children of each node."""
    return [node.indices("children", len(nodes)) for node in nodes]


def world_transforms(gltf: Gltf, nodes: list[Item], children: list[list[int]]) -> dict[int, Array]:
    """(4, 4) world matrix of each node that the scene shows."""
    parents: dict[int, int] = {}
    for parent, below in enumerate(children):
        for child in below:
            if child in parents or child == parent:
                raise DataError(f"node {child}: got two parents, expected one", where=nodes[parent].where)
            parents[child] = parent
    scenes = gltf.rows["scenes"]
    if scenes:
        scene = scenes[gltf.root.index("scene", len(scenes), 0)]
        waiting = deque((node, np.eye(4)) for node in scene.indices("nodes", len(nodes)))
    else:
        waiting = deque((node, np.eye(4)) for node in range(len(nodes)) if node not in parents)
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
    return world


def local_transform(node: Item) -> Array:
    """(4, 4): a node in its parent's space."""
    if "matrix" in node:
        return np.array(node.numbers("matrix", [0.0] * 16)).reshape(4, 4).T
    x, y, z, w = np.array(node.numbers("rotation", [0.0, 0.0, 0.0, 1.0]))
    size = x * x + y * y + z * z + w * w
    if not size > 0:
        raise node.fail("rotation", "a quaternion that is not 0")
    s = 2.0 / size
    turn = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * node.numbers("scale", [1.0] * 3)
    matrix[:3, 3] = node.numbers("translation", [0.0] * 3)
    return matrix


def find_bones(gltf: Gltf, nodes: list[Item], world: dict[int, Array]) -> dict[str, int]:
    """Joints named by VRM's humanoid, else by themselves, among the nodes shown: those with a (4, 4) matrix."""
    joints = humanoid(gltf, len(nodes))
    for node in world:
        name = nodes[node].string("name", "").rpartition(":")[2]
        bone = JOINT_NAMES.get("".join(letter for letter in name.lower() if letter.isalnum()))
        if bone and bone not in joints and "mesh" not in nodes[node]:
            joints[bone] = node
    return {bone: node for bone, node in joints.items() if node in world}


def subtree(root: int, children: list[list[int]]) -> set[int]:
    """Find a node and all below it."""
    inside, waiting = {root}, [root]
    while waiting:
        below = [child for child in children[waiting.pop()] if child not in inside]
        inside.update(below)
        waiting += below
    return inside


def _add_mesh(
    gltf: Gltf, nodes: list[Item], node: int, world: dict[int, Array], below: dict[str, set[int]], parts: _Parts,
    atlas: Atlas,
) -> None:  # fmt: skip
    meshes = gltf.rows["meshes"]
    number = nodes[node].index("mesh", len(meshes))
    mesh = meshes[number]
    for item in mesh.items("primitives"):
        mode = item.index("mode", 7, TRIANGLES)
        if mode < TRIANGLES:
            continue  # points and lines
        gltf.unpack_draco(item)
        attributes = item.item("attributes")
        local = gltf.accessor(attributes.index("POSITION", len(gltf.accessors)))
        if local.shape[1] != 3:
            raise DataError(f"POSITION: got {local.shape[1]} components, expected 3", where=item.where)
        if parts.count + len(local) > MAX_VERTICES:
            raise DataError(
                f"vertices: got {parts.count + len(local)} in all, expected at most {MAX_VERTICES}", where=item.where
            )
        titles = (nodes[node].string("name", ""), mesh.string("name", ""))
        look = atlas.material(item)
        if look.hidden:
            parts.notes.append(f"{' / '.join(filter(None, (*titles, look.name)))}: left out, as it is translucent")
            continue
        carry = carrier(gltf, nodes[node], attributes, len(local), world, node)
        placed = np.einsum("vij,vj->vi", carry.matrix[:, :3, :3], local) + carry.matrix[:, :3, 3]
        first = parts.count + np.arange(len(local))
        _add_look(gltf, attributes, look, titles, len(local), parts)
        parts.triangles.append(_triangles(gltf, item, mode, len(local), carry.mirrored) + parts.count)
        parts.vertices.append(placed)
        parts.count += len(local)
        for name, inside in below.items():
            parts.bones.setdefault(name, []).append((first, carry.share(inside)))
        size = MIN_MOTION_SHARE * float(np.linalg.norm(np.ptp(local, axis=0))) if len(local) else 0.0
        for target, (name, attribute) in enumerate(
            zip(target_names(gltf, mesh, item), item.items("targets"), strict=True)
        ):
            _add_target(gltf, attribute, size, (number, target), first, carry.matrix, parts)
            parts.names.setdefault((number, target), name)


def target_names(gltf: Gltf, mesh: Item, primitive: Item) -> list[str]:
    """Names of a primitive's morph targets, as its mesh or it gives them."""
    given = primitive.extras().strings("targetNames") or mesh.extras().strings("targetNames")
    return [
        given[target] if target < len(given) else _title(gltf, attribute, target)
        for target, attribute in enumerate(primitive.items("targets"))
    ]


def _title(gltf: Gltf, attribute: Item, target: int) -> str:
    """Name of a target without one: some exporters give it to its accessor."""
    if "POSITION" in attribute:
        name = gltf.accessors[attribute.index("POSITION", len(gltf.accessors))].string("name", "")
        if name:
            return name
    return f"target {target}"


def _add_target(
    gltf: Gltf, attribute: Item, size: float, key: tuple[int, int], first: Indices, matrix: Array, parts: _Parts
) -> None:
    if "POSITION" not in attribute:
        return
    moves = gltf.accessor(attribute.index("POSITION", len(gltf.accessors)))
    if moves.shape != (len(first), 3):
        raise DataError(f"target: got shape {moves.shape}, expected {(len(first), 3)}", where=attribute.where)
    kept = np.flatnonzero(np.abs(moves).max(axis=1, initial=0.0) > size)
    turned = np.einsum("vij,vj->vi", matrix[kept, :3, :3], moves[kept])
    parts.moves.setdefault(key, []).append((first[kept], turned))


@dataclass(frozen=True, slots=True)
class Carrier:
    """What takes each vertex to the scene."""

    matrix: Array
    """(V, 4, 4)."""
    joints: Indices
    """(V, J): nodes."""
    weights: Array
    """(V, J)."""

    @property
    def mirrored(self) -> bool:
        """Whether triangles turn over."""
        return bool(len(self.matrix)) and float(np.linalg.det(self.matrix[:, :3, :3].mean(axis=0))) < 0

    def share(self, nodes: set[int]) -> Array:
        """(V,): how much goes with these nodes."""
        return np.asarray((self.weights * np.isin(self.joints, list(nodes))).sum(axis=1))


def carrier(gltf: Gltf, node: Item, attributes: Item, count: int, world: dict[int, Array], number: int) -> Carrier:
    """Find what takes the (V,) vertices of a node's mesh to the scene: the node, or its skin's joints."""
    if "skin" not in node or "JOINTS_0" not in attributes:
        still = np.broadcast_to(world[number], (count, 4, 4))
        return Carrier(still, np.full((count, 1), number), np.ones((count, 1)))
    skins = gltf.rows["skins"]
    skin = skins[node.index("skin", len(skins))]
    bones = skin.indices("joints", len(gltf.rows["nodes"]))
    lost = [bone for bone in bones if bone not in world]
    if lost or not bones:
        raise DataError(f"joints: got {lost[:1] or 'none'}, expected nodes of the scene", where=skin.where)
    bind = np.broadcast_to(np.eye(4), (len(bones), 4, 4))
    if "inverseBindMatrices" in skin:
        given = gltf.accessor(skin.index("inverseBindMatrices", len(gltf.accessors)))
        if given.shape[1] != 16 or len(given) < len(bones):
            raise DataError(f"inverseBindMatrices: got {given.shape}, expected ({len(bones)}, 16)", where=skin.where)
        bind = given[: len(bones)].reshape(-1, 4, 4).transpose(0, 2, 1)
    matrices = np.stack([world[bone] for bone in bones]) @ bind
    joints, weights = _influences(gltf, attributes, count)
    if joints.max(initial=0) >= len(bones):
        raise DataError(f"JOINTS: got {joints.max()}, expected 0..{len(bones) - 1}", where=attributes.where)
    total = weights.sum(axis=1, keepdims=True)
    if (weights < 0).any() or (total <= 0).any():
        raise DataError("WEIGHTS: got a vertex that hangs on nothing", where=attributes.where)
    weights = weights / total
    matrix = np.zeros((count, 4, 4))
    for joint, weight in zip(joints.T, weights.T, strict=True):  # one after the other: all at once fill the memory
        matrix += weight[:, None, None] * matrices[joint]
    return Carrier(matrix, np.array(bones)[joints], weights)


def _influences(gltf: Gltf, attributes: Item, count: int) -> tuple[Indices, Array]:
    joints, weights = [], []
    for index in range(4):
        if f"JOINTS_{index}" not in attributes:
            break
        joints.append(gltf.accessor(attributes.index(f"JOINTS_{index}", len(gltf.accessors))))
        weights.append(gltf.accessor(attributes.index(f"WEIGHTS_{index}", len(gltf.accessors))))
        if joints[-1].shape != (count, 4) or weights[-1].shape != (count, 4):
            raise DataError(
                f"JOINTS_{index}, WEIGHTS_{index}: got shapes {joints[-1].shape}, {weights[-1].shape},"
                f" expected {(count, 4)} twice",
                where=attributes.where,
            )
    together = np.concatenate(joints, axis=1)
    if (together < 0).any() or (together != np.round(together)).any():
        raise DataError("JOINTS: got numbers that are no indices", where=attributes.where)
    return together.astype(np.int64), np.concatenate(weights, axis=1)


def _triangles(gltf: Gltf, item: Item, mode: int, count: int, mirrored: bool) -> Indices:
    order = np.arange(count)
    if "indices" in item:
        order = gltf.indices(item.index("indices", len(gltf.accessors)), count)
    if mode == TRIANGLES:
        corners = order[: len(order) // 3 * 3].reshape(-1, 3)
    elif mode == STRIP:
        corners = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        corners[1::2] = corners[1::2, ::-1]
    else:
        corners = np.stack(
            [np.full(max(len(order) - 2, 0), order[0] if len(order) else 0), order[1:-1], order[2:]], axis=1
        )
    corners = corners[
        (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 0] != corners[:, 2])
    ]
    return np.ascontiguousarray(corners[:, ::-1] if mirrored else corners)


def _add_look(gltf: Gltf, attributes: Item, look: Look, titles: tuple[str, str], count: int, parts: _Parts) -> None:
    colour = np.tile(np.array(look.factor), (count, 1))
    if "COLOR_0" in attributes:
        given = gltf.accessor(attributes.index("COLOR_0", len(gltf.accessors)))
        if given.shape[0] != count or given.shape[1] < 3:
            raise DataError(f"COLOR_0: got shape {given.shape}, expected ({count}, 3 or 4)", where=attributes.where)
        colour = colour * given[:, :3]
    uv = np.zeros((count, 2))
    if look.image is not None and f"TEXCOORD_{look.channel}" in attributes:
        uv = gltf.accessor(attributes.index(f"TEXCOORD_{look.channel}", len(gltf.accessors)))
        if uv.shape != (count, 2):
            raise DataError(f"TEXCOORD: got shape {uv.shape}, expected {(count, 2)}", where=attributes.where)
    parts.albedo.append(np.clip(colour, 0.0, 1.0))
    parts.uv.append(look.place(uv))
    parts.surface.append(np.full(count, len(parts.surfaces)))
    parts.looks.append(look)
    parts.surfaces.append(" / ".join(dict.fromkeys(filter(None, (*titles, look.name)))))


def _blendshapes(gltf: Gltf, parts: _Parts, bound: dict[str, list[Binding]]) -> dict[str, Blendshape]:
    """Blendshapes by name: the morph targets themselves, then VRM's expressions, which combine some."""
    sums: dict[str, list[tuple[Indices, Array]]] = {}
    for key, name in parts.names.items():
        sums.setdefault(name, []).extend(parts.moves.get(key, []))
    for name, binds in bound.items():
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
