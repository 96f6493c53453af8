"""Curves as other programs play them: keys at times, straight between them or cubic with a tangent at each.

Few keys are the via points of paper 004 (:mod:`.via_points`), taken here for the natural cubic spline, which a cubic
Hermite curve with the spline's own slopes at its keys repeats exactly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.models.via_points import MIN_POINTS, choose_frames, natural_spline

Array = NDArray[np.float64]

STRAIGHT, CUBIC = "linear", "cubic"
WAYS = (STRAIGHT, CUBIC)
"""Ways to go from key to key."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyedCurve:
    """Values at times. Arrays are read-only."""

    times_s: Array
    """(N,), rising from 0."""
    values: Array
    """(N, W)."""
    slopes: Array | None = None
    """(N, W) a second, of the cubic Hermite curve; None where it goes straight from key to key."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "times_s", frozen(self.times_s, "times_s", ("N",), np.float64))
        object.__setattr__(self, "values", frozen(self.values, "values", (len(self.times_s), "W"), np.float64))
        if self.slopes is not None:
            object.__setattr__(self, "slopes", frozen(self.slopes, "slopes", self.values.shape, np.float64))


def key_curve(values: Array, rate_hz: float, way: str = STRAIGHT, tolerance: float = 0.0) -> KeyedCurve:
    """Make a curve of frames.

    Parameters
    ----------
    values : (T, W)
        T >= 1; the first is at 0 s.
    rate_hz : float
    way : str
        ``"linear"``: a key a frame, all that changes nothing left out. ``"cubic"``: few keys.
    tolerance : float
        Largest distance of any cubic value from its frame's.

    Raises
    ------
    UsageError
        If there is no such way, or a cubic curve's tolerance is not positive.
    """
    if way not in WAYS:
        raise UsageError(f"keys: got {way!r}, expected {' or '.join(WAYS)}")
    times = np.arange(len(values)) / rate_hz
    if way == STRAIGHT or len(times) < MIN_POINTS:
        kept = _bends(values)
        return KeyedCurve(times[kept], values[kept])
    if not tolerance > 0:
        raise UsageError(f"tolerance: got {tolerance}, expected a positive number")
    moving = np.ptp(values, axis=0) > 0
    if not moving.any():
        return KeyedCurve(times[:1], values[:1], np.zeros_like(values[:1]))
    frames = choose_frames(values[:, moving, None], tolerance, degree=3)
    slopes = np.zeros((len(frames), values.shape[1]))
    slopes[:, moving] = natural_spline(times[frames], values[frames][:, moving], degree=3).derivative()(times[frames])
    return KeyedCurve(times[frames], values[frames], slopes)


def _bends(values: Array) -> NDArray[np.int64]:
    """Frames that are not just like the one before and the one behind."""
    still = (values[1:] == values[:-1]).all(axis=1)
    spared = np.zeros(len(values), bool)
    spared[1:-1] = still[:-1] & still[1:]
    return np.flatnonzero(~spared)
