"""Natural variation of speech: nobody says a word twice in the same way, or moves both halves of the mouth alike.

Theory of operation
-------------------
The plan is a mean. The residual of one speaker's captured motion was measured on 417 sentences
(``python -m design.speech_variation``): its principal components (:data:`DIRECTIONS`) and its power spectrum
(:data:`QUANTILES_HZ`). Each component is a sum of sines whose frequencies are drawn from the spectrum and whose phases
are random. So the variation at a time depends on the seed and that time alone: a stream equals its file.

Symmetric components have :data:`SYMMETRIC_SHARE` of their measured size. At full size 30 % of words are misread from
the lips, since a person's variation depends on what is said, and this does not. It is added before contacts are made
(:mod:`.closures`), and gives way to rounded lips as an expression does.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap

Array = NDArray[np.float64]

SYMMETRIC_SHARE, ASYMMETRIC_SHARE = 0.6, 1.0
"""Share of the measured size that is shown; :data:`DIRECTIONS` already contains it."""
DIRECTIONS: tuple[dict[int, float], ...] = (
    {6: 4.7, 7: -4.7, 8: -1.9, 9: 1.9, 10: 0.9, 11: -0.9, 12: 2.2, 13: -2.2, 15: -5.3, 39: 1.7, 40: -1.7, 53: 4.7,
     54: -4.7, 55: -2.3, 56: 2.3, 59: 2.3, 60: -2.3},
    {6: 1.2, 7: -1.2, 8: 6.4, 9: -6.4, 10: -6.7, 11: 6.7, 12: -8.9, 13: 8.9, 15: 1.0, 41: -0.4, 42: 0.4, 53: 1.3,
     54: -1.3, 55: 7.1, 56: -7.1, 57: -5.9, 58: 5.9, 59: -9.6, 60: 9.6},
    {6: 0.8, 7: -0.8, 10: 0.7, 11: -0.7, 12: 0.8, 13: -0.8, 15: -3.9, 39: 0.8, 40: -0.8, 53: 1.0, 54: -1.0, 55: 0.4,
     56: -0.4, 57: 1.2, 58: -1.2, 59: 1.1, 60: -1.1},
    {3: 29.1, 4: -1.7, 5: -42.7, 8: 5.3, 9: 5.3, 10: -33.5, 11: -33.5, 12: -17.0, 13: -17.0, 18: -2.5, 39: 0.4,
     40: 0.4, 41: -2.3, 42: -2.3, 51: 3.1, 52: -41.5, 53: 0.5, 54: 0.5, 55: 7.9, 56: 7.9, 57: -36.6, 58: -36.6,
     59: -16.7, 60: -16.7},
    {3: 2.6, 4: 28.1, 5: 12.6, 6: -1.3, 7: -1.3, 8: 21.1, 9: 21.1, 10: 4.2, 11: 4.2, 12: -10.9, 13: -10.9, 18: 2.0,
     41: -3.2, 42: -3.2, 51: 20.8, 52: 8.6, 53: -1.7, 54: -1.7, 55: 17.6, 56: 17.6, 57: 4.5, 58: 4.5, 59: -11.3,
     60: -11.3},
)  # fmt: skip
"""FAPU by FAP, one standard deviation: the mouth moves to a side; it tilts; the jaw moves to a side; lower lip and jaw;
upper lip."""
QUANTILES_HZ = (
    0.0, 0.29, 0.58, 0.83, 1.07, 1.33, 1.62, 1.94, 2.27, 2.64, 3.05, 3.53, 4.11, 4.91, 6.16, 8.4, 12.5,
)  # fmt: skip
"""Frequencies that divide the measured power into sixteenths."""
SINES = 4
"""Number of sines of each direction."""
RISE_S, FALL_S = 0.25, 0.12
"""Time over which it fades in before speech, and out after it."""
WAVES = SINES * len(DIRECTIONS)

_MATRIX = np.zeros((fap.FAP_COUNT, len(DIRECTIONS)))
for _column, _direction in enumerate(DIRECTIONS):
    _MATRIX[[fap.column(number) for number in _direction], _column] = list(_direction.values())
_SUMS = np.repeat(_MATRIX * np.sqrt(2.0 / SINES), SINES, axis=1)


def draw_variation(rng: np.random.Generator) -> Array:
    """(2, :data:`WAVES`): frequencies in rad/s and phases in rad."""
    shares, turns = rng.uniform(size=2 * WAVES).reshape(WAVES, 2).T
    return 2 * np.pi * np.stack([np.interp(shares, np.linspace(0, 1, len(QUANTILES_HZ)), QUANTILES_HZ), turns])


def variation_faps(levels: Array, waves: Array, since_s: Array) -> Array:
    """Vary N faces at one time, or one face at N times.

    Parameters
    ----------
    levels : (N,) float64
        Share that is shown, 0..1.
    waves : (2, WAVES, N or 1) float64
        Of :func:`draw_variation`.
    since_s : (N,) float64, s

    Returns
    -------
    (68, N) float64, FAPU
        Added to an expression, before :func:`.closures.settle`.
    """
    if not levels.any():
        return np.zeros((fap.FAP_COUNT, len(levels)))
    faps: Array = _SUMS @ (np.sin(waves[0] * since_s + waves[1]) * levels)
    return faps
