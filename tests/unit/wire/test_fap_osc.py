"""FAP frames over OSC: the bytes of one by hand, every frame back, and what a decoder refuses."""

import struct
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_packet import OscPacket

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.wire import fap_osc, osc
from fapengine.wire.fap_osc import (
    FapFrame,
    SessionFrames,
    decode_frame,
    encode_frame,
    encode_named,
    encode_track,
)

h = bytes.fromhex


def frame_of(sent: dict[int, int], *, visemes=(0, 0, 0, 0), expressions=(0,) * 6, high=(), **fields) -> FapFrame:
    values, mask = np.zeros(68, np.int32), np.zeros(68, bool)
    for number, value in sent.items():
        values[fap.column(number)], mask[fap.column(number)] = value, True
    for number in high:
        mask[fap.column(number)] = True
    defaults = {"session": "a", "number": 0, "time_us": 0}
    return FapFrame(values=values, mask=mask, visemes=visemes, expressions=expressions, **(defaults | fields))


EXAMPLE = frame_of({3: 200, 68: -1}, visemes=(1, 0, 63, 0), high=(1,), session="anna", number=7, time_us=40_000)
EXAMPLE_BYTES = h(
    "2f666170 2f312f66 72616d65 00000000"  # /fap/1/frame
    "2c736968 62696969 69696900"  # ,sihb and six i
    "616e6e61 00000000"  # anna
    "00000007 00000000 00009c40"  # number 7, 40000 us
    "00000009 a0000000 00000000 10000000"  # mask: FAP 1, 3 and 68
    "00000001 00000000 0000003f 00000000"  # viseme 1, 0, blend 63, def 0
    "000000c8 ffffffff"  # FAP 3, FAP 68
)


def same(one: FapFrame, other: FapFrame) -> bool:
    return all(np.array_equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(FapFrame))


def test_the_example_has_its_bytes_and_every_cut_is_refused() -> None:
    assert encode_frame(EXAMPLE) == EXAMPLE_BYTES
    assert same(decode_frame(EXAMPLE_BYTES), EXAMPLE)
    for cut in range(len(EXAMPLE_BYTES)):
        with pytest.raises(DataError):
            decode_frame(EXAMPLE_BYTES[:cut])


def test_another_reader_reads_it() -> None:
    (timed,) = OscPacket(encode_frame(EXAMPLE)).messages
    assert timed.message.address == "/fap/1/frame"
    assert timed.message.params == ["anna", 7, 40_000, h("a00000000000000010"), 1, 0, 63, 0, 200, -1]


INTS = st.integers(-(2**31), 2**31 - 1)


@st.composite
def frames(draw: st.DrawFn) -> FapFrame:
    mask = np.array(draw(st.lists(st.booleans(), min_size=68, max_size=68)))
    values = np.array(draw(st.lists(INTS, min_size=68, max_size=68)), np.int32) * mask
    values[:2] = 0
    four, six = (np.array(draw(st.lists(INTS, min_size=n, max_size=n)), np.int32) for n in (4, 6))
    return FapFrame(
        session=draw(
            st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=8)
        ),
        number=draw(st.integers(0, 2**31 - 1)),
        time_us=draw(st.integers(0, 2**63 - 1)),
        values=values,
        mask=mask,
        visemes=four * mask[0],
        expressions=six * mask[1],
    )


@given(frames())
def test_every_frame_comes_back(frame: FapFrame) -> None:
    data = encode_frame(frame)
    assert len(data) <= fap_osc.MAX_DATAGRAM
    assert same(decode_frame(data), frame)


def test_a_track_is_numbered_without_gaps_and_keeps_its_times() -> None:
    rng = np.random.default_rng(1)
    values = rng.integers(-500, 500, (3, 68), dtype=np.int32)
    values[:, :2] = 0
    track = replace(FapTrack.from_values(values, rate_hz=25.0), frame_numbers=np.array([0, 2, 3]))
    decoded = [decode_frame(data) for data in encode_track(track, session="s", start_us=1_000_000, first_number=5)]
    assert [frame.number for frame in decoded] == [5, 6, 7]
    assert [frame.time_us for frame in decoded] == [1_000_000, 1_080_000, 1_120_000]
    for row, frame in enumerate(decoded):
        assert np.array_equal(frame.values, track.values[row] * track.mask[row])
        assert np.array_equal(frame.mask, track.mask[row])
    assert encode_track(FapTrack.from_values(np.zeros((0, 68)), rate_hz=25.0), session="s") == []


def test_many_sessions_at_once_are_what_each_would_be_alone() -> None:
    rng = np.random.default_rng(2)
    faps = rng.integers(-(2**31), 2**31, (3, 68), dtype=np.int64).astype(np.int32)
    names = ("a", "anna", "é" * 16)
    stream = SessionFrames()
    for number, (sessions, rows) in enumerate([(names, faps), (names, faps[::-1]), (names[1:], faps[:2])]):
        for data, name, row in zip(stream.encode(sessions, rows, 7 + number), sessions, rows, strict=True):
            values = np.where(np.arange(68) < 2, 0, row)
            mask = np.arange(68) >= 2
            fields = {"visemes": np.zeros(4), "expressions": np.zeros(6), "values": values, "mask": mask}
            assert data == encode_frame(FapFrame(session=name, number=number, time_us=7 + number, **fields))
    assert [decode_frame(data).number for data in stream.encode(names, faps, 0)] == [0, 3, 3]  # "a" is back


def test_epochs_of_sessions_stand_behind_the_values() -> None:
    epochs = {"a": 3}
    stream = SessionFrames(epochs=epochs)
    faps = np.arange(136, dtype=np.int32).reshape(2, 68)
    plain = SessionFrames().encode(("a", "b"), faps, 0)
    for _ in range(2):
        frames = [decode_frame(data) for data in stream.encode(("a", "b"), faps, 0)]
        assert [frame.epoch for frame in frames] == [epochs["a"], 0]
        assert np.array_equal(frames[0].values, decode_frame(plain[0]).values)
        assert same(decode_frame(encode_frame(frames[0])), frames[0])
        epochs["a"] = 4
    assert not same(frames[0], decode_frame(plain[0]))
    with pytest.raises(UsageError, match="epoch -1"):
        frame_of({}, epoch=-1)


def test_low_level_faps_of_a_session() -> None:
    (data,) = SessionFrames().encode(("a",), np.arange(68, dtype=np.int32)[None], 0)
    frame = decode_frame(data)
    assert np.flatnonzero(frame.mask).tolist() == list(range(2, 68))
    assert frame.values.tolist() == [0, 0, *range(2, 68)]
    with pytest.raises(UsageError, match="session: got ''"):
        SessionFrames().encode(("",), np.zeros((1, 68), np.int32), 0)


def test_the_first_and_the_last_number_can_be_sent() -> None:
    track = FapTrack.from_values(np.zeros((2, 68)), rate_hz=25.0)
    for first in (0, 2**31 - 2):
        found = [decode_frame(data).number for data in encode_track(track, session="s", first_number=first)]
        assert found == [first, first + 1]


@pytest.mark.parametrize("where", [{"start_us": -1}, {"first_number": -1}, {"first_number": 2**31 - 1}])
def test_numbers_that_cannot_be_sent(where: dict[str, int]) -> None:
    with pytest.raises(UsageError, match="expected both from 0 on"):
        encode_track(FapTrack.from_values(np.zeros((2, 68)), rate_hz=25.0), session="s", **where)


@pytest.mark.parametrize(
    ("field", "what"),
    [
        ({"session": ""}, "0 bytes"),
        ({"session": "é" * 17}, "34 bytes, expected 1 to 32"),
        ({"session": "a\0"}, "NUL"),
        ({"session": "\ud800"}, "got"),
        ({"number": 2**31}, "number 2147483648"),
        ({"number": -1}, "number -1"),
        ({"time_us": -1}, "at -1 us"),
    ],
)
def test_frames_that_cannot_be(field: dict[str, object], what: str) -> None:
    with pytest.raises(UsageError, match=what):
        frame_of({3: 1}, **field)


def message_of(tags: str, *arguments: osc.Argument, address: str = "/fap/1/frame") -> bytes:
    return osc.message(address, tags, *arguments)


JAW = h("200000000000000000")


@pytest.mark.parametrize(
    ("data", "error", "what"),
    [
        (osc.bundles([EXAMPLE_BYTES] * 2, limit=999)[0], DataError, "got 2 messages"),
        (message_of("sihbi", "a", 0, 0, JAW, 1, address="/fap/2/frame"), DataError, "got /fap/2/frame"),
        (message_of("siib", "a", 0, 0, JAW), DataError, "got /fap/1/frame ,siib"),
        (message_of("sihb", "a", 0, 0, JAW), TruncatedError, "got 0 values, expected 1"),
        (message_of("sihbf", "a", 0, 0, JAW, 1.0), DataError, "got tags f, expected 1 x i"),
        (message_of("sihbi", "a", 0, 0, JAW[:8], 1), DataError, "got mask"),
        (message_of("sihbi", "a", 0, 0, JAW[:8] + h("01"), 1), DataError, "end in 4 zero bits"),
        (message_of("sihbi", "", 0, 0, JAW, 1), DataError, "session: got ''"),
        (message_of("sihbi", "a", -1, 0, JAW, 1), DataError, "number -1"),
        (message_of("sihbi", "a", 0, -1, JAW, 1), DataError, "at -1 us"),
    ],
)
def test_what_is_no_frame_is_refused(data: bytes, error: type[DataError], what: str) -> None:
    with pytest.raises(error, match=what):
        decode_frame(data)


def test_surplus_arguments_are_ignored() -> None:
    frame = decode_frame(message_of("sihbisf", "a", 0, 0, JAW, 9, "more", 1.0))
    assert frame.values[fap.column(3)] == 9


def test_named_form_sends_what_the_mask_says_within_the_limit() -> None:
    (data,) = encode_named(EXAMPLE)
    assert data == osc.BUNDLE_HEAD + b"".join(
        struct.pack(">i", len(part)) + part
        for part in (
            h("2f666170 2f766973 656d6500 2c696969 69000000 00000001 00000000 0000003f 00000000"),  # /fap/viseme
            h("2f666170 2f330000 2c690000 000000c8"),
            h("2f666170 2f363800 2c690000 ffffffff"),
        )
    )
    full = frame_of({n: n * 3 for n in range(3, 69)}, visemes=(1, 2, 3, 0), expressions=(1, 2, 3, 4, 0, 1), high=(1, 2))
    datagrams = encode_named(full)
    assert [len(data) for data in datagrams] == [1188, 256]  # 16 + 40 + 52 + 54 * 20, 16 + 12 * 20
    found = {message.address: message.arguments for data in datagrams for message in osc.parse_packet(data)}
    both = {"/fap/viseme": (1, 2, 3, 0), "/fap/expression": (1, 2, 3, 4, 0, 1)}
    assert found == both | {f"/fap/{n}": (n * 3,) for n in range(3, 69)}
    assert encode_named(frame_of({})) == []


def test_the_documented_example_is_the_one_tested() -> None:
    page = (Path(__file__).parents[3] / "docs" / "frames-out.md").read_text()
    block = page.split("```\n2f666170", 1)[1].split("```")[0]
    words = [line.split("  ")[0] for line in ("2f666170" + block).strip().splitlines()]
    assert h("".join(words)) == EXAMPLE_BYTES
