"""Phones as files of other tools: what is written comes back."""

import pytest

from fapengine.errors import UsageError
from fapengine.speech.alphabets.convert import from_xsampa
from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.formats.writing import WRITERS, check_writable, format_ctm, to_xsampa
from fapengine.speech.ipa import SOUNDS
from fapengine.speech.phone_track import Phone, PhoneTrack

TRACK = PhoneTrack(
    (
        Phone("_", 0.0, 0.1), Phone("b", 0.1, 0.17, 0, 'say "b"', 0.8), Phone("aɪ", 0.17, 0.3, 1, 'say "b"'),
        Phone("tʃ", 0.3, 0.41, 0, "x"), Phone("ɑː", 0.41, 0.6, 2, "x"), Phone("_", 0.6, 0.75),
    )
)  # fmt: skip


@pytest.mark.parametrize("ending", [".textgrid", ".json", ".pho"])
def test_what_is_written_comes_back(ending: str) -> None:
    back = parse_timings(WRITERS[ending](TRACK), ending=ending)
    assert [phone.label for phone in back.phones] == [phone.label for phone in TRACK.phones]
    for found, phone in zip(back.phones, TRACK.phones, strict=True):
        assert (found.start_s, found.end_s) == pytest.approx((phone.start_s, phone.end_s), abs=1e-3)
    if ending != ".pho":
        assert [phone.stress for phone in back.phones] == [phone.stress for phone in TRACK.phones]
        assert [phone.word for phone in back.phones] == [phone.word for phone in TRACK.phones]


def test_ctm_has_start_and_duration() -> None:
    lines = format_ctm(TRACK).decode().splitlines()
    assert lines[:2] == ["sound 1 0.100 0.070 b 0.80", "sound 1 0.170 0.130 aɪ 1.00"]
    assert len(lines) == 4  # silence is left out


def test_every_ipa_letter_has_a_spelling() -> None:
    for letter in SOUNDS:
        back = from_xsampa(to_xsampa(letter))
        assert back == letter or letter == "ⱱ", letter  # X-SAMPA has none


def test_names_of_other_kinds_are_refused() -> None:
    check_writable(".TextGrid")
    with pytest.raises(UsageError, match=r"'\.srt', expected one of \.TextGrid"):
        check_writable(".srt")
