"""Packets on a stream: in any pieces, and never more memory than allowed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip

h = bytes.fromhex

SLIP_CASES = [
    (b"abc", h("c0 61 62 63 c0")),
    (h("c0"), h("c0 db dc c0")),
    (h("db"), h("c0 db dd c0")),
    (h("db dc c0 dd"), h("c0 db dd dc db dc dd c0")),
]
PACKETS = st.lists(
    st.binary(min_size=1, max_size=30) | st.lists(st.sampled_from([0xC0, 0xDB, 0xDC, 0xDD]), min_size=1).map(bytes)
)


def in_pieces(decoder: SlipDecoder | LengthDecoder, data: bytes, size: int) -> list[bytes]:
    return [packet for at in range(0, len(data), size) for packet in decoder.feed(data[at : at + size])]


@pytest.mark.parametrize(("packet", "framed"), SLIP_CASES)
def test_slip_bytes_both_ways_and_cut(packet: bytes, framed: bytes) -> None:
    assert encode_slip(packet) == framed
    for cut in range(1, len(framed)):
        decoder = SlipDecoder()
        assert decoder.feed(framed[:cut]) == []
        if cut > 1:
            with pytest.raises(TruncatedError, match="into a packet"):
                decoder.close()
        assert decoder.feed(framed[cut:]) == [packet]
        decoder.close()


@given(PACKETS, st.integers(1, 9))
def test_slip_in_any_pieces(packets: list[bytes], size: int) -> None:
    data = b"".join(map(encode_slip, packets))
    decoder = SlipDecoder()
    assert in_pieces(decoder, data, size) == packets
    assert SlipDecoder().feed(data) == packets
    decoder.close()
    assert decoder.dropped == 0


def test_one_end_between_packets_is_enough() -> None:
    assert SlipDecoder().feed(h("61 c0 62 c0 c0 c0 63 c0")) == [b"a", b"b", b"c"]


@pytest.mark.parametrize("bad", ["61 db 62", "db c0", "db db", "61 db", "db 00 db dc"])
@pytest.mark.parametrize("size", [1, 2, 99])
def test_a_wrong_escape_costs_one_packet(bad: str, size: int) -> None:
    decoder = SlipDecoder()
    assert in_pieces(decoder, encode_slip(b"x") + h(bad) + encode_slip(b"y"), size) == [b"x", b"y"]
    assert decoder.dropped == 1


@pytest.mark.parametrize("size", [1, 3, 999])
def test_a_packet_without_end_is_dropped_and_not_kept(size: int) -> None:
    decoder = SlipDecoder(max_packet=10)
    assert in_pieces(decoder, encode_slip(b"z" * 10) + b"a" * 500, size) == [b"z" * 10]
    assert len(decoder._packet) == 0
    with pytest.raises(TruncatedError):
        decoder.close()
    assert in_pieces(decoder, encode_slip(b"ok") + encode_slip(b"z" * 11) + encode_slip(b"\xc0" * 10), size) == [
        b"ok",
        b"\xc0" * 10,
    ]
    assert decoder.dropped == 2


def test_length_bytes_both_ways_and_cut() -> None:
    data = encode_length(b"/a\0\0")
    assert data == h("00000004 2f610000")
    for cut in range(1, len(data)):
        decoder = LengthDecoder()
        assert decoder.feed(data[:cut]) == []
        with pytest.raises(TruncatedError, match=f"after {cut} bytes"):
            decoder.close()
        assert decoder.feed(data[cut:]) == [b"/a\0\0"]
        decoder.close()
    with pytest.raises(UsageError, match="must not be empty"):
        encode_length(b"")


@given(PACKETS, st.integers(1, 9))
def test_lengths_in_any_pieces(packets: list[bytes], size: int) -> None:
    data = b"".join(map(encode_length, packets))
    assert in_pieces(LengthDecoder(), data, size) == packets
    assert LengthDecoder().feed(data) == packets


@pytest.mark.parametrize("length", ["00000000", "0000000b", "7fffffff", "ffffffff"])
def test_a_wrong_length_ends_the_stream(length: str) -> None:
    decoder = LengthDecoder(max_packet=10)
    with pytest.raises(DataError, match=r"expected 1 to 10"):
        decoder.feed(h(length) + b"x" * 100)
    for call in (lambda: decoder.feed(encode_length(b"a")), decoder.close):
        with pytest.raises(DataError, match=r"expected 1 to 10"):
            call()
    assert not decoder._held


def test_packets_before_a_wrong_length_are_not_lost() -> None:
    decoder = LengthDecoder(max_packet=10)
    assert decoder.feed(encode_length(b"x" * 10) + h("ffffffff 00")) == [b"x" * 10]
    with pytest.raises(DataError, match="got -1"):
        decoder.close()


@given(st.binary(max_size=80), st.integers(1, 7))
def test_any_bytes(data: bytes, size: int) -> None:
    whole, split = SlipDecoder(max_packet=20), SlipDecoder(max_packet=20)
    assert whole.feed(data) == in_pieces(split, data, size)
    assert whole.dropped == split.dropped
    decoder = LengthDecoder(max_packet=20)
    try:
        in_pieces(decoder, data, size)
        decoder.close()
    except DataError:
        assert len(decoder._held) <= 24
