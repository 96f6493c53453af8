"""Plausibility of motion: remarks on tracks whose values look wrong, as by another unit."""

import numpy as np

from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack, limits

MOUTH = tuple(fap.column(number) for number in (*range(3, 19), *range(51, 61)))
"""Columns of jaw, lips and chin."""
UPPER_LIP, LOWER_LIP = (
    fap.column(fap.by_name("lower_t_midlip").number),
    fap.column(fap.by_name("raise_b_midlip").number),
)
FAPU_STEPS = 1024
"""Steps of a distance of the face."""
STILL_FAPU = 16
"""Largest movement of a mouth that nobody sees: 0.3 mm of an adult face."""
APART_FAPU, APART_S = 94, 2.0
"""Distance of lips that do not meet, 2 mm, and length of speech in which lips meet: read English closes them 2 to 3
times a second."""
LIMIT_SHARE = 0.2
"""Share of frames at a limit of the standard from which the unit is doubtful."""


def motion_remarks(track: FapTrack) -> tuple[str, ...]:
    """Remark on a track that does not move, moves too little or too much, or whose lips never meet.

    Examples
    --------
    >>> motion_remarks(FapTrack.pose(open_jaw=3))
    ('motion: the mouth moves by 3 FAPU at most (0.3 % of a distance of the face); is the unit right?',)
    """
    values = track.values
    largest = int(np.abs(values[:, MOUTH]).max(initial=0))
    if not len(track):
        return ()
    if not (values.any() or track.visemes.any() or track.expressions.any()):
        return (f"motion: no FAP moves in {len(track)} frames",)
    if 0 < largest < STILL_FAPU:
        share = 100 * largest / FAPU_STEPS
        return (f"motion: the mouth moves by {largest} FAPU at most ({share:.1f} % of a distance of the face); is the"
                " unit right?",)  # fmt: skip
    remarks = []
    highest = np.array([limits(column + 1)[1] for column in MOUTH])
    share = float((np.abs(values[:, MOUTH]) >= highest).any(axis=1).mean())
    if share >= LIMIT_SHARE:
        remarks.append(
            f"motion: in {100 * share:.0f} % of the frames the mouth is at a limit of the standard; is the unit right?"
        )
    least = int((-values[:, UPPER_LIP] - values[:, LOWER_LIP]).min())
    if least > APART_FAPU and track.duration_s >= APART_S:
        remarks.append(
            f"motion: the lips never meet in {track.duration_s:.1f} s, and stay {100 * least / FAPU_STEPS:.0f} % of the"
            " distance from mouth to nose apart"
        )
    return tuple(remarks)
