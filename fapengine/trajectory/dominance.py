"""Cohen and Massaro's coarticulation: every phone reaches for its target everywhere, the nearer the stronger.

The path is the mean of all targets, weighted by dominances ``exp(-rate |t - centre|)`` (Models and Techniques in
Computer Animation, 1993; here with one rate for all). For comparison: it has a kink at every centre, and short phones
drown.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.trajectory.targets import Resolved

RATE_HZ = 20.0
"""The better of 12 and 20 a second in ``bench/fidelity``."""


def dominance(
    resolved: Sequence[Resolved], times_s: NDArray[np.float64], rate_hz: float = RATE_HZ
) -> NDArray[np.float64]:
    """(T, K) weights; the rest face stands at the beginning of the first and the end of the last of the phones."""
    centres = np.array([(spoken.phone.start_s + spoken.phone.end_s) / 2 for spoken in resolved])
    targets = np.stack([spoken.targets[0] for spoken in resolved])
    rest = np.zeros_like(targets[:1])
    centres = np.concatenate([[resolved[0].phone.start_s], centres, [resolved[-1].phone.end_s]])
    weight = np.exp(-rate_hz * np.abs(times_s[:, None] - centres))
    path: NDArray[np.float64] = weight @ np.concatenate([rest, targets, rest]) / weight.sum(axis=1, keepdims=True)
    return path
