"""Test sets: means over utterances with bootstrap intervals, and paired tests of two systems.

The unit of resampling is the utterance: frames of one sentence depend on each other. Intervals are percentiles of means
over resampled utterances (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapters 13 and 14).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError

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
