"""Sound over OSC: in order, once, whatever the network does; and what a sender sends."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.engine.commands import Append, Begin, Cancel, End
from fapengine.errors import DataError, UsageError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.peers import SoundRequest
from fapengine.wire.speech_osc.receive_window import HOLD_S, MAX_GAP_S, SoundWindow
from fapengine.wire.speech_osc.sender import OscSender
from tests.unit.wire.protocol_double import Wire

RATE_HZ = 16_000
RAMP = np.arange(1, 9601, dtype=np.int16)
"""0.6 s of sound in which every sample tells its place."""
PIECES = [(start, RAMP[start : start + 480]) for start in range(0, len(RAMP), 480)]


def joined(pieces: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(pieces) if pieces else np.zeros(0, np.int16)


def sound(first: int, samples: np.ndarray, utterance: int = 0, rate_hz: int = RATE_HZ) -> bytes:
    return codec.encode(schema.Sound("anna", utterance, first, rate_hz, samples.astype("<i2").tobytes()))


def taken(one: Wire, now_s: float) -> list[SoundRequest]:
    return one.receiver.sounds(now_s)


@given(st.permutations(range(20)), st.lists(st.integers(0, 19), max_size=20))
def test_any_order_and_any_repeats_give_the_sound(order: list[int], again: list[int]) -> None:
    window = SoundWindow(RATE_HZ)
    came: list[np.ndarray] = []
    for index in [*order, *again]:
        first, piece = PIECES[index]
        window.take(first, piece, 0.0)
        came += window.release(0.0)
    window.finish(len(RAMP), 0.0)
    came += window.release(0.0)
    assert window.is_released
    assert np.array_equal(joined(came), RAMP)
    assert window.lost == 0


@given(st.sets(st.integers(0, 19), max_size=19))
def test_what_is_lost_is_filled_and_the_rest_keeps_its_place(lost: set[int]) -> None:
    window = SoundWindow(RATE_HZ)
    came: list[np.ndarray] = []
    for index, (first, piece) in enumerate(PIECES):
        if index not in lost:
            window.take(first, piece, 0.01 * index)
        came += window.release(0.01 * index)
    window.finish(len(RAMP), 0.2)
    came += window.release(0.2 + HOLD_S) + window.release(0.2 + 2 * HOLD_S)
    heard = joined(came)
    assert window.is_released
    assert len(heard) == len(RAMP)
    assert window.lost == 480 * len(lost)
    for index, (first, piece) in enumerate(PIECES):
        assert np.array_equal(heard[first : first + 480], piece) == (index not in lost)


def test_a_gap_is_waited_for_and_then_filled_backwards() -> None:
    window = SoundWindow(RATE_HZ)
    assert window.take(*PIECES[0], now_s=0.0)
    assert len(joined(window.release(0.0))) == 480
    assert window.take(*PIECES[2], now_s=0.03)
    assert window.release(0.03 + HOLD_S - 1e-6) == []
    filled, after = window.release(0.03 + HOLD_S)
    assert np.array_equal(filled, PIECES[0][1][::-1])
    assert np.array_equal(after, PIECES[2][1])
    assert window.take(*PIECES[1], now_s=0.1) is False  # too late
    assert window.take(PIECES[3][0] + round(MAX_GAP_S * RATE_HZ) + 1, RAMP, 0.1) is None


def test_an_utterance_that_others_began_is_joined() -> None:
    window = SoundWindow(RATE_HZ)
    assert window.take(5 * RATE_HZ, RAMP, 0.0)
    assert np.array_equal(joined(window.release(0.0)), RAMP)
    assert window.first == 5 * RATE_HZ


def test_sound_goes_to_the_ear_and_nothing_else_to_the_engine() -> None:
    one = Wire()
    one.send(sound(0, RAMP[:480]))
    one.send(sound(480, RAMP[480:960]))
    (request,) = taken(one, 0.0)
    assert (request.session, request.rate_hz, request.first_s) == ("anna", RATE_HZ, 0.0)
    assert (request.is_placed, request.is_last) == (False, False)
    assert np.array_equal(request.samples, RAMP[:960])
    assert taken(one, 0.1) == []
    one.send(codec.encode(schema.EndUtterance("anna", 0, 0, 60_000)))
    (last,) = taken(one, 0.1)
    assert (len(last.samples), last.is_last) == (0, True)
    assert one.faces.commands((Begin, Append, End)) == []


def test_one_that_begins_at_a_time_is_the_engines() -> None:
    one = Wire()
    one.send(codec.encode(schema.BeginUtterance("anna", 3, 0, "audio")))
    one.send(sound(0, RAMP[:480], 3))
    (request,) = taken(one, 0.0)
    (begin,) = one.faces.commands(Begin)
    assert request.is_placed
    assert request.utterance == begin.utterance


def test_a_cancel_forgets_the_sound_that_came_and_comes() -> None:
    one = Wire()
    one.send(sound(0, RAMP[:480]))
    one.send(codec.encode(schema.CancelUtterance("anna")))
    one.send(sound(480, RAMP[480:960]))
    assert taken(one, 0.0) == []
    assert one.faces.commands(Cancel)
    assert one.counts.repeated == 1
    one.send(sound(0, RAMP[:480], 1))  # what is said next
    assert len(taken(one, 0.0)) == 1


def test_phones_and_sound_of_one_utterance_do_not_mix() -> None:
    one = Wire()
    one.send(sound(0, RAMP[:480]))
    one.send(codec.encode(schema.Phones("anna", 0, 0, 0, (schema.WirePhone("m", 0, 80_000),))))
    assert one.counts.refused == 1
    one.send(sound(480, RAMP[:480], rate_hz=8000))
    assert one.counts.refused == 2
    one.send(codec.encode(schema.Phones("anna", 1, 0, 0, (schema.WirePhone("m", 0, 80_000),))))
    one.send(sound(0, RAMP[:480], 1))
    assert one.counts.refused == 3


@pytest.mark.parametrize(
    ("first", "rate_hz", "blob"),
    [(0, 16_000, b""), (0, 16_000, b"abc"), (-1, 16_000, b"ab"), (0, 4000, b"ab"), (0, 96_000, b"ab"),
     (2**31 - 1, 16_000, b"ab"), (0, 16_000, bytes(1202))],
)  # fmt: skip
def test_what_cannot_be_sound_is_refused(first: int, rate_hz: int, blob: bytes) -> None:
    message = osc.Message("/fap/1/sound", "siiib", ("anna", 0, first, rate_hz, blob))
    with pytest.raises(DataError, match="/fap/1/sound: got"):
        codec.parse(schema.Sound, message)
    with pytest.raises(DataError, match="expected a blob"):
        codec.parse(schema.Sound, osc.Message("/fap/1/sound", "siiis", ("anna", 0, 0, 16_000, "ab")))


def sent(sender: OscSender, until_s: float) -> list[tuple[float, schema.Wire, int]]:
    """Everything a sender sends, with the time and the size of its datagram."""
    known = schema.from_sender()
    return [
        (step / 1000, codec.parse(known[message.address], message), len(packet))
        for step in range(round(until_s * 1000) + 1)
        for packet in sender.due(step / 1000)
        for message in osc.parse_packet(packet)
    ]


def test_a_sender_sends_sound_twice_in_small_datagrams_and_faster_than_it_sounds() -> None:
    sender = OscSender("a" * 32)
    number = sender.begin(0.0, anchor="sound")
    sender.sound(number, RAMP, RATE_HZ, 0.0)
    sender.end(number)
    told = sent(sender, 0.5)
    assert max(size for _, _, size in told) <= schema.MAX_DATAGRAM
    pieces = [(at_s, wire) for at_s, wire, _ in told if isinstance(wire, schema.Sound)]
    firsts = [wire.first_sample for _, wire in pieces]
    assert sorted(firsts) == sorted([first for first, _ in PIECES] * 2)
    assert pieces[-1][0] == pytest.approx(0.6 / 4 + 0.03, abs=0.02)
    heard = {wire.first_sample: np.frombuffer(wire.samples, "<i2") for _, wire in pieces}
    assert np.array_equal(np.concatenate([heard[first] for first in sorted(heard)]), RAMP)
    ends = [(at_s, wire) for at_s, wire, _ in told if isinstance(wire, schema.EndUtterance)]
    assert ends[0][0] >= pieces[-1][0]
    assert ends[0][1].duration_us == 600_000
    assert not sender.is_settled()


def test_a_reliable_sender_sends_once() -> None:
    sender = OscSender("anna", reliable=True)
    sender.sound(sender.begin(0.0, anchor="sound"), RAMP, RATE_HZ, 0.0)
    assert sum(isinstance(wire, schema.Sound) for _, wire, _ in sent(sender, 0.3)) == len(PIECES)


def test_a_cancel_stops_the_sound_that_was_to_be_sent() -> None:
    sender = OscSender("anna")
    sender.sound(sender.begin(0.0, anchor="sound"), np.tile(RAMP, 100), RATE_HZ, 0.0)
    sender.due(0.0)
    sender.cancel(0.001)
    assert not any(isinstance(wire, schema.Sound) for _, wire, _ in sent(sender, 0.3))
    assert sender.next_s(1.0) < inf


def test_a_sender_refuses_what_cannot_be() -> None:
    sender = OscSender("anna")
    now, later = sender.begin(0.0), sender.begin(0.0, anchor="audio")
    with pytest.raises(UsageError, match="got sound, expected a beginning at a time"):
        sender.sound(now, RAMP, RATE_HZ, 0.0)
    with pytest.raises(UsageError, match=r"rate_hz: got 4000, expected 8000 to 48000"):
        sender.sound(later, RAMP, 4000, 0.0)
    sender.sound(later, RAMP, RATE_HZ, 0.0)
    with pytest.raises(UsageError, match="rate_hz: got 8000, expected 16000"):
        sender.sound(later, RAMP, 8000, 0.0)
    with pytest.raises(UsageError, match="got phones and sound"):
        sender.append(later, [])
    sender.end(later)
    with pytest.raises(UsageError, match="got sound after its end"):
        sender.sound(later, RAMP, RATE_HZ, 0.0)
