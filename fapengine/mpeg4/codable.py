"""From real numbers to FAP values that a stream can carry."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap


def to_codable(faps: NDArray[np.float64]) -> NDArray[np.int32]:
    """Round, and keep every value inside what the standard's default intra range can carry: (T, 68) int32.

    FAPs that act in one direction only (3, 14, 41, 42, 47) do not go below 0.
    """
    low, high = _codable_range()
    return np.rint(np.clip(faps, low, high)).astype(np.int32)


@cache
def limits(number: int) -> tuple[float, float]:
    """Least and greatest value that :func:`to_codable` leaves of a FAP, FAPU."""
    low, high = _codable_range()
    return float(low[fap.column(number)]), float(high[fap.column(number)])


@cache
def _codable_range() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low = np.zeros(fap.FAP_COUNT)
    high = np.zeros(fap.FAP_COUNT)
    for row in fap.FAPS:
        limit = row.intra_limit * row.quantiser_step
        low[fap.column(row.number)] = -limit if row.bidirectional else 0
        high[fap.column(row.number)] = limit
    low.flags.writeable = high.flags.writeable = False
    return low, high
