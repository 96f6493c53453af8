"""Alignments of recognisers and corpora with one label a line: CTM and TIMIT.

CTM (NIST; Kaldi, NeMo): ``recording channel start duration label [confidence ...]``, seconds; words or phones.
TIMIT (NIST, 1990): ``.PHN`` and ``.WRD``, ``start end label`` in samples at 16 kHz.
"""

import re

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.lines import number_at, rows_of
from fapengine.speech.formats.textgrid import decode_text
from fapengine.speech.formats.word_lists import timed_words
from fapengine.speech.phone_track import PhoneTrack

TIMIT_HZ = 16_000


def parse_ctm(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read a CTM; ``tier`` names the recording, if there are several.

    Raises
    ------
    DataError
        For a line that is none, several recordings, or phones that are only numbers.
    """
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
            raise DataError("CTM: got no label, expected one behind the times", where=f"line {number}")
        entries.append(Entry(start_s, start_s + number_at(row[3], number), label, f"line {number}"))
    if entries and all(re.fullmatch(r"\d+", entry.label) for entry in entries):
        raise UnsupportedError("CTM: got numbers of phones, expected labels; map them with phones.txt (int2sym.pl)")
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(timed_words(entries, "CTM", "one word a line"), "CTM", level="word", spelled=True)
    return track_of(entries, "CTM", alphabet=alphabet)


def parse_timit(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones or words of a TIMIT sentence.

    Raises
    ------
    DataError
        For a line that is none, with its number.
    """
    entries = [
        Entry(number_at(row[0], number) / TIMIT_HZ, number_at(row[1], number) / TIMIT_HZ, row[2], f"line {number}")
        for number, row in rows_of(data, "TIMIT", 3)
    ]
    if alphabet is None and guess(entry.label for entry in entries).words:
        return track_of(timed_words(entries, "TIMIT", "one word a line"), "TIMIT", level="word", spelled=True)
    return track_of(entries, "TIMIT", alphabet=alphabet or "arpabet")
