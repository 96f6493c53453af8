"""Names of espeak-ng's phone events as IPA."""

import pytest

from fapengine.speech import ipa
from fapengine.voices.espeak import read_label

CASES = {
    "ˈaɪ": ("aɪ", 1), "ˌə": ("ə", 2), "": ("", 0), "_:": ("", 0), "h": ("h", 0), "aː": ("aː", 0), "ɔ̃": ("ɔ̃", 0),
    "ˌʲ": ("ʲ", 2), "̃": ("̃", 0), "ː": ("ː", 0),
    "s.": ("ʂ", 0), "ˈi.": ("ɨ", 1), "ts.h": ("ʈʂʰ", 0), "o-": ("ɤ", 0), "th": ("tʰ", 0), "tɕh": ("tɕʰ", 0),
    "ə-": ("ə", 0), "e-": ("e", 0), "ˈ?a": ("ʔa", 1), "ˈε": ("ɛ", 1), "A": ("ɑ", 0), "X": ("χ", 0), "Φ": ("ɸ", 0),
    "t[": ("t̪", 0), "tS": ("tʃ", 0), "dZ": ("dʒ", 0), "S": ("ʃ", 0), "N": ("ŋ", 0), "l-": ("ɫ", 0), "r.": ("ɽ", 0),
    "r#": ("r̥", 0), "tl#": ("tl̥", 0), "n^": ("ɲ", 0),
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), CASES.items())
def test_names(name: str, expected: tuple[str, int]) -> None:
    assert read_label(name.encode().ljust(8, b"\0")) == expected


def test_a_change_of_language_is_no_phone() -> None:
    assert read_label(b"(en)\0\0\0\0") is None


def test_a_name_that_was_cut_keeps_its_nasality() -> None:
    assert read_label("ˈɐ̃ʊ̃".encode()[:8]) == ("ɐ̃ʊ̃", 1)
    assert read_label("ɐ̃ʊ̃".encode()) == ("ɐ̃ʊ̃", 0)


def test_what_nobody_knows_stays() -> None:
    label, _ = read_label("§".encode()) or ("", 0)
    assert label == "§"
    assert not ipa.letters(label)
