"""A head as a GLB: meshes with morph targets, a skin, textures, its licence, and what makes it an avatar in VRM 1.0.

Of VRM: bones, expressions, gaze and permissions,
https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm-1.0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.files.gltf.writing import INDICES, VERTICES, Curves, Row, Writer, quaternions_of
from fapengine.files.pictures import format_png
from fapengine.files.provenance import mark
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.ict_notice import ICT_COPYRIGHT, ICT_NOTICE, copyright_line
from fapengine.retarget.puppet import DOUBLE_SIDED, HEAD, JOINTS, LEFT_EYE, RIGHT_EYE, Part, Puppet
from fapengine.retarget.skeleton import PRESET_SHAPES, rest_matrices
from fapengine.retarget.visemes import VRM1_NAMES

GENERATOR = "fapengine"
ROOT = "Armature"
"""Node above the joints and meshes of a head on a body, by the name that TalkingHead looks for."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeClip:
    """Animation of a head within its file: weights of its shapes, and motion of the whole head."""

    weights: Mapping[str, NDArray[np.float64]]
    """(T,) weights by the name of a shape."""
    head: NDArray[np.float64]
    """(T, 4, 4): motion from rest, in m."""
    rate_hz: float
    name: str
    keys: str
    """``"linear"`` or ``"cubic"``: see :func:`fapengine.models.via_points.key_curve`."""


def format_head(puppet: Puppet, *, licence: str, source: str, clip: ShapeClip | None = None, vrm: str = "") -> bytes:
    """Write a head, optionally with an animation, as GLB; ``asset`` states source and licence.

    Each part is a skinned mesh with the shapes that move it. With a name in ``vrm``, the file is an avatar of that name
    in VRM 1.0: the puppet is on a body, and has the shapes of :func:`fapengine.retarget.skeleton.mood_shapes`.
    """
    asset: Row = {"version": "2.0", "generator": GENERATOR, "copyright": copyright_line(source, licence)}
    asset["extras"] = {"license": licence, "notice": ICT_NOTICE, **mark()}
    writer = Writer({"asset": asset, "scene": 0, "scenes": [{"nodes": []}]})
    skin = _add_skin(writer, puppet)
    nodes = [
        writer.row("nodes", {"name": part.name, "mesh": _add_mesh(writer, part), "skin": skin}) for part in puppet.parts
    ]
    shown = [number for number, joint in enumerate(puppet.skeleton) if joint.parent is None] + nodes
    if len(puppet.skeleton) > len(JOINTS):
        shown = [writer.row("nodes", {"name": ROOT, "children": shown})]
    writer.document["scenes"][0]["nodes"] = shown
    if clip is not None:
        _add_clip(writer, puppet, nodes, clip)
    if vrm:
        add_vrm(writer.document, puppet, nodes, name=vrm, licence=licence, source=source)
    return writer.glb()


def _add_clip(writer: Writer, puppet: Puppet, nodes: list[int], clip: ShapeClip) -> None:
    """Add the curves of the shapes' weights and of the head's joint; joints are the first nodes."""
    curves = Curves(writer, clip.rate_hz, clip.keys)
    still = np.zeros(len(clip.head))
    for node, part in zip(nodes, puppet.parts, strict=True):
        if any(name in clip.weights for name in part.shapes):
            weights = np.stack([clip.weights.get(name, still) for name in part.shapes], axis=1)
            curves.add(node, "weights", weights)
    turns = clip.head[:, :3, :3]
    if (clip.head != np.eye(4)).any():
        curves.add(HEAD, "rotation", quaternions_of(turns))
        moved = turns @ puppet.joints[HEAD] + clip.head[:, :3, 3] - puppet.joints[HEAD]
        curves.add(HEAD, "translation", puppet.skeleton[HEAD].place + moved)
    writer.row("animations", curves.row(clip.name))


def _add_skin(writer: Writer, puppet: Puppet) -> int:
    for joint in puppet.skeleton:
        node: Row = {"name": joint.name, "translation": list(joint.place)}
        if any(joint.turn):
            from scipy.spatial.transform import Rotation

            node["rotation"] = Rotation.from_euler("XYZ", joint.turn).as_quat().tolist()
        below = [number for number, child in enumerate(puppet.skeleton) if child.parent == joint.name]
        writer.row("nodes", node | ({"children": below} if below else {}))
    bind = np.linalg.inv(rest_matrices(puppet.skeleton)).transpose(0, 2, 1)  # column by column
    matrices = writer.accessor(bind.reshape(-1, 16).astype(np.float32))
    root = next(number for number, joint in enumerate(puppet.skeleton) if joint.parent is None)
    return writer.row(
        "skins", {"joints": list(range(len(puppet.skeleton))), "inverseBindMatrices": matrices, "skeleton": root}
    )


def _add_mesh(writer: Writer, part: Part) -> int:
    order, weights = part.influences()
    attributes = {
        "POSITION": writer.accessor(part.vertices, target=VERTICES, bounds=True),
        "NORMAL": writer.accessor(part.normals, target=VERTICES),
        "COLOR_0": writer.accessor(part.colours, target=VERTICES),
        "JOINTS_0": writer.accessor(np.where(weights > 0, order, 0).astype(np.uint8), target=VERTICES),
        "WEIGHTS_0": writer.accessor(weights.astype(np.float32), target=VERTICES),
    }
    if part.texture is not None:
        attributes["TEXCOORD_0"] = writer.accessor(part.uv, target=VERTICES)
    indices = part.triangles.ravel().astype(np.uint16 if len(part.vertices) < 1 << 16 else np.uint32)
    primitive: Row = {
        "attributes": attributes,
        "indices": writer.accessor(indices, target=INDICES),
        "material": _add_material(writer, part),
    }
    mesh: Row = {"name": part.name, "primitives": [primitive]}
    if part.shapes:
        primitive["targets"] = [
            {"POSITION": writer.sparse(shape.moves), "NORMAL": writer.sparse(shape.turns)}
            for shape in part.shapes.values()
        ]
        mesh |= {"weights": [0.0] * len(part.shapes), "extras": {"targetNames": list(part.shapes)}}
    return writer.row("meshes", mesh)


def _add_material(writer: Writer, part: Part) -> int:
    surface: Row = {"metallicFactor": 0.0, "roughnessFactor": part.roughness}
    material: Row = {"name": part.name, "pbrMetallicRoughness": surface}
    if part.texture is not None:
        surface["baseColorTexture"] = {"index": _add_texture(writer, part.texture)}
        if part.texture.shape[2] == 4:
            material["alphaMode"] = "MASK"
    if part.name in DOUBLE_SIDED:
        material["doubleSided"] = True
    return writer.row("materials", material)


def _add_texture(writer: Writer, texture: NDArray[np.uint8]) -> int:
    data = format_png(texture)
    for number, row in enumerate(writer.document.get("images", [])):  # parts share the head's texture
        view = writer.document["bufferViews"][row["bufferView"]]
        if writer.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]] == data:
            return number
    image = writer.row("images", {"bufferView": writer.view(data), "mimeType": "image/png"})
    return writer.row("textures", {"source": image})


EXTENSION, SPECIFICATION = "VRMC_vrm", "1.0"
LICENSE_URL = "https://vrm.dev/licenses/1.0/"
"""Required by VRM; the fields beside it say what the licence permits."""
OPEN_LICENCES = {"Apache-2.0": "https://www.apache.org/licenses/LICENSE-2.0"}
"""Licences under which everybody may use, change and sell an avatar; VRM's defaults forbid it for others."""
OPEN_PERMISSIONS: Row = {
    "avatarPermission": "everyone", "commercialUsage": "corporation", "allowPoliticalOrReligiousUsage": True,
    "creditNotation": "required", "allowRedistribution": True, "modification": "allowModificationRedistribution",
}  # fmt: skip
"""Violent, sexual and hateful use is left unset: VRM's default forbids it, and a head may be a child's."""
LOOK_DEG = 30.0
"""Turn of the eyes up to which the gaze of a program is followed."""


def add_vrm(document: Row, puppet: Puppet, nodes: list[int], *, name: str, licence: str, source: str) -> None:
    """Add the extension to a document whose first nodes are the joints of a puppet on a body.

    ``nodes`` show the puppet's parts. Presets are VRM's; ARKit's shapes are custom expressions ("Perfect Sync").
    """
    meta: Row = {
        "name": name, "authors": [source], "licenseUrl": LICENSE_URL, "copyrightInformation": f"{source}; {licence}",
        "thirdPartyLicenses": f"{ICT_COPYRIGHT}\n\n{ICT_NOTICE}",
    }  # fmt: skip
    if licence in OPEN_LICENCES:
        meta |= OPEN_PERMISSIONS | {"otherLicenseUrl": OPEN_LICENCES[licence]}
    presets = {preset: _expression(puppet, nodes, PRESET_SHAPES.get(preset, (preset,))) for preset in VRM1_NAMES}
    custom = {shape: _expression(puppet, nodes, (shape,)) for shape in ARKIT_NAMES}
    angle = {"inputMaxValue": LOOK_DEG, "outputScale": LOOK_DEG}
    eyes_m = puppet.joints[[LEFT_EYE, RIGHT_EYE]].mean(axis=0) - puppet.joints[HEAD]
    document["extensionsUsed"] = [EXTENSION]
    document["extensions"] = {
        EXTENSION: {
            "specVersion": SPECIFICATION,
            "meta": meta,
            "humanoid": {"humanBones": {joint.vrm: {"node": row} for row, joint in enumerate(puppet.skeleton)}},
            "expressions": {"preset": presets, "custom": custom},
            "lookAt": {
                "offsetFromHeadBone": eyes_m.tolist(),
                "type": "bone",
                **{
                    f"rangeMap{way}": angle
                    for way in ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
                },
            },
        }
    }


def _expression(puppet: Puppet, nodes: list[int], shapes: tuple[str, ...]) -> Row:
    """Bind shapes at full weight, in every part that they move."""
    binds = [
        {"node": node, "index": list(part.shapes).index(shape), "weight": 1.0}
        for node, part in zip(nodes, puppet.parts, strict=True)
        for shape in shapes
        if shape in part.shapes
    ]
    return {"morphTargetBinds": binds} if binds else {}
