"""Keyframes of a phone track in viseme space, and the path through them: paper 001, section 5.1.

Theory of operation
-------------------
Each phone brings the keyframes that :mod:`.targets` found for it. Silence is the rest face, the origin of the space: a
long pause holds it, a short one only passes through it, and one of under a tenth of a second is no pause to the face. A
C2 path runs through all keyframes (:mod:`.hermite`, or the paper's cubic spline); it starts and ends at rest with zero
slope.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.targets import Resolved

REST_MARGIN_S = 0.12
"""Time to leave rest before speech, and to reach it behind. Articulators start about 120 ms before the sound (JALI,
Edwards et al. 2016)."""
MIN_PAUSE_S = 0.1
"""Least length of a pause that passes through rest."""
HELD_PAUSE_S = 0.3
"""Least length of a pause that holds rest, between two keyframes; a shorter one has one keyframe, in its middle."""
CLOSEST_KEYS_S = 0.012
"""Nearer keyframes would make the spline swing; the later one gives way."""


@dataclass(frozen=True, slots=True, eq=False)
class Keyframes:
    """Times and points of a path in the space."""

    times_s: NDArray[np.float64]
    """(N,), strictly rising."""
    weights: NDArray[np.float64]
    """(N, K)."""

    def sample(self, times_s: ArrayLike, *, cubic: bool = False) -> NDArray[np.float64]:
        """(T, K): the path at ``times_s``; rest before the first and behind the last keyframe.

        ``cubic`` takes the paper's spline, clamped to rest at both ends, in place of the quintic path.
        """
        t = np.asarray(times_s, dtype=np.float64)
        if len(self.times_s) < 2:
            return np.zeros((len(t), self.weights.shape[1]))
        if not cubic:
            return hermite.sample(self.times_s, self.weights, t)
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.times_s, self.weights, bc_type="clamped")
        path: NDArray[np.float64] = spline(np.clip(t, self.times_s[0], self.times_s[-1]))
        return path

    def jet(self, times_s: ArrayLike) -> hermite.Jet:
        """Value, velocity and acceleration of the path, (T, K) each."""
        t = np.asarray(times_s, dtype=np.float64)
        if len(self.times_s) < 2:
            still = np.zeros((len(t), self.weights.shape[1]))
            return still, still, still
        return hermite.jet(self.times_s, self.weights, t)


def place_keyframes(track: PhoneTrack, resolved: list[Resolved], mode_count: int) -> Keyframes:
    """Put keyframes of phones and pauses in order, between rest and rest; see the theory of operation."""
    if not resolved:
        return Keyframes(np.zeros(0), np.zeros((0, mode_count)))
    times = [time for phone in resolved for time in phone.times_s]
    first_s, last_s = resolved[0].phone.start_s, resolved[-1].phone.end_s
    rests: list[float] = []
    for phone in track.phones:
        if phone.is_silence and first_s < phone.start_s < last_s and phone.duration_s >= MIN_PAUSE_S:
            held = phone.duration_s >= HELD_PAUSE_S
            edges = (phone.start_s + REST_MARGIN_S, phone.end_s - REST_MARGIN_S)
            rests += edges if held else [(phone.start_s + phone.end_s) / 2]
    rests += [max(first_s - REST_MARGIN_S, 0.0), last_s + REST_MARGIN_S]
    at = np.array(times + rests)
    order = np.argsort(at, kind="stable")
    if np.diff(at[order]).min() < CLOSEST_KEYS_S:
        order = order[spaced(at[order].tolist())]
    weights = np.concatenate([*(phone.targets for phone in resolved), np.zeros((len(rests), mode_count))])
    return Keyframes(at[order], weights[order])


def spaced(times_s: Sequence[float]) -> list[int]:
    """Choose the keys that stand far enough apart; the first and the last stay."""
    kept, last = [0], len(times_s) - 1
    for index in range(1, last):
        if times_s[kept[-1]] + CLOSEST_KEYS_S <= times_s[index] <= times_s[last] - CLOSEST_KEYS_S:
            kept.append(index)
    return [*kept, last]
