"""A C2 path through keyframes that later keys do not change: quintic Hermite segments.

Theory of operation
-------------------
At each key, velocity and acceleration are those of the parabola through it and its two neighbours; at both ends of the
path they are zero. A segment between two keys is the quintic with these values, so the path passes its keys, is C2
everywhere, and a change of one key changes nothing beyond two keys to either side, bit by bit. A natural cubic spline
passes a change on for ever, by a factor of 0.27 a key; a stream needs a local path.

Where keys stand at uneven distances the parabola's velocity is limited: alone it may not carry a key farther along the
longer of its two segments than its three keys range. That bounds the overshoot (:data:`OVERSHOOT`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array

Number = TypeVar("Number", float, Array)
Three = tuple[Number, ...]
"""Value, velocity and acceleration."""

PIECE = 4096
"""Number of times that are sampled at once: what is computed on the way takes 30 times the memory of the result."""
MAX_DERIVATIVES = 1.0, 3.0
"""Largest velocity times the longer segment, and acceleration times its square, in ranges of the three keys.
Even distances never reach it, nor do uneven ones up to 1.6 to 1."""
OVERSHOOT = 0.25
"""Share of the range of four keys by which the path may leave the range of the two keys that it runs between (worst
case, found by search; without the limit there is none)."""


def derivatives(times_s: Array, values: Array, path_of: NDArray[np.intp]) -> tuple[Array, Array]:
    """Velocity and acceleration at every key: (N,) s and (N, K) -> (N, K) each; zero at both ends of a path.

    ``path_of``, (N,), rising, is the number of the path that a key belongs to.
    """
    velocity, acceleration = np.zeros_like(values), np.zeros_like(values)
    if len(times_s) > 2:
        step, is_end = (times_s[1:] - times_s[:-1])[:, None], path_of[1:] != path_of[:-1]
        step[is_end] = 1.0  # of no path
        slope = values[1:] - values[:-1]
        slope /= step
        before, after = step[:-1], step[1:]
        longer, both = np.maximum(before, after), before + after
        first, second, third = values[:-2], values[1:-1], values[2:]
        most = np.maximum(first, second)
        np.maximum(most, third, out=most)
        least = np.minimum(first, second)
        most -= np.minimum(least, third, out=least)
        parabola, bend = velocity[1:-1], acceleration[1:-1]
        np.multiply(after / both, slope[:-1], out=parabola)
        parabola += before / both * slope[1:]
        np.subtract(slope[1:], slope[:-1], out=bend)
        bend *= 2 / both
        for found, limit in ((parabola, MAX_DERIVATIVES[0] / longer), (bend, MAX_DERIVATIVES[1] / longer**2)):
            bound = np.multiply(limit, most, out=least)
            np.minimum(found, bound, out=found)
            np.maximum(found, np.negative(bound, out=bound), out=found)
        ends = is_end.nonzero()[0]
        for still in (velocity, acceleration):
            still[ends] = still[ends + 1] = 0.0
    return velocity, acceleration


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Keys with their derivatives, ready to be sampled. Before the first and after the last key it is constant."""

    times_s: Array
    """(N,) s, strictly rising, N >= 2."""
    jets: Array
    """(N, 3, K): value, velocity and acceleration at every key."""

    def jet(self, at_s: Array) -> Three[Array]:
        """Value, velocity and acceleration at any times: (T,) s -> (T, K) each."""
        at = np.clip(at_s, self.times_s[0], self.times_s[-1])
        left = np.clip(np.searchsorted(self.times_s, at, side="right") - 1, 0, len(self.times_s) - 2)
        length = (self.times_s[left + 1] - self.times_s[left])[:, None]
        first, last = np.moveaxis(self.jets[left], 1, 0), np.moveaxis(self.jets[left + 1], 1, 0)
        since = (at - self.times_s[left])[:, None]
        return jet_of(quintic(length, tuple(first), tuple(last)), since / length, length)

    def sample(self, at_s: Array) -> Array:
        """Values at any times: (T,) s -> (T, K)."""
        sampled = np.zeros((len(at_s), self.jets.shape[2]))
        for start in range(0, len(at_s), PIECE):
            piece = slice(start, start + PIECE)
            sampled[piece] = self.jet(at_s[piece])[0]
        return sampled


def paths(times_s: Array, values: Array, path_of: NDArray[np.intp], count: int) -> list[Path]:
    """Make paths through keys; a path with fewer than two keys stays at 0.

    Parameters
    ----------
    times_s : (N,) float64, s
    values : (N, K) float64
    path_of : (N,) int
        Path of each key, rising.
    count : int
        Number of paths.
    """
    jets = np.stack([values, *derivatives(times_s, values, path_of)], axis=1)
    edges = np.searchsorted(path_of, np.arange(count + 1)).tolist()
    neutral = Path(np.array([0.0, 1.0]), np.zeros((2, 3, values.shape[1])))
    return [
        Path(times_s[first:stop], jets[first:stop]) if stop - first >= 2 else neutral for first, stop in pairwise(edges)
    ]


class Row(NamedTuple):
    """Keys of many paths, one path after the other."""

    times_s: Array
    """(N,) s."""
    first: NDArray[np.intp]
    """(S,): place of each path's first key."""
    counts: NDArray[np.intp]
    """(S,): number of its keys."""
    left: NDArray[np.intp]
    """(S,): of its keys, the one before the time that was asked for; never the last."""


def in_a_row(paths: Sequence[Path], times_s: Array) -> Row:
    """Put the keys of paths in a row, and find where each path is at a time of its own, (S,) s."""
    counts = np.array([len(path.times_s) for path in paths])
    first = np.cumsum(counts) - counts
    keys_s = np.concatenate([path.times_s for path in paths])
    passed = np.add.reduceat(keys_s <= np.repeat(times_s, counts), first, dtype=np.intp)
    return Row(keys_s, first, counts, np.minimum(np.maximum(passed - 1, 0), counts - 2))


def jets_at(paths: Sequence[Path], times_s: Array) -> Array:
    """Value, velocity and acceleration of many paths, each at a time of its own: (S,) s -> (S, 3, K)."""
    row = in_a_row(paths, times_s)
    start_s, end_s = row.times_s[row.first + row.left], row.times_s[row.first + row.left + 1]
    ends = [path.jets[left : left + 2] for path, left in zip(paths, row.left.tolist(), strict=True)]
    both = np.concatenate(ends).reshape(len(paths), 6, -1)
    since_s = np.minimum(np.maximum(times_s, start_s), end_s) - start_s
    return moments(since_s, end_s - start_s) @ both


def quintic(length_s: Number, first: Three[Number], last: Three[Number]) -> tuple[Number, ...]:
    """Coefficients of ``1, s, .. s^5`` of the quintic from ``first`` to ``last``; ``s`` is 1 after ``length_s``."""
    leave = (first[0], first[1] * length_s, first[2] * length_s**2)
    reach = (last[0], last[1] * length_s, last[2] * length_s**2)
    rest = reach[0] - leave[0] - leave[1] - leave[2] / 2  # what the three upper coefficients must make up for at s = 1
    slope = reach[1] - leave[1] - leave[2]
    bend = reach[2] - leave[2]
    c3 = 10 * rest - 4 * slope + bend / 2
    c4 = -15 * rest + 7 * slope - bend
    c5 = 6 * rest - 3 * slope + bend / 2
    return leave[0], leave[1], leave[2] / 2, c3, c4, c5


def jet_of(coefficients: Sequence[Number], s: Number, length_s: Number) -> Three[Number]:
    """Value, velocity and acceleration of what :func:`quintic` found, at ``s`` of its length."""
    c0, c1, c2, c3, c4, c5 = coefficients
    value = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    velocity = c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    acceleration = 2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return value, velocity / length_s, acceleration / length_s**2


def moments(since_s: Array, length_s: Array) -> Array:
    """Matrices from the jets at both ends of quintics, value first, to their jets ``since_s`` after the start.

    Parameters
    ----------
    since_s, length_s : (S,) float64, s

    Returns
    -------
    (S, 3, 6) float64
    """
    jets = np.zeros((3, 6, len(since_s)))
    value, velocity, acceleration = jets
    value[:] = powers(since_s / length_s)
    np.multiply(_SLOPES, value[:5] / length_s, out=velocity[1:])
    np.multiply(_SLOPES[1:], velocity[1:5] / length_s, out=acceleration[2:])
    lengths = length_s**_DEGREES
    matrices: Array = (jets.transpose(2, 0, 1) @ UNITS) * lengths.T[:, None]
    return matrices


def powers(s: Array) -> Array:
    """(6, S): ``1, s, .. s^5`` of (S,)."""
    found = np.ones((6, len(s)))
    found[1] = s
    squared = np.multiply(s, s, out=found[2])
    cubed = np.multiply(squared, s, out=found[3])
    np.multiply(squared, squared, out=found[4])
    np.multiply(squared, cubed, out=found[5])
    return found


def fading(of_value: Array, s: Array) -> tuple[Array, Array, Array]:
    """Share of a value, a velocity and an acceleration that is left, (T,) each, of a fade: nothing at 1.

    The value's fade is at ``of_value``, (T,) 0..1, theirs, which is shorter, at ``s``. They count per fade and per fade
    squared.
    """
    value: Array = 1 + of_value * of_value * of_value * (-10 + of_value * (15 - 6 * of_value))
    s3 = s * s * s
    velocity: Array = s + s3 * (-6 + s * (8 - 3 * s))
    acceleration: Array = s * s / 2 + s3 * (-1.5 + s * (1.5 - s / 2))
    return value, velocity, acceleration


_SLOPES, _DEGREES = np.arange(1.0, 6.0)[:, None], np.array([0.0, 1.0, 2.0] * 2)[:, None]
UNITS = np.stack(quintic(np.ones(1), tuple(np.eye(6)[:3]), tuple(np.eye(6)[3:])))
"""(6, 6): coefficients of the quintics whose jets at both ends, one after the other, are unit vectors; length 1."""
