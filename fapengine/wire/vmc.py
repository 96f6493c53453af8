"""VMC (Virtual Motion Capture protocol 3.1): a face for VSeeFace, Warudo and other VMC receivers.

Each frame is one immediate OSC bundle, split if it does not fit a datagram::

    /VMC/Ext/OK           i 1                               loaded
    /VMC/Ext/T            f seconds                         sign of life; a float32 resolves 1 ms for 2.3 hours
    /VMC/Ext/Bone/Pos     s bone, f x3 position, f x4 rotation x y z w
    /VMC/Ext/Blend/Val    s name, f 0..1                    once for each shape
    /VMC/Ext/Blend/Apply                                    shows the values; the end of the last datagram

Names are ARKit's ("Perfect Sync") or those of VRM's presets, case-sensitive. Poses are local, metres,
in Unity's space: x the subject's right, y up, z out of the face, left-handed. Ports: 39539 of a program that displays
(Marionette), which gets everything; 39540 of one that moves a model itself (Performer), which gets shapes only.
"""

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import SHOWN, VRM0_NAMES, VRM1_NAMES
from fapengine.wire import osc
from fapengine.wire.shapes import turns_rad

MARIONETTE_PORT, PERFORMER_PORT = 39539, 39540
MAX_DATAGRAM = 1472
"""Bytes: an Ethernet frame of 1500 without the headers of IP and UDP."""
PASCAL_NAMES = tuple(name[0].upper() + name[1:] for name in ARKIT_NAMES)
"""ARKit's names as Live Link spells them; some receivers require these."""
VRM0_SHOWN, VRM1_SHOWN = VRM0_NAMES[:SHOWN], VRM1_NAMES[:SHOWN]
"""Presets that are sent, without gaze; every receiver knows those of version 0, except ``Surprised``."""
BONES = ("Head", "LeftEye", "RightEye")

Weight = tuple[str, float]
Bone = tuple[str, NDArray[np.float64]]
"""Bone of Unity's humanoid, and its rotation relative to its parent: (4,) unit quaternion x, y, z, w."""


def encode_frame(
    weights: Sequence[Weight], *, time_s: float, bones: Sequence[Bone] = (), limit: int = MAX_DATAGRAM
) -> list[bytes]:
    """Encode a frame for a Marionette: datagrams, to be sent in this order.

    Raises UsageError if a number is not finite, or ``limit`` has no room for one message.

    Parameters
    ----------
    weights : sequence of (name, weight)
        Weights, clipped to 0..1.
    time_s : float
        Seconds since the sender began.
    bones : sequence of (name, quaternion)
        Sent before the shapes.
    limit : int, bytes
        Largest datagram.
    """
    if not math.isfinite(time_s):
        raise UsageError(f"time_s: got {time_s}, expected a finite number")
    head = [osc.message("/VMC/Ext/OK", "i", 1), osc.message("/VMC/Ext/T", "f", time_s)]
    poses = [
        osc.message("/VMC/Ext/Bone/Pos", "sfffffff", name, 0.0, 0.0, 0.0, *rotation.tolist())
        for name, rotation in bones
    ]
    return osc.bundles([*head, *poses, *_blend(weights)], limit=limit)


def encode_shapes(weights: Sequence[Weight], *, limit: int = MAX_DATAGRAM) -> list[bytes]:
    """Encode a frame for a Performer: shapes, then Apply."""
    return osc.bundles(_blend(weights), limit=limit)


def head_and_eyes(faps: ArrayLike) -> tuple[Bone, ...]:
    """Convert one frame's FAPs, (68,) FAPU, to rotations of ``Head``, ``LeftEye`` and ``RightEye``.

    The order of rotations is roll, pitch, yaw, as in Unity.
    """
    return tuple((name, _rotation(*turn.tolist())) for name, turn in zip(BONES, turns_rad(faps), strict=True))


class ChangedShapes:
    """Filter that drops unchanged shapes, except in every ``every``-th frame, against losses.

    Stateful.

    Fewer shapes fit one datagram, so that no partial face is applied.

    Parameters
    ----------
    names : sequence of str
        Names of the shapes, in the order of the weights.
    every : int
        Number of frames from one with all shapes to the next.
    least : float
        Smallest change of a weight that is sent.
    """

    def __init__(self, names: Sequence[str], *, every: int = 60, least: float = 1 / 512) -> None:
        if every < 1 or not 0 <= least < 1:
            raise UsageError(f"got every {every} and least {least}, expected 1 or more and 0 to 1")
        self._names = tuple(names)
        self._every, self._least = every, least
        self._sent = np.full(len(self._names), np.inf)
        self._frame = 0

    def of(self, weights: ArrayLike) -> list[Weight]:
        """Add the next frame's weights, (B,); return the pairs to send."""
        row = frozen(weights, "weights", (len(self._names),), np.float64)
        due = (np.abs(row - self._sent) > self._least) | (self._frame % self._every == 0)
        due |= (row != self._sent) & ((row == 0) | (row == 1))  # a closing mouth closes completely
        self._frame += 1
        self._sent = np.where(due, row, self._sent)
        return [(self._names[index], float(row[index])) for index in np.flatnonzero(due)]


def _blend(weights: Sequence[Weight]) -> list[bytes]:
    parts: list[bytes] = []
    for name, weight in weights:
        if not math.isfinite(weight):
            raise UsageError(f"{name}: got {weight}, expected a weight of 0 to 1")
        parts.append(osc.head("/VMC/Ext/Blend/Val", "sf", name) + struct.pack(">f", min(max(weight, 0.0), 1.0)))
    return [*parts, osc.message("/VMC/Ext/Blend/Apply")]


def _rotation(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """Convert FAP angles in rad (left, down, right ear down) to Unity's quaternion, y * x * z."""
    halves = (-yaw / 2, pitch / 2, -roll / 2)
    (sy, sx, sz), (cy, cx, cz) = map(math.sin, halves), map(math.cos, halves)
    return np.array(
        [
            cy * sx * cz + sy * cx * sz,
            sy * cx * cz - cy * sx * sz,
            cy * cx * sz - sy * sx * cz,
            cy * cx * cz + sy * sx * sz,
        ]
    )
