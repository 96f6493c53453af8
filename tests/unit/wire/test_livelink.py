"""Live Link Face packets: by hand from the layout, and read by a reader written from it alone."""

import struct

import numpy as np
import pytest

from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.retarget.shape_rows import ARKIT_NAMES
from fapengine.wire.livelink import Face, Subject, decode_packet, encode_face, keep_alive, livelink_values

h = bytes.fromhex

DEVICE = "01234567-89ab-cdef-0123-456789abcdef"
ZOE = Subject("Zoë", DEVICE)
FACE = Face(number=258, fraction=0.5, rate=(30000, 1001), values=np.arange(61) / 64)
HEAD = h("06000000") + b"$" + DEVICE.encode() + h("00000004 5a6fc3ab")  # four bytes for three letters
FIXED = h("00000102 3f000000 00007530 000003e9 3d")
VALUES = b"".join(struct.pack(">f", n / 64) for n in range(61))


def test_the_example_has_its_bytes_both_ways() -> None:
    data = encode_face(ZOE, FACE)
    assert data == HEAD + FIXED + VALUES
    assert len(data) == 306 + 4
    subject, face = decode_packet(data)
    assert subject == ZOE
    assert face is not None
    assert (face.number, face.fraction, face.rate) == (258, 0.5, (30000, 1001))
    assert np.array_equal(face.values, FACE.values)


def test_a_packet_without_face_is_keep_alive() -> None:
    assert keep_alive(ZOE) == HEAD
    assert decode_packet(HEAD) == (ZOE, None)


def test_every_other_cut_is_refused() -> None:
    data = encode_face(ZOE, FACE)
    for cut in set(range(len(data))) - {len(HEAD)}:
        with pytest.raises(TruncatedError):
            decode_packet(data[:cut])


def changed(at: int, new: bytes, data: bytes = HEAD + FIXED + VALUES) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize(
    ("data", "error", "what"),
    [
        (changed(0, h("00000006")), UnsupportedError, "version 100663296"),
        (changed(4, b"!"), DataError, "expected \\$ and a UUID"),
        (changed(5, b"g"), DataError, "expected a UUID of 36"),
        (changed(5, b"\xff"), DataError, "ascii"),
        (changed(41, h("ffffffff")), DataError, "name: got -1"),
        (changed(41, h("00000000")), DataError, "name: got 0"),
        (changed(41, h("00000101")), DataError, "name: got 257"),
        (changed(45, b"\xff"), DataError, "utf-8"),
        (changed(45, b"\0"), DataError, "without NUL"),
        (changed(len(HEAD), h("ffffffff")), DataError, "number -1"),
        (changed(len(HEAD) + 4, h("7fc00000")), DataError, "fraction nan"),
        (changed(len(HEAD) + 4, h("40000000")), DataError, "fraction 2.0"),
        (changed(len(HEAD) + 12, h("00000000")), DataError, "rate: got 30000/0"),
        (changed(len(HEAD) + 16, h("34")), UnsupportedError, "got 52 shapes"),
        (changed(len(HEAD) + 17, h("7f800000")), DataError, "finite"),
        (HEAD + FIXED + VALUES + b"\0", DataError, "1 bytes follow"),
    ],
)
def test_what_is_no_packet_is_refused(data: bytes, error: type[DataError], what: str) -> None:
    with pytest.raises(error, match=what):
        decode_packet(data)


@pytest.mark.parametrize(
    ("name", "device", "what"),
    [
        ("", DEVICE, "0 bytes"), ("é" * 129, DEVICE, "258 bytes"), ("a\0", DEVICE, "without NUL"),
        ("\ud800", DEVICE, "UTF-8 can hold"), ("a", "$" + DEVICE[1:], "UUID"), ("a", DEVICE + "\n", "UUID"),
    ],
)  # fmt: skip
def test_subjects_that_cannot_be(name: str, device: str, what: str) -> None:
    with pytest.raises(UsageError, match=what):
        Subject(name, device)


def test_the_smallest_and_the_largest() -> None:
    for number, fraction, rate in ((0, 0.0, (1, 1)), (2**31 - 1, 1.0, (2**31 - 1, 2**31 - 1))):
        face = Face(number=number, fraction=fraction, rate=rate, values=np.zeros(61))
        for name in ("a", "é" * 128):
            subject, back = decode_packet(encode_face(Subject(name, DEVICE), face))
            assert subject.name == name
            assert back is not None
            assert (back.number, back.fraction, back.rate) == (number, fraction, rate)


@pytest.mark.parametrize(
    "field", [{"number": -1}, {"number": 2**31}, {"fraction": 1.5}, {"rate": (60, 0)}, {"rate": (2**31, 1)}]
)
def test_faces_that_cannot_be(field: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="got"):
        Face(**({"number": 0, "values": np.zeros(61)} | field))
    with pytest.raises(UsageError, match="expected \\(61,\\)"):
        Face(number=0, values=np.zeros(52))


def test_faps_become_shapes_and_turns() -> None:
    faps = np.zeros((2, 68))
    for number, value in ((3, 800), (49, 10_000), (48, 20_000), (50, -30_000), (23, 1_000), (25, 2_000), (24, -3_000)):
        faps[1, fap.column(number)] = value
    rest, moved = livelink_values(faps)
    assert not rest.any()
    assert moved[ARKIT_NAMES.index("jawOpen")] > 0.3
    assert moved[52:].tolist() == pytest.approx([0.1, 0.2, -0.3, 0.01, 0.02, 0, -0.03, 0, 0])  # rad
