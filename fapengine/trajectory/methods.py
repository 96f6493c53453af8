"""Methods from phones to a path in the viseme space; ``bench/fidelity`` compares them.

``context``, the default, measures best on held-out capture: targets by least squares from a phone's neighbours, quintic
segments. ``paper`` is paper 001: a phone's median at 30 % and a cubic spline. ``minimum-jerk`` puts the spline of paper
004 through the same keyframes: degree 5, C4, the least squared jerk. Such splines swing far beyond their keys where a
long phone is next to short ones, so both are bounded (:func:`_bounded`); between 0.25 and 0.75 of a range the bound
is soft, and C2. ``published`` is paper 001 without what we added: one key for each phone (:func:`as_published`), no
bound, no phonetic layer, and no contacts (:meth:`.faps.Composer.faps`). It is for comparison: lips may stay open.

``dominance`` is Cohen and Massaro's coarticulation (Models and Techniques in Computer Animation, 1993; here with one
rate for all): the path is the mean of all targets, weighted by dominances ``exp(-rate |t - centre|)``. For comparison:
it has a kink at every centre, short phones are lost, and the neutral face is never quite reached. Sums over all phones
before and after a moment are recursions, so the work is linear in the length.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from fapengine._arrays import Array
from fapengine.geometry.smooth import soft_positive
from fapengine.profiles import Profile
from fapengine.speaking import Method
from fapengine.trajectory import hermite
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.targets import Keyframes, SpeechKeys

RATE_HZ = 20.0
"""The better of 12 and 20 per second in ``bench/fidelity``."""
PHONETIC_RATE_HZ = 30.0
"""Rate of :func:`dominance` for what the phonetic layer adds: Cohen and Massaro, too, have one for each parameter. With
that of the recorded modes, 20, rounded sounds in words of 0.11 s per phone come forward by 3.5 mm more than others,
with 30 by 4.2 mm."""
OVERSHOOT = 0.5
"""Fraction of the range of four keys by which a spline may leave it; up to :data:`.hermite.OVERSHOOT` it is
unchanged."""


def dominance(keys: SpeechKeys, times_s: Array, rate_hz: float = RATE_HZ) -> Array:
    """(T, K) weights; the neutral face is at the beginning of the first and the end of the last of the phones."""
    phones = [phone for said in keys.said for phone, _ in said]
    middles = [(phone.start_s + phone.end_s) / 2 for phone in phones]
    centres = np.array([phones[0].start_s, *middles, phones[-1].end_s])
    targets = keys.targets[np.unique(keys.phone_of, return_index=True)[1]]
    weighed = np.zeros((len(centres), targets.shape[1] + 1))
    weighed[1:-1, :-1] = targets
    weighed[:, -1] = 1.0  # sums the dominances themselves
    decay = np.exp(-rate_hz * np.diff(centres))
    past, coming = _summed(weighed, decay), _summed(weighed[::-1], decay[::-1])[::-1]
    passed = np.searchsorted(centres, times_s, side="right")
    since = times_s - np.append(-np.inf, centres)[passed]
    until = np.append(centres, np.inf)[passed] - times_s
    nearest = np.minimum(since, until)  # both are seen from the nearer centre, so that no sum is ever zero
    none = np.zeros_like(weighed[:1])
    sums = np.exp(-rate_hz * (since - nearest))[:, None] * np.concatenate([none, past])[passed]
    sums += np.exp(-rate_hz * (until - nearest))[:, None] * np.concatenate([coming, none])[passed]
    path: Array = sums[:, :-1] / sums[:, -1:]
    return path


def _summed(values: Array, decay: Array) -> Array:
    """Sum each row and those before it, less by ``decay`` with each step."""
    sums = values.copy()
    for index, share in enumerate(decay.tolist(), 1):
        sums[index] += share * sums[index - 1]
    return sums


def _quintic(keys: Keyframes, times_s: Array) -> Array:
    return hermite.paths(*keys, 1)[0].sample(times_s)


def _published(keys: Keyframes, times_s: Array) -> Array:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(keys.times_s, keys.weights, bc_type="clamped")
    return spline(np.clip(times_s, keys.times_s[0], keys.times_s[-1]))


def _paper(keys: Keyframes, times_s: Array) -> Array:
    return _bounded(_published(keys, times_s), keys, times_s)


def _minimum_jerk(keys: Keyframes, times_s: Array) -> Array:
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


SPLINES: Mapping[Method, Callable[[Keyframes, Array], Array]] = MappingProxyType(
    {"context": _quintic, "paper": _paper, "published": _published, "minimum-jerk": _minimum_jerk}
)
"""Keyframes of one track, times in s (T,) -> weights (T, K)."""


@lru_cache(maxsize=16)
def as_published(profile: Profile) -> Profile:
    """Keep the first key of each phone, and no context model."""
    phones = {
        name: replace(phone, fractions=phone.fractions[:1], targets=phone.targets[:1])
        for name, phone in profile.phones.items()
    }
    return replace(profile, phones=MappingProxyType(phones), context=None)


def sample_path(method: Method, keys: SpeechKeys, times_s: Array) -> Array:
    """(T, K + axes): weights of one track by a method; without phones nothing moves.

    ``keys`` come from :func:`.targets.keys_of`, with ``context`` true for the method of that name only.
    """
    if not keys.rests:
        return np.zeros((len(times_s), keys.targets.shape[1]))
    if method == "dominance":
        path = dominance(keys, times_s)
        path[:, -WIDTH:] = dominance(keys, times_s, PHONETIC_RATE_HZ)[:, -WIDTH:]
        return path
    path = SPLINES[method](keys.keyframes(), times_s)
    if method == "published":
        path[:, -WIDTH:] = 0.0
    return path
