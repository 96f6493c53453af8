"""The 73 coded fields of a plane, in the order of the stream; tracks laid out in them; and their symbol ranges.

Three fields of FAP 1 (select1, select2, blend), four of FAP 2 (select1, intensity1, select2, intensity2), then FAP 3 to
68 (FBA section 8). Beside them are three plain bits: viseme_def, init_face, expression_def. Ranges of the 66 low-level
FAPs are the table's or sent ones (FBA section 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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

GROUPS = fap.GROUPS
"""FAP numbers of the ten groups in which masks are sent (FBA section 4)."""


def rows_of(track: FapTrack) -> tuple[Ints, Ints]:
    """Lay a track out in fields.

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


def track_of(
    values: Ints, flags: Ints, mask: Bools, frame_numbers: Ints, *, rate_hz: float, name: str = "decoded"
) -> FapTrack:
    """Undo :func:`rows_of`; what ``mask`` (T, 68) does not select becomes 0."""
    count = len(values)
    out: NDArray[Any] = np.zeros((count, fap.FAP_COUNT), np.int64)
    out[:, fap.column(3) :] = np.where(mask[:, fap.column(3) :], values[:, LOW_LEVEL_FIELDS], 0)
    visemes: NDArray[Any] = np.column_stack([values[:, VISEME_FIELDS], flags[:, :1]]) * mask[:, :1]
    expressions: NDArray[Any] = np.column_stack([values[:, EXPRESSION_FIELDS], flags[:, 1:]]) * mask[:, 1:2]
    return FapTrack(
        values=out, mask=mask, visemes=visemes, expressions=expressions, frame_numbers=frame_numbers,
        rate_hz=rate_hz, name=name,
    )  # fmt: skip


UNIT = 60
"""A sent bound is a number of 5 bits times 60 quantiser steps at q = 1."""
MAX_SENT = 31
LISTS = ("i_max", "i_min", "p_max", "p_min")
"""Lists of ranges in the order in which they are sent."""
SIGNS = (1, -1, 1, -1)


@dataclass(frozen=True, slots=True, eq=False)
class SentRanges:
    """New ranges of one I plane; None where a list is not sent."""

    i_max: NDArray[np.int64] | None = None
    """(66,) magnitudes in units of 60, 0..31; FAPs that are masked out are not sent."""
    i_min: NDArray[np.int64] | None = None
    p_max: NDArray[np.int64] | None = None
    p_min: NDArray[np.int64] | None = None

    @property
    def lists(self) -> tuple[NDArray[np.int64] | None, ...]:
        """The four lists, each (66,) or None, in the order of the stream."""
        return self.i_max, self.i_min, self.p_max, self.p_min

    @classmethod
    def covering(
        cls, i_max: ArrayLike | None, i_min: ArrayLike | None, p_max: ArrayLike | None, p_min: ArrayLike | None
    ) -> "SentRanges":
        """Round wanted bounds outwards.

        Parameters
        ----------
        i_max, i_min, p_max, p_min : (66,) array_like of int, quantiser steps at q = 1, or None
            Maxima 0..1860, minima -1860..0.
        """
        wanted = (i_max, i_min, p_max, p_min)
        return cls(
            *(
                None if bounds is None else _magnitudes(name, np.asarray(bounds, np.int64) * sign)
                for name, bounds, sign in zip(LISTS, wanted, SIGNS, strict=True)
            )
        )


def _magnitudes(name: str, bounds: Ints) -> Ints:
    if bounds.shape != (LOW_LEVEL_COUNT,):
        raise UsageError(f"{name}: got shape {bounds.shape}, expected ({LOW_LEVEL_COUNT},)")
    sent: Ints = -(-bounds // UNIT)
    if sent.min() < 0 or sent.max() > MAX_SENT:
        worst = int(np.argmax(np.where(sent < 0, MAX_SENT - sent, sent)))
        raise UsageError(
            f"{name} of FAP {worst + 3}: must be 0 to {MAX_SENT * UNIT} with its sign, got magnitude {bounds[worst]}"
        )
    return sent


def default_ranges(quant: int) -> Ints:
    """Bounds from the table of FAPs, in symbols at ``quant``.

    Returns
    -------
    (4, 66) int64
        Rows in the order of :data:`LISTS`.
    """
    limits: Sequence[Sequence[int]] = [
        [row.intra_limit for row in fap.FAPS],
        [row.intra_limit for row in fap.FAPS],
        [row.predicted_limit for row in fap.FAPS],
        [row.predicted_limit for row in fap.FAPS],
    ]
    rounded = -(-np.array(limits, np.int64) // UNIT) * UNIT  # only FAP 63's 680 changes
    divided: Ints = rounded // max(quant, 1) * np.array(SIGNS)[:, None]
    return divided


def apply_sent(ranges: Ints, sent: SentRanges, mask: Bools, quant: int) -> None:
    """Change the rows of ``ranges`` that are sent, only for FAPs whose ``mask`` (66,) is on."""
    for row, (magnitudes, sign) in enumerate(zip(sent.lists, SIGNS, strict=True)):
        if magnitudes is not None:
            bounds = sign * (UNIT * magnitudes // max(quant, 1))
            ranges[row] = np.where(mask, bounds, ranges[row])
