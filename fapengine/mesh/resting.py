"""Expression of a face at rest, for display only: lids over the iris and a slight smile; and limits of what is drawn.

The standard's neutral face shows the whole iris and a level mouth, which looks like a stare. This pose is added to FAPs
before they are drawn, on any head, and never sent or written. Each value fades where the face does something itself:
lids as they move, the smile as the mouth or the brows show an expression.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.mpeg4 import fap


class Resting(NamedTuple):
    """Values of a few FAPs at rest, and the FAPs to which they yield."""

    values: dict[int, float]
    """FAP number to FAPU."""
    yields_to: tuple[int, ...]
    limit: float
    """FAPU of any of these at which nothing of the values is left."""


BROWS, CORNERS = (31, 32, 33, 34, 35, 36), (12, 13, 59, 60, 6, 7, 53, 54)
RESTING = (
    *(Resting({number: 110.0}, (number,), 350.0) for number in (19, 20)),
    *(Resting({number: 20.0}, (number,), 350.0) for number in (21, 22)),
    Resting({12: 45.0, 13: 45.0, 59: 60.0, 60: 60.0, 6: 20.0, 7: 20.0, 53: 35.0, 54: 35.0}, (*CORNERS, *BROWS), 250.0),
    Resting({41: 70.0, 42: 70.0}, (41, 42, *CORNERS, *BROWS), 250.0),
)
LIMITS = dict.fromkeys((27, 28), 40.0) | dict.fromkeys((39, 40, 65, 66), 200.0) | dict.fromkeys((67, 68), 150.0)
LIMITS |= dict.fromkeys((61, 62), 120.0) | dict.fromkeys((63, 64), 100.0)
"""FAP number to the largest magnitude that is drawn, FAPU: beyond it an eyeball leaves its socket, a cheek or a nose
becomes a cone, and an ear comes off.
"""


def with_rest(faps: ArrayLike, share: float) -> Array:
    """Add the pose at rest to FAPs, and keep them within :data:`LIMITS`.

    Parameters
    ----------
    faps : (..., 68) array_like, FAPU
    share : float
        1 adds all of it, 0 nothing.
    """
    given = np.asarray(faps, dtype=np.float64)
    rested = given.copy()
    limits = np.array([*LIMITS.values()])
    limited = [fap.column(number) for number in LIMITS]
    rested[..., limited] = np.clip(given[..., limited], -limits, limits)
    for values, yields_to, limit in RESTING if share else ():
        moved = np.abs(given[..., [fap.column(number) for number in yields_to]]).max(axis=-1)
        columns = [fap.column(number) for number in values]
        left = share * (1 - smoothstep(moved / limit))
        rested[..., columns] += left[..., None] * np.array([*values.values()])
    return rested
