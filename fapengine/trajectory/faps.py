"""Feature point displacements to FAPs: through the FAPU of the recorded face and each FAP's direction.

The space determines FAP 3-18 (jaw, inner lips, chin), 39-42 (cheeks) and 51-60 (outer lips).
FAP 18 moves the chin boss against the jaw: what the jaw carries it is taken off.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

DETERMINED = (*range(3, 19), *range(39, 43), *range(51, 61))


def displacements_to_faps(
    displacement_mm: NDArray[np.float64], points: Sequence[str], fapu: Fapu
) -> NDArray[np.float64]:
    """Measure the determined FAPs.

    Parameters
    ----------
    displacement_mm : (T, P, 3) float64, mm
        From the rest face, head axes.
    points : sequence of str
        P feature point names.
    fapu : Fapu
        Of the face that moved.

    Returns
    -------
    (T, 68) float64, FAPU, not rounded; other columns are 0.
    """
    index = {name: column for column, name in enumerate(points)}
    faps = np.zeros((len(displacement_mm), fap.FAP_COUNT))
    for number in DETERMINED:
        row = fap.spec(number)
        moved = displacement_mm[:, index[row.point]]
        if number == 18:
            moved = moved - displacement_mm[:, index["2.1"]]
        faps[:, fap.column(number)] = moved @ np.array(fap.HEAD_AXES[row.positive]) / fapu.unit(row.unit)
    return faps
