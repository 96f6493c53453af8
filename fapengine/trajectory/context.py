"""Targets of a phone between its neighbours: they depend on context, learned by least squares.

Theory of operation
-------------------
A phone's targets at a few fractions of its duration are a sum over *features* of the phone and of three neighbours
to either side: which phone stands there, how it is articulated (lips, rounding, opening, place ...), which two stand
beside each other, how long they last. Ridge regression finds what each feature adds; the rarer and the farther a
feature, the more it is shrunk. A phone or a pair that was never heard has no feature of its own, so its articulation
speaks for it, and it stays near its likes.

Measured on held-out sentences of one speaker (``bench/fidelity``), this is what lets lips foresee: the same /s/ is
round before /u/ and spread before /i/.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from fapengine.errors import UsageError
from fapengine.profiles import ContextModel
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

Array = NDArray[np.float64]

FRACTIONS = (0.2, 0.7)
"""Fractions of a phone's duration at which its keyframes stand; splines through captured values there are within 0.35
mm of the captured lips (through those at 30 % alone, 0.79)."""
REACH = 3
"""Neighbours to either side."""
TYPICAL_S, MIN_DURATION_S, MAX_DURATION_S = 0.1, 0.03, 0.4
"""Durations count as their logarithm against the first, cut at the others. The longest that was captured is 0.35 s; a
vowel that is held for a minute opened the mouth by 33 mm when its length went on to count."""
PAUSE_S = 0.3
"""Length of every silence as a neighbour, so that when speech began does not matter to its targets."""
PENALTIES = {"bias": 0.03, "phone": 1.0, "way": 3.0, "length": 3.0, "beside": 3.0, "pair": 6.0}
"""Ridge of each kind of feature, found by cross-validation within the training sentences; neighbours at distance 2 and
3 are shrunk by 2 and 4."""


LABELS = 4096
"""Remembered; a sender may make up any number."""
Part = tuple[str, tuple[str, ...]]
"""Name in the profile, and the IPA letters as they were spoken."""


class Token(NamedTuple):
    """A phone, or a part of one, under a name that the profile knows."""

    phone: Phone
    name: str
    """Name in the profile, or :data:`SILENCE`."""
    heard: tuple[str, ...]
    """IPA letters as they were spoken; the profile may know only their likes."""
    start_s: float
    end_s: float


def tokens_of(track: PhoneTrack, known: Mapping[str, object]) -> tuple[list[Token], list[str]]:
    """Take a track apart into what a profile knows.

    A label that it lacks is split into letters that share the time, each under the name of its likest.

    Returns
    -------
    tokens : list of Token
    strange : list of str
        Labels that are no IPA; the neutral vowel stands in.
    """
    parts_of = _speller(tuple(known))
    tokens, strange = [], []
    for phone in track.phones:
        start_s, end_s = phone.start_s, phone.end_s
        if phone.is_silence:
            tokens.append(Token(phone, SILENCE, (), start_s, end_s))
            continue
        parts, is_strange = parts_of(phone.label)
        if is_strange:
            strange.append(phone.label)
        if len(parts) == 1:
            tokens.append(Token(phone, *parts[0], start_s, end_s))
            continue
        share = (end_s - start_s) / len(parts)
        for index, (name, heard) in enumerate(parts):
            tokens.append(Token(phone, name, heard, start_s + index * share, start_s + (index + 1) * share))
    return tokens, strange


@lru_cache(maxsize=16)
def _speller(known: tuple[str, ...]) -> Callable[[str], tuple[tuple[Part, ...], bool]]:
    """Make what takes a label apart into known names, and tells whether it is no IPA; it remembers what it has met."""
    letters_known = tuple(name for name in known if len(name) == 1)

    @lru_cache(maxsize=LABELS)
    def parts_of(label: str) -> tuple[tuple[Part, ...], bool]:
        spelled = ipa.letters(label)
        letters = spelled or ("ə",)
        whole = "".join(letters)
        if whole in known:
            return ((whole, letters),), not spelled
        return tuple((ipa.nearest(letter, letters_known), (letter,)) for letter in letters), not spelled

    return parts_of


def features(tokens: Sequence[Token], index: int) -> dict[str, float]:
    """Describe one token between its neighbours: feature names and values."""
    around = [_neighbour(tokens, index + step) for step in range(-REACH, REACH + 1)]
    name = tokens[index].name
    length = _length(tokens[index].end_s - tokens[index].start_s)
    features = {"bias": 1.0, f"phone {name}": 1.0, "length 0": length, f"phone {name} length": length}
    for step, (other, heard, duration_s) in zip(range(-REACH, REACH + 1), around, strict=True):
        for way, value in _articulation(heard).items():
            features[f"way {step} {way}"] = value
        if step:
            features[f"beside {step} {other}"] = 1.0
            if abs(step) < REACH:
                features[f"length {step}"] = _length(duration_s)
    features[f"pair {around[REACH - 1][0]} {name}"] = 1.0
    features[f"pair {name} {around[REACH + 1][0]} next"] = 1.0
    return features


def _neighbour(tokens: Sequence[Token], index: int) -> tuple[str, tuple[str, ...], float]:
    if not 0 <= index < len(tokens) or tokens[index].name == SILENCE:
        return SILENCE, (), PAUSE_S
    return tokens[index].name, tokens[index].heard, tokens[index].end_s - tokens[index].start_s


def _length(duration_s: float) -> float:
    return float(np.log(min(max(duration_s, MIN_DURATION_S), MAX_DURATION_S) / TYPICAL_S))


def _articulation(heard: tuple[str, ...]) -> dict[str, float]:
    if not heard:
        return {"silent": 1.0}
    first, last = ipa.SOUNDS[heard[0]], ipa.SOUNDS[heard[-1]]
    ways = {
        "lips": first.lips, "rounding": (first.rounding + last.rounding) / 2, "opening": first.opening,
        "opening at the end": last.opening, "vowel": first.vowel, "place": first.place, "manner": first.manner,
    }  # fmt: skip
    return {way: float(value) for way, value in ways.items() if value}


def targets(tokens: Sequence[Token], model: ContextModel) -> Array:
    """Weights at the model's fractions of every token: (N, keyframes, K); features that it lacks add nothing.

    The sum of what :func:`features` names, but summed beforehand for each kind of token: a stream asks this whenever a
    phone comes.
    """
    tables = _tables(model)
    around = [tables.silence] * REACH + [tables.kind(token) for token in tokens] + [tables.silence] * REACH
    durations = [PAUSE_S if token.name == SILENCE else token.end_s - token.start_s for token in tokens]
    lengths = np.full(len(around), PAUSE_S)
    lengths[REACH : len(around) - REACH] = durations
    lengths = np.log(np.clip(lengths, MIN_DURATION_S, MAX_DURATION_S) / TYPICAL_S)
    kinds = np.array(around)
    spoken = [index for index, token in enumerate(tokens) if token.name != SILENCE]
    own = np.array(spoken, dtype=np.intp) + REACH
    total = tables.pairs(around, [index + REACH for index in spoken])
    total += lengths[own, None] * tables.by_length[kinds[own]]
    total += lengths[own[:, None] + _BESIDE] @ tables.lengths_beside
    for step in range(-REACH, REACH + 1):
        total += tables.by_step[kinds[own + step], step + REACH]
    targets = np.zeros((len(tokens), *model.coefficients.shape[1:]))
    targets[spoken] = total.reshape(len(spoken), *targets.shape[1:])
    return targets


_BESIDE = np.array([step for step in range(-REACH, REACH + 1) if step and abs(step) < REACH])
"""Steps to the neighbours whose lengths count."""


class _Tables:
    """Sums for every kind of token that was met: what it adds to its own targets and to its neighbours'.

    Stateful: it grows.
    """

    def __init__(self, model: ContextModel) -> None:
        flat = model.coefficients.reshape(len(model.features), -1)
        self.coefficients = np.vstack([flat, np.zeros(flat.shape[1])])
        """(F + 1, D); the last row is for features that the model lacks."""
        self.by_step = np.zeros((0, 2 * REACH + 1, flat.shape[1]))
        """(kinds, steps, D): as the neighbour at each step, and in the middle as the token itself."""
        self.by_length = np.zeros((0, flat.shape[1]))
        """(kinds, D), per length of the token itself."""
        self._rows = model.rows
        self.lengths_beside = self.coefficients[[self.row(f"length {step}") for step in _BESIDE]]
        """(steps, D), per length of the neighbour at each of :data:`_BESIDE`."""
        self._names: list[str] = []
        self._kinds: dict[tuple[str, tuple[str, ...]], int] = {}
        self._pairs: dict[tuple[int, int], tuple[int, int]] = {}
        self.silence = self._kind(SILENCE, ())

    def row(self, feature: str) -> int:
        return self._rows.get(feature, len(self.coefficients) - 1)

    def kind(self, token: Token) -> int:
        return self.silence if token.name == SILENCE else self._kind(token.name, token.heard)

    def pairs(self, kinds: Sequence[int], own: Sequence[int]) -> Array:
        """(N, D): what tokens at ``own`` get from standing beside each other."""
        before = [self._pair(kinds[at - 1], kinds[at])[0] for at in own]
        behind = [self._pair(kinds[at], kinds[at + 1])[1] for at in own]
        total: Array = self.coefficients[before] + self.coefficients[behind]
        return total

    def _pair(self, first: int, second: int) -> tuple[int, int]:
        if (first, second) not in self._pairs:
            text = f"pair {self._names[first]} {self._names[second]}"
            self._pairs[first, second] = self.row(text), self.row(f"{text} next")
        return self._pairs[first, second]

    def _kind(self, name: str, heard: tuple[str, ...]) -> int:
        if (name, heard) not in self._kinds:
            self._kinds[name, heard] = len(self._names)
            self._names.append(name)
            steps = [self._sum(step, name, heard) for step in range(-REACH, REACH + 1)]
            length = self.coefficients[[self.row("length 0"), self.row(f"phone {name} length")]].sum(axis=0)
            self.by_step = np.concatenate([self.by_step, [steps]])
            self.by_length = np.concatenate([self.by_length, [length]])
        return self._kinds[name, heard]

    def _sum(self, step: int, name: str, heard: tuple[str, ...]) -> Array:
        values = {f"way {step} {way}": value for way, value in _articulation(heard).items()}
        values |= {f"beside {step} {name}": 1.0} if step else {"bias": 1.0, f"phone {name}": 1.0}
        total: Array = np.array(list(values.values())) @ self.coefficients[[self.row(feature) for feature in values]]
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
        Captured weights at :data:`FRACTIONS` of each token; rows of silences are ignored.

    Raises
    ------
    UsageError
        If there is no spoken token, or shapes do not fit.
    """
    described = [
        features(tokens, index) for tokens in sentences for index, token in enumerate(tokens) if token.name != SILENCE
    ]
    goal = [
        values[index]
        for tokens, values in zip(sentences, weights, strict=True)
        for index, token in enumerate(tokens)
        if token.name != SILENCE
    ]
    if not described:
        raise UsageError("sentences: got no spoken phone, expected some")
    y = np.stack(goal).reshape(len(goal), -1)
    names = sorted({name for token in described for name in token})
    column_of = {name: index for index, name in enumerate(names)}
    rows = np.repeat(np.arange(len(described)), [len(token) for token in described])
    columns = np.array([column_of[name] for token in described for name in token])
    values = np.array([value for token in described for value in token.values()])
    design = csr_array((values, (rows, columns)), shape=(len(described), len(names)))
    normal = (design.T @ design).toarray()
    normal[np.diag_indices_from(normal)] += [_penalty(name) for name in names]
    coefficients = np.linalg.solve(normal, design.T @ y).reshape(len(names), *goal[0].shape)
    return ContextModel(fractions=FRACTIONS, features=tuple(names), coefficients=coefficients)


def _penalty(name: str) -> float:
    kind, *rest = name.split(" ")
    distance = abs(int(rest[0])) if kind in ("way", "beside") else 1
    return PENALTIES[kind] * 2.0 ** max(distance - 1, 0)
