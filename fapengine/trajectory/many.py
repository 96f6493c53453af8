"""Paths of many streams at once: what :mod:`.targets`, :mod:`.phonetics` and :mod:`.keyframes` do for one.

Theory of operation
-------------------
A stream plans a dozen phones anew whenever one comes, and the calls of NumPy cost more than their numbers. So what has
come for all streams of a server since the last frame is planned together: phones of all tracks stand in one row, with
room between them that nothing sees across, and each step is one call. A label's letters, kinds and contact are looked
up, not found anew.

The keys of a track are those that the three modules find for it alone, but for rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.profiles import ContextModel, Profile
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import hermite, phonetics
from fapengine.trajectory.context import tables_of
from fapengine.trajectory.context_features import PAUSE_S, REACH
from fapengine.trajectory.keyframes import CLOSEST_KEYS_S, HELD_PAUSE_S, MIN_PAUSE_S, REST_MARGIN_S, spaced
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.targets import APART_S, GAP_S, contact_of, jaws_of, loudness_gain
from fapengine.trajectory.tokens import LABELS, speller

Array = NDArray[np.float64]
Contacts = list[tuple[Phone, str]]
"""Phones that touch or must open, each with its contact."""


class _Spelled(NamedTuple):
    """What is known of a label before it has a time."""

    kinds: tuple[int, ...]
    """Kinds of its parts, in the context model's tables."""
    letters: tuple[int, ...]
    """Its letters, in the table of articulation."""
    contact: str


@dataclass(slots=True)
class _Row:
    """Phones of all tracks, side by side. Stateful: it grows phone by phone."""

    kinds: list[int] = field(default_factory=list)
    """Number of every token, and of the silences between them, in the context model's tables."""
    lengths_s: list[float] = field(default_factory=list)
    letters: list[int] = field(default_factory=list)
    own: list[int] = field(default_factory=list)
    """Place of each spoken token in ``kinds``."""
    tokens: list[float] = field(default_factory=list)
    """Seven numbers for each token that is spoken: its track, start, length; its phone's first and last letter, start
    and letters a second."""
    loud: list[tuple[int, float]] = field(default_factory=list)
    """Tokens that are louder or quieter than usual, and their gain."""
    rests: list[tuple[int, float]] = field(default_factory=list)
    """Track and time of each key at rest."""
    contacts: list[Contacts] = field(default_factory=list)

    def add(self, track: int, phones: Sequence[Phone], first_own: int, look_up: "_Labels") -> None:
        """Put a track behind the others; of the phones before ``first_own`` no keys are wanted."""
        kinds, lengths, letters = self.kinds, self.lengths_s, self.letters
        silence, spelled_of = look_up.silence, look_up.spelled_of
        kinds += (silence,) * REACH
        lengths += (PAUSE_S,) * REACH
        letters += phonetics.NOTHING_BESIDE
        contacts: Contacts = []
        now_s, spoken_s, first_s = 0.0, -np.inf, -1.0
        for number, phone in enumerate(phones):
            start_s, end_s = phone.start_s, phone.end_s
            if start_s > now_s + GAP_S:
                kinds.append(silence)
                lengths.append(PAUSE_S)
                if number > first_own and start_s - now_s >= MIN_PAUSE_S:
                    self._rest(track, now_s, start_s)
                now_s = start_s
            elif start_s < now_s - GAP_S:
                raise UsageError(f"phone {phone.label!r}: starts at {start_s} s, but the one before ends at {now_s} s")
            if end_s <= now_s:
                continue
            if start_s != now_s:
                phone, start_s = replace(phone, start_s=now_s), now_s
            parts, signs, contact = spelled_of(phone.label)
            if start_s - spoken_s > phonetics.PAUSE_S:
                letters.append(phonetics.PAUSE)
            first, count = len(letters), len(signs)
            letters += signs
            share_s = (end_s - start_s) / len(parts)
            now_s = spoken_s = end_s
            if number < first_own:
                kinds += parts
                lengths += (share_s,) * len(parts)
                continue
            if first_s < 0:
                first_s = start_s
            gain = loudness_gain(phone.loudness_db) if phone.loudness_db else 1.0
            at_s = start_s
            for kind in parts:
                if gain != 1.0:
                    self.loud.append((len(self.own), gain))
                self.own.append(len(kinds))
                self.tokens += (track, at_s, share_s, first, first + count - 1, start_s, count / (end_s - start_s))
                kinds.append(kind)
                lengths.append(share_s)
                at_s += share_s
            if contact != "none":
                contacts.append((phone, contact))
        letters += phonetics.PAUSE_BEHIND
        kinds += (silence,) * REACH
        lengths += (PAUSE_S,) * REACH
        self.contacts.append(contacts)
        if first_s >= 0:
            self.rests += ((track, max(first_s - REST_MARGIN_S, 0.0)), (track, spoken_s + REST_MARGIN_S))

    def _rest(self, track: int, from_s: float, until_s: float) -> None:
        if until_s - from_s >= HELD_PAUSE_S:
            self.rests += ((track, from_s + REST_MARGIN_S), (track, until_s - REST_MARGIN_S))
        else:
            self.rests.append((track, (from_s + until_s) / 2))


def lay_paths(
    tracks: Sequence[tuple[Sequence[Phone], int]], profile: Profile
) -> tuple[list[hermite.Path], list[Contacts]]:
    """Lay the path of each track through the keys of its phones.

    Parameters
    ----------
    tracks : sequence of (phone list, int)
        Phones in time order, without silences; and the number of the first of them whose keys are wanted.
    profile : Profile
        With a context model.

    Returns
    -------
    paths : list of hermite.Path
        In the space's modes, and the axes of :mod:`.phonetics` behind them.
    contacts : list of lists

    Raises
    ------
    UsageError
        If phones of a track overlap by more than :data:`.targets.GAP_S`.
    """
    look_up, row = _labels(profile), _Row()
    for number, (phones, first_own) in enumerate(tracks):
        row.add(number, phones, first_own, look_up)
    width = profile.space.mode_count + WIDTH
    if not row.own:
        return [hermite.Path.through(np.zeros(0), np.zeros((0, width))) for _ in tracks], row.contacts
    track_of, times_s, weights = _keys(row, profile, look_up)
    rests = np.array(row.rests)
    track_of = np.concatenate([track_of, rests[:, 0].astype(np.intp)])
    times_s = np.concatenate([times_s, rests[:, 1]])
    weights = np.concatenate([weights, np.zeros((len(rests), width))])
    order = np.lexsort((times_s, track_of))
    order = order[_apart(times_s[order], track_of[order])]
    times_s, track_of, weights = times_s[order], track_of[order], weights[order]
    edges = np.searchsorted(track_of, np.arange(len(tracks) + 1)).tolist()
    jets = np.empty((len(times_s), 3, width))
    jets[:, 0] = weights
    jets[:, 1], jets[:, 2] = hermite.derivatives(times_s, weights, track_of)
    paths = [
        hermite.Path(times_s[first:behind], jets[first:behind])
        if behind - first >= 2
        else hermite.Path.through(np.zeros(0), np.zeros((0, width)))
        for first, behind in pairwise(edges)
    ]
    return paths, row.contacts


def _keys(row: _Row, profile: Profile, look_up: "_Labels") -> tuple[NDArray[np.intp], Array, Array]:
    """Track, time (N,) and weights with axes (N, K + axes) of the keys of all phones."""
    told = np.array(row.tokens).reshape(-1, 7)
    track_of = told[:, 0].astype(np.intp)
    start_s, length_s, first, last, phone_s, letters_hz = told[:, 1:].T
    targets = look_up.tables.targets(np.array(row.kinds), np.array(row.lengths_s), np.array(row.own))
    fractions = look_up.fractions
    keys_s = start_s[:, None] + length_s[:, None] * fractions
    kept = np.ones(keys_s.shape, bool)
    crowded = length_s * (fractions[-1] - fractions[0]) < APART_S * (len(fractions) - 1)
    if crowded.any():
        targets[crowded, 0] = targets[crowded].mean(axis=1)
        keys_s[crowded, 0] = start_s[crowded] + length_s[crowded] * fractions.mean()
        kept[crowded, 1:] = False
    if row.loud:
        loud, gains = np.array([token for token, _ in row.loud]), np.array([gain for _, gain in row.loud])
        targets[loud] += (gains - 1.0)[:, None, None] * (targets[loud] @ jaws_of(profile))
    times_s = keys_s[kept]
    token = np.repeat(np.arange(len(told)), kept.sum(axis=1))
    letter = np.minimum(first[token] + np.floor((times_s - phone_s[token]) * letters_hz[token]), last[token])
    letters, at = np.array(row.letters), letter.astype(np.intp)
    layer = phonetics.in_context(letters, at)
    phone_lengths_s = (last - first + 1.0) / letters_hz
    phonetics.hold_long(layer, letters[at], phone_lengths_s[token])
    return track_of[token], times_s, np.concatenate([targets[kept], layer], axis=1)


def _apart(times_s: Array, track_of: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Choose the keys that stand far enough apart in their track."""
    near = (np.diff(times_s) < CLOSEST_KEYS_S) & (np.diff(track_of) == 0)
    if not near.any():
        return slice(None)
    kept = np.ones(len(times_s), bool)
    for track in np.unique(track_of[1:][near]).tolist():
        mine = np.flatnonzero(track_of == track)
        kept[mine] = False
        kept[mine[spaced(times_s[mine].tolist())]] = True
    return np.flatnonzero(kept)


class _Labels:
    """What is known of labels, by profile. Stateful: it remembers what it has met."""

    def __init__(self, profile: Profile, model: ContextModel) -> None:
        self.tables, self.fractions = tables_of(model), np.array(model.fractions)
        self.silence = self.tables.silence
        parts_of = speller(tuple(profile.phones))

        @lru_cache(maxsize=LABELS)
        def spelled_of(label: str) -> _Spelled:
            parts, _ = parts_of(label)
            kinds = tuple(self.tables.kind(heard) for _, heard in parts)
            return _Spelled(kinds, phonetics.kinds_of(label), contact_of(parts, profile))

        self.spelled_of = spelled_of


@lru_cache(maxsize=16)
def _labels(profile: Profile) -> _Labels:
    if profile.context is None:
        raise UsageError("profile: got none with a context model, expected one")
    return _Labels(profile, profile.context)
