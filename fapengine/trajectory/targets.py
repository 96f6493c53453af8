"""Targets: the point of the viseme space that each phone pulls the face to, and its keyframes; paper 001, section 5.1.

Theory of operation
-------------------
A phone has one keyframe at 30 % of its duration (a diphthong or affricate two, where its profile says so); with a
context model two, at 20 and 70 % (:mod:`.context`). A label that the profile lacks is split into IPA letters, each of
which takes the targets of the most similar letter.

Silence is the rest face, the origin of the space: a long pause holds it, a short one only passes through it, and one of
under a tenth of a second is ignored. A C2 path runs through all keyframes (:mod:`.hermite`, or the paper's cubic
spline); it starts and ends at rest with zero slope.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.profiles import ContextModel, Profile
from fapengine.speech import ipa
from fapengine.speech.articulation import SIBILANTS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.context import SpelledPart, Token, heard_as_here, targets, tokens_of
from fapengine.trajectory.style import DB_PER_DOUBLE_DROP, jaw_share

NEAR_OPEN = 0.85
"""Opening (:class:`fapengine.speech.ipa.Sound`) of æ and ɐ; a, ɑ and ɒ have 1."""
INTERDENTAL = "θð"
"""The tongue is seen between the teeth."""
APART_S = 0.03
"""A phone too short for its keyframes to stand so far apart has one, their mean: fast speech undershoots. It costs
0.003 mm of lip error at natural rate and takes a third of the highest velocity away."""

GAP_S = 0.005
"""Longest gap between two phones that is ignored: the later phone begins earlier by it."""

Keys = tuple[tuple[float, ...], NDArray[np.float64]]
"""Times in s, and targets (keyframes, K)."""


@dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """A phone with its targets: from the profile, or from the phone most like it."""

    phone: Phone
    times_s: tuple[float, ...]
    targets: NDArray[np.float64]
    """(keyframes, K)."""
    contact: str
    """``none``, ``lips``, ``teeth``, ``open`` for a vowel that must open and for θ ð, ``jaw`` where it must be high."""
    heard: bool = False
    """True where the context knows it between the same two neighbours."""


def joined_track(phones: Iterable[Phone]) -> PhoneTrack:
    """Make the track that is planned: of all phones, in time order, those that are spoken, and pauses between them.

    A stream keeps no silences and a file may have any number of them in a row; of this track both make the same motion.
    """
    return PhoneTrack.of([phone for phone in phones if not phone.is_silence], tolerance_s=GAP_S)


def resolve(track: PhoneTrack, profile: Profile, *, context: bool = True) -> tuple[list[Resolved], Counter[str]]:
    """Find every phone's targets.

    A label that is not IPA counts as unknown; the neutral vowel replaces it.

    Parameters
    ----------
    context : bool
        Let the profile's context model find targets, if it has one; otherwise a phone's are always the same.

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
    heard = [False] * len(tokens) if model is None else heard_as_here(tokens, model)
    resolved: list[Resolved] = []
    for _, together in groupby(zip(tokens, keys, heard, strict=True), key=lambda entry: id(entry[0].phone)):
        parts = list(together)
        phone = parts[0][0].phone
        if phone.is_silence:
            continue
        contact = contact_of([(token.name, token.heard) for token, _, _ in parts], profile)
        times_s, weights = parts[0][1] if len(parts) == 1 else _joined([key for _, key, _ in parts])
        if phone.loudness_db:
            weights = louder(weights, phone.loudness_db, profile)
        resolved.append(Resolved(phone, times_s, weights, contact, heard=len(parts) == 1 and parts[0][2]))
    return resolved, Counter(strange)


def contact_of(parts: Sequence[SpelledPart], profile: Profile) -> str:
    """Find the contact of a phone, as of :class:`Resolved`, from its parts' names and letters."""
    contacts = (profile.phones[name].contact for name, _ in parts)
    contact = next((each for each in contacts if each != "none"), "none")
    if contact != "none":
        return contact
    if any(_opens(heard) for _, heard in parts):
        return "open"
    return "none" if all(SIBILANTS.isdisjoint(heard) for _, heard in parts) else "jaw"


def _own_keys(tokens: Sequence[Token], profile: Profile) -> list[Keys]:
    """Give each token the keyframes that the profile has for its phone."""
    keys: list[Keys] = []
    for token in tokens:
        if token.name == SILENCE:
            keys.append(((), np.zeros((0, profile.space.mode_count))))
            continue
        phone, length_s = profile.phones[token.name], token.end_s - token.start_s
        keys.append((tuple(token.start_s + length_s * fraction for fraction in phone.fractions), phone.targets))
    return keys


def _keys_in_context(tokens: Sequence[Token], model: ContextModel) -> list[Keys]:
    """Keyframes of each token between its neighbours; one where there is no room for more."""
    weights, fractions = targets(tokens, model), model.fractions
    starts = np.array([token.start_s for token in tokens])
    lengths = np.array([token.end_s for token in tokens]) - starts
    crowded = lengths * (fractions[-1] - fractions[0]) < APART_S * (len(fractions) - 1)
    times = (starts[:, None] + lengths[:, None] * np.array(fractions)).tolist()
    middles = (starts + lengths * (sum(fractions) / len(fractions))).tolist()
    means = weights.mean(axis=1, keepdims=True)
    return [
        ((middles[n],), means[n]) if is_crowded else (tuple(times[n]), weights[n])
        for n, is_crowded in enumerate(crowded.tolist())
    ]


def _joined(keys: Sequence[Keys]) -> Keys:
    return tuple(time for times, _ in keys for time in times), np.concatenate([weights for _, weights in keys])


def louder(targets: NDArray[np.float64], loudness_db: float, profile: Profile) -> NDArray[np.float64]:
    """Targets, (..., K), said louder or more quietly: the jaw's part of them grows, as with a style."""
    said: NDArray[np.float64] = targets + (loudness_gain(loudness_db) - 1.0) * (targets @ jaws_of(profile))
    return said


def loudness_gain(loudness_db: float) -> float:
    """Size of the jaw's part of a phone by its loudness, dB against the usual."""
    return float(2.0 ** (loudness_db / DB_PER_DOUBLE_DROP))


@lru_cache(maxsize=16)
def jaws_of(profile: Profile) -> NDArray[np.float64]:
    """(K, K): from weights to those of the jaw's part of them."""
    return jaw_share(profile)


@cache
def _opens(heard: tuple[str, ...]) -> bool:
    return any(map(must_open, heard))


@cache
def must_open(letter: str) -> bool:
    """Whether this IPA letter cannot be said with the mouth nearly shut: open and near-open vowels, θ and ð."""
    if letter in INTERDENTAL:
        return True
    sound = ipa.SOUNDS.get(letter)
    return sound is not None and sound.vowel and sound.opening >= NEAR_OPEN


REST_MARGIN_S = 0.12
"""Time to leave rest before speech, and to reach it afterwards. Articulators start about 120 ms before the sound (JALI,
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
        """(T, K): the path at ``times_s``; rest before the first and after the last keyframe.

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
