"""ARKit's 52 blend shapes, FAPs in and out; the order is that of Live Link Face and Azure, 0 to 51."""

import numpy as np

from fapengine.mpeg4 import fap
from fapengine.retarget.arkit_table import ARKIT_FAPS
from fapengine.retarget.blend import BlendMap

ARKIT_NAMES = tuple(name for name, _ in ARKIT_FAPS)
SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
SIDEWAYS_MM = 0.8
"""Reluctance of :data:`SIDEWAYS`: left and right together narrow a mouth, which is the pucker's business. It costs half
a millimetre, the root of the sum over all FAPs; the lips' opening comes back as before."""


def arkit_map() -> BlendMap:
    """Make the map of the 52 shapes.

    Examples
    --------
    >>> shapes = arkit_map()
    >>> smile = shapes.to_faps(np.eye(52)[[ARKIT_NAMES.index("mouthSmileLeft")]])
    >>> bool(smile[0, fap.column(12)] > 100)  # raise_l_cornerlip
    True
    """
    faps = np.zeros((len(ARKIT_FAPS), fap.FAP_COUNT))
    for row, (_, values) in enumerate(ARKIT_FAPS):
        for number, value in values.items():
            faps[row, fap.column(number)] = value
    cost = np.array([SIDEWAYS_MM if name in SIDEWAYS else 0.0 for name in ARKIT_NAMES])
    return BlendMap(ARKIT_NAMES, faps, reluctance_mm=cost)
