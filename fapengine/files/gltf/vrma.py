"""VRM animations (``VRMC_vrm_animation`` 1.0): motion for any VRM avatar, in a file of its own.

An expression's weight is the x of a node's translation, the gaze is the rotation of a node at the eyes, and bones are
nodes whose rest pose has no rotations. Presets are VRM's; ``arkit`` writes ARKit's 52 shapes as custom expressions,
which avatars with "Perfect Sync" have.
https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.files.gltf.clip import FaceMotion
from fapengine.files.gltf.writing import Curves, Row, Writer, quaternions_of
from fapengine.models.via_points import STRAIGHT
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.shape_rows import ARKIT_NAMES
from fapengine.retarget.vrm import SHOWN, VRM1_NAMES, approximate_presets, gaze_of

Array = NDArray[np.float64]

EXTENSION, SPECIFICATION = "VRMC_vrm_animation", "1.0"
BONES = (("hips", 0.9), ("spine", 1.0), ("chest", 1.2), ("neck", 1.4), ("head", 1.5))
"""Bones from the hips upwards, and their height above the ground, m."""
EYES_M = (0.0, 0.07, 0.08)
"""Position of the eyes relative to the joint of the head."""
PRESETS, CUSTOM = "vrm1", "arkit"
SETS = (PRESETS, CUSTOM)


def format_vrma(motion: FaceMotion, *, shapes: str = PRESETS, keys: str = STRAIGHT) -> bytes:
    """Write a motion as a VRM animation (GLB).

    Parameters
    ----------
    motion : FaceMotion
    shapes : str
        ``"vrm1"``: the presets except looks, which the gaze gives; ``"arkit"``: ARKit's 52 as custom expressions.
    keys : str
        ``"linear"`` or ``"cubic"``.
    """
    writer = Writer({"asset": {"version": "2.0", "generator": "fapengine"}, "extensionsUsed": [EXTENSION]})
    curves = Curves(writer, motion.rate_hz, keys)
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
        named = zip(VRM1_NAMES[:SHOWN], approximate_presets(motion.faps).T[:SHOWN], strict=True)
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
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("YX", np.stack(gaze_of(faps), axis=1)).as_matrix())
