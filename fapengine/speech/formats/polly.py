"""Amazon Polly speech marks: JSON lines ``{"time": ms, "type", "value"}``; each lasts until the next of its kind."""

from fapengine.errors import DataError
from fapengine.speech.formats.documents import parse_document
from fapengine.speech.formats.entries import Entry, track_of, until_next, with_words
from fapengine.speech.phone_track import PhoneTrack


def parse_polly(data: bytes) -> PhoneTrack:
    """Read viseme marks, with the words around them if asked for; of words alone, the words.

    Raises
    ------
    DataError
        If keys lack, times fall, or there is neither viseme nor word.
    """
    onsets: dict[str, list[tuple[float, str, str]]] = {"viseme": [], "word": []}
    for mark in parse_document(data, "Polly speech marks").entries():
        kind = mark["type"].text()
        if kind in onsets:
            onsets[kind].append((mark["time"].number() / 1000, mark["value"].text(), mark.where))
        elif kind not in ("sentence", "ssml"):
            raise DataError(f"type: got {kind[:40]!r}, expected viseme, word, sentence or ssml", where=mark.where)
    visemes, words = until_next(onsets["viseme"]), until_next(onsets["word"])
    if not visemes:
        return track_of(words, "Polly speech marks", level="word", spelled=True)
    if words:  # the last word goes on to the end
        last = words[-1]
        words[-1] = Entry(last.start_s, max(last.end_s, visemes[-1].end_s), last.label, last.where)
    return track_of(with_words(visemes, words), "Polly speech marks", alphabet="polly-visemes", level="viseme")
