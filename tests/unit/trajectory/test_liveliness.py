"""Generators that liven the face: seeded, apart from each other, and at rest at both ends."""

import numpy as np
import pytest

from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.liveliness import (
    GLANCE_RAD,
    blinks,
    countered,
    emphasis,
    enliven,
    gaze,
    idle,
    sway,
)
from fapengine.trajectory.style import GENERATORS, Style

TIMES = np.arange(0, 20, 0.01)
PHONES = PhoneTrack.of([Phone("a", 2.0, 2.2, stress=1), Phone("t", 2.2, 2.3), Phone("i", 4.0, 4.1, stress=2)])


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def column(faps: np.ndarray, number: int) -> np.ndarray:
    return faps[:, fap.column(number)]


def only(*names: str) -> np.ndarray:
    style = Style(**{name: name in names for name in GENERATORS})  # type: ignore[arg-type]
    return enliven(TIMES, 20.0, PHONES, style, rng())


def test_blinks_close_the_eyes_fully_and_come_at_a_human_rate() -> None:
    times = np.arange(0, 300, 0.01)
    upper = column(blinks(times, 300.0, rng()), 19)
    count = (np.diff((upper > 900).astype(int)) == 1).sum()
    assert 8 * 5 <= count <= 22 * 5
    assert upper.max() == pytest.approx(960)
    assert upper[-1] == 0


def test_the_same_seed_is_the_same_motion_and_each_generator_has_its_own_chance() -> None:
    alone = [only(name) for name in GENERATORS]
    np.testing.assert_array_equal(only("sway"), only())
    assert all(one.any() for one in alone)
    without_gaze = only("blinks", "head_motion", "idle", "emphasis")
    np.testing.assert_allclose(
        without_gaze, sum(one for one, name in zip(alone, GENERATORS, strict=True) if name != "gaze")
    )
    np.testing.assert_allclose(only(*GENERATORS), without_gaze + countered(without_gaze) + alone[2])
    assert not only().any()


def test_everything_begins_and_ends_at_nothing() -> None:
    faps = only(*GENERATORS)
    assert not faps[0].any()
    last = enliven(np.array([20.0]), 20.0, PHONES, Style(), rng())
    assert last == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("end_s", [0.02, 0.3, 1.0])
def test_a_short_track_ends_at_nothing_too(end_s: float) -> None:
    assert enliven(np.array([end_s]), end_s, PHONES, Style(), rng()) == pytest.approx(0, abs=1e-6)


def test_eyes_counter_the_head() -> None:
    faps = only("head_motion", "emphasis", "gaze")
    seen = column(faps, 23) + column(faps, 49)
    assert np.abs(column(faps, 49)).max() > 500
    np.testing.assert_allclose(seen, column(only("gaze"), 23), atol=1e-9)
    np.testing.assert_array_equal(column(faps, 23), column(faps, 24))


def test_glances_jump_and_rest() -> None:
    yaw = column(gaze(np.arange(0, 120, 0.01), 120.0, rng()), 23) * 1e-5
    moving = np.abs(np.diff(yaw)) > 1e-9
    assert moving.mean() < 0.08
    starts = (np.diff(moving.astype(int)) == 1).sum()
    assert 120 / 3.5 < starts < 120 / 1.2
    assert 0.3 * GLANCE_RAD < np.std(yaw) < 2 * GLANCE_RAD


def test_stress_nods_and_raises_the_brows_once_each() -> None:
    faps = emphasis(TIMES, 20.0, [phone for phone in PHONES.phones if phone.stress], rng())
    brow = column(faps, 33)
    assert brow[205] > 20
    assert column(faps, 48)[205] > 500
    assert 0 < brow[402] < brow[205] + 38  # secondary stress: half
    assert not brow[1000:].any()


def test_idle_and_sway_are_small_and_never_still() -> None:
    drift, turn = idle(TIMES, 20.0, rng()), sway(TIMES, 20.0, rng())
    assert 3 < np.abs(column(drift, 33)).max() < 30
    assert np.abs(column(drift, 12)).max() < 15
    assert 0.01 < np.abs(column(turn, 49)).max() * 1e-5 < 0.08
    assert not column(drift, 4).any()  # the lips' opening is not touched
    assert not column(drift, 5).any()


def test_lids_go_with_the_gaze() -> None:
    faps = only("head_motion", "gaze")
    pitch_rad = column(faps, 25) * 1e-5
    assert np.abs(pitch_rad).max() > 0.01
    for number, per_rad in ((19, 600.0), (20, 600.0), (21, -200.0), (22, -200.0)):
        np.testing.assert_allclose(column(faps, number), per_rad * pitch_rad, atol=1e-9)
