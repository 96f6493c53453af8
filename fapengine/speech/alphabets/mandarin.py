"""Mandarin: pinyin in every spelling, Zhuyin, and the finals of Chinese speech corpora.

Pinyin is read with accents (``mā``), with digits 0 to 5 after or inside (``ma1n``), with ``v``, ``ü`` or ``u:``, in
capitals, with an -r (erhua), and joined (``zhong1guo2``). Sources: Hanyu Pinyin (ISO 7098), pronunciation after Lee and
Zee, JIPA 33 (2003); Zhuyin (Bopomofo) as in Unicode's chart; AISHELL-1's lexicon for ``ii iii ix iy ir``.
"""

import re
import unicodedata
from collections.abc import Iterator

from fapengine._arrays import read_tables
from fapengine.speech.alphabets.phone_set import PhoneSet

_TABLES: dict[str, dict[str, str]] = read_tables(__package__, "mandarin.toml")
INITIALS, FINALS, HELD = (_TABLES[name] for name in ("initials", "finals", "held"))
_ZERO, _SYLLABIC = _TABLES["zero"], _TABLES["syllabic"]
_BOPOMOFO, _RIMES, _MEDIALS = (_TABLES[name] for name in ("bopomofo", "rimes", "medials"))
_TONES = "\u0304\u0301\u030c\u0300\u0306"
"""Combining accents of the four tones; the breve is a common mistake for the third."""


def _syllables() -> dict[str, str]:
    finals = {name: sound for name, sound in FINALS.items() if name != "io"}
    table = {
        initial + final: consonant + sound
        for initial, consonant in INITIALS.items()
        for final, sound in finals.items()
        if initial not in ("y", "w", "ng")
    }
    for initial in ("zh", "ch", "sh", "r", "z", "c", "s"):  # here i is the consonant held on
        table[initial + "i"] = INITIALS[initial] + "ɨ"
    for initial in ("j", "q", "x"):  # here u is written for ü
        for final in ("u", "ue", "uan", "un"):
            table[initial + final] = INITIALS[initial] + FINALS[final.replace("u", "v", 1)]
    for spelling, final in _ZERO.items():
        table[spelling] = "jaɪ" if final == "iai" else FINALS[final]
    return table | {
        name: FINALS[name] for name in ("a", "o", "e", "ai", "ei", "ao", "ou", "an", "en", "ang", "er", "ê")
    }


SYLLABLES = _syllables()
"""Whole syllables, and combinations that Mandarin has not."""
_UNITS = INITIALS | FINALS | HELD | SYLLABLES | {"hm": "hm", "hng": "hŋ"}
"""Labels of one file: initials, finals, syllables."""
_ZHUYIN = re.compile(f"([{''.join(_BOPOMOFO)}]?)([ㄧㄨㄩ]?[{''.join(_RIMES)}]?)(ㄦ?)")


def plain_pinyin(label: str) -> str:
    """Remove tones, write ü as v, and use lower case.

    Examples
    --------
    >>> plain_pinyin("Lǜ"), plain_pinyin("ma1n"), plain_pinyin("lu:4"), plain_pinyin("ế")
    ('lv', 'man', 'lv', 'ê')
    """
    letters = "".join(letter for letter in unicodedata.normalize("NFD", label.lower()) if letter not in _TONES)
    letters = unicodedata.normalize("NFC", letters).replace("u:", "v").replace("ü", "v")
    return re.sub("[0-5˥˦˧˨˩]", "", letters)


def from_pinyin(label: str) -> str | None:
    """IPA of pinyin or Zhuyin, in any spelling; None if the text is neither.

    Examples
    --------
    >>> from_pinyin("mā"), from_pinyin("huar1"), from_pinyin("zhong1guo2"), from_pinyin("ㄓㄨㄤˋ"), from_pinyin("kg")
    ('ma', 'xwaɻ', 'ʈʂʊŋkwo', 'ʈʂwaŋ', None)
    """
    plain = plain_pinyin(label)
    if not plain:
        return None
    if all("ㄅ" <= letter <= "ㄭ" or letter in "ˊˇˋ˙ˉ" for letter in plain):
        return from_zhuyin(plain)
    one = _unit(plain)
    if one is not None:
        return one
    # digits after syllables separate them; else the longest syllables that fill the text
    pieces = [piece for piece in re.split(r"(?<=[0-5])(?=[^\W\d])|['’ -]", label.lower()) if piece]
    pieces = pieces if len(pieces) > 1 else [plain]
    sounds = [_in_a_row(plain_pinyin(piece)) for piece in pieces]
    return "".join(sound for sound in sounds if sound) if all(sounds) else None


def is_one_syllable(label: str) -> bool:
    """Whether a label is a part of a syllable, one syllable, or has tones: many words of other languages can be joined.

    Examples
    --------
    >>> is_one_syllable("zhuang"), is_one_syllable("panda"), is_one_syllable("pan1da2")
    (True, False, True)
    """
    plain = plain_pinyin(label)
    return from_pinyin(label) is not None and (
        _unit(plain) is not None or plain != label.lower() or not plain.isascii()
    )


def _unit(plain: str) -> str | None:
    if plain in _UNITS:
        return _UNITS[plain]
    if plain.endswith("r") and plain[:-1] in _UNITS and len(plain) > 2:  # erhua: the tongue bends, n and ng go
        return _UNITS[plain[:-1]].removesuffix("n").removesuffix("ŋ") + "ɻ"
    return None


def _in_a_row(plain: str) -> str | None:
    """Split into syllables; only the first may begin with a vowel, for pinyin writes an apostrophe before others."""

    def split(rest: str, first: bool) -> Iterator[list[str]]:
        if not rest:
            yield []
        for width in range(min(6, len(rest)), 0, -1):
            piece = rest[:width]
            erhua = piece.endswith("r") and piece[:-1] in SYLLABLES and len(piece) > 2
            if (piece in SYLLABLES or erhua) and (first or piece[0] not in "aeo"):
                for others in split(rest[width:], False):
                    yield [piece, *others]

    if len(plain) > 24:
        return None
    found = next(split(plain, True), None)
    return "".join(_unit(piece) or "" for piece in found) if found else None


def from_zhuyin(label: str) -> str | None:
    """IPA of one or more syllables in Zhuyin; None if the text is not Zhuyin.

    Examples
    --------
    >>> from_zhuyin("ㄅㄛ"), from_zhuyin("ㄌㄩˋ"), from_zhuyin("ㄕ"), from_zhuyin("ㄏㄨㄚㄦ"), from_zhuyin("ㄨㄥ")
    ('pwo', 'ly', 'ʂɨ', 'xwaɻ', 'wəŋ')
    """
    out, at, text = "", 0, re.sub("[ˊˇˋ˙ˉ]", "", label).replace("ㄋㄍ", "ㄫ")
    while at < len(text):
        match = _ZHUYIN.match(text, at)
        if match is None or not match.group():
            return None
        at = match.end()
        initial, rime, erhua = match.groups()
        spelled = _BOPOMOFO.get(initial, "")
        final = _MEDIALS.get(rime) or _RIMES.get(rime, "")
        if not final:
            sound = SYLLABLES.get(spelled + "i") if spelled in ("zh", "ch", "sh", "r", "z", "c", "s") else None
            sound = sound or _SYLLABIC.get(spelled) or INITIALS[spelled]
        elif rime == "ㄨㄥ" and not initial:
            sound = FINALS["ueng"]
        else:
            sound = (INITIALS[spelled] if spelled else "") + (FINALS.get(final) or HELD.get(final) or "jaɪ")
        out += sound.removesuffix("n").removesuffix("ŋ") + "ɻ" if erhua and final else sound + ("aɹ" if erhua else "")
    return out or None


PINYIN = PhoneSet(
    "pinyin",
    "Hanyu Pinyin (ISO 7098) in every spelling, Zhuyin, AISHELL's finals; sounds after Lee and Zee, JIPA 33 (2003)",
    "ISO 7098:2015",
    table=_UNITS | {"ü": "y", "üe": "ɥɛ", "üan": "ɥɛn", "ün": "yn"},
    read=from_pinyin,
)
