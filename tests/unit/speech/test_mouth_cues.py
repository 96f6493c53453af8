"""Rhubarb's mouth shapes: from phones, from frames, and as its files."""

import json
import math
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.formats.rhubarb import (
    CONTACTS,
    ENDINGS,
    MIN_CUE_CS,
    SHAPES,
    MouthCue,
    cues_of_frames,
    cues_of_phones,
    format_rhubarb,
    shape_of,
)
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

PHONES = st.lists(
    st.tuples(st.sampled_from([*sorted(ipa.SOUNDS), "aɪ", "t͡ʃ", SILENCE, "%%"]), st.floats(0.011, 0.4)), min_size=1
)


def track(*spoken: tuple[str, float]) -> PhoneTrack:
    phones, now_s = [], 0.0
    for label, length_s in spoken:
        phones.append(Phone(label, now_s, now_s + length_s))
        now_s += length_s
    return PhoneTrack.from_phones(phones)


def brief(cues: tuple[MouthCue, ...]) -> list[tuple[str, int]]:
    return [(cue.shape, cue.start_cs) for cue in cues]


def test_words_that_the_documentation_gives_as_examples() -> None:
    """Rhubarb's README, "Mouth shapes": P B M, K S T and EE, EH AE, AA, AO ER, UW OW W, F V, long L."""
    letters = {"p": "A", "b": "A", "m": "A", "k": "B", "s": "B", "t": "B", "i": "B", "ɛ": "C", "æ": "C", "ɑ": "D"}
    letters |= {"ɔ": "E", "ɝ": "E", "u": "F", "w": "F", "f": "G", "v": "G"}
    assert {letter: shape_of(letter, 0.05) for letter in letters} == letters
    assert (shape_of("l", 0.2), shape_of("l", 0.05)) == ("H", "B")


def test_a_sentence_becomes_cues() -> None:
    cues = cues_of_phones(track((SILENCE, 0.3), ("m", 0.1), ("aɪ", 0.2), ("h", 0.06), ("u", 0.2)), duration_s=1.2)
    assert brief(cues) == [("X", 0), ("A", 30), ("D", 40), ("B", 52), ("F", 60), ("X", 86)]
    assert cues[-1].end_cs == 120


def test_short_contacts_are_lengthened_and_other_short_shapes_go() -> None:
    cues = cues_of_phones(track(("ɑ", 0.2), ("p", 0.02), ("i", 0.1), ("ɛ", 0.02), ("u", 0.2)))
    assert brief(cues) == [("D", 0), ("A", 20), ("B", 25), ("F", 32)]


@given(PHONES)
def test_cues_lie_without_gaps_and_every_contact_stays(spoken: list[tuple[str, float]]) -> None:
    phones = track(*spoken)
    cues = cues_of_phones(phones)
    assert cues[0].start_cs == 0
    assert cues[-1].end_cs == round(100 * phones.duration_s)
    for one, other in pairwise(cues):
        assert one.end_cs == other.start_cs
        assert one.shape != other.shape
    assert {cue.shape for cue in cues} <= set(SHAPES)
    if len(cues) > 1:
        assert min((cue.length_cs for cue in cues if cue.shape not in CONTACTS), default=99) >= MIN_CUE_CS
    for phone in phones.phones:  # a closure of 2 cs and more is on the grid
        if phone.label in "pbm" and phone.duration_s >= 0.02:
            near = [cue for cue in cues if cue.start_cs <= 100 * phone.end_s and cue.end_cs >= 100 * phone.start_s]
            assert any(cue.shape == "A" for cue in near)


@given(PHONES, st.sampled_from([".json", ".tsv", ".xml"]))
def test_our_own_reader_reads_what_is_written(spoken: list[tuple[str, float]], ending: str) -> None:
    cues = cues_of_phones(track(*spoken))
    read = parse_timings(format_rhubarb(cues, ending, sound_file='/a "b"/ü&.wav'))
    table = {"A": "p", "B": "s", "C": "ɛ", "D": "ɑ", "E": "ɔ", "F": "u", "G": "f", "H": "l", "X": SILENCE}
    assert read.level == "viseme"
    assert [(phone.label, round(100 * phone.start_s)) for phone in read.phones] == [
        (table[shape], start_cs) for shape, start_cs in brief(cues)
    ]
    assert math.isclose(read.duration_s, cues[-1].end_cs / 100)


def test_what_is_read_and_written_again_is_the_same() -> None:
    cues = cues_of_phones(track(("m", 0.1), ("ɑ", 0.3), ("v", 0.1), ("l", 0.2), ("u", 0.2), (SILENCE, 0.3)))
    once = format_rhubarb(cues, ".json")
    assert format_rhubarb(cues_of_phones(parse_timings(once)), ".json") == once


CUES = (MouthCue("X", 0, 5), MouthCue("D", 5, 27), MouthCue("A", 27, 47))


def test_files_are_spelled_as_rhubarb_spells_them() -> None:
    """Layout of the files in Rhubarb's README, section "Output formats"."""
    assert format_rhubarb(CUES, ".tsv") == b"0.00\tX\n0.05\tD\n0.27\tA\n0.47\tX\n"
    assert format_rhubarb(CUES, ".dat") == b"MohoSwitch1\n1 X\n2 D\n7 A\n12 X\n"
    text = format_rhubarb(CUES, ".json", sound_file="/in/hi.wav").decode()
    assert json.loads(text)["metadata"] == {"soundFile": "/in/hi.wav", "duration": 0.47}
    assert '    { "start": 0.05, "end": 0.27, "value": "D" },\n' in text
    root = ElementTree.fromstring(format_rhubarb(CUES, ".xml", sound_file="/in/<hi>.wav"))
    assert [child.tag for child in root] == ["metadata", "mouthCues"]
    assert root.findtext("metadata/soundFile") == "/in/<hi>.wav"
    assert root.findtext("metadata/duration") == "0.47"
    assert root.find("mouthCues/mouthCue[2]").attrib == {"start": "0.05", "end": "0.27"}  # type: ignore[union-attr]


def test_frames_become_cues() -> None:
    assert brief(cues_of_frames("XXXXXXAAADDDDDD", 30.0)) == [("X", 0), ("A", 20), ("D", 30)]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cues_of_phones(PhoneTrack((Phone("hello", 0, 1),), "word", spelled=True)), "spelled words"),
        (lambda: cues_of_phones(PhoneTrack(())), "at least 0.01 s"),
        (lambda: cues_of_frames([], 30.0), "at least 0.01 s"),
        (lambda: format_rhubarb(CUES, ".csv"), "expected a name that ends with"),
        (lambda: format_rhubarb((), ENDINGS[0]), "empty; needs at least one"),
    ],
)
def test_what_cannot_be_is_refused(make: object, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make()  # type: ignore[operator]


def test_a_contact_takes_from_the_shape_before_where_the_next_has_nothing_to_spare() -> None:
    cues = cues_of_phones(track(("ɑ", 0.2), ("p", 0.02), ("i", 0.05), ("u", 0.2)))
    assert brief(cues) == [("D", 0), ("A", 17), ("B", 22), ("F", 27)]


def test_a_phone_of_two_letters_gives_each_half_of_its_time() -> None:
    """A long l has a shape of its own: an l that has as much of its phone."""
    shapes = [brief(cues_of_phones(track(("l", own_s), ("ɑ", 0.2))))[0][0] for own_s in (0.07, 0.2)]
    halves = [brief(cues_of_phones(track(("əl", 2 * own_s), ("ɑ", 0.2))))[1][0] for own_s in (0.07, 0.2)]
    assert shapes == ["B", "H"]
    assert halves == ["D", "H"]  # the first is the shape before it, too: one cue
