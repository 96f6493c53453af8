"""Names of espeak-ng's phone events as IPA, for each language.

Names are meant to be IPA with stress marks, cut at 8 bytes. Where a voice's data name no IPA, the library converts its
own mnemonic character by character: ``s.`` for ʂ, ``ə-`` for a weak e. Some results are letters of IPA that stand for
another sound: ``y`` is the mnemonic of the Russian ы, and ``ø`` (from ``Y``) that of the Turkish ü. So each language
has its own corrections. A word of another language, between ``(en)`` and ``(ru)``, is read with those of its own.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from fapengine.speech import ipa
from fapengine.voices.sounding import Mark, is_addition

NAME_BYTES = 8
"""Length of a name in an event (speak_lib.h); a longer one is cut."""
_LANGUAGE = re.compile(r"\((.*)\)")
"""A change of language, such as (en): no phone."""
_ASPIRATED = re.compile(r"(?<=[ptkqcʈɕʂs])h$")
_NASAL = "\u0303"

# Whole names by voice; espeak-ng 1.52, number texts of all its voices (tests/unit/voices/test_all_voices.py).
_NAMES = {
    "s.": "ʂ", "ts.": "ʈʂ", "ts.h": "ʈʂʰ", "i.": "ɨ", "o-": "ɤ",  # cmn, hak
    "r.": "ɽ", "n^": "ɲ", "t[": "t̪", "d[": "d̪", "l-": "ɫ",  # gu ml or sd; fr; ky
    "r#": "r̥", "l#": "l̥", "tl#": "tl̥",  # is
    "ε": "ɛ", "Φ": "ɸ", "A": "ɑ", "t`": "ʈ", "d`": "ɖ",  # da; smj; ga; Scandinavian
}  # fmt: skip
_PARTS = {'u"': "ʉ", "?": "ʔ", "_h": "ʰ"}
"""Parts of names in any voice: mi and ru; da; shn."""
_JYUTPING = {"eoi": "ɵy", "eo": "ɵ", "oe": "œː", "yu": "yː", "aa": "aː", "nɡ": "ŋ", "c": "tsʰ"}
_TAP = {"ɹ": "ɾ"}
_CORRECTIONS: dict[str, dict[str, str]] = {
    "cmn": {"nɡ": "ŋ"},  # Lee and Zee 2003, JIPA 33: -ong -eng
    "cy": {"ø": "ɨ"},  # Ball and Williams 2001: u and y of the north; no front rounded vowels
    "el": {"ʂ": "s"},  # Arvaniti 1999, JIPA 29: one s
    "et": {"ɵ": "ɤ"},  # Asu and Teras 2009, JIPA 39: õ
    "fa": {"1": ""},  # the second half of q1, ق
    "ga": _TAP,  # Ní Chasaide 1999, IPA Handbook: r is not the English one
    "gn": {"y": "ɨ"},  # Gregores and Suárez 1967: y is high central unrounded
    "hu": {"ɑ": "ɒ"},  # Szende 1994, JIPA 24: short a is slightly rounded
    "hy": _TAP, "hyw": _TAP,  # Dum-Tragut 2009: ր
    "kn": _TAP, "si": _TAP, "th": _TAP,  # Schiffman 1983; Gair and Paolillo 1997; Tingsabadh and Abramson 1993, JIPA 23
    "shn": _TAP, "mt": {"ɹ": "ɾ", "y": "i"},  # Cushing 1914; Borg and Azzopardi-Alexander 1997: no y
    "ky": {"oe": "ø"},  # Kara 2003: ө
    "lt": {"ʂ": "sʲ"},  # Ambrazas 1997: s before front vowels is palatalised
    "ltg": {"y": "ɨ"},  # Nau 2011: y
    "lv": {"y": "i"},  # names of foreign letters only
    "pt": _TAP,  # Cruz-Ferreira 1995, JIPA 25: final r is a tap
    "pt-br": {"y": "i"},  # Barbosa and Albano 2004, JIPA 34: final e is [i ɪ]
    "ru": {"y": "ɨ"},  # Yanushevskaya and Bunčić 2015, JIPA 45: ы
    "sd": {"ʂ": "s"}, "ur": {"ʂ": "s"},  # Cole 2005; Saleem and others 2002: ص is s
    "ta": {"ɹ": "ɾ", "ʉ": "ɯ"},  # Keane 2004, JIPA 34: ர; Schiffman 1999: u after the first syllable is unrounded
    "tk": {"ø": "y"},  # Clark 1998: ü; its ö is labelled œ
    "tn": {"K": "ɬ"},  # Bennett and others 2016, JIPA 46: tlh
    "tr": {"ø": "y"},  # Zimmer and Orgun 1992, JIPA 22: ü under stress and in closed syllables; its ö is labelled œ
    "uz": {"y": "ɨ", "ɑ": "ɒ"},  # Sjoberg 1963: i; o is rounded
    "vi": {"y": "ɯ"},  # Kirby 2011, JIPA 41: ư, ươ, ưa
    "yue": _JYUTPING,  # Zee 1991, JIPA 21; names are Jyutping's
}  # fmt: skip
"""Parts of names by voice or language, and what they stand for, by words of the voice and their spelling.

The works named describe the language's sounds and are the place to check a row; they were not opened for it.
"""
_NASAL_BEFORE = {"m": "pbm", "n": "tdnszɕɾɽlr", "ŋ": "kɡŋ"}
"""Japanese ん by the consonant after it; else ɴ. To be checked with Okada 1991, JIPA 21."""


def language_after(name: bytes) -> str | None:
    """Code of the language that an event changes to; None for a phone.

    Examples
    --------
    >>> language_after(b"(en)"), language_after(b"a")
    ('en', None)
    """
    found = _LANGUAGE.fullmatch(_spelling(name))
    return found[1] if found else None


def read_label(name: bytes, code: str) -> tuple[str, int] | None:
    """Label in IPA and stress of a phone event; empty for a nameless event, None for what is not a phone.

    A name that cannot be converted is returned unchanged, to be reported as unknown.

    Parameters
    ----------
    name : bytes
        UTF-8, filled up with zeros.
    code : str
        Code of the voice, or of the language of a foreign word.

    Examples
    --------
    >>> read_label("ˈaɪ".encode(), "en-us"), read_label(b"s.", "cmn"), read_label(b"", "de"), read_label(b"(en)", "ru")
    (('aɪ', 1), ('ʂ', 0), ('', 0), None)
    >>> read_label(b"y", "fr-fr"), read_label(b"y", "ru-lv"), read_label("yə".encode(), "vi")
    (('y', 0), ('ɨ', 0), ('ɯə', 0))
    """
    spelling = _spelling(name)
    if _LANGUAGE.fullmatch(spelling):
        return None
    label, stress = ipa.split_stress(spelling)
    corrections = _CORRECTIONS.get(code) or _CORRECTIONS.get(code.partition("-")[0], {})
    label = _NAMES.get(label, label)
    for part, meaning in (*_PARTS.items(), *corrections.items()):
        label = label.replace(part, meaning)
    if spelling and not label:
        return None
    label = _ASPIRATED.sub("ʰ", label)
    if len(name.rstrip(b"\0")) == NAME_BYTES and _NASAL in label and label[-1] != _NASAL:
        label += _NASAL  # Portuguese ɐ̃ʊ̃ under stress has 10 bytes
    if label and not ipa.letters(label) and not is_addition(label):
        from fapengine.speech.alphabets.phone_sets import ESPEAK  # mnemonics are rare

        label = ESPEAK.to_ipa(label) or label.rstrip("-#.") or label
    return label, stress


def in_context(marks: Sequence[Mark], code: str) -> list[Mark]:
    """Correct the labels that depend on the next phone: Japanese ん, and っ before p.

    Examples
    --------
    >>> [mark.label for mark in in_context([Mark(0.0, "ũ"), Mark(0.1, "h"), Mark(0.2, "p"), Mark(0.3, "ũ")], "ja")]
    ['ɴ', 'p', 'p', 'ɴ']
    """
    if code != "ja":
        return list(marks)
    corrected = list(marks)
    for index, (mark, after) in enumerate(pairwise([*marks, Mark(0.0, "")])):
        first = after.label[:1]
        if mark.label in ("ũ", "ɴ"):
            nasal = next((nasal for nasal, letters in _NASAL_BEFORE.items() if first and first in letters), "ɴ")
            corrected[index] = replace(mark, label=nasal)
        elif mark.label == "h" and first == "p":
            corrected[index] = replace(mark, label="p")
    return corrected


def _spelling(name: bytes) -> str:
    return name.split(b"\0")[0].decode("utf-8", errors="ignore").strip("_:| ")
