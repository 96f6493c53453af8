"""Remarks on timings that look wrong."""

import numpy as np
import pytest

from fapengine.errors import DataError
from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.phone_track import Phone, PhoneTrack, Reading
from fapengine.speech.plausible import dropped_remarks, refuse, remarks_on, script_remarks, sound_remarks
from fapengine.speech.text.words import spelled_remarks

FILE = Reading("ipa")


def evenly(length_s: float, count: int = 8, reading: Reading = FILE) -> PhoneTrack:
    phones = [Phone("ma"[n % 2], n * length_s, (n + 1) * length_s) for n in range(count)]
    return PhoneTrack.from_phones(phones, reading=reading)


@pytest.mark.parametrize(
    ("length_s", "said"),
    [
        (0.08, ()),
        (0.02, ()),
        (0.4, ()),
        (80.0, ("the median of 8 phones is 8e+04 ms", "columns='unit=ms' would make it 80 ms")),
        (8e-5, ("is 0.08 ms, expected 20 to 400 ms", "columns='unit=s' would make it 80 ms")),
        (0.01, ("is 10 ms, expected 20 to 400 ms", "is the unit right?")),
        (0.9, ("is 900 ms, expected 20 to 400 ms",)),
    ],
)
def test_the_median_phone_lasts_20_to_400_ms(length_s: float, said: tuple[str, ...]) -> None:
    remarks = remarks_on(evenly(length_s))
    assert len(remarks) == (1 if said else 0)
    assert all(part in remarks[0] for part in said)
    assert "columns=" not in "".join(remarks_on(evenly(length_s, reading=Reading())))  # which only a file has


def test_a_few_phones_say_nothing_about_the_unit() -> None:
    assert remarks_on(evenly(0.9, count=4)) == ()


def test_rows_without_length_are_counted_and_the_first_is_named() -> None:
    track = parse_timings(b"label,start,end\nm,0.0,0.1\naa,0.1,0.1\nb,0.1,0.3\nsil,0.3,0.3\niy,0.3,0.3\n")
    assert [phone.label for phone in track.phones] == ["m", "b"]
    assert any("2 rows were dropped" in remark and "'aa' at 0.100 s (row 2)" in remark for remark in remarks_on(track))
    assert dropped_remarks([]) == ()


def test_unknown_labels_and_rival_alphabets_are_remarks() -> None:
    track = PhoneTrack.from_phones([Phone("AA1", 0, 0.2), Phone("B", 0.2, 0.4), Phone("m", 0.4, 0.6)])
    assert remarks_on(track) == tuple(f"unknown phone '{label}' once, first at {at}00 s; /ə/ is used instead"
                                      for label, at in (("AA1", "0.0"), ("B", "0.2")))  # fmt: skip
    rivals = parse_timings(b"0 1000000 m\n1000000 2000000 ao\n2000000 3000000 t\n", ending=".lab")
    assert "ipa and pinyin would fit as well; alphabet=NAME" in remarks_on(rivals)[0]


def test_words_in_a_script_that_the_voice_does_not_read() -> None:
    words = [Phone("hello", 0, 1), Phone("there", 1, 2), Phone("мир", 2, 3)]
    (remark,) = script_remarks(words, "en-us", is_chosen=False)
    assert "'en-us' does not read Cyrillic: 'мир' at 2.000 s; voice=CODE names one that does" in remark
    assert script_remarks(words, "ru", is_chosen=False) == ()
    with pytest.raises(DataError, match=r"does not read Cyrillic: 'мир' at 2\.000 s"):
        script_remarks(words[1:], "en-us", is_chosen=False)
    with pytest.raises(DataError, match=r"'мир' at 2\.000 s and 3 more"):
        script_remarks([*words, *words[2:] * 3], "en-us", is_chosen=False)
    assert len(script_remarks(words[1:], "en-us", is_chosen=True)) == 1


def test_remarks_are_refused_together() -> None:
    refuse((), "a.lab")
    with pytest.raises(DataError, match=r"one; two \(at a\.lab\)"):
        refuse(("one", "two"), "a.lab")


@pytest.mark.parametrize(
    ("spoken_s", "sound_s", "remark"),
    [(0.4, 5.2, ""), (0.4, 5.6, "it lasts 5.60 s"), (4.0, 11.8, ""), (4.0, 12.2, "it lasts 12.20 s"),
     (4.0, 3.8, ""), (4.0, 3.6, "it ends at 3.60 s")],
)  # fmt: skip
def test_sound_of_another_length_than_its_phones_is_remarked(spoken_s: float, sound_s: float, remark: str) -> None:
    track = PhoneTrack.from_phones([Phone("a", 0.0, spoken_s)])
    remarks = sound_remarks((np.full(round(sound_s * 1000), 3000, np.int16), 1000), track)
    assert [remark in each for each in remarks] == [True] * bool(remark)


def test_words_that_are_spelled_are_told_with_their_place() -> None:
    (remark,) = spelled_remarks([("HTML", 4)])
    assert remark.startswith("text: 'HTML' (letter 5) spoken letter by letter")
