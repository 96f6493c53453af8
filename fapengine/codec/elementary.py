"""A face stream as a visual elementary stream: its headers, its access units, and its level.

MP4 files and RTP carry a stream plane by plane. Each plane has its time, and whole bytes that begin with a start code.
So such a stream must be encoded with a start code before every plane.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from fapengine.codec.bits import FACE_TYPE, OBJECT_START, PLANE_START, SEQUENCE_START, VISUAL_OBJECT, code
from fapengine.codec.decoder import Decoded, decode
from fapengine.errors import DataError

START_CODE_BYTES = 4


@dataclass(frozen=True, slots=True)
class Level:
    """A level of the profile Simple Face Animation, for one face."""

    number: int
    profile: int
    """Byte of the sequence header."""
    max_bit_s: int
    """Greatest number of bits in any second."""
    max_rate_hz: float
    """Greatest frame rate."""


LEVELS = (Level(1, 0x61, 16_000, 72.0), Level(2, 0x62, 32_000, 72.0))
"""[MEM] bounds of bits and frames; the bytes are those of FBA section 1."""


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One plane in whole bytes."""

    data: bytes
    """From its start code up to the next one. The first unit begins with the object start code."""
    frame: int
    """Frame number: its time is this divided by the frame rate."""
    intra: bool


def visual_headers(profile: int) -> bytes:
    """Return the headers before a face object in a visual elementary stream (FBA section 1; fields [MEM]).

    Examples
    --------
    >>> visual_headers(0x61).hex(" ")
    '00 00 01 b0 61 00 00 01 b5 23'
    """
    no_identifier, stuffing = 0, 0b011
    return code(SEQUENCE_START) + bytes([profile]) + code(VISUAL_OBJECT) + bytes(
        [no_identifier << 7 | FACE_TYPE << 3 | stuffing]
    )  # fmt: skip


def access_units(stream: bytes, decoded: Decoded | None = None) -> list[AccessUnit]:
    """Split a stream into its planes.

    Parameters
    ----------
    stream : bytes
        A face stream with a start code before every plane.
    decoded : Decoded, optional
        The same stream, if it was already decoded.
    """
    decoded = decode(stream) if decoded is None else decoded
    extents = np.concatenate([part.extents for part in decoded.planes])
    frames = np.concatenate([part.numbers for part in decoded.planes]).tolist()
    intra = [part.intra for part in decoded.planes for _ in range(len(part))]
    starts = (extents[:, 0] // 8 - START_CODE_BYTES).tolist()
    first_object = stream.find(code(OBJECT_START), 0, starts[0] + START_CODE_BYTES)
    codes = [stream[start : start + START_CODE_BYTES] for start in starts[1:]]
    if (extents[:, 0] % 8).any() or any(found != code(PLANE_START) for found in codes):
        raise DataError("planes share bytes: expected a start code before every plane", clause="FBA section 3")
    cuts = [max(first_object, 0), *starts[1:], len(stream)]
    parts = (stream[start:end] for start, end in itertools.pairwise(cuts))
    return list(map(AccessUnit, parts, frames, intra))


def level_of(decoded: Decoded) -> Level | None:
    """Return the lowest level whose bounds a stream keeps, or None.

    Bits are counted in every second that begins with a frame.
    """
    track = decoded.track
    bits = np.concatenate([part.extents[:, 1] - part.extents[:, 0] for part in decoded.planes])
    times_s = track.frame_numbers / track.rate_hz
    sums = np.concatenate([[0], np.cumsum(bits)])
    busiest = int((sums[np.searchsorted(times_s, times_s + 1.0 - 1e-9)] - sums[:-1]).max())
    fitting = (level for level in LEVELS if busiest <= level.max_bit_s and track.rate_hz <= level.max_rate_hz)
    return next(fitting, None)
