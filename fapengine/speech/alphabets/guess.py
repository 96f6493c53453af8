"""Guessing the alphabet of labels: the one that has most of them as whole labels.

Almost any text can be cut into letters of IPA or X-SAMPA, so letters prove nothing. A label counts for an alphabet if
it is one of its labels, and for IPA and X-SAMPA, which are built of letters, if it is one phone: a vowel or diphthong,
a consonant, an affricate. Each different label counts once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.mandarin import is_one_syllable

GUESSED = ("arpabet", "ipa", "x-sampa", "openjtalk", "mrpa", "pinyin", "kana")
"""Alphabets among which is guessed; of those that explain equally much, the first."""
MIN_EXPLAINED = 0.6
"""Part of the different labels below which long labels are words."""
WORD_LETTERS = 2.5
"""Letters a label above which unexplained labels are words."""
FIRST_OTHER = "\u0400"
"""The first letter of Cyrillic; before it are Latin, IPA and Greek."""
MIN_CAPITALS = 5
"""Labels in capitals from which on a file without small consonants is not X-SAMPA."""
_BASIC = frozenset("ptkbdgmnlrszfv")
_NEAR = 0.2
"""Distance of places of articulation within which a stop and what follows are one affricate."""


@dataclass(frozen=True, slots=True)
class Guess:
    """An alphabet, and how sure it is."""

    alphabet: str
    explained: float
    """Part of the different labels that the alphabet has, 0..1."""
    others: tuple[str, ...]
    """Alphabets that explain as many, and mean something else by some."""
    words: bool
    """True where the labels look like words rather than phones of any alphabet."""


def is_one_phone(label: str) -> bool:
    """Whether IPA is one phone: a vowel or diphthong, a consonant, an affricate, a glide or liquid with its vowel.

    Examples
    --------
    >>> [is_one_phone(label) for label in ("aɪ", "t͡ʃ", "ju", "ɑːɹ", "ŋɡ", "sh", "eng", "blah", "aa")]
    [True, True, True, True, True, False, False, False, False]
    """
    letters = ipa.letters(label)
    sounds = [ipa.SOUNDS[letter] for letter in letters]
    if len(letters) < 2 or any(tie in label for tie in ipa.TIES):
        return bool(letters)
    if any(a == b for a, b in pairwise(letters)):
        return False
    if all(sound.vowel for sound in sounds):
        return len(sounds) <= 3 and not (label.isascii() and letters[-1] == "y")  # ay, oy: no IPA writes them so
    if not any(sound.vowel for sound in sounds):
        first, second = sounds[:2]
        near = first.manner in (0.0, 0.8) and abs(first.place - second.place) <= _NEAR
        return len(sounds) == 2 and (near or "".join(letters) in ("kp", "ɡb", "ŋm"))
    vowels = [sound.vowel for sound in sounds]
    if letters[0] in "jwɥ":
        return all(vowels[1:]) and len(vowels) <= 3
    ends_in_r = letters[-1] in "ɹɻɫ" and all(vowels[:-1]) and len(vowels) <= 3
    return ends_in_r or "".join(letters) in ("əl", "ən", "əm")


def explains(alphabet: str, label: str) -> bool:
    """Whether an alphabet has this label.

    Examples
    --------
    >>> explains("arpabet", "iy"), explains("ipa", "sh"), explains("x-sampa", "tS"), explains("mrpa", "e@")
    (True, False, True, True)
    """
    as_ipa, _ = alphabets.spelled_out(label, alphabet)
    if alphabet in ("ipa", "x-sampa"):
        return as_ipa is not None and is_one_phone(as_ipa)
    return as_ipa is not None and (alphabet != "pinyin" or is_one_syllable(label))


def guess(labels: Iterable[str]) -> Guess:
    """Find the alphabet that has most of the different labels, without silences; ties go to ARPAbet, then IPA.

    Examples
    --------
    >>> [guess(labels).alphabet for labels in (["AY1", "T"], ["b", "ɹ", "aɪ"], ["b", "{", "t"])]
    ['arpabet', 'ipa', 'x-sampa']
    >>> [guess(labels.split()).alphabet for labels in ("SH IY DCL D", "hh_B ah0_E", "k o N ch i")]
    ['arpabet', 'arpabet', 'openjtalk']
    >>> guess(["m", "ao"]).others, guess(["The", "birch", "canoe"]).words
    (('ipa', 'pinyin'), True)
    """
    distinct = sorted({label.strip() for label in labels if not alphabets.is_silence(label)})
    if not distinct:
        return Guess("ipa", 1.0, (), False)
    capitals = all(label.upper() == label and label.isascii() for label in distinct)
    explained = _explained(distinct, capitals=capitals)
    letters = ("ipa", "x-sampa", "arpabet") if capitals else ("ipa", "x-sampa")  # others need more than letters
    candidates = [
        name
        for name in GUESSED
        if name in letters or any(len(label) > 1 or not label.isascii() for label in explained[name])
    ]
    count = max(len(explained[name]) for name in candidates)
    best, *ties = (name for name in candidates if len(explained[name]) == count)
    part = count / len(distinct)
    if part < MIN_EXPLAINED:
        is_long = sum(map(len, distinct)) / len(distinct) > WORD_LETTERS
        return Guess(best, part, (), words=is_long or 2 * sum(map(_is_written, distinct)) >= len(distinct))
    others: list[str] = []
    for name in ties:
        if not any(_same(other, name, distinct) for other in (best, *others)):
            others.append(name)
    return Guess(best, part, tuple(others), words=False)


def _explained(labels: Sequence[str], *, capitals: bool) -> dict[str, list[str]]:
    """Labels that each alphabet has; the case of the labels excludes some."""
    found = {name: [label for label in labels if explains(name, label)] for name in GUESSED}
    if _mixed_case(labels):
        found["arpabet"] = [label for label in found["arpabet"] if label.isupper()]
    if not capitals:
        found["pinyin"] = [label for label in found["pinyin"] if not label.isupper()]
    elif any(len(label) > 1 for label in found["arpabet"]):
        found["x-sampa"] = found["pinyin"] = []  # neither is written in capitals alone
    if sum(label.isupper() for label in labels) >= MIN_CAPITALS and _BASIC.isdisjoint(labels):
        found["x-sampa"] = []  # every language has some of these consonants, and X-SAMPA writes them small
    return found


def _is_written(label: str) -> bool:
    """Whether a label has letters of a script in which no phone is written, from Cyrillic to Han; one may be a word."""
    return any(letter.isalpha() and letter >= FIRST_OTHER and letter not in ipa.SOUNDS for letter in label)


def _mixed_case(labels: Sequence[str]) -> bool:
    """Whether labels come in capitals and in small letters, Kaldi's positions aside."""
    plain = [alphabets.without_position(label) for label in labels]
    return any(label != label.upper() for label in plain) and any(label != label.lower() for label in plain)


def _same(one: str, other: str, labels: Sequence[str]) -> bool:
    """Whether two alphabets read all labels alike, as far as lips and letters go."""
    return all(
        ipa.letters(alphabets.to_ipa(label, one)[0]) == ipa.letters(alphabets.to_ipa(label, other)[0])
        for label in labels
    )


def is_doubtful(label: str, alphabet: str, *, guessed: bool) -> bool:
    """Whether a label is not in its alphabet although its letters can be read.

    Of an alphabet that was named, IPA and X-SAMPA say themselves where a phone ends.

    Examples
    --------
    >>> [is_doubtful("eng", alphabet, guessed=True) for alphabet in ("ipa", "arpabet", "mrpa")]
    [True, False, True]
    >>> is_doubtful("eng", "ipa", guessed=False)
    False
    """
    if not guessed and alphabet in ("ipa", "x-sampa", "mfa"):
        return False
    return bool(ipa.letters(alphabets.to_ipa(label, alphabet)[0])) and not explains(alphabet, label)
