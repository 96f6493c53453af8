"""Live Link Face packets, by hand from the layout; tests/oracle has another program read them."""

import struct

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.wire.livelink import Subject, encode_face, livelink_values

h = bytes.fromhex

DEVICE = "01234567-89ab-cdef-0123-456789abcdef"
ZOE = Subject("Zoë", DEVICE)
HEAD = h("06000000") + b"$" + DEVICE.encode() + h("00000004 5a6fc3ab")  # four bytes for three characters
FIXED = h("00000102 3f000000 00007530 000003e9 3d")
VALUES = b"".join(struct.pack(">f", n / 64) for n in range(61))


def test_the_example_has_its_bytes() -> None:
    data = encode_face(ZOE, np.arange(61) / 64, number=258, fraction=0.5, rate=(30000, 1001))
    assert data == HEAD + FIXED + VALUES
    assert len(data) == 306 + 4


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
        for name in ("a", "é" * 128):
            data = encode_face(Subject(name, DEVICE), np.zeros(61), number=number, fraction=fraction, rate=rate)
            assert data[41:45] == struct.pack(">i", len(name.encode()))
            assert struct.unpack_from(">ifii", data, len(data) - 61 * 4 - 17) == (number, fraction, *rate)


@pytest.mark.parametrize(
    "field", [{"number": -1}, {"number": 2**31}, {"fraction": 1.5}, {"rate": (60, 0)}, {"rate": (2**31, 1)}]
)
def test_frames_that_cannot_be(field: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="got"):
        encode_face(ZOE, np.zeros(61), **({"number": 0} | field))
    with pytest.raises(UsageError, match="expected \\(61,\\)"):
        encode_face(ZOE, np.zeros(52), number=0)


def test_weights_and_turns_are_joined() -> None:
    faps = np.zeros(68)
    for number, value in ((49, 10_000), (48, 20_000), (50, -30_000), (23, 1_000), (25, 2_000), (24, -3_000)):
        faps[fap.column(number)] = value
    values = livelink_values(np.arange(52) / 64, faps)
    assert values[:52].tolist() == [n / 64 for n in range(52)]
    assert values[52:].tolist() == pytest.approx([0.1, 0.2, -0.3, 0.01, 0.02, 0, -0.03, 0, 0])  # rad
