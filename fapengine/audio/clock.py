"""Position of the sound that is heard: an estimate of a sound card's clock.

Theory of operation
-------------------
A device fetches sound one buffer at a time and reports when that buffer's first frame will be heard, on its own clock.
That clock may step (PortAudio on Linux reads the wall clock), so it is mapped to the monotonic clock by the smallest
recent distance between the two: a callback is never early, but often late. Each fetch then gives the position at its
time, with an error of some milliseconds. A Kalman filter with two states, position and drift, fits a line to these; the
drift is that of the device's quartz, tens of ppm.

The line that is shown jumps only for errors above :data:`LEAP_S`; for smaller ones it runs a little faster or slower
until it meets the estimate. It never passes the last fetched frame, so a device that stalls stops the line. All times
are arguments, in seconds of the monotonic clock; positions count from the first frame that the device fetched.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError

STEP_S, STEPS = 0.02, 3
"""Limit of an error, s, and number of reports in a row beyond it on one side that show a stall or a skip."""
JUMP_S = 0.1
"""Error of a single report that shows it."""
LEAP_S = 0.03
"""Error above which the line that is shown jumps; it slews smaller ones."""
SLEW_S = 0.25
"""Time in which the line that is shown meets the estimate."""
MAX_SLEW = 0.05
"""Largest change of the rate: 5 % faster or slower is not visible on a face."""
MAX_DRIFT = 1e-3
"""1000 ppm: beyond any quartz, but not beyond adaptive software devices for a while."""
OFFSET_WINDOW_S = 2.0
"""Window for the smallest distance between the clocks."""
NOISE_S = 0.003
"""Standard deviation of one report; PulseAudio's are good to 0.2 ms, others to a period."""
PLACE_WALK_S = 1e-4
"""Random walk of the position in a second, besides the drift."""
DRIFT_FIRST, DRIFT_WALK = 2e-4, 1e-6
"""Uncertainty of the drift at first, and its growth per second."""


@dataclass(frozen=True, slots=True)
class Fetch:
    """One fetch of a device."""

    called_s: float
    """Monotonic clock at the callback."""
    device_s: float
    """The device's own clock at the fetch."""
    heard_s: float
    """The device's own clock when the first of these frames will be heard."""
    frames: int
    ran_dry: bool = False
    """True after an underrun."""


@dataclass(slots=True)
class PlaybackClock:
    """Estimate of the position that is heard, from the reports of a device when it fetches samples.

    Stateful.

    Parameters
    ----------
    sample_rate_hz : float

    Raises
    ------
    UsageError
        If the rate is not positive.
    """

    sample_rate_hz: float
    underruns: int = 0
    jumps: int = 0
    """Number of stalls and skips of the device."""
    fetched: int = 0
    """Frames so far."""
    fetched_s: float = 0.0
    """Time of the last fetch, monotonic clock; 0 before the first."""
    latency_s: float = 0.0
    """Time from the last fetch to when its first frame is heard."""
    _astray: int = 0
    """Number of reports in a row off by :data:`STEP_S`; the sign is the side."""
    _offsets: deque[tuple[float, float]] = field(default_factory=deque)
    _place: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    _spread: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2)))
    _line: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Time, position and rate of the line that is shown."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sample_rate_hz) and self.sample_rate_hz > 0):
            raise UsageError(f"sample_rate_hz: got {self.sample_rate_hz}, expected a positive number")

    def position_s(self, now_s: float) -> float:
        """Position that is heard at ``now_s``; 0 before anything was fetched."""
        at_s, position_s, rate = self._line
        return min(position_s + rate * (now_s - at_s), self.fetched / self.sample_rate_hz)

    def tell(self, fetch: Fetch) -> None:
        """Add the report of a fetch."""
        now_s = fetch.called_s
        is_first = not self.fetched
        shown_s = self.position_s(now_s)
        wait_s = fetch.heard_s + self._offset_s(fetch) - now_s
        seen_s = self.fetched / self.sample_rate_hz - max(wait_s, 0.0)
        self.fetched += fetch.frames
        self.underruns += fetch.ran_dry
        self.latency_s = max(wait_s, 0.0)
        if is_first or self._has_jumped(seen_s - self._predict(now_s)):
            self.jumps += not is_first
            self._restart(now_s, seen_s)
        else:
            self._correct(now_s, seen_s)
        drift = float(self._place[1])
        error_s = float(self._place[0]) - shown_s
        if is_first or abs(error_s) > LEAP_S:
            self._line = (now_s, float(self._place[0]), 1 + drift)
        else:
            slew = min(max(error_s / SLEW_S, -MAX_SLEW), MAX_SLEW)
            self._line = (now_s, shown_s, 1 + drift + slew)

    def _offset_s(self, fetch: Fetch) -> float:
        """Return the monotonic clock minus the device's."""
        distance_s = fetch.called_s - fetch.device_s
        window = self._offsets
        if window and distance_s > window[-1][1] + JUMP_S:
            window.clear()  # the device's clock was set back, or the whole machine slept
        while window and window[-1][1] >= distance_s:
            window.pop()
        window.append((fetch.called_s, distance_s))
        while window[0][0] < fetch.called_s - OFFSET_WINDOW_S:
            window.popleft()
        return window[0][1]

    def _has_jumped(self, off_s: float) -> bool:
        side = int(off_s > STEP_S) - int(off_s < -STEP_S)
        self._astray = self._astray + side if side * self._astray >= 0 and side else side
        return abs(off_s) > JUMP_S or abs(self._astray) >= STEPS

    def _predict(self, now_s: float) -> float:
        return float(self._place[0] + (1 + self._place[1]) * (now_s - self.fetched_s))

    def _restart(self, now_s: float, seen_s: float) -> None:
        drift = min(self._spread[1, 1], DRIFT_FIRST**2) or DRIFT_FIRST**2
        self.fetched_s, self._astray = now_s, 0
        self._place = np.array([seen_s, self._place[1]])
        self._spread = np.diag([NOISE_S**2, drift])

    def _correct(self, now_s: float, seen_s: float) -> None:
        """Do one step of the filter: predict position and drift at ``now_s``, correct them by the measured position."""
        step_s = max(now_s - self.fetched_s, 0.0)
        state = np.array([self._predict(now_s), self._place[1]])
        forth = np.array([[1.0, step_s], [0.0, 1.0]])
        walk = np.diag([PLACE_WALK_S**2, DRIFT_WALK**2]) * step_s
        spread = forth @ self._spread @ forth.T + walk
        gain = spread[:, 0] / (spread[0, 0] + NOISE_S**2)
        state += gain * (seen_s - state[0])
        state[1] = min(max(state[1], -MAX_DRIFT), MAX_DRIFT)
        self.fetched_s, self._place = now_s, state
        self._spread = spread - np.outer(gain, spread[0])
