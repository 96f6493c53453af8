"""FAPs to blend shapes and back."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fapengine._arrays import read_rows
from fapengine._resources import profile_files
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.profiles import parse_profile
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES, RIDGE, BlendMap, weights_mm
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan

ARKIT = arkit_map()
PLAIN = BlendMap(ARKIT.names, ARKIT.faps)
"""The same shapes, all at no cost: least squares and nothing else."""
VECTORS = Path(__file__).resolve().parents[2] / "vectors"


def shape(**weights: float) -> np.ndarray:
    row = np.zeros(52)
    for name, weight in weights.items():
        row[ARKIT_NAMES.index(name)] = weight
    return row


def speech() -> np.ndarray:
    labels = ["b", "ɹ", "aɪ", "t", "s", "ʌ", "n", "ʃ", "aɪ", "n", "m", "uː", "v", "z", "f", "aɪ", "v", "b", "ɪ", "ɡ"]
    phones = PhoneTrack.from_phones([Phone(label, 0.3 + 0.11 * n, 0.41 + 0.11 * n) for n, label in enumerate(labels)])
    profile = parse_profile(profile_files("grid_s1_en"))
    return plan(phones, profile, rng=np.random.default_rng(0), rate_hz=30).track.values.copy()


@pytest.mark.conformance
def test_costs_are_in_the_order_of_the_names() -> None:
    assert tuple(row[0] for row in read_rows("fapengine.retarget", "arkit_costs.csv")) == ARKIT_NAMES


def test_the_52_names_are_in_the_order_of_live_link_face() -> None:
    assert len(ARKIT_NAMES) == len(set(ARKIT_NAMES)) == 52
    assert (ARKIT_NAMES[0], ARKIT_NAMES[17], ARKIT_NAMES[51]) == ("eyeBlinkLeft", "jawOpen", "tongueOut")
    assert ARKIT_NAMES.index("mouthSmileLeft") == 23
    assert (VECTORS / "arkit_names.txt").read_text().split() == list(ARKIT_NAMES)


@pytest.mark.shared
def test_the_names_are_those_of_the_measured_face(shared) -> None:
    with np.load(shared / "data" / "dense_face.npz") as dense:
        assert tuple(dense["arkit_names"].tolist()) == ARKIT_NAMES
    with (shared / "data" / "markers.csv").open() as file:
        assert sum(row["layout"] == "mpeg4" for row in csv.DictReader(file)) == 74


@pytest.mark.parametrize(
    ("name", "number", "sign"),
    [
        ("jawOpen", 3, 1), ("mouthSmileLeft", 12, 1), ("mouthSmileRight", 13, 1), ("mouthFrownLeft", 12, -1),
        ("eyeBlinkLeft", 19, 1), ("eyeBlinkRight", 20, 1), ("eyeWideLeft", 19, -1), ("browInnerUp", 31, 1),
        ("browDownRight", 34, -1), ("browOuterUpLeft", 35, 1), ("mouthPucker", 6, -1), ("cheekPuff", 39, 1),
        ("jawLeft", 15, -1), ("jawForward", 14, 1), ("noseSneerLeft", 63, 1), ("eyeLookInLeft", 23, -1),
        ("eyeLookOutRight", 24, -1), ("eyeLookUpLeft", 25, -1), ("mouthUpperUpLeft", 8, -1), ("tongueOut", 45, 1),
    ],
)  # fmt: skip
def test_shapes_do_what_their_names_say(name: str, number: int, sign: int) -> None:
    value = ARKIT.to_faps(shape(**{name: 1.0}))[fap.column(number)]
    assert sign * value > 15


def test_weights_come_back() -> None:
    wanted = np.stack([shape(jawOpen=0.5, mouthSmileLeft=0.6), shape(eyeBlinkLeft=0.9, browInnerUp=0.4), shape()])
    found = ARKIT.approximate_weights(ARKIT.to_faps(wanted))
    np.testing.assert_allclose(ARKIT.to_faps(found) * weights_mm(), ARKIT.to_faps(wanted) * weights_mm(), atol=0.5)
    assert np.abs(found[:, [ARKIT_NAMES.index("jawOpen"), 23]] - wanted[:, [17, 23]]).max() < 0.12
    assert not found[2].any()


def test_speech_comes_back_for_the_most_part() -> None:
    """The 52 shapes cannot say everything that 66 FAPs can; on the lips they say most of it."""
    faps = speech()
    faps[:, fap.column(45)] = np.maximum(faps[:, fap.column(45)], 0)  # no shape draws the tongue back
    found = ARKIT.approximate_weights(faps)
    assert found.min() >= 0
    assert found.max() <= 1
    back = ARKIT.to_faps(found)
    lips = [fap.column(number) for number in (4, 5, 51, 52)]
    off = np.abs((back - faps) * weights_mm())[:, lips]
    moved = np.abs(faps * weights_mm())[:, lips]
    assert off.mean() < 0.25 * moved.mean()
    assert (
        np.sqrt((((back - faps) * weights_mm()) ** 2).sum(axis=1)).mean() < 3.1
    )  # measured 2.91, the root of the sum over all FAPs
    assert found[:, ARKIT_NAMES.index("jawOpen")].max() > 0.15


def test_left_and_right_are_never_both_in_speech() -> None:
    """Of a living face: with blinks, gaze, idle and emphasis."""
    found = ARKIT.approximate_weights(speech())
    for part in ("jaw", "mouth"):
        left, right = (found[:, ARKIT_NAMES.index(f"{part}{side}")] for side in ("Left", "Right"))
        assert np.minimum(left, right).max() < 0.035, part  # 0.029 measured; 0.42 if both cost nothing
        assert np.maximum(left, right).max() < 0.1, part
    assert found[:, ARKIT_NAMES.index("mouthPucker")].max() > 0.4


def test_it_finds_the_optimum() -> None:
    faps = speech()[40:43]
    found = PLAIN.approximate_weights(faps)
    scaled = PLAIN.faps * weights_mm()
    ridge = np.sqrt(RIDGE * (scaled**2).sum() / 52) * np.eye(52)
    for row, weights in zip(faps, found, strict=True):
        best = lsq_linear(np.vstack([scaled.T, ridge]), np.concatenate([row * weights_mm(), np.zeros(52)]), (0, 1))

        def cost(w: np.ndarray, goal: np.ndarray = row) -> float:
            return float((((w @ scaled) - goal * weights_mm()) ** 2).sum() + ((ridge @ w) ** 2).sum())

        assert cost(weights) <= 1.01 * cost(best.x) + 1e-6


def cost_of(weights: np.ndarray, faps: np.ndarray) -> float:
    scaled = ARKIT.faps * weights_mm()
    ridge = RIDGE * (scaled**2).sum() / 52
    return float(((weights @ scaled - faps * weights_mm()) ** 2).sum() + ridge * (weights**2).sum())


def test_a_single_frame_is_solved_exactly_wherever_it_begins() -> None:
    rng = np.random.default_rng(3)
    frames = np.vstack([speech()[10:40:5], rng.normal(0, 300, (20, 68)).round(), np.zeros((1, 68))])
    scaled = PLAIN.faps * weights_mm()
    ridge = np.sqrt(RIDGE * (scaled**2).sum() / 52) * np.eye(52)
    for row in frames:
        best = lsq_linear(
            np.vstack([scaled.T, ridge]), np.concatenate([row * weights_mm(), np.zeros(52)]), (0, 1), tol=1e-14
        ).x
        found = PLAIN.solve_weights(row)
        assert found.min() >= 0
        assert found.max() <= 1
        assert cost_of(found, row) <= cost_of(np.clip(best, 0, 1), row) + 1e-9
        for near in (rng.uniform(-0.5, 1.5, 52), np.zeros(52), np.ones(52)):
            np.testing.assert_allclose(PLAIN.solve_weights(row, near), found, atol=1e-9)


def test_block_pivots_that_do_not_help_go_one_by_one() -> None:
    """Shapes nearly alike, of which blocks would go in circles."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        faps = np.repeat(rng.normal(0, 100, (1, 68)), 8, axis=0) + rng.normal(0, 3.0, (8, 68))
        alike = BlendMap(tuple("abcdefgh"), faps, limit=0.3)
        goal = rng.normal(0, 100, 68)
        found = alike.solve_weights(goal, rng.uniform(-0.1, 0.4, 8))
        np.testing.assert_allclose(found, alike.solve_weights(goal), atol=1e-6)
        assert found.min() >= 0
        assert found.max() <= 0.3


def test_refuses() -> None:
    with pytest.raises(UsageError, match="limit: got 0"):
        BlendMap(("a",), np.ones((1, 68)), limit=0)
    with pytest.raises(UsageError, match="no shape moves anything"):
        BlendMap(("a",), np.zeros((1, 68)))
    with pytest.raises(UsageError, match="faps: got shape"):
        BlendMap(("a",), np.zeros((1, 52)))
    with pytest.raises(UsageError, match="weights"):
        ARKIT.to_faps(np.zeros(51))
    with pytest.raises(UsageError, match="faps: got shape"):
        ARKIT.solve_weights(np.zeros(52))
    with pytest.raises(UsageError, match="near: got shape"):
        ARKIT.solve_weights(np.zeros(68), np.zeros(51))
