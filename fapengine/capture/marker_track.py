"""Markers over time: the one type that every recording becomes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerTrack:
    """Positions of labelled markers over time, in mm. Arrays are read-only.

    Raises
    ------
    UsageError
        If shapes do not fit, labels are empty or repeat, the rate is not positive, or a marker is seen in part only.
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
            raise UsageError(f"labels: got {len(self.labels)}, expected {positions.shape[1]}, one for each marker")
        repeated = next((name for i, name in enumerate(self.labels) if name in self.labels[:i]), None)
        if repeated is not None or "" in self.labels:
            raise UsageError(f"labels: got {repeated or ''!r} twice or empty, expected different names")
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise UsageError(f"rate_hz: got {self.rate_hz}, expected a positive number")
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
        """Frames, T."""
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
        """Return these markers alone, in this order.

        Raises
        ------
        UsageError
            If one is missing.
        """
        missing = [name for name in labels if name not in self.labels]
        if missing:
            raise UsageError(f"labels: got {missing[0]!r}, expected one of {', '.join(self.labels)}")
        columns = [self.labels.index(name) for name in labels]
        return MarkerTrack(positions_mm=self.positions_mm[:, columns], labels=tuple(labels), rate_hz=self.rate_hz)

    def equals(self, other: "MarkerTrack", *, atol_mm: float = 0.0) -> bool:
        """Tell whether labels, rate, gaps and, within ``atol_mm``, positions are the same."""
        return (
            self.labels == other.labels
            and self.rate_hz == other.rate_hz
            and self.positions_mm.shape == other.positions_mm.shape
            and np.allclose(self.positions_mm, other.positions_mm, rtol=0.0, atol=atol_mm, equal_nan=True)
        )
