"""The 73 coded fields of a plane, in the order of the stream; conversion from and to tracks; symbol ranges.

Three fields of FAP 1 (select1, select2, blend), four of FAP 2 (select1, intensity1, select2, intensity2), then FAP 3 to
68 (FBA section 8). Three flags are sent uncoded: viseme_def, init_face, expression_def. The ranges of the 66 low-level
FAPs come from the table of FAPs or from the stream (FBA section 5).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FIELD_COUNT = 73
VISEME_FIELDS = slice(0, 3)
EXPRESSION_FIELDS = slice(3, 7)
LOW_LEVEL_FIELDS = slice(7, 73)
LOW_LEVEL_COUNT = 66

FIELD_FAPS: tuple[int, ...] = (1, 1, 1, 2, 2, 2, 2, *range(3, fap.FAP_COUNT + 1))
"""FAP number of each field."""
FIELD_NAMES: tuple[str, ...] = (
    "viseme_select1", "viseme_select2", "viseme_blend",
    "expression_select1", "expression_intensity1", "expression_select2", "expression_intensity2",
    *(row.name for row in fap.FAPS),
)  # fmt: skip


def rows_of(track: FapTrack) -> tuple[Ints, Ints]:
    """Convert a track to fields.

    Returns
    -------
    values : (T, 73) int64
    flags : (T, 3) int64
        viseme_def, init_face, expression_def.
    """
    values = np.zeros((len(track), FIELD_COUNT), np.int64)
    values[:, VISEME_FIELDS] = track.visemes[:, :3]
    values[:, EXPRESSION_FIELDS] = track.expressions[:, :4]
    values[:, LOW_LEVEL_FIELDS] = track.values[:, fap.column(3) :]
    flags = np.column_stack([track.visemes[:, 3], track.expressions[:, 4], track.expressions[:, 5]]).astype(np.int64)
    return values, flags


def track_of(values: Ints, flags: Ints, mask: Bools, frame_numbers: Ints, *, rate_hz: float) -> FapTrack:
    """Convert fields back to a track: the inverse of :func:`rows_of`. Values outside ``mask`` (T, 68) become 0."""
    low_level = slice(fap.column(3), None)
    out: NDArray[Any] = np.zeros(mask.shape, np.int64)
    out[:, low_level] = np.where(mask[:, low_level], values[:, LOW_LEVEL_FIELDS], 0)
    visemes: NDArray[Any] = np.column_stack([values[:, VISEME_FIELDS], flags[:, :1]]) * mask[:, :1]
    expressions: NDArray[Any] = np.column_stack([values[:, EXPRESSION_FIELDS], flags[:, 1:]]) * mask[:, 1:2]
    return FapTrack(
        values=out, mask=mask, visemes=visemes, expressions=expressions, frame_numbers=frame_numbers,
        rate_hz=rate_hz, name="decoded",
    )  # fmt: skip


UNIT = 60
"""A sent bound is a 5-bit number times 60 quantiser steps at q = 1."""
MAX_SENT = 31
LISTS = ("i_max", "i_min", "p_max", "p_min")
"""Lists of ranges in the order in which they are sent."""
SIGNS = (1, -1, 1, -1)


class SentRanges(NamedTuple):
    """New ranges of one I plane, in the order of :data:`LISTS`.

    Each is (66,) int64 magnitudes in units of 60, 0 to 31, or None where not sent. Only those of coded FAPs are sent.
    """

    i_max: Ints | None = None
    i_min: Ints | None = None
    p_max: Ints | None = None
    p_min: Ints | None = None

    @classmethod
    def covering(cls, *bounds: ArrayLike | None) -> "SentRanges":
        """Round bounds outwards.

        Parameters
        ----------
        bounds : four of (66,) array_like of int, quantiser steps at q = 1, or None
            Maxima 0 to 1860, minima -1860 to 0.
        """
        return cls(
            *(
                None if wanted is None else _magnitudes(name, np.asarray(wanted, np.int64) * sign)
                for name, wanted, sign in zip(LISTS, bounds, SIGNS, strict=True)
            )
        )


def _magnitudes(name: str, bounds: Ints) -> Ints:
    """(66,) bounds in units of 60, rounded up."""
    if bounds.shape != (LOW_LEVEL_COUNT,):
        raise UsageError(f"{name}: got shape {bounds.shape}, expected ({LOW_LEVEL_COUNT},)")
    sent: Ints = -(-bounds // UNIT)
    bad = np.flatnonzero((sent < 0) | (sent > MAX_SENT))
    if len(bad):
        limits = f"must be 0 to {MAX_SENT * UNIT} with its sign"
        raise UsageError(f"{name} of FAP {bad[0] + 3}: {limits}, got magnitude {bounds[bad[0]]}")
    return sent


def default_ranges(quant: int) -> Ints:
    """Ranges of the table of FAPs, in symbols at ``quant``.

    Returns
    -------
    (4, 66) int64
        Rows in the order of :data:`LISTS`.
    """
    intra, predicted = [row.intra_limit for row in fap.FAPS], [row.predicted_limit for row in fap.FAPS]
    limits = np.array([intra, intra, predicted, predicted], np.int64)
    rounded = -(-limits // UNIT) * UNIT  # only FAP 63's 680 changes
    divided: Ints = rounded // max(quant, 1) * np.array(SIGNS)[:, None]
    return divided


def apply_sent(ranges: Ints, sent: SentRanges, mask: Bools, quant: int) -> Ints:
    """Return ranges, (4, 66), with the rows that are sent replaced, for FAPs with a ``mask`` (66,) that is on."""
    ranges = ranges.copy()
    for row, magnitudes, sign in zip(ranges, sent, SIGNS, strict=True):
        if magnitudes is not None:
            row[mask] = (sign * (UNIT * magnitudes // max(quant, 1)))[mask]
    return ranges
