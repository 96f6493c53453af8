"""Lips that meet in the motion meet in every set of shapes, and no weight of a mouth jumps."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget.blend_tracks import SHAPE_SETS
from fapengine.retarget.visemes import VOWELS, VRM1_NAMES
from fapengine.scoring.mouth import Mouth, closures_of_phones, mouth_of
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.wire.shapes import ArkitFollower, PresetFollower, VisemeFollower
from tests.english import english

TEXTS = (
    "p l iː z ɡ ɪ v m iː f aɪ v m ɔː ɹ m ɪ n ɪ t s b ɪ f ɔː ɹ j uː l iː v",
    "m aɪ b eɪ b i b ɹ ʌ ð ɚ b ʌ m p t ð ə b ɪ ɡ b l uː b oʊ l",
    "ʃ iː j uː z d ð ə f oʊ n t ə b ʊ k ə t eɪ b l f ɔː ɹ m aɪ m ʌ ð ɚ",
)
MOUTHS = {
    "arkit": [column for column, name in enumerate(SHAPE_SETS["arkit"].names) if not name.startswith(("Eye", "Brow"))],
    "oculus": list(range(15)),
    "vrm1": [VRM1_NAMES.index(vowel) for vowel in VOWELS],
}
FOLLOWERS: dict[str, Callable[[], ArkitFollower | VisemeFollower | PresetFollower]] = {
    "arkit": ArkitFollower, "oculus": VisemeFollower, "vrm1": PresetFollower,
}  # fmt: skip


@cache
def phones_of(text: str) -> PhoneTrack:
    phones = [Phone(label, 0.3 + 0.085 * n, 0.385 + 0.085 * n) for n, label in enumerate(text.split())]
    phones.append(Phone("_", phones[-1].end_s, phones[-1].end_s + 0.4))
    return PhoneTrack.from_phones(phones)


@cache
def spoken(text: str, rate_hz: float) -> np.ndarray:
    track = plan(phones_of(text), english(), rng=np.random.default_rng(2), rate_hz=rate_hz).track
    return track.values.astype(np.float64)


def seen(faps: np.ndarray, rate_hz: float) -> Mouth:
    return mouth_of(FapTrack.from_values(to_codable(faps), rate_hz=rate_hz))


def check(key: str, weights: np.ndarray, text: str, rate_hz: float) -> None:
    faps = spoken(text, rate_hz)
    padded = np.pad(weights, ((0, 0), (0, len(SHAPE_SETS[key].names) - weights.shape[1])))  # live, eyes turn as bones
    shown, wanted = seen(SHAPE_SETS[key].to_faps(padded), rate_hz), seen(faps, rate_hz)
    closures = closures_of_phones(shown, phones_of(text), closed_mm=0.5)
    assert closures.met == closures.wanted >= 3
    assert np.corrcoef(shown.opening_mm, wanted.opening_mm)[0, 1] > 0.985
    assert weights.min() >= 0
    assert np.abs(np.diff(weights[:, MOUTHS[key]], axis=0)).max() < 0.3 * 60.0 / rate_hz


@pytest.mark.parametrize("key", MOUTHS)
@pytest.mark.parametrize("text", TEXTS)
def test_a_track(key: str, text: str) -> None:
    check(key, SHAPE_SETS[key].from_faps(spoken(text, 60.0), 60.0), text, 60.0)


@pytest.mark.parametrize("key", MOUTHS)
def test_a_live_face(key: str) -> None:
    follower = FOLLOWERS[key]()
    check(key, np.array([follower.follow(row) for row in spoken(TEXTS[1], 60.0)]), TEXTS[1], 60.0)


@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_other_rates(rate_hz: float) -> None:
    check("oculus", SHAPE_SETS["oculus"].from_faps(spoken(TEXTS[0], rate_hz), rate_hz), TEXTS[0], rate_hz)


def test_a_mouth_that_leaps_changes_no_weight_faster() -> None:
    leaps = np.random.default_rng(0).normal(0, 3000, (40, 68))
    follower = VisemeFollower()
    for weights in (SHAPE_SETS["oculus"].from_faps(leaps, 60.0), np.array([follower.follow(row) for row in leaps])):
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-9)
        assert np.abs(np.diff(weights, axis=0)).max() < 0.3
