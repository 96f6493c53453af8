"""Rhubarb Lip Sync 1.14: mouth cues as JSON or XML (its TSV is in :mod:`fapengine.speech.formats.lines`).

Cues of ports of Rhubarb overlap; as in the TSV form, the start of a cue ends the one before.
"""

import math
from xml.etree import ElementTree

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.formats.documents import parse_document
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.phone_track import PhoneTrack


def parse_rhubarb_json(data: bytes) -> PhoneTrack:
    """Read ``{"mouthCues": [{"start", "end", "value"}]}``.

    Raises
    ------
    DataError
        If keys lack or times fall.
    """
    cues = parse_document(data, "Rhubarb JSON")["mouthCues"]
    return _track([Entry(c["start"].number(), c["end"].number(), c["value"].text(), c.where) for c in cues.items()])


def parse_rhubarb_xml(data: bytes) -> PhoneTrack:
    """Read ``<mouthCue start= end=>shape</mouthCue>``.

    Raises
    ------
    DataError
        If it is no such XML.
    """
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise UnsupportedError("Rhubarb XML: got a document type or entities, expected none")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DataError(f"Rhubarb XML: no XML here ({error})") from error
    entries: list[Entry] = []
    for number, cue in enumerate(root.iter("mouthCue"), start=1):
        where = f"mouthCue {number}"
        start_s, end_s = (_attribute(cue, name, where) for name in ("start", "end"))
        entries.append(Entry(start_s, end_s, (cue.text or "").strip(), where))
    return _track(entries)


def _attribute(cue: ElementTree.Element, name: str, where: str) -> float:
    try:
        value = float(cue.get(name, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"{name}: got {cue.get(name)!r}, expected a number of seconds", where=where)
    return value


def _track(cues: list[Entry]) -> PhoneTrack:
    cues = sorted(cues, key=lambda cue: cue.start_s)
    cut: list[Entry] = []
    for index, cue in enumerate(cues):
        end_s = min([cue.end_s, *(later.start_s for later in cues[index + 1 : index + 2])])
        cut.append(Entry(cue.start_s, end_s, cue.label, cue.where))
    return track_of(cut, "Rhubarb", alphabet="rhubarb-shapes", level="viseme")
