"""How much better the full map gets by exchanging its markers; the program itself takes those of the weights."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.models.subset_study import RIDGE, fit_full_map


def search_full_swaps(
    gram_mm2: ArrayLike, primary: Sequence[int] | NDArray[np.intp], *, rounds: int = 100
) -> NDArray[np.intp]:
    """Exchange one basis marker at a time while the squared error of the full map falls: (k,) markers.

    As :func:`fapengine.models.subset.search_swaps`, with 3 x 3 blocks: taking marker j in lowers the error by
    ``trace(S_jj^-1 S_j. S_.j)`` of the Schur complement ``S`` without the marker that left.
    """
    gram = np.asarray(gram_mm2, dtype=np.float64)
    chosen = fit_full_map(gram, primary).primary.copy()
    small = RIDGE * np.trace(gram) / len(gram)
    left = np.inf
    for _ in range(rounds):
        best = (np.inf, 0, 0)
        for place in range(len(chosen)):
            others = np.delete(chosen, place)
            rows = (3 * others[:, None] + np.arange(3)).ravel()
            inner = gram[np.ix_(rows, rows)] + small * np.eye(len(rows))
            schur = gram - gram[:, rows] @ np.linalg.solve(inner, gram[rows])
            blocks = np.stack([schur[at : at + 3, at : at + 3] for at in range(0, len(gram), 3)])
            sides = schur.reshape(-1, 3, len(gram))
            gain = np.trace(
                np.linalg.solve(blocks + small * np.eye(3), sides @ np.swapaxes(sides, 1, 2)), axis1=1, axis2=2
            )
            gain[others] = -np.inf
            successor = int(gain.argmax())
            best = min(best, (float(np.trace(schur) - gain[successor]), place, successor))
        if best[0] >= left * (1 - 1e-9):
            break
        left, chosen[best[1]] = best[0], best[2]
    return chosen
