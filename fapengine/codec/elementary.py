"""A face stream as a visual elementary stream: its headers, its access units, the level it fits.

MP4 files and RTP carry a stream plane by plane, each plane in bytes of its own behind a start code, with its time. A
stream whose planes share bytes cannot be carried so; encode it with a start code before every plane.
"""

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
    """Bits in any second."""
    max_rate_hz: float
    """Frames a second."""


LEVELS = (Level(1, 0x61, 16_000, 72.0), Level(2, 0x62, 32_000, 72.0))
"""[MEM] bounds of bits and frames; the bytes are FBA section 1's."""


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One plane in bytes of its own."""

    data: bytes
    """Its start code and what follows, up to the next one. The first unit begins with the object start code."""
    frame: int
    """Its frame number: its time is this divided by the rate."""
    intra: bool


def visual_headers(profile: int) -> bytes:
    """Write what stands before a face object in a visual elementary stream (FBA section 1; fields [MEM]).

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
    """Cut a stream into its planes.

    Parameters
    ----------
    stream : bytes
        A face stream with a start code before every plane.
    decoded : Decoded, optional
        The same stream decoded, where that has been done.
    """
    decoded = decode(stream) if decoded is None else decoded
    extents = np.concatenate([part.extents for part in decoded.planes])
    frames = np.concatenate([part.numbers for part in decoded.planes]).tolist()
    intra = [part.intra for part in decoded.planes for _ in range(len(part))]
    firsts = extents[:, 0]
    starts = (firsts // 8 - START_CODE_BYTES).tolist()
    first_object = stream.find(code(OBJECT_START), 0, starts[0] + START_CODE_BYTES)
    codes = [stream[start : start + START_CODE_BYTES] for start in starts[1:]]
    if (firsts % 8).any() or any(found != code(PLANE_START) for found in codes):
        raise DataError("planes share bytes: expected a start code before every plane", clause="FBA section 3")
    cuts = [max(first_object, 0), *starts[1:], len(stream)]
    return [
        AccessUnit(stream[cuts[n] : cuts[n + 1]], frames[n], intra[n]) for n in range(len(starts))
    ]  # fmt: skip


def level_of(decoded: Decoded) -> Level | None:
    """Find the lowest level that holds a stream; None where none does.

    The bits of every second that begins with a frame are counted, as they are sent.
    """
    track = decoded.track
    bits = np.concatenate([part.extents[:, 1] - part.extents[:, 0] for part in decoded.planes])
    times_s = track.frame_numbers / track.rate_hz
    sums = np.concatenate([[0], np.cumsum(bits)])
    busiest = int((sums[np.searchsorted(times_s, times_s + 1.0 - 1e-9)] - sums[:-1]).max())
    for level in LEVELS:
        if busiest <= level.max_bit_s and track.rate_hz <= level.max_rate_hz:
            return level
    return None
