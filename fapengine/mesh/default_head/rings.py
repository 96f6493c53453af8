"""Rings round an opening in the skin grid: the mouth and the eyes.

A block of grid cells is left out; its border is the outermost ring, the rim of the opening the innermost, and each
border vertex has one vertex in every ring. A ring starts at the corner with the larger x and runs counter-clockwise as
seen from the front: first over the upper side, then back along the lower.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Which cells of the skin grid an opening replaces."""

    bottom: int
    top: int
    """Rows of the grid."""
    corner: int
    """Row on which the corners of the opening lie."""
    left: int
    right: int
    """Columns of the grid, rising with x."""

    def border(self) -> tuple[Indices, Indices]:
        """Rows and columns of the border's vertices, (N,) each, in ring order."""
        up = np.arange(self.corner, self.top)
        across = np.arange(self.right, self.left, -1)
        down = np.arange(self.top, self.bottom, -1)
        back = np.arange(self.left, self.right)
        rise = np.arange(self.bottom, self.corner)
        rows = np.concatenate([up, np.full(len(across), self.top), down, np.full(len(back), self.bottom), rise])
        columns = np.concatenate(
            [np.full(len(up), self.right), across, np.full(len(down), self.left), back, np.full(len(rise), self.right)]
        )
        return rows, columns

    @property
    def upper_count(self) -> int:
        """Segments of the upper side, corner to corner."""
        return 2 * (self.top - self.corner) + (self.right - self.left)

    @property
    def lower_count(self) -> int:
        """Segments of the lower side."""
        return 2 * (self.corner - self.bottom) + (self.right - self.left)

    def along(self) -> tuple[Array, NDArray[np.bool_]]:
        """(N,) position along the opening, 1 at the first corner to -1 at the other; (N,) upper side or corner."""
        upper = np.arange(self.upper_count + 1) / self.upper_count
        lower = np.arange(1, self.lower_count) / self.lower_count
        t = np.concatenate([_spread(upper), -_spread(lower)])
        return t, np.arange(len(t)) <= self.upper_count


def _spread(share: Array) -> Array:
    """From 1 to -1, somewhat denser at the ends."""
    spread: Array = 0.45 * np.cos(np.pi * share) + 0.55 * (1 - 2 * share)
    return spread


def resampled(table: ArrayLike, detail: float) -> Array:
    """(M, ...) from (N, ...): about ``detail`` times as many rows, the first and the last as they were."""
    rows = np.asarray(table, dtype=np.float64)
    flat = rows.reshape(len(rows), -1)
    places = np.linspace(0, len(rows) - 1, max(2, round((len(rows) - 1) * detail) + 1))
    columns = [np.interp(places, np.arange(len(rows)), column) for column in flat.T]
    return np.stack(columns, axis=-1).reshape(len(places), *rows.shape[1:])


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Vertices round an opening."""

    indices: Indices
    """(levels, N), outermost first."""
    level: Array
    """(levels,): 2 at the border of the block, 1 at the outer edge of lip or lid, 0 at the rim, negative inside."""
    t: Array
    """(N,): 1 to -1 from corner to corner."""
    upper: NDArray[np.bool_]
    """(N,): upper side or corner."""
