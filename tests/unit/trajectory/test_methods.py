"""Ways to a path: none swings far beyond its keys, and none is quadratic in the length."""

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.speaking import Method
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.methods import OVERSHOOT, SPLINES, as_published, dominance
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from fapengine.trajectory.targets import Keyframes, SpeechKeys, keys_of

KEYS = st.lists(
    st.tuples(st.sampled_from([0.012, 0.03, 0.1, 0.3, 2.0, 60.0]), st.floats(-5, 5)), min_size=2, max_size=9
)


def spoken(lengths_s: list[float], rng: np.random.Generator) -> SpeechKeys:
    """One key in the middle of each phone."""
    phones = [Phone("a", float(a), float(b)) for a, b in itertools.pairwise(np.cumsum([0.2, *lengths_s]))]
    middles, targets = (
        np.array([(phone.start_s + phone.end_s) / 2 for phone in phones]),
        rng.normal(size=(len(phones), 3)),
    )
    said = [[(phone, "none") for phone in phones]]
    return SpeechKeys(said, np.arange(len(phones)), middles, targets, [], Counter())


def keyframes(times_s: np.ndarray, values: np.ndarray) -> Keyframes:
    return Keyframes(times_s, values, np.zeros(len(times_s), np.intp))


@pytest.mark.parametrize("method", ["context", "paper", "minimum-jerk"])
@given(KEYS)
@settings(max_examples=30)
def test_overshoot_is_half_of_the_range_of_four_keys_at_most(method: Method, keys: list[tuple[float, float]]) -> None:
    values = np.array([0.0, *(value for _, value in keys), 0.0])[:, None]
    frames = keyframes(np.cumsum([0.0, *(step for step, _ in keys), 0.1]), values)
    for index in range(len(values) - 1):
        times = np.linspace(frames.times_s[index], frames.times_s[index + 1], 60)
        path = SPLINES[method](frames, times)
        four = values[max(index - 1, 0) : index + 3]
        room = OVERSHOOT * np.ptp(four) + 1e-6
        assert four.min() - room <= path.min()
        assert path.max() <= four.max() + room
        np.testing.assert_allclose(path[[0, -1]], values[index : index + 2], atol=1e-6)  # keys are met all the same


@pytest.mark.parametrize(("method", "power"), [("context", 3), ("paper", 2), ("minimum-jerk", 3)])
def test_a_path_starts_from_rest_and_ends_at_rest(method: Method, power: int) -> None:
    """It moves with the square of the time, or with its cube where the acceleration begins at 0 too."""
    values = np.random.default_rng(1).normal(size=(9, 4))
    values[[0, -1]] = 0.0
    frames = keyframes(np.arange(9) * 0.1, values)
    for edge_s, way in ((0.0, 1), (0.8, -1)):
        once, twice = np.abs(SPLINES[method](frames, edge_s + way * np.array([0.001, 0.002])))
        np.testing.assert_allclose(np.log2(twice / once), power, atol=0.2)


def test_a_spline_through_even_keys_is_left_alone() -> None:
    values = np.sin(0.7 * np.arange(30))[:, None] * np.sin(np.pi * np.arange(30) / 29)[:, None]
    frames, times = keyframes(np.arange(30) * 0.05, values), np.linspace(0, 1.45, 400)
    spline = CubicSpline(frames.times_s, values, bc_type="clamped")
    np.testing.assert_array_equal(SPLINES["paper"](frames, times), spline(times))


@given(st.lists(st.sampled_from([0.01, 0.08, 0.3, 2.0]), min_size=1, max_size=12), st.integers(0, 99))
@settings(max_examples=30)
def test_dominance_is_the_mean_of_all_targets_weighed_by_their_distance(lengths_s: list[float], seed: int) -> None:
    keys = spoken(lengths_s, np.random.default_rng(seed))
    end_s = keys.said[0][-1][0].end_s
    centres = np.array([0.2, *keys.times_s, end_s])
    targets = np.concatenate([np.zeros((1, 3)), keys.targets, np.zeros((1, 3))])
    times = np.linspace(-0.3, end_s + 0.5, 80)
    weights = np.exp(-20.0 * np.abs(times[:, None] - centres))
    np.testing.assert_allclose(dominance(keys, times), weights @ targets / weights.sum(axis=1)[:, None], atol=1e-9)


def test_dominance_survives_a_phone_of_minutes() -> None:
    keys = spoken([0.1, 300.0, 0.1], np.random.default_rng(1))
    path = dominance(keys, np.linspace(0, 301, 2000))
    assert np.isfinite(path).all()
    np.testing.assert_allclose(dominance(keys, np.array([150.3])), keys.targets[1:2], atol=1e-9)


def test_paper_001_as_published_meets_one_key_per_phone_and_closes_no_lips() -> None:
    """At 30 % of each phone the face is the phone's median, whatever the lips do; ``paper`` closes them in b and p."""
    profile = load_profile("grid_s1_en")
    labels = ["b", "aɪ", "p", "oʊ", "m", "i"]
    phones = PhoneTrack.from_phones([Phone(label, 0.2 + 0.1 * n, 0.3 + 0.1 * n) for n, label in enumerate(labels)])
    assert len(keys_of(phones, as_published(profile), context=False).times_s) == len(labels)
    faps = {
        method: plan(
            phones, profile, rng=np.random.default_rng(0), rate_hz=100.0, style=Style.speech_only(method=method)
        )
        for method in ("published", "paper")
    }
    at_keys = [round(100 * (0.2 + 0.1 * n + 0.03)) for n in range(len(labels))]
    medians = np.stack([profile.phones[label].targets[0] for label in labels])
    space = profile.space
    expected = displacements_to_faps(space.to_points_mm(medians), space.points, profile.fapu)
    jaw, upper, lower = (fap.column(number) for number in (3, 4, 5))
    shown = faps["published"].track.values[at_keys]
    np.testing.assert_allclose(shown[:, [jaw, upper, lower]], expected[:, [jaw, upper, lower]], atol=1.0)
    opening = {method: -plan.track.values[at_keys][:, [upper, lower]].sum(axis=1) for method, plan in faps.items()}
    assert opening["published"][[0, 2, 4]].max() > 30  # FAPU: over 1 mm
    assert opening["paper"][[0, 2, 4]].max() <= 1
