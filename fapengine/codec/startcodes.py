"""Start codes, and what may stand before a face object in a visual elementary stream (FBA sections 1 and 3)."""

from fapengine.errors import ConformanceError, DataError, TruncatedError, UnsupportedError

PREFIX = b"\x00\x00\x01"
SEQUENCE_START, END, USER_DATA, VISUAL_OBJECT = 0xB0, 0xB1, 0xB2, 0xB5
OBJECT_START, PLANE_START = 0xBA, 0xBB
OLD_OBJECT_START, OLD_PLANE_START = 0x01, 0x03
"""Read, never written."""
FACE_TYPE = 4
"""visual_object_type of a face or body object (N2202, table 6-4)."""
PROFILES = {
    0x61: "Simple Face Animation, level 1",
    0x62: "Simple Face Animation, level 2",
    0x63: "Simple FBA, level 1",
    0x64: "Simple FBA, level 2",
}
MAX_PREAMBLE = 4096
"""Bytes before the face object; more is no stream of ours."""


def code(last: int) -> bytes:
    """Spell a start code.

    Examples
    --------
    >>> code(OBJECT_START).hex()
    '000001ba'
    """
    return PREFIX + bytes([last])


def skip_preamble(data: bytes) -> int:
    """Find the first byte behind the object start code.

    A sequence header (profile), a visual object header of type face, and user data may stand before it.

    Raises
    ------
    TruncatedError
        If the data end before it.
    UnsupportedError
        For a visual object of another type.
    ConformanceError
        For anything else.
    """
    at = 0
    while at < MAX_PREAMBLE:
        head = data[at : at + 4]
        if len(head) < 4:
            raise TruncatedError(f"start code: got {len(head)} bytes, expected 4", where=f"byte {at}, bit 0")
        if not head.startswith(PREFIX):
            raise ConformanceError(
                f"start code: got {head.hex(' ')}, expected 00 00 01 ba", where=f"byte {at}, bit 0",
                clause="FBA section 1",
            )  # fmt: skip
        if head[3] in (OBJECT_START, OLD_OBJECT_START):
            return at + 4
        if head[3] not in (SEQUENCE_START, VISUAL_OBJECT, USER_DATA):
            raise ConformanceError(
                f"start code: got {head.hex(' ')}, expected 00 00 01 ba", where=f"byte {at}, bit 0",
                clause="FBA section 1",
            )  # fmt: skip
        if head[3] == VISUAL_OBJECT:
            _expect_face(data, at + 4)
        following = data.find(PREFIX, at + 4)
        if following < 0:
            if len(data) > at + MAX_PREAMBLE:
                break
            raise TruncatedError("start code: none behind the headers", where=f"byte {len(data)}, bit 0")
        at = following
    raise DataError(f"got no face object in the first {MAX_PREAMBLE} bytes", where=f"byte {at}, bit 0")


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
