"""Many values that glide from where they are to where they are sent: expressions, gaze, blinks, gains.

A ramp is a quintic from a channel's value, velocity and acceleration at its start to rest at its goal, so a channel is
C2 whatever is sent when. Channels of all rows lie in arrays and are evaluated at once; Python runs only where a ramp
begins.
"""

from bisect import insort
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.trajectory import hermite

Array = NDArray[np.float64]

FIRST_ROWS = 16
MOST_WISHES = 1024
"""Of a row: of more, the latest is dropped."""


@dataclass(frozen=True, slots=True, order=True)
class _Wish:
    at_s: float
    order: int
    channel: int
    goal: float
    over_s: float


class Ramps:
    """Stateful: ``channels`` values in each of many rows. Time never goes back.

    Parameters
    ----------
    start : (C,) float64
        Where every row begins, at rest.
    """

    def __init__(self, start: Array) -> None:
        self._start = start
        self._count = 0
        self._order = 0
        self._wishes: list[list[_Wish]] = []
        self._due_s = np.full(FIRST_ROWS, np.inf)
        self._from_s = np.zeros((len(start), FIRST_ROWS))
        self._rate = np.ones((len(start), FIRST_ROWS))
        self._quintic = np.zeros((6, len(start), FIRST_ROWS))

    def open(self) -> int:
        """Add a row behind the last, and tell its number."""
        row = self._count
        if row == len(self._due_s):
            self._grow()
        self._count += 1
        self._wishes.append([])
        self._due_s[row] = np.inf
        self._quintic[:, :, row] = 0.0
        self._quintic[0, :, row] = self._start
        return row

    def close(self, row: int) -> None:
        """Take a row away; the last moves into its place."""
        last = self._count = self._count - 1
        for array in (self._due_s, self._from_s, self._rate, self._quintic):
            array[..., row] = array[..., last]
        self._wishes[row] = self._wishes[last]
        self._wishes.pop()

    def send(self, row: int, channel: int, at_s: float, goal: float, over_s: float) -> None:
        """Let a channel glide to a goal from a time on, over a time; a later ramp takes over from an earlier one."""
        self._order += 1
        insort(self._wishes[row], _Wish(at_s, self._order, channel, goal, over_s))
        del self._wishes[row][MOST_WISHES:]
        self._due_s[row] = self._wishes[row][0].at_s

    def forget(self, row: int, channel: int, from_s: float) -> None:
        """Drop what a channel was to do from a time on."""
        kept = [wish for wish in self._wishes[row] if wish.channel != channel or wish.at_s < from_s]
        self._wishes[row] = kept
        self._due_s[row] = kept[0].at_s if kept else np.inf

    def values(self, now_s: float) -> Array:
        """(C, rows): where everything is."""
        for row in np.flatnonzero(self._due_s[: self._count] <= now_s):
            self._begin_due(int(row), now_s)
        s = np.clip((now_s - self._from_s[:, : self._count]) * self._rate[:, : self._count], 0.0, 1.0)
        powers = self._quintic[:, :, : self._count]
        value: Array = powers[5] * s
        for power in (4, 3, 2, 1):
            value += powers[power]
            value *= s
        value += powers[0]
        return value

    def _begin_due(self, row: int, now_s: float) -> None:
        wishes = self._wishes[row]
        while wishes and wishes[0].at_s <= now_s:
            wish = wishes.pop(0)
            channel = wish.channel
            length_s = 1.0 / float(self._rate[channel, row])
            since_s = wish.at_s - float(self._from_s[channel, row])
            s = min(max(since_s / length_s, 0.0), 1.0)
            first = hermite.jet_of(self._quintic[:, channel, row].tolist(), s, length_s)
            self._quintic[:, channel, row] = hermite.quintic(wish.over_s, first, (wish.goal, 0.0, 0.0))
            self._from_s[channel, row], self._rate[channel, row] = wish.at_s, 1.0 / wish.over_s
        self._due_s[row] = wishes[0].at_s if wishes else np.inf

    def _grow(self) -> None:
        more = len(self._due_s)
        self._due_s = np.concatenate([self._due_s, np.full(more, np.inf)])
        self._from_s = np.pad(self._from_s, ((0, 0), (0, more)))
        self._rate = np.pad(self._rate, ((0, 0), (0, more)), constant_values=1.0)
        self._quintic = np.pad(self._quintic, ((0, 0), (0, 0), (0, more)))
