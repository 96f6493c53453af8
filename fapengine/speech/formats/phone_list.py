"""Lists of phones as many small tools write them in JSON: wrappers of PocketSphinx, piper-plus, FastSpeech 2.

``{"phones": [...]}`` or ``{"phonemes": [...]}`` of objects with a label (``phone``, ``phoneme``, ``label``), and
``start`` and ``end`` in seconds or ``offset`` and ``duration`` in ms; a ``word`` if known.
"""

from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.phone_track import PhoneTrack

LISTS = ("phones", "phonemes")
LABELS = ("phone", "phoneme", "label")
_BORDERS = frozenset({"<sos/eos>", "<sos>", "<eos>", "<s>", "</s>", "<blank>", ".", ",", ";", ":", "!"})


def parse_phone_list(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the list.

    Raises
    ------
    DataError
        If keys lack or times are wrong.
    """
    entries = [_entry(item) for item in parse_document(data, "list of phones").first(*LISTS).items()]
    return track_of(entries, "list of phones", alphabet=alphabet)


def _entry(item: Node) -> Entry:
    label = item.first(*LABELS).text()
    if item.has("start"):
        start_s, end_s = item["start"].number(), item["end"].number()
    else:
        start_s = item["offset"].number() / 1000
        end_s = start_s + item["duration"].number() / 1000
    word = item["word"].text() if item.has("word") else ""
    return Entry(start_s, end_s, "_" if label in _BORDERS else label, item.where, word)
