"""Markers over time: the tracks that readers return, checked tracks, and the sessions that group them."""

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
