"""Rows of the tables of blendshapes, as arrays: what each does in FAPs at full weight."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap
from fapengine.retarget.arkit_table import ARKIT_FAPS

Array = NDArray[np.float64]


def rows_of(table: Mapping[str, Mapping[int, float]], names: tuple[str, ...]) -> Array:
    """Rows of a table by name, (N, 68) FAPU."""
    rows = np.zeros((len(names), fap.FAP_COUNT))
    for row, name in enumerate(names):
        for number, value in table[name].items():
            rows[row, fap.column(number)] = value
    return rows


@cache
def _arkit() -> dict[str, dict[int, float]]:
    return dict(ARKIT_FAPS)


def arkit_rows(names: tuple[str, ...]) -> Array:
    """Rows of ARKit's shapes by name, (N, 68) FAPU."""
    return rows_of(_arkit(), names)
