"""Loudness against the speaker's own, and stress that no text tells."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speech.phone_track import LOUDNESS_DB, SILENCE, Phone
from fapengine.speech.prosody import KNOWN_S, RunningProsody, Sounding, Usual, with_prosody


def speech(levels_db: list[float], *, vowel: str = "a") -> tuple[list[Phone], list[Sounding]]:
    """A t and a vowel for each level, five a second."""
    phones, soundings = [], []
    for number, level_db in enumerate(levels_db):
        phones += [Phone("t", number / 5, number / 5 + 0.08), Phone(vowel, number / 5 + 0.08, (number + 1) / 5)]
        soundings += [Sounding(level_db - 15, 0.0), Sounding(level_db, 120.0)]
    return phones, soundings


PARTS = [-20.0] * 12 + [-40.0] * 12 + [-20.0] * 12 + [-8.0] * 12


def loudness(phones: list[Phone]) -> np.ndarray:
    return np.array([phone.loudness_db for phone in phones])


def test_a_whisper_is_quiet_and_a_shout_loud_consonants_too() -> None:
    phones, soundings = speech(PARTS)
    found = loudness(with_prosody(phones, soundings))
    assert (found[4:20] == 0).all()  # usual, and no vowel of the next part near
    assert (found[28:44] == LOUDNESS_DB[0]).all()  # 20 dB down
    assert found[84:92] == pytest.approx(8.0)  # 12 dB up, without the 4 that are usual


def test_a_louder_recording_is_no_shout() -> None:
    phones, soundings = speech(PARTS)
    louder = [replace(sounding, loudness_db=sounding.loudness_db + 7) for sounding in soundings]
    assert with_prosody(phones, louder) == with_prosody(phones, soundings)
    assert (loudness(with_prosody(*speech([-60.0] * 20))) == 0).all()


def test_single_vowels_do_not_count_unless_they_are_unsure() -> None:
    phones, soundings = speech([-20.0, -26.0] * 15)
    assert (loudness(with_prosody(phones, soundings)) == 0).all()
    unsure = [replace(phone, confidence=0.5) for phone in phones]
    found = loudness(with_prosody(unsure, soundings))
    assert (found[::2] == 0).all()  # of consonants a level says nothing
    vowels = found[1::2][2:-2]
    assert (vowels[::2] > vowels[1::2] + 1).all()
    assert np.abs(vowels).max() < 2


def test_vowels_that_stand_out_are_stressed() -> None:
    levels = [-20.0] * 20
    for index in (4, 12):
        levels[index] = -12.0
    phones, soundings = speech(levels)
    found = with_prosody(phones, soundings)
    assert [number for number, phone in enumerate(found) if phone.stress] == [9, 25]
    higher = [replace(s, pitch_hz=160.0 if number == 31 else s.pitch_hz) for number, s in enumerate(soundings)]
    assert [n for n, phone in enumerate(with_prosody(phones, higher)) if phone.stress] == [9, 25, 31]


def test_stress_that_a_text_tells_stays() -> None:
    phones, soundings = speech([-20.0] * 4 + [-10.0] + [-20.0] * 4)
    phones[3] = replace(phones[3], stress=2)
    assert [phone.stress for phone in with_prosody(phones, soundings)] == [phone.stress for phone in phones]


def test_of_neighbours_one_is_stressed() -> None:
    levels = [-20.0] * 20
    levels[8], levels[9] = -13.0, -12.0
    found = with_prosody(*speech(levels))
    assert [number for number, phone in enumerate(found) if phone.stress] == [19]


def test_without_vowels_nothing_is_said() -> None:
    phones = [Phone(SILENCE, 0.0, 1.0), Phone("s", 1.0, 1.2)]
    soundings = [Sounding(-90.0, 0.0), Sounding(-20.0, 0.0)]
    assert with_prosody(phones, soundings) == phones
    assert with_prosody([], []) == []


def test_another_usual_may_be_given() -> None:
    phones, soundings = speech([-20.0] * 10)
    assert loudness(with_prosody(phones, soundings, Usual(-30.0, 120.0))) == pytest.approx(6.0)


def test_a_stream_is_compared_with_its_past() -> None:
    phones, soundings = speech(PARTS)
    running = RunningProsody()
    told = []
    for start in range(0, len(phones), 3):
        told += running.push(phones[start : start + 3], soundings[start : start + 3])
    assert [replace(phone, stress=0, loudness_db=0.0) for phone in told] == phones
    found = loudness(told)
    assert (found[:20] == 0).all()
    assert (found[30:44] < -9).all()
    assert (found[80:] > 6).all()
    assert told[: int(2 * KNOWN_S / 0.12)] == phones[: int(2 * KNOWN_S / 0.12)]  # nothing is known yet
    assert running.push([], []) == []


@pytest.mark.parametrize("loudness_db", [LOUDNESS_DB[0] - 0.1, LOUDNESS_DB[1] + 0.1, float("nan")])
def test_a_loudness_out_of_range_is_refused(loudness_db: float) -> None:
    with pytest.raises(UsageError, match=r"loudness_db of 'a': got .*, expected -12 to 8"):
        Phone("a", 0.0, 0.1, loudness_db=loudness_db)


def test_the_last_phones_alone_are_as_among_all() -> None:
    rng = np.random.default_rng(3)
    phones = [Phone("ma_"[n % 3], n / 10, (n + 1) / 10, confidence=0.5) for n in range(60)]
    sounds = [Sounding(float(rng.uniform(-40, -10)), float(rng.uniform(90, 200))) for _ in phones]
    whole = with_prosody(phones, sounds)
    assert sum(phone.stress for phone in whole) >= 3
    for first in (0, 1, 31, 58):
        assert with_prosody(phones, sounds, first=first) == whole[first:]
