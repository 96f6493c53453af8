"""Sound that was recorded together with positions, and whether the two belong together in time.

A face moves when it speaks: the loudness of the sound follows the speed of the markers. Shifted against each other, the
two fit best at the delay between them (a few hundredths of a second on one clock).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError

PEAK = 0.5 * 2**15
"""Largest sample after scaling; analog channels are volts."""
MAX_SAMPLE = 1e300
"""Larger samples are damage, and count as 0."""
RATES_HZ = (4_000, 768_000)
"""Lowest and highest sample rate of sound; slower channels are forces and switches."""
REACH_S, MIN_S = 0.5, 6.0
"""Greatest delay that is tried, and least length of a recording."""
LATE_S, CLEARER, CLEAR_R = 0.1, 0.12, 0.3
"""Delay from which a recording is doubted, if the correlation there is this much higher than without, and this high. Of
15 filmed pieces of 12 s none is doubted, and 11 whose sound was delayed by 0.2 s."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSound:
    """Sound of a recording of positions; it begins with the first frame. Arrays are read-only."""

    label: str
    """Name of its channel."""
    samples: NDArray[np.int16]
    """(N,): scaled to a peak of half the range."""
    rate_hz: int

    @classmethod
    def of(cls, label: str, values: NDArray[np.float64], rate_hz: float) -> "RecordedSound":
        """Sound of any scale, (N,) with any offset.

        Raises
        ------
        DataError
            If the rate is none of sound.
        """
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            raise DataError(f"sound {label!r}: must have {RATES_HZ[0]} to {RATES_HZ[1]} Hz, got {rate_hz:g} Hz")
        values = np.where(np.abs(values) < MAX_SAMPLE, values, 0.0)  # NaN is not
        values = values - (np.median(values) if len(values) else 0.0)
        most = np.abs(values).max(initial=0.0)
        samples = np.round(PEAK * (values / most if most > 0 else values)).astype(np.int16)
        samples.setflags(write=False)
        return cls(label, samples, round(rate_hz))


@dataclass(frozen=True, slots=True)
class Synchrony:
    """The delay at which sound and motion fit best."""

    delay_s: float
    """Of the sound after the motion; negative: before."""
    r: float
    """Correlation of loudness and speed there."""
    r_as_recorded: float

    @property
    def is_doubtful(self) -> bool:
        """Whether another delay fits clearly better than none."""
        return abs(self.delay_s) >= LATE_S and self.r > CLEAR_R and self.r - self.r_as_recorded > CLEARER


def synchrony(sound: RecordedSound, track: MarkerTrack) -> Synchrony | None:
    """Compare sound and motion; None if either is too short or without change."""
    places = track.positions_mm - _mean(track.positions_mm)[:, None]
    motion = _mean(np.linalg.norm(np.diff(places, axis=0), axis=-1))
    edges = (np.arange(len(motion) + 1) * sound.rate_hz / track.rate_hz).astype(np.int64)
    edges = edges[edges <= len(sound.samples)]
    reach = round(REACH_S * track.rate_hz)
    count = min(len(edges) - 1, len(motion))
    if count < MIN_S * track.rate_hz:
        return None
    squares = sound.samples[: edges[-1]].astype(np.float64) ** 2
    power = np.add.reduceat(squares, edges[:-1]) / np.diff(edges)
    loudness = np.log(power + 1e-4 * power.max() + 1e-9)
    width = max(1, round(0.05 * track.rate_hz))
    smooth = np.convolve(motion[:count], np.ones(width) / width, "same")
    found = []
    for delay in range(-reach, reach + 1):
        ours, theirs = smooth[max(-delay, 0) : count - max(delay, 0)], loudness[max(delay, 0) : count - max(-delay, 0)]
        if not (np.ptp(ours) > 0 and np.ptp(theirs) > 0):
            return None
        found.append(float(np.corrcoef(ours, theirs)[0, 1]))
    best = int(np.argmax(found))
    return Synchrony((best - reach) / track.rate_hz, found[best], found[reach])


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the markers, (T, M) or (T, M, 3), that are seen; 0 where none is."""
    seen = ~np.isnan(values)
    return np.asarray(np.where(seen, values, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))
