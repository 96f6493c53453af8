"""FAPs that are not sent: they keep their last value, or are computed from others (FBA section 9).

Deviation: the standard's formula for mask type 2 is not known here. The rules are: inner and outer lips replace each
other, then left and right; the others keep their last value. They are written as a FAP interpolation table
(:mod:`.fit`), whose publishers name the same two uses. A table of one's own takes their place.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.decoder import Decoded
from fapengine.codec.fit import Fit, Link, Polynomial, Term
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
LOW_LEVEL = slice(fap.column(3), None)
_COPY = ((Polynomial((Term(1, ((0, 1, 1),)),)), Polynomial()),)
PARTNERS = Fit(
    tuple((number,) for number in range(1, fap.FAP_COUNT + 1)),
    tuple(
        Link(fap.column(parent), fap.column(child), priority, _COPY)
        for priority, pairs in ((1, LIP_PARTNERS), (2, SIDE_PARTNERS))
        for pair in pairs
        for parent, child in (pair, pair[::-1])
    ),
)
"""The rules of mask type 2."""


def fill(
    values: NDArray[np.int32], known: NDArray[np.bool_], wanted: NDArray[np.bool_], table: Fit = PARTNERS
) -> tuple[NDArray[np.int32], int]:
    """Low-level FAPs that a face shows: computed by a table, else held.

    Parameters
    ----------
    values : (T, 68) int32, FAPU
        Used where known.
    known : (T, 68) bool
        FAPs that were sent.
    wanted : (T, 68) bool
        FAPs that the table may compute.
    table : Fit

    Returns
    -------
    values : (T, 68) int32, FAPU
        What neither was sent nor follows from the table keeps its last value; 0 at first.
    unreal : int
        Values that the table gives no real number for.
    """
    filled, known = values.astype(np.float64), known.copy()
    unreal = table.fill(filled, known, wanted)
    last = np.maximum.accumulate(np.where(known, np.arange(1, len(values) + 1)[:, None], 0), axis=0)
    held = np.take_along_axis(filled, np.maximum(last - 1, 0), axis=0)
    limits = np.iinfo(np.int32)
    return np.where(last > 0, np.rint(held.clip(limits.min, limits.max)), 0).astype(np.int32), unreal


def fill_track(decoded: Decoded, track: FapTrack | None = None, table: Fit | None = None) -> tuple[FapTrack, int]:
    """Return the track that a face shows: every low-level FAP of every frame.

    Parameters
    ----------
    decoded : Decoded
        Its mask types say which FAPs are interpolated.
    track : FapTrack, optional
        Its track, after FAP 1 and 2 were replaced by what they show; by default as it was sent.
    table : Fit, optional
        Computes FAPs of all groups that were not sent; by default :data:`PARTNERS` computes those of type 2.

    Returns
    -------
    FapTrack
    unreal : int
        As :func:`fill`.
    """
    track = track or decoded.track
    wanted = np.ones_like(track.mask)
    if table is None:
        group_of = [next(k for k, group in enumerate(fap.GROUPS) if number in group) for number in range(3, 69)]
        types = [
            np.broadcast_to(np.array(part.header.mask_types)[group_of], (len(part), 66)) for part in decoded.planes
        ]
        wanted[:, LOW_LEVEL] = np.concatenate(types) == INTERPOLATED
    values, unreal = fill(track.values, track.mask, wanted, table or PARTNERS)
    mask = track.mask.copy()
    mask[:, LOW_LEVEL] = True
    return replace(track, values=values, mask=mask), unreal
