"""What a reader finds in a file, before anybody asks whether it can be true."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawTrack:
    """Positions as a file has them; :func:`fapengine.capture.conventions.understand` makes a MarkerTrack of it."""

    positions: NDArray[np.float64]
    """(T, M, 3), in the file's units and axes; NaN where the file itself says that a marker is missing."""
    labels: tuple[str, ...]
    """(M,), as they stand in the file; may be empty or repeat."""
    rate_hz: float | None = None
    units: str | None = None
    up: str | None = None
    """Axis that points up, such as ``"+z"``, if the file says so."""
    notes: tuple[str, ...] = ()
    """Remarks on what the reader had to overlook."""
