"""The marker subset study of a session: every experiment of paper 000, on one recording."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.laboratory.few_markers import spread_out
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.models.subset import MarkerSubset, PivotedFactor, factorise_gram, fit_weights, search_swaps, select
from fapengine.models.subset_study import (
    ErrorCurve,
    KinematicRegions,
    coordinate_gram,
    diagonals_by_amount,
    error_curve,
    fit_full_map,
    interpolate_regions,
    pivots_of_trials,
    sentence_grams,
    stability,
)

MIN_MARKERS = 5
MAX_K = 15
TRIALS, TRAINING_SHARE, LISTED = 10, 0.75, 12
"""Table 1 of paper 000: ten trials with 30 of 40 sentences, twelve markers listed."""
RANDOM_SUBSETS = 20
GRID = (96, 112)
PIECES = 12
"""Number of parts of a recording with fewer takes."""
MIN_PIECE_FRAMES = 12
MAX_MARKERS = 300
"""Largest number of markers to study, spread over the face; a mesh sequence has thousands."""
GROUPS = 64
"""Largest number of groups of sentences; it bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Selection:
    """The selected markers, and how stable the selection is."""

    prepared: Prepared
    """Markers that were studied, to which all indices refer: the session's, or some of very many."""
    factor: PivotedFactor
    curve: ErrorCurve
    k: int
    reason: str
    """Reason for the choice of k."""
    plain: MarkerSubset
    """The first k pivots."""
    swapped: MarkerSubset
    """Subset after exchanges of single markers."""
    trials: NDArray[np.intp]
    """(trials, listed) markers of random splits, as table 1."""
    stability: float
    by_amount: Array
    """(S, 10): R_kk over the norm for the first 1, 2, ... sentences, as figure 3."""
    held_out_mm: dict[str, float]
    """Mean error of the driven markers: plain, swapped, full map, random subsets (mean and best)."""
    regions: KinematicRegions
    grid_mm: tuple[Array, Array]
    """Columns and rows of the image of the regions."""


def study_selection(
    prepared: Prepared,
    training: tuple[Displacements, ...],
    held_out: tuple[Displacements, ...],
    *,
    k: int | None,
    tolerance_mm: float,
    rng: np.random.Generator,
) -> Selection | None:
    """Run the study; ``None`` for fewer than five markers.

    Parameters
    ----------
    k : int, optional
        Size of the subset; without it the error curve decides.
    tolerance_mm : float
        Largest error that the choice of k may leave.
    """
    count = len(prepared.labels)
    if count < MIN_MARKERS:
        return None
    if k is not None and not 1 <= k < count:
        raise UsageError(f"k: must be 1 to {count - 1} (fewer than the markers), got {k}")
    if count > MAX_MARKERS:
        named = [index for index, point in enumerate(prepared.points) if point]
        kept = spread_out(prepared.neutral_mm, MAX_MARKERS, named or [0])
        prepared = replace(
            prepared, labels=tuple(prepared.labels[i] for i in kept), points=tuple(prepared.points[i] for i in kept),
            neutral_mm=prepared.neutral_mm[kept], takes=(),
        )  # fmt: skip
        training, held_out = (
            tuple(replace(take, moved_mm=take.moved_mm[:, kept]) for take in takes) for takes in (training, held_out)
        )
        count = len(kept)
    sentences = _sentences(training)
    judged = [take.moved_mm for take in held_out] or sentences
    grams = sentence_grams(sentences, at_most=GROUPS)
    whole = grams.sum(axis=0)
    factor = factorise_gram(whole)
    largest = min(MAX_K, count - 1, factor.rank())
    curve = error_curve(sentences, range(1, largest + 1), folds=min(10, len(sentences)), rng=rng)
    chosen, reason = (k, "asked for") if k is not None else curve.choose_within(tolerance_mm)
    plain = select(factor, chosen)
    swapped = search_swaps(whole, plain)
    total = np.sum([sentence.sum(axis=0) for sentence in sentences], axis=0)
    frames = sum(len(sentence) for sentence in sentences)
    exact = np.asarray(total, np.float64)
    centred = select(factorise_gram(whole - exact @ exact.T / frames), chosen)
    full = fit_full_map(coordinate_gram(sentences), swapped.primary)
    random_mm = [
        fit_weights(whole, rng.choice(count, chosen, replace=False)).error_mm(*judged) for _ in range(RANDOM_SUBSETS)
    ]
    trials = pivots_of_trials(
        grams, training=max(1, round(TRAINING_SHARE * len(grams))), count=min(LISTED, count), trials=TRIALS, rng=rng
    )
    columns, rows = (np.linspace(at.min(), at.max(), n) for at, n in zip(prepared.neutral_mm.T, GRID, strict=False))
    places = np.stack([*(a.ravel() for a in np.meshgrid(columns, rows)), np.zeros(columns.size * rows.size)], axis=1)
    return Selection(
        prepared=prepared,
        factor=factor,
        curve=curve,
        k=chosen,
        reason=reason,
        plain=plain,
        swapped=swapped,
        trials=trials,
        stability=stability(trials, min(chosen, trials.shape[1])),
        by_amount=diagonals_by_amount(grams, min(10, count)),
        held_out_mm={
            "QR pivots, one weight for each pair": plain.error_mm(*judged),
            "the same, from the mean pose in place of the neutral one": centred.error_mm(
                *(each - total / frames for each in judged)
            ),
            "after swaps, one weight for each pair": swapped.error_mm(*judged),
            "after swaps, a matrix for each pair": full.error_mm(*judged),
            f"{RANDOM_SUBSETS} random subsets, mean": float(np.mean(random_mm)),
            f"{RANDOM_SUBSETS} random subsets, best": float(np.min(random_mm)),
        },
        regions=interpolate_regions(swapped, prepared.neutral_mm, places),
        grid_mm=(columns, rows),
    )


def _sentences(takes: tuple[Displacements, ...]) -> list[NDArray[np.float32]]:
    if len(takes) >= PIECES:
        return [take.moved_mm for take in takes]
    each = -(-PIECES // len(takes))
    pieces = [
        piece
        for take in takes
        for piece in np.array_split(take.moved_mm, max(1, min(each, len(take.moved_mm) // MIN_PIECE_FRAMES)))
    ]
    return pieces if len(pieces) >= 2 else [half for piece in pieces for half in np.array_split(piece, 2)]
