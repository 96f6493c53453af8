"""Bits and start codes: fields of fixed length, most significant bit first, and the headers before a face object.

Arrays of bits hold one bit per byte. Start codes and headers are those of FBA sections 1 and 3.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ConformanceError, DataError, TruncatedError, UnsupportedError

Bits = NDArray[np.uint8]


def unpack(data: bytes) -> Bits:
    """Unpack bytes into bits: (8 * N,) uint8 of 0 and 1."""
    return np.unpackbits(np.frombuffer(data, np.uint8))


def place(bit: int) -> str:
    """Format a bit position for an error message.

    Examples
    --------
    >>> place(51)
    'byte 6, bit 3'
    """
    return f"byte {bit // 8}, bit {bit % 8}"


class BitReader:
    """Reads numbers from an array of bits.

    Stateful.

    Parameters
    ----------
    bits : (N,) uint8
        One bit per byte.
    position : int
        Next bit to read.
    origin : int
        Number of bits of the stream before ``bits``; used in error messages only.
    """

    def __init__(self, bits: Bits, position: int, origin: int = 0) -> None:
        self._bits = bits
        self.position = position
        self._origin = origin

    def read(self, count: int, what: str) -> int:
        """Read an unsigned number of ``count`` bits."""
        end = self.position + count
        if end > len(self._bits):
            left = len(self._bits) - self.position
            raise TruncatedError(f"{what}: got {left} bits, expected {count}", where=self.where())
        number = 0
        for bit in self._bits[self.position : end].tolist():
            number = 2 * number + bit
        self.position = end
        return number

    def expect_marker(self, what: str, clause: str) -> None:
        """Read a bit that must be 1."""
        where = self.where()
        if not self.read(1, what):
            raise ConformanceError(f"{what}: got marker bit 0, expected 1", where=where, clause=clause)

    def where(self) -> str:
        """Position of the next bit in the whole stream, as text."""
        return place(self._origin + self.position)


PREFIX = b"\x00\x00\x01"
SEQUENCE_START, END, USER_DATA, VISUAL_OBJECT = 0xB0, 0xB1, 0xB2, 0xB5
OBJECT_START, PLANE_START = 0xBA, 0xBB
OLD_OBJECT_START, OLD_PLANE_START = 0x01, 0x03
"""Read, never written."""
FACE_TYPE = 4
"""visual_object_type of a face or body object (N2202, table 6-4)."""
MAX_PREAMBLE = 4096
"""Greatest number of bytes before the face object."""


def code(last: int) -> bytes:
    """Bytes of a start code.

    Examples
    --------
    >>> code(OBJECT_START).hex()
    '000001ba'
    """
    return PREFIX + bytes([last])


def skip_preamble(data: bytes) -> int:
    """Return the position of the first byte after the object start code.

    A sequence header (profile), a visual object header of type face, and user data may precede it.
    """
    at = 0
    while at < MAX_PREAMBLE:
        head, where = data[at : at + 4], f"byte {at}, bit 0"
        if len(head) < 4:
            raise TruncatedError(f"start code: got {len(head)} bytes, expected 4", where=where)
        last = head[3] if head.startswith(PREFIX) else -1
        if last in (OBJECT_START, OLD_OBJECT_START):
            return at + 4
        if last not in (SEQUENCE_START, VISUAL_OBJECT, USER_DATA):
            raise ConformanceError(
                f"start code: got {head.hex(' ')}, expected 00 00 01 ba", where=where, clause="FBA section 1"
            )
        if last == VISUAL_OBJECT:
            _expect_face(data, at + 4)
        following = data.find(PREFIX, at + 4)
        if following < 0:
            if len(data) > at + MAX_PREAMBLE:
                break
            raise TruncatedError("start code: missing after the headers", where=f"byte {len(data)}, bit 0")
        at = following
    raise DataError(f"no face object in the first {MAX_PREAMBLE} bytes", where=f"byte {at}, bit 0")


def _expect_face(data: bytes, at: int) -> None:
    """Read a visual object header: is_identifier 1, then if set verid 4 and priority 3, then the type 4 bits [MEM]."""
    needed = 2 if data[at : at + 1] >= b"\x80" else 1
    if len(data) < at + needed:
        raise TruncatedError("visual object header: cut off", where=f"byte {at}, bit 0")
    kind = data[at + 1] >> 4 if needed == 2 else data[at] >> 3 & 15
    if kind != FACE_TYPE:
        raise UnsupportedError(
            f"visual_object_type: got {kind}, expected {FACE_TYPE} (face)", where=f"byte {at}, bit 1",
            clause="FBA section 1",
        )  # fmt: skip
