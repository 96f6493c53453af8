"""Choices of an encoder that a decoder need not know: ranges, masks, and the quantiser for a given accuracy."""

from collections.abc import Callable

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
"""Half the tongue's width as a fraction of the mouth width: the lever of tongue_roll."""
_EYES, _HEAD, _TONGUE_ROLL = slice(23 - 3, 27 - 3), slice(48 - 3, 51 - 3), 47 - 3
"""Rotations among FAP 3 to 68."""
MAX_QUANT = 31


def quantise(values: Ints, quant: int) -> tuple[Ints, Ints]:
    """Quantise low-level FAPs as an I plane and the P planes after it (FBA section 6), ignoring ranges.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    quant : int
        fap_quant, 0 to 31.

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
    """Return the narrowest ranges that contain the levels of :func:`quantise`.

    Parameters
    ----------
    margin : float
        Factor on every bound, for future values.
    predicted_only : bool
        Leave the ranges of I planes unchanged.
    """
    scale = max(quant, 1) * margin
    intra, predicted = levels[:1], levels[1:]
    if not len(predicted):
        predicted = np.zeros_like(intra)
    bounds = np.array([intra.max(0), -intra.min(0), predicted.max(0), -predicted.min(0)])
    lists = np.clip(np.ceil(np.maximum(bounds, 0) * scale / UNIT), 0, MAX_SENT).astype(np.int64)
    column = fap.column(4) - 2
    lists[0, column] = max(lists[0, column], 1)  # a decoder of the reference family takes 0..0 for "not yet set"
    return SentRanges(None, None, *lists[2:]) if predicted_only else SentRanges(*lists)


def table_ranges() -> SentRanges:
    """Ranges of the table of FAPs, to be sent when the quantiser changes: a decoder keeps its ranges otherwise."""
    intra = [row.intra_limit for row in fap.FAPS]
    predicted = [row.predicted_limit for row in fap.FAPS]
    return SentRanges.covering(intra, np.negative(intra), predicted, np.negative(predicted))


def moving(values: Ints, held: Ints) -> Bools:
    """Find the FAPs that must be sent.

    Parameters
    ----------
    values : (T, 73) int64
    held : (73,) int64
        Values that the decoder shows now.

    Returns
    -------
    (68,) bool
        FAPs with a value other than the one shown.
    """
    differs = (values != held).any(0)
    return np.concatenate([[differs[:3].any(), differs[3:7].any()], differs[LOW_LEVEL_FIELDS]])


def point_errors_mm(errors: NDArray[np.float64], fapu: Fapu) -> NDArray[np.float64]:
    """Return the greatest possible error of each feature point.

    The FAPs of one point move it along different axes: their errors add as squares. Head rotation moves all points.

    Parameters
    ----------
    errors : (..., 66) float64, FAPU
        Errors of FAP 3 to 68.
    fapu : Fapu
        Units of the face that will be animated.

    Returns
    -------
    (..., 66) float64, mm
        For each FAP, the error of its feature point.
    """
    sizes = fapu.steps()[fap.column(3) :].copy()
    sizes[_EYES] *= EYE_LEVER_MM
    sizes[_HEAD] *= HEAD_LEVER_MM
    sizes[_TONGUE_ROLL] *= TONGUE_LEVER * fapu.mw0_mm
    mm = np.abs(errors) * sizes
    head = np.sqrt((mm[..., _HEAD] ** 2).sum(-1, keepdims=True))
    mm[..., _HEAD] = 0
    total: NDArray[np.float64] = np.sqrt(mm**2 @ _SAME_POINT) + head
    return total


_POINTS = np.array([row.point for row in fap.FAPS])
_SAME_POINT = (_POINTS[:, None] == _POINTS[None, :]).astype(np.float64)


def coarsest_quant(values: Ints, mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Return the largest fap_quant that keeps every feature point within ``max_error_mm``.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    mask : (66,) bool
        FAPs that are sent.

    Returns
    -------
    int
        1 to 31, or 0 (no quantiser) where even 1 is too coarse.
    """
    return _largest_quant(lambda quant: values - quantise(values, quant)[1], mask, fapu, max_error_mm)


def guaranteed_quant(mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Like :func:`coarsest_quant` for unknown values: every error may be half a step."""
    return _largest_quant(lambda quant: STEPS * quant // 2, mask, fapu, max_error_mm)


def _largest_quant(errors_at: Callable[[int], Ints], mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    for quant in range(MAX_QUANT, 0, -1):
        errors = np.where(mask, errors_at(quant), 0).astype(np.float64)
        if point_errors_mm(errors, fapu).max(initial=0.0) <= max_error_mm:
            return quant
    return 0
