"""Words of a text, the words that each mark of a voice speaks, and pieces of a long text.

Theory of operation
-------------------
A word is what stands between spaces, without the punctuation around it: apostrophes, hyphens, points and the commas of
numbers stay inside (``we'll``, ``là-bas``, ``a.m.``, ``1,234.50``). Where a script puts no spaces between words, a word
ends where the script does; in Chinese and Japanese also where the voice begins another.

A voice marks places in the text. The marks may be inside a word (``84`` of ``1984``), after it, or missing where the
voice joins words (``on the``). So a mark belongs to the word around it, and the phones of one mark are divided among
the words that have none, by the number of their letters.

Pieces of a long text are spoken one by one, so that other texts have their turn between them.

Scripts that the voices of espeak-ng read; in others they spell the letters or are silent.
"""

import re
import unicodedata
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

_INNER = "'’ʼ-‐‑./@&_·#%*\\״׳՚՛՜՞"
"""Punctuation that may stand inside a word."""
_OUTER_KEPT = "@&#%*"
"""Punctuation that also belongs to a word at its ends; signs and symbols (``C++``, ``$5``) do as well."""
_IN_NUMBERS = ",:"
_ABBREVIATION = re.compile(r"(?:[^\W\d_]{1,3}\.){2,}")
_HAN_KANA = re.compile(
    "[\u2e80-\u2fdf\u3005-\u3007\u3021-\u3029\u3031-\u3035\u3041-\u30ff\u31f0-\u31ff\u3400-\u9fff\uf900-\ufaff"
    "\U0001b000-\U0001b16f\U00020000-\U000323af]"
)
_WITHOUT_SPACES = re.compile("[\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\ua9e0-\ua9ff\uaa60-\uaadf]")
"""Thai, Lao, Myanmar, Khmer, Shan."""
_TAG = re.compile(r"<[^<>]*>")
_STOP = re.compile("[.,;:!?…—()。、]")


@dataclass(frozen=True, slots=True, order=True)
class Stretch:
    """Part of a text, from one index to before another."""

    start: int
    stop: int


def words_of(text: str) -> list[Stretch]:
    r"""Find the words of a text.

    Examples
    --------
    >>> text = '"We\'ll go at 9 a.m.," he said -- 1,234.50 (là-bas).'
    >>> [text[word.start : word.stop] for word in words_of(text)]
    ["We'll", 'go', 'at', '9', 'a.m.', 'he', 'said', '1,234.50', 'là-bas']
    """
    words: list[Stretch] = []
    start = 0
    for index in range(len(text) + 1):
        if index == len(text) or text[index].isspace() or _cuts(text, index):
            words += _parts(text, start, index)
            start = index + 1
    return words


def without_tags(text: str) -> str:
    """Blank the tags of a marked-up text; every other character stays where it is."""
    return _TAG.sub(lambda tag: " " * len(tag[0]), text)


def attribute(text: str, marks: Sequence[tuple[int, int]]) -> list[list[tuple[Stretch, int]]]:
    """Say which words each mark of a voice speaks.

    Parameters
    ----------
    text : str
        What is spoken.
    marks : sequence of (int, int)
        Where in the text the voice says that it is, and the number of phones that it then speaks.

    Returns
    -------
    list of list of (Stretch, int)
        For each mark the words that it speaks, at least one, each with its number of phones; they sum to the mark's.
        Of a text without a word the whole.
    """
    words = words_of(text) or [Stretch(0, len(text))]
    places = [place for place, _ in marks]
    chosen = _chosen(words, places)
    attributed = []
    for index, following, (place, phones) in zip(chosen, [*chosen[1:], len(words)], marks, strict=False):
        if _HAN_KANA.match(text[words[index].start : words[index].stop]):
            others = {other for other, at in zip(places, chosen, strict=True) if at == index}
            attributed.append([(_part(text, words[index], place, others), phones)])
        else:
            attributed.append(_shared(text, [words[index], *_unmarked(text, words, index, following)], phones))
    return attributed


def _cuts(text: str, index: int) -> bool:
    """Whether a character parts words."""
    if "--" in text[max(index - 1, 0) : index + 2] and text[index] == "-":
        return True
    if not unicodedata.category(text[index]).startswith("P") or text[index] in _INNER:
        return False
    between_digits = text[max(index - 1, 0) : index].isdigit() and text[index + 1 : index + 2].isdigit()
    return not (text[index] in _IN_NUMBERS and between_digits)


def _parts(text: str, start: int, stop: int) -> list[Stretch]:
    """Words of a stretch without a space: it is cut where the scripts without spaces begin and end."""
    parts = []
    kind = begun = None
    for index in range(start, stop + 1):
        now = None if index == stop else _kind(text[index]) or kind or "spaced"
        if now != kind:
            if begun is not None:
                parts.append(_stripped(text, begun, index))
            kind, begun = now, index
    return [part for part in parts if part.start < part.stop]


def _kind(char: str) -> str | None:
    """Kind of script of a character; None for what takes the kind of the character before."""
    if _HAN_KANA.match(char):
        return "Han or kana"
    if _WITHOUT_SPACES.match(char):
        return "without spaces"
    return None if unicodedata.category(char)[0] == "M" or char in _INNER else "spaced"


def _stripped(text: str, start: int, stop: int) -> Stretch:
    """Leave out the punctuation around a word, except the last point of an abbreviation."""

    def is_outer(char: str) -> bool:
        return unicodedata.category(char)[0] == "P" and char not in _OUTER_KEPT

    while start < stop and is_outer(text[start]):
        start += 1
    end = stop
    while start < end and is_outer(text[end - 1]):
        end -= 1
    return Stretch(start, end + 1 if _ABBREVIATION.fullmatch(text, start, min(end + 1, stop)) else end)


def _chosen(words: Sequence[Stretch], places: Sequence[int]) -> list[int]:
    """Index of the word that each place belongs to.

    A place between two words belongs to the one after it, unless a later mark begins that one: then the one before has
    several marks, such as the second half of an emoji's name.
    """
    starts = [word.start for word in words]
    chosen = []
    for index, place in enumerate(places):
        before = bisect_right(starts, place) - 1
        if before >= 0 and (place < words[before].stop or before + 1 == len(words)):
            chosen.append(before)
            continue
        behind = words[before + 1]
        later = next((other for other in places[index + 1 :] if other != place), None)
        is_begun = before >= 0 and later is not None and behind.start <= later < behind.stop
        chosen.append(before if is_begun else before + 1)
    return chosen


def _unmarked(text: str, words: Sequence[Stretch], index: int, following: int) -> list[Stretch]:
    """Words after one that the voice joined with it: up to the next that has a mark, or a stop."""
    joined: list[Stretch] = []
    for before, word in pairwise(words[index:following]):
        if _STOP.search(text, before.stop, word.start) or not _letters(text, word):
            break
        joined.append(word)
    return joined


def _letters(text: str, word: Stretch) -> int:
    return sum(unicodedata.category(char)[0] in "LN" for char in text[word.start : word.stop])


def _shared(text: str, words: Sequence[Stretch], phones: int) -> list[tuple[Stretch, int]]:
    """Share phones among words by their letters, at least one for each as long as there are some."""
    words = words[: max(phones, 1)]
    letters = [max(_letters(text, word), 1) for word in words]
    shares = []
    given = 0
    for index, word in enumerate(words):
        wish = round(phones * sum(letters[: index + 1]) / sum(letters)) - given
        share = min(max(wish, 1), phones - given - (len(words) - index - 1))
        shares.append((word, share))
        given += share
    return shares


def _part(text: str, word: Stretch, place: int, places: set[int]) -> Stretch:
    """Part of a stretch of Han or kana from a place to the next one that is marked."""

    def edge(at: int) -> int:
        while at > word.start and unicodedata.category(text[at])[0] == "M":
            at -= 1
        return at

    inside = sorted(at for at in places if word.start < at < word.stop)
    start = max((at for at in inside if at <= place), default=word.start)
    stop = min((at for at in inside if at > place), default=word.stop)
    return Stretch(edge(start), edge(stop) if stop < word.stop else stop)


PIECE_LETTERS = 300
"""Characters of a piece; 300 of 字, read out in English, are 100 s of audio and take espeak-ng 0.4 s."""
_CUTS = (
    re.compile(r"\n+|\w{4,}[.!?…][\"'»”)]*\s+|[。！？]"),  # not after "Dr."
    re.compile(r"[.!?…]\s+|[,;:]\s+|[、，；：]"),
    re.compile(r"\s+"),
)
"""Places where a text may be cut, the best first."""
_WHOLE = re.compile(r"\[[^\[\]{}<>]{1,80}\]\{[^{}<>]{0,200}\}")
"""A word with its sounds; shorter than a piece."""


def pieces_of(text: str, letters: int = PIECE_LETTERS) -> list[str]:
    """Cut a long text into pieces: after a sentence, else after a comma, else after a word, else anywhere.

    Examples
    --------
    >>> pieces_of("I saw Dr. Lee. He slept, and then he woke.", 30)
    ['I saw Dr. Lee. He slept, ', 'and then he woke.']
    >>> pieces_of("The sentence ends. The next begins.", 30)
    ['The sentence ends. ', 'The next begins.']
    >>> "".join(pieces_of("x" * 1000)) == "x" * 1000, len(pieces_of("x" * 1000))
    (True, 4)
    """
    pieces = []
    while len(text) > letters:
        window = text[:letters]
        whole = [found.span() for found in _WHOLE.finditer(text) if found.start() < letters]
        ends = (
            [end for end in (found.end() for found in cut.finditer(window)) if not _inside(end, whole)] for cut in _CUTS
        )
        end = next((places[-1] for places in ends if places and places[-1] >= letters // 4), letters)
        end = next((start or stop for start, stop in whole if start < end < stop), end)
        pieces.append(text[:end])
        text = text[end:]
    return [*pieces, text] if text else pieces


def _inside(place: int, stretches: Sequence[tuple[int, int]]) -> bool:
    return any(start < place < stop for start, stop in stretches)


def ends_sentence(piece: str) -> bool:
    """Return whether a sentence ends with a piece, so that a longer pause follows.

    Examples
    --------
    >>> [ends_sentence(piece) for piece in ("He slept. ", "He slept, ", "睡了。")]
    [True, False, True]
    """
    return bool(re.search(r"[.!?…。！？\n][\"'»”)]*\s*$", piece))


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
