"""Scripts that the voices of espeak-ng read; in others they spell the letters or are silent."""

import unicodedata
from collections.abc import Iterable, Sequence
from functools import cache

_VOICES = {
    "Cyrillic": "ba be bg bs cv hr kk ky lfn mk nog ru sr tt uk uz",
    "Greek": "el grc", "Arabic": "ar fa sd ug ur", "Hebrew": "he", "Devanagari": "hi kok mr ne",
    "Bengali": "as bn bpy", "Gujarati": "gu", "Gurmukhi": "pa", "Oriya": "or", "Tamil": "ta", "Telugu": "te",
    "Kannada": "kn", "Malayalam": "ml", "Sinhala": "si", "Thai": "th", "Myanmar": "my shn", "Georgian": "ka",
    "Armenian": "hy hyw", "Ethiopic": "am ti", "Hangul": "ko", "Han": "cmn yue", "Kana": "ja",
    "Cherokee": "chr", "Shavian": "en",
}  # fmt: skip
"""Scripts, and the languages with voices that read words of them, by their transcriptions in 1.52."""
_UNREAD = "Lao Khmer Tibetan Syriac Thaana Tifinagh Mongolian Bopomofo Braille Nko Gothic Coptic"
"""Scripts that no voice reads."""
_NO_LATIN = {"ja"}
"""Languages whose voice spells Latin words too; the others read them as English."""
_CALLED = {"Cjk": "Han", "Hiragana": "Kana", "Katakana": "Kana"}


@cache
def script_of(char: str) -> str | None:
    """Return the script of a letter, by the first word of its name in Unicode; None for other characters.

    Examples
    --------
    >>> [script_of(char) for char in "aжあ漢1"]
    ['Latin', 'Cyrillic', 'Kana', 'Han', None]
    """
    if not unicodedata.category(char).startswith("L"):
        return None
    first = unicodedata.name(char, "").partition(" ")[0].title()
    script = _CALLED.get(first, first)
    return script if script in _VOICES or script == "Latin" or script in _UNREAD.split() else None


def scripts_in(word: str) -> list[str]:
    """Return the scripts of a word's letters, in order."""
    return list(dict.fromkeys(filter(None, map(script_of, word))))


def reads(code: str, script: str) -> bool:
    """Return whether the voice of a language code reads words of a script, with its own rules or as English.

    Examples
    --------
    >>> reads("en-us", "Latin"), reads("en-us", "Arabic"), reads("ru-lv", "Cyrillic")
    (True, False, True)
    """
    language = code.lower().partition("-")[0]
    return language not in _NO_LATIN if script == "Latin" else language in _VOICES.get(script, "").split()


def readers(script: str) -> list[str]:
    """Language codes of voices that read a script, some of them."""
    return _VOICES.get(script, "").split()[:4]


def is_spelled(word: str, transcription: str) -> bool:
    """Return whether a voice spells a word of an unknown script, or is silent, by its transcription in IPA.

    espeak-ng writes the language that speaks a whole word before it, ``(hi)nəmˈʌsteː``; letters are named one by one,
    separated by spaces.
    """
    begin, _, rest = transcription.strip().removeprefix("(").partition(")")
    handed_over = transcription.startswith("(") and all(reads(begin, script) for script in scripts_in(word))
    letters = sum(script_of(char) is not None for char in word)
    return not handed_over or (letters > 1 and rest.strip().count(" ") + 1 >= letters)


_VOWELS = frozenset("aeiouyæøœəıаеёиоуыэюяєіїўαεηιουω")


def may_be_spelled(word: str) -> bool:
    """Return whether a word of letters has no vowel, and is not an acronym in capitals.

    Examples
    --------
    >>> [may_be_spelled(word) for word in ("km", "Hptm", "TV", "by", "krk", "мм", "p.m.")]
    [True, True, False, False, True, True, False]
    """
    letters = unicodedata.normalize("NFD", word.lower())
    alphabetic = all(script_of(char) in ("Latin", "Cyrillic", "Greek") for char in word)
    return len(word) > 1 and alphabetic and not word.isupper() and not _VOWELS.intersection(letters)


def bare(transcription: str) -> str:
    """Leave out spaces, stress and length of a transcription in IPA."""
    return "".join(char for char in transcription if char not in " ˈˌː")


def spelled_remarks(found: Sequence[tuple[str, int]]) -> tuple[str, ...]:
    """Describe, in one sentence, the words whose letters a voice named; each with its place in the text, from 0."""
    if not found:
        return ()
    named = ", ".join(f"{word!r} (letter {place + 1})" for word, place in found[:3])
    more = f" and {len(found) - 3} more" if len(found) > 3 else ""
    return (f"text: {named}{more} spoken letter by letter; write out what is meant",)


def unread_remarks(found: Iterable[tuple[str, int]], code: str) -> tuple[str, ...]:
    """Describe the words that a voice does not read, in one sentence per script.

    Parameters
    ----------
    found : iterable of (str, int)
        The words, each with its place in the text, from 0.
    code : str
        Language code of the voice.
    """
    by_script: dict[str, list[tuple[str, int]]] = {}
    for word, place in found:
        for script in scripts_in(word):
            if not reads(code, script):
                by_script.setdefault(script, []).append((word, place))
    remarks = []
    for script, words in by_script.items():
        more = f" and {len(words) - 1} more" if len(words) > 1 else ""
        choice = f"voices that read it: {', '.join(readers(script))}" if readers(script) else "no voice reads it"
        choice = "most other voices read it" if script == "Latin" else choice
        remarks.append(
            f"text: voice {code!r} does not read {script}: {words[0][0]!r} (letter {words[0][1] + 1}){more} cannot be"
            f" pronounced, only spelled; {choice}"
        )
    return tuple(remarks)
