"""Lips that meet: the opening between the inner lips as a channel of its own, settled after everything else.

Theory of operation
-------------------
A spline through keyframes leaves the lips apart in many bilabials, and an expression added on top opens more of them.
So the vertical opening of the three pairs of inner-lip points (middle, left, right) is corrected last, in FAPs:

1. where the lips would pass through each other the opening is held at zero (:func:`soft_positive`, C2);
2. over the hold of every p b m it is multiplied by ``1 - bump``: zero through the hold, C2 at its ends.

The lower lip takes :data:`LOWER_SHARE` of each correction, the upper lip the rest, and the outer lips follow the inner.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import bump, soft_positive
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.keyframes import Resolved

PAIRS = ((4, 5, 51, 52), (8, 10, 55, 57), (9, 11, 56, 58))
"""FAPs of the inner upper, inner lower, outer upper and outer lower lip: middle, left, right. All count in MNS; upper
ones are positive downwards and lower ones upwards, so a pair's opening is minus its sum."""
LOWER_SHARE = 0.7
"""The lower lip does most of a closure; it has the jaw's help."""
HOLD = (0.1, 0.75)
"""Part of a bilabial in which the lips stay shut, as fractions of its duration."""
SHORTEST_HOLD_S = 0.04
RAMP_S = 0.05
SOFTNESS_FAPU = 20.0
"""About 0.4 mm on the recorded face."""


@dataclass(frozen=True, slots=True)
class Hold:
    """While the lips stay shut."""

    start_s: float
    stop_s: float


def hold_of(phone: Phone) -> Hold:
    """Time in which a bilabial keeps the lips shut."""
    start_s = phone.start_s + HOLD[0] * phone.duration_s
    return Hold(start_s, max(phone.start_s + HOLD[1] * phone.duration_s, start_s + SHORTEST_HOLD_S))


def holds_of(resolved: Sequence[Resolved]) -> list[Hold]:
    """List the holds of all bilabials."""
    return [hold_of(one.phone) for one in resolved if one.contact == "lips"]


def close_lips(faps: NDArray[np.float64], times_s: NDArray[np.float64], holds: Sequence[Hold]) -> NDArray[np.float64]:
    """Correct lip FAPs, (T, 68) FAPU, so that bilabials close and lips never pass through each other."""
    shut = np.zeros(len(times_s))
    for hold in holds:
        shut = np.maximum(shut, bump(times_s, hold.start_s, hold.stop_s, RAMP_S, RAMP_S))
    closed = faps.copy()
    for inner_upper, inner_lower, outer_upper, outer_lower in PAIRS:
        opening = -(closed[:, fap.column(inner_upper)] + closed[:, fap.column(inner_lower)])
        change = opening - (1.0 - shut) * soft_positive(opening, SOFTNESS_FAPU)
        for upper in (inner_upper, outer_upper):
            closed[:, fap.column(upper)] += (1 - LOWER_SHARE) * change
        for lower in (inner_lower, outer_lower):
            closed[:, fap.column(lower)] += LOWER_SHARE * change
    return closed
