"""Timed labels of a file, and the :class:`PhoneTrack` made of them: the checks that every reader shares."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.guess import guess, is_doubtful
from fapengine.speech.alphabets.japanese import JAPANESE, in_japanese
from fapengine.speech.phone_track import SILENCE, Level, Phone, PhoneTrack, Reading, UnknownPhone
from fapengine.speech.plausible import dropped_remarks

MAX_TIME_S = 86_400.0
"""A day: later times are a mistake of unit, not speech."""
EMPTY_S, A_PHONE_S = 600.0, 60.0
"""Longest timings without a label, and more for each label: a short file must not give a day of frames."""
OVERLAP_S = 1.5e-3
"""Longest overlap that counts as rounding: start, length and next start, each rounded to 1 ms."""
LAST_S = 0.1
"""Duration of the last phone in a format that gives no end, s."""
_BURSTS = {"bcl": ("b",), "dcl": ("d", "jh"), "gcl": ("g",), "pcl": ("p",), "tcl": ("t", "ch"), "kcl": ("k",)}


@dataclass(frozen=True, slots=True)
class Entry:
    """One timed label as a file gives it."""

    start_s: float
    end_s: float
    label: str
    where: str
    """Line or key, for messages."""
    word: str = ""


def until_next(
    onsets: Sequence[tuple[float, str, str] | tuple[float, str, str, str]], end_s: float | None = None
) -> list[Entry]:
    """Entries from onsets (start_s, label, where, optional word).

    Each lasts until the next one, the last one until ``end_s``, or :data:`LAST_S`.
    """
    ends_s = [onset[0] for onset in onsets[1:]]
    if onsets:
        last_s = onsets[-1][0]
        ends_s.append(last_s + LAST_S if end_s is None else max(end_s, last_s))
    return [Entry(onset[0], until_s, *onset[1:]) for onset, until_s in zip(onsets, ends_s, strict=True)]


def in_sequence(
    lengths: Iterable[tuple[str, float, str] | tuple[str, float, str, str]], start_s: float = 0.0
) -> list[Entry]:
    """Entries that follow each other, from (label, length in s, where, optional word)."""
    entries: list[Entry] = []
    for label, length_s, *rest in lengths:
        if length_s < 0:
            raise DataError(f"length: must be 0 or more, got {length_s:g} s", where=rest[0])
        entries.append(Entry(start_s, start_s + length_s, label, *rest))
        start_s += length_s
    return entries


def without_overlaps(entries: Sequence[Entry]) -> list[Entry]:
    """End each entry where the next one starts, if that is earlier."""
    cut = [
        replace(entry, end_s=later.start_s) if entry.start_s <= later.start_s < entry.end_s else entry
        for entry, later in pairwise(entries)
    ]
    return [*cut, *entries[-1:]]


def with_words(phones: Sequence[Entry], words: Sequence[Entry]) -> list[Entry]:
    """Assign to each phone the word at its middle; both are in the order of time."""
    found: list[Entry] = []
    index = 0
    for phone in phones:
        middle_s = (phone.start_s + phone.end_s) / 2
        while index < len(words) and words[index].end_s <= middle_s:
            index += 1
        inside = index < len(words) and words[index].start_s <= middle_s
        found.append(replace(phone, word=words[index].label if inside else ""))
    return found


def shared_out(start_s: float, end_s: float, labels: Sequence[str], where: str, word: str = "") -> list[Entry]:
    """Spread labels evenly over a time, where a file times the word but not its phones."""
    step_s = (end_s - start_s) / max(len(labels), 1)
    edges_s = [start_s + index * step_s for index in range(len(labels))] + [end_s]
    return [Entry(*edges, label, where, word) for edges, label in zip(pairwise(edges_s), labels, strict=True)]


def join_closures(entries: Sequence[Entry]) -> list[Entry]:
    """Join TIMIT's closures and bursts to stops; a closure without a burst stays, and is the stop itself.

    TIMIT times the two apart; lips show one stop, shut from the closure on.

    Examples
    --------
    >>> closed = [Entry(0, 1, "pcl", ""), Entry(1, 2, "p", ""), Entry(2, 3, "kcl", "")]
    >>> [(entry.label, entry.start_s, entry.end_s) for entry in join_closures(closed)]
    [('p', 0, 2), ('kcl', 2, 3)]
    """
    joined: list[Entry] = []
    for entry in entries:
        before = joined[-1] if joined else entry
        bursts = _BURSTS.get(before.label.strip().lower(), ())
        if entry.label.strip().lower() in bursts and before.end_s == entry.start_s:
            joined[-1] = replace(entry, start_s=before.start_s)
        else:
            joined.append(entry)
    return joined


def track_of(
    entries: Iterable[Entry],
    what: str,
    *,
    alphabet: str | None = None,
    level: Level = "phone",
    spelled: bool = False,
    remarks: tuple[str, ...] = (),
) -> PhoneTrack:
    """Make a track of entries; those without length are dropped with a remark, gaps become silence.

    Parameters
    ----------
    entries : iterable of Entry
        In the order of time.
    what : str
        Name of the format, for messages.
    alphabet : str, optional
        One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`; by default guessed. Words have none.
    level, spelled : Level, bool
        See :class:`PhoneTrack`.
    remarks : tuple of str
        What the format assumed.

    Raises
    ------
    DataError
        If times are wrong, or only silence has a length.
    """
    entries = list(entries)
    if not entries:
        raise DataError(f"{what}: contains no timed label")
    timed: list[Entry] = []
    dropped: list[tuple[str, float, str]] = []
    for entry in entries:
        _check(entry, timed[-1].end_s if timed else 0.0)
        if entry.end_s > entry.start_s:
            timed.append(replace(entry, start_s=entry.start_s + 0.0, label=entry.label.strip()))  # -0.0 is 0
        elif not alphabets.is_silence(entry.label, spelled=spelled):
            dropped.append((entry.label, entry.start_s, entry.where))
    if all(alphabets.is_silence(entry.label, spelled=spelled) for entry in timed):
        got = f"{len(dropped)} labels without length" if dropped else f"{len(entries)} silences"
        raise DataError(f"{what}: got {got}, expected phones or words with times", where=entries[0].where)
    remarks += dropped_remarks(dropped)
    _check_length(timed, what)
    if spelled:
        words = [
            Phone(SILENCE, entry.start_s, entry.end_s)
            if alphabets.is_silence(entry.label, spelled=True)
            else Phone(entry.label, entry.start_s, entry.end_s, 0, entry.label)
            for entry in timed
        ]
        return PhoneTrack.from_phones(
            words, tolerance_s=OVERLAP_S, level=level, spelled=True, reading=Reading(remarks=remarks)
        )
    reading = replace(_reading_of(timed, alphabet), remarks=remarks)
    if reading.alphabet == "arpabet":
        timed = join_closures(timed)
    phones = [_phone(entry, reading.alphabet) for entry in timed]
    if reading.alphabet in JAPANESE:
        phones = in_japanese(phones)
    return PhoneTrack.from_phones(phones, tolerance_s=OVERLAP_S, level=level, reading=reading)


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


def _check_length(timed: Sequence[Entry], what: str) -> None:
    count = sum(not alphabets.is_silence(entry.label) for entry in timed)
    end_s, most_s = (timed[-1].end_s if timed else 0.0), EMPTY_S + A_PHONE_S * count
    if end_s > most_s:
        raise DataError(
            f"{what}: got {count} labels in {end_s:.0f} s, expected at most {most_s:.0f} s for so few; cut the silence",
            where=timed[-1].where,
        )


def _reading_of(entries: Sequence[Entry], alphabet: str | None) -> Reading:
    """Alphabet of the labels, and those of them that are doubtful; numbers are refused, for they can be any."""
    if alphabet is None and all(
        re.fullmatch(r"\d*", entry.label) or alphabets.is_silence(entry.label) for entry in entries
    ):
        raise DataError(
            f"labels: got numbers such as {entries[0].label!r}, expected phones; ids of Azure's visemes need"
            " alphabet=azure-visemes",
            where=entries[0].where,
        )
    guessed = guess(entry.label for entry in entries) if alphabet is None else None
    name = guessed.alphabet if guessed else alphabet or ""
    first_s = {entry.label: entry.start_s for entry in reversed(entries)}
    doubtful = tuple(
        UnknownPhone(label, count, first_s[label], " ".join(ipa.letters(alphabets.to_ipa(label, name)[0])))
        for label, count in Counter(entry.label for entry in entries).items()
        if not alphabets.is_silence(label) and is_doubtful(label, name, guessed=guessed is not None)
    )
    return Reading(name, guessed is not None, guessed.others if guessed else (), doubtful)


def _phone(entry: Entry, alphabet: str) -> Phone:
    as_ipa, stress = alphabets.to_ipa(entry.label, alphabet)
    if not as_ipa or alphabets.is_silence(entry.label):
        return Phone(SILENCE, entry.start_s, entry.end_s)
    return Phone(as_ipa, entry.start_s, entry.end_s, stress, entry.word.strip())
