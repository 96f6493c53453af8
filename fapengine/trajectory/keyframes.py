"""Keyframes of a phone track in viseme space, and the spline through them: paper 001, section 5.1.

Theory of operation
-------------------
Each phone puts one keyframe at 30 % of its duration (a diphthong or affricate two, where its profile says); with a
context model two, at 20 and 70 % (:mod:`fapengine.trajectory.context`).
Silence is the rest face, the origin of the space: a long pause holds it, a short one only passes through it, and one of
under a tenth of a second is no pause to the face. A C2 path runs through all keyframes (:mod:`.hermite`, or the paper's
cubic spline); it starts and ends at rest with zero slope.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from fapengine.profiles import ContextModel, Profile
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.context import Token, targets, tokens_of

REST_MARGIN_S = 0.12
"""Before and behind speech: time to leave and to reach rest. Articulators start about 120 ms before the sound (JALI,
Edwards et al. 2016)."""
SHORTEST_PAUSE_S = 0.1
HELD_PAUSE_S = 0.3
"""From this length on a pause holds rest between two keyframes."""
NEAR_OPEN = 0.85
"""Opening (:class:`fapengine.speech.ipa.Sound`) of æ and ɐ; a, ɑ and ɒ have 1."""
APART_S = 0.03
"""A phone too short for its keyframes to stand so far apart has one, their mean: fast speech undershoots. It costs
0.003 mm of lip error at natural rate and takes a third of the highest velocity away."""
CLOSEST_KEYS_S = 0.012
"""Nearer keyframes would make the spline swing; the later one gives way."""


Keys = tuple[tuple[float, ...], NDArray[np.float64]]
"""Times in s, and targets (keyframes, K)."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """A phone with its targets: from the profile, or from what looks most like it."""

    phone: Phone
    times_s: tuple[float, ...]
    targets: NDArray[np.float64]
    """(keyframes, K)."""
    contact: str
    """``none``, ``lips``, ``teeth``, or ``open`` for a vowel that must open."""


def resolve(track: PhoneTrack, profile: Profile, *, context: bool = True) -> tuple[list[Resolved], Counter[str]]:
    """Find every phone's targets.

    A label that the profile lacks is taken apart into IPA letters, each replaced by the letter of the profile that
    looks most like it. A label that is no IPA counts as unknown; the neutral vowel stands in.

    Parameters
    ----------
    track : PhoneTrack
    profile : Profile
    context : bool
        Let the profile's context model say what a phone looks like, if it has one; otherwise one look for each phone.

    Returns
    -------
    resolved : list of Resolved
        Silences are left out.
    unknown : Counter of str
        Labels that are no IPA, with how often they came.
    """
    tokens, strange = tokens_of(track, profile.phones)
    model = profile.context if context else None
    keys = _own_keys(tokens, profile) if model is None else _keys_in_context(tokens, model)
    resolved: list[Resolved] = []
    for _, together in groupby(zip(tokens, keys, strict=True), key=lambda entry: id(entry[0].phone)):
        parts = list(together)
        phone = parts[0][0].phone
        if phone.is_silence:
            continue
        contact, opens = "none", False
        for token, _ in parts:
            contact = profile.phones[token.name].contact if contact == "none" else contact
            opens = opens or _opens(token.heard)
        if contact == "none" and opens:
            contact = "open"
        times_s, looks = parts[0][1] if len(parts) == 1 else _joined([key for _, key in parts])
        resolved.append(Resolved(phone, times_s, looks, contact))
    return resolved, Counter(strange)


def _own_keys(tokens: Sequence[Token], profile: Profile) -> list[Keys]:
    """Give each token the keyframes that the profile has for its phone."""
    keys: list[Keys] = []
    for token in tokens:
        if token.name == SILENCE:
            keys.append(((), np.zeros((0, profile.space.mode_count))))
            continue
        own, length_s = profile.phones[token.name], token.end_s - token.start_s
        keys.append((tuple(token.start_s + length_s * fraction for fraction in own.fractions), own.targets))
    return keys


def _keys_in_context(tokens: Sequence[Token], model: ContextModel) -> list[Keys]:
    """Give each token the keyframes that it has between its neighbours; one where there is no room for more."""
    looks, fractions = targets(tokens, model), model.fractions
    starts = np.array([token.start_s for token in tokens])
    lengths = np.array([token.end_s for token in tokens]) - starts
    crowded = lengths * (fractions[-1] - fractions[0]) < APART_S * (len(fractions) - 1)
    times = (starts[:, None] + lengths[:, None] * np.array(fractions)).tolist()
    middles, means = (starts + lengths * (sum(fractions) / len(fractions))).tolist(), looks.mean(axis=1, keepdims=True)
    return [
        ((middles[n],), means[n]) if alone else (tuple(times[n]), looks[n]) for n, alone in enumerate(crowded.tolist())
    ]


def _joined(keys: Sequence[Keys]) -> Keys:
    return tuple(time for times, _ in keys for time in times), np.concatenate([looks for _, looks in keys])


@cache
def _opens(heard: tuple[str, ...]) -> bool:
    return any(map(must_open, heard))


@cache
def must_open(letter: str) -> bool:
    """Whether this IPA letter is a vowel that cannot be said with the mouth nearly shut: open or near-open."""
    sound = ipa.SOUNDS.get(letter)
    return sound is not None and sound.vowel and sound.opening >= NEAR_OPEN


def place_keyframes(track: PhoneTrack, resolved: list[Resolved], mode_count: int, end_s: float) -> Keyframes:
    """Put keyframes of phones and pauses in order, rest at 0 s and at ``end_s``; see the theory of operation."""
    if not resolved:
        return Keyframes(np.zeros(0), np.zeros((0, mode_count)))
    times = [time for one in resolved for time in one.times_s]
    first_s, last_s = resolved[0].phone.start_s, resolved[-1].phone.end_s
    rests: list[float] = []
    for phone in track.phones:
        if phone.is_silence and first_s < phone.start_s < last_s and phone.duration_s >= SHORTEST_PAUSE_S:
            held = phone.duration_s >= HELD_PAUSE_S
            edges = (phone.start_s + REST_MARGIN_S, phone.end_s - REST_MARGIN_S)
            rests += edges if held else [(phone.start_s + phone.end_s) / 2]
    rests += [max(first_s - REST_MARGIN_S, 0.0), min(last_s + REST_MARGIN_S, end_s)]
    at = np.array(times + rests)
    order = np.argsort(at, kind="stable")
    if np.diff(at[order]).min() < CLOSEST_KEYS_S:
        order = order[_spaced(at[order].tolist())]
    weights = np.concatenate([*(one.targets for one in resolved), np.zeros((len(rests), mode_count))])
    return Keyframes(at[order], weights[order])


def _spaced(times_s: Sequence[float]) -> list[int]:
    """Choose the keys that stand far enough apart; the first and the last stay."""
    kept, last = [0], len(times_s) - 1
    for index in range(1, last):
        if times_s[kept[-1]] + CLOSEST_KEYS_S <= times_s[index] <= times_s[last] - CLOSEST_KEYS_S:
            kept.append(index)
    return [*kept, last]
