"""Timing: the lag of a whole recording, and the distance in time of its single movements from the reference's.

Theory of operation
-------------------
*Lag*: the shift at which the speeds of two openings correlate best where both are known, to a fraction of a grid step
by a parabola; speeds have sharper peaks than openings. Of shifts that fit nearly as well, the smaller counts. Without a
reference, the opening that phones lead to expect is used: shut on p b m, wide on open vowels.

*Mean temporal misalignment* (MTM; Chae-Yeon et al., "Perceptually Accurate 3D Talking Head Generation", CVPR 2025,
arXiv:2503.20308): both openings are smoothed, aligned by dynamic time warping of their derivatives (Keogh and Pazzani
2001), and extrema of one kind that the alignment joins are compared. One is left out if it is beyond the reference's
neighbouring extrema. The mean of their distances in time is the measure. Theirs runs at 30 frames a second with a
smoothing of two frames; here the grid is finer, and an extremum within half of such a frame of the path counts as met.
The warp reaches :data:`REACH_S` at most, which bounds its time and memory. Extrema without a counterpart do not
count, so the fraction of those with one is given too.
"""

from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.scoring.mouth import Mouth
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone, PhoneTrack, is_bilabial, is_labiodental

GRID_HZ = 100.0
"""Rate at which times are compared."""
REACH_S = 0.5
"""Largest misalignment that is looked for."""
SMOOTHING_S = 2 / 30
"""Standard deviation: two frames of the published measure."""
MET_S = 0.02
"""Distance from the path at which an extremum still counts as met: half a frame of the published measure."""
MIN_PROMINENCE_MM = 0.1
"""Extrema that stand out by less are noise."""
LAG_SMOOTHING_S, NEARER = 0.03, 0.1
"""Smoothing of openings before their speeds are compared, and correlation that the largest shift loses. Of 130 filmed
sentences delayed by 0 and 0.2 s, 3 and 9 lags are wrong by more than 0.12 s (by openings: 9 and 26)."""
PHONE_SMOOTHING_S = 0.04
"""Smoothing of what phones lead to expect: lips that move that fast follow their phones closely."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Delay of a recording."""

    lag_ms: float | None
    """Lag of the opening, positive if it comes late; None if it does not move."""
    mtm_ms: float | None = None
    """Mean temporal misalignment; None if no extremum of the reference is met, or without a reference."""
    met: float | None = None
    """Fraction of the reference's extrema that are met."""


def timing_of_truth(mouth: Mouth, truth: Mouth) -> Timing:
    """Compare with a reference."""
    times_s = grid(min(mouth.end_s, truth.end_s), mouth.start_s)
    made, true = (np.interp(times_s, m.times_s, m.opening_mm) for m in (mouth, truth))
    mtm_ms, met = misalignment(made, true)
    return Timing(lag_ms(made, true), mtm_ms, met)


def timing_of_phones(mouth: Mouth, phones: PhoneTrack) -> Timing:
    """Compare with the opening that phones lead to expect."""
    times_s = grid(min(mouth.end_s, phones.duration_s), mouth.start_s)
    return Timing(lag_ms(np.interp(times_s, mouth.times_s, mouth.opening_mm), expected_opening(phones, times_s)))


def grid(end_s: float, start_s: float = 0.0) -> Array:
    """Return the multiples of a step of :data:`GRID_HZ` from a start to an end, (T,) s; none if the end comes first."""
    return np.arange(int(np.ceil(start_s * GRID_HZ - 1e-6)), int(end_s * GRID_HZ) + 1) / GRID_HZ


def expected_opening(phones: PhoneTrack, times_s: Array) -> Array:
    """(T,): how far phones open a mouth, 0 shut to 1 wide, smoothed as lips are."""
    starts = np.array([phone.start_s for phone in phones.phones])
    level = np.array([_opens(phone) for phone in phones.phones])
    if not len(starts):
        return np.zeros(len(times_s))
    row = np.clip(np.searchsorted(starts, times_s, side="right") - 1, 0, len(starts) - 1)
    return smoothed(level[row], PHONE_SMOOTHING_S)


def smoothed(values: Array, sd_s: float) -> Array:
    """Smooth values, (T,) at :data:`GRID_HZ`, by a Gaussian with a standard deviation in s."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, sd_s * GRID_HZ))


def _opens(phone: Phone) -> float:
    letters = ipa.letters(phone.label)
    if phone.is_silence or not letters or is_bilabial(phone):
        return 0.0
    if is_labiodental(phone):
        return 0.1
    return float(np.mean([0.35 + (0.65 * ipa.SOUNDS[x].opening if ipa.SOUNDS[x].vowel else 0.0) for x in letters]))


def lag_ms(made: Array, true: Array) -> float | None:
    """Shift of ``made`` against ``true``, both (T,) at :data:`GRID_HZ`, ms; None if either does not move."""
    reach = min(int(REACH_S * GRID_HZ), len(made) // 2)
    if reach < 1 or np.ptp(made) < MIN_PROMINENCE_MM or np.ptp(true) < 1e-6:
        return None
    a, b = (np.gradient(smoothed(each, LAG_SMOOTHING_S)) for each in (made, true))
    score = np.full(2 * reach + 1, -1.0)
    for place, shift in enumerate(range(-reach, reach + 1)):
        one, other = a[max(shift, 0) : len(a) + min(shift, 0)], b[max(-shift, 0) : len(b) - max(shift, 0)]
        if np.ptp(one) > 0 and np.ptp(other) > 0:
            score[place] = np.corrcoef(one, other)[0, 1] - NEARER * abs(shift) / (REACH_S * GRID_HZ)
    best = int(np.clip(score.argmax(), 1, len(score) - 2))
    before, at, after = score[best - 1 : best + 2]
    bend = before - 2 * at + after
    part = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(1000 * (best - reach + np.clip(part, -0.5, 0.5)) / GRID_HZ)


def misalignment(made: Array, true: Array) -> tuple[float | None, float | None]:
    """Mean temporal misalignment in ms of openings, (T,) mm at :data:`GRID_HZ`, and the fraction of extrema met."""
    from scipy.signal import find_peaks

    if len(made) < 2:
        return None, None
    made, true = (smoothed(each, SMOOTHING_S) for each in (made, true))
    first, last = warp(np.gradient(true), np.gradient(made), int(REACH_S * GRID_HZ))
    extrema = {sign: find_peaks(sign * true, prominence=MIN_PROMINENCE_MM)[0] for sign in (1, -1)}
    every = np.unique(np.concatenate([*extrema.values()]))
    if not len(every):
        return None, None
    found: list[int] = []
    for sign, places in extrema.items():
        answers = find_peaks(sign * made, prominence=MIN_PROMINENCE_MM)[0]
        for place in places:
            position = int(np.searchsorted(every, place))
            left = every[position - 1] if position else 0
            right = every[position + 1] if position + 1 < len(every) else len(true) - 1
            apart = np.maximum(np.maximum(first[place] - answers, answers - last[place]), 0)
            if len(answers) and apart.min() <= MET_S * GRID_HZ:
                answer = int(answers[apart.argmin()])
                if left <= answer <= right:
                    found.append(abs(answer - int(place)))
    return (float(1000 * np.mean(found) / GRID_HZ) if found else None), len(found) / len(every)


def warp(one: Array, other: Array, reach: int) -> tuple[Indices, Indices]:
    """Align two sequences of equal length by dynamic time warping.

    Parameters
    ----------
    one, other : (T,) float64
    reach : int
        Largest distance of aligned samples.

    Returns
    -------
    first, last : (T,) int64
        Sample ``n`` of ``one`` is aligned with ``first[n]`` to ``last[n]`` of ``other``.

    Notes
    -----
    Diagonal by diagonal, so that each is one array operation; a cell's cost is kept under the index of ``one`` plus 1.
    """
    count = len(one)
    before, last_but_one, now = (np.full(count + 2, np.inf) for _ in range(3))
    steps = np.zeros((2 * count - 1, reach + 1), np.int8)
    lows = np.zeros(2 * count - 1, np.int64)
    for diagonal in range(2 * count - 1):
        low = max(0, diagonal - count + 1, (diagonal - reach + 1) // 2)
        high = min(count - 1, diagonal, (diagonal + reach) // 2)
        cost = np.abs(one[low : high + 1] - other[diagonal - high : diagonal - low + 1][::-1])
        ways = np.stack([last_but_one[low : high + 1], before[low : high + 1], before[low + 1 : high + 2]])
        step = ways.argmin(axis=0)
        now[low + 1 : high + 2] = cost + (ways.min(axis=0) if diagonal else 0.0)
        now[low], now[high + 2 : high + 3] = np.inf, np.inf
        lows[diagonal], steps[diagonal, : high - low + 1] = low, step
        last_but_one, before, now = before, now, last_but_one
    first, last = np.zeros(count, np.int64), np.zeros(count, np.int64)
    last[count - 1] = here = there = count - 1
    while True:
        first[here] = there
        if not here and not there:
            return first, last
        step_taken = steps[here + there, here - lows[here + there]]
        here, there = here - (step_taken != 2), there - (step_taken != 1)
        last[here] = max(last[here], there)
