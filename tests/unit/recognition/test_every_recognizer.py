"""Promises of every ear that hears without a text: pieces do not matter, phones come in time and stay."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.recognition.protocol import RATE_HZ, Recognizer
from fapengine.recognition.small_recognizer import JointRecognizer, SmallRecognizer
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import Phone, PhoneTrack
from tests.unit.recognition.speech import BABY, POPPIES, closures, heard, met, no_speech, spoken

MAX_BLOCKS_S = 0.16
"""Time by which phones may come behind the look-ahead, in the median: what is heard at a time, twice."""


@pytest.fixture(scope="module", params=[SphinxRecognizer, SmallRecognizer, JointRecognizer])
def ear(request: pytest.FixtureRequest) -> Recognizer:
    made: Recognizer = request.param()
    return made


def test_speech_after_music_is_heard(ear: Recognizer) -> None:
    speech = spoken("rms", BABY)
    quiet = np.zeros(RATE_HZ // 2, np.int16)
    phones = PhoneTrack.from_phones(heard(ear, np.concatenate([no_speech()["music"], quiet, speech.samples])))
    truth = [4.5 + at_s for at_s in closures(speech.phones)]
    assert met(truth, closures(phones)) >= 0.6 * len(truth)
    assert all(at_s > 4.0 for at_s in closures(phones))


def test_phones_are_told_behind_the_look_ahead_and_stay(ear: Recognizer) -> None:
    samples = spoken("slt", POPPIES).samples
    ear.reset()
    told: list[Phone] = []
    late_s = []
    for start in range(0, len(samples), 320):
        new = ear.push(samples[start : start + 320])
        now_s = (start + 320) / RATE_HZ
        assert all(phone.end_s <= now_s - ear.look_ahead_s + 1e-9 for phone in new)
        late_s += [now_s - phone.end_s for phone in new if not phone.is_silence]
        told += new
    assert np.median(late_s) < ear.look_ahead_s + MAX_BLOCKS_S
    told += ear.end()
    assert told[0].start_s == 0
    assert told[-1].end_s == pytest.approx(len(samples) / RATE_HZ)
    for before, after in pairwise(told):
        assert after.start_s == pytest.approx(before.end_s, abs=1e-9)


def test_a_partial_result_goes_on_where_the_final_phones_end(ear: Recognizer) -> None:
    samples = spoken("slt", POPPIES).samples
    ear.reset()
    end_s, ahead_s = 0.0, []
    for start in range(0, len(samples), 640):
        for phone in [*ear.push(samples[start : start + 640])]:
            end_s = phone.end_s
        track = [end_s, *(phone.end_s for phone in ear.partial)]
        assert all(
            phone.start_s == pytest.approx(at_s, abs=1e-9) for phone, at_s in zip(ear.partial, track, strict=False)
        )
        assert track[-1] <= (start + 640) / RATE_HZ
        ahead_s.append((start + 640) / RATE_HZ - track[-1])
    assert np.median(ahead_s[20:]) < 0.17  # a final phone's end is known after 0.15 s and, on average, half a block
    ear.end()
    assert not ear.partial


@pytest.fixture(scope="module")
def whole(ear: Recognizer) -> list[Phone]:
    """What it hears in a sentence that comes in one piece."""
    return heard(ear, spoken("rms", BABY).samples)


@settings(max_examples=4)
@given(size_ms=st.sampled_from([10, 20, 37, 200]), first=st.integers(0, 4000))
def test_pieces_of_any_length_give_the_same_phones(
    ear: Recognizer, whole: list[Phone], size_ms: int, first: int
) -> None:
    samples = spoken("rms", BABY).samples
    step = size_ms * RATE_HZ // 1000
    assert heard(ear, samples, [first, *range(first + step, len(samples), step)]) == whole
    assert len(whole) > 15
