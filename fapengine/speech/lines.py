"""Formats of one label a line: HTK, Festival, MARY, GRID, flite, MFA's CSV, Rhubarb's TSV.

============ ============================ ==========================================================
format       line                         source
============ ============================ ==========================================================
HTK          ``start end label [score]``  HTK Book 3.4, section 6.2.1; 100 ns; seconds if with a point
Festival     ``end colour label``         ESPS xlabel, after a line ``#``; seconds
MARY         the same, colour 125         MaryTTS 5.2, REALISED_DURATIONS; SAMPA
GRID         ``start end word``           GRID corpus, ``.align``; samples at 25 kHz
flite        ``phone:end`` in one line    flite ``-psdur``; seconds
MFA CSV      Begin,End,Label,Type,Speaker Montreal Forced Aligner 3; seconds
Rhubarb TSV  ``start<TAB>shape``          Rhubarb Lip Sync 1.14; seconds, the last line is the end
============ ============================ ==========================================================
"""

import csv
import math
import re

from fapengine.errors import DataError
from fapengine.speech.entries import Entry, track_of, until_next, with_words
from fapengine.speech.guess import guess
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.textgrid import decode_text

HTK_HZ = 1e7
"""Units of 100 ns."""
GRID_HZ = 25_000
_FULL_CONTEXT = re.compile(r"^[^-]*\^?[^-]*-([^+]+)\+")


def _number(text: str, line: int) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"time: got {text[:40]!r}, expected a number", where=f"line {line}")
    return value


def _rows(data: bytes, what: str, fields: int) -> list[tuple[int, list[str]]]:
    """Split into lines that hold something, with their numbers; each has at least so many fields."""
    rows = [(n, line.split(None, fields)) for n, line in enumerate(decode_text(data, what).splitlines(), 1)]
    rows = [(number, row) for number, row in rows if row]
    for number, row in rows:
        if len(row) < fields and row != ["#"]:
            raise DataError(f"{what}: got {' '.join(row)[:40]!r}, expected {fields} fields", where=f"line {number}")
    return rows


def _lab_track(entries: list[Entry], what: str, alphabet: str | None) -> PhoneTrack:
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(entries, what, level="word", spelled=True)
    return track_of(entries, what, alphabet=alphabet)


def parse_htk(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read an HTK label file; of a full-context label ``a^b-c+d=e`` the phone is c.

    Raises
    ------
    DataError
        For a line that is none, with its number.
    """
    entries: list[Entry] = []
    for number, row in _rows(data, ".lab", 3):
        rate_hz = 1.0 if "." in row[0] + row[1] else HTK_HZ
        start_s, end_s = (_number(text, number) / rate_hz for text in row[:2])
        context = _FULL_CONTEXT.match(row[2])
        entries.append(Entry(start_s, end_s, context[1] if context else row[2], f"line {number}"))
    return _lab_track(entries, ".lab", alphabet)


def parse_xlabel(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read a Festival or MARY label file: after ``#``, each line gives an *end*.

    Raises
    ------
    DataError
        For a line that is none, or if there is no ``#``.
    """
    text = decode_text(data, ".lab")
    header, pieces, _ = text.partition("#")
    if not pieces:
        raise DataError("xlabel: got no line with # alone, expected one above the labels")
    blank = "\n" * header.count("\n") + "#" + text[len(header) + 1 :]
    entries: list[Entry] = []
    now_s = 0.0
    for number, row in _rows(blank.encode("utf-8", "replace"), ".lab", 3):
        if row != ["#"]:
            end_s = _number(row[0], number)
            entries.append(Entry(now_s, end_s, row[2].split(";")[0].strip() or "_", f"line {number}"))
            now_s = end_s
    return _lab_track(entries, ".lab", alphabet)


def parse_align(data: bytes) -> PhoneTrack:
    """Read a GRID alignment: words, in samples at 25 kHz.

    Raises
    ------
    DataError
        For a line that is none, with its number.
    """
    entries = [
        Entry(_number(row[0], number) / GRID_HZ, _number(row[1], number) / GRID_HZ, row[2], f"line {number}")
        for number, row in _rows(data, ".align", 3)
    ]
    return track_of(entries, ".align", level="word", spelled=True)


def parse_flite(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read what ``flite -psdur`` prints: ``phone:end`` with blanks between.

    Raises
    ------
    DataError
        For a piece that is none, with its number.
    """
    entries: list[Entry] = []
    now_s = 0.0
    for count, piece in enumerate(decode_text(data, "flite").split(), start=1):
        label, _, end = piece.rpartition(":")
        try:
            end_s = float(end)
        except ValueError:
            end_s = math.nan
        entries.append(Entry(now_s, end_s, label or "_", f"piece {count}"))
        now_s = end_s
    return _lab_track(entries, "flite", alphabet)


def parse_mfa_csv(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the CSV of the Montreal Forced Aligner; ``tier`` names the speaker, if there are several.

    Raises
    ------
    DataError
        If columns lack, several speakers speak, or times are wrong.
    """
    lines = decode_text(data, "MFA CSV").splitlines()
    try:
        rows = list(csv.DictReader(lines))
    except csv.Error as error:
        raise DataError(f"MFA CSV: {error}") from error
    wanted = ("Begin", "End", "Label", "Type", "Speaker")
    if not rows or any(name not in rows[0] for name in wanted):
        raise DataError(f"MFA CSV: got {lines[:1]}, expected the header {','.join(wanted)}", where="line 1")
    texts = [(number, {name: row[name] or "" for name in wanted}) for number, row in enumerate(rows, start=2)]
    speakers = sorted({row["Speaker"] for _, row in texts})
    if len(speakers) > 1 and tier not in speakers:
        raise DataError(f"MFA CSV: got the speakers {speakers}, expected one; name one with tier=NAME")
    spoken = [(n, row) for n, row in texts if len(speakers) == 1 or row["Speaker"] == tier]
    timed = {
        kind: [
            Entry(_number(row["Begin"], n), _number(row["End"], n), row["Label"], f"line {n}")
            for n, row in spoken
            if row["Type"] == kind
        ]
        for kind in ("phones", "words")
    }
    return track_of(with_words(timed["phones"], timed["words"]), "MFA CSV", alphabet=alphabet)


def parse_rhubarb_tsv(data: bytes) -> PhoneTrack:
    """Read Rhubarb's TSV: starts and mouth shapes; the last line only says where the recording ends.

    Raises
    ------
    DataError
        For a line that is none, with its number.
    """
    onsets = [(_number(row[0], number), row[1], f"line {number}") for number, row in _rows(data, "Rhubarb TSV", 2)]
    if len(onsets) < 2:
        raise DataError("Rhubarb TSV: got fewer than two lines, expected a shape and the end")
    entries = until_next(onsets[:-1], onsets[-1][0])
    return track_of(entries, "Rhubarb TSV", alphabet="rhubarb-shapes", level="viseme")
