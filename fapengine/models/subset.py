"""Marker subsets: selection by QR with column pivoting, paper 000 (Lucero, Baigorri, Munhall).

Theory of operation
-------------------
``A`` (3T x M) holds the displacements of M markers from the neutral pose, axes stacked under each other (section 4).
``A Pi = Q R`` with column pivoting orders the markers by how much each adds to those before it; ``R_kk`` says how
much. The first k are the basis; ``R11 X = R12`` gives the weights by which they drive the others, ``||R22||_F`` is what
is left (equations 1 to 3).

None of this needs ``A`` itself: ``R`` is the pivoted Cholesky factor of the M x M Gram matrix ``A^T A``, and Gram
matrices of sentences add up. So every experiment of the paper (random splits, number of sentences, choice of k) works
on one small matrix per sentence. Squaring costs half the digits: ``R_kk`` below about 1e-8 of ``R_11`` is rounding.

Greedy pivoting is not the best subset; :func:`search_swaps` exchanges single markers while that lowers ``||R22||_F``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack, solve_triangular

from fapengine._arrays import Array, freeze, frozen
from fapengine.errors import DataError, UsageError

ILL_CONDITIONED = 1e-6
"""R_kk / R_11 below which rounding of the Gram matrix hides a column: sqrt of double precision, times 60."""

BLOCK = 1024
"""Frames of one block of a Gram matrix."""

MAX_SWAPS = 100
"""Exchanges after which the search for better ones ends."""


@dataclass(frozen=True, slots=True, eq=False)
class PivotedFactor:
    """``R`` of ``A Pi = Q R`` and the order ``Pi``. Arrays are read-only."""

    order: NDArray[np.intp]
    """(M,): column of ``A`` at each place, most independent first."""
    r: Array
    """(M, M), upper triangular, columns in ``order``, mm."""

    def __post_init__(self) -> None:
        freeze(self, np.intp, order=("M",))
        freeze(self, r=(len(self.order), len(self.order)))

    @property
    def diagonal(self) -> Array:
        """(M,): ``R_kk``, falling, mm (figure 2)."""
        return np.abs(np.diag(self.r))

    def rank(self, relative: float = 1e-9) -> int:
        """Count the ``R_kk`` that exceed ``relative * R_11``: the numerical dimension of the data."""
        return int((self.diagonal > relative * self.diagonal[0]).sum())

    def gaps(self) -> Array:
        """(M - 1,): ``R_kk / R_(k+1)(k+1)``; a sharp gap marks a dimension (figure 2). Infinite after the rank."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.diagonal[:-1] / self.diagonal[1:]
        return np.where(np.isnan(ratio), np.inf, ratio)


@dataclass(frozen=True, slots=True, eq=False)
class MarkerSubset:
    """A basis of k markers and the scalar weights by which it drives all M. Arrays are read-only."""

    primary: NDArray[np.intp]
    """(k,): the chosen markers."""
    weights: Array
    """(k, M): ``X`` in the order of the recording; a primary marker drives itself with 1 and no other primary one."""
    residual_mm: float
    """``||R22||_F`` of the training data, mm (a norm over all frames, not a mean)."""

    def __post_init__(self) -> None:
        freeze(self, np.intp, primary=("k",))
        freeze(self, weights=(len(self.primary), "M"))

    @property
    def secondary(self) -> NDArray[np.intp]:
        """(M - k,): the driven markers."""
        return np.setdiff1d(np.arange(self.weights.shape[1]), self.primary)

    def synthesise(self, primary_mm: ArrayLike) -> Array:
        """Drive all markers (section 5): displacements (..., k, 3) mm of the primary ones -> (..., M, 3) mm."""
        driven = frozen(primary_mm, "primary_mm", ("...", len(self.primary), 3), np.float64)
        return np.asarray(self.weights.T @ driven)

    def error_mm(self, *sentences_mm: ArrayLike) -> float:
        """Mean distance between predicted and true secondary markers over sentences of held-out displacements, mm.

        Each sentence is (T, M, 3).
        """
        rest, total, frames = self.secondary, 0.0, 0
        for sentence in sentences_mm:
            data = _displacements(sentence)
            if data.shape[1] != self.weights.shape[1]:
                raise UsageError(f"displacements_mm: got {data.shape[1]} markers, expected {self.weights.shape[1]}")
            off = self.weights[:, rest].T @ data[:, self.primary] - data[:, rest]
            total, frames = total + float(np.linalg.norm(off, axis=-1).sum()), frames + len(data)
        return total / (frames * len(rest)) if len(rest) else 0.0


def gram(displacements_mm: ArrayLike) -> Array:
    """``A^T A`` of a sentence: (T, M, 3) mm -> (M, M) mm^2. Sums over sentences are Grams of their union."""
    data = _displacements(displacements_mm)
    total = np.zeros((data.shape[1], data.shape[1]))
    for start in range(0, len(data), BLOCK):  # stays in the cache while its axes are stacked
        a = _tall(data[start : start + BLOCK])
        total += a.T @ a
    return total


def factorise_gram(gram_mm2: ArrayLike) -> PivotedFactor:
    """``R`` and the pivots from ``A^T A``, (M, M) mm2, alone, by pivoted Cholesky (LAPACK dpstrf).

    After the numerical rank ``R`` is zero.
    """
    a = frozen(gram_mm2, "gram_mm2", ("M", "M"), np.float64)
    if not np.diag(a).max(initial=0.0) > 0:
        raise DataError("displacements: got only zeros, expected motion")
    c, pivots, rank, _ = lapack.dpstrf(a, lower=0)
    r = np.triu(c)
    r[rank:] = 0.0
    return PivotedFactor(np.asarray(pivots) - 1, r)


def select(factor: PivotedFactor, k: int) -> MarkerSubset:
    """Take the first k pivots as basis and fit ``R11 X = R12`` (section 3)."""
    rank = factor.rank()
    if not 1 <= k <= rank:
        raise UsageError(f"k: must be 1 to {rank} (the rank of the data), got {k}")
    count = len(factor.order)
    weights = np.zeros((k, count))
    weights[np.arange(k), factor.order[:k]] = 1.0
    weights[:, factor.order[k:]] = solve_triangular(factor.r[:k, :k], factor.r[:k, k:])
    return MarkerSubset(factor.order[:k], weights, float(np.linalg.norm(factor.r[k:, k:])))


def fit_weights(gram_mm2: ArrayLike, primary: Sequence[int] | NDArray[np.intp]) -> MarkerSubset:
    """Least-squares weights of a chosen basis, (k,) columns, from the Gram matrix, (M, M) mm2."""
    a = frozen(gram_mm2, "gram_mm2", ("M", "M"), np.float64)
    chosen = checked_basis(primary, len(a))
    rest = np.setdiff1d(np.arange(len(a)), chosen)
    square = a[np.ix_(chosen, chosen)]
    if np.linalg.matrix_rank(square, hermitian=True) < len(chosen):
        raise UsageError(f"primary: got {chosen.tolist()}, whose motions are linearly dependent")
    weights = np.zeros((len(chosen), len(a)))
    weights[np.arange(len(chosen)), chosen] = 1.0
    weights[:, rest] = np.linalg.solve(square, a[np.ix_(chosen, rest)])
    left = np.trace(a[np.ix_(rest, rest)]) - (weights[:, rest] * a[np.ix_(chosen, rest)]).sum()
    return MarkerSubset(chosen, weights, float(np.sqrt(max(left, 0.0))))


def checked_basis(primary: Sequence[int] | NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Check that a basis, (K,), has different markers of ``count``; raises UsageError."""
    chosen = np.asarray(primary, dtype=np.intp)
    if not len(chosen) or len(set(chosen.tolist())) < len(chosen) or chosen.min() < 0 or chosen.max() >= count:
        raise UsageError(f"primary: must be different markers 0 to {count - 1}, got {chosen.tolist()}")
    return chosen


def search_swaps(gram_mm2: ArrayLike, subset: MarkerSubset) -> MarkerSubset:
    """Exchange one basis marker at a time, always the best exchange, until none lowers ``||R22||_F``.

    Each round takes one basis marker out (k ways); the gain of each possible successor ``j`` is then
    ``||S_j||^2 / S_jj`` of the remaining Schur complement ``S``, so no exchange is tried by solving.
    The Gram matrix is (M, M) mm2.
    """
    a = frozen(gram_mm2, "gram_mm2", ("M", "M"), np.float64)
    chosen = subset.primary.copy()
    left = float(subset.residual_mm) ** 2
    for _ in range(MAX_SWAPS):
        best = (left * (1 - 1e-9), 0, 0)
        for place in range(len(chosen)):
            others = np.delete(chosen, place)
            schur = a - a[:, others] @ np.linalg.solve(a[np.ix_(others, others)], a[others]) if len(others) else a
            own = np.diag(schur)
            able = own > ILL_CONDITIONED**2 * a.trace()
            gain = np.where(able, (schur**2).sum(0) / np.where(able, own, 1.0), -np.inf)
            successor = int(gain.argmax())
            best = min(best, (float(own.sum() - gain[successor]), place, successor))
        if best[0] >= left * (1 - 1e-9):
            break
        left, chosen[best[1]] = best[0], best[2]
    return fit_weights(a, chosen)


def _displacements(displacements_mm: ArrayLike) -> Array:
    data = np.asarray(displacements_mm, dtype=np.float64)
    if data.ndim != 3 or data.shape[2] != 3 or not data.size:
        raise UsageError(f"displacements_mm: got shape {data.shape}, expected (T, M, 3)")
    if not np.isfinite(data).all():
        frame, marker, _ = np.argwhere(~np.isfinite(data))[0].tolist()
        raise DataError("displacements: got a number that is not finite", where=f"frame {frame}, marker {marker}")
    return data


def _tall(data: Array) -> Array:
    """(T, M, 3) -> (3T, M)."""
    return np.swapaxes(data, 1, 2).reshape(-1, data.shape[1])
