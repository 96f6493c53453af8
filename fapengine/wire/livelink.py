"""Live Link Face over UDP: one datagram a frame, 61 floats; ARKit faces of Unreal and its kin listen on port 11111.

Layout, 306 bytes and the name::

    int32 LITTLE-endian   packet version, 6
    37 bytes ASCII        device: "$" and a UUID of 36 letters
    int32 big-endian      length of the name in bytes, not in letters
    UTF-8                 name of the subject
    int32, float32        frame number, fraction of a frame 0..1, big-endian like all that follows
    int32, int32          frame rate: numerator, denominator
    uint8                 number of shapes, 61
    61 x float32          ARKit's 52, then yaw, pitch, roll of head, left eye, right eye, rad

A packet that ends after the name says that the subject is there and its face is not seen: keep-alive.
"""

import re
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.retarget.arkit import approximate_arkit
from fapengine.wire.shapes import turns_rad

PORT = 11111
VERSION = 6
WIDTH = 61
MAX_NAME_BYTES = 256
DEVICE_BYTES = 37
_FACE = struct.Struct(">ifiiB")
_UUID = re.compile(r"[0-9A-Fa-f]{8}(-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}")


@dataclass(frozen=True, slots=True)
class Subject:
    """Who is seen, by which device."""

    name: str
    """1 to 256 bytes of UTF-8; what the receiver lists."""
    device: str
    """A UUID of 36 letters; one for each sender, the same in every packet."""

    def __post_init__(self) -> None:
        try:
            size = len(self.name.encode())
        except UnicodeEncodeError as error:
            raise UsageError(f"name: got {self.name!r:.40}, expected text that UTF-8 can hold") from error
        if not 1 <= size <= MAX_NAME_BYTES or "\0" in self.name:
            raise UsageError(f"name: got {self.name!r:.40} of {size} bytes, expected 1..{MAX_NAME_BYTES} without NUL")
        if not _UUID.fullmatch(self.device):
            raise UsageError(f"device: got {self.device!r:.60}, expected a UUID of 36 letters")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Face:
    """One frame. Arrays are read-only."""

    number: int
    """0..2**31 - 1."""
    fraction: float = 0.0
    """0..1: how far past the frame's start it was seen."""
    rate: tuple[int, int] = (60, 1)
    """Frames a second, numerator and denominator."""
    values: NDArray[np.float32]
    """(61,) float32: 52 weights, then yaw, pitch, roll of head, left eye, right eye in rad."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values, "values", (WIDTH,), np.float32))
        if not (0 <= self.number < 2**31 and 0 <= self.fraction <= 1):
            raise UsageError(f"frame: got number {self.number} and fraction {self.fraction}, expected 0.. and 0..1")
        if not all(1 <= part < 2**31 for part in self.rate):
            raise UsageError(f"rate: got {self.rate[0]}/{self.rate[1]}, expected positive numbers")


def livelink_values(faps: ArrayLike) -> NDArray[np.float32]:
    """Turn FAPs into the 61 values: (T, 68) FAPU -> (T, 61) float32; turns count as FAP 48 to 50 and 23 to 26 do."""
    turns = turns_rad(faps)
    return np.hstack([approximate_arkit(faps), turns.reshape(len(turns), 9)]).astype(np.float32)


def join_values(weights: ArrayLike, faps: ArrayLike) -> NDArray[np.float32]:
    """Put together the 61 values of one frame whose shapes are known: (52,) weights and (68,) FAPU."""
    turns = turns_rad(np.asarray(faps)[None])
    return np.concatenate([np.asarray(weights), turns.reshape(9)]).astype(np.float32)


def keep_alive(subject: Subject) -> bytes:
    """Write the packet that says the subject is there, without a face."""
    name = subject.name.encode()
    return struct.pack("<i", VERSION) + f"${subject.device}".encode() + struct.pack(">i", len(name)) + name


def encode_face(subject: Subject, face: Face) -> bytes:
    """Write one frame's packet."""
    fixed = _FACE.pack(face.number, face.fraction, *face.rate, WIDTH)
    return keep_alive(subject) + fixed + face.values.astype(">f4").tobytes()


def decode_packet(data: bytes) -> tuple[Subject, Face | None]:
    """Read one packet; a keep-alive has no face.

    Raises
    ------
    TruncatedError
        If it ends inside a field.
    UnsupportedError
        If version or number of shapes is another.
    DataError
        If a field cannot be, or bytes follow the last.
    """
    name_at = 4 + DEVICE_BYTES + 4
    if len(data) < name_at:
        raise TruncatedError(f"Live Link: got {len(data)} bytes, expected {name_at} before the name")
    (version,) = struct.unpack_from("<i", data, 0)
    if version != VERSION:
        raise UnsupportedError(f"Live Link: got packet version {version}, expected {VERSION}", where="byte 0")
    (size,) = struct.unpack_from(">i", data, name_at - 4)
    if not 1 <= size <= MAX_NAME_BYTES:
        raise DataError(f"name: got {size} bytes, expected 1..{MAX_NAME_BYTES}", where=f"byte {name_at - 4}")
    if len(data) < name_at + size:
        raise TruncatedError(f"name: got {len(data) - name_at} bytes of {size}", where=f"byte {name_at}")
    try:
        device = data[4 : 4 + DEVICE_BYTES].decode("ascii")
        if not device.startswith("$"):
            raise DataError(f"device: got {device!r}, expected $ and a UUID", where="byte 4")
        subject = Subject(data[name_at : name_at + size].decode(), device[1:])
        face = _face(data, name_at + size)
    except (UnicodeDecodeError, UsageError) as error:
        raise DataError(f"Live Link: {error}") from error
    return subject, face


def _face(data: bytes, at: int) -> Face | None:
    rest = len(data) - at
    if not rest:
        return None
    if rest < _FACE.size:
        raise TruncatedError(f"frame: got {rest} bytes, expected {_FACE.size} before its values", where=f"byte {at}")
    number, fraction, numerator, denominator, count = _FACE.unpack_from(data, at)
    at += _FACE.size
    if count != WIDTH:
        raise UnsupportedError(f"frame: got {count} shapes, expected {WIDTH}", where=f"byte {at - 1}")
    if len(data) - at < 4 * WIDTH:
        raise TruncatedError(f"values: got {len(data) - at} bytes, expected {4 * WIDTH}", where=f"byte {at}")
    if len(data) - at > 4 * WIDTH:
        raise DataError(f"{len(data) - at - 4 * WIDTH} bytes follow the values", where=f"byte {at + 4 * WIDTH}")
    values = np.frombuffer(data, ">f4", WIDTH, at)
    return Face(number=number, fraction=fraction, rate=(numerator, denominator), values=values)
