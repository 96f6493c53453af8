"""VOICEVOX audio query (engine 0.14 and later): morae with the lengths of consonant and vowel, in seconds."""

from fapengine.errors import DataError
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.phone_track import PhoneTrack


def parse_voicevox(data: bytes) -> PhoneTrack:
    """Read a query; all lengths are divided by ``speedScale``, pauses multiplied by ``pauseLengthScale``.

    Raises
    ------
    DataError
        If keys lack, a length is negative, or a scale is not positive.
    """
    query = parse_document(data, "VOICEVOX")
    speed = _scale(query, "speedScale")
    pauses = _scale(query, "pauseLengthScale")
    pieces = [_piece(query, "prePhonemeLength", "pau")] if query.has("prePhonemeLength") else []
    for phrase in query["accent_phrases"].items():
        for mora in phrase["moras"].items():
            text = mora["text"].text() if mora.has("text") else ""
            if mora.has("consonant"):
                pieces.append(_piece(mora, "consonant_length", mora["consonant"].text(), text))
            pieces.append(_piece(mora, "vowel_length", mora["vowel"].text(), text))
        if phrase.has("pause_mora"):
            label, length_s, where, text = _piece(phrase["pause_mora"], "vowel_length", "pau")
            if query.has("pauseLength"):
                length_s = query["pauseLength"].number()
            pieces.append((label, length_s * pauses, where, text))
    if query.has("postPhonemeLength"):
        pieces.append(_piece(query, "postPhonemeLength", "pau"))
    entries: list[Entry] = []
    now_s = 0.0
    for label, length_s, where, text in pieces:
        if length_s < 0:
            raise DataError(f"length: got {length_s:g} s, expected 0 or more", where=where)
        entries.append(Entry(now_s, now_s + length_s / speed, label, where, text))
        now_s += length_s / speed
    return track_of(entries, "VOICEVOX", alphabet="voicevox")


def _piece(node: Node, key: str, label: str, text: str = "") -> tuple[str, float, str, str]:
    return label, node[key].number(), node[key].where, text


def _scale(query: Node, key: str) -> float:
    scale = query[key].number() if query.has(key) else 1.0
    if not 0.01 <= scale <= 100:
        raise DataError(f"{key}: got {scale:g}, expected 0.01..100", where=key)
    return scale
