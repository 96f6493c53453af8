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

from fapengine._arrays import Array, read_tables
from fapengine.mpeg4 import fap

PARTS = 16
"""Number of equal parts of a spectrum's power."""
_TABLES = read_tables("fapengine.trajectory", "variation.toml")["directions"]
DIRECTIONS = [{int(number): fapu for number, fapu in table["fapu"].items()} for table in _TABLES]
"""FAPU by FAP, what is shown of one standard deviation."""
QUANTILES_HZ = [table["quantiles_hz"] for table in _TABLES]
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
