"""Symbol ranges of the 66 low-level FAPs: the table's, the sent ones, and what persists (FBA section 5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.codec.fields import LOW_LEVEL_COUNT, Bools, Ints
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap

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

        Raises
        ------
        UsageError
            If a bound has the wrong sign or five bits cannot hold it.
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
            f"{name} of FAP {worst + 3}: got magnitude {bounds[worst]}, expected 0..{MAX_SENT * UNIT} with its sign"
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
