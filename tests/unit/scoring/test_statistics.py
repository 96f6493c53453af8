"""Intervals and paired tests: known answers, and an interval that holds what it promises."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.scoring.statistics import compare, estimate, share_test


def test_a_mean_is_weighted_and_its_interval_is_that_of_resampling() -> None:
    found = estimate([0.0, 1.0], [1.0, 3.0])
    assert (found.mean, found.count) == (0.75, 2)
    assert (found.low, found.high) == (0.0, 1.0)  # a quarter of the draws take one utterance twice
    one = estimate([2.0])
    assert (one.mean, one.low, one.high) == (2.0, None, None)
    same = estimate([3.0] * 5)
    assert (same.low, same.high) == (3.0, 3.0)


def test_an_interval_of_a_large_sample_is_the_normal_one() -> None:
    values = np.random.default_rng(2).normal(10.0, 2.0, 400)
    found = estimate(values)
    half = 1.96 * values.std() / np.sqrt(400)
    assert found.low == pytest.approx(values.mean() - half, abs=0.02)
    assert found.high == pytest.approx(values.mean() + half, abs=0.02)
    assert estimate(values) == found
    assert estimate(values, seed=2) != found


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(6)
    held = 0
    for _ in range(60):
        found = estimate(rng.exponential(1.0, 40))
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 1.0 <= found.high
    assert 50 <= held <= 60  # 57 expected, a little fewer by percentiles of 40


def test_two_systems_are_compared_utterance_by_utterance() -> None:
    base = np.random.default_rng(3).normal(0, 50.0, 12)
    found = compare(base + 1.0 + 0.01 * np.arange(12), base)
    assert found.difference.mean == pytest.approx(1.055)
    assert found.difference.low == pytest.approx(1.035, abs=0.01)
    assert found.p == pytest.approx(2 / 2**12)  # all 12 signs are the same
    assert compare(base, base).p == 1.0
    assert compare([1.0, -1.0], [0.0, 0.0]).p == 1.0


def test_what_cannot_be_averaged_is_refused() -> None:
    for values, weights in (([], None), ([1.0], [0.0]), ([1.0], [-1.0])):
        with pytest.raises(UsageError, match="values: got"):
            estimate(values, weights)
    with pytest.raises(UsageError, match="other: got 1 values, expected 2"):
        compare([1.0, 2.0], [1.0])


def test_shares_have_exact_intervals() -> None:
    low, high, p = share_test(8, 10)
    assert (low, high) == pytest.approx((0.4439, 0.9748), abs=1e-4)
    assert p == pytest.approx(2 * (45 + 10 + 1) / 1024)
