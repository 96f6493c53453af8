"""From what a file says to a :class:`PhoneTrack`: checks that every reader shares."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fapengine.errors import DataError
from fapengine.speech import alphabets
from fapengine.speech.phone_track import SILENCE, Level, Phone, PhoneTrack

MAX_TIME_S = 86_400.0
"""A day: later times are a mistake of unit, not speech."""
OVERLAP_S = 1e-3
"""Overlaps up to here are rounding."""
LAST_S = 0.1
"""Duration of the last phone in a format that gives no end, s."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One timed label as a file gives it."""

    start_s: float
    end_s: float
    label: str
    where: str
    """Line or key, for messages."""
    word: str = ""


def until_next(onsets: Sequence[tuple[float, str, str]], end_s: float | None = None) -> list[Entry]:
    """Give each onset (start_s, label, where) the time until the next; the last until ``end_s``, or :data:`LAST_S`."""
    entries: list[Entry] = []
    for index, (start_s, label, where) in enumerate(onsets):
        if index + 1 < len(onsets):
            until_s = onsets[index + 1][0]
        else:
            until_s = start_s + LAST_S if end_s is None else max(end_s, start_s)
        entries.append(Entry(start_s, until_s, label, where))
    return entries


def track_of(
    entries: Iterable[Entry], what: str, *, alphabet: str | None = None, level: Level = "phone", spelled: bool = False
) -> PhoneTrack:
    """Make a track of entries; those without length are dropped, holes become silence.

    Parameters
    ----------
    entries : iterable of Entry
        In the order of time.
    what : str
        Name of the format, for messages.
    alphabet : str, optional
        One of :data:`fapengine.speech.alphabets.ALPHABETS`; by default guessed. Spelled words have none.
    level, spelled : Level, bool
        See :class:`PhoneTrack`.

    Raises
    ------
    DataError
        If there is nothing, or times are no numbers, fall, overlap, or exceed a day; ``where`` is the entry's.
    """
    entries = list(entries)
    if not entries:
        raise DataError(f"{what}: got no timed label at all")
    if alphabet is None and not spelled:
        alphabet = alphabets.guess_alphabet(entry.label.strip() for entry in entries)
    phones: list[Phone] = []
    end_s = 0.0
    for entry in entries:
        _check(entry, end_s)
        if entry.end_s == entry.start_s:
            continue
        end_s = entry.end_s
        phones.append(_phone(entry, alphabet, spelled))
    return PhoneTrack.of(phones, tolerance_s=OVERLAP_S, level=level, spelled=spelled)


def _check(entry: Entry, before_s: float) -> None:
    start_s, end_s = entry.start_s, entry.end_s
    if not (math.isfinite(start_s) and math.isfinite(end_s) and 0 <= start_s <= end_s):
        raise DataError(f"times: got {start_s:g} s .. {end_s:g} s, expected 0 <= start <= end", where=entry.where)
    if end_s > MAX_TIME_S:
        raise DataError(f"times: got {end_s:g} s, expected at most a day; is the unit right?", where=entry.where)
    if start_s < before_s - OVERLAP_S:
        raise DataError(
            f"times: {entry.label[:40]!r} starts at {start_s:g} s, expected {before_s:g} s or later, where the one"
            " before ends",
            where=entry.where,
        )


def _phone(entry: Entry, alphabet: str | None, spelled: bool) -> Phone:
    label = entry.label.strip()
    if label.lower() in alphabets.SILENCES:
        return Phone(SILENCE, entry.start_s, entry.end_s)
    if spelled or alphabet is None:
        return Phone(label, entry.start_s, entry.end_s, 0, label)
    as_ipa, stress = alphabets.to_ipa(label, alphabet)
    if not as_ipa:
        return Phone(SILENCE, entry.start_s, entry.end_s)
    return Phone(as_ipa, entry.start_s, entry.end_s, stress, entry.word.strip())


def shared_out(start_s: float, end_s: float, labels: Sequence[str], where: str, word: str = "") -> list[Entry]:
    """Spread labels evenly over a time, where a file times the word but not its phones."""
    step_s = (end_s - start_s) / max(len(labels), 1)
    return [
        Entry(start_s + index * step_s, end_s if index + 1 == len(labels) else start_s + (index + 1) * step_s, label,
              where, word)
        for index, label in enumerate(labels)
    ]  # fmt: skip
