"""The 15 visemes of Oculus (OVR LipSync), also used by Ready Player Me, VRChat and others: from FAPs and to FAPs.

They are MPEG-4's visemes, number for number, and ``sil``. Weights are fractions: none is negative, they add up to 1,
and ``sil`` is the remainder. The FAPs of each viseme come from ``design/fit_visemes.py``; of several sounds
that look alike (t, k, n), one represents the others.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.visemes import VISEMES
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.moods import find_moods, without_moods
from fapengine.retarget.shape_rows import shape_rows

OCULUS_NAMES = tuple(viseme.label for viseme in VISEMES)
"""Names in the order of the API, 0..14."""
PLAIN = ("PP", "FF", "aa", "E", "ih", "oh", "ou")
"""Visemes that can be recognized by sight; others are used where they gain more than :data:`RELUCTANCE_MM`."""
DEPTH = (16, 17)
"""FAPs that hardly distinguish visemes: a p next to u is as far forward as the u."""
RELUCTANCE_MM = 0.2
"""Reluctance with which every vowel is shown as its own viseme; it causes half of the error (0.1 mm)."""


@cache
def oculus_map() -> BlendMap:
    """Return the map of the 14 visemes that move; ``sil`` is the neutral face."""
    names = OCULUS_NAMES[1:]
    cost = np.array([0.0 if name in PLAIN else RELUCTANCE_MM for name in names])
    return BlendMap(names, shape_rows(names), reluctance_mm=cost, ignored=DEPTH)


def approximate_visemes(faps: ArrayLike) -> Array:
    """Find the visemes that reproduce FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU
        Jaw and lips count; the contribution of moods (:mod:`.moods`) is removed.

    Returns
    -------
    (T, 15) float64
        In the order of :data:`OCULUS_NAMES`; each row adds up to 1.

    Examples
    --------
    >>> import numpy as np
    >>> rest = approximate_visemes(np.zeros((1, 68)))
    >>> OCULUS_NAMES[int(rest[0].argmax())], float(rest.sum())
    ('sil', 1.0)
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    spoken = without_moods(values, find_moods(values)[0])
    return shares(oculus_map().approximate_weights(spoken))


def shares(weights: Array) -> Array:
    """Convert weights of the 14, (..., 14), to fractions of the 15, (..., 15)."""
    total = weights.sum(axis=-1, keepdims=True)
    fitted = weights / np.maximum(total, 1.0)
    return np.concatenate([np.maximum(1.0 - fitted.sum(axis=-1, keepdims=True), 0.0), fitted], axis=-1)


def visemes_to_faps(weights: ArrayLike) -> Array:
    """(..., 15) weights -> (..., 68) FAPU; sums below 1 are filled with silence, sums above 1 are scaled down.

    Raises
    ------
    UsageError
        If a weight is negative.
    """
    values = frozen(weights, "weights", ("...", len(OCULUS_NAMES)), np.float64)
    if (values < 0).any():
        raise UsageError(f"weights: got {values.min():g}, expected none below 0")
    return oculus_map().to_faps(values[..., 1:] / np.maximum(values.sum(axis=-1, keepdims=True), 1.0))
