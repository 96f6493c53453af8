"""A simulated sound card, and whether its clock is followed."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from fapengine.audio.clock import MAX_SLEW, Fetch, PlaybackClock
from fapengine.errors import UsageError

RATE_HZ = 22_050


@dataclass
class Card:
    """Fetches a period whenever one has been heard; its quartz is wrong, its reports jitter, and we hear of it late."""

    drift_ppm: float = 0.0
    period: int = 512
    periods: int = 3
    jitter_s: float = 0.0
    late_s: float = 0.0
    clock_step: Callable[[float], float] = lambda now_s: 0.0
    """What is added to the device's own clock at a monotonic time."""
    stalls: tuple[tuple[float, float], ...] = ()
    """(when, how long) it stands still."""
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def heard_s(self, now_s: float) -> float:
        """The truth: sound heard at ``now_s``, device seconds."""
        lost = sum(min(max(now_s - at, 0.0), span) for at, span in self.stalls)
        return (now_s - lost) * (1 + self.drift_ppm * 1e-6)

    def fetches(self, until_s: float) -> list[Fetch]:
        times = np.arange(0, until_s, 1e-4)
        heard = np.array([self.heard_s(time) for time in times])
        made, fetched = [], 0
        for count in range(int(until_s * RATE_HZ / self.period)):
            wanted = max(count - self.periods, 0) * self.period / RATE_HZ
            at_s = times[min(int(np.searchsorted(heard, wanted)), len(times) - 1)]
            wait_s = fetched / RATE_HZ - self.heard_s(at_s) + self.rng.normal(0, self.jitter_s)
            device_s = 1.7e9 + at_s + self.clock_step(at_s)
            called_s = at_s + self.rng.exponential(self.late_s) if self.late_s else at_s
            made.append(Fetch(called_s, device_s, device_s + wait_s, self.period))
            fetched += self.period
        return made


def errors_s(card: Card, until_s: float, *, step_s: float = 0.005) -> np.ndarray:
    """What the clock says against the truth, every 5 ms."""
    clock, found = PlaybackClock(RATE_HZ), []
    fetches = sorted(card.fetches(until_s), key=lambda one: one.called_s)
    for now_s in np.arange(0.0, until_s - 0.2, step_s):
        while fetches and fetches[0].called_s <= now_s:
            clock.tell(fetches.pop(0))
        found.append(clock.position_s(now_s) - card.heard_s(now_s))
    return np.array(found)


def test_a_perfect_card_is_followed_exactly() -> None:
    assert np.abs(errors_s(Card(), 3.0)).max() < 2e-4  # the simulator's own step is 0.1 ms


@pytest.mark.parametrize("drift_ppm", [-200.0, 200.0])
def test_drift_jitter_and_late_callbacks(drift_ppm: float) -> None:
    card = Card(drift_ppm=drift_ppm, jitter_s=0.002, late_s=0.004)
    off = np.abs(errors_s(card, 60.0))
    assert np.percentile(off, 95) < 0.0015
    assert off[200:].max() < 0.004  # after a second
    clock = PlaybackClock(RATE_HZ)
    for fetch in card.fetches(60.0):
        clock.tell(fetch)
    assert clock.latency_s == pytest.approx(card.periods * card.period / RATE_HZ, abs=0.03)


def test_the_devices_clock_may_step_like_the_wall_clock() -> None:
    for step_s in (-3600.0, -0.5, 0.5, 3600.0):
        off = np.abs(errors_s(Card(clock_step=lambda now_s, by=step_s: by * (now_s > 2.0), late_s=0.002), 6.0))
        assert np.percentile(off, 99) < 0.003, step_s
        assert off.max() < 0.03, step_s


def test_a_device_that_stalls_stops_the_line() -> None:
    """PulseAudio's null sink may sleep for 2 s before it plays the first buffer."""
    off = errors_s(Card(stalls=((0.03, 1.7),)), 5.0)
    times = np.arange(len(off)) * 0.005
    assert np.abs(off[(times > 0.12) & (times < 1.7)]).max() <= 4 * 512 / RATE_HZ + 1e-3  # no more than was fetched
    assert np.abs(off[times > 2.1]).max() < 5e-4


def test_an_underrun_is_counted_and_jumped_over() -> None:
    card, clock = Card(stalls=((2.0, 0.3),)), PlaybackClock(RATE_HZ)
    fetches = card.fetches(4.0)
    for number, fetch in enumerate(fetches):
        clock.tell(Fetch(fetch.called_s, fetch.device_s, fetch.heard_s, fetch.frames, number == 100))
    assert clock.underruns == 1
    assert clock.jumps == 1
    off = np.abs(errors_s(card, 4.0))
    assert off[500:].max() < 0.001  # within three periods it is right again
    assert off.max() <= 4 * 512 / RATE_HZ + 1e-3
    late = [
        Fetch(one.called_s, one.device_s, one.heard_s - 0.4 * (one.called_s > 1.0), one.frames)
        for one in Card(period=2048, periods=8).fetches(3.0)
    ]
    clock = PlaybackClock(RATE_HZ)
    before = 0.0
    for fetch in late:
        before = clock.position_s(fetch.called_s)
        clock.tell(fetch)
        if clock.jumps:
            break
    assert clock.position_s(fetch.called_s) - before == pytest.approx(0.4, abs=1e-3)


def test_small_errors_are_slewed_away_and_time_never_runs_back() -> None:
    card = Card(jitter_s=0.01, late_s=0.003)
    clock, fetches, shown = PlaybackClock(RATE_HZ), card.fetches(20.0), []
    for now_s in np.arange(0.0, 19.5, 0.001):
        while fetches and fetches[0].called_s <= now_s:
            clock.tell(fetches.pop(0))
        shown.append(clock.position_s(now_s))
    steps = np.diff(shown[100:])
    assert clock.jumps == 0
    assert steps.min() >= 0.001 * (1 - MAX_SLEW) - 2e-6
    assert steps.max() <= 0.001 * (1 + MAX_SLEW) + 2e-6


def test_a_step_of_50_ms_is_believed_after_three_reports() -> None:
    """Long after the beginning, when the filter is sure of itself."""
    off = np.abs(errors_s(Card(stalls=((15.0, 0.05),)), 18.0))
    times_s = np.arange(len(off)) * 0.005
    assert off[times_s < 15.0].max() < 1e-3
    assert off[times_s > 15.3].max() < 1e-3


def test_a_step_of_25_ms_is_slewed_to_no_faster_than_is_allowed() -> None:
    card = Card(stalls=((15.0, 0.025),))
    clock, fetches, shown = PlaybackClock(RATE_HZ), card.fetches(18.0), []
    for now_s in np.arange(0.0, 17.5, 0.001):
        while fetches and fetches[0].called_s <= now_s:
            clock.tell(fetches.pop(0))
        shown.append(clock.position_s(now_s))
    steps = np.diff(shown[14_000:])
    assert steps.min() == pytest.approx(0.001 * (1 - MAX_SLEW), abs=2e-6)
    assert clock.position_s(17.5) == pytest.approx(card.heard_s(17.5), abs=5e-4)


def test_between_distant_fetches_the_drift_goes_on() -> None:
    off = np.abs(errors_s(Card(drift_ppm=400.0, period=11_025), 60.0))
    assert off[8000:].max() < 2.2e-4  # measured 1.7e-4; 2.7e-4 if it did not


def test_nothing_is_heard_before_anything_was_fetched() -> None:
    clock = PlaybackClock(RATE_HZ)
    assert clock.position_s(1e6) == 0.0
    clock.tell(Fetch(5.0, 0.0, 0.2, 100))
    assert clock.position_s(5.0) == pytest.approx(-0.2)
    assert clock.position_s(50.0) == pytest.approx(100 / RATE_HZ)


@pytest.mark.parametrize("rate", [0, -1, float("nan"), float("inf")])
def test_refuses_a_rate(rate: float) -> None:
    with pytest.raises(UsageError, match="sample_rate_hz: got"):
        PlaybackClock(rate)
