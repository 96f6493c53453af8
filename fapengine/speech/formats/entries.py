"""From what a file says to a :class:`PhoneTrack`: checks that every reader shares."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.guess import guess, is_doubtful
from fapengine.speech.neighbours import JAPANESE, in_japanese, join_closures
from fapengine.speech.phone_track import SILENCE, Entry, Level, Phone, PhoneTrack, Reading, UnknownPhone

__all__ = ["LAST_S", "MAX_TIME_S", "OVERLAP_S", "Entry", "shared_out", "track_of", "until_next", "with_words"]

MAX_TIME_S = 86_400.0
"""A day: later times are a mistake of unit, not speech."""
EMPTY_S, A_PHONE_S = 600.0, 60.0
"""Length that timings may have without a label, and for each label more: a short file is not a day of frames."""
OVERLAP_S = 1e-3
"""Overlaps up to here are rounding."""
LAST_S = 0.1
"""Duration of the last phone in a format that gives no end, s."""


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
        One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`; by default guessed. Spelled words have none.
    level, spelled : Level, bool
        See :class:`PhoneTrack`.
    """
    entries = list(entries)
    if not entries:
        raise DataError(f"{what}: contains no timed label")
    timed: list[Entry] = []
    for entry in entries:
        _check(entry, timed[-1].end_s if timed else 0.0)
        if entry.end_s > entry.start_s:
            timed.append(entry)
    _check_length(timed, what)
    if spelled:
        return PhoneTrack.of([_word(entry) for entry in timed], tolerance_s=OVERLAP_S, level=level, spelled=True)
    reading = reading_of(timed, alphabet)
    if reading.alphabet == "arpabet":
        timed = join_closures(timed)
    phones = [_phone(entry, reading.alphabet) for entry in timed]
    if reading.alphabet in JAPANESE:
        phones = in_japanese(phones)
    return PhoneTrack.of(phones, tolerance_s=OVERLAP_S, level=level, reading=reading)


def _check_length(timed: Sequence[Entry], what: str) -> None:
    count = sum(not alphabets.is_silence(entry.label.strip()) for entry in timed)
    end_s, most_s = (timed[-1].end_s if timed else 0.0), EMPTY_S + A_PHONE_S * count
    if end_s > most_s:
        raise DataError(
            f"{what}: got {count} labels in {end_s:.0f} s, expected at most {most_s:.0f} s for so few; cut the silence",
            where=timed[-1].where,
        )


def reading_of(entries: Sequence[Entry], alphabet: str | None) -> Reading:
    """Say what the labels are taken for, and which of them are doubtful."""
    guessed = guess(entry.label for entry in entries) if alphabet is None else None
    name = guessed.alphabet if guessed else alphabet or ""
    doubtful: dict[str, UnknownPhone] = {}
    for entry in entries:
        label = entry.label.strip()
        if label in doubtful:
            doubtful[label] = replace(doubtful[label], count=doubtful[label].count + 1)
        elif not alphabets.is_silence(label) and is_doubtful(label, name, guessed=guessed is not None):
            shown = " ".join(ipa.letters(alphabets.to_ipa(label, name)[0]))
            doubtful[label] = UnknownPhone(label, 1, entry.start_s, shown)
    return Reading(name, guessed is not None, guessed.others if guessed else (), tuple(doubtful.values()))


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


def _word(entry: Entry) -> Phone:
    word = entry.label.strip()
    if alphabets.is_silence(word, spelled=True):
        return Phone(SILENCE, entry.start_s, entry.end_s)
    return Phone(word, entry.start_s, entry.end_s, 0, word)


def _phone(entry: Entry, alphabet: str) -> Phone:
    label = entry.label.strip()
    if alphabets.is_silence(label):
        return Phone(SILENCE, entry.start_s, entry.end_s)
    as_ipa, stress = alphabets.to_ipa(label, alphabet)
    if not as_ipa:
        return Phone(SILENCE, entry.start_s, entry.end_s)
    return Phone(as_ipa, entry.start_s, entry.end_s, stress, entry.word.strip())


def with_words(phones: list[Entry], words: list[Entry]) -> list[Entry]:
    """Give each phone the word in whose time its middle lies; both in the order of time."""
    pieces: list[Entry] = []
    index = 0
    for phone in phones:
        middle_s = (phone.start_s + phone.end_s) / 2
        while index < len(words) and words[index].end_s <= middle_s:
            index += 1
        inside = index < len(words) and words[index].start_s <= middle_s
        pieces.append(Entry(phone.start_s, phone.end_s, phone.label, phone.where, words[index].label if inside else ""))
    return pieces


def shared_out(start_s: float, end_s: float, labels: Sequence[str], where: str, word: str = "") -> list[Entry]:
    """Spread labels evenly over a time, where a file times the word but not its phones."""
    step_s = (end_s - start_s) / max(len(labels), 1)
    return [
        Entry(start_s + index * step_s, end_s if index + 1 == len(labels) else start_s + (index + 1) * step_s, label,
              where, word)
        for index, label in enumerate(labels)
    ]  # fmt: skip
