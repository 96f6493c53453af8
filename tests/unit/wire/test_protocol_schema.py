"""Messages of the robust mode: bytes, defaults, leniency, and what is refused."""

import re
import struct
import zlib
from math import inf, radians
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.engine.command_table import Command
from fapengine.engine.commands import Blink, Express, Look, Pause, Resume, SetParameter, TurnHead
from fapengine.errors import DataError, UsageError
from fapengine.expressions import Expression
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.schema import SessionCommand, WirePhone


def h(text: str) -> bytes:
    return bytes.fromhex(text)


PHONES = schema.Phones("anna", 7, 3, 16, (WirePhone("m", 0, 80_000, 1, 1.0), WirePhone("aɪ", 80_000, 120_000)))
CASES = [
    (
        schema.Hello("anna", 1, "ipa", "en", 1, "", 9),
        h(
            "2f666170 2f312f68 656c6c6f 00000000"  # /fap/1/hello
            "2c736973 73697369 69000000"  # ,sissisii
            "616e6e61 00000000 00000001 69706100 656e0000 00000001 00000000 00000009 00000000"
        ),
    ),
    (
        schema.Ping(2, 1_000_000, -5, 0.5, 3),
        h("2f666170 2f312f70 696e6700 2c696868 66690000 00000002 00000000000f4240 fffffffffffffffb 3f000000 00000003"),
    ),
    (
        PHONES,
        h(
            "2f666170 2f312f70 686f6e65 73000000"  # /fap/1/phones
            "2c736969 69697369 69696673 69696966 00000000"  # ,siiiisiiifsiiif
            "616e6e61 00000000 00000007 00000003 00000010 00000002"
            "6d000000 00000000 00013880 00000001 3f800000"  # m
            "61c9aa00 00013880 0001d4c0 00000000 3f800000"  # aɪ
        ),
    ),
    (
        schema.Sound("anna", 7, 480, 16_000, b"\x01\x00\xff\xff\x00\x80"),  # 1, -1, -32768
        h(
            "2f666170 2f312f73 6f756e64 00000000"  # /fap/1/sound
            "2c736969 69620000"  # ,siiib
            "616e6e61 00000000 00000007 000001e0 00003e80 00000006 0100ffff 00800000"
        ),
    ),
    (
        schema.EndUtterance("a", 1, 2, 200_000, -5, 0),
        h(
            "2f666170 2f312f75 74742f65 6e640000"  # /fap/1/utt/end
            "2c736969 69696900 61000000 00000001 00000002 00030d40 fffffffb 00000000"
        ),
    ),
    (
        schema.Ack("a", 1, 4, 5, 1000, 1, 0),
        h(
            "2f666170 2f312f61 636b0000 2c736969 68696969 00000000"
            "61000000 00000001 00000004 0000000000000005 000003e8 00000001 00000000"
        ),
    ),
    (
        schema.WordTimes("a", 1, 2, (schema.WireWord("Hi", 100_000, 300_000),), "en"),
        h(
            "2f666170 2f312f77 6f726473 00000000 2c736969 69736969 73000000"  # /fap/1/words ,siiisiis
            "61000000 00000001 00000002 00000001 48690000 000186a0 000493e0 656e0000"
        ),
    ),
    (
        SessionCommand("anna", Express(Expression.JOY, 0.5, None, 0.2, inf, 0.3)),
        h(
            "2f666170 2f312f65 78707200 2c737366 69696969 00000000"  # /fap/1/expr ,ssfiiii
            "616e6e61 00000000 6a6f7900 3f000000 ffffffff 00030d40 ffffffff 000493e0"
        ),
    ),
    (
        SessionCommand("anna", Look(radians(30.0), radians(-5.0), 0.2)),
        h(
            "2f666170 2f312f67 617a6500 2c736666 69000000"  # /fap/1/gaze ,sffi
            "616e6e61 00000000 41f00000 c0a00000 00030d40"
        ),
    ),
    (SessionCommand("anna", Blink()), h("2f666170 2f312f62 6c696e6b 00000000 2c730000 616e6e61 00000000")),
    (
        SessionCommand(
            "anna", TurnHead(roll_rad=radians(1.0), pitch_rad=radians(2.0), yaw_rad=radians(-30.0), over_s=0.3)
        ),
        h(
            "2f666170 2f312f68 65616400 2c736666 66690000"  # /fap/1/head ,sfffi
            "616e6e61 00000000 3f800000 40000000 c1f00000 000493e0"
        ),
    ),
    (
        SessionCommand("anna", SetParameter("jaw", 1.5)),
        h("2f666170 2f312f70 6172616d 00000000 2c737366 00000000 616e6e61 00000000 6a617700 3fc00000"),
    ),
    (
        SessionCommand("anna", Pause(0.15)),
        h("2f666170 2f312f75 74742f70 61757365 00000000 2c736900 616e6e61 00000000 00000096"),
    ),
    (
        SessionCommand("anna", Resume()),
        h("2f666170 2f312f75 74742f72 6573756d 65000000 2c730000 616e6e61 00000000"),
    ),
]


def kind_of(message: osc.Message) -> type:
    return (schema.from_sender() | schema.FROM_ENGINE)[message.address]


def read(packet: bytes) -> schema.Wire:
    (message,) = osc.parse_packet(packet)
    return codec.parse(kind_of(message), message)


@pytest.mark.parametrize(("value", "packet"), CASES)
def test_layout(value, packet):
    assert codec.encode(value) == packet
    assert read(packet) == value


@pytest.mark.parametrize("kind", [*schema.from_sender().values(), *get_args(schema.FromEngine)])
def test_every_message_comes_back_and_its_required_arguments_are_required(kind):
    samples = {"s": "x", "i": 3, "h": 1 << 40, "f": 0.5}
    layout = codec.layout(kind)
    required = layout.required
    if kind is schema.Phones:
        value = PHONES
    elif kind in (schema.Sound, schema.WordTimes):
        value = next(value for value, _ in CASES if isinstance(value, kind))
    elif issubclass(kind, Command):
        value = next(value for value, _ in CASES if type(getattr(value, "command", None)) is kind)
    else:
        assert len(layout.names) == len(layout.tags) >= required
        value = kind(*(samples[tag] for tag in layout.tags))
    assert read(codec.encode(value)) == value
    (message,) = osc.parse_packet(codec.encode(value))
    short = osc.Message(message.address, message.tags[: required - 1], message.arguments[: required - 1])
    with pytest.raises(DataError, match=f"got {required - 1} arguments, expected {required} or more"):
        codec.parse(kind, short)
    if kind not in (schema.Phones, schema.WordTimes):
        least = osc.Message(message.address, message.tags[:required], message.arguments[:required])
        got = codec.parse(kind, least)
        (again,) = osc.parse_packet(codec.encode(got))
        assert again.arguments[:required] == pytest.approx(least.arguments)


def test_addresses_are_of_the_first_version_and_differ():
    kinds = [*schema.from_sender().values(), *get_args(schema.FromEngine)]
    addresses = {codec.layout(kind).address for kind in kinds}
    assert len(addresses) == len(kinds) >= 22
    assert all(re.fullmatch(r"/fap/1/[a-z/]+", address) for address in addresses)


def test_numbers_are_taken_from_any_numeric_type():
    given = osc.message(schema.AudioPosition.ADDRESS, "sfdfi", "a", 3.0, 2e12, 40_000.0, 1)
    assert read(given) == schema.AudioPosition("a", 3, 2_000_000_000_000, 40_000, 1.0)
    assert read(osc.message("/fap/1/gaze", "siiT", "a", 5, -5, True)) == schema.SessionCommand(
        "a", Look(radians(5), radians(-5), 1e-6)
    )


def test_surplus_arguments_are_left_and_counted():
    (message,) = osc.parse_packet(osc.message("/fap/1/blink", "sif", "a", 1, 2.0))
    assert codec.parse(Blink, message) == schema.SessionCommand("a", Blink())
    assert codec.surplus(Blink, message) == 2
    tags, values = "siiiisiiif", ["a", 1, 0, 0, 1, "m", 0, 1, 0, 1.0]
    (message,) = osc.parse_packet(osc.message(schema.Phones.ADDRESS, tags + "iss", *values, 4, "x", "y"))
    assert codec.surplus(schema.Phones, message) == 2
    assert codec.parse(schema.Phones, message).revision == 4
    (message,) = osc.parse_packet(osc.message(schema.Phones.ADDRESS, tags, *values))
    assert codec.surplus(schema.Phones, message) == 0
    assert codec.parse(schema.Phones, message).revision is None


@pytest.mark.parametrize(
    ("address", "tags", "values", "said"),
    [
        (schema.Bye.ADDRESS, "i", (1,), "got 1, expected a string"),
        (schema.Bye.ADDRESS, "s", ("",), r"session: got '', expected 1 to 32 bytes"),
        (schema.Bye.ADDRESS, "s", ("é" * 17,), "expected 1 to 32 bytes"),
        ("/fap/1/gaze", "sff", ("a", float("nan"), 0.0), "got nan, expected a number"),
        ("/fap/1/gaze", "ssf", ("a", "b", 0.0), "got 'b', expected a number"),
        (schema.SeekUtterance.ADDRESS, "sih", ("a", 1, 1 << 31), r"expected -2147483648 to 2147483647"),
        (schema.Ping.ADDRESS, "id", (1, 1e300), "expected -9223372036854775808"),
        (schema.Phones.ADDRESS, "siiii", ("a", 1, 0, 0, 0), r"got 0 phones from 0, expected 1 to 256"),
        (schema.Phones.ADDRESS, "siiii", ("a", 1, 0, -1, 1), "got 1 phones from -1"),
        (schema.Phones.ADDRESS, "siiii", ("a", 1, 0, 0, 257), "got 257 phones"),
        (schema.Phones.ADDRESS, "siiiisiii", ("a", 1, 0, 0, 1, "m", 0, 1, 0), "got 9 arguments, expected 10"),
        (schema.Phones.ADDRESS, "siiiisiiif", ("a", 1, 0, 0, 1, "m", -1, 1, 0, 1.0), "phone 'm': got -1 us for 1"),
        (schema.Phones.ADDRESS, "siiiisiiif", ("a", 1, 0, 0, 1, "m", 0, -1, 0, 1.0), "for -1 us"),
        (schema.Phones.ADDRESS, "siiiiiiiif", ("a", 1, 0, 0, 1, 5, 0, 1, 0, 1.0), "got 5, expected a string"),
        (schema.Phones.ADDRESS, "siiiisiiifs", ("a", 1, 0, 0, 1, "m", 0, 1, 0, 1.0, "x"), "got 'x', expected a number"),
    ],
)
def test_what_cannot_be_meant_is_a_data_error(address, tags, values, said):
    with pytest.raises(DataError, match=said):
        read(osc.message(address, tags, *values))


def test_checksum_is_that_of_the_documented_bytes():
    phones = [WirePhone("m", 0, 80_000), WirePhone("ʃ", 80_000, 120_000, flags=1, weight=0.5)]
    spelled = b"m\0" + struct.pack(">ii", 0, 80_000) + "ʃ".encode() + b"\0" + struct.pack(">ii", 80_000, 120_000)
    assert schema.checksum(phones) % 2**32 == zlib.crc32(spelled)
    assert -(2**31) <= schema.checksum(phones) < 2**31
    assert schema.checksum([]) == 0


def test_session_names_have_a_length():
    assert schema.check_session("x" * 32) == "x" * 32
    for name in ("", "x" * 33, "é" * 17):
        with pytest.raises(UsageError, match=r"session: got .*, expected 1 to 32 bytes"):
            schema.check_session(name)


def test_values_that_do_not_fit_are_a_usage_error():
    with pytest.raises(UsageError, match="utt/end"):
        codec.encode(schema.EndUtterance("a", 1, 1 << 40))


TEXT = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=40)
ARGUMENTS = st.lists(
    st.one_of(
        st.tuples(st.just("i"), st.integers(-(2**31), 2**31 - 1)),
        st.tuples(st.just("h"), st.integers(-(2**63), 2**63 - 1)),
        st.tuples(st.just("f"), st.floats(width=32)),
        st.tuples(st.just("d"), st.floats()),
        st.tuples(st.just("s"), TEXT),
        st.tuples(st.just("T"), st.just(True)),
        st.tuples(st.just("N"), st.none()),
        st.tuples(st.just("b"), st.binary(max_size=8)),
    ),
    max_size=16,
)  # fmt: skip


@given(st.sampled_from([*schema.from_sender().values(), *get_args(schema.FromEngine)]), ARGUMENTS)
def test_any_arguments_are_read_or_a_data_error(kind, arguments):
    message = osc.Message(
        codec.layout(kind).address, "".join(tag for tag, _ in arguments), tuple(value for _, value in arguments)
    )
    assert codec.surplus(kind, message) >= 0
    try:
        value = codec.parse(kind, message)
    except DataError:
        return
    assert isinstance(getattr(value, "command", value), kind)
    assert isinstance(codec.encode(value), bytes)
