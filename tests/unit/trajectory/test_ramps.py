"""Channels that glide: whatever is sent when, they stay near where they were sent, and never jump."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fapengine.trajectory.ramps import FIRST_ROWS, Ramp, Ramps, sample_ramps

SENT = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.003, 0.005, 0.02, 0.1, 0.7, 8.0]),
        st.sampled_from([0.0, 1.0, -1.0, 0.3]),
        st.sampled_from([0.01, 0.03, 0.15, 0.5, 10.0, 60.0]),
    ),
    min_size=1,
    max_size=7,
)
"""Time since the one before, goal, duration: quick and slow ones of the whole range that a command may ask for."""
BEYOND = 0.1
"""Share of the range of all goals by which a channel may leave it; 2,200 where momentum fades as slowly as value."""


def ramps_of(sent: list[tuple[float, float, float]]) -> list[Ramp]:
    times = np.cumsum([after_s for after_s, _, _ in sent]).tolist()
    return [Ramp(at_s, 0, goal, over_s) for at_s, (_, goal, over_s) in zip(times, sent, strict=True)]


@example([(0.0, 1.0, 0.01), (0.005, 0.0, 60.0)])
@given(SENT)
def test_a_channel_stays_between_where_it_was_and_where_it_is_sent(sent: list[tuple[float, float, float]]) -> None:
    ramps = ramps_of(sent)
    times = np.unique([ramp.at_s + np.linspace(0, length_s, 200) for ramp in ramps for length_s in (0.02, 0.3, 60.0)])
    values = sample_ramps(np.zeros(1), ramps, times)[0]
    goals = [0.0, *(ramp.goal for ramp in ramps)]
    room = BEYOND * (max(goals) - min(goals)) + 1e-12
    assert min(goals) - room <= values.min()
    assert values.max() <= max(goals) + room
    assert sample_ramps(np.zeros(1), ramps, np.array([ramps[-1].at_s + 60.0]))[0, 0] == pytest.approx(ramps[-1].goal)


@given(SENT)
def test_value_velocity_and_acceleration_do_not_jump(sent: list[tuple[float, float, float]]) -> None:
    ramps, step_s = ramps_of(sent), 1e-5
    for ramp in ramps:
        if any(other is not ramp and abs(other.at_s - ramp.at_s) < 1e-3 for other in ramps):
            continue
        around = sample_ramps(np.zeros(1), ramps, ramp.at_s + step_s * np.arange(-4, 5))[0]
        assert np.abs(np.diff(around)).max() < 2 * 188 * 2 * step_s  # of a ramp from -1 to 1 in 10 ms
        assert np.abs(np.diff(around, 3)).max() / step_s**2 < 0.1 * 5.8 * 2 / 0.01**2  # a step in acceleration


def test_any_number_of_rows_glide_each_from_its_start() -> None:
    """More than there is room for at first, and more than twice as many."""
    start, count = np.array([0.5, -2.0]), 2 * FIRST_ROWS + 3
    ramps = Ramps(start)
    for number in range(count):
        ramps.send(ramps.open(), [Ramp(0.0, 1, float(number), 0.5)])
        assert ramps.values(0.0).shape == (2, number + 1)
    np.testing.assert_allclose(ramps.values(0.0), np.repeat(start[:, None], count, axis=1))
    np.testing.assert_allclose(ramps.values(0.25)[1], (start[1] + np.arange(count)) / 2)  # half of the way
    np.testing.assert_allclose(ramps.values(9.0), [np.full(count, 0.5), np.arange(count)], atol=1e-9)
