"""Names of espeak-ng's phone events as IPA, for each language; and IPA as its mnemonics.

Names are meant to be IPA with stress marks, cut at 8 bytes. Where a voice's data name no IPA, the library converts its
own mnemonic character by character: ``s.`` for ʂ, ``ə-`` for a weak e. Some results are letters of IPA that stand for
another sound: ``y`` is the mnemonic of the Russian ы, and ``ø`` (from ``Y``) that of the Turkish ü. So each language
has its own corrections (``espeak_labels.toml``). A word of another language, between ``(en)`` and ``(ru)``, is read
with those of its own.

``<phoneme ph="wɪn">Nguyen</phoneme>`` becomes ``[[wIn]]``. Each voice has its own mnemonics. They are found by
speaking: each that is known from any voice is spoken, a vowel before t and a consonant before ə, because voices change
the last sound of a word. Those that give one phone are the voice's. A sound that it lacks is replaced by the one that
looks most alike.
"""

import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import unescape
from itertools import accumulate, pairwise

from fapengine._arrays import read_tables
from fapengine.speech import ipa
from fapengine.speech.marks import check_sounds
from fapengine.voices.sounding import Mark, is_addition, is_vowel
from fapengine.voices.spoken_form import Edit

NAME_BYTES = 8
"""Length of a name in an event (speak_lib.h); a longer one is cut."""
_LANGUAGE = re.compile(r"\((.*)\)")
"""A change of language, such as (en): no phone."""
_ASPIRATED = re.compile(r"(?<=[ptkqcʈɕʂs])h$")
_NASAL = "\u0303"

_TABLES = read_tables(__package__, "espeak_labels.toml")
_NAMES: dict[str, str] = _TABLES["names"]
_PARTS: dict[str, str] = _TABLES["parts"]
_CORRECTIONS: dict[str, dict[str, str]] = _TABLES["corrections"]
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


_ELEMENT = re.compile(r"(<phoneme\b([^<>]*[^<>/])>)([^<>]*)(</phoneme\s*>)")
_ATTRIBUTE = re.compile(r"\b(alphabet|ph)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_MARKS = {"ˈ": "'", "ˌ": ","}
Sounds = tuple[int, int, str]
"""Start and stop of a word, and its sounds in IPA."""
Speak = Callable[[str], list[tuple[int, str]]]
"""Function from a text with mnemonics to the labels that it gives, each with its place."""


def elements_of(text: str) -> tuple[list[Sounds], list[Edit]]:
    """Words with sounds in the ``phoneme`` elements of an SSML text, and the edits that remove their tags."""
    sounds: list[Sounds] = []
    edits: list[Edit] = []
    for match in _ELEMENT.finditer(text):
        given = {name: unescape(one or other) for name, one, other in _ATTRIBUTE.findall(match[2])}
        if given.get("alphabet", "ipa") == "ipa" and match[3].strip():
            sounds.append((*match.span(3), check_sounds(match[3], given.get("ph", ""))))
            edits += [(*match.span(1), ""), (*match.span(4), "")]
    return sounds, edits


def phonemes_of(text: str, sounds: Sequence[Sounds], code: str, speak: Speak) -> list[Edit]:
    """Edits of a text that give words in the mnemonics of a voice.

    Parameters
    ----------
    text : str
        Plain or SSML.
    sounds : sequence of (int, int, str)
        Start and stop of each word, and its sounds in IPA.
    code : str
        Code of the voice.
    speak : callable
        Called once for a voice.
    """
    known = _known(code, speak)
    said = [(start, stop, f" [[{mnemonics(ipa_text, known)}]] ") for start, stop, ipa_text in sounds]
    literal = [(place.start() + 1, place.start() + 1, " ") for place in re.finditer(r"\[(?=\[)", text)]  # is text
    return [*said, *literal]


def mnemonics(sounds: str, known: Mapping[str, str]) -> str:
    """Spell IPA in mnemonics, the longest labels first.

    Parameters
    ----------
    sounds : str
        IPA.
    known : mapping
        Mnemonics of labels.

    Examples
    --------
    >>> mnemonics("ˈwɪn", {"w": "w", "ɪ": "I", "n": "n"}), mnemonics("ɴyː", {"n": "n", "m": "m", "u": "u", "i": "i"})
    ("w|'I|n", 'n|u')
    """
    letters = tuple(label for label in known if label in ipa.SOUNDS)
    longest = max(map(len, known))
    text = ipa.normalise(sounds)
    pieces: list[str] = []
    stress = ""
    while text:
        width = next((n for n in range(min(longest, len(text)), 0, -1) if text[:n] in known), 0)
        symbols = () if ipa.is_mark(text[0]) else ipa.letters(text[0])
        stress = _MARKS.get(text[0], stress)
        if width or symbols:
            said = [known[text[:width]]] if width else [known[ipa.nearest(symbol, letters)] for symbol in symbols]
            carries = is_vowel(text[: max(width, 1)])
            pieces += [(stress if carries else "") + said[0], *said[1:]]
            stress = "" if carries else stress
        text = text[max(width, 1) :]
    return "|".join(pieces)


_KNOWN: dict[str, dict[str, str]] = {}
"""Mnemonics by the labels of their phones, for each voice that was asked."""


def _known(code: str, speak: Speak) -> dict[str, str]:
    if code not in _KNOWN:
        from fapengine.speech.alphabets.phone_sets import ESPEAK  # rare

        asked = [
            (mnemonic, "t" if is_vowel(label) else "ə")
            for mnemonic, label in ESPEAK.table.items()
            if ipa.letters(label)
        ]
        spelled = [f"[[{mnemonic}{'@' if after == 'ə' else after}]]" for mnemonic, after in asked]
        starts = [0, *accumulate(len(each) + 1 for each in spelled)]
        heard: dict[int, list[str]] = {}
        for place, label in speak(" ".join(spelled)):
            heard.setdefault(bisect_right(starts, place) - 1, []).append(label)
        found: dict[str, str] = {}
        for index, (mnemonic, after) in enumerate(asked):
            label, *rest = heard.get(index, [""])
            if rest == [after]:
                found.setdefault(label, mnemonic)
        _KNOWN[code] = found
    return _KNOWN[code]
