"""VRChat over OSC: avatar parameters in VRCFaceTracking's Unified Expressions, and native eyes.

Plain messages, one per datagram (support of bundles is not documented), to port 9000::

    /avatar/parameters/<prefix>v2/<name>   f     one for each row of UNIFIED; the avatar's author chooses the prefix
    /avatar/parameters/<name>              i f or T/F
    /tracking/eye/EyesClosedAmount         f 0..1, both eyes
    /tracking/eye/LeftRightPitchYaw        ffff  left pitch, left yaw, right pitch, right yaw; degrees, positive is down
                                                 and the subject's right

After 10 s without eyes VRChat blinks and looks by itself. ``Viseme`` and ``Voice`` are outputs of VRChat. ARKit's
mouthLeft and mouthRight are not sent: their Unified name is not documented.
"""

import struct
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.wire import osc
from fapengine.wire.shapes import turns_rad

PORT = 9000
PARAMETERS = "/avatar/parameters/"
LID_OPEN = 0.75
"""EyeLid: 0 closed, 0.75 open, 1 wide."""
_SIDES = ("Left", "Right")
_SIDED = (  # ARKit's name and Unified's, each with Left and Right
    ("eyeSquint", "EyeSquint"), ("browDown", "BrowDown"), ("browOuterUp", "BrowOuterUp"),
    ("cheekSquint", "CheekSquint"), ("noseSneer", "NoseSneer"), ("mouthUpperUp", "MouthUpperUp"),
    ("mouthLowerDown", "MouthLowerDown"), ("mouthSmile", "MouthCornerPull"), ("mouthFrown", "MouthFrown"),
    ("mouthDimple", "MouthDimple"), ("mouthStretch", "MouthStretch"), ("mouthPress", "MouthPress"),
)  # fmt: skip
_BOTH = (  # one shape of ARKit, two of Unified
    ("browInnerUp", "BrowInnerUp"), ("cheekPuff", "CheekPuffSuck"), ("mouthFunnel", "LipFunnelUpper"),
    ("mouthFunnel", "LipFunnelLower"), ("mouthPucker", "LipPuckerUpper"), ("mouthPucker", "LipPuckerLower"),
    ("mouthRollUpper", "LipSuckUpper"), ("mouthRollLower", "LipSuckLower"),
)  # fmt: skip
_SINGLE = (
    ("jawOpen", "JawOpen"), ("mouthClose", "MouthClosed"), ("jawForward", "JawZ"),
    ("mouthShrugUpper", "MouthRaiserUpper"), ("mouthShrugLower", "MouthRaiserLower"), ("tongueOut", "TongueOut"),
)  # fmt: skip

Row = tuple[str, float, tuple[tuple[str, float], ...]]
UNIFIED: tuple[Row, ...] = (
    *((name, 0.0, ((arkit, 1.0),)) for arkit, name in _SINGLE),
    ("JawX", 0.0, (("jawRight", 1.0), ("jawLeft", -1.0))),
    *(
        (f"EyeLid{side}", LID_OPEN, ((f"eyeBlink{side}", -LID_OPEN), (f"eyeWide{side}", 1 - LID_OPEN)))
        for side in _SIDES
    ),
    *((name + side, 0.0, ((arkit + side, 1.0),)) for arkit, name in _SIDED for side in _SIDES),
    *((name + side, 0.0, ((arkit, 1.0),)) for arkit, name in _BOTH for side in _SIDES),
)
"""Name after ``v2/``, its value at rest, and the factor of each ARKit shape."""


def encode_unified(weights: ArrayLike, *, prefix: str = "") -> list[bytes]:
    """Encode one frame of ARKit weights, (52,), as Unified Expressions: a datagram for each row of ``UNIFIED``."""
    row = frozen(weights, "weights", (len(ARKIT_NAMES),), np.float64)
    rest, matrix = _matrix()
    low = np.where(matrix.min(axis=1) * (rest == 0) < 0, -1.0, 0.0)
    values = np.clip(rest + matrix @ row, low, 1.0)
    return [
        osc.head(f"{PARAMETERS}{prefix}v2/{name}", "f") + struct.pack(">f", value)
        for (name, _, _), value in zip(UNIFIED, values.tolist(), strict=True)
    ]


def encode_eyes(faps: ArrayLike, weights: ArrayLike) -> list[bytes]:
    """Encode lids and gaze of one frame for VRChat's native eyes: two datagrams.

    Parameters
    ----------
    faps : (68,) FAPU
        FAP 23 to 26 are the gaze.
    weights : (52,)
        Of ARKit's shapes, same frame; the mean of both blinks closes the lids.
    """
    row = frozen(weights, "weights", (len(ARKIT_NAMES),), np.float64)
    blinks = [row[ARKIT_NAMES.index(f"eyeBlink{side}")] for side in _SIDES]
    turns = np.degrees(turns_rad(faps))
    (left_yaw, left_pitch), (right_yaw, right_pitch) = turns[1, :2].tolist(), turns[2, :2].tolist()
    return [
        osc.message("/tracking/eye/EyesClosedAmount", "f", float(np.clip(np.mean(blinks), 0.0, 1.0))),
        osc.message("/tracking/eye/LeftRightPitchYaw", "ffff", left_pitch, -left_yaw, right_pitch, -right_yaw),
    ]


@cache
def _matrix() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values at rest, (U,), and factors of the shapes, (U, 52)."""
    matrix = np.zeros((len(UNIFIED), len(ARKIT_NAMES)))
    for index, (_, _, adds) in enumerate(UNIFIED):
        for name, weight in adds:
            matrix[index, ARKIT_NAMES.index(name)] = weight
    return np.array([rest for _, rest, _ in UNIFIED]), matrix
