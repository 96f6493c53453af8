"""Ways to a path: none swings far beyond its keys, and none is quadratic in the length."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.speaking import Method
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.methods import OVERSHOOT, dominance, sample_path
from fapengine.trajectory.targets import Keyframes, Resolved

KEYS = st.lists(
    st.tuples(st.sampled_from([0.012, 0.03, 0.1, 0.3, 2.0, 60.0]), st.floats(-5, 5)), min_size=2, max_size=9
)


def resolved(lengths_s: list[float], rng: np.random.Generator) -> list[Resolved]:
    ends = np.cumsum([0.2, *lengths_s])
    return [
        Resolved(Phone("a", float(a), float(b)), (float(a + b) / 2,), rng.normal(size=(1, 3)), "none")
        for a, b in itertools.pairwise(ends)
    ]


@pytest.mark.parametrize("method", ["context", "paper", "minimum-jerk"])
@given(KEYS)
@settings(max_examples=30)
def test_overshoot_is_half_of_the_range_of_four_keys_at_most(method: Method, keys: list[tuple[float, float]]) -> None:
    values = np.array([0.0, *(value for _, value in keys), 0.0])[:, None]
    frames = Keyframes(np.cumsum([0.0, *(step for step, _ in keys), 0.1]), values)
    anything = resolved([0.1], np.random.default_rng(1))
    for index in range(len(values) - 1):
        times = np.linspace(frames.times_s[index], frames.times_s[index + 1], 60)
        path = sample_path(method, anything, frames, times)
        four = values[max(index - 1, 0) : index + 3]
        room = OVERSHOOT * np.ptp(four) + 1e-6
        assert four.min() - room <= path.min()
        assert path.max() <= four.max() + room
        np.testing.assert_allclose(path[[0, -1]], values[index : index + 2], atol=1e-6)  # keys are met all the same


def test_a_spline_through_even_keys_is_left_alone() -> None:
    values = np.sin(0.7 * np.arange(30))[:, None] * np.sin(np.pi * np.arange(30) / 29)[:, None]
    frames, times = Keyframes(np.arange(30) * 0.05, values), np.linspace(0, 1.45, 400)
    anything = resolved([0.1], np.random.default_rng(2))
    np.testing.assert_array_equal(sample_path("paper", anything, frames, times), frames.sample(times, cubic=True))


@given(st.lists(st.sampled_from([0.01, 0.08, 0.3, 2.0]), min_size=1, max_size=12), st.integers(0, 99))
@settings(max_examples=30)
def test_dominance_is_the_mean_of_all_targets_weighed_by_their_distance(lengths_s: list[float], seed: int) -> None:
    phones = resolved(lengths_s, np.random.default_rng(seed))
    centres = np.array([0.2, *((one.phone.start_s + one.phone.end_s) / 2 for one in phones), phones[-1].phone.end_s])
    targets = np.concatenate([np.zeros((1, 3)), *(one.targets for one in phones), np.zeros((1, 3))])
    times = np.linspace(-0.3, phones[-1].phone.end_s + 0.5, 80)
    weights = np.exp(-20.0 * np.abs(times[:, None] - centres))
    np.testing.assert_allclose(dominance(phones, times), weights @ targets / weights.sum(axis=1)[:, None], atol=1e-9)


def test_dominance_survives_a_phone_of_minutes() -> None:
    phones = resolved([0.1, 300.0, 0.1], np.random.default_rng(1))
    path = dominance(phones, np.linspace(0, 301, 2000))
    assert np.isfinite(path).all()
    np.testing.assert_allclose(dominance(phones, np.array([150.3])), phones[1].targets, atol=1e-9)
