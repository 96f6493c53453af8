"""espeak-ng events as JSON: PHONEME marks the onset of a phone, in mnemonics of espeak-ng or in IPA.

The shape is that of ``espeak_EVENT`` (speak_lib.h, API revision 12), type by name or by number. Pauses are ``_`` and
``_:``, in IPA the empty text. A WORD event names a place in the text, if the file has the text.
"""

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.phone_sets import ESPEAK
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of, until_next
from fapengine.speech.phone_track import PhoneTrack

_TYPES = {1: "WORD", 2: "SENTENCE", 5: "END", 6: "MSG_TERMINATED", 7: "PHONEME"}
DEFAULT_RATE_HZ = 22050.0
_ADDITIONS = frozenset({"ʲ", "ʰ", "ː", ";"})
"""Events that only add to the phone before."""


def parse_espeak_events(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the events; mnemonics or IPA is guessed unless ``alphabet`` says it.

    Raises
    ------
    DataError
        If keys lack, nothing is spoken, or times are wrong.
    """
    document = parse_document(data, "espeak-ng events")
    events = document["events"] if document.has("events") else document
    rate_hz = document["samplerate"].number() if document.has("samplerate") else DEFAULT_RATE_HZ
    if rate_hz <= 0:
        raise DataError(f"samplerate: got {rate_hz:g}, expected more than 0", where="samplerate")
    text = document["text"].text() if document.has("text") else ""
    onsets: list[tuple[float, str, str]] = []
    words: list[str] = []
    word = ""
    end_s: float | None = document["samples"].number() / rate_hz if document.has("samples") else None
    for event in events.items():
        kind = _kind(event["type"])
        if kind == "WORD" and event.has("text_position", "length"):
            start, length = (int(event[key].number()) for key in ("text_position", "length"))
            word = text[start - 1 : start - 1 + length] if start > 0 else ""
        elif kind == "PHONEME":
            label = event["phoneme"].text()
            if label not in _ADDITIONS:
                onsets.append((_time_s(event, rate_hz), label, event.where))
                words.append(word)
        elif kind == "END" and end_s is None:
            end_s = _time_s(event, rate_hz)
    timed = [
        Entry(entry.start_s, entry.end_s, entry.label, entry.where, spoken)
        for entry, spoken in zip(until_next(onsets, end_s), words, strict=True)
    ]
    return track_of(timed, "espeak-ng events", alphabet=alphabet or _guess([label for _, label, _ in onsets]))


def _kind(node: Node) -> str:
    return node.text() if isinstance(node.value, str) else _TYPES.get(int(node.number()), "")


def _time_s(event: Node, rate_hz: float) -> float:
    if event.has("sample"):
        return event["sample"].number() / rate_hz
    return event.first("audio_position_ms", "audio_position").number() / 1000


def _guess(labels: list[str]) -> str:
    """IPA if more labels are IPA than mnemonics; of what both know, the longer marks decide."""
    spoken = [label for label in labels if label.strip("_:!|")]
    phones = ESPEAK
    as_ipa = sum(bool(ipa.letters(label)) and ":" not in label for label in spoken)
    mnemonic = sum(alphabets.from_set(label, phones) is not None for label in spoken)
    return "ipa" if as_ipa > mnemonic else "espeak"
