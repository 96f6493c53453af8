"""Paths of many streams at once: what :mod:`.targets`, :mod:`.phonetics` and :mod:`.targets` do for one.

Theory of operation
-------------------
A stream plans a dozen phones again whenever one comes, and NumPy's calls cost more than its arithmetic. So phones of
all streams of a server since the last frame are planned together: phones of all tracks stand in one row, far enough
apart that no feature reaches across, and each step is one call. What is known of a label is looked up, not computed
again.

The keys of a track equal those that the three modules find for it alone, except for rounding.
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
from fapengine.trajectory.context import LABELS, PAUSE_S, REACH, speller, tables_of
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.targets import (
    APART_S,
    CLOSEST_KEYS_S,
    GAP_S,
    HELD_PAUSE_S,
    MIN_PAUSE_S,
    REST_MARGIN_S,
    contact_of,
    jaws_of,
    loudness_gain,
    spaced,
)

Array = NDArray[np.float64]
Contacts = list[tuple[Phone, str]]
"""Phones that touch or must open, each with its contact."""


class _Spelled(NamedTuple):
    """A label without a time."""

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
    letters: list[int] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    """Seven numbers for each phone: its track, or -1 where no keys are wanted; places and counts of its tokens in
    ``kinds`` and of its letters; start and end."""
    loud: list[tuple[int, float]] = field(default_factory=list)
    """Phones that are louder or quieter than usual, and their gain."""
    rests: list[tuple[int, float]] = field(default_factory=list)
    """Track and time of each key at rest."""
    contacts: list[Contacts] = field(default_factory=list)

    def add(self, track: int, phones: Sequence[Phone], first_own: int, look_up: "_Labels") -> None:
        """Append a track; phones before ``first_own`` get no keys."""
        kinds, letters, numbers = self.kinds, self.letters, self.numbers
        silence, spelled_of = look_up.silence, look_up.spelled_of
        kinds += (silence,) * REACH
        letters += phonetics.NOTHING_BESIDE
        contacts: Contacts = []
        now_s, spoken_s, first_s = 0.0, -np.inf, -1.0
        for number, phone in enumerate(phones):
            start_s, end_s = phone.start_s, phone.end_s
            if start_s != now_s:
                if start_s > now_s + GAP_S:
                    kinds.append(silence)
                    if number > first_own and start_s - now_s >= MIN_PAUSE_S:
                        self._rest(track, now_s, start_s)
                elif start_s < now_s - GAP_S:
                    raise UsageError(
                        f"phone {phone.label!r}: starts at {start_s} s, but the one before ends at {now_s} s"
                    )
                elif end_s <= now_s:
                    continue
                else:
                    phone, start_s = replace(phone, start_s=now_s), now_s
            parts, signs, contact = spelled_of(phone.label)
            if start_s - spoken_s > phonetics.PAUSE_S:
                letters.append(phonetics.PAUSE)
            now_s = spoken_s = end_s
            mine = number >= first_own
            numbers += (track if mine else -1, len(kinds), len(parts), len(letters), len(signs), start_s, end_s)
            kinds += parts
            letters += signs
            if mine:
                if first_s < 0:
                    first_s = start_s
                if phone.loudness_db:
                    self.loud.append((len(numbers) // 7 - 1, loudness_gain(phone.loudness_db)))
                if contact != "none":
                    contacts.append((phone, contact))
        letters += phonetics.PAUSE_BEHIND
        kinds += (silence,) * REACH
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
    """Make the path of each track through the keys of its phones.

    Parameters
    ----------
    tracks : sequence of (phone list, int)
        Phones in time order, without silences; and the index of the first one that gets keys.
    profile : Profile
        With a context model.

    Returns
    -------
    paths : list of hermite.Path
        In the space's modes, then the axes of :mod:`.phonetics`.
    contacts : list of lists
    """
    look_up, row = _labels(profile), _Row()
    for number, (phones, first_own) in enumerate(tracks):
        row.add(number, phones, first_own, look_up)
    width = profile.space.mode_count + WIDTH
    if not row.rests:
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
    numbers = np.array(row.numbers).reshape(-1, 7)
    start_s, end_s = numbers[:, 5], numbers[:, 6]
    track_of, place, parts, first, count = numbers[:, :5].T.astype(np.intp)
    shares_s = (end_s - start_s) / parts
    phone = np.repeat(np.arange(len(numbers)), parts)
    index = np.arange(len(phone)) - (np.cumsum(parts) - parts)[phone]
    places, length_s = place[phone] + index, shares_s[phone]
    lengths_s = np.full(len(row.kinds), PAUSE_S)
    lengths_s[places] = length_s
    own = np.flatnonzero(track_of[phone] >= 0)
    phone, length_s = phone[own], length_s[own]
    targets = look_up.tables.targets(np.array(row.kinds), lengths_s, places[own])
    fractions = look_up.fractions
    keys_s = (start_s[phone] + index[own] * length_s)[:, None] + length_s[:, None] * fractions
    kept = np.ones(keys_s.shape, bool)
    crowded = length_s * (fractions[-1] - fractions[0]) < APART_S * (len(fractions) - 1)
    if crowded.any():
        targets[crowded, 0] = targets[crowded].mean(axis=1)
        keys_s[crowded, 0] = keys_s[crowded, 0] + length_s[crowded] * (fractions.mean() - fractions[0])
        kept[crowded, 1:] = False
    if row.loud:
        gains = np.ones(len(numbers))
        gains[[number for number, _ in row.loud]] = [gain for _, gain in row.loud]
        loud = np.flatnonzero(gains[phone] != 1.0)
        targets[loud] += (gains[phone[loud]] - 1.0)[:, None, None] * (targets[loud] @ jaws_of(profile))
    times_s = keys_s[kept]
    token = np.repeat(np.arange(len(phone)), kept.sum(axis=1))
    whole_s = (end_s - start_s)[phone]
    heard = look_up.tables.heard_as_here(np.array(row.kinds), places[own]) & (parts[phone] == 1)
    long_s = np.where(heard, 0.0, whole_s)[token]
    phone, letters_hz = phone[token], (count[phone] / whole_s)[token]
    passed = np.floor((times_s - start_s[phone]) * letters_hz).astype(np.intp)
    letters, at = np.array(row.letters), first[phone] + np.minimum(passed, count[phone] - 1)
    layer = phonetics.in_context(letters, at)
    phonetics.hold_long(layer, letters[at], long_s)
    return track_of[phone], times_s, np.concatenate([targets[kept], layer], axis=1)


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
    """Labels as a profile knows them. Stateful: it caches what it has looked up."""

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
        raise UsageError("profile: needs a context model")
    return _Labels(profile, profile.context)
