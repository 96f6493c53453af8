"""How far a marker subset can be trusted: choice of k, stability, amount of data; paper 000, section 4.

All experiments split by sentence, never by frame: neighbouring frames are nearly equal, so frames would leak. Every
split is a sum of sentence Gram matrices; only the mean distance in mm needs the frames again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.models.subset import factorise_gram, gram, search_swaps, select

Sentences = Sequence[NDArray[np.floating]]
"""One (T, M, 3) array of displacements from the neutral pose for each sentence, mm; M is common."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorCurve:
    """Cross-validated error of bases of rising size. Arrays are read-only."""

    k: NDArray[np.intp]
    """(N,), rising."""
    fold_mm: NDArray[np.float64]
    """(N, folds): mean distance of the driven markers in the sentences left out, mm."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", frozen(self.k, "k", ("N",), np.intp))
        object.__setattr__(self, "fold_mm", frozen(self.fold_mm, "fold_mm", (len(self.k), "folds"), np.float64))

    @property
    def mean_mm(self) -> NDArray[np.float64]:
        """(N,)."""
        mean: NDArray[np.float64] = self.fold_mm.mean(axis=1)
        return mean

    @property
    def standard_error_mm(self) -> NDArray[np.float64]:
        """(N,): of the mean over folds."""
        folds = self.fold_mm.shape[1]
        error: NDArray[np.float64] = self.fold_mm.std(axis=1, ddof=1) / np.sqrt(folds)
        return error

    def choose(self, tolerance_mm: float | None = None) -> int:
        """Give the smallest k that is good enough.

        Parameters
        ----------
        tolerance_mm : float, optional
            The recording's uncertainty, or what the eye forgives: k is the first whose error, one standard error added,
            is within. Without it, k is the first whose error is within one standard error of the least (Breiman et al.
            1984): more markers would not be told apart from luck.

        Raises
        ------
        UsageError
            If no k of the curve reaches the tolerance.
        """
        if tolerance_mm is None:
            least = int(self.mean_mm.argmin())
            good = self.mean_mm <= self.mean_mm[least] + self.standard_error_mm[least]
        else:
            good = self.mean_mm + self.standard_error_mm <= tolerance_mm
        if not good.any():
            raise UsageError(f"tolerance_mm: got {tolerance_mm}, the curve ends at {self.mean_mm.min():.3f} mm")
        return int(self.k[good.argmax()])


def error_curve(
    sentences: Sentences, ks: Sequence[int], *, folds: int = 10, rng: np.random.Generator, swaps: bool = False
) -> ErrorCurve:
    """Cross-validate the whole procedure, selection included.

    Parameters
    ----------
    sentences : Sentences
    ks : sequence of int
        Sizes of the basis, each below M.
    folds : int
        2 to the number of sentences.
    rng : numpy.random.Generator
        Deals the sentences to the folds.
    swaps : bool
        Improve each basis by :func:`fapengine.models.subset.search_swaps`.

    Raises
    ------
    UsageError
        If ``folds`` or a k is out of range.
    """
    if not 2 <= folds <= len(sentences):
        raise UsageError(f"folds: got {folds}, expected 2..{len(sentences)}, the number of sentences")
    sizes, count = sorted(set(ks)), sentences[0].shape[1]
    if not sizes or sizes[0] < 1 or sizes[-1] >= count:
        raise UsageError(f"ks: got {sizes}, expected numbers 1..{count - 1}")
    dealt = rng.permutation(len(sentences))
    left_out = [dealt[fold::folds] for fold in range(folds)]
    grams = np.stack([sentence_grams([sentences[index] for index in out], at_most=1)[0] for out in left_out])
    whole = grams.sum(axis=0)
    errors = np.empty((len(sizes), folds))
    for fold, out in enumerate(left_out):
        training = whole - grams[fold]
        factor = factorise_gram(training)
        frames = [sentences[index] for index in out]
        for row, k in enumerate(sizes):
            subset = select(factor, k)
            errors[row, fold] = (search_swaps(training, subset) if swaps else subset).error_mm(*frames)
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

    Raises
    ------
    UsageError
        If ``training`` exceeds S.
    """
    all_grams = frozen(grams, "grams", ("S", "M", "M"), np.float64)
    if not 1 <= training <= len(all_grams):
        raise UsageError(f"training: got {training}, expected 1..{len(all_grams)}, the number of sentences")
    chosen = [np.arange(training)]
    chosen += [rng.choice(len(all_grams), training, replace=False) for _ in range(trials - 1)]
    return np.stack([factorise_gram(all_grams[rows].sum(axis=0)).order[:count] for rows in chosen])


def stability(pivots: ArrayLike, k: int) -> float:
    """Mean share of common markers among the first k of every two trials, 0..1; order does not matter (section 4)."""
    sets = [set(row[:k].tolist()) for row in np.asarray(pivots)]
    pairs = [len(a & b) / k for index, a in enumerate(sets) for b in sets[index + 1 :]]
    return float(np.mean(pairs)) if pairs else 1.0


def diagonals_by_amount(grams: ArrayLike, count: int = 10) -> NDArray[np.float64]:
    """Repeat figure 3: (S, count) ``R_kk / ||R||_F`` of the first 1, 2, ... S sentences."""
    sums = np.cumsum(frozen(grams, "grams", ("S", "M", "M"), np.float64), axis=0)
    return np.stack([factorise_gram(matrix).diagonal[:count] / np.sqrt(np.trace(matrix)) for matrix in sums])


def sentence_grams(sentences: Sentences, *, at_most: int | None = None) -> NDArray[np.float64]:
    """(S, M, M): the Gram matrix of each sentence; with ``at_most``, of so many groups of neighbouring sentences.

    Raises
    ------
    UsageError
        If there is no sentence, or their markers differ in number.
    """
    counts = sorted({np.shape(sentence)[1] for sentence in sentences})
    if len(counts) != 1:
        raise UsageError(f"sentences: got marker counts {counts}, expected one")
    groups = min(at_most or len(sentences), len(sentences))
    grams = np.zeros((groups, *counts, *counts))
    for index, sentence in enumerate(sentences):  # added up in place: a face has many markers, a session many sentences
        grams[index * groups // len(sentences)] += gram(sentence)
    return grams
