"""Test sets: means over utterances with bootstrap intervals, and paired tests of two systems.

The unit of resampling is the utterance: frames of one sentence depend on each other. Intervals are percentiles of means
over resampled utterances (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapters 13 and 14).

Answers of a listening test
---------------------------
The page (:mod:`fapengine.app.listening`) shows the same utterance by two systems and asks which fits its speech better.
Attention checks show one film twice, once with a picture that stands still. Who chooses the standing one in more than
a quarter of the checks is left out, and counted.
"""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.errors import DataError, UsageError

DRAWS = 10_000
"""Number of resampled sets."""
MAX_DRAWN = 1 << 20
"""Utterances drawn at once, which bounds memory."""
LEVEL = 0.95
"""Coverage of intervals."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over utterances."""

    mean: float
    low: float | None
    """Lower end of the 95 % interval; None for fewer than two utterances."""
    high: float | None
    count: int
    """Number of utterances."""


@dataclass(frozen=True, slots=True)
class PairedTest:
    """Two systems on the same utterances."""

    difference: Estimate
    """Mean of the first less that of the second."""
    p: float
    """Two-sided p of Wilcoxon's signed-rank test on the differences of the utterances; 1 if none differs."""


def estimate(values: ArrayLike, weights: ArrayLike | None = None, *, seed: int = 1) -> Estimate:
    """Estimate a mean and its 95 % bootstrap interval over utterances.

    Parameters
    ----------
    values : (N,) float64
        One value per utterance, N >= 1.
    weights : (N,) float64, optional
        Weight of each utterance, such as its number of frames; by default all are equal.
    seed : int
        The same seed gives the same interval.

    Returns
    -------
    Estimate
        ``mean``, ``low``, ``high`` in the unit of the values, and ``count``.

    Raises
    ------
    UsageError
        If there is no value, or no weight above 0.

    Examples
    --------
    >>> estimate([1.0, 3.0], [3.0, 1.0]).mean
    1.5
    """
    numbers, shares = _weighted(values, weights)
    return _interval(float(numbers @ shares / shares.sum()), _means(numbers, shares, seed), len(numbers))


def compare(one: ArrayLike, other: ArrayLike, weights: ArrayLike | None = None, *, seed: int = 1) -> PairedTest:
    """Compare two systems on the same utterances.

    Parameters
    ----------
    one, other : (N,) float64
        Values of both systems, utterance by utterance.
    weights, seed
        As of :func:`estimate`; the same draws serve both systems.

    Returns
    -------
    PairedTest
        ``difference``: an :class:`Estimate` of the first less the second; ``p``.

    Raises
    ------
    UsageError
        If lengths differ.
    """
    first, shares = _weighted(one, weights)
    second, _ = _weighted(other, weights)
    if len(first) != len(second):
        raise UsageError(f"other: got {len(second)} values, expected {len(first)}, one for each of the first system's")
    from scipy.stats import wilcoxon

    apart = first - second
    p = float(wilcoxon(apart).pvalue) if apart.any() else 1.0
    mean = float(apart @ shares / shares.sum())
    return PairedTest(_interval(mean, _means(apart, shares, seed), len(apart)), p)


def _weighted(values: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array]:
    numbers = frozen(values, "values", ("N",), np.float64)
    shares = frozen(np.ones(len(numbers)) if weights is None else weights, "weights", (len(numbers),), np.float64)
    if not len(numbers) or (shares < 0).any() or not shares.any():
        raise UsageError(f"values: got {len(numbers)} with weights of {shares.sum():g} in all, expected one or more")
    return numbers, shares


def _means(values: Array, weights: Array, seed: int) -> Array:
    """Means of resampled utterances, up to :data:`DRAWS`: draws without any weight are left out."""
    rng, count, weighted = np.random.default_rng(seed), len(values), values * weights
    sums = []
    for first in range(0, DRAWS, at_once := max(1, MAX_DRAWN // count)):
        drawn = rng.integers(count, size=(min(at_once, DRAWS - first), count))
        sums.append(np.stack([weighted[drawn].sum(axis=1), weights[drawn].sum(axis=1)]))
    total, weight = np.concatenate(sums, axis=1)
    means: Array = total[weight > 0] / weight[weight > 0]
    return means


def _interval(mean: float, means: Array, count: int) -> Estimate:
    if count < 2:
        return Estimate(mean, None, None, count)
    low, high = np.percentile(means, (50 * (1 - LEVEL), 50 * (1 + LEVEL))).tolist()
    return Estimate(mean, low, high, count)


def share_test(successes: int, trials: int) -> tuple[float, float, float]:
    """Exact binomial statistics of a share.

    Returns
    -------
    low, high : float
        95 % interval by Clopper and Pearson (Biometrika 26, 1934), doi:10.1093/biomet/26.4.404.
    p : float
        Two-sided, against equal chances.
    """
    from scipy.stats import binomtest

    found = binomtest(successes, trials)
    interval = found.proportion_ci(LEVEL, method="exact")
    return float(interval.low), float(interval.high), float(found.pvalue)


COLUMNS = ("listener", "seed", "trial", "item", "left", "right", "choice", "seconds", "plays")
"""Columns of the page's CSV; ``left`` and ``right`` are systems, ``choice`` is the side that was chosen."""
MOVING, STILL = "moving", "still"
"""What attention checks have in place of systems."""
MIN_PASSED = 0.75
"""Least share of attention checks that a listener passes; our choice."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One choice of one listener."""

    listener: str
    item: str
    chosen: str
    """System, or :data:`MOVING` or :data:`STILL` in an attention check."""
    other: str
    line: tuple[str, ...] = ()
    """Its row of the table, by which an answer that was saved twice is known."""

    @property
    def is_check(self) -> bool:
        """Whether this is an attention check."""
        return {self.chosen, self.other} == {MOVING, STILL}


@dataclass(frozen=True, slots=True, kw_only=True)
class Preference:
    """Whom the listeners prefer."""

    system: str
    other: str
    chosen: int
    """How often ``system`` was chosen over ``other``."""
    answers: int
    share: float
    """``chosen / answers``."""
    low: float
    """Lower end of its exact 95 % binomial interval."""
    high: float
    p: float
    """Two-sided p of the exact binomial test against equal chances."""
    over_listeners: Estimate
    """The same share, with a bootstrap interval over listeners: answers of one person depend on each other."""
    by_item: Mapping[str, float]
    """Share by utterance."""
    listeners: int
    """Number of listeners that count."""
    excluded: Mapping[str, float]
    """Listeners that were left out, and the share of attention checks that each passed."""


def parse_answers(data: bytes) -> list[Answer]:
    """Read the CSV of a listener, or of several one below the other.

    Raises DataError if it is not such a table (``where`` is the line).
    """
    try:
        rows = list(csv.reader(io.StringIO(data.decode("utf-8-sig")), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"answers: is not a table of UTF-8 text: {error}") from error
    if not rows or tuple(rows[0]) != COLUMNS:
        raise DataError(f"answers: expected the columns {', '.join(COLUMNS)}", where="line 1")
    answers = []
    for line, row in enumerate(rows[1:], 2):
        if not row or tuple(row) == COLUMNS:
            continue
        cells = dict(zip(COLUMNS, row, strict=False))
        if len(row) != len(COLUMNS) or cells["choice"] not in ("left", "right"):
            raise DataError(
                f"answers: got {','.join(row)!r:.80}, expected a choice of left or right", where=f"line {line}"
            )
        other = "right" if cells["choice"] == "left" else "left"
        answers.append(Answer(cells["listener"], cells["item"], cells[cells["choice"]], cells[other], tuple(row)))
    return answers


def preference_of(answers: Iterable[Answer], *, seed: int = 1) -> Preference:
    """Analyse a listening test of two systems. The same row twice is one answer: people save and send files again.

    Raises DataError if there is no answer of a listener that counts, or the answers are not about two systems.
    """
    answers = list(dict.fromkeys(answers))
    checks = [answer for answer in answers if answer.is_check]
    shares = _shares((answer.listener, answer.chosen == MOVING) for answer in checks)
    excluded = {listener: share for listener, (share, _) in shares.items() if share < MIN_PASSED}
    pairs = [answer for answer in answers if not answer.is_check and answer.listener not in excluded]
    systems = sorted({name for answer in pairs for name in (answer.chosen, answer.other)})
    if len(systems) != 2:
        raise DataError(
            f"answers: got {len(pairs)} about {', '.join(systems) or 'no system'} of listeners that count"
            f" ({len(excluded)} left out), expected answers about two systems"
        )
    wins = [answer.chosen == systems[0] for answer in pairs]
    if sum(wins) * 2 < len(wins):
        systems, wins = systems[::-1], [not won for won in wins]
    chosen = sum(wins)
    by_listener = _shares(zip((answer.listener for answer in pairs), wins, strict=True))
    by_item = _shares(zip((answer.item for answer in pairs), wins, strict=True))
    low, high, p = share_test(chosen, len(wins))
    return Preference(
        system=systems[0],
        other=systems[1],
        chosen=chosen,
        answers=len(wins),
        share=chosen / len(wins),
        low=low,
        high=high,
        p=p,
        over_listeners=estimate(*zip(*by_listener.values(), strict=True), seed=seed),
        by_item={item: share for item, (share, _) in by_item.items()},
        listeners=len(by_listener),
        excluded=excluded,
    )


def _shares(pairs: Iterable[tuple[str, bool]]) -> dict[str, tuple[float, int]]:
    """Share of true values, and number of values, by name."""
    values: dict[str, list[bool]] = {}
    for name, value in pairs:
        values.setdefault(name, []).append(value)
    return {name: (sum(each) / len(each), len(each)) for name, each in values.items()}
