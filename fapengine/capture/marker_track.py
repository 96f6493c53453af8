"""Markers over time: the tracks that readers return, checked tracks, and the sessions that group them.

Sound that was recorded together with positions belongs to them in time: a face moves when it speaks, so the loudness of
the sound follows the speed of the markers. Shifted against each other, the two fit best at the delay between them (a
few hundredths of a second on one clock).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, UsageError


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerTrack:
    """Positions of labelled markers over time, in mm. Arrays are read-only.

    Raises
    ------
    UsageError
        If shapes do not fit, labels are empty or repeat, the rate is not positive, or a marker is seen in part.
    """

    positions_mm: NDArray[np.float64]
    """(T, M, 3) float64, mm; NaN in all three coordinates where a marker was not seen."""
    labels: tuple[str, ...]
    """(M,), each different."""
    rate_hz: float

    def __post_init__(self) -> None:
        positions = frozen(self.positions_mm, "positions_mm", ("T", "M", 3), np.float64, finite=False)
        object.__setattr__(self, "positions_mm", positions)
        object.__setattr__(self, "labels", tuple(self.labels))
        if len(self.labels) != positions.shape[1]:
            raise UsageError(f"labels: must be {positions.shape[1]}, one for each marker, got {len(self.labels)}")
        repeated = next((name for i, name in enumerate(self.labels) if name in self.labels[:i]), None)
        if repeated is not None or "" in self.labels:
            raise UsageError(f"labels: must be different and not empty, got {repeated or ''!r} twice or empty")
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise UsageError(f"rate_hz: must be positive, got {self.rate_hz}")
        seen = ~np.isnan(positions)
        wrong = (seen.any(axis=2) != seen.all(axis=2)) | np.isinf(positions).any(axis=2)
        if wrong.any():
            frame, marker = np.argwhere(wrong)[0]
            raise UsageError(
                f"positions_mm: got {positions[frame, marker]} for marker {self.labels[marker]!r} at frame {frame},"
                " expected three finite numbers, or three NaN"
            )

    @property
    def frame_count(self) -> int:
        """Number of frames, T."""
        return len(self.positions_mm)

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return self.frame_count / self.rate_hz

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(T, M): where a marker was seen."""
        return ~np.isnan(self.positions_mm[..., 0])

    def select(self, labels: Sequence[str]) -> "MarkerTrack":
        """Return only these markers, in this order.

        Raises
        ------
        UsageError
            If one is missing.
        """
        missing = [name for name in labels if name not in self.labels]
        if missing:
            raise UsageError(f"labels: unknown marker {missing[0]!r}; use {', '.join(self.labels)}")
        columns = [self.labels.index(name) for name in labels]
        return MarkerTrack(positions_mm=self.positions_mm[:, columns], labels=tuple(labels), rate_hz=self.rate_hz)

    def equals(self, other: "MarkerTrack", *, atol_mm: float = 0.0) -> bool:
        """Whether labels, rate, gaps and, within ``atol_mm``, positions are equal."""
        return (
            self.labels == other.labels
            and self.rate_hz == other.rate_hz
            and self.positions_mm.shape == other.positions_mm.shape
            and np.allclose(self.positions_mm, other.positions_mm, rtol=0.0, atol=atol_mm, equal_nan=True)
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawTrack:
    """Positions as a file has them; :func:`fapengine.capture.conventions.understand` makes a MarkerTrack of it."""

    positions: NDArray[np.float64]
    """(T, M, 3), in the file's units and axes; NaN where the file marks a marker as missing."""
    labels: tuple[str, ...]
    """(M,), as written in the file; may be empty or repeat."""
    rate_hz: float | None = None
    times_s: NDArray[np.float64] | None = None
    """(T,): times of via points, between which a minimum-jerk spline is the motion; None for frames."""
    units: str | None = None
    up: str | None = None
    """Axis that points up, such as ``"+z"``, if the file says so."""
    height: float | None = None
    """Length from foot to head along a skeleton's bones, in the file's unit; None for other markers."""
    notes: tuple[str, ...] = ()
    """Remarks about parts of the file that were skipped."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A phone or a held pose within a take."""

    label: str
    start_s: float
    end_s: float
    word: str = ""
    """The word that it belongs to, if known."""


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One recording, with the phones spoken in it, where known."""

    name: str
    markers: MarkerTrack
    phones: tuple[Interval, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Takes of one subject with one marker set.

    Raises
    ------
    UsageError
        Without takes.
    DataError
        If takes differ in markers or rate; ``where`` is the take.
    """

    subject: str
    takes: tuple[Take, ...]

    def __post_init__(self) -> None:
        if not self.takes:
            raise UsageError(f"session {self.subject!r}: contains no take")
        first = self.takes[0]
        for take in self.takes[1:]:
            extra = set(take.markers.labels) ^ set(first.markers.labels)
            if extra:
                raise DataError(
                    f"markers: differ from take {first.name!r} in {', '.join(sorted(extra)[:8])}",
                    where=f"take {take.name}",
                )
            if take.markers.rate_hz != first.markers.rate_hz:
                raise DataError(
                    f"rate: must be {first.markers.rate_hz:g} Hz as in {first.name!r}, got {take.markers.rate_hz:g} Hz",
                    where=f"take {take.name}",
                )

    @property
    def labels(self) -> tuple[str, ...]:
        """Marker labels, in the order of the first take."""
        return self.takes[0].markers.labels

    @property
    def rate_hz(self) -> float:
        """Frame rate of every take."""
        return self.takes[0].markers.rate_hz


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
            If audio cannot have this sample rate.
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
