"""Reliability of a marker subset, and the regions that it moves: paper 000, section 4.

Choice of k, stability, amount of data: all experiments split by sentence, never by frame, because neighbouring frames
are nearly equal and would leak. Every split is a sum of sentence Gram matrices; only the mean distance in mm needs the
frames again.

Regions (figure 4): a subset's weights are known at markers; between them they are interpolated over the face by cubic
radial functions. The region of a primary marker is where its weight is notable; a negative subregion moves against it.

Beyond the paper's scalar weights: a scalar cannot say that a cheek moves inward when the jaw drops; a 3 x 3 matrix for
each pair of markers can.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.cluster.hierarchy import fclusterdata
from scipy.interpolate import RBFInterpolator
from scipy.spatial import Delaunay

from fapengine._arrays import Array, Mask, freeze, frozen
from fapengine.errors import UsageError
from fapengine.models.subset import MarkerSubset, checked_basis, factorise_gram, gram, select

SAME_PLACE_MM = 1.0
"""Distance in the frontal plane within which markers count by their means: those of lips that are shut are at one place
and move against each other, and no smooth function goes through both."""


@dataclass(frozen=True, slots=True, eq=False)
class KinematicRegions:
    """Weights of k primary markers at N points of the face. Arrays are read-only."""

    weights: Array
    """(k, N)."""
    inside: Mask
    """(N,): within the hull of the markers; beyond it the weights are a guess."""

    def __post_init__(self) -> None:
        freeze(self, weights=("k", "N"))
        freeze(self, np.bool_, inside=(self.weights.shape[1],))


def interpolate_regions(subset: MarkerSubset, markers_mm: ArrayLike, points_mm: ArrayLike) -> KinematicRegions:
    """Extend a subset's weights to any points of the face.

    Parameters
    ----------
    markers_mm : (M, 3) array_like, mm
        All markers in the neutral pose; +z points out of the face. Those at one place count by their mean weights.
    points_mm : (N, 3) array_like, mm
        Interpolation is over the frontal plane (x, y), as in the paper's figure.

    Notes
    -----
    Cubic, degree 1, no smoothing: on a test with known weights it was nearest to the truth (0.43 mm against 0.41 for
    the weights themselves, 0.55 linear), and unlike Clough-Tocher it answers outside of the hull.
    """
    count = subset.weights.shape[1]
    markers = frozen(markers_mm, "markers_mm", (count, 3), np.float64)
    points = frozen(points_mm, "points_mm", ("N", 3), np.float64)
    weights = interpolate_flat(markers[:, :2], subset.weights.T, points[:, :2])
    return KinematicRegions(weights.T, Delaunay(markers[:, :2]).find_simplex(points[:, :2]) >= 0)


def interpolate_flat(markers_mm: Array, values: Array, points_mm: Array) -> Array:
    """Interpolate values of markers, (M, C) at (M, 2) mm, by cubic radial functions: (N, 2) mm -> (N, C)."""
    place = fclusterdata(markers_mm, SAME_PLACE_MM, criterion="distance", method="complete") - 1
    means = np.zeros((place.max() + 1, 2 + values.shape[1]))
    np.add.at(means, place, np.hstack([markers_mm, values]))
    means /= np.bincount(place)[:, None]
    if len(means) < 4:
        raise UsageError(f"markers_mm: needs at least 4 markers, got {len(markers_mm)} at {len(means)} places")
    return np.asarray(RBFInterpolator(means[:, :2], means[:, 2:], kernel="cubic", degree=1)(points_mm))


RIDGE = 1e-6
"""Ridge relative to the mean variance of the primary coordinates; only tames dependent ones."""


@dataclass(frozen=True, slots=True, eq=False)
class FullMap:
    """A basis of k markers and the matrix by which it drives all M. Arrays are read-only."""

    primary: NDArray[np.intp]
    """(k,): the chosen markers."""
    matrix: Array
    """(3k, 3M): coordinates of a marker are adjacent."""

    def __post_init__(self) -> None:
        freeze(self, np.intp, primary=("k",))
        freeze(self, matrix=(3 * len(self.primary), "3M"))

    def synthesise(self, primary_mm: ArrayLike) -> Array:
        """Drive all markers: displacements (..., k, 3) mm of the primary ones -> (..., M, 3) mm."""
        driven = frozen(primary_mm, "primary_mm", ("...", len(self.primary), 3), np.float64)
        batch = driven.shape[:-2]
        return (driven.reshape(*batch, -1) @ self.matrix).reshape(*batch, -1, 3)

    def error_mm(self, *sentences_mm: ArrayLike) -> float:
        """Mean distance between predicted and true markers outside the basis, mm; each sentence is (T, M, 3)."""
        count = self.matrix.shape[1] // 3
        rest, total, frames = np.setdiff1d(np.arange(count), self.primary), 0.0, 0
        for sentence in sentences_mm:
            data = frozen(sentence, "sentences_mm", ("T", count, 3), np.float64)
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
    """
    gram = frozen(gram_mm2, "gram_mm2", ("3M", "3M"), np.float64)
    if len(gram) % 3:
        raise UsageError(f"gram_mm2: got {len(gram)} rows, expected three for each marker")
    chosen = checked_basis(primary, len(gram) // 3)
    rows = (3 * chosen[:, None] + np.arange(3)).ravel()
    square = gram[np.ix_(rows, rows)]
    square[np.diag_indices_from(square)] += RIDGE * np.trace(square) / len(square)
    return FullMap(chosen, np.asarray(np.linalg.solve(square, gram[rows]), dtype=np.float64))


def coordinate_gram(sentences_mm: Sequence[ArrayLike]) -> Array:
    """Sentences of displacements, (T, M, 3) mm each -> (3M, 3M), mm^2, of all their frames."""
    if not sentences_mm:
        raise UsageError("sentences_mm: empty; needs at least one")

    def square(sentence: ArrayLike) -> Array:
        flat = frozen(sentence, "displacements_mm", ("T", "M", 3), np.float64).reshape(len(np.asarray(sentence)), -1)
        return np.asarray(flat.T @ flat)

    return np.asarray(sum(map(square, sentences_mm)))


Sentences = Sequence[NDArray[np.floating]]
"""One (T, M, 3) array of displacements from the neutral pose for each sentence, mm; M is common."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorCurve:
    """Cross-validated error of bases of rising size. Arrays are read-only."""

    k: NDArray[np.intp]
    """(N,), rising."""
    fold_mm: Array
    """(N, folds): mean distance of the driven markers in the sentences left out, mm."""

    def __post_init__(self) -> None:
        freeze(self, np.intp, k=("N",))
        freeze(self, fold_mm=(len(self.k), "folds"))

    @property
    def mean_mm(self) -> Array:
        """(N,)."""
        return np.asarray(self.fold_mm.mean(axis=1))

    @property
    def standard_error_mm(self) -> Array:
        """(N,): of the mean over folds."""
        folds = self.fold_mm.shape[1]
        return np.asarray(self.fold_mm.std(axis=1, ddof=1) / np.sqrt(folds))

    def choose(self, tolerance_mm: float | None = None) -> int:
        """Find the smallest k that is good enough.

        Parameters
        ----------
        tolerance_mm : float, optional
            The recording's uncertainty, or a difference that is not visible: k is the first whose error, plus one
            standard error, is within it. Without it, k is the first whose error is within one standard error of the
            least (Breiman et al. 1984): the effect of more markers could be chance.
        """
        if tolerance_mm is None:
            least = int(self.mean_mm.argmin())
            good = self.mean_mm <= self.mean_mm[least] + self.standard_error_mm[least]
        else:
            good = self.mean_mm + self.standard_error_mm <= tolerance_mm
        if not good.any():
            raise UsageError(f"tolerance_mm: got {tolerance_mm}, the curve ends at {self.mean_mm.min():.3f} mm")
        return int(self.k[good.argmax()])

    def choose_within(self, tolerance_mm: float) -> tuple[int, str]:
        """Choose k by a tolerance if the curve reaches it, else without one; also return the reason as text."""
        if (self.mean_mm + self.standard_error_mm).min() <= tolerance_mm:
            return self.choose(tolerance_mm), f"the first whose error is within {tolerance_mm:g} mm"
        return self.choose(), f"none comes within {tolerance_mm:g} mm: the first near the least"


def error_curve(sentences: Sentences, ks: Sequence[int], *, folds: int = 10, rng: np.random.Generator) -> ErrorCurve:
    """Cross-validate the whole procedure, selection included.

    Parameters
    ----------
    ks : sequence of int
        Sizes of the basis, each below M.
    folds : int
        2 to the number of sentences.
    rng : numpy.random.Generator
        Deals the sentences to the folds.
    """
    if not 2 <= folds <= len(sentences):
        raise UsageError(f"folds: must be 2 to {len(sentences)} (the number of sentences), got {folds}")
    sizes, count = sorted(set(ks)), sentences[0].shape[1]
    if not sizes or sizes[0] < 1 or sizes[-1] >= count:
        raise UsageError(f"ks: got {sizes}, expected numbers 1 to {count - 1}")
    dealt = rng.permutation(len(sentences))
    left_out = [dealt[fold::folds] for fold in range(folds)]
    grams = np.stack([sentence_grams([sentences[index] for index in out], at_most=1)[0] for out in left_out])
    whole = grams.sum(axis=0)
    errors = np.empty((len(sizes), folds))
    for fold, out in enumerate(left_out):
        factor = factorise_gram(whole - grams[fold])
        frames = [sentences[index] for index in out]
        errors[:, fold] = [select(factor, k).error_mm(*frames) for k in sizes]
    return ErrorCurve(np.array(sizes, dtype=np.intp), errors)


def pivots_of_trials(
    grams: ArrayLike, *, training: int, count: int, trials: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Repeat table 1: (trials, count) markers in order of selection; the first trial takes the first sentences.

    Parameters
    ----------
    grams : (S, M, M) array_like
        From :func:`sentence_grams`.
    training, count, trials : int
        Sentences of a trial (the paper: 30 of 40), markers to list (12), trials (10).
    """
    all_grams = frozen(grams, "grams", ("S", "M", "M"), np.float64)
    if not 1 <= training <= len(all_grams):
        raise UsageError(f"training: must be 1 to {len(all_grams)} (the number of sentences), got {training}")
    chosen = [np.arange(training)]
    chosen += [rng.choice(len(all_grams), training, replace=False) for _ in range(trials - 1)]
    return np.stack([factorise_gram(all_grams[rows].sum(axis=0)).order[:count] for rows in chosen])


def stability(pivots: ArrayLike, k: int) -> float:
    """Mean fraction of common markers among the first k of every two trials, 0..1; order is ignored (section 4)."""
    sets = [set(row[:k].tolist()) for row in np.asarray(pivots)]
    pairs = [len(a & b) / k for index, a in enumerate(sets) for b in sets[index + 1 :]]
    return float(np.mean(pairs)) if pairs else 1.0


def diagonals_by_amount(grams: ArrayLike, count: int = 10) -> Array:
    """Repeat figure 3: (S, count) ``R_kk / ||R||_F`` of the first 1, 2, ... S sentences."""
    sums = np.cumsum(frozen(grams, "grams", ("S", "M", "M"), np.float64), axis=0)
    return np.stack([factorise_gram(matrix).diagonal[:count] / np.sqrt(np.trace(matrix)) for matrix in sums])


def sentence_grams(sentences: Sentences, *, at_most: int | None = None) -> Array:
    """(S, M, M): Gram matrices of sentences, or of at most ``at_most`` groups of neighbouring sentences."""
    counts = sorted({np.shape(sentence)[1] for sentence in sentences})
    if len(counts) != 1:
        raise UsageError(f"sentences: got marker counts {counts}, expected one")
    groups = min(at_most or len(sentences), len(sentences))
    grams = np.zeros((groups, *counts, *counts))
    for index, sentence in enumerate(sentences):  # added up in place: a face has many markers, a session many sentences
        grams[index * groups // len(sentences)] += gram(sentence)
    return grams
