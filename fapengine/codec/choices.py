"""What an encoder may choose and a decoder never asks: ranges, masks, and the quantiser for a wanted accuracy."""

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.fields import LOW_LEVEL_FIELDS, MAX_SENT, UNIT, Bools, Ints, SentRanges
from fapengine.codec.planes import STEPS
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

EYE_LEVER_MM = 12.0
"""Radius of an eyeball: how far a gaze error carries the pupil."""
HEAD_LEVER_MM = 120.0
"""Distance from the centre of head rotation to the farthest feature point of an adult head."""
TONGUE_LEVER = 0.25
"""Half the tongue's width as a part of the mouth width: the lever of tongue_roll."""
EYE_ROTATIONS, HEAD_ROTATIONS, TONGUE_ROLL = range(23, 27), range(48, 51), 47
MAX_QUANT = 31


def quantise(values: Ints, quant: int) -> tuple[Ints, Ints]:
    """Quantise low-level FAPs as an I plane and P planes behind it (FBA section 6), free of ranges.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    quant : int
        fap_quant, 0..31.

    Returns
    -------
    levels : (T, 66) int64
        Row 0 absolute, the others differences.
    reconstructed : (T, 66) int64, FAPU
    """
    steps = STEPS * quant if quant else np.ones_like(STEPS)
    half = steps // 2
    levels, reconstructed = np.zeros_like(values), np.zeros_like(values)
    previous = np.zeros(values.shape[1], np.int64)
    for t, row in enumerate(values):
        wanted = row - previous
        size = np.abs(wanted)
        levels[t] = np.where(size <= half, 0, np.sign(wanted) * ((size + half) // steps))
        previous = previous + levels[t] * steps
        reconstructed[t] = previous
    return levels, reconstructed


def fit_ranges(levels: Ints, quant: int, *, margin: float = 1.0, predicted_only: bool = False) -> SentRanges:
    """Choose the narrowest ranges that hold the levels of :func:`quantise`.

    Parameters
    ----------
    margin : float
        Factor on every bound, for values yet unseen.
    predicted_only : bool
        Leave the ranges of I planes as they are.
    """
    scale = max(quant, 1) * margin
    intra, predicted = levels[:1], levels[1:]
    if not len(predicted):
        predicted = np.zeros_like(intra)
    lists = [_units(part, scale) for part in (intra.max(0), -intra.min(0), predicted.max(0), -predicted.min(0))]
    column = fap.column(4) - 2
    lists[0][column] = max(lists[0][column], 1)  # a decoder of the reference family takes 0..0 for "not yet set"
    return SentRanges(None, None, *lists[2:]) if predicted_only else SentRanges(*lists)


def _units(bounds: Ints, scale: float) -> Ints:
    return np.clip(np.ceil(np.maximum(bounds, 0) * scale / UNIT), 0, MAX_SENT).astype(np.int64)


def table_ranges() -> SentRanges:
    """Spell the table's ranges as sent ones: needed when the quantiser changes, for stored ranges do not follow it."""
    intra = [row.intra_limit for row in fap.FAPS]
    predicted = [row.predicted_limit for row in fap.FAPS]
    return SentRanges.covering(intra, np.negative(intra), predicted, np.negative(predicted))


def moving(values: Ints, held: Ints) -> Bools:
    """Find the fields that must be sent.

    Parameters
    ----------
    values : (T, 73) int64
    held : (73,) int64
        What the decoder shows now.

    Returns
    -------
    (68,) bool
        FAPs with a value unlike the one held.
    """
    differs = (values != held).any(0)
    return np.concatenate([[differs[:3].any(), differs[3:7].any()], differs[LOW_LEVEL_FIELDS]])


def point_errors_mm(errors: NDArray[np.float64], fapu: Fapu) -> NDArray[np.float64]:
    """Bound how far each feature point is off.

    The FAPs of one point move it along different axes: their errors add as squares. Head rotation carries all points.

    Parameters
    ----------
    errors : (..., 66) float64, FAPU
        Of FAP 3 to 68, magnitudes.
    fapu : Fapu
        Of the face that will be animated.

    Returns
    -------
    (..., 66) float64, mm
        For each FAP, the error of its feature point.
    """
    mm = np.abs(errors) * _mm_per_step(fapu)
    head = np.sqrt((mm[..., [number - 3 for number in HEAD_ROTATIONS]] ** 2).sum(-1, keepdims=True))
    own = mm.copy()
    own[..., [number - 3 for number in HEAD_ROTATIONS]] = 0
    total: NDArray[np.float64] = np.sqrt(own**2 @ _SAME_POINT) + head
    return total


def _mm_per_step(fapu: Fapu) -> NDArray[np.float64]:
    sizes = fapu.steps()[fap.column(3) :].copy()
    for number in EYE_ROTATIONS:
        sizes[number - 3] *= EYE_LEVER_MM
    for number in HEAD_ROTATIONS:
        sizes[number - 3] *= HEAD_LEVER_MM
    sizes[TONGUE_ROLL - 3] *= TONGUE_LEVER * fapu.mw0_mm
    return sizes


_POINTS = np.array([row.point for row in fap.FAPS])
_SAME_POINT = (_POINTS[:, None] == _POINTS[None, :]).astype(np.float64)


def coarsest_quant(values: Ints, mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Find the largest fap_quant that keeps every feature point within ``max_error_mm``.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    mask : (66,) bool
        FAPs that are sent.

    Returns
    -------
    int
        1..31, or 0 (no quantiser) where even 1 is too coarse.
    """
    for quant in range(MAX_QUANT, 0, -1):
        _, reconstructed = quantise(values, quant)
        errors = np.where(mask, values - reconstructed, 0).astype(np.float64)
        if point_errors_mm(errors, fapu).max(initial=0.0) <= max_error_mm:
            return quant
    return 0


def guaranteed_quant(mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Do as :func:`coarsest_quant` for values yet unknown: every error may be half a step."""
    for quant in range(MAX_QUANT, 0, -1):
        half = np.where(mask, STEPS * quant // 2, 0).astype(np.float64)
        if point_errors_mm(half, fapu).max(initial=0.0) <= max_error_mm:
            return quant
    return 0
