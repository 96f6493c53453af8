"""Visemes with their times, in the sets of other programs."""

import json
from itertools import pairwise

import pytest

import fapengine
from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.formats.registry import ParseOptions, parse_timings
from fapengine.speech.formats.visemes import VISEME_SETS, format_visemes, viseme_of, visemes_of_phones
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack, is_bilabial, is_labiodental

LABELS = [SILENCE, "m", "aʊ", "h", "u", "tʃ", "f", "QQ", SILENCE]
PHONES = PhoneTrack.from_phones([Phone(label, 0.1 * n, 0.1 * n + 0.1) for n, label in enumerate(LABELS)])


@pytest.mark.parametrize(
    ("shapes", "names"),
    [
        ("mpeg4", "0 1 10 14 6 2 11 0"),
        ("oculus", "sil PP aa ou CH FF E sil"),
        ("azure", "0 21 9 12 7 16 18 1 0"),
        ("rhubarb", "X A D F B G B X"),
    ],
)
def test_phones_in_every_set(shapes: str, names: str) -> None:
    rows = fapengine.visemes(PHONES, shapes)
    assert " ".join(name for name, _, _ in rows) == names
    assert rows[0][1] == 0.0
    assert rows[-1][2] == pytest.approx(0.9)
    assert all(one[2] == other[1] for one, other in pairwise(rows))


@pytest.mark.parametrize("shapes", ["mpeg4", "oculus", "azure", "rhubarb"])
def test_visemes_begin_at_0_where_phones_begin_later(shapes: str) -> None:
    rows = fapengine.visemes(PhoneTrack((Phone("m", 0.5, 1.0),)), shapes)
    assert [row[1:] for row in rows] == [(0.0, 0.5), (0.5, 1.0)]


@pytest.mark.parametrize("shapes", VISEME_SETS)
def test_every_letter_has_a_viseme_and_lips_that_close_stay_closed(shapes: str) -> None:
    names = {letter: viseme_of(letter, shapes) for letter in ipa.SOUNDS}
    assert set(names.values()) <= set(VISEME_SETS[shapes])
    assert {names[letter] for letter in "pbm"} == {names["p"]}
    assert names["v"] == names["f"] != names["p"]


@pytest.mark.parametrize("shapes", ["mpeg4", "oculus", "azure"])
@pytest.mark.parametrize("ending", [".json", ".csv", ".tsv"])
def test_our_own_reader_reads_what_is_written(shapes: str, ending: str) -> None:
    rows = visemes_of_phones(PHONES, shapes)
    data = format_visemes(rows, shapes, ending)
    is_events = ending == ".json" and shapes == "azure"
    options = ParseOptions(alphabet=None if is_events else f"{shapes}-visemes")
    read = parse_timings(data, ending=ending, options=options)
    assert [phone.is_silence for phone in read.phones] == [row.name in ("0", "sil") for row in rows]
    assert [phone.start_s for phone in read.phones] == pytest.approx([row.start_s for row in rows])
    if is_events:
        assert json.loads(data)[1] == {"audio_offset": 1_000_000, "viseme_id": 21}


def test_a_motion_shows_nearly_what_its_phones_say() -> None:
    """Lips that close in the phones close in the motion."""
    spoken = fapengine.animate(PhoneTrack.from_phones([Phone("ama"[n], 0.2 * n, 0.2 * n + 0.2) for n in range(3)]))
    for shapes in ("mpeg4", "oculus", "azure", "rhubarb"):
        name, start_s, end_s = next(row for row in spoken.visemes(shapes) if row[1] <= 0.3 < row[2])
        seen = [row for row in fapengine.visemes(spoken.track, shapes) if row[0] == name]
        assert any(row[1] < end_s and row[2] > start_s for row in seen), shapes


def test_what_has_no_visemes_is_refused() -> None:
    with pytest.raises(UsageError, match="shapes: got 'foo', expected one of mpeg4, oculus, azure, rhubarb"):
        fapengine.visemes(PHONES, "foo")
    with pytest.raises(UsageError, match="spelled words"):
        fapengine.visemes(PhoneTrack((Phone("hello", 0.0, 1.0),), "word", spelled=True), "azure")
    with pytest.raises(UsageError, match="source: got"):
        fapengine.visemes([1, 2], "azure")


def test_nothing_said_is_silence() -> None:
    assert [tuple(each) for each in visemes_of_phones(PhoneTrack(()), "oculus", duration_s=1.0)] == [("sil", 0.0, 1.0)]


def test_azure_counts_in_tenths_of_a_microsecond() -> None:
    track = PhoneTrack.from_phones([Phone("m", 0.0, 900.0), Phone("a", 900.0, 1000.0)])
    events = json.loads(format_visemes(visemes_of_phones(track, "azure"), "azure", ".json"))
    assert [event["audio_offset"] for event in events] == [0, 9_000_000_000, 10_000_000_000]


def test_lips_and_teeth_touch_in_phones_of_their_own() -> None:
    assert [is_labiodental(Phone(label, 0.0, 0.1)) for label in "fvm"] == [True, True, False]
    assert [is_bilabial(Phone(label, 0.0, 0.1)) for label in "fvm"] == [False, False, True]


@pytest.mark.parametrize(("ending", "sign"), [(".csv", ","), (".tsv", "\t")])
def test_tables_are_parted_as_their_ending_says(ending: str, sign: str) -> None:
    rows = visemes_of_phones(PHONES, "oculus")
    first, second, *_ = format_visemes(rows, "oculus", ending).decode().splitlines()
    assert first.split(sign) == ["start", "end", "viseme"]
    assert second.split(sign) == ["0.0000", f"{rows[0].end_s:.4f}", rows[0].name]
