"""Cohen and Massaro's coarticulation: every phone reaches for its target everywhere, the nearer the stronger.

The path is the mean of all targets, weighted by dominances ``exp(-rate |t - centre|)`` (Models and Techniques in
Computer Animation, 1993; here with one rate for all). For comparison: it has a kink at every centre, short phones
drown, and rest is never quite reached. Sums over all phones before and behind a moment are recursions, so the work is
linear in the length.
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
    weighed = np.concatenate([rest, targets, rest])
    weighed = np.hstack([weighed, np.ones((len(weighed), 1))])  # the last column sums the dominances themselves
    decay = np.exp(-rate_hz * np.diff(centres))
    past, coming = _summed(weighed, decay), _summed(weighed[::-1], decay[::-1])[::-1]
    behind = np.searchsorted(centres, times_s, side="right")
    since = times_s - np.append(-np.inf, centres)[behind]
    until = np.append(centres, np.inf)[behind] - times_s
    nearest = np.minimum(since, until)  # both are seen from the nearer centre, so that no sum is ever zero
    none = np.zeros_like(weighed[:1])
    sums = np.exp(-rate_hz * (since - nearest))[:, None] * np.concatenate([none, past])[behind]
    sums += np.exp(-rate_hz * (until - nearest))[:, None] * np.concatenate([coming, none])[behind]
    path: NDArray[np.float64] = sums[:, :-1] / sums[:, -1:]
    return path


def _summed(values: NDArray[np.float64], decay: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum each row and those before it, less by ``decay`` with each step."""
    sums = values.copy()
    for index, share in enumerate(decay.tolist(), 1):
        sums[index] += share * sums[index - 1]
    return sums
