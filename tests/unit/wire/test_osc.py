"""OSC packets: bytes by hand, python-osc as the other reader and writer, and every way to be wrong."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import BuildError, OscMessageBuilder
from pythonosc.osc_packet import OscPacket

from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.wire import osc

pytestmark = pytest.mark.conformance

h = bytes.fromhex

CASES = [
    (("/fap/3", "i", 200), h("2f666170 2f330000 2c690000 000000c8")),
    (("/abc", ""), h("2f616263 00000000 2c000000")),  # four letters need four NULs
    (("/a", "sf", "é", 0.5), h("2f610000 2c736600 c3a90000 3f000000")),
    (("/a", "hT", -2, True), h("2f610000 2c685400 ffffffff fffffffe")),
    (("/a", "bFN", b"12345", False, None), h("2f610000 2c62464e 00000000 00000005 31323334 35000000")),
    (("/a", "d", 1.0), h("2f610000 2c640000 3ff00000 00000000")),
]


@pytest.mark.parametrize(("call", "data"), CASES)
def test_known_messages_both_ways(call: tuple, data: bytes) -> None:
    assert osc.message(*call) == data
    (back,) = osc.parse_packet(data)
    assert (back.address, back.tags, *back.arguments) == call
    assert back.time_tag == osc.IMMEDIATELY


@pytest.mark.parametrize(("call", "data"), CASES)
def test_every_cut_of_a_message_is_refused(call: tuple, data: bytes) -> None:
    for cut in range(1, len(data)):
        if cut == len(call[0]) // 4 * 4 + 4:  # an address alone is what old senders send
            continue
        with pytest.raises(TruncatedError):
            osc.parse_packet(data[:cut])


def test_an_address_alone_is_a_message() -> None:
    assert osc.parse_packet(h("2f616263 00000000")) == (osc.Message("/abc", "", ()),)


def test_other_types_of_another_writer() -> None:
    builder = OscMessageBuilder("/x")
    for value, tag in ((0x11223344, "r"), ((1, 2, 3, 4), "m")):
        builder.add_arg(value, tag)
    (back,) = osc.parse_packet(builder.build().dgram)
    assert back.arguments == (h("11223344"), h("01020304"))
    builder = OscMessageBuilder("/x")
    builder.add_arg([1, [2.5, "z"]])
    builder.add_arg(2**40)
    (back,) = osc.parse_packet(builder.build().dgram)
    assert (back.tags, back.arguments) == ("ifsh", (1, 2.5, "z", 2**40))
    (back,) = osc.parse_packet(h("2f610000 2c745363 00000000 00000000 00000001 68690000 00000041"))
    assert back.arguments == (1, "hi", 65)


def test_bundles_in_bundles_keep_their_time_tags() -> None:
    inner = OscBundleBuilder(1_700_000_000.5)
    inner.add_content(OscMessage(osc.message("/in", "i", 1)))
    outer = OscBundleBuilder(IMMEDIATELY)
    outer.add_content(inner.build())
    outer.add_content(OscMessage(osc.message("/out")))
    first, second = osc.parse_packet(outer.build().dgram)
    assert (first.address, second.address) == ("/in", "/out")
    assert first.time_tag == ((1_700_000_000 + 2_208_988_800) << 32) + 2**31
    assert second.time_tag == osc.IMMEDIATELY


def test_a_bundle_has_its_bytes_and_another_reader_reads_it() -> None:
    (data,) = osc.bundles([osc.message("/a", "i", 5), osc.message("/b")], limit=100)
    assert data == h(
        "2362756e 646c6500 00000000 00000001"  # #bundle, immediately
        "0000000c 2f610000 2c690000 00000005"
        "00000008 2f620000 2c000000"
    )
    assert [(m.message.address, m.message.params) for m in OscPacket(data).messages] == [("/a", [5]), ("/b", [])]
    for cut in (1, 3, 9, 15, 17, 18, 19, *range(20, 32), *range(33, len(data))):
        with pytest.raises(DataError):
            osc.parse_packet(data[:cut])


def test_bundles_are_filled_to_the_limit_and_keep_the_order() -> None:
    messages = [osc.message("/n", "i", n) for n in range(10)]  # 12 bytes each, 16 in a bundle
    assert [len(data) for data in osc.bundles(messages, limit=16 + 3 * 16)] == [64, 64, 64, 32]
    assert [len(data) for data in osc.bundles(messages, limit=16 + 3 * 16 - 1)] == [48] * 5
    found = [each.arguments[0] for data in osc.bundles(messages, limit=64) for each in osc.parse_packet(data)]
    assert found == list(range(10))
    assert osc.bundles([], limit=64) == []
    with pytest.raises(UsageError, match="message of 12 bytes, expected room for it within 31"):
        osc.bundles(messages, limit=31)


@pytest.mark.parametrize(
    ("data", "error", "what"),
    [
        (b"", DataError, "expected / or #bundle"),
        (b"hello\0\0\0", DataError, "expected / or #bundle"),
        (h("2f610000 69000000"), DataError, "type tags"),
        (h("2f610000 2c510000"), UnsupportedError, "type tag: got 'Q'"),
        (h("2f610000 2c000000 00000000"), DataError, "4 bytes follow"),
        (h("2fff0000 2c000000"), DataError, "invalid UTF-8"),
        (h("2f610000 2c620000 ffffffff"), DataError, "length of -1"),
        (h("2f610000 2c620000 00000005 31323334"), TruncatedError, "blob: got 4 bytes of 5"),
        (osc.BUNDLE_HEAD + h("00000000"), DataError, "got 0 bytes"),
        (osc.BUNDLE_HEAD + h("00000006 2f610000 2c00"), DataError, "multiple of 4"),
        (osc.BUNDLE_HEAD + h("fffffffc"), DataError, "got -4 bytes"),
        (osc.BUNDLE_HEAD + h("7ffffffc 2f610000"), TruncatedError, "got 4 bytes of 2147483644"),
        (osc.BUNDLE_HEAD + h("0000"), TruncatedError, "inside the length"),
        (osc.BUNDLE_HEAD[:12], TruncatedError, "expected 16 or more"),
    ],
)
def test_what_is_no_osc_is_refused(data: bytes, error: type[DataError], what: str) -> None:
    with pytest.raises(error, match=what) as caught:
        osc.parse_packet(data)
    assert caught.value.where.startswith("byte ")


def test_deep_bundles_are_refused_before_they_cost() -> None:
    def nest(depth: int) -> bytes:
        data = osc.message("/a")
        for _ in range(depth):
            data = osc.BUNDLE_HEAD + struct.pack(">i", len(data)) + data
        return data

    assert osc.parse_packet(nest(osc.MAX_DEPTH)) == (osc.Message("/a", "", ()),)
    with pytest.raises(UnsupportedError, match="deeper than 8"):
        osc.parse_packet(nest(osc.MAX_DEPTH + 1))
    with pytest.raises(UnsupportedError, match="deeper than 8"):
        osc.parse_packet(nest(3000))


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (("a", ""), "expected /"),
        (("/a\0b", ""), "expected /"),
        (("/a", "i"), "got 0 arguments, expected 1"),
        (("/a", "i", 2**31), "/a: got"),
        (("/a", "i", 1.5), "/a: got"),
        (("/a", "f", 1e39), "/a: got"),
        (("/a", "f", "x"), "/a: got"),
        (("/a", "s", 5), "/a: got"),
        (("/a", "s", "x\0y"), "NUL inside"),
        (("/a", "s", "\ud800"), "/a: got"),
        (("/a", "b", b""), "/a: got"),
        (("/a", "Q", 1), "/a: got"),
    ],
)
def test_what_cannot_be_sent_is_the_callers_mistake(call: tuple, what: str) -> None:
    with pytest.raises(UsageError, match=what):
        osc.message(*call)


def test_a_float_stays_a_float() -> None:
    (back,) = osc.parse_packet(osc.message("/a", "ff", 1, math.inf))
    assert back.arguments == (1.0, math.inf)
    assert isinstance(back.arguments[0], float)


def test_what_is_empty_or_just_fits() -> None:
    assert osc.parse_packet(osc.BUNDLE_HEAD) == ()
    (back,) = osc.parse_packet(h("2f610000 2c620000 00000000"))
    assert back.arguments == (b"",)
    each = osc.message("/n", "i", 1)
    assert [len(data) for data in osc.bundles([each, each], limit=16 + 4 + len(each))] == [32, 32]


@given(
    st.lists(
        st.tuples(st.just("i"), st.integers(-(2**31) - 1, 2**31))
        | st.tuples(st.just("h"), st.integers(-(2**63) - 1, 2**63))
        | st.tuples(st.just("s"), st.text(max_size=6))
        | st.tuples(st.just("f"), st.floats(width=32, allow_nan=False)),
        max_size=6,
    )
)
def test_messages_are_those_of_python_osc(arguments: list[tuple[str, osc.Argument]]) -> None:
    builder = OscMessageBuilder("/a/b")
    try:
        for tag, value in arguments:
            builder.add_arg(value, tag)
        expected = builder.build().dgram
    except (BuildError, ValueError, OverflowError):
        expected = None
    try:
        built = osc.message("/a/b", "".join(tag for tag, _ in arguments), *(value for _, value in arguments))
    except UsageError:
        built = None
    if any(tag == "s" and "\0" in str(value) for tag, value in arguments):
        expected = None  # python-osc would cut it
    assert built == expected
