"""FAPs that are not sent: they keep their last value, or are filled from their partners (FBA section 9).

Deviation: the standard's formula for mask type 2 is not known here. The rules are: inner and outer lips replace each
other, then left and right; the others keep their last value. The values of FIT tables are not used.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.decoder import Decoded
from fapengine.codec.fields import GROUPS, LOW_LEVEL_COUNT, LOW_LEVEL_FIELDS, Bools, Ints
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

LIP_PARTNERS = tuple(zip(range(4, 14), range(51, 61), strict=True))
"""Inner and outer lip FAPs; each fills the other."""
SIDE_PARTNERS = (
    (6, 7), (8, 9), (10, 11), (12, 13), (19, 20), (21, 22), (23, 24), (25, 26), (27, 28), (29, 30), (31, 32), (33, 34),
    (35, 36), (37, 38), (39, 40), (41, 42), (53, 54), (55, 56), (57, 58), (59, 60), (61, 62), (65, 66), (67, 68),
)  # fmt: skip
"""The value is copied unchanged: units and positive directions of each pair are mirror images."""
INTERPOLATED = 2
"""Mask type of groups whose FAPs that are not sent are interpolated."""

_PARTNERS: NDArray[np.int64] = np.full((2, LOW_LEVEL_COUNT), -1, np.int64)
for _row, _pairs in enumerate((LIP_PARTNERS, SIDE_PARTNERS)):
    for _one, _other in _pairs:
        _PARTNERS[_row, _one - 3], _PARTNERS[_row, _other - 3] = _other - 3, _one - 3
_GROUP_OF = np.array([next(k for k, group in enumerate(GROUPS) if number in group) for number in range(3, 69)])


def fill(values: Ints, mask: Bools, mask_types: tuple[int, ...], shown: Ints) -> Ints:
    """Low-level FAPs that a face shows in one frame.

    Parameters
    ----------
    values : (66,) int64, FAPU
        FAP 3 to 68; used where ``mask`` is on.
    mask : (66,) bool
        FAPs that were sent.
    mask_types : (10,) int
        Types in the I plane in force.
    shown : (66,) int64, FAPU
        The frame before; 0 at first.

    Returns
    -------
    (66,) int64, FAPU
    """
    filled = np.where(mask, values, shown)
    sent = mask.copy()
    wanted = ~mask & (np.array(mask_types)[_GROUP_OF] == INTERPOLATED)
    for partners in (*_PARTNERS, _PARTNERS[0]):  # lips, sides, and lips again: 7 may come from 6, then 54 from 7
        take = wanted & ~sent & (partners >= 0) & sent[partners]
        filled[take] = filled[partners[take]]
        sent |= take
    return filled


def fill_track(decoded: Decoded) -> FapTrack:
    """Return the track that a face shows: every low-level FAP of every frame, held or filled where it was not sent."""
    low_level = slice(fap.column(3), None)
    shown = [np.zeros(LOW_LEVEL_COUNT, np.int64)]
    for part in decoded.planes:
        mask, types = part.header.mask[low_level], part.header.mask_types
        for row in part.values:
            shown.append(fill(row[LOW_LEVEL_FIELDS], mask, types, shown[-1]))
    values, mask = decoded.track.values.copy(), decoded.track.mask.copy()
    values[:, low_level], mask[:, low_level] = shown[1:], True
    return replace(decoded.track, values=values, mask=mask)
