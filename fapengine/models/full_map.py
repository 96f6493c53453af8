"""All coordinates of the driven markers from all coordinates of the primary ones: paper 000 beyond its scalar weights.

A scalar weight cannot say that a cheek moves inward when the jaw drops; a 3 x 3 matrix for each pair of markers can.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError

RIDGE = 1e-6
"""Ridge relative to the mean variance of the primary coordinates; only tames dependent ones."""


@dataclass(frozen=True, slots=True, eq=False)
class FullMap:
    """A basis of k markers and the matrix by which it drives all M. Arrays are read-only."""

    primary: NDArray[np.intp]
    """(k,): the chosen markers."""
    matrix: NDArray[np.float64]
    """(3k, 3M): coordinates of a marker lie side by side."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "primary", frozen(self.primary, "primary", ("k",), np.intp))
        object.__setattr__(self, "matrix", frozen(self.matrix, "matrix", (3 * len(self.primary), "3M"), np.float64))

    def synthesise(self, primary_mm: ArrayLike) -> NDArray[np.float64]:
        """Drive all markers: displacements (..., k, 3) mm of the primary ones -> (..., M, 3) mm."""
        driven = frozen(primary_mm, "primary_mm", ("...", len(self.primary), 3), np.float64)
        batch = driven.shape[:-2]
        return (driven.reshape(*batch, -1) @ self.matrix).reshape(*batch, -1, 3)

    def error_mm(self, *sentences_mm: ArrayLike) -> float:
        """Mean distance between predicted and true markers beyond the basis, mm; each sentence is (T, M, 3)."""
        rest, total, frames = np.setdiff1d(np.arange(self.matrix.shape[1] // 3), self.primary), 0.0, 0
        for sentence in sentences_mm:
            data = frozen(sentence, "sentences_mm", ("T", self.matrix.shape[1] // 3, 3), np.float64)
            off = self.synthesise(data[:, self.primary])[:, rest] - data[:, rest]
            total, frames = total + float(np.linalg.norm(off, axis=-1).sum()), frames + len(data)
        return total / (frames * len(rest))


def fit_full_map(gram_mm2: ArrayLike, primary: Sequence[int] | NDArray[np.intp]) -> FullMap:
    """Least squares for a given basis.

    Parameters
    ----------
    gram_mm2 : (3M, 3M) array_like, mm^2
        From :func:`coordinate_gram`.
    primary : sequence of int
        k different markers.

    Raises
    ------
    UsageError
        If ``gram_mm2`` has no such shape, or ``primary`` is empty, repeats a marker, or names none.
    """
    gram = _checked(gram_mm2)
    count = len(gram) // 3
    chosen = np.asarray(primary, dtype=np.intp)
    if not len(chosen) or len(set(chosen.tolist())) < len(chosen) or chosen.min() < 0 or chosen.max() >= count:
        raise UsageError(f"primary: got {chosen.tolist()}, expected different markers 0..{count - 1}")
    rows = _coordinates(chosen)
    square = gram[np.ix_(rows, rows)]
    square[np.diag_indices_from(square)] += RIDGE * np.trace(square) / len(square)
    return FullMap(chosen, np.asarray(np.linalg.solve(square, gram[rows]), dtype=np.float64))


def search_full_swaps(
    gram_mm2: ArrayLike, primary: Sequence[int] | NDArray[np.intp], *, rounds: int = 100
) -> NDArray[np.intp]:
    """Exchange one basis marker at a time while the squared error of the full map falls: (k,) markers.

    As :func:`fapengine.models.subset.search_swaps`, with 3 x 3 blocks: taking marker j in lowers the error by
    ``trace(S_jj^-1 S_j. S_.j)`` of the Schur complement ``S`` without the marker that left.
    """
    gram = _checked(gram_mm2)
    chosen = fit_full_map(gram, primary).primary.copy()
    small = RIDGE * np.trace(gram) / len(gram)
    left = np.inf
    for _ in range(rounds):
        best = (np.inf, 0, 0)
        for place in range(len(chosen)):
            others = np.delete(chosen, place)
            rows = _coordinates(others)
            inner = gram[np.ix_(rows, rows)] + small * np.eye(len(rows))
            schur = gram - gram[:, rows] @ np.linalg.solve(inner, gram[rows])
            blocks = np.stack([schur[at : at + 3, at : at + 3] for at in range(0, len(gram), 3)])
            sides = schur.reshape(-1, 3, len(gram))
            gain = np.trace(
                np.linalg.solve(blocks + small * np.eye(3), sides @ np.swapaxes(sides, 1, 2)), axis1=1, axis2=2
            )
            gain[others] = -np.inf
            successor = int(gain.argmax())
            best = min(best, (float(np.trace(schur) - gain[successor]), place, successor))
        if best[0] >= left * (1 - 1e-9):
            break
        left, chosen[best[1]] = best[0], best[2]
    return chosen


def coordinate_gram(sentences_mm: Sequence[ArrayLike]) -> NDArray[np.float64]:
    """Sentences of displacements, (T, M, 3) mm each -> (3M, 3M), mm^2, of all their frames."""
    total: NDArray[np.float64] | None = None
    for sentence in sentences_mm:
        data = frozen(sentence, "displacements_mm", ("T", "M", 3), np.float64)
        flat = data.reshape(len(data), -1)
        if total is None:
            total = np.zeros((flat.shape[1], flat.shape[1]))
        total += flat.T @ flat
    if total is None:
        raise UsageError("sentences_mm: got none, expected at least one")
    return total


def _checked(gram_mm2: ArrayLike) -> NDArray[np.float64]:
    gram = frozen(gram_mm2, "gram_mm2", ("3M", "3M"), np.float64)
    if len(gram) % 3:
        raise UsageError(f"gram_mm2: got {len(gram)} rows, expected three for each marker")
    return gram


def _coordinates(markers: NDArray[np.intp]) -> NDArray[np.intp]:
    return (3 * markers[:, None] + np.arange(3)).ravel()
