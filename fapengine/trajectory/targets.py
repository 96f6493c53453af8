"""Keyframes: when phones pull the face to which points of the viseme space; paper 001, section 5.1.

Theory of operation
-------------------
A phone has one keyframe at 30 % of its duration (a diphthong or affricate two, where its profile says so); with a
context model two, at 20 and 70 % (:mod:`.context`). A label that the profile lacks is split into IPA characters, each
of which gets the targets of the most similar one. After the weights of the space a target has the values of the
phonetic layer (:mod:`.phonetics`).

By the method ``context`` a phone that is longer than any that was recorded has its keyframes as far from its two ends
as the longest one, and others between them: it is reached in time, held, and left in time. A face that holds a vowel
drifts a little and breathes, so there a target sways (:func:`sway_of`).

Silence is the neutral face, the origin of the space: a long pause holds it, a short one only passes through it, and one
of under a tenth of a second is ignored. After a long one, and by the method ``context``, lips prepare: they have the
shape of the first phone before it is heard (:data:`LEAD_S`), as captured ones do. A C2 path runs through all keyframes
(:mod:`.hermite`, or another of :mod:`.methods`); it starts and ends neutral, with zero slope.

There is one implementation for files and streams. NumPy's calls cost more than its arithmetic, and a stream plans a
dozen phones whenever one comes. So the phones of all tracks are laid in one row, far enough apart that no feature
reaches across, and each step is one call for all of them. What is known of a label is looked up, not computed again.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.geometry.smooth import smoothstep
from fapengine.profiles import Profile
from fapengine.speech import ipa
from fapengine.speech.articulation import SIBILANTS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory import hermite, phonetics
from fapengine.trajectory.context import (
    LABELS,
    MAX_DURATION_S,
    PAUSE_S,
    REACH,
    SpelledPart,
    names_vowels,
    spelled,
    tables_of,
)
from fapengine.trajectory.style import DB_PER_DOUBLE_DROP, DB_PER_DOUBLE_LIPS, jaw_share

Indices = NDArray[np.intp]

NEAR_OPEN = 0.85
"""Opening (:class:`fapengine.speech.ipa.Sound`) of æ and ɐ; a, ɑ and ɒ have 1."""
INTERDENTAL = "θð"
"""The tongue is seen between the teeth."""
GLIDES = frozenset("wʍɥ")
"""Their lips nearly touch."""
APART_S = 0.03
"""Least distance of a phone's keyframes; a phone too short for it has one, their mean: fast speech undershoots. It
costs 0.003 mm of lip error at natural rate and takes a third of the highest velocity away."""
GAP_S = 0.005
"""Longest gap between two phones that is ignored: the later phone begins earlier by it."""
REST_MARGIN_S = 0.12
"""Time to reach the neutral face after speech."""
LEAD_S = 0.24
"""Time to leave it before speech; halfway the lips have the shape of the first phone. In the 0.4 s before speech this
takes a fifth of the lips' error away (``design/tried.md``). Less than the delay of live sound, so that it is shown."""
MIN_PAUSE_S = 0.1
"""Least length of a pause that passes through the neutral face."""
HELD_PAUSE_S = REST_MARGIN_S + LEAD_S
"""Least length of a pause that holds it, between two keyframes; a shorter one has one keyframe, in its middle."""
CLOSEST_KEYS_S = 0.012
"""Nearer keyframes would make the spline swing; the later one is dropped."""
HELD_STEP_S = 0.4
"""Least distance of the keyframes that hold a long phone."""
MAX_HELD = 64
"""Greatest number of them; those of longer phones are farther apart."""
SWAY_FROM_S, SWAY_RISE_S = 0.3, 0.5
"""Distance from both ends of a phone at which its sway begins, and over which it grows."""
JAW_SWAY = (0.05, 5.3), (0.03, 1.9)
LIPS_SWAY = (0.04, 4.1), (0.02, 1.6)
"""Share of a target and period, s, of a drift and of breath: our choice, slow enough for :data:`HELD_STEP_S`. Phones of
more than 0.35 s were not recorded. An ɑ of 3 s goes to and fro by 1 mm."""


class Keyframes(NamedTuple):
    """Times and points of the paths of any number of tracks, by track and time."""

    times_s: Array
    """(N,), strictly rising in each track."""
    weights: Array
    """(N, K + axes)."""
    track_of: Indices
    """(N,)."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeechKeys:
    """Keys of the phones of any number of tracks, and of the silences between them."""

    said: list[list[tuple[Phone, str]]]
    """Spoken phones of each track that have keys, with their contacts (:func:`contact_of`)."""
    phone_of: Indices
    """(N,): phone of each key, counted through all tracks."""
    times_s: Array
    """(N,)."""
    targets: Array
    """(N, K + axes): weights of the space, then the axes of :mod:`.phonetics`."""
    rests: list[tuple[int, float]]
    """Track and time of each key at the neutral face."""
    unknown: Counter[str]
    """Labels that are not IPA, with counts; the neutral vowel replaces them."""

    def keyframes(self) -> Keyframes:
        """Put the keys of all tracks in order, with those of silences; keys that are too near are left out."""
        tracks = np.repeat(np.arange(len(self.said)), [len(phones) for phones in self.said])
        rests = np.array(self.rests).reshape(-1, 2)
        times_s = np.concatenate([self.times_s, rests[:, 1]])
        track_of = np.concatenate([tracks[self.phone_of], rests[:, 0].astype(np.intp)])
        weights = np.concatenate([self.targets, np.zeros((len(rests), self.targets.shape[1]))])
        order = np.lexsort((times_s, track_of))
        order = order[_apart(times_s[order], track_of[order])]
        return Keyframes(times_s[order], weights[order], track_of[order])

    def paths(self) -> list[hermite.Path]:
        """Lay the path of each track through its keys."""
        return hermite.paths(*self.keyframes(), len(self.said))


def keys_of(track: PhoneTrack, profile: Profile, *, context: bool = True) -> SpeechKeys:
    """Find the keys of one track; see :func:`speech_keys`. Pauses between spoken phones make its silences."""
    return speech_keys([([phone for phone in track.phones if not phone.is_silence], 0)], profile, context=context)


def weights_of(track: PhoneTrack, profile: Profile, times_s: Array, *, context: bool = True) -> Array:
    """(T, K): weights of the space along the path of one track, without the phonetic layer."""
    path = keys_of(track, profile, context=context).paths()[0]
    return path.sample(times_s)[:, : profile.space.mode_count]


def speech_keys(tracks: Sequence[tuple[Sequence[Phone], int]], profile: Profile, *, context: bool = True) -> SpeechKeys:
    """Find the keys of many tracks at once.

    Parameters
    ----------
    tracks : sequence of (phone list, int)
        Phones in time order, without silences; and the index of the first one that gets keys.
    profile : Profile
    context : bool
        Whether the profile's context model finds targets, if it has one; otherwise a phone's are always the same.
    """
    labels, row = _labels(profile, context), _Row(LEAD_S if context else REST_MARGIN_S)
    for number, (phones, first_own) in enumerate(tracks):
        row.add(number, phones, first_own, labels)
    numbers = np.array(row.numbers).reshape(-1, 7)
    start_s, end_s = numbers[:, 5], numbers[:, 6]
    own, place, parts, first, count = numbers[:, :5].T.astype(np.intp)
    phone = np.repeat(np.arange(len(numbers)), parts)
    index = np.arange(len(phone)) - (np.cumsum(parts) - parts)[phone]
    places, length_s = place[phone] + index, ((end_s - start_s) / parts)[phone]
    lengths_s = np.full(len(row.kinds), PAUSE_S)
    lengths_s[places] = length_s
    wanted = (own[phone] >= 0).nonzero()[0]
    kinds, phone, length_s = np.array(row.kinds, np.intp), phone[wanted], length_s[wanted]
    token, fractions, weights, heard = labels.targets(kinds, lengths_s, places[wanted])
    ages_s = length_s[token] * fractions
    if context and (length_s > MAX_DURATION_S).any():
        token, fractions, weights, ages_s = _keys_of_long(token, fractions, weights, length_s, (count > parts)[phone])
    times_s = (start_s[phone] + index[wanted] * length_s)[token] + ages_s
    jaws, lips = np.ones((2, len(token)))
    if row.loud:
        loudness_db = np.zeros(len(numbers))
        loudness_db[[number for number, _ in row.loud]] = [loudness for _, loudness in row.loud]
        lips = 2.0 ** (loudness_db[phone[token]] / DB_PER_DOUBLE_LIPS)
        jaws = 2.0 ** (loudness_db[phone[token]] / DB_PER_DOUBLE_DROP) / lips
    inside_s = np.minimum(ages_s, length_s[token] - ages_s)
    swaying = (inside_s > SWAY_FROM_S).nonzero()[0] if context else np.zeros(0, np.intp)
    if len(swaying):
        sways_s, shares = times_s[swaying], smoothstep((inside_s[swaying] - SWAY_FROM_S) / SWAY_RISE_S)
        jaws[swaying] *= 1.0 + shares * sway_of(JAW_SWAY, sways_s)
    changed = (jaws != 1.0).nonzero()[0]
    if len(changed):
        weights[changed] += (jaws[changed] - 1.0)[:, None] * (weights[changed] @ jaw_share(profile))
        weights[changed] *= lips[changed, None]
    whole_s = (end_s - start_s)[phone]
    long_s = np.where(heard & (parts[phone] == 1), 0.0, whole_s)[token]
    passed = np.floor((index[wanted][token] + fractions) * (count / parts)[phone][token]).astype(np.intp)
    phone = phone[token]
    letters, at = np.array(row.letters), first[phone] + np.minimum(passed, count[phone] - 1)
    layer = phonetics.in_context(letters, at, phonetics.values_of(profile))
    phonetics.hold_long(layer, letters[at], long_s)
    if row.loud:
        layer *= phonetics.layer_gain(lips)[:, None]
    targets = np.concatenate([weights, layer], axis=1)
    if len(swaying):
        targets[swaying] *= (1.0 + shares * sway_of(LIPS_SWAY, sways_s))[:, None]
    phone_of = own[phone]
    if context and row.prepared:
        awaited, early_s = zip(*row.prepared, strict=True)
        every = np.append(np.arange(len(phone_of)), np.searchsorted(phone_of, awaited))
        phone_of, targets, times_s = phone_of[every], targets[every], np.append(times_s, early_s)
    return SpeechKeys(row.said, phone_of, times_s, targets, row.rests, row.unknown)


def sway_of(waves: Iterable[tuple[float, float]], times_s: Array) -> Array:
    """(N,): sum of slow waves, shares and periods in s, at times of a track, so that stream and file sway alike."""
    waving = [share * np.sin(2.0 * np.pi / period_s * times_s) for share, period_s in waves]
    return np.asarray(np.sum(waving, axis=0))


def _keys_of_long(
    token: Indices, fractions: Array, weights: Array, length_s: Array, glides: NDArray[np.bool_]
) -> tuple[Indices, Array, Array, Array]:
    """Move the keys of long parts towards both ends, and put others between them.

    Parameters
    ----------
    token, fractions, weights : (N,), (N,), (N, K)
        Keys, by part, as :meth:`_Labels.targets` finds them.
    length_s, glides : (P,)
        Length of each part, and whether it is a diphthong: its first sound is held. Others are held between how they
        begin and how they end.

    Returns
    -------
    (N + M,) int, (N + M,), (N + M, K), (N + M,) s
        ``token``, ``fractions`` (of a held key that of what is held), ``weights``, and times since the part's begin.
    """
    more_s = np.maximum(length_s - MAX_DURATION_S, 0.0)
    ages_s = (length_s - more_s)[token] * fractions + more_s[token] * (fractions >= 0.5)
    every = np.arange(len(length_s))
    first, last = np.searchsorted(token, every), np.searchsorted(token, every, "right") - 1
    is_alone = (first == last) & (more_s > 0)  # a single key is held until it is as far from the end
    between_s = np.where(is_alone, more_s, ages_s[last] - ages_s[first])
    counts = np.clip(between_s / HELD_STEP_S, is_alone, MAX_HELD).astype(np.intp)
    part = np.repeat(every, counts)
    steps = (np.arange(len(part)) - (np.cumsum(counts) - counts)[part] + 1) / (counts + ~is_alone)[part]
    begin, end = first[part], np.where(glides, first, last)[part]
    token = np.concatenate([token, part])
    fractions = np.concatenate([fractions, (fractions[begin] + fractions[end]) / 2])
    weights = np.concatenate([weights, (weights[begin] + weights[end]) / 2])
    ages_s = np.concatenate([ages_s, ages_s[begin] + steps * between_s[part]])
    order = np.lexsort((ages_s, token))
    return token[order], fractions[order], weights[order], ages_s[order]


class _Spelled(NamedTuple):
    """A label without a time."""

    kinds: tuple[int, ...]
    """Kinds of its parts: in the context model's tables, or the profile's phones."""
    letters: tuple[int, ...]
    """Its characters, in the table of articulation."""
    contact: str
    is_unknown: bool


@dataclass(slots=True)
class _Row:
    """Phones of all tracks in one row. Stateful: it grows phone by phone."""

    lead_s: float
    """Time to leave the neutral face before speech."""
    kinds: list[int] = field(default_factory=list)
    """Kind of every part, and of the silences between them."""
    letters: list[int] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    """Seven numbers for each phone: its number among those with keys, or -1; places and counts of its parts in
    ``kinds`` and of its characters in ``letters``; start and end."""
    loud: list[tuple[int, float]] = field(default_factory=list)
    """Phones that are louder or quieter than usual, and by how much, dB."""
    rests: list[tuple[int, float]] = field(default_factory=list)
    prepared: list[tuple[int, float]] = field(default_factory=list)
    """Phones with keys that lips prepare for, by number among those, and when they are ready, s."""
    said: list[list[tuple[Phone, str]]] = field(default_factory=list)
    unknown: Counter[str] = field(default_factory=Counter)
    own_count: int = 0

    def add(self, track: int, phones: Sequence[Phone], first_own: int, labels: "_Labels") -> None:
        """Append a track; phones before ``first_own`` get no keys."""
        kinds, letters, numbers = self.kinds, self.letters, self.numbers
        kinds += (labels.silence,) * REACH
        letters += phonetics.NOTHING_BESIDE
        said: list[tuple[Phone, str]] = []
        now_s, spoken_s, first_s = 0.0, -np.inf, 0.0
        for number, phone in enumerate(phones):
            start_s, end_s = phone.start_s, phone.end_s
            lead_s = (
                min(self.lead_s, start_s) if start_s - now_s >= (HELD_PAUSE_S if number else REST_MARGIN_S) else 0.0
            )
            if start_s > now_s + GAP_S:
                kinds.append(labels.silence)
                if number > first_own and start_s - now_s >= MIN_PAUSE_S:
                    self._rest(track, now_s, start_s)
            elif start_s < now_s - GAP_S:
                raise UsageError(f"phone {phone.label!r}: starts at {start_s} s, but the one before ends at {now_s} s")
            elif end_s <= now_s:
                continue
            elif start_s != now_s:
                phone, start_s = replace(phone, start_s=now_s), now_s
            parts, signs, contact, is_unknown = labels.spelled_of(phone.label, names_vowels(phone))
            if start_s - spoken_s > phonetics.PAUSE_S:
                letters.append(phonetics.PAUSE)
            now_s = spoken_s = end_s
            is_own = number >= first_own
            numbers += (
                self.own_count if is_own else -1, len(kinds), len(parts), len(letters), len(signs), start_s, end_s
            )  # fmt: skip
            kinds += parts
            letters += signs
            if is_own:
                if lead_s:
                    self.prepared.append((self.own_count, start_s - lead_s / 2))
                self.own_count += 1
                first_s = first_s if said else start_s
                said.append((phone, contact))
                if is_unknown:
                    self.unknown[phone.label] += 1
                if phone.loudness_db:
                    self.loud.append((len(numbers) // 7 - 1, phone.loudness_db))
        letters += phonetics.PAUSE_BEHIND
        kinds += (labels.silence,) * REACH
        self.said.append(said)
        if said:
            self.rests += ((track, max(first_s - self.lead_s, 0.0)), (track, spoken_s + REST_MARGIN_S))

    def _rest(self, track: int, from_s: float, until_s: float) -> None:
        if until_s - from_s >= HELD_PAUSE_S:
            self.rests += ((track, from_s + REST_MARGIN_S), (track, until_s - self.lead_s))
        else:
            self.rests.append((track, (from_s + until_s) / 2))


class _Labels:
    """Labels as a profile knows them, with or without its context model. Stateful: it caches what it has looked up."""

    def __init__(self, profile: Profile, *, context: bool) -> None:
        model, known = profile.context if context else None, tuple(profile.phones)
        self._tables = tables = None if model is None else tables_of(model)
        self._fractions = np.zeros(0) if model is None else np.array(model.fractions)
        self._phones, self._modes = tuple(profile.phones.values()), profile.space.mode_count
        self.silence = -1 if tables is None else tables.silence

        @lru_cache(maxsize=LABELS)
        def spelled_of(label: str, vowels: tuple[str, ...]) -> _Spelled:
            parts, is_unknown = spelled(label, known)
            kinds = tuple(known.index(name) if tables is None else tables.kind(heard, vowels) for name, heard in parts)
            return _Spelled(kinds, phonetics.kinds_of(label), contact_of(parts, profile), is_unknown)

        self.spelled_of = spelled_of

    def targets(
        self, kinds: Indices, lengths_s: Array, own: Indices
    ) -> tuple[Indices, Array, Array, NDArray[np.bool_]]:
        """Find the keys of parts.

        Parameters
        ----------
        kinds, lengths_s : (T,)
            All parts in a row, with silences.
        own : (P,) int
            Places of the parts that get keys.

        Returns
        -------
        part : (N,) int
            Part of each key, 0 to P - 1.
        fractions : (N,) float64
            Place of each key in its part.
        weights : (N, K) float64
        heard : (P,) bool
            Whether the recorded speaker said the part between the same neighbours.
        """
        if self._tables is None:
            phones = [self._phones[kind] for kind in kinds[own].tolist()]
            part = np.repeat(np.arange(len(own)), [len(phone.fractions) for phone in phones])
            fractions = np.array([fraction for phone in phones for fraction in phone.fractions])
            weights = np.concatenate([np.zeros((0, self._modes)), *(phone.targets for phone in phones)])
            return part, fractions, weights, np.zeros(len(own), bool)
        targets, heard = self._tables.targets(kinds, lengths_s, own)
        between, every = self._fractions, len(self._fractions)
        part, fractions = np.arange(len(own)).repeat(every), np.tile(between, len(own))
        weights = targets.reshape(len(part), self._modes)
        crowded = (lengths_s[own] * (between[-1] - between[0]) < APART_S * (every - 1)).nonzero()[0]
        if len(crowded):
            targets[crowded, 0], fractions[crowded * every] = targets[crowded].mean(axis=1), between.mean()
            kept = np.ones((len(own), every), bool)
            kept[crowded, 1:] = False
            keys = kept.ravel()
            part, fractions, weights = part[keys], fractions[keys], weights[keys]
        return part, fractions, weights, heard


@lru_cache(maxsize=16)
def _labels(profile: Profile, context: bool) -> _Labels:
    return _Labels(profile, context=context)


def spelled_of(label: str, profile: Profile) -> _Spelled:
    """Targets of a label, from a profile without a context model."""
    return _labels(profile, False).spelled_of(label, ())


def contact_of(parts: Iterable[SpelledPart], profile: Profile) -> str:
    """Find the contact of a phone from its parts.

    Returns
    -------
    str
        ``none``, ``lips``, ``teeth``, ``open`` for a vowel that must open and for θ ð, ``glide`` for w, ``jaw`` where
        it must be high.
    """
    contacts = (profile.phones[name].contact for name, _ in parts)
    letters = {letter for _, heard in parts for letter in heard}
    contact = next((each for each in contacts if each != "none"), "none")
    if contact != "none":
        return contact
    if any(map(must_open, letters)):
        return "open"
    return "glide" if letters & GLIDES else "jaw" if letters & SIBILANTS else "none"


def must_open(letter: str) -> bool:
    """Whether an IPA character cannot be said with the mouth nearly shut: open and near-open vowels, θ and ð."""
    sound = ipa.SOUNDS.get(letter)
    return letter in INTERDENTAL or (sound is not None and sound.vowel and sound.opening >= NEAR_OPEN)


def _apart(times_s: Array, track_of: Indices) -> Indices | slice:
    """Choose the keys that are far enough apart in their track; the first and the last stay."""
    near = (times_s[1:] - times_s[:-1] < CLOSEST_KEYS_S) & (track_of[1:] == track_of[:-1])
    if not near.any():
        return slice(None)
    kept = np.ones(len(times_s), bool)
    for track in np.unique(track_of[1:][near]).tolist():
        first, last = np.flatnonzero(track_of == track)[[0, -1]].tolist()
        before_s, end_s = times_s[first], times_s[last]
        for index in range(first + 1, last):
            kept[index] = before_s + CLOSEST_KEYS_S <= times_s[index] <= end_s - CLOSEST_KEYS_S
            before_s = times_s[index] if kept[index] else before_s
    return np.flatnonzero(kept)
