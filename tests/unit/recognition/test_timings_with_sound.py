"""Timings with their recording: a shout looks like one, whoever has timed it."""

import numpy as np
import pytest

from fapengine.app.hearing import with_loudness
from fapengine.app.performance import animate
from fapengine.recognition.loudness import PIECE_S, soundings, soundings_at
from fapengine.recognition.protocol import RATE_HZ
from fapengine.speech.phone_track import Phone, PhoneTrack
from tests.unit.recognition.speech import BABY, spoken


def opening_fapu(sound: np.ndarray | None, half: int) -> float:
    values = animate(spoken("rms", BABY).phones, sound=None if sound is None else (sound, RATE_HZ)).track.values
    opening = -(values[:, 3] + values[:, 4])
    return float(np.array_split(opening, 2)[half].max())


def test_what_is_said_quietly_opens_the_mouth_less() -> None:
    even = spoken("rms", BABY).samples
    fading = even.copy()
    fading[len(even) // 2 :] //= 10
    assert opening_fapu(even, 0) == opening_fapu(None, 0)
    assert opening_fapu(fading, 1) < 0.7 * opening_fapu(even, 1)  # it varies


def test_phones_that_tell_their_loudness_keep_it() -> None:
    phones = PhoneTrack.from_phones([Phone("a", 0.0, 0.5, loudness_db=6.0), Phone("i", 0.5, 1.0)])
    assert with_loudness(phones, np.zeros(RATE_HZ, np.int16), RATE_HZ) is phones


@pytest.mark.parametrize("rate_hz", [RATE_HZ, 44_100])
def test_a_long_sound_is_heard_in_pieces_as_in_one(rate_hz: int) -> None:
    at_s = np.arange(round(2.5 * PIECE_S * rate_hz)) / rate_hz
    sound = (8000 * (0.2 + 0.8 * (at_s / at_s[-1])) * np.sin(2 * np.pi * 150 * at_s)).astype(np.int16)
    phones = [Phone("a", start_s, start_s + 0.5) for start_s in np.arange(0.0, 2.5 * PIECE_S, 0.5)]
    found = soundings_at(phones, sound, rate_hz)
    plain = sound if rate_hz == RATE_HZ else None
    assert len(found) == len(phones)
    assert [one.pitch_hz for one in found] == pytest.approx([150.0] * len(phones), abs=1.0)
    assert found[-1].loudness_db - found[0].loudness_db == pytest.approx(20 * np.log10(1.0 / 0.208), abs=0.3)
    if plain is not None:
        whole = soundings(phones, plain)
        assert [one.loudness_db for one in found] == pytest.approx([one.loudness_db for one in whole], abs=0.2)


def test_phones_behind_the_end_of_a_sound_change_nothing() -> None:
    phones = PhoneTrack.from_phones([Phone("a", 0.0, 0.5), Phone("i", 0.5, 1.0), Phone("u", 30.0, 31.0)])
    told = with_loudness(phones, np.zeros(100, np.int16), RATE_HZ)
    assert told.phones == phones.phones
