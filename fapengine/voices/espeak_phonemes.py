"""Sounds in IPA as espeak-ng's mnemonics: ``<phoneme ph="wɪn">Nguyen</phoneme>`` becomes ``[[wIn]]``.

Each voice has its own mnemonics. They are found by speaking: each that is known from any voice is spoken, a vowel
before t and a consonant before ə, because voices change the last sound of a word. Those that give one phone are the
voice's. A sound that it lacks is replaced by the one that looks most alike.
"""

import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from html import unescape
from itertools import accumulate

from fapengine.speech import ipa
from fapengine.speech.alphabets.phone_sets import ESPEAK
from fapengine.speech.marks import check_sounds
from fapengine.voices.sounding import is_vowel
from fapengine.voices.spoken_form import Edit

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
