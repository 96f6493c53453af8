"""No phones, however fast, make the lips jump, overshoot or linger."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import close_lips, holds_of
from fapengine.trajectory.faps import speech_faps
from fapengine.trajectory.planner import Style, plan
from fapengine.trajectory.targets import APART_S, REST_MARGIN_S, keys_of, weights_of
from tests.english import english

STEP_S = 0.001
CAPTURED_MM_S, CAPTURED_MM_S2 = 349.0, 9270.0
"""Speed and acceleration of the opening between captured inner lips, 99.9th percentile of 520 sentences at 25 frames a
second (``design/lip_speed.py``); frames so far apart hide the true peaks. docs/trajectories.md promises multiples."""

SPEECH = st.lists(
    st.tuples(st.deferred(lambda: st.sampled_from(sorted(english().phones))), st.floats(0.05, 0.25)),
    min_size=1,
    max_size=11,
)
RATE = st.floats(0.5, 3.0)


def spoken(speech: list[tuple[str, float]], rate: float) -> PhoneTrack:
    ends = 0.3 + np.cumsum([seconds / rate for _, seconds in speech])
    starts = [0.3, *ends[:-1]]
    phones = [Phone(label, start, end) for (label, _), start, end in zip(speech, starts, ends, strict=True)]
    return PhoneTrack.from_phones([*phones, Phone("_", ends[-1], ends[-1] + 0.4)])


def opening_mm(phones: PhoneTrack, step_s: float = STEP_S) -> NDArray[np.float64]:
    """Of the lips' middle, every millisecond, not rounded."""
    times = np.arange(0, phones.duration_s, step_s)
    faps = speech_faps(english(), weights_of(phones, english(), times))
    faps = close_lips(faps, times, holds_of(keys_of(phones, english()).said[0]))
    gap: NDArray[np.float64] = -english().fapu.unit(fap.FapUnit.MNS) * (faps[:, fap.column(4)] + faps[:, fap.column(5)])
    return gap


@given(SPEECH, RATE)
def test_speed_and_acceleration_stay_near_what_was_captured(speech: list[tuple[str, float]], rate: float) -> None:
    gap = opening_mm(spoken(speech, rate))
    speed = np.gradient(gap, STEP_S)
    assert np.abs(speed).max() <= 2.5 * CAPTURED_MM_S
    assert np.abs(np.gradient(speed, STEP_S)).max() <= 11.0 * max(1.0, rate) * CAPTURED_MM_S2


@pytest.mark.parametrize("each_s", [0.02, 0.045, 0.0625, 0.1])
def test_acceleration_has_no_steps_where_closures_meet(each_s: float) -> None:
    phones = spoken([("m", each_s), ("aɪ", each_s), ("f", each_s), ("ɑ", each_s), ("p", each_s), ("aɪ", each_s)], 1.0)
    steps = [
        np.abs(np.diff(opening_mm(phones, step_s), 3)).max() / step_s**2 for step_s in (2e-4, 1e-4)
    ]  # a step would not shrink with the time between samples
    assert steps[1] < 0.7 * steps[0]


def test_lips_are_as_fast_as_people_s() -> None:
    gap = opening_mm(spoken([(label, 0.1) for label in ("b", "aɪ", "p", "ɑ", "m", "aɪ", "b", "i")], 1.0))
    assert np.abs(np.gradient(gap, STEP_S)).max() > 0.5 * CAPTURED_MM_S


KEYS = st.lists(st.tuples(st.floats(0.012, 0.4), st.floats(-5, 5)), min_size=2, max_size=9)


@given(KEYS)
def test_overshoot_beyond_two_keys_is_a_quarter_of_four_at_most(keys: list[tuple[float, float]]) -> None:
    times = np.cumsum([step for step, _ in keys])
    values = np.array([[value] for _, value in keys])
    (laid,) = hermite.paths(times, values, np.zeros(len(times), np.intp), 1)
    for index in range(len(times) - 1):
        path = laid.sample(np.linspace(times[index], times[index + 1], 50))
        two, four = values[index : index + 2], values[max(index - 1, 0) : index + 3]
        margin = hermite.OVERSHOOT * np.ptp(four) + 1e-9
        assert two.min() - margin <= path.min()
        assert path.max() <= two.max() + margin


@pytest.mark.parametrize("speed_up", [1.0, 1.6])
def test_where_keys_are_about_evenly_spaced_the_limit_changes_nothing(speed_up: float) -> None:
    times = np.cumsum([0.1, 0.1 / speed_up, 0.1, 0.1 / speed_up])
    values = np.array([[0.0], [1.0], [1.0], [2.0]])
    velocity, acceleration = hermite.derivatives(times, values, np.zeros(len(times), np.intp))
    for index in (1, 2):
        parabola = np.polyfit(times[index - 1 : index + 2] - times[index], values[index - 1 : index + 2, 0], 2)
        assert velocity[index, 0] == pytest.approx(parabola[1])
        assert acceleration[index, 0] == pytest.approx(2 * parabola[0])


@given(SPEECH, RATE, st.sampled_from(list(Expression)))
def test_rest_is_reached_in_an_eighth_of_a_second(
    speech: list[tuple[str, float]], rate: float, expression: Expression
) -> None:
    phones = spoken(speech, rate)
    wish = {expression: 0.7} if expression else {}
    values = plan(
        phones, english(), rng=np.random.default_rng(1), rate_hz=100.0, style=STILL, expressions=wish
    ).track.values
    alone = plan(PhoneTrack.from_phones([Phone("_", 0.0, phones.duration_s)]), english(), rng=np.random.default_rng(1),
                 rate_hz=100.0, style=STILL, expressions=wish).track.values  # fmt: skip
    last_s = phones.phones[-2].end_s
    behind = int(np.ceil((last_s + REST_MARGIN_S) * 100 + 1e-6))
    assert len(values) - behind >= 20
    np.testing.assert_array_equal(values[behind:], alone[behind:])


STILL = Style.speech_only()


def test_short_phones_have_one_keyframe_between_their_two() -> None:
    seconds = 2 * APART_S
    for length, count in ((seconds * 1.01, 2), (seconds * 0.99, 1)):
        keys = keys_of(PhoneTrack.from_phones([Phone("s", 0.0, length)]), english())
        assert len(keys.times_s) == len(keys.targets) == count
        assert np.mean(keys.times_s) == pytest.approx(0.45 * length)
