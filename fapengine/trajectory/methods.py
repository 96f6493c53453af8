"""Ways from phones to a path in the viseme space, behind one interface; ``bench/fidelity`` compares them.

``context``, the default, measures best on held-out capture: targets by least squares from a phone's neighbours, quintic
segments. ``paper`` is paper 001: a phone's median at 30 % and a cubic spline. ``minimum-jerk`` lays the spline of paper
004 through the same keyframes: degree 5, C4, the least squared jerk. ``dominance`` is :mod:`.dominance`.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from fapengine.trajectory.dominance import dominance
from fapengine.trajectory.keyframes import Keyframes
from fapengine.trajectory.style import Method
from fapengine.trajectory.targets import Resolved

Array = NDArray[np.float64]
PathOf = Callable[[Sequence[Resolved], Keyframes, Array], Array]
"""Phones with their targets, keyframes, times in s (T,) -> weights (T, K)."""


def _context(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    return keys.sample(times_s)


def _paper(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    return keys.sample(times_s, cubic=True)


def _minimum_jerk(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    still = np.zeros(keys.weights.shape[1])
    at_rest = [(1, still), (2, still)]
    spline = make_interp_spline(keys.times_s, keys.weights, k=5, bc_type=(at_rest, at_rest))  # type: ignore[arg-type]  # the stubs lack derivatives
    path: Array = spline(np.clip(times_s, keys.times_s[0], keys.times_s[-1]))
    return path


def _dominance(resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    return dominance(resolved, times_s)


METHODS: Mapping[Method, PathOf] = MappingProxyType(
    {"context": _context, "paper": _paper, "minimum-jerk": _minimum_jerk, "dominance": _dominance}
)


def sample_path(method: Method, resolved: Sequence[Resolved], keys: Keyframes, times_s: Array) -> Array:
    """(T, K) weights by one of :data:`METHODS`; no phones make no motion.

    ``resolved`` and ``keys`` come from :func:`.targets.resolve`, with ``context`` true for the method of that name
    only, and from :func:`.keyframes.place_keyframes`.
    """
    if not resolved:
        return np.zeros((len(times_s), keys.weights.shape[1]))
    return METHODS[method](resolved, keys, times_s)
