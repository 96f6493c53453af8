"""IPA labels: cleaning, splitting in time, and the distance between two phones.

Places, manners and vowel positions are those of the chart of the International Phonetic Association (2020). The
distance weighs what is *seen* most: lips, then jaw, then the rest. The stand-in for an unknown phone is found by
articulatory features (:data:`ROWS`) among phones with the same lips.

The rows, ``phone_features.csv``, are those of panphon 0.22 (Mortensen and others, "PanPhon", COLING 2016; MIT licence),
written by ``design/phone_features.py`` for our letters. The distance is panphon's ``Segment.distance``, so both rank
neighbours alike (``tests/oracle``).
"""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from fapengine._arrays import read_rows, read_tables
from fapengine.speech.articulation import ARTICULATIONS

FEATURES = (
    "syl", "son", "cons", "cont", "delrel", "lat", "nas", "strid", "voi", "sg", "cg", "ant",
    "cor", "distr", "lab", "hi", "lo", "back", "round", "velaric", "tense", "long", "hitone", "hireg",
)  # fmt: skip
"""Columns of :data:`ROWS`, with panphon's names."""

ROWS: dict[str, str] = dict(read_rows("fapengine.speech", "phone_features.csv"))
"""Features of a letter, a sign each: + present, - absent, 0 does not apply."""
ALIKE: dict[str, str] = {"ɚ": "ə", "ɝ": "ɜ", "ʜ": "ħ", "ʢ": "ʕ", "ʡ": "ʔ", "ⱱ": "v"}
"""Letters without a row of their own, and the letter whose row they take."""

_VALUES = {"+": 1, "0": 0, "-": -1}


def features(letter: str) -> tuple[int, ...]:
    """Features of a letter: 24 values of +1, 0, -1 in the order of :data:`FEATURES`.

    Examples
    --------
    >>> dict(zip(FEATURES, features("m"), strict=True))["nas"]
    1
    """
    return tuple(_VALUES[sign] for sign in ROWS[ALIKE.get(letter, letter)])


def feature_distance(first: str, second: str) -> int:
    """Sum of the differences of all features, 0 for the same; a feature turned over counts 2.

    Examples
    --------
    >>> feature_distance("p", "b"), feature_distance("p", "m") < feature_distance("p", "a")
    (2, True)
    """
    return sum(abs(a - b) for a, b in zip(features(first), features(second), strict=True))


ROUNDED_MM = 5.0
"""Half of what u protrudes by."""
STRESS = {"ˈ": 1, "ˌ": 2}
STRESS_MARKS = ("", *STRESS)
"""Mark of each stress: none, primary and secondary."""
TIES = "\u0361\u035c"
LENGTH = "ːˑ"
_LIGATURES = {"ʣ": "dz", "ʤ": "dʒ", "ʦ": "ts", "ʧ": "tʃ", "ʨ": "tɕ", "ʥ": "dʑ"}
_REPLACED = {**_LIGATURES, "g": "ɡ", "ᵻ": "ɪ", "ᵊ": "ə", "’": ""}


@dataclass(frozen=True, slots=True)
class Sound:
    """Articulation of one IPA symbol."""

    lips: float
    """0 free, 0.5 lip against teeth, 1 both lips closed or nearly."""
    rounding: float
    """0 spread or neutral, 1 rounded."""
    opening: float
    """0 jaw up (close), 1 open vowel."""
    place: float
    """0 teeth, 1 glottis; for vowels 0 front, 1 back."""
    vowel: bool
    voiced: bool = True
    manner: float = 0.0
    """0 stop, 0.3 fricative, 0.6 approximant, 0.8 nasal; 1 vowel."""


MANNERS = {"stop": 0.0, "fricative": 0.3, "approximant": 0.6, "nasal": 0.8}
"""Values of :attr:`Sound.manner`."""
_CHART = read_tables("fapengine.speech", "ipa_chart.toml")


def _table() -> dict[str, Sound]:
    sounds: dict[str, Sound] = {}
    for place, manners in _CHART["consonants"].items():
        lips, rounding, back = _CHART["places"][place]
        for manner, (voiceless, voiced) in manners.items():
            for letter in voiceless + voiced:
                sounds[letter] = Sound(lips, rounding, 0.1, back, False, letter in voiced, MANNERS[manner])
    for opening, columns in _CHART["vowels"].items():
        for place_of, pair in zip((0.0, 0.5, 1.0), columns, strict=True):
            for rounding, letter in enumerate(pair):
                if letter != " ":
                    sounds[letter] = Sound(0.0, float(rounding), float(opening), place_of, True, True, 1.0)
    sounds["ɚ"] = Sound(0.0, 0.4, 0.5, 0.5, True, True, 1.0)
    sounds["ɝ"] = Sound(0.0, 0.4, 0.6, 0.5, True, True, 1.0)
    return sounds


SOUNDS: dict[str, Sound] = _table()
"""Every IPA symbol that fapengine knows, with its articulation."""


def split_stress(label: str) -> tuple[str, int]:
    """Remove the stress marks of a label; returns the rest and the stress.

    Examples
    --------
    >>> split_stress("ˈaɪ")
    ('aɪ', 1)
    """
    stress = next((STRESS[letter] for letter in label if letter in STRESS), 0)
    return "".join(letter for letter in label if letter not in STRESS), stress


def normalise(label: str) -> str:
    """Return the canonical spelling of a phone: without tie bars and tones, ligatures such as ʧ split, g as ɡ.

    Examples
    --------
    >>> normalise("t͡ʃ"), normalise("ʤ"), normalise("gː"), normalise("ɔ̃"), normalise("a˥")
    ('tʃ', 'dʒ', 'ɡː', 'ɔ̃', 'a')
    """
    kept = (
        _REPLACED.get(letter, letter)
        for letter in unicodedata.normalize("NFD", label)
        if letter not in TIES and letter not in "\u200d\u200c" and not "˥" <= letter <= "˩"
    )
    return unicodedata.normalize("NFC", "".join(kept)) or label


CEDILLA = "\u0327"
"""Mark of ç, the one letter of IPA that Unicode takes apart though it is another sound than its base."""


@cache
def letters(label: str) -> tuple[str, ...]:
    """Split a label into known IPA symbols, without diacritics, ties and lengths; empty if one is unknown.

    Examples
    --------
    >>> letters("t͡ʃ"), letters("ɑː"), letters("spn"), letters("%"), letters("ç")
    (('t', 'ʃ'), ('ɑ',), ('s', 'p', 'n'), (), ('ç',))
    """
    known_letters: list[str] = []
    for letter in unicodedata.normalize("NFD", label):
        if letter == CEDILLA and known_letters and known_letters[-1] == "c":
            known_letters[-1] = "ç"
        if is_mark(letter):
            continue
        for known in _REPLACED.get(letter, letter):
            if known not in SOUNDS:
                return ()
            known_letters.append(known)
    return tuple(known_letters)


def foreign_symbol(text: str) -> str | None:
    """Return the first symbol of a transcription that is not IPA, or None.

    Examples
    --------
    >>> foreign_symbol("ˈwɪn.sə naɪt"), foreign_symbol("w1n")
    (None, '1')
    """
    for char in unicodedata.normalize("NFD", text):
        if not char.isspace() and char not in ".|‿" and not letters(char) and not is_mark(char):
            return char
    return None


def is_mark(char: str) -> bool:
    """Return whether a character of IPA only changes another: stress, length, a tie, a diacritic."""
    return char in STRESS or char in TIES or char in LENGTH or unicodedata.category(char) in ("Mn", "Lm", "Sk", "Cf")


_VISIBILITY = {
    "lips": 3.0, "rounding": 2.0, "opening": 2.0, "vowel": 1.5, "place": 0.8, "manner": 0.5, "voiced": 0.05,
}  # fmt: skip
"""Weights of differences: chosen so that the nearest neighbours agree with the groups of the MPEG-4 viseme table."""


def distance(one: str, other: str) -> float:
    """Visible difference of two IPA symbols, 0 for the same.

    Examples
    --------
    >>> distance("p", "b") < distance("p", "f") < distance("p", "a")
    True
    """
    a, b = SOUNDS[one], SOUNDS[other]
    return float(sum(weight * abs(getattr(a, name) - getattr(b, name)) for name, weight in _VISIBILITY.items()))


def counterparts(changes: Sequence[Sequence[float]], lost: float, around: float) -> list[tuple[int, int]]:
    """Pair phones of two sequences: least sum of changes (Wagner and Fischer, 1974).

    Parameters
    ----------
    changes : sequence of sequence of float
        Cost of each phone of the second sequence for each of the first.
    lost : float
        Cost of a phone without a counterpart.
    around : float
        The same before the first pair and after the last one, in the second sequence.

    Returns
    -------
    list of tuple of int
        Places in the two sequences, in order.

    Examples
    --------
    >>> counterparts([[0.5, 0.0, 0.5]], lost=1.0, around=1.0)
    [(0, 1)]
    """
    count = len(changes[0]) if changes else 0
    costs = [[around * column for column in range(count + 1)]]
    for row, unlike in enumerate(changes, start=1):
        above, line = costs[-1], [lost * row]
        for column, change in enumerate(unlike):
            line.append(min(above[column] + change, line[column] + lost, above[column + 1] + lost))
        costs.append(line)
    row, column = len(changes), count
    if around < lost:
        column = min(range(count + 1), key=lambda last: costs[-1][last] + around * (count - last))
    pairs = []
    while row and column:
        if costs[row][column] == costs[row - 1][column - 1] + changes[row - 1][column - 1]:
            row, column = row - 1, column - 1
            pairs.append((row, column))
        elif costs[row][column] == costs[row - 1][column] + lost:
            row -= 1
        else:
            column -= 1
    return pairs[::-1]


def is_rounded(letter: str) -> bool:
    """Return whether lips come forward for a symbol, by :data:`ROUNDED_MM` or more.

    Examples
    --------
    >>> [letter for letter in "iyɪʏʃɕjɥɹ" if is_rounded(letter)]
    ['y', 'ʏ', 'ʃ', 'ɥ', 'ɹ']
    """
    return ARTICULATIONS[letter].push >= ROUNDED_MM


def nearest(letter: str, known: tuple[str, ...]) -> str:
    """Return the symbol of ``known`` with the articulation most similar to ``letter``.

    Panphon's feature distance decides, but only among symbols with the same lips: a phone never closes the lips, sets
    them against the teeth or rounds them because an inner feature such as nasality agrees. Ties go to the smaller
    :func:`distance`, then to the earlier symbol. For vowels only :func:`distance` counts: panphon's *tense* puts ʊ
    nearer to ɔ than to u, which opens half as far.

    Examples
    --------
    >>> nearest("ɸ", ("m", "s", "a")), nearest("ŋ", ("m", "k", "s"))
    ('m', 'k')
    >>> nearest("ʏ", ("i", "ɪ", "u")), nearest("ɻ", ("j", "ɹ")), nearest("ɕ", ("s", "ʃ"))
    ('u', 'ɹ', 's')
    """
    sound = SOUNDS[letter]

    def order(candidate: str) -> tuple[float, bool, int, float]:
        lips = abs(round(2 * sound.lips) - round(2 * SOUNDS[candidate].lips))
        features = 0 if sound.vowel else feature_distance(letter, candidate)
        return lips, is_rounded(letter) != is_rounded(candidate), features, distance(letter, candidate)

    return min(known, key=order)
