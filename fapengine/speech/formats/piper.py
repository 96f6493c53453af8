"""Piper phoneme alignments: IPA code points, each with its length in seconds or samples.

Shapes: ``{"phoneme", "seconds"}`` (Piper's HTTP server, GET /info, ``last.alignments``), ``PhonemeAlignment`` of
``piper.voice`` (``phoneme``, ``num_samples``, with ``sample_rate`` beside the list), Piper 1.3. A code point that only
marks (stress, length, tie) belongs to its neighbour; blanks, punctuation, ``^`` and ``$`` are pauses.
"""

import unicodedata
from collections.abc import Iterable, Iterator

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.phone_track import PhoneTrack

LIST_KEYS = ("phoneme_alignments", "alignments")


def parse_piper(data: bytes) -> PhoneTrack:
    """Read the alignments of one or several sentences, one behind the other.

    Raises
    ------
    DataError
        If keys lack, a length is negative, or samples come without a rate.
    """
    chunks = _chunks(parse_document(data, "Piper alignments"))
    return track_of(entries_of(_lengths(chunks)), "Piper alignments", alphabet="ipa")


def entries_of(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
    """Put code points one behind the other, each (label, length in s, where), and join those that only mark."""
    entries: list[Entry] = []
    now_s = 0.0
    stress = ""
    for label, length_s, where in lengths:
        stress_mark, kind = label in ipa.STRESS, unicodedata.category(label[:1] or " ")
        if stress_mark or (entries and kind in ("Mn", "Lm", "Sk", "Cf")):
            stress = label if stress_mark else stress
            _lengthen(entries, now_s + length_s, "" if stress_mark else label)
        else:
            silent = not label or kind[0] in "PZSC"
            entries.append(Entry(now_s, now_s + length_s, "_" if silent else stress + label, where))
            stress = stress if silent else ""
        now_s += length_s
    return entries


def _lengths(chunks: Iterable[Node]) -> Iterator[tuple[str, float, str]]:
    for chunk in chunks:
        rate_hz = chunk["sample_rate"].number() if chunk.has("sample_rate") else 0.0
        for item in (chunk.first(*LIST_KEYS) if not isinstance(chunk.value, list) else chunk).items():
            yield item["phoneme"].text(), _length_s(item, rate_hz), item.where


def _chunks(document: Node) -> list[Node]:
    if document.has("last"):
        document = document["last"]
    if not isinstance(document.value, list):
        return [document]
    chunks = document.entries()
    return chunks if chunks and any(chunks[0].has(key) for key in LIST_KEYS) else [document]


def _length_s(item: Node, rate_hz: float) -> float:
    if item.has("seconds"):
        length_s = item["seconds"].number()
    elif rate_hz > 0:
        length_s = item["num_samples"].number() / rate_hz
    else:
        raise DataError("got no seconds and no sample_rate, expected one of them", where=item.where)
    if length_s < 0:
        raise DataError(f"length: got {length_s:g} s, expected 0 or more", where=item.where)
    return length_s


def _lengthen(entries: list[Entry], end_s: float, mark: str) -> None:
    """Let the last entry last on; before the first phone there is none, and the time is a pause."""
    if entries:
        last = entries[-1]
        entries[-1] = Entry(last.start_s, end_s, last.label + mark if last.label != "_" else "_", last.where)
    else:
        entries.append(Entry(0.0, end_s, "_", "the first mark"))
