"""A face in a stream, whatever pieces come: no sample is lost, no phone is late, positions are right to 20 ms."""

from math import ceil

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.host.stream import REST_S, STALL_S
from tests.unit.host.test_stream import mouths, noise, pauses_of, sound_of, stage
from tests.unit.host.ticking_recognizer import TickingRecognizer

RATES_HZ = (8_000, 16_000, 22_050, 24_000, 44_100, 48_000)
FRAMES_HZ = (12.0, 24.0, 25.0, 29.97, 30.0, 60.0)
pieces = st.lists(st.tuples(st.integers(1, 9_000), st.integers(0, 12)), min_size=1, max_size=25)
"""Samples, and frames that pass before the next piece."""


@settings(max_examples=40)
@given(pieces=pieces, rate_hz=st.sampled_from(RATES_HZ), frame_hz=st.sampled_from(FRAMES_HZ), has_ear=st.booleans())
def test_every_sample_once_and_no_phone_late(
    pieces: list[tuple[int, int]], rate_hz: int, frame_hz: float, has_ear: bool
) -> None:
    one = stage(TickingRecognizer() if has_ear else None)
    pauses = pauses_of(one)
    frames, sent = [], []
    for number, (count, pause) in enumerate(pieces):
        sent.append(noise(count / rate_hz, rate_hz, seed=number))
        one.push(sent[-1], rate_hz)
        frames += [one.next(1 / frame_hz) for _ in range(pause)]
    one.end()
    length_s = sum(map(len, sent)) / rate_hz
    frames += [one.next(1 / frame_hz) for _ in range(ceil((length_s + 0.5) * frame_hz))]
    assert np.array_equal(sound_of(frames), np.concatenate(sent))
    stretches = len(pauses) + 1  # each may end inside a frame
    filled = sum(bool(frame.sounds) for frame in frames)
    assert ceil(length_s * frame_hz - 1e-6) <= filled < ceil(length_s * frame_hz - 1e-6) + stretches
    counters = one.engine.counters(one.session)
    assert (counters.late, counters.dropped) == (0, 0)
    finished = one.events()[-1]
    assert finished.kind == "finished"
    assert abs(finished.position_s - length_s) < 0.02


@settings(max_examples=40)
@given(
    begun=st.integers(1, 60), heard=st.floats(0.0, 1.0), frame_hz=st.sampled_from(FRAMES_HZ), again=st.booleans()
)  # fmt: skip
def test_an_interruption_at_any_time(begun: int, heard: float, frame_hz: float, again: bool) -> None:
    """The listener has heard a part of the last frame when the interruption comes."""
    one = stage(TickingRecognizer())
    one.push(noise(3.0), 24_000)
    frames = [one.next(1 / frame_hz) for _ in range(begun)]
    unplayed_s = (1 - heard) / frame_hz if frames[-1].sounds else 0.0
    one.interrupt(unplayed_s)
    heard_s = max(len(sound_of(frames)) / 24_000 - unplayed_s, 0.0)
    last = one.events()[-1]
    assert last.kind == "interrupted"
    assert abs(last.position_s - heard_s) < 0.02
    if again:
        one.push(noise(3.0), 24_000)
        one.interrupt()
    after = [one.next(1 / frame_hz) for _ in range(ceil(frame_hz))]
    assert not any(frame.sounds for frame in after)
    assert mouths(after)[ceil(REST_S * frame_hz) :].max() == 0
    assert not one.is_speaking


@settings(max_examples=15)
@given(lengths=st.lists(st.floats(0.05, 1.5), min_size=2, max_size=5), ends=st.booleans())
def test_one_after_the_other(lengths: list[float], ends: bool) -> None:
    """Utterances that come at once finish in order; one whose end is never told is said all the same."""
    one = stage(TickingRecognizer())
    sent = [noise(length_s, seed=number) for number, length_s in enumerate(lengths)]
    for sound in sent:
        one.push(sound, 24_000)
        if ends:
            one.end()
    frames = [one.next(0.04) for _ in range(ceil((sum(lengths) + STALL_S + 1.0) / 0.04))]
    assert np.array_equal(sound_of(frames), np.concatenate(sent))
    told = [(event.utterance, event.kind) for event in one.events()]
    count = len(lengths) if ends else 1
    expected = [(number + 1, kind) for number in range(count) for kind in ("started", "finished")]
    assert told == (expected if ends else expected[:1])
