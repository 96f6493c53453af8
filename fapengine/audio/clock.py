"""Where the sound really is: a sound card's clock, followed.

Theory of operation
-------------------
A device fetches sound a buffer at a time and says when that buffer's first frame will be heard, on a clock of its own.
That clock may step (PortAudio on Linux reads the wall clock), so it is carried over to the monotonic clock by the
smallest distance between the two seen of late: a callback is never early, but often late. Each fetch then says where
the sound was when it happened, some milliseconds wrong. A Kalman filter of two states, place and drift, makes a line
of these; the drift is that of the device's quartz, tens of ppm.

The line that is shown does not leap for less than :data:`LEAP_S`: it runs a little faster or slower until it has met
the estimate. Nothing that was not fetched yet is ever said to be heard, so a device that stalls stops the line. All
times are arguments, in seconds of the monotonic clock; ``position`` counts from the first frame the device fetched.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError

STEP_S, STEPS = 0.02, 3
"""Limit of an error, s, and number of reports in a row beyond it on one side: the device stood still, or skipped."""
JUMP_S = 0.1
"""Nor is a single one that is so far off."""
LEAP_S = 0.03
"""The line that is shown leaps over more than this, and slews away what is less."""
SLEW_S = 0.25
"""The line that is shown aims to meet the estimate this much later."""
MAX_SLEW = 0.05
"""Largest change of the rate: 5 % faster or slower are not seen on a face."""
MAX_DRIFT = 1e-3
"""1000 ppm: no quartz is so wrong; adaptive software devices are, for a while."""
OFFSET_WINDOW_S = 2.0
"""Window in which the smallest distance between the clocks is searched."""
NOISE_S = 0.003
"""Standard deviation of one report; PulseAudio's are good to 0.2 ms, others to a period."""
PLACE_WALK_S = 1e-4
"""Random walk of the position in a second, besides the drift."""
DRIFT_FIRST, DRIFT_WALK = 2e-4, 1e-6
"""Uncertainty of the drift at the beginning, and what a second adds."""


@dataclass(frozen=True, slots=True)
class Fetch:
    """A device fetched sound."""

    called_s: float
    """Monotonic clock, as soon as we knew."""
    device_s: float
    """The device's own clock, when it asked."""
    heard_s: float
    """The device's own clock, when the first of these frames will be heard."""
    frames: int
    ran_dry: bool = False
    """Sound was lost before this: an underrun."""


@dataclass(slots=True)
class PlaybackClock:
    """The position in a sound that is heard at any time, estimated from what the device says when it fetches samples.

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
    """Times that the device stood still or skipped."""
    fetched: int = 0
    """Frames so far."""
    _latency_s: float = 0.0
    _astray: int = 0
    """Reports in a row off by :data:`STEP_S`; the sign is the side."""
    _offsets: deque[tuple[float, float]] = field(default_factory=deque)
    _at_s: float = 0.0
    _place: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    _spread: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2)))
    _line: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Time, position and rate of what is shown."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sample_rate_hz) and self.sample_rate_hz > 0):
            raise UsageError(f"sample_rate_hz: got {self.sample_rate_hz}, expected a positive number")

    @property
    def drift_ppm(self) -> float:
        """How much faster than the monotonic clock the device plays."""
        return float(self._place[1]) * 1e6

    @property
    def told_s(self) -> float:
        """When the device fetched last, monotonic clock; 0 before it did."""
        return self._at_s

    @property
    def latency_s(self) -> float:
        """From the last fetch to when it is heard."""
        return self._latency_s

    def position_s(self, now_s: float) -> float:
        """Where what is heard at ``now_s`` stands, in seconds of sound; 0 before anything was fetched."""
        at_s, position_s, rate = self._line
        return min(position_s + rate * (now_s - at_s), self.fetched / self.sample_rate_hz)

    def tell(self, fetch: Fetch) -> None:
        """Take in what the device said."""
        now_s = fetch.called_s
        is_first = not self.fetched
        shown_s = self.position_s(now_s)
        wait_s = fetch.heard_s + self._offset_s(fetch) - now_s
        seen_s = self.fetched / self.sample_rate_hz - max(wait_s, 0.0)
        self.fetched += fetch.frames
        self.underruns += fetch.ran_dry
        self._latency_s = max(wait_s, 0.0)
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
        """From the device's clock to the monotonic one."""
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
        return float(self._place[0] + (1 + self._place[1]) * (now_s - self._at_s))

    def _restart(self, now_s: float, seen_s: float) -> None:
        drift = min(self._spread[1, 1], DRIFT_FIRST**2) or DRIFT_FIRST**2
        self._at_s, self._astray = now_s, 0
        self._place = np.array([seen_s, self._place[1]])
        self._spread = np.diag([NOISE_S**2, drift])

    def _correct(self, now_s: float, seen_s: float) -> None:
        """One step of the filter: carry place and drift to ``now_s``, weigh what was seen."""
        step_s = max(now_s - self._at_s, 0.0)
        state = np.array([self._predict(now_s), self._place[1]])
        forth = np.array([[1.0, step_s], [0.0, 1.0]])
        walk = np.diag([PLACE_WALK_S**2, DRIFT_WALK**2]) * step_s
        spread = forth @ self._spread @ forth.T + walk
        gain = spread[:, 0] / (spread[0, 0] + NOISE_S**2)
        state += gain * (seen_s - state[0])
        state[1] = min(max(state[1], -MAX_DRIFT), MAX_DRIFT)
        self._at_s, self._place = now_s, state
        self._spread = spread - np.outer(gain, spread[0])
