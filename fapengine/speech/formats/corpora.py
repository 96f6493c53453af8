"""Timings of aligners and corpora: formats with one label a line, and the JSON of the Montreal Forced Aligner.

============ ============================== ==========================================================
format       line                           source
============ ============================== ==========================================================
HTK          ``start end label [score]``    HTK Book 3.4, section 6.2.1; 100 ns; seconds if with a point
Festival     ``end colour label``           ESPS xlabel, after a line ``#``; seconds
MARY         the same, colour 125           MaryTTS 5.2, REALISED_DURATIONS; SAMPA
GRID         ``start end word``             GRID corpus, ``.align``; samples at 25 kHz
flite        ``phone:end`` in one line      flite ``-psdur``; seconds
MFA CSV      Begin,End,Label,Type,Speaker   Montreal Forced Aligner 3; seconds
Rhubarb TSV  ``start<TAB>shape``            Rhubarb Lip Sync 1.14; seconds, the last line is the end
CTM          ``recording channel start``    NIST; Kaldi, NeMo; seconds; words or phones
             ``duration label [confid...]``
TIMIT        ``start end label``            NIST, 1990, ``.PHN`` and ``.WRD``; samples at 16 kHz
============ ============================== ==========================================================

MFA 3 as JSON: tiers of ``[begin, end, label]`` in seconds, as praatio writes them.
"""

import csv
import math
import re

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of, until_next, with_words
from fapengine.speech.formats.textgrid import PHONE_TIERS, WORD_TIERS, Tier, choose_tier, decode_text
from fapengine.speech.formats.word_lists import timed_words
from fapengine.speech.phone_track import PhoneTrack

HTK_HZ = 1e7
"""Units of 100 ns."""
GRID_HZ = 25_000
MAX_SAMPLES = 1_000_000
"""Largest whole number that is too small for HTK's units: 0.1 s."""
_FULL_CONTEXT = re.compile(r"^[^-]*\^?[^-]*-([^+]+)\+")


def number_at(text: str, line: int) -> float:
    """Return the finite number in a field."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"time: got {text[:40]!r}, expected a number", where=f"line {line}")
    return value


def rows_of(data: bytes, what: str, fields: int) -> list[tuple[int, list[str]]]:
    """Split into lines that hold something, with their numbers; each has at least so many fields."""
    rows = [(n, line.split(None, fields)) for n, line in enumerate(decode_text(data, what).splitlines(), 1)]
    rows = [(number, row) for number, row in rows if row]
    for number, row in rows:
        if len(row) < fields:
            raise DataError(f"{what}: got {' '.join(row)[:40]!r}, expected {fields} fields", where=f"line {number}")
    return rows


def _lab_track(entries: list[Entry], what: str, alphabet: str | None) -> PhoneTrack:
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(entries, what, level="word", spelled=True)
    return track_of(entries, what, alphabet=alphabet)


def parse_htk(data: bytes, *, alphabet: str | None = None, rate_hz: float | None = None) -> PhoneTrack:
    """Read an HTK label file; of a full-context label ``a^b-c+d=e`` the phone is c.

    Parameters
    ----------
    data : bytes
        The file. Point labels, which begin where they end, last until the next.
    alphabet : str, optional
        Of the labels; by default guessed.
    rate_hz : float, optional
        Rate of the samples that whole numbers count; by default they are units of 100 ns.
    """
    entries: list[Entry] = []
    rows = rows_of(data, ".lab", 3)
    whole = not any("." in row[0] + row[1] for _, row in rows)
    longest = max((number_at(row[1], number) for number, row in rows), default=0.0)
    if whole and rate_hz is None and len(rows) > 1 and 1000 < longest < MAX_SAMPLES:
        raise DataError(
            f".lab: got whole numbers up to {longest:g}, {1000 * longest / HTK_HZ:.0f} ms in HTK's units of 100 ns;"
            " are they samples? say their rate with columns='hz=16000'"
        )
    for number, row in rows:
        rate_hz = rate_hz if whole and rate_hz else HTK_HZ if whole else 1.0
        start_s, end_s = (number_at(text, number) / rate_hz for text in row[:2])
        context = _FULL_CONTEXT.match(row[2])
        entries.append(Entry(start_s, end_s, context[1] if context else row[2], f"line {number}"))
    if len(entries) > 1 and all(entry.start_s == entry.end_s for entry in entries):
        entries = until_next([(entry.start_s, entry.label, entry.where) for entry in entries])
    if all(re.fullmatch(r"f\d{6}", entry.label) for entry in entries):
        raise DataError(".lab: got the numbers of fragments (aeneas), expected labels; write JSON from aeneas instead")
    return _lab_track(entries, ".lab", alphabet)


def parse_xlabel(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read a Festival or MARY label file: after ``#``, each line gives an *end*."""
    text = decode_text(data, ".lab")
    header, pieces, _ = text.partition("#")
    if not pieces:
        raise DataError("xlabel: the line with # alone, above the labels, is missing")
    blank = "\n" * header.count("\n") + text[len(header) + 1 :]
    entries: list[Entry] = []
    now_s = 0.0
    for number, row in rows_of(blank.encode("utf-8", "replace"), ".lab", 3):
        end_s = number_at(row[0], number)
        entries.append(Entry(now_s, end_s, row[2].split(";")[0].strip() or "_", f"line {number}"))
        now_s = end_s
    return _lab_track(entries, ".lab", alphabet)


def parse_align(data: bytes) -> PhoneTrack:
    """Read a GRID alignment: words, in samples at 25 kHz."""
    entries = [
        Entry(number_at(row[0], number) / GRID_HZ, number_at(row[1], number) / GRID_HZ, row[2], f"line {number}")
        for number, row in rows_of(data, ".align", 3)
    ]
    return track_of(entries, ".align", level="word", spelled=True)


def parse_flite(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read what ``flite -psdur`` prints: ``phone:end`` with blanks between."""
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
    """Read the CSV of the Montreal Forced Aligner; ``tier`` names the speaker, if there are several."""
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
            Entry(number_at(row["Begin"], n), number_at(row["End"], n), row["Label"], f"line {n}")
            for n, row in spoken
            if row["Type"] == kind
        ]
        for kind in ("phones", "words")
    }
    return track_of(with_words(timed["phones"], timed["words"]), "MFA CSV", alphabet=alphabet)


def parse_rhubarb_tsv(data: bytes) -> PhoneTrack:
    """Read Rhubarb's TSV: starts and mouth shapes; the last line only says where the recording ends."""
    onsets = [(number_at(row[0], number), row[1], f"line {number}") for number, row in rows_of(data, "Rhubarb TSV", 2)]
    if len(onsets) < 2:
        raise DataError("Rhubarb TSV: got fewer than two lines, expected a shape and the end")
    entries = until_next(onsets[:-1], onsets[-1][0])
    return track_of(entries, "Rhubarb TSV", alphabet="rhubarb-shapes", level="viseme")


TIMIT_HZ = 16_000


def parse_ctm(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read a CTM; ``tier`` names the recording, if there are several."""
    said = re.sub("^;;.*$", "", decode_text(data, "CTM"), flags=re.MULTILINE)
    rows = rows_of(said.encode(), "CTM", 5)
    recordings = sorted({row[0] for _, row in rows})
    if len(recordings) > 1 and tier not in recordings:
        raise DataError(f"CTM: got the recordings {recordings[:8]}, expected one; name one with tier=NAME")
    spoken = [(number, row) for number, row in rows if len(recordings) == 1 or row[0] == tier]
    entries: list[Entry] = []
    for number, row in spoken:
        if len(row) < 5:
            raise DataError(
                f"CTM: got {row}, expected recording, channel, start, length, label", where=f"line {number}"
            )
        start_s = number_at(row[2], number)
        label = next(iter(row[4].split()), "")
        if not label:
            raise DataError("CTM: label is missing after the times", where=f"line {number}")
        entries.append(Entry(start_s, start_s + number_at(row[3], number), label, f"line {number}"))
    if entries and all(re.fullmatch(r"\d+", entry.label) for entry in entries):
        raise UnsupportedError("CTM: got numbers of phones, expected labels; map them with phones.txt (int2sym.pl)")
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(timed_words(entries, "CTM", "one word a line"), "CTM", level="word", spelled=True)
    return track_of(entries, "CTM", alphabet=alphabet)


def parse_timit(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones or words of a TIMIT sentence."""
    entries = [
        Entry(number_at(row[0], number) / TIMIT_HZ, number_at(row[1], number) / TIMIT_HZ, row[2], f"line {number}")
        for number, row in rows_of(data, "TIMIT", 3)
    ]
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(timed_words(entries, "TIMIT", "one word a line"), "TIMIT", level="word", spelled=True)
    return track_of(entries, "TIMIT", alphabet=alphabet or "arpabet")


def parse_mfa_json(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the aligner's JSON; the tier is found as in a TextGrid."""
    tiers = parse_document(data, "MFA JSON")["tiers"]
    if not isinstance(tiers.value, dict):
        raise DataError(f"tiers: got {ascii(tiers.value)[:40]}, expected an object of tiers", where="tiers")
    names = tuple(Tier(str(name), ()) for name in tiers.value)
    phones = _entries(tiers, choose_tier(names, tier, PHONE_TIERS, "phones").name)
    try:
        words = _entries(tiers, choose_tier(names, None, WORD_TIERS, "words").name)
    except DataError:
        words = []
    return track_of(with_words(phones, words), "MFA JSON", alphabet=alphabet)


def _entries(tiers: Node, name: str) -> list[Entry]:
    entries: list[Entry] = []
    for row in tiers[name]["entries"].items():
        cells = list(row.items())
        if len(cells) != 3:
            raise DataError(f"entry: got {len(cells)} values, expected begin, end, label", where=row.where)
        entries.append(Entry(cells[0].number(), cells[1].number(), cells[2].text(), row.where))
    return entries
