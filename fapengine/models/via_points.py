"""Via points: few poses through which a minimum-jerk spline retraces a captured motion; paper 004, "Interpolation".

Theory of operation
-------------------
The curve with the least squared jerk through given points at given times, its ends free, is the natural quintic spline:
degree 5, C4, third and fourth derivative zero at both ends. Frames of the capture serve as via points. Wanted are as
few as keep *every marker in every frame* within a distance of the capture.

1. Insertion: between two via points, wherever the curve is too far off, the worst frame becomes one; all intervals at
   once, until nothing is too far.
2. Pruning: each via point is tried for removal on a window of neighbours, the least needed first. A quintic forgets a
   change by a factor of 0.43 for each point, so 12 neighbours on each side suffice. Step 1 repairs what is then too far
   off.

Noise needs points too: 0.15 mm of it at a bound of 0.75 mm made three of four frames via points. Filter first
(:func:`fapengine.geometry.smooth.low_pass`); speech moves the face below 12 Hz.

For other programs the same method finds few keys of a natural cubic spline, which a cubic Hermite curve with the
spline's own slopes at its keys repeats exactly (:class:`KeyedCurve`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, Indices, Mask, freeze, frozen
from fapengine._strict_toml import checked
from fapengine.errors import UsageError

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

WINDOW = 12
"""Neighbours on each side that a removal is judged with: 0.43^12 is 4e-5; a cubic forgets by 0.27."""

MIN_POINTS = 3
"""A natural quintic through two points is not unique."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ViaPoints:
    """Times and poses of a minimum-jerk curve. Arrays are read-only."""

    times_s: Array
    """(N,), rising, N >= 3."""
    positions_mm: Array
    """(N, M, 3)."""

    def __len__(self) -> int:
        return len(self.times_s)

    def __post_init__(self) -> None:
        freeze(self, times_s=("N",), positions_mm=("N", "M", 3))
        if len(self.times_s) < MIN_POINTS or (np.diff(self.times_s) <= 0).any():
            raise UsageError(f"times_s: needs at least {MIN_POINTS} times, strictly rising, got {len(self.times_s)}")

    def sample(self, times_s: ArrayLike) -> Array:
        """(T, M, 3) mm: the curve at ``times_s``; before the first and after the last point it does not move."""
        times = np.clip(np.asarray(times_s, dtype=np.float64), self.times_s[0], self.times_s[-1])
        flat = self.positions_mm.reshape(len(self.times_s), -1)
        return natural_spline(self.times_s, flat)(times).reshape(len(times), -1, 3)

    def frames(self, rate_hz: float) -> Array:
        """(T, M, 3) mm: the curve at a frame rate, from 0 s to the last point."""
        return self.sample(np.arange(int(self.times_s[-1] * rate_hz + 1e-9) + 1) / rate_hz)


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """Reduction of the data, and its error."""

    tolerance_mm: float
    point_count: int
    share: float
    """Via points per frame, 0..1."""
    mean_mm: float
    """Mean distance of a marker to its captured place."""
    max_mm: float


@checked
def extract_via_points(positions_mm: ArrayLike, rate_hz: float, tolerance_mm: float) -> ViaPoints:
    """Find few frames with a minimum-jerk curve that keeps every marker of every frame within ``tolerance_mm``.

    Parameters
    ----------
    positions_mm : (T, M, 3) array_like, mm
        At least 3 frames.
    rate_hz : float
        Frame rate; the first frame is at 0 s.
    tolerance_mm : float
        The paper's error criterion: largest distance.

    Returns
    -------
    ViaPoints
        ``times_s`` (N,) s and ``positions_mm`` (N, M, 3); ``frames(rate_hz)`` gives the motion at any rate.

    Raises
    ------
    UsageError
        If the frames are too few, or rate or tolerance not positive.
    """
    positions = frozen(positions_mm, "positions_mm", ("T", "M", 3), np.float64)
    if len(positions) < MIN_POINTS:
        raise UsageError(f"positions_mm: needs at least {MIN_POINTS} frames, got {len(positions)}")
    if not (rate_hz > 0 and tolerance_mm > 0):
        raise UsageError(f"rate_hz, tolerance_mm: got {rate_hz} and {tolerance_mm}, expected positive numbers")
    frames = choose_frames(positions, tolerance_mm)
    return ViaPoints(times_s=frames / rate_hz, positions_mm=positions[frames])


def choose_frames(positions: Array, tolerance: float, *, degree: int = 5) -> Indices:
    """Find few frames with a natural spline that keeps every point of every frame within ``tolerance``.

    Parameters
    ----------
    positions : (T, M, D)
        At least 3 frames; distances are of all D coordinates together.
    tolerance : float
        In the unit of the positions.
    degree : int
        5 for the curve of least jerk, 3 for that of least acceleration, which other programs can play.

    Returns
    -------
    (N,) int64
        Frames, rising; the first and the last are among them.
    """
    motion = _Motion(positions, degree)
    chosen = np.zeros(len(positions), dtype=bool)
    chosen[[0, len(positions) // 2, -1]] = True
    _insert(motion, chosen, tolerance)
    _prune(motion, chosen, tolerance)
    _insert(motion, chosen, tolerance)
    return np.flatnonzero(chosen)


def reduction_curve(positions_mm: ArrayLike, rate_hz: float, tolerances_mm: ArrayLike) -> list[Reduction]:
    """Weigh data reduction against error, an entry for each tolerance, (N,) mm; else as :func:`extract_via_points`."""
    positions = frozen(positions_mm, "positions_mm", ("T", "M", 3), np.float64)
    times = np.arange(len(positions)) / rate_hz
    curve = []
    for tolerance in np.asarray(tolerances_mm, dtype=np.float64).tolist():
        points = extract_via_points(positions, rate_hz, tolerance)
        off = np.linalg.norm(points.sample(times) - positions, axis=-1)
        count = len(points.times_s)
        curve.append(Reduction(tolerance, count, count / len(positions), float(off.mean()), float(off.max())))
    return curve


def natural_spline(times: Array, values: Array, degree: int = 5) -> BSpline:
    """Lay the spline of degree 3 or 5 with free ends through values, (N, W), at times, (N,) rising, N >= 3."""
    from scipy.interpolate import make_interp_spline

    zero = np.zeros(values.shape[1])
    free = [(order, zero) for order in range((degree + 1) // 2, degree)]
    return make_interp_spline(times, values, k=degree, bc_type=(free, free))  # type: ignore[arg-type]  # the stubs lack derivatives


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Motion that a spline of a degree must retrace."""

    positions: Array
    """(T, M, D)."""
    degree: int

    def off(self, frames: Indices, at: Indices) -> Array:
        """(T,): squared distance of the worst point at some frames from the spline through others."""
        flat = self.positions.reshape(len(self.positions), -1)
        curve = natural_spline(frames.astype(np.float64), flat[frames], self.degree)(at.astype(np.float64))
        away = curve.reshape(len(at), *self.positions.shape[1:]) - self.positions[at]
        return np.asarray((away**2).sum(axis=-1).max(axis=-1))


def _insert(motion: _Motion, chosen: Mask, tolerance: float) -> None:
    """Step 1, in place: set frames in ``chosen`` until the curve is near everywhere."""
    every = np.arange(len(chosen))
    while True:
        frames = np.flatnonzero(chosen)
        off = motion.off(frames, every)
        off[frames] = 0.0
        if off.max() <= tolerance**2:
            return
        worst = np.maximum.reduceat(off, frames[:-1])
        for start, stop, peak in zip(frames[:-1], frames[1:], worst, strict=True):
            if peak > tolerance**2:
                chosen[start + off[start:stop].argmax()] = True


def _prune(motion: _Motion, chosen: Mask, tolerance: float) -> None:
    """Step 2, in place: clear frames in ``chosen`` that their neighbours can spare."""
    frames = np.flatnonzero(chosen)
    need = {int(frame): _error_without(motion, chosen, int(frame)) for frame in frames[1:-1]}
    for frame in sorted(need, key=need.__getitem__):
        if need[frame] > 4 * tolerance**2 or chosen.sum() <= MIN_POINTS:
            break
        if _error_without(motion, chosen, frame) <= tolerance**2:
            chosen[frame] = False


def _error_without(motion: _Motion, chosen: Mask, frame: int) -> float:
    """Largest squared distance within half a window when ``frame`` is not a via point."""
    before = np.flatnonzero(chosen[:frame])[-WINDOW:]
    later = frame + 1 + np.flatnonzero(chosen[frame + 1 :])[:WINDOW]
    frames = np.concatenate([before, later])
    if len(frames) < MIN_POINTS:
        return np.inf
    inner = np.arange(before[-(WINDOW // 2) :][0], later[: WINDOW // 2][-1] + 1)
    return float(motion.off(frames, inner).max())


STRAIGHT, CUBIC = "linear", "cubic"
WAYS = (STRAIGHT, CUBIC)
"""Interpolations between keys."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyedCurve:
    """Values at times. Arrays are read-only."""

    times_s: Array
    """(N,), rising from 0."""
    values: Array
    """(N, W)."""
    slopes: Array | None = None
    """(N, W) per second, of the cubic Hermite curve; None for linear interpolation."""

    def __post_init__(self) -> None:
        freeze(self, times_s=("N",), values=("N", "W"))
        if self.slopes is not None:
            freeze(self, slopes=self.values.shape)


def key_curve(values: Array, rate_hz: float, way: str = STRAIGHT, tolerance: float = 0.0) -> KeyedCurve:
    """Make a curve of frames.

    Parameters
    ----------
    values : (T, W)
        T >= 1; the first is at 0 s.
    way : str
        ``"linear"``: a key per frame, without those that change nothing. ``"cubic"``: few keys.
    tolerance : float
        Largest distance of any cubic value from its frame's.
    """
    if way not in WAYS:
        raise UsageError(f"keys: got {way!r}, expected {' or '.join(WAYS)}")
    times = np.arange(len(values)) / rate_hz
    if way == STRAIGHT or len(times) < MIN_POINTS:
        kept = _bends(values)
        return KeyedCurve(times[kept], values[kept])
    if not tolerance > 0:
        raise UsageError(f"tolerance: must be a positive number, got {tolerance}")
    moving = np.ptp(values, axis=0) > 0
    if not moving.any():
        return KeyedCurve(times[:1], values[:1], np.zeros_like(values[:1]))
    frames = choose_frames(values[:, moving, None], tolerance, degree=3)
    slopes = np.zeros((len(frames), values.shape[1]))
    slopes[:, moving] = natural_spline(times[frames], values[frames][:, moving], degree=3).derivative()(times[frames])
    return KeyedCurve(times[frames], values[frames], slopes)


def _bends(values: Array) -> Indices:
    """Frames that differ from the one before or the one after."""
    still = (values[1:] == values[:-1]).all(axis=1)
    spared = np.zeros(len(values), bool)
    spared[1:-1] = still[:-1] & still[1:]
    return np.flatnonzero(~spared)
