"""What a listener's eye misses when it is absent: blinks, head motion, gaze, idle drifts, emphasis on stress.

Each generator is a pure function of times and a random generator of its own, and makes (T, 68) FAPU. The same seed
gives the same motion, and to switch one off changes nothing in the others. All but blinks begin and end at nothing.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import bump, smoothstep
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.style import GENERATORS, Style

Array = NDArray[np.float64]

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
"""Motion grows from nothing and returns to it over this time."""
FIXATION_S = (0.6, 1.4)
"""Shortest time that the eyes rest on a place, and mean of the exponential time added."""
GLANCE_RAD = 0.022
"""Standard deviation of where they rest, sideways; half of it up and down. 1.3 degrees stay in a listener's face."""
SACCADE_S = 0.04
"""Of some degrees' size; Bahill et al. 1975 (main sequence)."""
BREATH_HZ, BREATH_RAD = (0.2, 0.3), 0.004
DRIFTS_FAPU = {(31, 32, 33, 34): 14.0, (35, 36): 8.0, (12, 13, 59, 60): 7.0, (19, 20): 15.0}
"""Brows, their outer ends, mouth corners, upper lids: together, about a third of a millimetre."""
DRIFT_BAND_HZ = (0.05, 0.25)
LIDS_FOLLOW = {(19, 20): 600.0, (21, 22): -200.0}
"""FAPU by which upper and lower lids follow a gaze that goes down by a radian: 0.6 and 0.2 of the eye's angle. The
look-down and look-up shapes of ICT-FaceKit turn the upper lid by 24.1 and 11.4 degrees, the lower by 8.4 and 5.9, for
eyes that turn by about 33 and 30. One iris's width is 1024, 1.1 of it the radius of the eye."""


def enliven(times_s: Array, end_s: float, phones: PhoneTrack, style: Style, rng: np.random.Generator) -> Array:
    """Add up what a style switches on."""
    own = dict(zip(GENERATORS, rng.spawn(len(GENERATORS)), strict=True))
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    if style.head_motion:
        faps += sway(times_s, end_s, own["head_motion"])
    if style.emphasis:
        faps += emphasis(times_s, end_s, [phone for phone in phones.phones if phone.stress], own["emphasis"])
    if style.idle:
        faps += idle(times_s, end_s, own["idle"])
    if style.gaze:
        faps += gaze(times_s, end_s, own["gaze"]) + countered(faps)
    if style.blinks:
        faps += blinks(times_s, end_s, own["blinks"])
    return faps


def _add(faps: Array, numbers: Iterable[int], values: Array) -> None:
    for number in numbers:
        faps[:, fap.column(number)] += values


def _edges(times_s: Array, end_s: float) -> Array:
    return smoothstep(times_s / EDGE_S) * smoothstep((end_s - times_s) / EDGE_S)


def _wander(times_s: Array, band_hz: tuple[float, float], rng: np.random.Generator) -> Array:
    """(T,) of about unit size: four sines of the band, by chance."""
    frequencies = rng.uniform(*band_hz, size=4)
    phases = rng.uniform(0, 2 * np.pi, size=4)
    wandering: Array = np.sin(2 * np.pi * frequencies * times_s[:, None] + phases).sum(axis=1) / 2
    return wandering


def blinks(times_s: Array, end_s: float, rng: np.random.Generator) -> Array:
    """Blinks of both eyes, none cut off by the end."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    shut_s = 0.6 + rng.uniform(0.0, 1.2)
    while shut_s + BLINK_SHUT_S + BLINK_OPEN_S < end_s:
        shape = bump(times_s, shut_s, shut_s + BLINK_SHUT_S, BLINK_CLOSE_S, BLINK_OPEN_S)
        _add(faps, (19, 20), UPPER_LID * shape)
        _add(faps, (21, 22), LOWER_LID * shape)
        shut_s += BLINK_INTERVAL_S[0] + rng.exponential(BLINK_INTERVAL_S[1])
    return faps


def sway(times_s: Array, end_s: float, rng: np.random.Generator) -> Array:
    """Slow turns of the head."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    for number, amplitude_rad in HEAD_AMPLITUDE_RAD.items():
        _add(faps, (number,), _edges(times_s, end_s) * amplitude_rad / AU_RAD * _wander(times_s, HEAD_BAND_HZ, rng))
    return faps


def emphasis(times_s: Array, end_s: float, stressed: Iterable[Phone], rng: np.random.Generator) -> Array:
    """Nod a little and raise the brows with each stressed phone."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    edges = _edges(times_s, end_s)
    for phone in stressed:
        strength = (1.0 if phone.stress == 1 else 0.5) * rng.uniform(0.5, 1.0)
        beat = strength * bump(times_s, phone.start_s, phone.start_s + 0.5 * phone.duration_s, 0.18, 0.3) * edges
        _add(faps, (48,), NOD_RAD * beat / AU_RAD)
        _add(faps, (31, 32, 33, 34, 35, 36), BROW_FAPU * beat)
    return faps


def idle(times_s: Array, end_s: float, rng: np.random.Generator) -> Array:
    """Breathe, and drift."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    edges = _edges(times_s, end_s)
    breath = np.sin(2 * np.pi * rng.uniform(*BREATH_HZ) * times_s + rng.uniform(0, 2 * np.pi))
    _add(faps, (48,), BREATH_RAD / AU_RAD * edges * breath)
    for numbers, size in DRIFTS_FAPU.items():
        _add(faps, numbers, size * edges * _wander(times_s, DRIFT_BAND_HZ, rng))
    return faps


def gaze(times_s: Array, end_s: float, rng: np.random.Generator) -> Array:
    """Small glances: both eyes jump from place to place and rest between, straight ahead at first and at last."""
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    place = np.zeros(2)
    jump_s = FIXATION_S[0] + rng.exponential(FIXATION_S[1])
    while place.any() or jump_s < end_s - FIXATION_S[0]:
        last = jump_s >= end_s - FIXATION_S[0]
        goal = np.zeros(2) if last else rng.normal(scale=(GLANCE_RAD, GLANCE_RAD / 2))
        jump_s = min(jump_s, end_s - SACCADE_S)
        step = smoothstep((times_s - jump_s) / SACCADE_S)
        for numbers, change in zip(((23, 24), (25, 26)), goal - place, strict=True):
            _add(faps, numbers, change / AU_RAD * step)
        place = goal
        jump_s += FIXATION_S[0] + rng.exponential(FIXATION_S[1])
    return _with_lids(faps)


def countered(head: Array) -> Array:
    """Eyes that counter the head (vestibulo-ocular reflex), so that the gaze rests where it was."""
    faps = np.zeros_like(head)
    _add(faps, (23, 24), -head[:, fap.column(49)])
    _add(faps, (25, 26), -head[:, fap.column(48)])
    return _with_lids(faps)


def _with_lids(faps: Array) -> Array:
    """Lids go with the eyes, which the standard leaves to whoever makes the FAPs."""
    for numbers, per_rad in LIDS_FOLLOW.items():
        _add(faps, numbers, per_rad * AU_RAD * faps[:, fap.column(25)])
    return faps
