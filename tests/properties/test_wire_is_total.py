"""For all bytes from the network: a value or a DataError, in every decoder of the wire."""

import struct
from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError
from fapengine.mpeg4.track import FapTrack
from fapengine.wire import fap_osc, osc

TRACK = FapTrack.from_values(np.arange(68)[None] * (np.arange(68) > 1), rate_hz=25.0)
(FRAME,) = fap_osc.encode_track(TRACK, session="anna")
MIXED = osc.message("/x", "sbihfdTFN", "é", b"abc", 1, 2, 3.0, 4.0, True, False, None)
(BUNDLE,) = osc.bundles([MIXED, osc.message("/fap/3", "i", 1), FRAME], limit=9999)
NESTED = osc.BUNDLE_HEAD + struct.pack(">i", len(BUNDLE)) + BUNDLE


def every_message(data: bytes) -> None:
    for message in osc.parse_packet(data):
        is_total(lambda _, message=message: fap_osc.parse_frame(message), b"")


DECODERS: tuple[tuple[Callable[[bytes], object], bytes], ...] = (
    (every_message, MIXED),
    (every_message, NESTED),
    (fap_osc.decode_frame, FRAME),
)


def is_total(decode: Callable[[bytes], object], data: bytes) -> None:
    try:
        decode(data)
    except DataError:
        return


@given(st.sampled_from(DECODERS), st.data())
def test_damaged_packets(known: tuple[Callable[[bytes], object], bytes], data: st.DataObject) -> None:
    decode, valid = known
    decode(valid)
    raw = bytearray(valid)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at] = data.draw(st.sampled_from([0, 1, 0x2C, 0x7F, 0x80, 0xC0, 0xFF]) | st.integers(0, 255))
    is_total(decode, bytes(raw))
    is_total(decode, bytes(raw[: data.draw(st.integers(0, len(raw)))]))
    is_total(decode, bytes(raw) + data.draw(st.binary(max_size=8)))


@given(st.sampled_from(DECODERS), st.binary(max_size=80))
def test_noise(known: tuple[Callable[[bytes], object], bytes], noise: bytes) -> None:
    decode, valid = known
    for start in (b"", b"/", osc.BUNDLE_HEAD, b"/a\0\0,", valid[:60]):
        is_total(decode, start + noise)
