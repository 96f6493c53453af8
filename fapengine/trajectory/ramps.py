"""Values that move smoothly to goals: levels of expressions, gaze, blinks, gains.

Theory of operation
-------------------
A ramp is a quintic from a channel's value, at rest, to its goal. The velocity and acceleration that the channel has at
its beginning are added as a second quintic, the *momentum*, from there to nothing, within the length of the ramp that
it comes from. So a channel is C2 whatever is sent when, and a slow ramp that takes over from a quick one does not carry
it out of its way. There are two ways to evaluate the same ramps: :func:`sample_ramps` for one face at many times
(offline), and :class:`Ramps` for many faces at one time, which never goes back (live).
"""

from bisect import bisect_right, insort
from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from fapengine._arrays import Array
from fapengine.trajectory import hermite

FIRST_ROWS = 16
MOMENTUM_S = 0.15
"""Longest time over which velocity and acceleration fade when a ramp takes over."""
MAX_WAITING = 1024
"""Number of ramps of a row that may wait for their beginning; of more, the latest is dropped."""
MAX_BEGINNING = 32
"""Number of ramps of a row that may begin in one frame, one after the other."""
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
    motion = _Motion(-np.inf, 1.0, 1.0, (start, 0.0, 0.0, 0.0, 0.0, 0.0), _NOTHING)
    motions = [motion]
    for ramp in queue:
        motion = motion.taken_over(ramp)
        motions.append(motion)
    begins = np.array([motion.at_s for motion in motions])
    index = np.searchsorted(begins, times_s, side="right") - 1
    since = np.where(index, times_s - begins[index], 0.0)
    values = np.zeros(len(times_s))
    for lengths, quintics in (
        ([motion.over_s for motion in motions], [motion.way for motion in motions]),
        ([motion.momentum_s for motion in motions], [motion.momentum for motion in motions]),
    ):
        values += _horner(np.array(quintics).T[:, index], since / np.array(lengths)[index])
    return values


Quintic = tuple[float, ...]
_NOTHING: Quintic = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class _Motion(NamedTuple):
    """A channel's way to a goal: lowest coefficients first, each per share of its own length."""

    at_s: float
    over_s: float
    momentum_s: float
    way: Quintic
    momentum: Quintic

    def taken_over(self, ramp: Ramp) -> "_Motion":
        """Continue with another ramp from here."""
        value = velocity = acceleration = 0.0
        momentum_s = min(ramp.over_s, MOMENTUM_S)
        for quintic, length_s in ((self.way, self.over_s), (self.momentum, self.momentum_s)):
            share = min(max((ramp.at_s - self.at_s) / length_s, 0.0), 1.0)
            jet = hermite.jet_of(quintic, share, length_s)
            value, velocity, acceleration = value + jet[0], velocity + jet[1], acceleration + jet[2]
            if share < 1.0:
                momentum_s = min(momentum_s, length_s)
        way = hermite.quintic(ramp.over_s, (value, 0.0, 0.0), (ramp.goal, 0.0, 0.0))
        momentum = hermite.quintic(momentum_s, (0.0, velocity, acceleration), (0.0, 0.0, 0.0))
        return _Motion(ramp.at_s, ramp.over_s, momentum_s, way, momentum)


def _horner(powers: Iterable[Array] | Array, share: Array) -> Array:
    """Evaluate quintics, lowest coefficient first, at shares of their lengths, which are clipped to 0..1."""
    c0, c1, c2, c3, c4, c5 = powers
    s = np.minimum(np.maximum(share, 0.0), 1.0)
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
        self._rate = np.ones((2, len(start), FIRST_ROWS))
        self._quintic = np.zeros((6, 2, len(start), FIRST_ROWS))

    def open(self) -> int:
        """Append a row, and return its number."""
        row = self._count
        if row == len(self._due_s):
            self._grow()
        self._count += 1
        self._waiting.append([])
        self._due_s[row] = np.inf
        self._quintic[..., row] = 0.0
        self._quintic[0, 0, :, row] = self._start
        return row

    def close(self, row: int) -> None:
        """Remove a row; the last moves into its place."""
        last = self._count = self._count - 1
        for array in (self._due_s, self._begun_s, self._rate, self._quintic):
            array[..., row] = array[..., last]
        self._waiting[row] = self._waiting[last]
        self._waiting.pop()

    def send(self, row: int, ramps: Iterable[Ramp]) -> None:
        """Start ramps of channels; of ramps that begin at the same time the last one counts."""
        waiting = self._waiting[row]
        for ramp in ramps:
            if ramp.takes_over:
                waiting[:] = [later for later in waiting if later.channel != ramp.channel or later.at_s < ramp.at_s]
            insort(waiting, ramp, key=_time)
        del waiting[MAX_WAITING:]
        self._due_s[row] = waiting[0].at_s if waiting else np.inf

    def values(self, now_s: float) -> Array:
        """(C, rows): the value of every channel."""
        for row in (self._due_s[: self._count] <= now_s).nonzero()[0]:
            self._begin_due(int(row), now_s)
        share = (now_s - self._begun_s[:, : self._count]) * self._rate[..., : self._count]
        way, momentum = _horner(self._quintic[..., : self._count], share)
        values: Array = way + momentum
        return values

    def _begin_due(self, row: int, now_s: float) -> None:
        waiting = self._waiting[row]
        count = bisect_right(waiting, now_s, key=_time)
        due, self._waiting[row] = waiting[:count], waiting[count:]
        if count > MAX_BEGINNING:  # between two frames only the last ramp of a channel matters to the eye
            due = list({ramp.channel: ramp for ramp in due}.values())
        for ramp in due:
            place = ramp.channel, row
            over_s, momentum_s = (1.0 / self._rate[:, *place]).tolist()
            way, momentum = self._quintic[:, :, *place].T.tolist()
            motion = _Motion(float(self._begun_s[place]), over_s, momentum_s, way, momentum).taken_over(ramp)
            self._quintic[:, :, *place] = np.array((motion.way, motion.momentum)).T
            self._begun_s[place] = motion.at_s
            self._rate[:, *place] = 1.0 / motion.over_s, 1.0 / motion.momentum_s
        self._due_s[row] = waiting[count].at_s if count < len(waiting) else np.inf

    def _grow(self) -> None:
        more = len(self._due_s)
        self._due_s = np.concatenate([self._due_s, np.full(more, np.inf)])
        self._begun_s = np.pad(self._begun_s, ((0, 0), (0, more)))
        self._rate = np.pad(self._rate, ((0, 0), (0, 0), (0, more)), constant_values=1.0)
        self._quintic = np.pad(self._quintic, ((0, 0), (0, 0), (0, 0), (0, more)))
