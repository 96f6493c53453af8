"""What a listener's eye misses when it is absent: blinks, small head motion, gaze that counters it, stressed brows.

Each generator is a pure function of times and a random generator; the same seed gives the same motion.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import bump, smoothstep
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.speech.phone_track import Phone

BLINK_INTERVAL_S = (1.2, 3.0)
"""Shortest time between blinks, and mean of the exponential time added: about 14 a minute, between rest (17) and
reading (4.5) in Bentivoglio et al. 1997, Movement Disorders 12, 1028."""
BLINK_CLOSE_S, BLINK_SHUT_S, BLINK_OPEN_S = 0.09, 0.04, 0.17
"""Lids fall about twice as fast as they rise (Guitton et al. 1991, J. Neurophysiology 65)."""
UPPER_LID, LOWER_LID = 960.0, 100.0
"""FAPU of a full blink: together a little over the lid distance (1024), so that no slit remains."""
HEAD_AMPLITUDE_RAD = {48: 0.022, 49: 0.030, 50: 0.013}
"""Pitch, yaw, roll: about 1.3, 1.7 and 0.7 degrees, an attentive speaker."""
HEAD_BAND_HZ = (0.12, 0.55)
NOD_RAD = 0.018
BROW_FAPU = 75.0
EDGE_S = 0.5
"""Head motion grows from nothing and returns to it over this time."""


def _add(faps: NDArray[np.float64], numbers: Iterable[int], values: NDArray[np.float64]) -> None:
    for number in numbers:
        faps[:, fap.column(number)] += values


def blinks(times_s: NDArray[np.float64], end_s: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(T, 68) FAPU: blinks of both eyes, none cut off by the end."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    shut_s = 0.6 + rng.uniform(0.0, 1.2)
    while shut_s + BLINK_SHUT_S + BLINK_OPEN_S < end_s:
        shape = bump(times_s, shut_s, shut_s + BLINK_SHUT_S, BLINK_CLOSE_S, BLINK_OPEN_S)
        _add(faps, (19, 20), UPPER_LID * shape)
        _add(faps, (21, 22), LOWER_LID * shape)
        shut_s += BLINK_INTERVAL_S[0] + rng.exponential(BLINK_INTERVAL_S[1])
    return faps


def head_motion(
    times_s: NDArray[np.float64], end_s: float, stressed: Iterable[Phone], rng: np.random.Generator
) -> NDArray[np.float64]:
    """(T, 68) FAPU: slow sway, a small nod with each stressed phone, and eyes that keep looking ahead."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    edges = smoothstep(times_s / EDGE_S) * smoothstep((end_s - times_s) / EDGE_S)
    for number, amplitude_rad in HEAD_AMPLITUDE_RAD.items():
        frequencies = rng.uniform(*HEAD_BAND_HZ, size=4)
        phases = rng.uniform(0, 2 * np.pi, size=4)
        sway = np.sin(2 * np.pi * frequencies * times_s[:, None] + phases).sum(axis=1) / 2
        _add(faps, (number,), edges * amplitude_rad * sway / AU_RAD)
    for phone in stressed:
        strength = (1.0 if phone.stress == 1 else 0.5) * rng.uniform(0.5, 1.0)
        beat = strength * bump(times_s, phone.start_s, phone.start_s + 0.5 * phone.duration_s, 0.18, 0.3) * edges
        _add(faps, (48,), NOD_RAD * beat / AU_RAD)
        _add(faps, (31, 32, 33, 34, 35, 36), BROW_FAPU * beat)
    # The eyes counter the head (vestibulo-ocular reflex), so that the gaze rests on the viewer.
    _add(faps, (23, 24), -faps[:, fap.column(49)])
    _add(faps, (25, 26), -faps[:, fap.column(48)])
    return faps
