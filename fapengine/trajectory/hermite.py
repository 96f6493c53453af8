"""A C2 path through keyframes that a later key cannot reach back into: quintic Hermite segments.

Theory of operation
-------------------
At each key, velocity and acceleration are those of the parabola through it and its two neighbours; at both ends of the
path they are zero. A segment between two keys is the quintic with these values, so the path passes its keys, is C2
everywhere, and a change of one key changes nothing beyond two keys to either side, bit by bit. A natural cubic spline
passes a change on for ever, by a factor of 0.27 a key; that is why a stream uses this one.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def derivatives(times_s: Array, values: Array) -> tuple[Array, Array]:
    """Velocity and acceleration at every key: (N,) s and (N, K) -> (N, K) each; zero at both ends."""
    velocity, acceleration = np.zeros_like(values), np.zeros_like(values)
    if len(times_s) > 2:
        step = np.diff(times_s)[:, None]
        slope = np.diff(values, axis=0) / step
        before, after = step[:-1], step[1:]
        velocity[1:-1] = (after * slope[:-1] + before * slope[1:]) / (before + after)
        acceleration[1:-1] = 2 * (slope[1:] - slope[:-1]) / (before + after)
    return velocity, acceleration


def sample(times_s: Array, values: Array, at_s: Array) -> Array:
    """Values of the path at any times: (T, K); before the first and behind the last key it stands still.

    Parameters
    ----------
    times_s : (N,) float64, s
        Keys, strictly rising, N >= 2.
    values : (N, K) float64
    at_s : (T,) float64, s
    """
    return jet(times_s, values, at_s)[0]


Jet = tuple[Array, Array, Array]
"""Value, velocity and acceleration."""


def jet(times_s: Array, values: Array, at_s: Array) -> Jet:
    """Value, velocity and acceleration of the path at any times, (T, K) each; parameters as :func:`sample`."""
    velocity, acceleration = derivatives(times_s, values)
    at = np.clip(at_s, times_s[0], times_s[-1])
    left = np.clip(np.searchsorted(times_s, at, side="right") - 1, 0, len(times_s) - 2)
    length = (times_s[left + 1] - times_s[left])[:, None]
    first, last = ((values[key], velocity[key], acceleration[key]) for key in (left, left + 1))
    return blend((at - times_s[left])[:, None], length, first, last)


def blend(since_s: Array, length_s: Array, first: Jet, last: Jet) -> Jet:
    """Evaluate the quintic from ``first`` to ``last``, ``length_s`` apart, at ``since_s`` after its start."""
    s = since_s / length_s
    leave = (first[0], first[1] * length_s, first[2] * length_s**2)
    reach = (last[0], last[1] * length_s, last[2] * length_s**2)
    rest = reach[0] - leave[0] - leave[1] - leave[2] / 2  # what the three upper coefficients must make up for at s = 1
    slope = reach[1] - leave[1] - leave[2]
    bend = reach[2] - leave[2]
    c3 = 10 * rest - 4 * slope + bend / 2
    c4 = -15 * rest + 7 * slope - bend
    c5 = 6 * rest - 3 * slope + bend / 2
    value: Array = leave[0] + s * (leave[1] + s * (leave[2] / 2 + s * (c3 + s * (c4 + s * c5))))
    velocity: Array = leave[1] + s * (leave[2] + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    acceleration: Array = leave[2] + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return value, velocity / length_s, acceleration / length_s**2
