"""Where in a text a piece of sound ends: phones that were heard against phones that were expected.

Theory of operation
-------------------
A phone loop, which knows no text, mistakes many phones, but seldom their kind (:data:`KINDS`). The phones that it heard
in a piece are laid beside those of the words that follow, by edit distance; the piece's words end where that is least.
Once words are aligned, the share of their frames in which the loop hears the same kind tells whether they were
said: .45 to .9 of a sentence if so, 0 to .4 if it is another one.
"""

from collections.abc import Sequence

import numpy as np

from fapengine.ears.sphinx import MODEL_PHONES

KINDS = tuple(
    frozenset(names.split())
    for names in (
        "M N NG", "B P", "D T", "G K", "F TH HH", "V DH", "S Z", "SH ZH CH JH", "L W OW AO OY", "R ER", "IY IH Y EY",
        "EH AE", "AA AH AY AW", "UW UH",
    )
)  # fmt: skip
"""Phones of the model that sound alike."""
_KIND = {name: number for number, names in enumerate(KINDS) for name in names}
OTHER, LEFT_OUT = 1.0, 0.7
"""Costs of another kind of phone, and of a phone too many or too few; the same kind costs 0, but for :data:`ALIKE`."""
ALIKE = 0.2
"""Cost of another phone of the same kind."""
QUICK_HZ = 25.0
"""Phones a second that nobody speaks."""

_COST = np.array([
    [0.0 if a == b else ALIKE if _KIND[a] == _KIND[b] else OTHER for b in MODEL_PHONES] for a in MODEL_PHONES
])  # fmt: skip
_NUMBER = {name: number for number, name in enumerate(MODEL_PHONES)}


def words_said(heard: Sequence[str], words: Sequence[Sequence[str]]) -> int:
    """Count the words of a text that a piece of sound holds.

    Parameters
    ----------
    heard : sequence of str
        The model's phones that were heard, without silences.
    words : sequence of sequences of str
        The model's phones of the words that follow; more than the piece can hold.

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
    """Tell whether two phones of the model sound alike; silence is like none.

    Examples
    --------
    >>> same_kind("M", "N"), same_kind("M", "SIL")
    (True, False)
    """
    return one in _KIND and _KIND.get(other) == _KIND[one]
