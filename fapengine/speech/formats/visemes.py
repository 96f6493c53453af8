"""Visemes with their times from phones, in the sets of other programs, and their files, written.

A diphthong or an affricate is one viseme where the set has it, else two. h and the glottal stop have no lips of their
own and show those of the phone after them. A phone that a set does not name shows the nearest one
(:func:`fapengine.speech.ipa.nearest`). Rhubarb's nine shapes have rules of their own: :mod:`.rhubarb`.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import zip_longest
from typing import NamedTuple

from fapengine.errors import UsageError
from fapengine.mpeg4.fap import VISEMES
from fapengine.speech import ipa
from fapengine.speech.formats.rhubarb import (
    FIRST_SHARE,
    GRID_HZ,
    MouthCue,
    cues_of_frames,
    cues_of_phones,
    format_rhubarb,
)
from fapengine.speech.phone_track import STAND_IN, Phone, PhoneTrack

RHUBARB = "rhubarb"
"""The set of nine mouth shapes of Rhubarb Lip Sync."""
_MPEG4 = {str(row.number): row.phonemes for row in VISEMES}
_OCULUS = {row.label: row.phonemes for row in VISEMES}
_AZURE = {
    "0": "", "1": "æ ə ʌ", "2": "ɑ", "3": "ɔ", "4": "ɛ ʊ", "5": "ɝ", "6": "j i ɪ", "7": "w u", "8": "o", "9": "aʊ",
    "10": "ɔɪ", "11": "aɪ", "12": "h", "13": "ɹ", "14": "l", "15": "s z", "16": "ʃ tʃ dʒ ʒ", "17": "ð",
    "18": "f v", "19": "d t n θ", "20": "k ɡ ŋ", "21": "p b m",
}  # fmt: skip
"""Ids and their phones (Azure Speech documentation, how-to-speech-synthesis-viseme, 2026-02-25)."""
VISEME_SETS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "mpeg4": _MPEG4, "oculus": _OCULUS, "azure": {name: phones.split() for name, phones in _AZURE.items()}
}  # fmt: skip
"""Names of each set in order, silence first, and the phones of each: MPEG-4's numbers (Table C.4), Meta's names of the
same visemes, Azure's ids."""
_AS_NEXT = frozenset("hɦʔ")
TICKS_HZ = 10_000_000
"""Azure's unit of time: 100 ns."""


class TimedViseme(NamedTuple):
    """A viseme and its time."""

    name: str
    start_s: float
    end_s: float


def visemes_of_phones(track: PhoneTrack, shapes: str, *, duration_s: float | None = None) -> list[TimedViseme]:
    """List the visemes that show phones, from 0 to the end without a gap; neighbours differ.

    Parameters
    ----------
    track : PhoneTrack
        Phones in IPA, not words.
    shapes : str
        One of :data:`VISEME_SETS`, or ``"rhubarb"``.
    duration_s : float, optional
        Length of the sound; by default that of the phones.

    Raises
    ------
    UsageError
        If the set is unknown, or the track has words.

    Examples
    --------
    >>> ma = PhoneTrack((Phone("m", 0.0, 0.1), Phone("aʊ", 0.1, 0.3)))
    >>> [each.name for each in visemes_of_phones(ma, "azure")], visemes_of_phones(ma, "oculus")[0]
    (['21', '9'], TimedViseme(name='PP', start_s=0.0, end_s=0.1))
    """
    check_viseme_set(shapes)
    if track.phones and track.phones[0].start_s > 0:
        track = replace(track, phones=PhoneTrack.from_phones(list(track.phones)).phones)
    if shapes == RHUBARB:
        return _timed(cues_of_phones(track, duration_s=duration_s))
    if track.spelled:
        raise UsageError("phones: got spelled words, expected phones; pronounce them first")
    silence = next(iter(VISEME_SETS[shapes]))
    rows: list[TimedViseme] = []
    for phone, following in zip_longest(track.phones, track.phones[1:]):
        names = [silence] if phone.is_silence else _names(phone, following, shapes)
        middle_s = phone.start_s + FIRST_SHARE * phone.duration_s
        edges_s = (phone.start_s, phone.end_s) if len(names) == 1 else (phone.start_s, middle_s, phone.end_s)
        rows += map(TimedViseme, names, edges_s[:-1], edges_s[1:])
    end_s = track.duration_s if duration_s is None else duration_s
    if end_s > track.duration_s:
        rows.append(TimedViseme(silence, track.duration_s, end_s))
    return joined(rows)


def visemes_of_frames(frames: Sequence[int | str], rate_hz: float, shapes: str) -> list[TimedViseme]:
    """List the visemes of frames, each with a number of MPEG-4's table; for Rhubarb's set with a letter of its own."""
    if shapes == RHUBARB:
        return _timed(cues_of_frames([str(frame) for frame in frames], rate_hz))
    silence, *_ = names = tuple(VISEME_SETS[shapes])
    if shapes == "azure":
        names = tuple(viseme_of(row.phonemes[0], shapes) if row.phonemes else silence for row in VISEMES)
    return joined(TimedViseme(names[int(frame)], n / rate_hz, (n + 1) / rate_hz) for n, frame in enumerate(frames))


def _timed(cues: Iterable[MouthCue]) -> list[TimedViseme]:
    return [TimedViseme(cue.shape, cue.start_cs / GRID_HZ, cue.end_cs / GRID_HZ) for cue in cues]


def joined(rows: Iterable[TimedViseme]) -> list[TimedViseme]:
    """Join neighbours of one name."""
    kept: list[TimedViseme] = []
    for row in rows:
        if kept and kept[-1].name == row.name:
            kept[-1] = kept[-1]._replace(end_s=row.end_s)
        elif row.end_s > row.start_s:
            kept.append(row)
    return kept


def check_viseme_set(shapes: str) -> None:
    """Reject an unknown set. Raises UsageError."""
    if shapes not in (*VISEME_SETS, RHUBARB):
        raise UsageError(f"shapes: got {shapes!r}, expected one of {', '.join(VISEME_SETS)}, {RHUBARB}")


def _names(phone: Phone, following: Phone | None, shapes: str) -> list[str]:
    """Visemes of a phone that is not silence, one or two."""
    letters = ipa.letters(phone.label) or (STAND_IN,)
    if "".join(letters) in _phones_of(shapes):
        return [viseme_of("".join(letters), shapes)]
    if _AS_NEXT.issuperset(letters) and following is not None and not following.is_silence:
        return _names(following, None, shapes)[:1]
    return [viseme_of(letter, shapes) for letter in (letters[0], *letters[1:][-1:])]


@cache
def _phones_of(shapes: str) -> dict[str, str]:
    """Viseme of each phone that a set names, spelled by its letters."""
    return {
        "".join(ipa.letters(phone)): name for name, phones in VISEME_SETS[shapes].items() for phone in reversed(phones)
    }


@cache
def viseme_of(phone: str, shapes: str) -> str:
    """Name of the viseme that shows a phone of the set, or any IPA letter.

    Examples
    --------
    >>> [viseme_of("ŋ", shapes) for shapes in VISEME_SETS]
    ['5', 'kk', '20']
    """
    names, spelled = _phones_of(shapes), "".join(ipa.letters(phone))
    return names.get(spelled) or names[ipa.nearest(spelled, tuple(name for name in names if len(name) == 1))]


def format_visemes(rows: Sequence[TimedViseme], shapes: str, ending: str, *, sound_file: str = "") -> bytes:
    """Write visemes as JSON (``.json``) or a table (``.csv``, ``.tsv``), with times to 0.1 ms.

    Azure's JSON is that of its own events, and Rhubarb's files are its own; those name the ``sound_file``.
    """
    if shapes == RHUBARB and ending != ".csv":
        cues = [MouthCue(row.name, round(row.start_s * GRID_HZ), round(row.end_s * GRID_HZ)) for row in rows]
        return format_rhubarb(cues, ending, sound_file=sound_file)
    if ending == ".json" and shapes == "azure":
        events = [{"audio_offset": round(row.start_s * TICKS_HZ), "viseme_id": int(row.name)} for row in rows]
        if rows and rows[-1].name != "0":
            events.append({"audio_offset": round(rows[-1].end_s * TICKS_HZ), "viseme_id": 0})
        return (json.dumps(events, indent=1) + "\n").encode()
    if ending == ".json":
        listed = [{"start": round(row.start_s, 4), "end": round(row.end_s, 4), "viseme": row.name} for row in rows]
        return (json.dumps(listed, indent=1) + "\n").encode()
    sign = "\t" if ending == ".tsv" else ","
    lines = [("start", "end", "viseme"), *((f"{row.start_s:.4f}", f"{row.end_s:.4f}", row.name) for row in rows)]
    return ("\n".join(map(sign.join, lines)) + "\n").encode()
