"""How like a true mouth: opening, width and lip points, frame by frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.scoring.mouth import Mouth

Array = NDArray[np.float64]

MIN_MM = 1e-6
"""Range below which a length does not move, and correlates with nothing."""


@dataclass(frozen=True, slots=True)
class Likeness:
    """Figures over the truth's frames that both recordings have. None where one of them does not move."""

    opening_r: float | None
    """Pearson correlation of the openings."""
    opening_slope: float | None
    """Slope of the regression of the opening on the true one: 0.5 opens half as far."""
    opening_mm: float
    """Mean distance of the openings (mouth opening distance, MOD)."""
    width_r: float | None
    """Pearson correlation of the widths."""
    width_slope: float | None
    """Slope of the width."""
    lips_mm: float
    """Mean distance of the 16 lip points."""
    lve_mm2: float
    """Lip vertex error: mean over frames of the largest squared distance of a lip point, mm²."""
    lve_root_mm: float
    """The same without the square, as some papers print it: mean of the largest distance, mm."""


def likeness_of(mouth: Mouth, truth: Mouth) -> Likeness:
    """Compare a mouth with a truth.

    Notes
    -----
    LVE is that of TorchMetrics 1.9 (``LipVertexError``: the mean over frames of the maximum over lip vertices of the
    squared distance), with the lip points of MPEG-4 as vertices. Sets of vertices differ between papers, and so their
    figures cannot be compared with each other or with these.
    """
    times_s = truth.times_s[truth.times_s <= mouth.end_s + 1e-9]
    true, made = truth.at(times_s), mouth.at(times_s)
    squared = ((made.lips_mm - true.lips_mm) ** 2).sum(axis=-1)
    return Likeness(
        opening_r=correlation(made.opening_mm, true.opening_mm),
        opening_slope=slope(made.opening_mm, true.opening_mm),
        opening_mm=float(np.abs(made.opening_mm - true.opening_mm).mean()),
        width_r=correlation(made.width_mm, true.width_mm),
        width_slope=slope(made.width_mm, true.width_mm),
        lips_mm=float(np.sqrt(squared).mean()),
        lve_mm2=float(squared.max(axis=1).mean()),
        lve_root_mm=float(np.sqrt(squared.max(axis=1)).mean()),
    )


def correlation(one: Array, other: Array) -> float | None:
    """Pearson's r of two (T,) arrays; None if one of them does not vary."""
    if len(one) < 2 or np.ptp(one) < MIN_MM or np.ptp(other) < MIN_MM:
        return None
    return float(np.corrcoef(one, other)[0, 1])


def slope(made: Array, true: Array) -> float | None:
    """Slope of the regression of ``made`` on ``true``, both (T,); None if the truth does not vary."""
    if len(true) < 2 or np.ptp(true) < MIN_MM:
        return None
    centred = true - true.mean()
    return float(centred @ made / (centred @ centred))
