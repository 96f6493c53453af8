"""VRM 0.x and 1.0: expressions that bind morph targets, and the humanoid's bones of the face.

VRM 0.x: ``extensions.VRM.blendShapeMaster.blendShapeGroups``, weights 0 to 100, bound to meshes. VRM 1.0:
``extensions.VRMC_vrm.expressions``, weights 0 to 1, bound to nodes. Names are given as the file spells them, the
presets' by their preset.
"""

from dataclasses import dataclass

from fapengine.files.gltf.document import Gltf
from fapengine.files.gltf.json_cursor import Item

BONES = {"head": "head", "jaw": "jaw", "leftEye": "left eye", "rightEye": "right eye"}
UNKNOWN = "unknown"
"""The preset of VRM 0.x's own expressions."""


@dataclass(frozen=True, slots=True)
class Binding:
    """One target's share of an expression."""

    mesh: int
    target: int
    weight: float


def bindings(gltf: Gltf, nodes: list[Item]) -> dict[str, list[Binding]]:
    """Targets of each expression; none for a file that is no VRM.

    Raises
    ------
    DataError
        If an expression binds what is not there.
    """
    meshes = gltf.rows["meshes"]
    extensions = gltf.root.item("extensions")
    bound: dict[str, list[Binding]] = {}
    for group in extensions.item("VRM").item("blendShapeMaster").items("blendShapeGroups"):
        preset = group.string("presetName", UNKNOWN)
        name = group.string("name", "") if preset.lower() == UNKNOWN else preset
        bound[name] = [
            _bind(meshes, bind, bind.index("mesh", len(meshes)), bind.number("weight", 100.0) / 100.0)
            for bind in group.items("binds")
        ]
    expressions = extensions.item("VRMC_vrm").item("expressions")
    for kind in ("preset", "custom"):
        group = expressions.item(kind)
        for name in group:
            bound[name] = [
                _bind(meshes, bind, _mesh_of(bind, nodes, len(meshes)), bind.number("weight", 1.0))
                for bind in group.item(name).items("morphTargetBinds")
            ]
    return bound


def humanoid(gltf: Gltf, count: int) -> dict[str, int]:
    """Node of each bone of the face that a VRM names."""
    extensions = gltf.root.item("extensions")
    bound = {}
    for bone in extensions.item("VRM").item("humanoid").items("humanBones"):
        if limb := BONES.get(bone.string("bone", "")):
            bound[limb] = bone.index("node", count)
    bones = extensions.item("VRMC_vrm").item("humanoid").item("humanBones")
    for name, limb in BONES.items():
        if name in bones:
            bound[limb] = bones.item(name).index("node", count)
    return bound


def _mesh_of(bind: Item, nodes: list[Item], count: int) -> int:
    return nodes[bind.index("node", len(nodes))].index("mesh", count)


def _bind(meshes: list[Item], bind: Item, mesh: int, weight: float) -> Binding:
    most = max((len(item.items("targets")) for item in meshes[mesh].items("primitives")), default=0)
    return Binding(mesh, bind.index("index", max(most, 1)), weight)
