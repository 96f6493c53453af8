"""Names of espeak-ng's phone events as IPA."""

import pytest

from fapengine.speech import ipa
from fapengine.voices.espeak_labels import in_context, read_label
from fapengine.voices.sounding import Mark

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
    assert read_label(name.encode().ljust(8, b"\0"), "de") == expected


def test_a_change_of_language_is_no_phone() -> None:
    assert read_label(b"(en)\0\0\0\0", "ru") is None


def test_a_name_that_was_cut_keeps_its_nasality() -> None:
    assert read_label("ˈɐ̃ʊ̃".encode()[:8], "pt") == ("ɐ̃ʊ̃", 1)
    assert read_label("ɐ̃ʊ̃".encode(), "pt") == ("ɐ̃ʊ̃", 0)


def test_what_nobody_knows_stays() -> None:
    label, _ = read_label("§".encode(), "de") or ("", 0)
    assert label == "§"
    assert not ipa.letters(label)


@pytest.mark.parametrize(
    ("code", "name", "label"),
    [
        ("pt-br", "y", "i"), ("pt-br", "ɐ̃y", "ɐ̃i"), ("ru", "y", "ɨ"), ("ru-lv", "y", "ɨ"), ("ru-cl", 'u"', "ʉ"),
        ("vi-vn-x-south", "yə", "ɯə"), ("tr", "ø", "y"), ("fr-fr", "y", "y"), ("fr-fr", "ø", "ø"), ("en", "ɹ", "ɹ"),
        ("hy", "ɹ", "ɾ"), ("ky", "oe", "ø"), ("uz", "y", "ɨ"), ("gn", "y", "ɨ"), ("mi", 'u"ː', "ʉː"),
        ("shn", "k_h", "kʰ"),
        ("da", "?ɑ", "ʔɑ"), ("yue", "hoenɡ", "hœːŋ"), ("yue-latn-jyutping", "eoi", "ɵy"), ("cmn", "onɡ", "oŋ"),
    ],
)  # fmt: skip
def test_names_mean_what_they_do_in_their_language(code: str, name: str, label: str) -> None:
    assert read_label(name.encode(), code) == (label, 0)


def test_a_name_that_is_part_of_another_is_no_phone() -> None:
    assert read_label(b"1", "fa") is None


@pytest.mark.parametrize(
    ("labels", "expected"),
    [("ũ b", "m b"), ("ũ k", "ŋ k"), ("ũ t", "n t"), ("ũ w", "ɴ w"), ("ɴ p", "m p"), ("h p", "p p"), ("h a", "h a")],
)
def test_japanese_labels_follow_the_next_phone(labels: str, expected: str) -> None:
    marks = [Mark(0.1 * index, label) for index, label in enumerate(labels.split())]
    assert " ".join(mark.label for mark in in_context(marks, "ja")) == expected
    assert in_context(marks, "pt") == marks
