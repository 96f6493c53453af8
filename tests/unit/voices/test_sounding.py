"""Marks of a voice and its samples to phones, on sounds made for the purpose."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.speech.phone_track import SILENCE
from fapengine.voices.sounding import MAX_CLOSURE_S, Mark, SoundLevel, sounding

RATE_HZ = 16000
DARK, BRIGHT, QUIET = "dark", "bright", "quiet"
Told = list[tuple[str, int, int]]


def sound_of(*pieces: tuple[str, int]) -> SoundLevel:
    """Stretches of so many ms: a hum of 200 Hz, as of a nasal; the same with formants, as of a vowel; nothing."""
    return SoundLevel(np.concatenate([piece(kind, length_ms) for kind, length_ms in pieces]), RATE_HZ)


def piece(kind: str, length_ms: int) -> NDArray[np.float64]:
    times_s = np.arange(round(RATE_HZ * length_ms / 1e3)) / RATE_HZ
    hum = 3000 * np.sin(2 * np.pi * 200 * times_s)
    formants = 2000 * np.sin(2 * np.pi * 1500 * times_s)
    return {DARK: hum, BRIGHT: hum + formants, QUIET: 0 * times_s}[kind]


def told(sound: SoundLevel, *marks: tuple[int, str]) -> Told:
    """Labels with start and end in ms."""
    phones = sounding([Mark(at_ms / 1e3, label) for at_ms, label in marks], sound)
    assert [phone.start_s for phone in phones[1:]] == [phone.end_s for phone in phones[:-1]]
    assert (phones[0].start_s, phones[-1].end_s) == (0.0, sound.duration_s)
    return [(phone.label, round(1e3 * phone.start_s), round(1e3 * phone.end_s)) for phone in phones]


@pytest.mark.parametrize("stop", ["p", "t", "tʃ", "t͡s", "kʰ"])
def test_a_stop_begins_with_its_closure(stop: str) -> None:
    sound = sound_of((BRIGHT, 200), (QUIET, 50), (BRIGHT, 150))
    start, closure = told(sound, (0, "a"), (250, stop), (280, "a"))[:2]
    assert start == ("a", 0, pytest.approx(200, abs=3))
    assert closure == (stop, pytest.approx(200, abs=3), 280)


def test_only_a_stop_has_a_closure() -> None:
    sound = sound_of((BRIGHT, 200), (QUIET, 50), (BRIGHT, 150))
    assert told(sound, (0, "a"), (250, "s"), (320, "a")) == [("a", 0, 250), ("s", 250, 320), ("a", 320, 400)]


def test_a_voiced_stop_that_hums_stays() -> None:
    sound = sound_of((BRIGHT, 200), (DARK, 50), (BRIGHT, 150))
    assert told(sound, (0, "a"), (200, "b"), (250, "a")) == [("a", 0, 200), ("b", 200, 250), ("a", 250, 400)]


def test_a_closure_has_an_end() -> None:
    sound = sound_of((BRIGHT, 300), (QUIET, 300), (BRIGHT, 200))
    (_, _, ends), (_, starts, _), _ = told(sound, (0, "s"), (600, "p"), (630, "a"))
    assert ends == starts == pytest.approx(600 - 1e3 * MAX_CLOSURE_S, abs=1)


def test_after_a_pause_the_lips_close_before_the_burst() -> None:
    sound = sound_of((BRIGHT, 200), (QUIET, 300), (BRIGHT, 200))
    assert told(sound, (0, "a"), (200, ""), (500, "p"), (530, "a")) == [
        ("a", 0, 200), (SILENCE, 200, 440), ("p", 440, 530), ("a", 530, 700)
    ]  # fmt: skip


@pytest.mark.parametrize(("consonant", "ends_ms"), [("m", 180), ("n", 180), ("l", 190), ("ɹ", 190), ("z", 210)])
def test_a_vowel_begins_where_the_sound_gets_bright(consonant: str, ends_ms: int) -> None:
    """A nasal ends there; a liquid goes over into its vowel, so its mark gives way by 20 ms at most; others stay."""
    sound = sound_of((BRIGHT, 100), (DARK, 80), (BRIGHT, 220))
    (_, vowel) = told(sound, (0, "a"), (100, consonant), (210, "a"))[1:]
    assert vowel == ("a", pytest.approx(ends_ms, abs=6), 400)


def test_without_brightness_the_mark_stays() -> None:
    sound = sound_of((DARK, 400))
    assert told(sound, (0, "a"), (100, "m"), (210, "u"))[2] == ("u", 210, 400)


def test_a_loud_event_without_a_name_is_no_pause() -> None:
    sound = sound_of((BRIGHT, 400))
    assert told(sound, (0, "a"), (150, ""), (200, "r")) == [("a", 0, 200), ("r", 200, 400)]
    assert told(sound, (0, ""), (100, "a")) == [("a", 0, 400)]


def test_a_quiet_event_without_a_name_is_a_pause_where_it_is_quiet() -> None:
    sound = sound_of((BRIGHT, 100), (QUIET, 150), (BRIGHT, 250))
    assert told(sound, (0, "a"), (80, ""), (300, "s")) == [("a", 0, 100), (SILENCE, 100, 250), ("s", 250, 500)]


def test_a_short_quiet_before_a_stop_is_its_closure() -> None:
    sound = sound_of((BRIGHT, 100), (QUIET, 40), (BRIGHT, 260))
    assert told(sound, (0, "n"), (100, ""), (140, "t")) == [("n", 0, 100), ("t", 100, 400)]
    assert told(sound, (0, "n"), (100, ""), (140, "s"))[1] == (SILENCE, 100, 140)


def test_silence_at_both_ends_is_silence() -> None:
    sound = sound_of((QUIET, 12), (BRIGHT, 200), (QUIET, 8))
    assert told(sound, (12, "a"), (212, "")) == [(SILENCE, 0, 12), ("a", 12, 212), (SILENCE, 212, 220)]


def test_a_stop_without_time_takes_the_quiet_behind_it() -> None:
    sound = sound_of((BRIGHT, 200), (QUIET, 40), (DARK, 160))
    assert told(sound, (0, "a"), (200, "p"), (200, ""), (240, "m")) == [("a", 0, 200), ("p", 200, 240), ("m", 240, 400)]
    long = sound_of((BRIGHT, 200), (QUIET, 300))
    assert told(long, (0, "a"), (200, "p"), (200, "")) == [("a", 0, 200), ("p", 200, 290), (SILENCE, 290, 500)]


def test_another_phone_without_time_gets_a_share() -> None:
    sound = sound_of((BRIGHT, 400))
    assert told(sound, (0, "a"), (300, "l"), (300, "s")) == [("a", 0, 200), ("l", 200, 300), ("s", 300, 400)]
    assert told(sound, (0, "s"), (100, "w"), (100, "j"), (100, "a")) == [
        ("s", 0, 100), ("w", 100, 175), ("j", 175, 250), ("a", 250, 400)
    ]  # fmt: skip


def test_what_adds_to_a_phone_joins_it() -> None:
    sound = sound_of((BRIGHT, 400))
    assert told(sound, (0, "d"), (50, "ʲ"), (80, "i"), (200, "s"), (300, "ː")) == [
        ("dʲ", 0, 50), ("i", 50, 200), ("sː", 200, 400)
    ]  # fmt: skip


def test_marks_in_disorder_or_outside_lose_nothing() -> None:
    sound = sound_of((BRIGHT, 400))
    assert [label for label, _, _ in told(sound, (0, "a"), (200, "s"), (190, "i"), (600, "f"))] == ["a", "s", "i", "f"]


def test_stress_and_words_are_kept() -> None:
    phones = sounding([Mark(0.0, "a", 1, "ah"), Mark(0.2, "", 0, "ah")], sound_of((BRIGHT, 200), (QUIET, 200)))
    assert [(phone.stress, phone.word) for phone in phones] == [(1, "ah"), (0, "")]


def test_a_sound_of_nothing() -> None:
    assert sounding([Mark(0.0, "a")], SoundLevel(np.zeros(0), RATE_HZ)) == []
    assert told(sound_of((QUIET, 100))) == [(SILENCE, 0, 100)]
    assert told(sound_of((BRIGHT, 100))) == [(SILENCE, 0, 100)]


def test_refuses() -> None:
    with pytest.raises(UsageError, match="rate_hz: must be a positive number, got 0"):
        SoundLevel(np.zeros(4), 0)
    with pytest.raises(UsageError, match="samples"):
        SoundLevel(np.zeros((4, 2)), RATE_HZ)
