"""Values that glide from where they are to where they are sent: levels of expressions, gaze, blinks, gains.

Theory of operation
-------------------
A ramp is a quintic from a channel's value, velocity and acceleration at its beginning to rest at its goal, so a channel
is C2 whatever is sent when. There are two ways to evaluate the same ramps: :func:`sample_ramps` for one face at many
times (offline), and :class:`Ramps` for many faces at one time, which never goes back (live).
"""

from bisect import insort
from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from fapengine.trajectory import hermite

Array = NDArray[np.float64]

FIRST_ROWS = 16
MAX_WAITING = 1024
"""Number of ramps of a row that may wait for their beginning; of more, the latest is dropped."""
_time = attrgetter("at_s")


@dataclass(frozen=True, slots=True)
class Ramp:
    """The way of one channel to a goal."""

    at_s: float
    """Time at which it begins; it takes over from what its channel was doing."""
    channel: int
    goal: float
    """Value that it reaches, and keeps."""
    over_s: float
    """Duration, above 0."""
    takes_over: bool = False
    """True where ramps of the channel that were to begin later are dropped."""


def pulse(at_s: float, channel: int, height: float, rise_s: float, hold_s: float, fall_s: float) -> tuple[Ramp, Ramp]:
    """Make the two ramps of a value that rises from ``at_s`` on, holds and falls back to 0."""
    rise = Ramp(at_s, channel, height, rise_s, takes_over=True)
    return rise, Ramp(at_s + rise_s + hold_s, channel, 0.0, fall_s)


def sample_ramps(start: Array, ramps: Iterable[Ramp], times_s: Array) -> Array:
    """Evaluate every channel at every time.

    Parameters
    ----------
    start : (C,) float64
        Values before the first ramp, at rest.
    ramps : iterable of Ramp
        In the order in which they are sent.
    times_s : (T,) float64, s

    Returns
    -------
    (C, T) float64
    """
    queues: dict[int, list[Ramp]] = {}
    for ramp in ramps:
        queue = queues.setdefault(ramp.channel, [])
        while ramp.takes_over and queue and queue[-1].at_s >= ramp.at_s:
            queue.pop()
        insort(queue, ramp, key=_time)
    values = np.repeat(start[:, None], len(times_s), axis=1)
    for channel, queue in queues.items():
        values[channel] = _sample(float(start[channel]), queue, times_s)
    return values


def _sample(start: float, queue: list[Ramp], times_s: Array) -> Array:
    """Evaluate the ramps of one channel, in time order: (T,)."""
    coefficients, length_s, begun_s = (start, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0, 0.0
    rows = [(-np.inf, 0.0, 0.0, *coefficients)]
    for ramp in queue:
        coefficients = _next_quintic(ramp, coefficients, begun_s, length_s)
        begun_s, length_s = ramp.at_s, ramp.over_s
        rows.append((begun_s, begun_s, 1.0 / length_s, *coefficients))
    segments = np.array(rows).T
    index = np.searchsorted(segments[0], times_s, side="right") - 1
    begins_s, rate, *powers = segments[1:, index]
    return _horner(powers, (times_s - begins_s) * rate)


def _next_quintic(
    ramp: Ramp, coefficients: tuple[float, ...], begun_s: float, length_s: float
) -> tuple[float, float, float, float, float, float]:
    """Coefficients of a ramp that takes over from another, which began at ``begun_s`` and lasts ``length_s``."""
    share = min(max((ramp.at_s - begun_s) / length_s, 0.0), 1.0)
    c0, c1, c2, c3, c4, c5 = hermite.quintic(
        ramp.over_s, hermite.jet_of(coefficients, share, length_s), (ramp.goal, 0.0, 0.0)
    )
    return c0, c1, c2, c3, c4, c5


def _horner(powers: Iterable[Array] | Array, share: Array) -> Array:
    """Evaluate quintics, lowest coefficient first, at shares of their lengths, which are clipped to 0..1."""
    c0, c1, c2, c3, c4, c5 = powers
    s = np.clip(share, 0.0, 1.0)
    value: Array = c5 * s
    for coefficient in (c4, c3, c2, c1):
        value += coefficient
        value *= s
    value += c0
    return value


class Ramps:
    """Channels of many rows at a time that never goes back; Python runs only where a ramp begins.

    Stateful.

    Parameters
    ----------
    start : (C,) float64
        Values with which every row begins, at rest.
    """

    def __init__(self, start: Array) -> None:
        self._start = start
        self._count = 0
        self._waiting: list[list[Ramp]] = []
        self._due_s = np.full(FIRST_ROWS, np.inf)
        self._begun_s = np.zeros((len(start), FIRST_ROWS))
        self._rate = np.ones((len(start), FIRST_ROWS))
        self._quintic = np.zeros((6, len(start), FIRST_ROWS))

    def open(self) -> int:
        """Add a row behind the last, and return its number."""
        row = self._count
        if row == len(self._due_s):
            self._grow()
        self._count += 1
        self._waiting.append([])
        self._due_s[row] = np.inf
        self._quintic[:, :, row] = 0.0
        self._quintic[0, :, row] = self._start
        return row

    def close(self, row: int) -> None:
        """Take a row away; the last moves into its place."""
        last = self._count = self._count - 1
        for array in (self._due_s, self._begun_s, self._rate, self._quintic):
            array[..., row] = array[..., last]
        self._waiting[row] = self._waiting[last]
        self._waiting.pop()

    def send(self, row: int, ramps: Iterable[Ramp]) -> None:
        """Let channels glide; of ramps that begin at the same time the last one counts."""
        waiting = self._waiting[row]
        for ramp in ramps:
            if ramp.takes_over:
                waiting[:] = [later for later in waiting if later.channel != ramp.channel or later.at_s < ramp.at_s]
            insort(waiting, ramp, key=_time)
        del waiting[MAX_WAITING:]
        self._due_s[row] = waiting[0].at_s if waiting else np.inf

    def values(self, now_s: float) -> Array:
        """(C, rows): the value of every channel."""
        for row in np.flatnonzero(self._due_s[: self._count] <= now_s):
            self._begin_due(int(row), now_s)
        share = (now_s - self._begun_s[:, : self._count]) * self._rate[:, : self._count]
        return _horner(self._quintic[:, :, : self._count], share)

    def _begin_due(self, row: int, now_s: float) -> None:
        waiting = self._waiting[row]
        while waiting and waiting[0].at_s <= now_s:
            ramp = waiting.pop(0)
            channel = ramp.channel
            begun_s, length_s = float(self._begun_s[channel, row]), 1.0 / float(self._rate[channel, row])
            coefficients = tuple(self._quintic[:, channel, row].tolist())
            self._quintic[:, channel, row] = _next_quintic(ramp, coefficients, begun_s, length_s)
            self._begun_s[channel, row], self._rate[channel, row] = ramp.at_s, 1.0 / ramp.over_s
        self._due_s[row] = waiting[0].at_s if waiting else np.inf

    def _grow(self) -> None:
        more = len(self._due_s)
        self._due_s = np.concatenate([self._due_s, np.full(more, np.inf)])
        self._begun_s = np.pad(self._begun_s, ((0, 0), (0, more)))
        self._rate = np.pad(self._rate, ((0, 0), (0, more)), constant_values=1.0)
        self._quintic = np.pad(self._quintic, ((0, 0), (0, 0), (0, more)))
