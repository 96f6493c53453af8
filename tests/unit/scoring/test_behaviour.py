"""Blinks, head motion, and lips that grow with loudness."""

import numpy as np
import pytest

from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import Mouth, mouth_of
from fapengine.scoring.score import MIN_WINDOWS, behaviour_of, intensity_of

RATE_HZ = 50.0
LIDS = [fap.column(number) for number in (19, 20)]


def mouth(values: np.ndarray) -> Mouth:
    return mouth_of(FapTrack.from_values(values.astype(np.int32), rate_hz=RATE_HZ))


def test_blinks_are_counted_and_sleep_and_winks_are_not() -> None:
    values = np.zeros((3001, fap.FAP_COUNT))
    for first in (100, 900, 2500):
        values[first : first + 7, LIDS] = 1000
    values[1500:1600, LIDS] = 1000  # 2 s
    values[2000:2007, LIDS[0]] = 1000  # one eye
    values[-3:, LIDS] = 1000  # cut
    found = behaviour_of(mouth(values))
    assert found.blinks == 3
    assert found.blinks_per_minute == pytest.approx(3)
    assert found.blink_ms == pytest.approx(140)


def test_lids_that_waver_while_they_are_shut_blink_once() -> None:
    values = np.zeros((200, fap.FAP_COUNT))
    values[50:57, LIDS] = np.array([600, 700, 450, 800, 400, 750, 300])[:, None] * 0.9
    found = behaviour_of(mouth(values))
    assert found.blinks == 1
    assert found.blink_ms == pytest.approx(120)  # six frames from the first to the last that is more than half shut


def test_a_head_that_swings_has_its_deviation_and_speed() -> None:
    turn_rad = 0.1 * np.sin(2 * np.pi * np.arange(1001) / 100)
    values = np.zeros((1001, fap.FAP_COUNT))
    values[:, fap.column(49)] = turn_rad / AU_RAD
    found = behaviour_of(mouth(values))
    assert found.head_deg == pytest.approx((0, np.rad2deg(0.1) / np.sqrt(2), 0), rel=2e-3)
    assert found.head_deg_s == pytest.approx(np.rad2deg(0.1) * 4 / 2, rel=1e-2)  # four amplitudes in 2 s


def test_lips_that_grow_with_loudness_correlate() -> None:
    rng = np.random.default_rng(5)
    strength = np.repeat(rng.uniform(0.2, 1.0, 12), 100)  # of each second, at 100 Hz
    wave = (1 - np.cos(2 * np.pi * 4 * np.arange(1200) / 100)) / 2
    values = np.zeros((600, fap.FAP_COUNT))
    values[:, fap.column(5)] = -400 * (strength * wave)[::2]
    seen = mouth(values)
    loud = intensity_of(seen, (strength * wave) ** 2)
    assert loud.slcc is not None
    assert loud.opening_r is not None
    assert loud.slcc > 0.95
    assert loud.opening_r > 0.7
    against = intensity_of(seen, ((1.2 - strength) * wave) ** 2)
    assert against.slcc is not None
    assert against.slcc < -0.9
    assert intensity_of(seen, 1e-9 * (strength * wave) ** 2).slcc == pytest.approx(loud.slcc)


def test_too_short_or_silent_says_nothing() -> None:
    seen = mouth(np.zeros((600, fap.FAP_COUNT)))
    assert intensity_of(seen, np.ones(1200)).slcc is None
    assert intensity_of(seen, np.zeros(1200)).opening_r is None
    assert intensity_of(seen, np.zeros(0)).windows == 0
    assert intensity_of(seen, np.ones(300)).windows < MIN_WINDOWS
