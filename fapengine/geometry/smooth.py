"""Smooth steps and bumps with continuous curvature (C2), Gaussian spots, and a low-pass filter without delay."""

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array
from fapengine.errors import UsageError


def smoothstep(x: ArrayLike) -> Array:
    """Minimum-jerk step from 0 at ``x <= 0`` to 1 at ``x >= 1``; value, slope and curvature join at both ends.

    ``6 x^5 - 15 x^4 + 10 x^3``: rest to rest with the least squared jerk (Flash and Hogan 1985).

    Examples
    --------
    >>> smoothstep([-1, 0, 0.5, 1, 2]).tolist()
    [0.0, 0.0, 0.5, 1.0, 1.0]
    """
    t = np.minimum(np.maximum(np.asarray(x, dtype=np.float64), 0.0), 1.0)  # np.clip takes three times as long
    inner = 6.0 * t - 15.0
    inner *= t  # in place: new arrays of this size cost as much as their values
    inner += 10.0
    cubed = t * t
    cubed *= t
    cubed *= inner
    return np.asarray(cubed)


def bump(x: ArrayLike, start: float | Array, stop: float | Array, rise: float, fall: float | Array) -> Array:
    """1 between ``start`` and ``stop``; rises over ``rise`` before and falls over ``fall`` after; C2.

    Examples
    --------
    >>> bump([0.0, 1.0, 1.5, 2.0, 3.0], 1.0, 2.0, 1.0, 1.0).tolist()
    [0.0, 1.0, 1.0, 1.0, 0.0]
    """
    t = np.asarray(x, dtype=np.float64)
    return np.asarray(smoothstep((t - start + rise) / rise) * smoothstep((stop + fall - t) / fall))


def spot(x: Array, y: Array, centre: tuple[float, float], size: tuple[float, float], power: float = 2.0) -> Array:
    """Gaussian over a plane, (...): 1 at the centre, 1 / e at a distance of ``size`` along either axis.

    Examples
    --------
    >>> spot(np.array([3.0, 5.0]), np.array([1.0, 1.0]), (3.0, 1.0), (2.0, 4.0)).round(4).tolist()
    [1.0, 0.3679]
    """
    return np.exp(-(np.abs((x - centre[0]) / size[0]) ** power) - np.abs((y - centre[1]) / size[1]) ** power)


def soft_positive(x: ArrayLike, width: float) -> Array:
    """0 for ``x <= 0``, ``x - width / 2`` for ``x >= width``, C2 between: a smooth ``max(x, 0)``.

    Its slope is the cubic smoothstep ``3 s^2 - 2 s^3`` with ``s = x / width``.

    Examples
    --------
    >>> soft_positive([-1.0, 0.0, 0.5, 2.0], 0.5).tolist()
    [0.0, 0.0, 0.25, 1.75]
    """
    above = np.maximum(np.asarray(x, dtype=np.float64), 0.0)
    bent = np.minimum(above, width)
    s = bent / width
    soft = s * -0.5  # above - bent (1 - s^2 (1 - s / 2)), in place as in smoothstep
    soft += 1.0
    soft *= s
    soft *= s
    soft -= 1.0
    soft *= bent
    soft += above
    return np.asarray(soft)


def low_pass(values: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Remove frequencies above ``cutoff_hz`` without delay: (T, ...) -> (T, ...).

    A second-order Butterworth filter, run forwards and backwards.

    Raises
    ------
    UsageError
        If ``cutoff_hz`` is not between 0 and half the rate.
    """
    from scipy.signal import butter, sosfiltfilt  # it loads scipy.stats: a quarter of a second at every start

    if not 0 < cutoff_hz < rate_hz / 2:
        raise UsageError(f"cutoff_hz: must be between 0 and half the rate, {rate_hz / 2}, got {cutoff_hz}")
    return np.asarray(sosfiltfilt(butter(2, cutoff_hz, fs=rate_hz, output="sos"), values, axis=0))
