"""Japanese: kana, mora by mora.

Pronunciation after Okada, Handbook of the IPA (1999). Katakana and hiragana, full and half width, with every small
vowel. The moraic nasal takes the place of the stop after it, and so does っ: before p b m the lips are shut.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import replace

from fapengine._arrays import read_tables
from fapengine.speech.alphabets.phone_set import PhoneSet, joined
from fapengine.speech.phone_track import Phone

JAPANESE = ("kana", "voicevox", "openjtalk", "misaki")
"""Names of the sets that write a moraic nasal as ɴ and っ as ʔ."""

_TABLES: dict[str, dict[str, str]] = read_tables(__package__, "japanese.toml")
_VOWELS = dict(zip("アイウエオ", "aiɯeo", strict=True))
_SILENT = "、。？！・，．,.!?「」『』（）()…‥：；:; 　～\"'ˈ↓ꜜ"


def _kana() -> dict[str, str]:
    table = dict(_TABLES["others"])
    for consonant, morae in _TABLES["rows"].items():
        for vowel, mora in zip(_VOWELS.values(), morae.ljust(5), strict=True):
            if mora != " ":
                table[mora] = consonant + vowel
    for mora, consonant in _TABLES["palatal"].items():
        for small, vowel in zip("ャュョ", "aɯo", strict=True):
            table[mora + small] = consonant + vowel
    for small, vowel in zip("ァィゥェォ", _VOWELS.values(), strict=True):
        table[small] = vowel
        for mora, consonant in _TABLES["before-small-vowels"].items():
            table[mora + small] = consonant + vowel
    for mora, sound in list(table.items()):
        for small, vowel in zip("ァィゥェォ", _VOWELS.values(), strict=True):
            if len(mora) == 1 and mora not in "ァィゥェォ" and sound.endswith(vowel):
                table[mora + small] = sound + "ː"  # a small vowel after the same vowel only lengthens it
    for mora in "クグ":
        table[mora + "ヮ"] = table[mora + "ァ"]
    table["ヲ"] = "o"  # a particle in all but songs
    return table | dict.fromkeys(_SILENT, "")


_MORAE = _kana()


def plain_kana(label: str) -> str:
    """Write katakana of full width for any kana; ゝ and ゞ repeat what stands before, 〜 is ー.

    Examples
    --------
    >>> plain_kana("ｶﾞｯﾂ"), plain_kana("こゝろ"), plain_kana("すゞ"), plain_kana("あ〜")
    ('ガッツ', 'ココロ', 'スズ', 'アー')
    """
    text = unicodedata.normalize("NFKC", label)
    kana = "".join(chr(ord(letter) + 0x60) if "ぁ" <= letter <= "ゖ" else letter for letter in text)
    out = ""
    for letter in kana.replace("〜", "ー").replace("~", "ー"):
        if letter in "ゝヽゞヾ" and out:
            letter = unicodedata.normalize("NFC", out[-1] + "\u3099") if letter in "ゞヾ" else out[-1]
        out += letter
    return out


def from_kana(label: str) -> str | None:
    """IPA of one or more morae, empty for signs; None if the text is not kana.

    Examples
    --------
    >>> [from_kana(text) for text in ("きょ", "ヴォ", "しんぶん", "きっぷ", "、", "x")]
    ['kʲo', 'bo', 'ɕimbɯɴ', 'kippɯ', '', None]
    """
    out = joined(plain_kana(label), _MORAE) if label else None
    return None if out is None else assimilated(out)


def assimilated(label: str, following: str = "") -> str:
    """Close the lips on a moraic nasal and on っ before p b m, inside a label and at its end.

    Examples
    --------
    >>> assimilated("ɕiɴbɯɴ"), assimilated("ɴ", "mi"), assimilated("kiʔpɯ"), assimilated("ʔ", "ta")
    ('ɕimbɯɴ', 'm', 'kippɯ', 'ʔ')
    """
    return re.sub("ʔ(?=p)", "p", re.sub("ɴ(?=[pbm])", "m", label + following))[: len(label)]


def in_japanese(phones: Sequence[Phone]) -> list[Phone]:
    """Assimilate moraic nasals and っ to the next phone; a separate long mark lengthens the phone before it.

    Examples
    --------
    >>> said = [Phone("ka", 0, 1), Phone("ː", 1, 2), Phone("ɴ", 2, 3), Phone("pa", 3, 4)]
    >>> [(phone.label, phone.end_s) for phone in in_japanese(said)]
    [('kaː', 2), ('m', 3), ('pa', 4)]
    """
    changed: list[Phone] = []
    for phone, following in zip(phones, [*(each.label for each in phones[1:]), ""], strict=False):
        before = changed[-1] if changed else None
        if phone.label == "ː" and before and not before.is_silence:
            changed[-1] = replace(before, label=before.label + "ː", end_s=phone.end_s)
        else:
            changed.append(replace(phone, label=assimilated(phone.label, following)))
    return changed


_HIRAGANA = {
    "".join(chr(ord(c) - 0x60) if "ァ" <= c <= "ヶ" else c for c in kana): sound for kana, sound in _MORAE.items()
}
KANA = PhoneSet(
    "kana", "Katakana and hiragana; pronunciation after Okada, Handbook of the IPA (1999)", "JIS X 0208 and 0201",
    table={k: v for k, v in (_MORAE | _HIRAGANA).items() if v or k in "、。？！・"}, read=from_kana,
)  # fmt: skip
