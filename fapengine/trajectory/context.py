"""Targets of a phone between its neighbours: they depend on context, learned by least squares.

Theory of operation
-------------------
A phone's targets at a few fractions of its duration are a sum over *features* of the phone and of three neighbours
to either side (:mod:`.context_features`): how they are articulated, who they are, who stands beside whom, how long
they last. Ridge regression finds what each feature adds; the rarer and the farther a feature, the more it is shrunk. A
phone or a pair that was never heard has no feature of its own, so its articulation speaks for it, and it stays near its
likes.

How much each kind is shrunk was chosen by words left out, not by sentences left out: all that a user makes a face say
is new words, while the words of a held-out sentence were heard in others (``bench/new_words``).

Lips foresee by this: the same /s/ is round before /u/ and spread before /i/.
"""

from array import array
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve
from scipy.sparse import csr_array

from fapengine.errors import UsageError
from fapengine.profiles import ContextModel
from fapengine.speech.phone_track import SILENCE
from fapengine.trajectory.context_features import (
    LENGTHS,
    MAX_DURATION_S,
    MIN_DURATION_S,
    PAUSE_S,
    REACH,
    TYPICAL_S,
    Part,
    alone,
    beside,
    features,
    lengthened,
    paired,
    parts_of,
    ways,
)  # fmt: skip
from fapengine.trajectory.tokens import Token
from fapengine.trajectory.unheard import add_unheard

Array = NDArray[np.float64]

FRACTIONS = (0.2, 0.7)
"""Fractions of a phone's duration at which its keyframes stand; splines through captured values there are within 0.35
mm of the captured lips (through those at 30 % alone, 0.79)."""
PENALTIES: Mapping[str, tuple[float, ...]] = {
    "bias": (0.03,), "phone": (10.0,), "length": (3.0,), "way": (1.0, 10.0, 20.0, 40.0),
    "letter": (0.0, 30.0, 60.0, 120.0), "cross": (0.0, 60.0), "pair": (30.0,), "triple": (10.0,),
}  # fmt: skip
"""Ridge of each kind of feature by its distance in steps, the first for a kind without one. Found by leaving words out,
within training sentences of one speaker; of those tried, none a third of it or thrice it lowers the error at the keys
by more than 0.6 %."""
MIN_TOKENS = 3
"""Tokens that a feature must be seen in; what is rarer is luck."""
BLOCK = 256
"""Columns of the normal matrix that are computed at a time."""
FIRST_PAIRS = 64
"""Rows that tables begin with; they double when they are full."""


def targets(tokens: Sequence[Token], model: ContextModel) -> Array:
    """Weights at the model's fractions of every token: (N, keyframes, K); features that it lacks add nothing.

    The sum of what :func:`.context_features.features` names, but summed beforehand for each kind of token: a stream
    asks this whenever a phone comes.
    """
    tables = _tables(model)
    around = [tables.silence] * REACH + [tables.kind(token) for token in tokens] + [tables.silence] * REACH
    lengths = np.full(len(around), PAUSE_S)
    lengths[REACH : len(around) - REACH] = [
        PAUSE_S if token.name == SILENCE else token.end_s - token.start_s for token in tokens
    ]
    lengths = np.log(np.clip(lengths, MIN_DURATION_S, MAX_DURATION_S) / TYPICAL_S)
    kinds = np.array(around)
    spoken = [index for index, token in enumerate(tokens) if token.name != SILENCE]
    own = np.array(spoken, dtype=np.intp) + REACH
    total = tables.near(around, own.tolist())
    total += lengths[own, None] * tables.by_length[kinds[own]]
    total += lengths[own[:, None] + _LENGTHS] @ tables.lengths_beside
    for step in range(-REACH, REACH + 1):
        total += tables.by_step[kinds[own + step], step + REACH]
    found = np.zeros((len(tokens), *model.coefficients.shape[1:]))
    found[spoken] = total.reshape(len(spoken), *found.shape[1:])
    return found


_LENGTHS = np.array(LENGTHS)


class _Tables:
    """Sums for every kind of token that was met: what it adds to its own targets and to its neighbours'.

    Stateful: it grows, up to the square of the number of IPA's letters.
    """

    def __init__(self, model: ContextModel) -> None:
        flat = model.coefficients.reshape(len(model.features), -1)
        self._coefficients = np.vstack([flat, np.zeros(flat.shape[1])])
        """(F + 1, D); the last row is for features that the model lacks."""
        self._rows = model.rows
        self.lengths_beside = np.stack([self._sum({f"length {step}": 1.0}) for step in LENGTHS])
        """(steps, D), per length of the neighbour at each of :data:`LENGTHS`."""
        self.by_step = np.zeros((0, 2 * REACH + 1, flat.shape[1]))
        """(kinds, steps, D): as the neighbour at each step, and in the middle as the token itself."""
        self.by_length = np.zeros((0, flat.shape[1]))
        """(kinds, D), per length of the token itself."""
        self._parts: list[tuple[Part, Part]] = []
        self._kinds: dict[tuple[str, ...], int] = {}
        self._pairs: dict[tuple[int, int], int] = {}
        self._pair_sums = np.zeros((FIRST_PAIRS, 2, flat.shape[1]))
        self.silence = self._kind(())

    def kind(self, token: Token) -> int:
        if token.name == SILENCE:
            return self.silence
        known = self._kinds.get(token.heard)
        return self._kind(token.heard) if known is None else known

    def near(self, kinds: Sequence[int], own: Sequence[int]) -> Array:
        """(N, D): what tokens at ``own`` get from who stands right beside them."""
        names, rows = [self._parts[kind][0].name for kind in kinds], self._rows
        triples = [rows.get(f"triple {names[at - 1]} {names[at]} {names[at + 1]}", -1) for at in own]
        before = [self._pair(kinds[at - 1], kinds[at]) for at in own]
        behind = [self._pair(kinds[at], kinds[at + 1]) for at in own]
        total: Array = self._coefficients[triples] + self._pair_sums[before, 0] + self._pair_sums[behind, 1]
        return total

    def _pair(self, first: int, second: int) -> int:
        row = self._pairs.get((first, second))
        if row is None:
            row = self._pairs[first, second] = len(self._pairs)
            if row == len(self._pair_sums):
                self._pair_sums = np.concatenate([self._pair_sums, np.zeros_like(self._pair_sums)])
            one, other = self._parts[first][1], self._parts[second][0]
            self._pair_sums[row] = self._sum(paired(other, -1, one)), self._sum(paired(one, 1, other))
        return row

    def _kind(self, heard: tuple[str, ...]) -> int:
        first, last = parts_of(heard)
        self._kinds[heard] = len(self._parts)
        self._parts.append((first, last))
        steps = [
            self._sum(beside(step, last if step < 0 else first) if step else alone(first))
            for step in range(-REACH, REACH + 1)
        ]
        self.by_step = np.concatenate([self.by_step, [steps]])
        self.by_length = np.concatenate([self.by_length, [self._sum(lengthened(first))]])
        return self._kinds[heard]

    def _sum(self, named: Mapping[str, float]) -> Array:
        rows = [self._rows.get(name, -1) for name in named]
        total: Array = np.array(list(named.values())) @ self._coefficients[rows]
        return total


@lru_cache(maxsize=16)
def _tables(model: ContextModel) -> _Tables:
    return _Tables(model)


def fit_context(sentences: Sequence[Sequence[Token]], weights: Sequence[Array]) -> ContextModel:
    """Learn the model.

    Parameters
    ----------
    sentences : sequence of token lists
    weights : sequence of (N, keyframes, K) arrays
        Captured weights at :data:`FRACTIONS` of each token. Rows of silences are ignored, and so are rows with NaN:
        tokens that were not captured, but stand beside others. Letters without a gesture (h) teach nothing: one
        speaker's stood before w alone, and looked like it.

    Raises
    ------
    UsageError
        If there is no spoken token, or shapes do not fit.
    """
    goals: list[Array] = []
    column_of: dict[str, int] = {}
    columns, values, ends = array("i"), array("d"), array("i", [0])  # not lists: some 250 features a token
    for tokens, captured in zip(sentences, weights, strict=True):
        for index, token in enumerate(tokens):
            if token.name == SILENCE or not ways(token.heard[0]) or np.isnan(captured[index]).any():
                continue
            named = features(tokens, index)
            columns.extend(column_of.setdefault(name, len(column_of)) for name in named)
            values.extend(named.values())
            ends.append(len(columns))
            goals.append(captured[index])
    if not goals:
        raise UsageError("sentences: got no spoken phone, expected some")
    goal = np.stack(goals)
    seen = np.bincount(columns, minlength=len(column_of))
    names = sorted(name for name, column in column_of.items() if seen[column] >= min(MIN_TOKENS, len(goals)))
    design = csr_array((values, columns, ends), shape=(len(goals), len(column_of)))
    design = design[:, [column_of[name] for name in names]]
    normal = np.empty((len(names), len(names)), order="F")
    for start in range(0, len(names), BLOCK):  # as a sparse matrix it would be larger than as a full one
        part = slice(start, start + BLOCK)
        normal[:, part] = (design.T @ design[:, part]).toarray()
    normal[np.diag_indices_from(normal)] += [_penalty(name) for name in names]
    coefficients = solve(normal, design.T @ goal.reshape(len(goal), -1), assume_a="pos", overwrite_a=True)
    shape = (len(names), *goal.shape[1:])
    return add_unheard(
        ContextModel(fractions=FRACTIONS, features=tuple(names), coefficients=coefficients.reshape(shape))
    )


def _penalty(name: str) -> float:
    kind, *rest = name.split(" ")
    by_distance = PENALTIES[kind]
    return by_distance[abs(int(rest[0]))] if len(by_distance) > 1 else by_distance[0]
