"""VRM animations (``VRMC_vrm_animation`` 1.0): a motion for any VRM avatar, without one.

An expression's weight is the x of a node's place; the gaze is the turn of a node at the eyes; bones are nodes of a rest
pose without turns. Presets are VRM's; ``arkit`` writes ARKit's 52 as custom expressions, which avatars with "Perfect
Sync" have. https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.files.gltf.clip import FaceMotion
from fapengine.files.gltf.writing import Curves, Row, Writer, quaternions_of
from fapengine.models.via_points import STRAIGHT
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.shape_rows import ARKIT_NAMES
from fapengine.retarget.vrm import SHOWN, VRM1_NAMES, approximate_presets

Array = NDArray[np.float64]

EXTENSION, SPECIFICATION = "VRMC_vrm_animation", "1.0"
BONES = (("hips", 0.9), ("spine", 1.0), ("chest", 1.2), ("neck", 1.4), ("head", 1.5))
"""Bones from the hips up, and their height above the ground, m."""
EYES_M = (0.0, 0.07, 0.08)
"""Place of the eyes above and before the joint of the head."""
PRESETS, CUSTOM = "vrm1", "arkit"
SETS = (PRESETS, CUSTOM)


def format_vrma(motion: FaceMotion, *, shapes: str = PRESETS, keys: str = STRAIGHT) -> bytes:
    """Write a motion.

    Parameters
    ----------
    motion : FaceMotion
    shapes : str
        ``"vrm1"``: the presets, looks left to the gaze; ``"arkit"``: ARKit's 52 as custom expressions.
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
    curves.add_turns(head, quaternions_of(motion.turns["head"]))
    curves.add_turns(gaze, quaternions_of(gaze_of(motion.faps)))
    expressions: Row = {}
    for name, weights in _weights(motion.faps, shapes).items():
        if weights.any():
            node_number = writer.row("nodes", {"name": name})
            shown.append(node_number)
            expressions[name] = {"node": node_number}
            curves.add_places(node_number, weights[:, None] * [1.0, 0.0, 0.0])
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


def _weights(faps: Array, shapes: str) -> dict[str, Array]:
    if shapes == CUSTOM:
        return dict(zip(ARKIT_NAMES, approximate_arkit(faps).T, strict=True))
    return dict(zip(VRM1_NAMES[:SHOWN], approximate_presets(faps).T[:SHOWN], strict=True))


def gaze_of(faps: Array) -> Array:
    """(T, 3, 3): turn of both eyes together, the mean of theirs, from FAPs (T, 68)."""
    yaw, pitch = (
        faps[:, [fap.column(number) for number in numbers]].mean(axis=1) * AU_RAD for numbers in ((23, 24), (25, 26))
    )
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("YX", np.stack([yaw, pitch], axis=1)).as_matrix())
