"""Natural variation of speech: nobody says a word twice in the same way, or moves both halves of the mouth alike.

Theory of operation
-------------------
The plan is a mean. The residual of one speaker's captured motion was measured on 420 sentences
(``python -m design.speech_variation``): its principal components (:data:`DIRECTIONS`) and the power spectrum of each
(:data:`QUANTILES_HZ`). Each component is a sum of sines whose frequencies are drawn from its spectrum and whose phases
are random. So the variation at a time depends on the seed and that time alone: a stream equals its file.

At full size 30 % of words are misread from the lips, since a person's variation depends on what is said, and this does
not. So symmetric components show a part of their measured size: half or two thirds at the lips, nine tenths at the jaw,
which tells a lip reader less. It is added before contacts are made (:mod:`.closures`), and gives way to rounded lips as
an expression does.
"""

import numpy as np

from fapengine._arrays import Array
from fapengine.mpeg4 import fap

PARTS = 16
"""Number of equal parts of a spectrum's power."""
DIRECTIONS: tuple[dict[int, float], ...] = (
    {6: 5.6, 7: -5.6, 8: -2.2, 9: 2.2, 10: 1.2, 11: -1.2, 12: 2.7, 13: -2.7, 15: -7.5, 39: 2.4, 40: -2.4, 53: 5.7,
     54: -5.7, 55: -2.8, 56: 2.8, 57: 0.5, 58: -0.5, 59: 3.1, 60: -3.1},
    {6: 1.2, 7: -1.2, 8: 7.5, 9: -7.5, 10: -7.8, 11: 7.8, 12: -10.4, 13: 10.4, 15: 1.0, 41: -0.5, 42: 0.5, 53: 1.3,
     54: -1.3, 55: 8.2, 56: -8.2, 57: -6.9, 58: 6.9, 59: -11.1, 60: 11.1},
    {8: -0.5, 9: 0.5, 10: -0.7, 11: 0.7, 15: 5.5, 39: -1.5, 40: 1.5, 53: -0.4, 54: 0.4, 55: -0.7, 56: 0.7, 57: -1.7,
     58: 1.7, 59: -0.8, 60: 0.8},
    {3: 50.3, 4: 3.0, 5: -37.9, 8: 8.3, 9: 8.3, 10: -30.7, 11: -30.7, 12: -30.0, 13: -30.0, 18: -1.8, 41: -2.8,
     42: -2.8, 51: 6.0, 52: -37.9, 55: 10.1, 56: 10.1, 57: -33.7, 58: -33.7, 59: -29.8, 60: -29.8},
    {3: -0.7, 4: 33.6, 5: 18.2, 6: -1.7, 7: -1.7, 8: 25.4, 9: 25.4, 10: 7.3, 11: 7.3, 12: -16.5, 13: -16.5, 18: 2.3,
     41: -4.3, 42: -4.3, 51: 25.1, 52: 13.3, 53: -2.1, 54: -2.1, 55: 21.3, 56: 21.3, 57: 8.1, 58: 8.1, 59: -17.3,
     60: -17.3},
    {3: 3.2, 4: 4.1, 5: 2.6, 6: 5.9, 7: 5.9, 8: 1.8, 9: 1.8, 10: -0.5, 11: -0.5, 12: -1.4, 13: -1.4, 18: 1.4, 39: 1.7,
     40: 1.7, 41: -1.1, 42: -1.1, 51: 2.1, 52: 4.9, 53: 5.7, 54: 5.7, 55: 0.9, 56: 0.9, 57: 2.2, 58: 2.2, 59: -0.9,
     60: -0.9},
)  # fmt: skip
"""FAPU by FAP, what is shown of one standard deviation. Asymmetric: the mouth moves to a side; it tilts; the jaw moves
to a side. Symmetric: lower lip and jaw; upper lip; width."""
QUANTILES_HZ = (
    (0.0, 0.02, 0.03, 0.05, 0.07, 0.08, 0.24, 0.68, 1.01, 1.37, 1.86, 2.47, 3.19, 4.14, 5.55, 8.35, 12.5),
    (0.0, 0.02, 0.04, 0.06, 0.09, 0.27, 0.54, 0.76, 0.96, 1.17, 1.41, 1.73, 2.2, 2.95, 4.17, 6.31, 12.5),
    (0.0, 0.01, 0.03, 0.04, 0.06, 0.07, 0.09, 0.43, 0.88, 1.26, 1.67, 2.19, 2.85, 3.65, 4.61, 6.6, 12.5),
    (0.0, 0.03, 0.05, 0.08, 0.4, 0.86, 1.26, 1.71, 2.23, 2.79, 3.31, 3.81, 4.29, 4.88, 5.78, 7.53, 12.5),
    (0.0, 0.03, 0.05, 0.08, 0.4, 0.84, 1.22, 1.63, 2.06, 2.51, 2.98, 3.51, 4.1, 4.85, 6.0, 8.25, 12.5),
    (0.0, 0.02, 0.04, 0.06, 0.08, 0.15, 0.66, 1.01, 1.34, 1.71, 2.14, 2.66, 3.34, 4.21, 5.53, 7.96, 12.5),
)  # fmt: skip
"""Frequencies that divide the measured power of each into :data:`PARTS`; the slowest are a sentence's posture."""
SINES = 4
"""Number of sines of each direction."""
RISE_S, FALL_S = 0.25, 0.12
"""Time over which it fades in before speech, and out after it."""
WAVES = SINES * len(DIRECTIONS)

_MATRIX = np.zeros((fap.FAP_COUNT, len(DIRECTIONS)))
for _column, _direction in enumerate(DIRECTIONS):
    _MATRIX[fap.columns(*_direction), _column] = list(_direction.values())
_QUANTILES = np.repeat(np.array(QUANTILES_HZ), SINES, axis=0)
_SUMS = np.repeat(_MATRIX * np.sqrt(2.0 / SINES), SINES, axis=1)


def draw_variation(rng: np.random.Generator) -> Array:
    """(2, :data:`WAVES`): frequencies in rad/s and phases in rad."""
    shares, turns = rng.uniform(size=2 * WAVES).reshape(WAVES, 2).T
    parts, place = np.divmod(PARTS * shares, 1.0)
    low, high = (_QUANTILES[range(WAVES), parts.astype(int) + step] for step in (0, 1))
    return 2 * np.pi * np.stack([low + place * (high - low), turns])


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
