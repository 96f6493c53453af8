"""Words to phones within the words' times."""

from itertools import groupby

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.pronounce import MAX_WORDS, Pronouncer, pronounce
from fapengine.voices.protocol import Speech


class Parrot:
    """Speaks each letter for as many tenths of a second as its place, with silence around."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def speak(self, text: str) -> Speech:
        self.asked.append(text)
        if not text.replace(" ", "").isascii():
            raise UsageError("nothing to speak")
        phones, now_s = [Phone(SILENCE, 0.0, 0.3)], 0.3
        for place, letter in enumerate(text.replace(" ", ""), start=1):
            phones.append(Phone(letter, now_s, now_s + place / 10, 1))
            now_s = phones[-1].end_s
        return Speech(
            samples=np.zeros(1000, np.int16),
            sample_rate_hz=1000,
            phones=PhoneTrack.from_phones(phones, tolerance_s=0.0),
        )


class Reader:
    """Speaks only what it was told how to; phones last 0.1 s."""

    def __init__(self, **spellings: str) -> None:
        self.spellings = {text.replace("_", " "): phones.split() for text, phones in spellings.items()}

    def speak(self, text: str) -> Speech:
        if text not in self.spellings:
            raise UsageError("nothing to speak")
        phones = [Phone(label, index / 10, (index + 1) / 10) for index, label in enumerate(self.spellings[text])]
        return Speech(samples=np.zeros(1000, np.int16), sample_rate_hz=1000, phones=PhoneTrack.from_phones(phones))


def spelled(*words: str) -> PhoneTrack:
    """Words of a second each."""
    return PhoneTrack(tuple(Phone(word, i, i + 1.0, word=word) for i, word in enumerate(words)), "word", True)


def heard(track: PhoneTrack) -> list[tuple[str, str]]:
    return [(phone.label, phone.word) for phone in track.phones]


def test_phones_fill_the_time_of_their_word() -> None:
    words = [Phone("ma", 0.5, 1.1, word="ma"), Phone("%", 1.1, 1.5, word="%"), Phone("ma", 1.5, 1.8, word="ma")]
    parrot = Parrot()
    track = pronounce(PhoneTrack.from_phones(words, level="word", spelled=True), parrot)
    assert heard(track) == [(SILENCE, ""), ("m", "ma"), ("a", "ma"), (SILENCE, ""), ("m", "ma"), ("a", "ma")]
    assert [track.phones[index].start_s for index in (1, 3, 4)] == [0.5, 1.1, 1.5]
    assert track.phones[-1].end_s == 1.8
    assert (track.level, track.spelled) == ("word", False)
    assert track.phones[1].stress == 1
    assert parrot.asked == ["ma", "ma ma"]


def test_vowels_are_stretched_more_than_consonants() -> None:
    short, long = (
        [phone.duration_s for phone in pronounce(track, Parrot()).phones]
        for track in (
            PhoneTrack((Phone("ma", 0.0, 0.2),), "word", True),
            PhoneTrack((Phone("ma", 0.0, 0.8),), "word", True),
        )
    )
    assert long[1] / short[1] > 4 > long[0] / short[0] > 3
    assert sum(long) == pytest.approx(0.8)


def test_words_are_spoken_together() -> None:
    voice = Reader(a="eɪ", cup="k ʌ p", of="ʌ v", tea="t iː", a_cup_of_tea="ə k ʌ p ə t iː")
    assert heard(pronounce(spelled("a", "cup", "of", "tea"), voice)) == [
        ("ə", "a"), ("k", "cup"), ("ʌ", "cup"), ("p", "cup"), ("ə", "of"), ("t", "tea"), ("iː", "tea")
    ]  # fmt: skip


def test_a_word_that_is_not_heard_in_the_phrase_is_spoken_alone() -> None:
    voice = Reader(le="l ə", ami="a m i", le_ami="a m i")
    assert heard(pronounce(spelled("le", "ami"), voice))[:2] == [("l", "le"), ("ə", "le")]


def test_silences_end_a_phrase() -> None:
    track = PhoneTrack.from_phones(
        [Phone("a", 0.0, 0.2), Phone("b", 0.2, 0.4), Phone("c", 0.6, 0.8)], level="word", spelled=True
    )
    parrot = Parrot()
    pronounce(track, parrot)
    assert parrot.asked == ["a", "b", "a b", "c"]


def test_long_phrases_are_taken_in_portions() -> None:
    parrot = Parrot()
    track = pronounce(spelled(*(["ma"] * (2 * MAX_WORDS + 1))), parrot)
    assert len(track.phones) == 2 * (2 * MAX_WORDS + 1)
    assert max(len(text.split()) for text in parrot.asked) == MAX_WORDS


def test_signs_are_silent_and_hums_are_hummed() -> None:
    track = pronounce(spelled("ma", "😀", "—", "Hm", "mmm", "日本"), Parrot())
    assert heard(track) == [
        ("m", "ma"),
        ("a", "ma"),
        (SILENCE, ""),
        ("h", "Hm"),
        ("m", "Hm"),
        ("m", "mmm"),
        ("日本", "日本"),
    ]


@pytest.mark.parametrize(
    ("voice", "words", "expected"),
    [
        ("en-us", "give me a cup", ("a", "ɐ")),
        ("en-us", "go to the house", ("to", "tə")),
        ("ru", "в лесу", ("в", "v")),
        ("el", "ο σκύλος", ("ο", "o")),
    ],
)
def test_little_words_are_no_letters(voice: str, words: str, expected: tuple[str, str]) -> None:
    track = pronounce(spelled(*words.split()), EspeakVoice(voice))
    assert "".join(phone.label for phone in track.phones if phone.word == expected[0]) == expected[1]


@pytest.mark.parametrize(
    ("voice", "text"),
    [
        ("en-us", "the quick brown fox jumps over a lazy dog and runs to the house of my father"),
        ("de", "der schnelle braune Fuchs springt über den faulen Hund und läuft nach Hause"),
        ("fr", "le renard brun saute par dessus le chien paresseux et rentre dans la maison"),
        ("es", "el zorro marrón salta sobre el perro perezoso y corre a la casa de mi padre"),
        ("it", "la volpe marrone salta sopra il cane pigro e corre verso la casa di mio padre"),
        ("pt", "a raposa marrom salta sobre o cachorro preguiçoso e corre para casa"),
        ("ru", "быстрая лиса прыгает через ленивую собаку и бежит в дом моего отца"),
        ("tr", "hızlı kahverengi tilki tembel köpeğin üstünden atlar ve eve koşar"),
    ],
)
def test_near_the_running_speech_of_the_voice_itself(voice: str, text: str) -> None:
    phones = EspeakVoice(voice).speak(text).phones.phones
    groups = [tuple(group) for _, group in groupby(phones, key=lambda phone: phone.word)]
    words = [Phone(g[0].word or SILENCE, g[0].start_s, g[-1].end_s, word=g[0].word) for g in groups]
    ours = pronounce(PhoneTrack(tuple(words), "word", True), EspeakVoice(voice)).phones
    fitted = [tuple(group) for _, group in groupby(ours, key=lambda phone: phone.word)]
    errors_s = [
        abs(one.end_s - other.end_s)
        for theirs, mine in zip(groups, fitted, strict=True)
        if len(theirs) == len(mine)
        for one, other in zip(theirs[:-1], mine[:-1], strict=True)
    ]
    assert len(errors_s) >= 20
    assert np.mean(errors_s) <= 0.019  # the worst of 11 languages when each word was spoken alone


def test_a_track_of_phones_stays() -> None:
    track = PhoneTrack((Phone("m", 0.0, 1.0),))
    assert pronounce(track, Parrot()) is track


@pytest.mark.parametrize("length_s", [1e-6, 1e-3, 86_000.0])
def test_words_of_any_length(length_s: float) -> None:
    track = pronounce(PhoneTrack((Phone("mama", 0.0, length_s),), "word", True), Parrot())
    assert track.duration_s == pytest.approx(length_s)


def test_what_was_spoken_before_changes_nothing_and_is_not_asked_again() -> None:
    parrot = Parrot()
    pronouncer = Pronouncer(parrot)
    first = pronouncer.words([("ma", 0.0, 0.5), ("mo", 0.5, 1.0)])
    pronouncer.words([("hm", 1.0, 1.5), ("li", 1.5, 2.0), ("%", 2.0, 2.2)])
    assert parrot.asked == ["ma", "mo", "ma mo", "li"]
    assert pronouncer.words([("ma", 0.0, 0.5), ("mo", 0.5, 1.0)]) == first
    assert parrot.asked[4:] == ["ma mo"]
    voice = EspeakVoice("en-us")
    words = [("read", 0.0, 0.3), ("a", 0.3, 0.4), ("book", 0.4, 0.8)]
    used = Pronouncer(voice)
    used.words([("a", 0.0, 0.2), ("read", 0.2, 0.5), ("of", 0.5, 0.6), ("book", 0.6, 1.0)])
    again, fresh = used.words(words), Pronouncer(voice).words(words)
    assert [(phone.label, phone.word) for phone in again] == [(phone.label, phone.word) for phone in fresh]
    ends_s = [[phone.end_s for phone in phones] for phones in (again, fresh)]
    np.testing.assert_allclose(ends_s[0], ends_s[1], atol=1e-3)  # espeak-ng's own lengths vary by some µs


def test_memory_of_words_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fapengine.voices.pronounce.MAX_KNOWN_WORDS", 3)
    parrot = Parrot()
    pronouncer = Pronouncer(parrot)
    for word in ("ba", "da", "ga", "la", "ba"):
        pronouncer.words([(word, 0.0, 0.5)])
    assert parrot.asked == ["ba", "da", "ga", "la", "ba"]
