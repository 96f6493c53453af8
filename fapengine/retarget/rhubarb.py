"""FAPs to Rhubarb's mouth shapes, frame by frame.

Theory of operation
-------------------
Four lengths on an adult's face decide, in mm relative to the neutral face: the opening of the lips, the narrowing of
the mouth, the height of the lower lip, and the drop of the jaw. Lips that touch are A; those of the neutral face touch
as well, so a closed mouth with its jaw up is X, unless the lips part within :data:`PAUSE_S` before and after. A lower
lip at the teeth is G. An open mouth is F or E if it is narrow, else B, C or D by its opening. Thresholds are between
the medians of the shapes in planned speech of the shipped profile (106 to 21 cues of a shape; opening of B 6.7, C 7.6,
D 11.4, E 7.5, F 4.5, G 1.2 mm; narrowing of E and F 5.3, of B, C, D 3.0 mm). H is a tongue behind the teeth, which
these lengths do not show, so it is never returned.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import weights_mm
from fapengine.retarget.moods import find_moods, without_moods

SHUT_MM = 0.7
"""Opening relative to the neutral face below which lips touch; closures of the planner leave 0.3 mm at most."""
BITTEN_OPENING_MM, BITTEN_LOWER_MM, BITTEN_UPPER_MM = 2.5, -0.7, 0.0
"""Largest opening of G, least height of its lower lip, and lowest upper lip: on p b m it comes down."""
NARROW_MM = 4.5
"""Narrowing from which lips are rounded."""
PUCKERED_OPENING_MM = 6.0
"""Largest opening of F; rounder lips that are wider open are E."""
OPEN_MM, WIDE_OPEN_MM = 7.0, 9.5
"""Least opening of C and of D."""
JAW_UP_MM = 1.0
"""Jaws of closed lips in speech are lower than this (4 mm, median)."""
PAUSE_S = 0.15
"""Closures of speech are shorter."""


def approximate_shapes(faps: ArrayLike, rate_hz: float) -> list[str]:
    """Find the shape of each frame.

    Parameters
    ----------
    faps : (T, 68) FAPU
        The contribution of moods (:mod:`.moods`) is removed.
    rate_hz : float
        Frame rate.

    Returns
    -------
    list of str
        T characters.

    Examples
    --------
    >>> import numpy as np
    >>> approximate_shapes(np.zeros((2, 68)), 30.0)
    ['X', 'X']
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    if not len(values):
        return []
    moved = without_moods(values, find_moods(values)[0]) * weights_mm()
    upper, lower, left, right = (moved[:, fap.column(number)] for number in (4, 5, 6, 7))
    jaw = values[:, fap.column(3)] * weights_mm()[fap.column(3)]  # brows that move make a little surprise, and its jaw
    opening, round_lips = -(upper + lower), left + right < -NARROW_MM
    shut, jaw_up = opening < SHUT_MM, jaw < JAW_UP_MM
    speaking = ~jaw_up | _near(~shut, round(PAUSE_S * rate_hz))
    bitten = (opening < BITTEN_OPENING_MM) & (lower > BITTEN_LOWER_MM) & (upper < BITTEN_UPPER_MM) & ~jaw_up
    names = np.select(
        [bitten, shut & speaking, shut, round_lips & (opening < PUCKERED_OPENING_MM), round_lips,
         opening < OPEN_MM, opening < WIDE_OPEN_MM],
        ["G", "A", "X", "F", "E", "B", "C"],
        "D",
    )  # fmt: skip
    return [str(name) for name in names]


def _near(parted: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Whether lips are parted both within ``reach`` frames before and within ``reach`` after each frame."""
    count = np.concatenate([[0], np.cumsum(parted)])
    here = np.arange(len(parted))
    before = count[here + 1] - count[np.maximum(here - reach, 0)]
    after = count[np.minimum(here + reach + 1, len(parted))] - count[here]
    near: NDArray[np.bool_] = (before > 0) & (after > 0)
    return near
