"""Methods from phones to a path in the viseme space, with one interface; ``bench/fidelity`` compares them.

``context``, the default, measures best on held-out capture: targets by least squares from a phone's neighbours, quintic
segments. ``paper`` is paper 001: a phone's median at 30 % and a cubic spline. ``minimum-jerk`` puts the spline of paper
004 through the same keyframes: degree 5, C4, the least squared jerk. Such splines swing far beyond their keys where a
long phone stands beside short ones, so both are bounded (:func:`_bounded`); between 0.25 and 0.75 of a range the bound
is soft, and C2.

``dominance`` is Cohen and Massaro's coarticulation (Models and Techniques in Computer Animation, 1993; here with one
rate for all): the path is the mean of all targets, weighted by dominances ``exp(-rate |t - centre|)``. For comparison:
it has a kink at every centre, short phones are lost, and rest is never quite reached. Sums over all phones before and
after a moment are recursions, so the work is linear in the length.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import soft_positive
from fapengine.speaking import Method
from fapengine.trajectory import hermite
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.targets import Keyframes, Resolved

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


Array = NDArray[np.float64]
PathOf = Callable[[Sequence[Resolved], Keyframes, Array], Array]
"""Phones with their targets, keyframes, times in s (T,) -> weights (T, K)."""
PHONETIC_RATE_HZ = 30.0
"""Rate of :mod:`.methods` for what the phonetic layer adds: Cohen and Massaro, too, have one for each parameter. With
that of the recorded modes, 20, rounded sounds in words of 0.11 s a phone come forward by 3.5 mm more than others, with
30 by 4.2 mm."""
OVERSHOOT = 0.5
"""Share of the range of four keys by which a spline may leave it; up to :data:`.hermite.OVERSHOOT` it is left alone."""


def _context(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    return keys.sample(times_s)


def _paper(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    return _bounded(keys.sample(times_s, cubic=True), keys, times_s)


def _minimum_jerk(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    from scipy.interpolate import make_interp_spline

    still = np.zeros(keys.weights.shape[1])
    at_rest = [(1, still), (2, still)]
    spline = make_interp_spline(keys.times_s, keys.weights, k=5, bc_type=(at_rest, at_rest))  # type: ignore[arg-type]  # the stubs lack derivatives
    return _bounded(spline(np.clip(times_s, keys.times_s[0], keys.times_s[-1])), keys, times_s)


def _bounded(path: Array, keys: Keyframes, times_s: Array) -> Array:
    """Keep a path, (T, K), near the range of the two keys before a moment and the two after it."""
    last = len(keys.times_s) - 1
    left = np.clip(np.searchsorted(keys.times_s, times_s, side="right") - 1, 0, last - 1)
    four = keys.weights[np.clip(left[:, None] + np.arange(-1, 3), 0, last)]
    low, high = four.min(axis=1), four.max(axis=1)
    size = np.maximum(high - low, 1e-9)
    soft = 2 * (OVERSHOOT - hermite.OVERSHOOT)
    above, below = ((beyond / size) - hermite.OVERSHOOT for beyond in (path - high, low - path))
    bounded: Array = path + size * (soft_positive(below, soft) - soft_positive(above, soft))
    return bounded


def _dominance(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    path = dominance(resolved, times_s)
    path[:, -WIDTH:] = dominance(resolved, times_s, PHONETIC_RATE_HZ)[:, -WIDTH:]
    return path


METHODS: Mapping[Method, PathOf] = MappingProxyType(
    {"context": _context, "paper": _paper, "minimum-jerk": _minimum_jerk, "dominance": _dominance}
)


def sample_path(method: Method, resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    """(T, K) weights by one of :data:`METHODS`, the axes of :mod:`.phonetics` last; without phones nothing moves.

    ``resolved`` and ``keys`` come from :func:`.targets.resolve`, with ``context`` true for the method of that name
    only, and from :func:`.targets.place_keyframes`.
    """
    if not resolved:
        return np.zeros((len(times_s), keys.weights.shape[1]))
    return METHODS[method](resolved, keys, times_s)
