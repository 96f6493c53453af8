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

Lips foresee by this: the same /s/ is round before /u/ and spread before /i/. What has no gesture of its own, h and its
like, takes the shape of what follows (:data:`NEXT_FROM`).
"""

from array import array
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.profiles import ContextModel
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE
from fapengine.trajectory.context_features import (
    GESTURELESS,
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
    part_at,
    parts_of,
    tripled,
    ways,
)  # fmt: skip
from fapengine.trajectory.tokens import Token
from fapengine.trajectory.unheard import add_unheard

Array = NDArray[np.float64]
Number = TypeVar("Number", int, NDArray[np.intp])

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
SENTENCE = 6.0
"""Ridge of what is a sentence's own, an offset of the whole face and its drift: no timing tells them (none of their
variance in other sentences), and phones need not bend to them. 3 and 10 measure the same."""
MIN_TOKENS = 3
"""Tokens that a feature must be seen in; what is rarer is luck."""
NEXT_FROM = 0.65
"""Share of the next letter in the first keyframe of h and its like, which have no gesture of their own; the rest is how
the one before ends. In the last keyframe it is all."""
BLOCK = 256
"""Columns of the normal matrix that are computed at a time."""
FIRST_PAIRS = 64
"""Rows that tables begin with; they double when they are full."""
KIND_RADIX = 1 << 20
"""Kinds of tokens that three of make one number; labels are remembered up to 4,096 (:data:`.tokens.LABELS`)."""


def targets(tokens: Sequence[Token], model: ContextModel) -> Array:
    """Weights at the model's fractions of every token: (N, keyframes, K); features that it lacks add nothing.

    The sum of what :func:`.context_features.features` names, but of h and its like, summed beforehand for each kind of
    token: a stream asks this whenever a phone comes.
    """
    tables = tables_of(model)
    beyond = [tables.silence] * REACH
    around = np.array([*beyond, *(tables.kind(token.heard) for token in tokens), *beyond])
    lengths_s = np.full(len(around), PAUSE_S)
    lengths_s[REACH : len(around) - REACH] = [
        PAUSE_S if token.name == SILENCE else token.end_s - token.start_s for token in tokens
    ]
    spoken = [index for index, token in enumerate(tokens) if token.name != SILENCE]
    found = np.zeros((len(tokens), *model.coefficients.shape[1:]))
    found[spoken] = tables.targets(around, lengths_s, np.array(spoken, dtype=np.intp) + REACH)
    return found


def heard_as_here(tokens: Sequence[Token], model: ContextModel) -> list[bool]:
    """Tell of every token whether the recorded speaker said it between the same two neighbours."""
    around = ((part_at(tokens, n - 1, -1), parts_of(token.heard)[0], part_at(tokens, n + 1, 1))
              for n, token in enumerate(tokens))  # fmt: skip
    return [model.rows.keys() >= tripled(*three).keys() for three in around]


_LENGTHS = np.array(LENGTHS)


class ContextTables:
    """Sums for every kind of token that was met: what it adds to its own targets and to its neighbours'.

    Stateful: it grows, up to the square of the number of IPA's letters.
    """

    def __init__(self, model: ContextModel) -> None:
        self._shape = model.coefficients.shape[1:]
        flat = model.coefficients.reshape(len(model.features), -1)
        self._coefficients = np.vstack([flat, np.zeros(flat.shape[1])])
        """(F + 1, D); the last row is for features that the model lacks."""
        self._rows = model.rows
        self._lengths_beside = np.stack([self._sum({f"length {step}": 1.0}) for step in LENGTHS])
        """(steps, D), per length of the neighbour at each of :data:`LENGTHS`."""
        self._by_step = np.zeros((0, 2 * REACH + 1, flat.shape[1]))
        """(kinds, steps, D): as the neighbour at each step, and in the middle as the token itself."""
        self._by_length = np.zeros((0, flat.shape[1]))
        """(kinds, D), per length of the token itself."""
        self._idle = np.zeros(0, bool)
        """(kinds,): which have no gesture of their own."""
        self._parts: list[tuple[Part, Part]] = []
        self._kinds: dict[tuple[str, ...], int] = {}
        self._pairs = np.full((FIRST_PAIRS, FIRST_PAIRS), -1)
        """(kinds, kinds): row in ``_pair_sums``, -1 before the two have met."""
        self._met = 0
        """Count of the rows of ``_pair_sums`` that are in use."""
        self._pair_sums = np.zeros((FIRST_PAIRS, 2, flat.shape[1]))
        self.silence = self.kind(())
        triples = [name.split(" ")[1:] for name in model.features if name.startswith("triple ")]
        self._codes = np.array(sorted((self._code(*map(self._named, names)), self._rows[" ".join(["triple", *names])])
                                      for names in triples), dtype=np.int64).reshape(-1, 2)  # fmt: skip
        """(triples, 2): three kinds as one number, rising, and the row of their coefficients."""

    def kind(self, heard: tuple[str, ...]) -> int:
        """Give the number of a token's letters; of none, that of silence."""
        known = self._kinds.get(heard)
        return self._new_kind(heard) if known is None else known

    def targets(self, around: NDArray[np.intp], lengths_s: Array, own: NDArray[np.intp]) -> Array:
        """Targets of tokens between their neighbours.

        Parameters
        ----------
        around : (T,) int
            Kinds of tokens, in order, those of any number of tracks; three silences before and behind each track.
        lengths_s : (T,) float64, s
            Of silences :data:`.context_features.PAUSE_S`.
        own : (N,) int
            Places of the tokens that are asked for, none of them silences.

        Returns
        -------
        (N, keyframes, K) float64
        """
        lengths = np.log(np.clip(lengths_s, MIN_DURATION_S, MAX_DURATION_S) / TYPICAL_S)
        found = self._sums(around, lengths, own, range(-REACH, REACH + 1))
        idle = np.flatnonzero(self._idle[around[own]])
        if len(idle):
            found[idle] = self._between(found[idle], around, lengths, own[idle])
        return found

    def _sums(self, around: NDArray[np.intp], lengths: Array, own: NDArray[np.intp], steps: range) -> Array:
        """(N, keyframes, K): what every feature adds, of neighbours at ``steps``; in place of the others is silence."""
        total = self._near(around, own)
        total += lengths[own, None] * self._by_length[around[own]]
        total += lengths[own[:, None] + _LENGTHS] @ self._lengths_beside
        for step in range(-REACH, REACH + 1):
            total += self._by_step[around[own + step] if step in steps else self.silence, step + REACH]
        return total.reshape(len(own), *self._shape)

    def _between(self, alone: Array, around: NDArray[np.intp], lengths: Array, own: NDArray[np.intp]) -> Array:
        """(N, keyframes, K): tokens without a gesture, which go from how the one before ends to how the next begins.

        None sees more of the track than other tokens do. ``alone`` is taken where neither neighbour has a gesture.
        """
        shares = np.linspace(NEXT_FROM, 1.0, self._shape[0])[:, None]
        goes = ~self._idle
        goes[self.silence] = False
        led, leads = goes[around[own - 1]][:, None, None], goes[around[own + 1]][:, None, None]
        before = self._sums(around, lengths, own - 1, range(1 - REACH, REACH + 1))[:, -1:]
        behind = self._sums(around, lengths, own + 1, range(-REACH, REACH))[:, :1]
        both = (1.0 - shares) * before + shares * behind
        either = np.where(led & leads, both, np.where(leads, behind, before))
        found: Array = np.where(led | leads, either, alone)
        return found

    def _near(self, kinds: NDArray[np.intp], own: NDArray[np.intp]) -> Array:
        """(N, D): what tokens at ``own`` get from who stands right beside them."""
        before, mine, behind = kinds[own - 1], kinds[own], kinds[own + 1]
        pairs = self._pair_rows(before, mine), self._pair_rows(mine, behind)
        total: Array = self._pair_sums[pairs[0], 0]
        total += self._pair_sums[pairs[1], 1]
        heard, rows = self._triples(before, mine, behind)
        total[heard] += self._coefficients[rows]
        return total

    def heard_as_here(self, around: NDArray[np.intp], own: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(N,): as :func:`heard_as_here`, of tokens as :meth:`targets` takes them."""
        found = np.zeros(len(own), bool)
        found[self._triples(around[own - 1], around[own], around[own + 1])[0]] = True
        return found

    def _triples(
        self, before: NDArray[np.intp], mine: NDArray[np.intp], behind: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Which of three kinds beside each other were heard so, and the rows of their coefficients."""
        if not len(self._codes):
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        codes = self._code(before, mine, behind)
        at = np.minimum(np.searchsorted(self._codes[:, 0], codes), len(self._codes) - 1)
        heard = np.flatnonzero(self._codes[at, 0] == codes)
        return heard, self._codes[at[heard], 1]

    def _pair_rows(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.intp]:
        rows = self._pairs[first, second]
        for index in np.flatnonzero(rows < 0).tolist():
            rows[index] = self._pair(int(first[index]), int(second[index]))
        return rows

    def _pair(self, first: int, second: int) -> int:
        row = int(self._pairs[first, second])
        if row < 0:
            row = self._pairs[first, second] = self._met
            self._met += 1
            if row == len(self._pair_sums):
                self._pair_sums = np.concatenate([self._pair_sums, np.zeros_like(self._pair_sums)])
            one, other = self._parts[first][1], self._parts[second][0]
            self._pair_sums[row] = self._sum(paired(other, -1, one)), self._sum(paired(one, 1, other))
        return row

    def _new_kind(self, heard: tuple[str, ...]) -> int:
        first, last = parts_of(heard)
        kind = self._kinds[heard] = len(self._parts)
        self._parts.append((first, last))
        if kind == len(self._pairs):
            self._pairs = np.pad(self._pairs, (0, kind), constant_values=-1)
        steps = [
            self._sum(beside(step, last if step < 0 else first) if step else alone(first))
            for step in range(-REACH, REACH + 1)
        ]
        self._idle = np.append(self._idle, bool(heard) and GESTURELESS.issuperset(heard))
        self._by_step = np.concatenate([self._by_step, [steps]])
        self._by_length = np.concatenate([self._by_length, [self._sum(lengthened(first))]])
        return kind

    def _named(self, name: str) -> int:
        return self.kind(() if name == SILENCE else ipa.letters(name))

    @staticmethod
    def _code(first: Number, second: Number, third: Number) -> Number:
        return (first * KIND_RADIX + second) * KIND_RADIX + third

    def _sum(self, named: Mapping[str, float]) -> Array:
        rows = [self._rows.get(name, -1) for name in named]
        total: Array = np.array(list(named.values())) @ self._coefficients[rows]
        return total


@lru_cache(maxsize=16)
def tables_of(model: ContextModel) -> ContextTables:
    """Give a model its tables, which all who plan by it share."""
    return ContextTables(model)


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
    said: list[tuple[int, float]] = []
    column_of: dict[str, int] = {}
    columns, values, ends = array("i"), array("d"), array("i", [0])  # not lists: some 250 features a token
    for sentence, (tokens, captured) in enumerate(zip(sentences, weights, strict=True)):
        for index, token in enumerate(tokens):
            if token.name == SILENCE or not ways(token.heard[0]) or np.isnan(captured[index]).any():
                continue
            named = features(tokens, index)
            columns.extend(column_of.setdefault(name, len(column_of)) for name in named)
            values.extend(named.values())
            ends.append(len(columns))
            goals.append(captured[index])
            said.append((sentence, token.start_s))
    if not goals:
        raise UsageError("sentences: got no spoken phone, expected some")
    from scipy.linalg import solve  # only fitting needs them: planning starts without
    from scipy.sparse import csr_array

    goal = np.stack(goals).reshape(len(goals), -1)
    seen = np.bincount(columns, minlength=len(column_of))
    names = sorted(name for name, column in column_of.items() if seen[column] >= min(MIN_TOKENS, len(goals)))
    design = csr_array((values, columns, ends), shape=(len(goals), len(column_of)))
    design = design[:, [column_of[name] for name in names]]
    own = csr_array(_of_sentences(said))
    shared = own.T @ design
    normal = np.empty((len(names), len(names)), order="F")
    for start in range(0, len(names), BLOCK):  # as a sparse matrix it would be larger than as a full one
        part = slice(start, start + BLOCK)
        normal[:, part] = (design.T @ design[:, part]).toarray() - (shared.T @ shared[:, part]).toarray()
    normal[np.diag_indices_from(normal)] += [_penalty(name) for name in names]
    coefficients = solve(normal, design.T @ goal - shared.T @ (own.T @ goal), assume_a="pos", overwrite_a=True)
    shape = (len(names), *goals[0].shape)
    return add_unheard(
        ContextModel(fractions=FRACTIONS, features=tuple(names), coefficients=coefficients.reshape(shape))
    )


def _of_sentences(said: Sequence[tuple[int, float]]) -> tuple[Array, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Values, rows and columns of what is a sentence's own, for tokens of ``(sentence, time in s)``.

    A column of ones and one of times from their mean for each sentence, orthogonal, so that ridge regression on them
    beside others is what their products, divided by their sums of squares and :data:`SENTENCE`, take from the others'.
    """
    sentences, times_s = np.array(said).T
    _, sentence, count = np.unique(sentences, return_inverse=True, return_counts=True)
    drift = times_s - (np.bincount(sentence, times_s) / count)[sentence]
    ones = 1.0 / np.sqrt(count + SENTENCE)
    slopes = 1.0 / np.sqrt(np.bincount(sentence, drift**2) + SENTENCE)
    values = np.concatenate([ones[sentence], slopes[sentence] * drift])
    tokens = np.arange(len(sentence))
    return values, (np.concatenate([tokens, tokens]), np.concatenate([sentence, sentence + len(count)]))


def _penalty(name: str) -> float:
    kind, *rest = name.split(" ")
    by_distance = PENALTIES[kind]
    return by_distance[abs(int(rest[0]))] if len(by_distance) > 1 else by_distance[0]
