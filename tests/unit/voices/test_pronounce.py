"""Words to phones within the words' times."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.pronounce import pronounce
from fapengine.voices.protocol import Speech


class Parrot:
    """Speaks each letter for as many tenths of a second as its place, with silence around."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def speak(self, text: str) -> Speech:
        self.asked.append(text)
        if not text.isalpha():
            raise UsageError("nothing to speak")
        phones, now_s = [Phone(SILENCE, 0.0, 0.3)], 0.3
        for place, letter in enumerate(text, start=1):
            phones.append(Phone(letter, now_s, now_s + place / 10, 1))
            now_s = phones[-1].end_s
        return Speech(samples=np.zeros(10, np.int16), sample_rate_hz=10, phones=PhoneTrack.of(phones, tolerance_s=0.0))


def test_phones_fill_the_time_of_their_word() -> None:
    words = [Phone("ma", 0.5, 1.1, word="ma"), Phone("%", 1.1, 1.5, word="%"), Phone("ma", 1.5, 1.8, word="ma")]
    parrot = Parrot()
    track = pronounce(PhoneTrack.of(words, level="word", spelled=True), parrot)
    told = [(phone.label, round(phone.start_s, 9), round(phone.end_s, 9), phone.word) for phone in track.phones]
    assert told == [
        (SILENCE, 0.0, 0.5, ""), ("m", 0.5, 0.7, "ma"), ("a", 0.7, 1.1, "ma"), ("%", 1.1, 1.5, "%"),
        ("m", 1.5, 1.6, "ma"), ("a", 1.6, 1.8, "ma"),
    ]  # fmt: skip
    assert (track.level, track.spelled) == ("word", False)
    assert track.phones[1].stress == 1
    assert parrot.asked == ["ma", "%"]


def test_a_track_of_phones_stays() -> None:
    track = PhoneTrack((Phone("m", 0.0, 1.0),))
    assert pronounce(track, Parrot()) is track


@pytest.mark.parametrize("length_s", [1e-6, 1e-3, 86_000.0])
def test_words_of_any_length(length_s: float) -> None:
    track = pronounce(PhoneTrack((Phone("mama", 0.0, length_s),), "word", True), Parrot())
    assert track.duration_s == pytest.approx(length_s)
