"""What a face feels, told from what it says: moods are found where speech does nothing.

Brows, lids, cheeks and nose tell the mood and the blinks; what the mood does to the mouth follows from it.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.viseme_table import EXPRESSION_FAPS

Array = NDArray[np.float64]

MOODS = {"happy": "joy", "angry": "anger", "sad": "sadness", "surprised": "surprise"}
"""VRM's moods that MPEG-4 has too, and its names for them."""
UPPER_FACE = (19, 20, 21, 22, *range(31, 43), 61, 62, 63, 64)
"""FAPs that tell moods and blinks."""
MOOD_MM = 0.25
"""A mood that is so faint is none: lids that follow the gaze, brows that drift."""


@cache
def mood_map() -> BlendMap:
    """Make the map of moods and the two lids, on the upper face."""
    moods = rows_of(dict(EXPRESSION_FAPS), tuple(MOODS.values()))
    lids = arkit_map().select(("eyeBlinkLeft", "eyeBlinkRight")).faps
    upper = np.zeros(fap.FAP_COUNT)
    upper[[fap.column(number) for number in UPPER_FACE]] = 1.0
    cost = np.array([MOOD_MM] * len(MOODS) + [0.0, 0.0])
    return BlendMap((*MOODS, "blinkLeft", "blinkRight"), np.concatenate([moods, lids]) * upper, reluctance_mm=cost)


def find_moods(faps: Array) -> tuple[Array, Array]:
    """Find moods (T, 4) and lids, left and right, (T, 2), each 0..1, of FAPs (T, 68)."""
    weights = mood_map().approximate_weights(faps)
    return weights[:, : len(MOODS)], weights[:, len(MOODS) :]


def moods_to_faps(moods: Array) -> Array:
    """(..., 4) -> (..., 68) FAPU: the whole face."""
    faps: Array = moods @ _rows()
    return faps


@cache
def _rows() -> Array:
    return rows_of(dict(EXPRESSION_FAPS), tuple(MOODS.values()))


def rows_of(table: dict[str, dict[int, float]], names: tuple[str, ...]) -> Array:
    """Rows of a table by name, (N, 68) FAPU."""
    rows = np.zeros((len(names), fap.FAP_COUNT))
    for row, name in enumerate(names):
        for number, value in table[name].items():
            rows[row, fap.column(number)] = value
    return rows
