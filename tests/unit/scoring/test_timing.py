"""Warping, lag and misalignment: against plain programs, and their laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fapengine.scoring.timing import GRID_HZ, expected_opening, grid, lag_ms, misalignment, warp
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

SHORT = arrays(np.float64, st.integers(2, 14), elements=st.integers(-5, 5).map(float))


def plain_cost(one: np.ndarray, other: np.ndarray, reach: int) -> float:
    """Least cost of an alignment, cell by cell."""
    cost = np.full((len(one) + 1, len(other) + 1), np.inf)
    cost[0, 0] = 0
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            if abs(i - j) <= reach:
                cost[i + 1, j + 1] = abs(a - b) + min(cost[i, j], cost[i, j + 1], cost[i + 1, j])
    return float(cost[-1, -1])


@given(SHORT, st.integers(0, 14), st.randoms(use_true_random=False))
def test_warping_finds_the_cheapest_way(one: np.ndarray, reach: int, chance: object) -> None:
    other = np.array([chance.randint(-5, 5) for _ in one], float)  # type: ignore[attr-defined]
    first, last = warp(one, other, reach)
    assert first[0] == 0
    assert last[-1] == len(one) - 1
    assert (first <= last).all()
    assert (first[1:] - last[:-1] >= 0).all()
    assert (first[1:] - last[:-1] <= 1).all()
    assert max(np.abs(first - np.arange(len(one))).max(), np.abs(last - np.arange(len(one))).max()) <= reach
    spent = sum(np.abs(one[n] - other[first[n] : last[n] + 1]).sum() for n in range(len(one)))
    assert spent == pytest.approx(plain_cost(one, other, reach))


@given(st.integers(-40, 40), st.integers(0, 10**6))
def test_a_shift_is_found(shift: int, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(size=700)
    smooth = 20 * np.convolve(noise, np.hanning(25) / 12, "same")
    made, true = smooth[100 - shift : 500 - shift], smooth[100:500]
    assert lag_ms(made, true) == pytest.approx(1000 * shift / GRID_HZ, abs=6)


def test_of_shifts_that_fit_nearly_as_well_the_smaller_counts() -> None:
    times_s = grid(4.0)
    wave, bump = (
        (lambda at_s: np.sin(10 * np.pi * (times_s - at_s))),
        (lambda at_s: np.exp(-900 * (times_s - at_s) ** 2)),
    )
    made = wave(0.03) + 0.8 * bump(2.23)  # 30 ms and 230 ms are the same to the wave; the bump is for 230 ms
    assert lag_ms(made, wave(0.0) + 0.8 * bump(2.0)) == pytest.approx(30, abs=5)


def test_misalignment_is_the_shift_of_slow_movements() -> None:
    times_s = grid(6.0)
    true = 5 + 4 * np.sin(2 * np.pi * 1.3 * times_s) + np.sin(2 * np.pi * 0.4 * times_s)
    for shift in (0, 3, 8, 15):
        mtm_ms, met = misalignment(np.roll(true, shift)[20:-20], true[20:-20])
        assert mtm_ms == pytest.approx(10 * shift, abs=5)
        assert met is not None
        assert met > 0.8


def test_what_does_not_move_has_no_time() -> None:
    wave = np.sin(grid(3.0) * 9)
    assert lag_ms(np.zeros(301), wave) is None
    assert lag_ms(wave[:2], wave[:2]) is None
    assert misalignment(np.zeros(301), np.zeros(301)) == (None, None)
    assert misalignment(np.zeros(301), wave) == (None, 0.0)


def test_phones_lead_to_expect_an_opening() -> None:
    phones = PhoneTrack.from_phones(
        [Phone("ɑ", 0.5, 1.0), Phone("m", 1.0, 1.5), Phone("i", 1.5, 2.0), Phone(SILENCE, 2.0, 3.0)]
    )
    times_s = grid(3.0)
    seen = expected_opening(phones, times_s)
    at = dict(zip(times_s.round(2).tolist(), seen.tolist(), strict=True))
    assert at[0.75] > at[1.75] > 0.3
    assert max(at[0.1], at[1.25], at[2.6]) < 0.01
    assert expected_opening(PhoneTrack(()), times_s).tolist() == [0.0] * len(times_s)
