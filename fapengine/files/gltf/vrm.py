"""The part of a head's GLB that makes it an avatar in VRM 1.0: bones, expressions, gaze and permissions.

https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm-1.0
"""

from fapengine.files.gltf.writing import Row
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.notice import ICT_COPYRIGHT, ICT_NOTICE
from fapengine.retarget.puppet import HEAD, LEFT_EYE, RIGHT_EYE, Puppet
from fapengine.retarget.skeleton import PRESET_SHAPES
from fapengine.retarget.visemes import VRM1_NAMES

EXTENSION, SPECIFICATION = "VRMC_vrm", "1.0"
LICENSE_URL = "https://vrm.dev/licenses/1.0/"
"""Required by VRM; the fields beside it say what the licence permits."""
OPEN_LICENCES = {"Apache-2.0": "https://www.apache.org/licenses/LICENSE-2.0"}
"""Licences under which everybody may use, change and sell an avatar; VRM's defaults forbid it for others."""
OPEN_PERMISSIONS: Row = {
    "avatarPermission": "everyone", "commercialUsage": "corporation", "allowPoliticalOrReligiousUsage": True,
    "creditNotation": "required", "allowRedistribution": True, "modification": "allowModificationRedistribution",
}  # fmt: skip
"""Nothing is said about violent, sexual and hateful content: VRM's default is no, and a head may be a child's."""
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
