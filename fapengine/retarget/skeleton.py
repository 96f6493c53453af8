"""A body of joints below a head, for programs that expect one: names of Mixamo and VRM, and the pose at rest.

Theory of operation
-------------------
Joints below the neck move nothing but the collar; they are there because programs look for them by name and turn them.
The pose at rest is a T. As in Mixamo's and Ready Player Me's avatars, the y axis of an arm's, finger's or leg's joint
points along it, so that poses made for those avatars fit; from hips to head the axes are those of the scene (x the
subject's left, y up, z forward). :data:`BODY` states the left side; the right one is its mirror image.

Names are those of https://docs.readyplayer.me/ready-player-me/api-reference/avatars/full-body-avatars and
https://github.com/vrm-c/vrm-specification/blob/master/specification/VRMC_vrm-1.0/humanoid.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FAP_COUNT
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.rig_weights import OCULUS_SPELLINGS
from fapengine.retarget.visemes import VOWELS, VRM1_NAMES, presets_to_faps

Vector = tuple[float, float, float]
STRAIGHT: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint at rest."""

    name: str
    parent: str | None
    vrm: str
    """Name of the bone in VRM 1.0."""
    place: Vector
    """Position in the parent's frame, m."""
    turn: Vector = STRAIGHT
    """Rotation in the parent's frame, rad: about x, then about the new y, then about the new z."""


# fmt: off
BODY = (
    Joint("Hips",          None,            "hips",                   (0.0, 0.95, 0.0)),
    Joint("Spine",         "Hips",          "spine",                  (0.0, 0.09, 0.0)),
    Joint("Spine1",        "Spine",         "chest",                  (0.0, 0.11, 0.0)),
    Joint("Spine2",        "Spine1",        "upperChest",             (0.0, 0.12, 0.0)),
    Joint("LeftShoulder",  "Spine2",        "leftShoulder",           (0.06, 0.09, 0.0), (np.pi / 2, 0.0, -np.pi / 2)),
    Joint("LeftArm",       "LeftShoulder",  "leftUpperArm",           (0.0, 0.12, 0.0)),
    Joint("LeftForeArm",   "LeftArm",       "leftLowerArm",           (0.0, 0.27, 0.0)),
    Joint("LeftHand",      "LeftForeArm",   "leftHand",               (0.0, 0.25, 0.0)),
    Joint("LeftUpLeg",     "Hips",          "leftUpperLeg",           (0.09, -0.05, 0.0), (0.0, 0.0, np.pi)),
    Joint("LeftLeg",       "LeftUpLeg",     "leftLowerLeg",           (0.0, 0.42, 0.0)),
    Joint("LeftFoot",      "LeftLeg",       "leftFoot",               (0.0, 0.41, 0.0), (1.17, 0.0, 0.0)),
    Joint("LeftToeBase",   "LeftFoot",      "leftToes",               (0.0, 0.13, 0.0), (0.4, 0.0, 0.0)),
    Joint("LeftHandThumb1", "LeftHand",      "leftThumbMetacarpal",   (-0.025, 0.03, 0.0), (0.0, 0.0, np.pi / 4)),
    Joint("LeftHandThumb2", "LeftHandThumb1", "leftThumbProximal",    (0.0, 0.04, 0.0)),
    Joint("LeftHandThumb3", "LeftHandThumb2", "leftThumbDistal",      (0.0, 0.03, 0.0)),
    Joint("LeftHandIndex1", "LeftHand",      "leftIndexProximal",     (-0.03, 0.09, 0.0)),
    Joint("LeftHandIndex2", "LeftHandIndex1", "leftIndexIntermediate", (0.0, 0.037, 0.0)),
    Joint("LeftHandIndex3", "LeftHandIndex2", "leftIndexDistal",      (0.0, 0.025, 0.0)),
    Joint("LeftHandMiddle1", "LeftHand",     "leftMiddleProximal",    (-0.008, 0.093, 0.0)),
    Joint("LeftHandMiddle2", "LeftHandMiddle1", "leftMiddleIntermediate", (0.0, 0.042, 0.0)),
    Joint("LeftHandMiddle3", "LeftHandMiddle2", "leftMiddleDistal",   (0.0, 0.028, 0.0)),
    Joint("LeftHandRing1", "LeftHand",      "leftRingProximal",       (0.013, 0.088, 0.0)),
    Joint("LeftHandRing2", "LeftHandRing1", "leftRingIntermediate",   (0.0, 0.038, 0.0)),
    Joint("LeftHandRing3", "LeftHandRing2", "leftRingDistal",         (0.0, 0.026, 0.0)),
    Joint("LeftHandPinky1", "LeftHand",      "leftLittleProximal",    (0.033, 0.08, 0.0)),
    Joint("LeftHandPinky2", "LeftHandPinky1", "leftLittleIntermediate", (0.0, 0.03, 0.0)),
    Joint("LeftHandPinky3", "LeftHandPinky2", "leftLittleDistal",     (0.0, 0.02, 0.0)),
)
# fmt: on
"""Joints of an adult without those of the head. The joint of the neck is 1.42 m above the ground."""
CHEST = "Spine2"
NECK_PLACE: Vector = (0.0, 0.15, 0.0)
"""Joint of the neck in the frame of :data:`CHEST`."""
FACE: Mapping[str, tuple[str | None, str]] = {
    "Neck": (None, "neck"),
    "Head": ("Neck", "head"),
    "Jaw": ("Head", "jaw"),
    "LeftEye": ("Head", "leftEye"),
    "RightEye": ("Head", "rightEye"),
}
"""Parent and VRM's name of each joint of a head; the first joints of every skeleton."""

EXTRAS = {
    "mouthOpen": {"jawOpen": 0.5},
    "mouthSmile": {"mouthSmileLeft": 0.8, "mouthSmileRight": 0.8},
    "eyesClosed": {"eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "eyesLookUp": {"eyeLookUpLeft": 1.0, "eyeLookUpRight": 1.0},
    "eyesLookDown": {"eyeLookDownLeft": 1.0, "eyeLookDownRight": 1.0},
}
"""Shapes of Ready Player Me beyond ARKit's and Oculus', as mixtures of ARKit's: those of TalkingHead's ``mtExtras``."""
LIDS = {"eyeBlinkLeft": (19, 21), "eyeBlinkRight": (20, 22)}
"""FAPs of both lids of a blink."""
CLOSED_FAPU = 1024.0
"""Sum of both at which lids meet: the iris' diameter is the distance of the lids (ISO/IEC 14496-2, Annex C)."""
PRESET_SHAPES = {name: (f"viseme_{OCULUS_SPELLINGS[viseme.lower()]}",) for name, viseme in VOWELS.items()} | {
    "blink": ("eyeBlinkLeft", "eyeBlinkRight"),
    "blinkLeft": ("eyeBlinkLeft",),
    "blinkRight": ("eyeBlinkRight",),
    "lookUp": ("eyeLookUpLeft", "eyeLookUpRight"),
    "lookDown": ("eyeLookDownLeft", "eyeLookDownRight"),
    "lookLeft": ("eyeLookOutLeft", "eyeLookInRight"),
    "lookRight": ("eyeLookInLeft", "eyeLookOutRight"),
    "neutral": (),
}
"""Shapes of ARKit and Oculus that make VRM's presets; moods are shapes of their own (:func:`mood_shapes`)."""


def arkit_shapes() -> dict[str, Array]:
    """(68,) FAPU of each of ARKit's shapes at full weight; those of blinks close the eye, as in avatars.

    The measured rows leave it open by 15 % (``arkit.npz``).
    """
    shapes = dict(zip(ARKIT_NAMES, arkit_map().faps, strict=True))
    for name, numbers in LIDS.items():
        shapes[name] = shapes[name] * (CLOSED_FAPU / shapes[name][fap.columns(*numbers)].sum())
    return shapes


def extra_shapes() -> dict[str, Array]:
    """(68,) FAPU of each of :data:`EXTRAS` at full weight."""
    arkit = arkit_shapes()
    return {
        name: sum((weight * arkit[shape] for shape, weight in mix.items()), np.zeros(FAP_COUNT))
        for name, mix in EXTRAS.items()
    }


def mood_shapes() -> dict[str, Array]:
    """(68,) FAPU of each mood of VRM at full weight."""
    rows = dict(zip(VRM1_NAMES, presets_to_faps(np.eye(len(VRM1_NAMES))), strict=True))
    return {name: row for name, row in rows.items() if name not in PRESET_SHAPES}


def face_joints(places_m: Array) -> tuple[Joint, ...]:
    """Joints of a head alone, at these places of the scene, (5, 3) in the order of :data:`FACE`."""
    at = dict(zip(FACE, places_m, strict=True))
    return tuple(
        Joint(name, parent, vrm, _vector(at[name] if parent is None else at[name] - at[parent]))
        for name, (parent, vrm) in FACE.items()
    )


def on_body(face: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Joints of a head, then those of the body that carries it: the hips have no parent."""
    neck, *others = face
    right = (_mirrored(joint) for joint in BODY if joint.name.startswith("Left"))
    return (replace(neck, parent=CHEST, place=NECK_PLACE), *others, *BODY, *right)


def _vector(values: Array) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def _mirrored(joint: Joint) -> Joint:
    (x, y, z), (about_x, about_y, about_z) = joint.place, joint.turn
    return Joint(
        name=joint.name.replace("Left", "Right"),
        parent=joint.parent and joint.parent.replace("Left", "Right"),
        vrm=joint.vrm.replace("left", "right"),
        place=(-x, y, z),
        turn=(about_x, -about_y, -about_z),
    )


def rest_matrices(joints: tuple[Joint, ...]) -> Array:
    """(J, 4, 4): from each joint's frame to the scene, at rest."""
    from scipy.spatial.transform import Rotation

    rows = {joint.name: joint for joint in joints}
    world: dict[str | None, Array] = {None: np.eye(4)}

    def matrix(joint: Joint) -> Array:
        if joint.name not in world:
            local = np.eye(4)
            local[:3, :3] = Rotation.from_euler("XYZ", joint.turn).as_matrix()
            local[:3, 3] = joint.place
            above = world[None] if joint.parent is None else matrix(rows[joint.parent])
            world[joint.name] = above @ local
        return world[joint.name]

    return np.stack([matrix(joint) for joint in joints])
