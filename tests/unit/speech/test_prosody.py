"""Loudness against the speaker's own, and stress that no text tells."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speech import prosody
from fapengine.speech.phone_track import LOUDNESS_DB, SILENCE, Phone
from fapengine.speech.prosody import KNOWN_S, RunningProsody, Sounding, with_prosody


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


def test_a_stream_is_compared_with_its_past() -> None:
    phones, soundings = speech(PARTS)
    running = RunningProsody()
    told = []
    for start in range(0, len(phones), 3):
        told += running.push(phones[start : start + 3], soundings[start : start + 3])[0]
    assert [replace(phone, stress=0, loudness_db=0.0) for phone in told] == phones
    found = loudness(told)
    assert (found[:20] == 0).all()
    assert (found[30:44] < -9).all()
    assert (found[80:] > 6).all()
    assert told[: int(2 * KNOWN_S / 0.12)] == phones[: int(2 * KNOWN_S / 0.12)]  # nothing is known yet
    assert running.push([], []) == ([], [])


@pytest.mark.parametrize("loudness_db", [LOUDNESS_DB[0] - 0.1, LOUDNESS_DB[1] + 0.1, float("nan")])
def test_a_loudness_out_of_range_is_refused(loudness_db: float) -> None:
    with pytest.raises(UsageError, match=r"loudness_db of 'a': got .*, expected -12 to 8"):
        Phone("a", 0.0, 0.1, loudness_db=loudness_db)


def test_phones_that_may_still_change_count_for_those_before_them() -> None:
    phones, soundings = speech([-20.0] * 10)
    phones_after, soundings_after = phones[16:], soundings[16:]
    running = RunningProsody()
    running.push(phones[:14], soundings[:14])
    louder = [replace(one, loudness_db=one.loudness_db + 12) for one in soundings_after]
    expected = with_prosody(phones, [*soundings[:16], *louder])
    for _ in range(2):  # they are not kept
        final, partial = running.push([], [], phones[14:], [*soundings[14:16], *louder])
        assert (final, partial) == ([], expected[14:])
    assert running.push(phones[14:16], soundings[14:16], phones_after, louder) == (expected[14:16], expected[16:])
    assert expected[15].loudness_db > 0


def test_in_a_stream_too_one_of_neighbours_is_stressed() -> None:
    levels = [-20.0] * 12
    levels[8], levels[9] = -12.0, -13.0
    running, told = RunningProsody(), []
    for phone, sounding in zip(*speech(levels), strict=True):
        told += running.push([phone], [sounding])[0]
    assert [number for number, phone in enumerate(told) if phone.stress] == [17]


def test_a_long_stream_takes_no_more_work_than_a_short_one() -> None:
    running, work = RunningProsody(), []
    phones, soundings = speech([-20.0, -23.0, -18.0] * 100)
    for at in range(0, len(phones) - 4, 2):
        new, after = slice(at, at + 2), slice(at + 2, at + 6)
        with patch.object(prosody, "_prominence", wraps=prosody._prominence) as compared:
            running.push(phones[new], soundings[new], phones[after], soundings[after])
        work.append(compared.call_count)
    assert max(work[20:]) == max(work[-20:]) <= 10
    assert len(running._vowels) <= 5 * prosody.KEPT_S


@pytest.mark.parametrize(("pitch_hz", "times"), [(900.0, 1.0), (120.0, 6.0)])
def test_height_and_length_count_up_to_a_limit(pitch_hz: float, times: float) -> None:
    """However high or long a vowel is, the quietness that outweighs half of it outweighs the whole."""

    def is_stressed(share: float, quieter_db: float) -> bool:
        phones, soundings = speech([-20.0] * 20)
        grown_s = phones[21].duration_s * (times**share - 1.0)
        phones[21] = replace(phones[21], end_s=phones[21].end_s + grown_s)
        phones[22:] = [replace(one, start_s=one.start_s + grown_s, end_s=one.end_s + grown_s) for one in phones[22:]]
        soundings[21] = Sounding(-20.0 - quieter_db, 120.0 * (pitch_hz / 120.0) ** share)
        return bool(with_prosody(phones, soundings)[21].stress)

    enough_db = next(db for db in np.arange(0.0, 30.0, 0.5) if not is_stressed(0.5, db))
    assert 0 < enough_db < 10
    assert is_stressed(1.0, enough_db - 0.5)
    assert not is_stressed(1.0, enough_db)
