"""Live Link Face over UDP: one datagram of 61 floats per frame, for ARKit faces in Unreal; its port is 11111.

Layout, 306 bytes and the name::

    int32 LITTLE-endian   packet version, 6
    37 bytes ASCII        device: "$" and a UUID of 36 characters
    int32 big-endian      length of the name in bytes, not in characters
    UTF-8                 name of the subject
    int32, float32        frame number, fraction of a frame 0..1, big-endian like the rest
    int32, int32          frame rate: numerator, denominator
    uint8                 number of shapes, 61
    61 x float32          ARKit's 52, then yaw, pitch, roll of head, left eye, right eye, rad

A packet that ends after the name is a keep-alive: the subject is connected, its face is not seen.
"""

import re
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.wire.shapes import turns_rad

PORT = 11111
VERSION = 6
WIDTH = 61
MAX_NAME_BYTES = 256
_FACE = struct.Struct(">ifiiB")
_UUID = re.compile(r"[0-9A-Fa-f]{8}(-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}")


@dataclass(frozen=True, slots=True)
class Subject:
    """Name and device of the face."""

    name: str
    """1 to 256 bytes of UTF-8; receivers list it."""
    device: str
    """A UUID of 36 characters; one per sender, the same in every packet."""

    def __post_init__(self) -> None:
        try:
            size = len(self.name.encode())
        except UnicodeEncodeError as error:
            raise UsageError(f"name: got {self.name!r:.40}, expected text that UTF-8 can hold") from error
        if not 1 <= size <= MAX_NAME_BYTES or "\0" in self.name:
            raise UsageError(f"name: got {self.name!r:.40} of {size} bytes, expected 1 to {MAX_NAME_BYTES} without NUL")
        if not _UUID.fullmatch(self.device):
            raise UsageError(f"device: got {self.device!r:.60}, expected a UUID of 36 characters")


def livelink_values(weights: ArrayLike, faps: ArrayLike) -> NDArray[np.float32]:
    """Return the 61 values of one frame, float32: (52,) weights, then the head and eye angles of (68,) FAPU."""
    return np.concatenate([np.asarray(weights), turns_rad(faps).reshape(9)]).astype(np.float32)


def encode_face(
    subject: Subject, values: ArrayLike, *, number: int, fraction: float = 0.0, rate: tuple[int, int] = (60, 1)
) -> bytes:
    """Encode one frame.

    Raises UsageError if a number is out of range.

    Parameters
    ----------
    subject : Subject
    values : (61,) float32
        52 weights, then yaw, pitch and roll of head, left eye and right eye in rad.
    number : int
        0..2**31 - 1.
    fraction : float
        0..1: time of capture after the start of the frame.
    rate : (int, int)
        Frames per second: numerator and denominator.
    """
    row = frozen(values, "values", (WIDTH,), np.float32)
    if not (0 <= number < 2**31 and 0 <= fraction <= 1):
        raise UsageError(f"frame: got number {number} and fraction {fraction}, expected 0 or more and 0 to 1")
    if not all(1 <= part < 2**31 for part in rate):
        raise UsageError(f"rate: got {rate[0]}/{rate[1]}, expected positive numbers")
    name = subject.name.encode()
    head = struct.pack("<i", VERSION) + f"${subject.device}".encode() + struct.pack(">i", len(name)) + name
    return head + _FACE.pack(number, fraction, *rate, WIDTH) + row.astype(">f4").tobytes()
