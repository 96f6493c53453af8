"""VRM 0.x and 1.0: expressions that bind morph targets, and the humanoid's bones of the face.

VRM 0.x: ``extensions.VRM.blendShapeMaster.blendShapeGroups``, weights 0 to 100, bound to meshes. VRM 1.0:
``extensions.VRMC_vrm.expressions``, weights 0 to 1, bound to nodes. An expression has the name in the file; a preset
has the name of the preset.
"""

from dataclasses import dataclass

from fapengine.files.gltf.document import Gltf
from fapengine.files.gltf.json_cursor import Item

BONES = {"head": "head", "jaw": "jaw", "leftEye": "left eye", "rightEye": "right eye"}
UNKNOWN = "unknown"
"""Preset of expressions that VRM 0.x does not define."""


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
