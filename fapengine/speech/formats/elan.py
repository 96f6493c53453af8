"""ELAN annotations, ``.eaf`` (Max Planck Institute for Psycholinguistics, EAF schema 3.0): tiers of labels with times.

Annotations that refer to others have no times of their own and are left out, as are those whose time slots have none.
The language of a tier is that of ``LANG_REF``, else ``DEFAULT_LOCALE``, else the only ``LANGUAGE`` of the document.
"""

from xml.etree.ElementTree import Element

from fapengine.errors import DataError
from fapengine.speech.formats.documents import number_of, parse_xml
from fapengine.speech.formats.textgrid import Tier, track_of_tiers
from fapengine.speech.phone_track import PhoneTrack


def parse_elan(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones, else the words of a document; tiers are chosen as in a TextGrid."""
    root = parse_xml(data, "ELAN")
    slots_ms = {slot.get("TIME_SLOT_ID", ""): slot.get("TIME_VALUE") for slot in root.iter("TIME_SLOT")}
    known = [row.get("LANG_ID", "") for row in root.iter("LANGUAGE")]
    tiers = [_tier(element, slots_ms, known[0] if len(known) == 1 else "") for element in root.iter("TIER")]
    found = tuple(each for each in tiers if each.intervals)
    if not found:
        raise DataError("ELAN: contains no annotation with times")
    return track_of_tiers(found, "ELAN", tier, alphabet)


def _tier(element: Element, slots_ms: dict[str, str | None], language: str) -> Tier:
    name = element.get("TIER_ID", "")
    intervals = []
    for number, row in enumerate(element.iter("ALIGNABLE_ANNOTATION"), start=1):
        where = f"tier {name!r}, annotation {number}"
        times = [slots_ms.get(row.get(f"TIME_SLOT_REF{end}", "")) for end in (1, 2)]
        if None not in times:
            start_s, end_s = (number_of(str(time), "time", where) / 1000 for time in times)
            intervals.append((start_s, end_s, (row.findtext("ANNOTATION_VALUE") or "").strip()))
    intervals.sort(key=lambda row: row[:2])
    return Tier(name, tuple(intervals), element.get("LANG_REF") or element.get("DEFAULT_LOCALE") or language)
