"""espeak-ng's phone names as IPA, and its word marks as marks of whole words of the text.

Phone names are meant to be IPA with stress marks, cut at 8 bytes. Where a voice's data name no IPA, the library
converts its own mnemonic character by character: ``s.`` for ʂ, ``ə-`` for a weak e. An empty name is a pause or less.
"""

import re
import unicodedata
from collections.abc import Sequence

from fapengine.speech import ipa
from fapengine.speech.text.words import attribute

NAME_BYTES = 8
"""Length of a name in an event (speak_lib.h); a longer one is cut."""
_LANGUAGE = re.compile(r"\(.*\)")
"""A change of language, such as (en): no phone."""
_ASPIRATED = re.compile(r"(?<=[ptkqcʈɕʂs])h$")
_NASAL = "\u0303"

# Places by voice; espeak-ng 1.52, number texts of all its voices (tests/unit/voices/test_all_voices.py).
_OWN = {
    "s.": "ʂ", "ts.": "ʈʂ", "ts.h": "ʈʂʰ", "i.": "ɨ", "o-": "ɤ",  # cmn, hak
    "r.": "ɽ", "n^": "ɲ", "t[": "t̪", "d[": "d̪", "l-": "ɫ",  # gu ml or sd; fr; ky
    "r#": "r̥", "l#": "l̥", "tl#": "tl̥",  # is
    "ε": "ɛ", "Φ": "ɸ", "A": "ɑ", "t`": "ʈ", "d`": "ɖ",  # da; smj; ga; Scandinavian
}  # fmt: skip


def read_label(name: bytes) -> tuple[str, int] | None:
    """Label in IPA and stress of a phone event; empty for a nameless event, None for a change of language.

    A name that is not IPA even then is returned as it is, to be reported as unknown.

    Parameters
    ----------
    name : bytes
        UTF-8, filled up with zeros.

    Examples
    --------
    >>> read_label("ˈaɪ".encode()), read_label(b"s."), read_label(b""), read_label(b"(en)")
    (('aɪ', 1), ('ʂ', 0), ('', 0), None)
    """
    spelling = name.split(b"\0")[0].decode("utf-8", errors="ignore").strip("_:| ")
    if _LANGUAGE.fullmatch(spelling):
        return None
    label, stress = ipa.split_stress(spelling)
    label = _ASPIRATED.sub("ʰ", _OWN.get(label, label))
    if len(name.rstrip(b"\0")) == NAME_BYTES and _NASAL in label and label[-1] != _NASAL:
        label += _NASAL  # Portuguese ɐ̃ʊ̃ under stress has 10 bytes
    if label and not ipa.letters(label) and not all(unicodedata.category(sign) in ("Mn", "Lm") for sign in label):
        from fapengine.speech.alphabets.phone_sets import ESPEAK  # mnemonics are rare

        label = ESPEAK.to_ipa(label) or label.rstrip("-#.") or label
    return label, stress


Event = tuple[int, int, int, int, bytes]
"""Sample, kind, position in the text from 1, length, name of the phone."""
WORD, PHONEME = 1, 7
"""Kinds of events (speak_lib.h)."""


def with_whole_words(events: Sequence[Event], text: str) -> list[Event]:
    """Return the events with marks of words that are whole words, more of them where the voice joined some.

    Parameters
    ----------
    events : sequence of Event
        As the library gave them.
    text : str
        What was spoken, with spaces in the place of tags.
    """
    marks: list[tuple[int, int]] = []
    for _, kind, position, _, name in events:
        if kind == WORD:
            marks.append((position - 1, 0))
        elif marks and _is_phone(kind, name):
            marks[-1] = (marks[-1][0], marks[-1][1] + 1)
    attributed = iter(attribute(text, marks))
    whole: list[Event] = []
    waiting: list[tuple[int, int, int]] = []  # phones until then, position, length
    for event in events:
        if event[1] == WORD:
            waiting, before = [], 0
            for word, phones in next(attributed):
                waiting.append((before, word.start + 1, word.stop - word.start))
                before = phones
            _, position, length = waiting.pop(0)
            whole.append((event[0], WORD, position, length, b""))
            continue
        if waiting and _is_phone(event[1], event[4]):
            left, position, length = waiting[0]
            if left == 0:
                whole.append((event[0], WORD, position, length, b""))
                waiting.pop(0)
                if waiting:
                    waiting[0] = (waiting[0][0] - 1, *waiting[0][1:])
            else:
                waiting[0] = (left - 1, position, length)
        whole.append(event)
    return whole


def _is_phone(kind: int, name: bytes) -> bool:
    return kind == PHONEME and name[:1] not in (b"", b"\0", b"(")
