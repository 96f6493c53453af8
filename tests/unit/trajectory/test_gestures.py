"""Gestures: seeded, apart from each other, at rest at both ends, and the same in whatever pieces phones come."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.gestures import (
    BLINK_CLOSE_S,
    BLINK_OPEN_S,
    BLINK_SHUT_S,
    GLANCE_RAD,
    NOD_FALL_S,
    NOD_RISE_S,
    Channel,
    GestureGenerator,
    sample_gestures,
)
from fapengine.trajectory.ramps import Ramp, Ramps, sample_ramps
from fapengine.trajectory.style import GENERATORS, Style

TIMES = np.arange(0, 20, 0.01)
PHONES = PhoneTrack.of([Phone("a", 2.0, 2.2, stress=1), Phone("t", 2.2, 2.3), Phone("i", 4.0, 4.1, stress=2)])


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def column(faps: np.ndarray, number: int) -> np.ndarray:
    return faps[:, fap.column(number)]


def only(*names: str, times: np.ndarray = TIMES, end_s: float = 20.0) -> np.ndarray:
    style = Style(**{name: name in names for name in GENERATORS})  # type: ignore[arg-type]
    return sample_gestures(times, end_s, PHONES.phones, style, rng())


def test_blinks_close_the_eyes_fully_and_come_at_a_human_rate() -> None:
    times = np.arange(0, 300, 0.01)
    upper = column(only("blinks", times=times, end_s=300.0), 19)
    count = (np.diff((upper > 900).astype(int)) == 1).sum()
    assert 8 * 5 <= count <= 22 * 5
    assert upper.max() == pytest.approx(960)
    assert upper[-1] == 0


@pytest.mark.parametrize("seed", range(8))
def test_no_blink_is_cut_off_by_the_end(seed: int) -> None:
    generator = GestureGenerator(np.random.default_rng(seed), Style())
    generator.end(4.0, 0.0)
    blinks = [ramp for ramp in generator.draw(9.0) if ramp.channel == Channel.BLINK]
    assert blinks
    assert max(ramp.at_s + ramp.over_s for ramp in blinks) < 4.0
    assert blinks[1].at_s - blinks[0].at_s == pytest.approx(BLINK_CLOSE_S + BLINK_SHUT_S)
    assert blinks[1].over_s == BLINK_OPEN_S


def test_the_same_seed_is_the_same_motion_and_each_generator_has_its_own_chance() -> None:
    alone = {name: only(name) for name in GENERATORS}
    np.testing.assert_array_equal(only("sway"), only())
    assert not only().any()
    assert all(faps.any() for faps in alone.values())
    np.testing.assert_array_equal(only(*GENERATORS), only(*GENERATORS))
    without_gaze = [name for name in GENERATORS if name != "gaze"]
    np.testing.assert_allclose(only(*without_gaze), sum(alone[name] for name in without_gaze), atol=1e-9)
    head = [fap.column(number) for number in (48, 49, 50)]
    brows = [fap.column(number) for number in range(31, 37)]
    for name in GENERATORS:  # what one adds is the same, whatever else is switched on
        rest = only(*(other for other in GENERATORS if other != name))
        for columns in (head, brows):
            added = (only(*GENERATORS) - rest)[:, columns]
            np.testing.assert_allclose(added, alone[name][:, columns], atol=1e-9)
    glances = column(only(*GENERATORS), 23) + column(only(*GENERATORS), 49)
    np.testing.assert_allclose(glances, column(alone["gaze"], 23), atol=1e-9)


def test_everything_begins_and_ends_at_nothing() -> None:
    faps = only(*GENERATORS)
    assert not faps[0].any()
    assert only(*GENERATORS, times=np.array([20.0, 20.1])) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("end_s", [0.02, 0.3, 1.0])
def test_a_short_track_ends_at_nothing_too(end_s: float) -> None:
    assert only(*GENERATORS, times=np.array([end_s]), end_s=end_s) == pytest.approx(0, abs=1e-6)


def test_a_nod_that_is_under_way_at_the_end_comes_to_rest_with_it() -> None:
    stressed = [Phone("a", 0.5, 0.9, stress=1)]
    style = Style(blinks=False, head_motion=False, gaze=False, idle=False)
    times = np.array([0.55, 1.0, 1.01])
    assert column(sample_gestures(times, 1.0, stressed, style, rng()), 33) == pytest.approx([43.7, 0, 0], abs=0.1)
    assert not sample_gestures(times, 0.5 - NOD_RISE_S + NOD_FALL_S, stressed, style, rng()).any()


def test_eyes_counter_the_head() -> None:
    faps = only("head_motion", "emphasis", "gaze")
    seen = column(faps, 23) + column(faps, 49)
    assert np.abs(column(faps, 49)).max() > 500
    np.testing.assert_allclose(seen, column(only("gaze"), 23), atol=1e-9)
    np.testing.assert_array_equal(column(faps, 23), column(faps, 24))


def test_glances_jump_and_rest() -> None:
    yaw = column(only("gaze", times=np.arange(0, 120, 0.01), end_s=120.0), 23) * 1e-5
    moving = np.abs(np.diff(yaw)) > 1e-9
    assert moving.mean() < 0.08
    starts = (np.diff(moving.astype(int)) == 1).sum()
    assert 120 / 3.5 < starts < 120 / 1.2
    assert 0.3 * GLANCE_RAD < np.std(yaw) < 2 * GLANCE_RAD


def test_stress_nods_and_raises_the_brows_once_each() -> None:
    faps = only("emphasis")
    brow = column(faps, 33)
    assert brow[205] > 20
    assert column(faps, 48)[205] > 500
    assert 0 < brow[402] < brow[205] + 38  # secondary stress: half
    assert brow[1000:] == pytest.approx(0)


def test_idle_and_head_motion_are_small_and_never_still() -> None:
    drift, turn = only("idle"), only("head_motion")
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


def test_lids_that_a_blink_has_shut_do_not_follow_the_gaze() -> None:
    faps = only("gaze", "blinks")
    shut = column(faps, 19) >= 960
    assert np.abs(column(faps, 25)[shut]).max() > 100
    np.testing.assert_allclose(column(faps, 19)[shut], 960)


def nods(pieces: list[list[Phone]], known_s: list[float], step_s: float) -> list[Ramp]:
    """Ramps of nods, for phones that become known in pieces, drawn frame by frame."""
    generator = GestureGenerator(rng(), Style())
    waiting, ramps = list(zip(known_s, pieces, strict=True)), []
    for frame in range(round(12 / step_s)):
        while waiting and waiting[0][0] <= frame * step_s:
            at_s, phones = waiting.pop(0)
            generator.stress([(phone.start_s, phone) for phone in phones], at_s)
        ramps += generator.draw(frame * step_s)
    return [ramp for ramp in ramps if ramp.channel == Channel.NOD]


STRESSED = [
    Phone("a", float(at_s), float(at_s) + 0.2, stress=1 + n % 2) for n, at_s in enumerate(np.arange(0.4, 9, 0.3))
]


@pytest.mark.parametrize("ahead_s", [NOD_RISE_S + 0.001, 0.5, 3.0])
def test_nods_are_the_same_whether_phones_come_at_once_or_one_by_one_ahead_of_time(ahead_s: float) -> None:
    at_once = nods([STRESSED], [0.0], 1 / 25)
    one_by_one = nods([[phone] for phone in STRESSED], [max(phone.start_s - ahead_s, 0.0) for phone in STRESSED], 1e-3)
    assert one_by_one == at_once
    assert len(at_once) == 2 * len(STRESSED)
    pairs = [[STRESSED[n + 1], STRESSED[n]] for n in range(0, len(STRESSED) - 1, 2)]
    assert nods(pairs, [0.0] * len(pairs), 0.01) == nods([STRESSED[: 2 * len(pairs)]], [0.0], 0.01)


def test_a_nod_begins_when_its_phone_is_known_and_never_behind_the_phone_s_beginning() -> None:
    (rise, fall) = nods([[Phone("a", 1.0, 1.2, stress=1)]], [0.9], 0.01)
    assert (rise.at_s, fall.at_s) == (0.9, pytest.approx(0.9 + NOD_RISE_S + 0.1))
    assert nods([[Phone("a", 1.0, 1.2, stress=1)]], [1.0], 0.01) == []


def test_a_shouted_nod_is_large_and_a_whispered_one_small() -> None:
    spoken = [Phone("a", 1.0, 1.2, stress=1, loudness_db=loudness_db) for loudness_db in (0.0, 8.0, -12.0)]
    usual, shouted, whispered = (nods([[phone]], [0.0], 0.01)[0].goal for phone in spoken)
    assert shouted == pytest.approx(2 * usual)
    assert whispered == pytest.approx(usual / 2**1.5)


def test_a_nod_takes_over_from_the_one_before() -> None:
    ramps = nods([[Phone("a", 1.0, 1.6, stress=1), Phone("a", 1.2, 1.8, stress=2)]], [0.0], 0.01)
    level = sample_ramps(np.zeros(len(Channel)), ramps, np.array([1.0, 1.2, 1.5, 1.7]))[Channel.NOD]
    assert level[0] > 0.49
    np.testing.assert_allclose(level[1:3], ramps[2].goal)  # the first one's fall, at 1.3 s, is dropped
    assert 0 < level[3] < ramps[2].goal


def test_gestures_do_not_depend_on_the_frame_rate() -> None:
    drawn = []
    for step_s in (1 / 25, 1 / 60, 30.0):
        generator = GestureGenerator(rng(), Style())
        ramps = [ramp for frame in range(round(30 / step_s) + 1) for ramp in generator.draw(frame * step_s)]
        drawn.append({channel: [ramp for ramp in ramps if ramp.channel == channel] for channel in Channel})
    assert drawn[0] == drawn[1] == drawn[2]
    assert len(drawn[0][Channel.BLINK]) > 8


RAMPS = st.lists(
    st.builds(Ramp, st.floats(0, 5), st.integers(0, 2), st.floats(-2, 2), st.floats(0.01, 2), takes_over=st.booleans()),
    max_size=12,
)


@given(RAMPS, st.integers(1, 40))
def test_ramps_are_the_same_sampled_and_frame_by_frame(ramps: list[Ramp], frames: int) -> None:
    times = np.linspace(0, 8, frames)
    start = np.array([0.0, 1.0, -1.0])
    many = Ramps(start)
    row = many.open()
    many.send(row, ramps)
    live = np.array([many.values(float(time_s))[:, row] for time_s in times])
    np.testing.assert_allclose(sample_ramps(start, ramps, times).T, live, atol=1e-9)
