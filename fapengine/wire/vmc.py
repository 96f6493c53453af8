"""VMC (Virtual Motion Capture protocol 3.1): a face for VSeeFace, Warudo, Virtual Motion Capture and their kin.

Each frame is one immediate OSC bundle, split where it does not fit a datagram::

    /VMC/Ext/OK           i 1                               loaded
    /VMC/Ext/T            f seconds                         sign of life; a float32 tells 1 ms apart for 2.3 hours
    /VMC/Ext/Bone/Pos     s bone, f x3 position, f x4 rotation x y z w
    /VMC/Ext/Blend/Val    s name, f 0..1                    once for each shape
    /VMC/Ext/Blend/Apply                                    shows the values; always the last of the last datagram

Names are ARKit's ("Perfect Sync") or those of VRM's presets, and count with their case. Poses are local, metres,
in Unity's space: x the subject's right, y up, z out of the face, left-handed. Ports: 39539 to a program that shows
(Marionette), which gets all; 39540 to one that moves a model itself (Performer), which gets shapes alone.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.retarget.shape_rows import ARKIT_NAMES
from fapengine.retarget.vrm import SHOWN, VRM0_NAMES, VRM1_NAMES
from fapengine.wire import osc
from fapengine.wire.shapes import turns_rad

MARIONETTE_PORT, PERFORMER_PORT = 39539, 39540
MAX_DATAGRAM = 1472
"""Bytes: an Ethernet frame of 1500 without the heads of IP and UDP."""
PASCAL_NAMES = tuple(name[0].upper() + name[1:] for name in ARKIT_NAMES)
"""ARKit's names as Live Link spells them; some receivers want these."""
VRM0_SHOWN, VRM1_SHOWN = VRM0_NAMES[:SHOWN], VRM1_NAMES[:SHOWN]
"""Presets that are sent, looks left out; every receiver knows those of version 0, except ``Surprised``."""
BONES = ("Head", "LeftEye", "RightEye")

Weight = tuple[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class BonePose:
    """A bone of Unity's humanoid, relative to its parent. Arrays are read-only."""

    name: str
    rotation: NDArray[np.float64]
    """(4,) unit quaternion x, y, z, w in Unity's space."""
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, "rotation", (4,), np.float64))
        if abs(float(np.linalg.norm(self.rotation)) - 1.0) > 1e-6:
            raise UsageError(f"rotation: got length {np.linalg.norm(self.rotation):.6g}, expected a unit quaternion")


def encode_frame(
    weights: Sequence[Weight], *, time_s: float, bones: Sequence[BonePose] = (), limit: int = MAX_DATAGRAM
) -> list[bytes]:
    """Write a frame for a Marionette: datagrams, to be sent in this order.

    Parameters
    ----------
    weights : sequence of (name, weight)
        Weights 0..1; what is outside is clipped.
    time_s : float
        Seconds since the sender began.
    bones : sequence of BonePose
        Sent before the shapes.
    limit : int, bytes
        Largest datagram.

    Raises
    ------
    UsageError
        If a number is not finite, or ``limit`` has no room for one message.
    """
    if not math.isfinite(time_s):
        raise UsageError(f"time_s: got {time_s}, expected a finite number")
    head = [_ok(), osc.message("/VMC/Ext/T", "f", time_s)]
    return osc.bundles([*head, *map(_bone, bones), *_blend(weights)], limit=limit)


def encode_shapes(weights: Sequence[Weight], *, limit: int = MAX_DATAGRAM) -> list[bytes]:
    """Write a frame for a Performer: shapes alone, then Apply."""
    return osc.bundles(_blend(weights), limit=limit)


def head_and_eyes(faps: ArrayLike) -> tuple[BonePose, ...]:
    """Turn one frame's FAPs into poses of ``Head``, ``LeftEye`` and ``RightEye``: (68,) FAPU.

    Roll turns first, then pitch, then yaw, which is Unity's own order.
    """
    turns = turns_rad(frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)[None])[0]
    return tuple(BonePose(name, _rotation(*turn.tolist())) for name, turn in zip(BONES, turns, strict=True))


class ChangedShapes:
    """A filter of shapes that did not move; now and then all are sent, for what a network lost.

    Stateful.

    Fewer shapes fit one datagram, so that half a face is never applied.

    Parameters
    ----------
    names : sequence of str
        Names of the shapes, in the order of the weights.
    every : int
        Frames between two that send all.
    least : float
        A weight is sent when it is so far from what was sent last.
    """

    def __init__(self, names: Sequence[str], *, every: int = 60, least: float = 1 / 512) -> None:
        if every < 1 or not 0 <= least < 1:
            raise UsageError(f"got every {every} and least {least}, expected 1 or more and 0..1")
        self._names = tuple(names)
        self._every, self._least = every, least
        self._sent = np.full(len(self._names), np.inf)
        self._frame = 0

    def of(self, weights: ArrayLike) -> list[Weight]:
        """Take the next frame's weights, (B,); return the pairs to send."""
        row = frozen(weights, "weights", (len(self._names),), np.float64)
        due = (np.abs(row - self._sent) > self._least) | (self._frame % self._every == 0)
        due |= (row != self._sent) & ((row == 0) | (row == 1))  # a mouth that shuts, shuts wholly
        self._frame += 1
        self._sent = np.where(due, row, self._sent)
        return [(self._names[index], float(row[index])) for index in np.flatnonzero(due)]


def _blend(weights: Sequence[Weight]) -> list[bytes]:
    parts: list[bytes] = []
    for name, weight in weights:
        if not math.isfinite(weight):
            raise UsageError(f"{name}: got {weight}, expected a weight of 0..1")
        parts.append(_value_head(name) + struct.pack(">f", min(max(weight, 0.0), 1.0)))
    return [*parts, _apply()]


def _bone(pose: BonePose) -> bytes:
    return osc.message("/VMC/Ext/Bone/Pos", "sfffffff", pose.name, *pose.position_m, *pose.rotation.tolist())


def _rotation(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """FAP angles in rad (left, down, right ear down) to Unity's quaternion, y * x * z."""
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


@lru_cache(maxsize=1024)
def _value_head(name: str) -> bytes:
    return osc.message("/VMC/Ext/Blend/Val", "sf", name, 0.0)[:-4]


@lru_cache(maxsize=1)
def _apply() -> bytes:
    return osc.message("/VMC/Ext/Blend/Apply")


@lru_cache(maxsize=1)
def _ok() -> bytes:
    return osc.message("/VMC/Ext/OK", "i", 1)
