"""Words with times in JSON of other shapes: Gentle, PocketSphinx, aeneas, Inworld, Fish Audio.

Gentle (lowerquality/gentle): ``words`` with ``start``, ``end`` and ``phones`` of Kaldi's ARPAbet with durations; a word
whose ``case`` is not ``success`` has no times. PocketSphinx 5: lines of begin ``b``, duration ``d``, text ``t`` and
parts ``w``: words, in which phones lie if they were asked for. aeneas: ``fragments`` with ``begin``, ``end`` (texts)
and ``lines``.
Inworld TTS 1.5: ``timestampInfo.wordAlignment``, parallel lists, with ``phoneticDetails`` of IPA and visemes.
Fish Audio: events with ``alignment.segments``, snapshots that replace each other, and the offset of their chunk.
"""

import re
from dataclasses import replace

from fapengine.errors import DataError
from fapengine.speech.formats.documents import Node, parse_document, same_length
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.word_lists import timed_words, walk
from fapengine.speech.phone_track import PhoneTrack

INWORLD = ("timestampInfo", "result.timestampInfo", "[].timestampInfo", "[].result.timestampInfo")


def is_gentle(first: Node) -> bool:
    """Whether a document is Gentle's."""
    return any(word.has("case") or word.has("alignedWord") for word in list(walk(first, "words[]"))[:3])


def parse_gentle(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read phones, or the words where no word has phones."""
    phones: list[Entry] = []
    words: list[Entry | tuple[str, str]] = []
    for word in parse_document(data, "Gentle")["words"].items():
        text = word.first("word", "alignedWord").text()
        if not word.has("start", "end"):
            words.append((text, word.where))
            continue
        now_s, end_s = word["start"].number(), word["end"].number()
        words.append(Entry(now_s, end_s, text, word.where))
        for phone in walk(word, "phones[]"):
            until_s = now_s + phone["duration"].number()
            phones.append(Entry(now_s, until_s, phone["phone"].text(), phone.where, text))
            now_s = until_s
    if phones and len({phone.word for phone in phones}) >= sum(isinstance(word, Entry) for word in words) / 2:
        return track_of(_cut(phones), "Gentle", alphabet=alphabet or "arpabet")
    hint = "was the text the one that is spoken?"
    return track_of(timed_words(words, "Gentle", hint), "Gentle", level="word", spelled=True)


def _cut(entries: list[Entry]) -> list[Entry]:
    """Cut what is longer than the time to the next by rounding."""
    return [
        entry if later is None or not entry.start_s <= later.start_s < entry.end_s else Entry(
            entry.start_s, later.start_s, entry.label, entry.where, entry.word)
        for entry, later in zip(entries, [*entries[1:], None], strict=True)
    ]  # fmt: skip


def parse_pocketsphinx(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones, or the words where there are none."""
    phones: list[Entry] = []
    words: list[Entry | tuple[str, str]] = []
    for word in (word for line in parse_document(data, "PocketSphinx").entries() for word in walk(line, "w[]")):
        text = re.sub(r"\(\d+\)$", "", word["t"].text())  # go(2) is another pronunciation of go
        words.append(_begin_and_length(word, text))
        phones += [_begin_and_length(phone, phone["t"].text(), text) for phone in walk(word, "w[]")]
    if phones:
        spoken = [replace(phone, word="" if phone.word.startswith("<") else phone.word) for phone in phones]
        return track_of(_cut(spoken), "PocketSphinx", alphabet=alphabet or "arpabet")
    spoken_words = [word for word in words if isinstance(word, Entry) and not word.label.startswith(("<", "["))]
    return track_of(
        timed_words(spoken_words, "PocketSphinx", "align a text"), "PocketSphinx", level="word", spelled=True
    )


def _begin_and_length(node: Node, label: str, word: str = "") -> Entry:
    start_s = node["b"].number()
    return Entry(start_s, start_s + node["d"].number(), label, node.where, word)


def parse_aeneas(data: bytes) -> PhoneTrack:
    """Read the innermost fragments, which must be words."""
    words: list[Entry | tuple[str, str]] = []

    def add(fragments: Node) -> None:
        for fragment in fragments.items():
            if fragment.has("children") and fragment["children"].value:
                add(fragment["children"])
            else:
                text = " ".join(fragment["lines"].texts())
                words.append(Entry(fragment["begin"].number(), fragment["end"].number(), text, fragment.where))

    add(parse_document(data, "aeneas")["fragments"])
    hint = "align word by word: is_text_type=mplain, and its third level"
    return track_of(timed_words(words, "aeneas", hint), "aeneas", level="word", spelled=True)


def is_inworld(document: Node) -> bool:
    """Whether a document is an answer of Inworld's, whole or streamed."""
    return any(True for path in INWORLD for _ in _found(document, path))


def _found(document: Node, path: str) -> list[Node]:
    listed = isinstance(document.value, list)
    return list(walk(document, path)) if listed == path.startswith("[]") else []


def parse_inworld(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read phones; of visemes alone, the visemes; of words alone, the words."""
    document = parse_document(data, "Inworld")
    phones: list[Entry] = []
    words: list[Entry] = []
    visemes = False
    for info in (info for path in INWORLD for info in _found(document, path)):
        if not info.has("wordAlignment"):
            raise DataError("Inworld: wordAlignment is missing; ask for timestampType WORD", where=info.where)
        alignment = info["wordAlignment"]
        texts, starts_s = alignment["words"].texts(), alignment["wordStartTimeSeconds"].numbers()
        ends_s = alignment["wordEndTimeSeconds"].numbers()
        same_length(starts_s, ends_s, texts, where=alignment.where)
        words += [Entry(*row, alignment.where) for row in zip(starts_s, ends_s, texts, strict=True)]
        for detail in walk(alignment, "phoneticDetails[]"):
            index = int(detail["wordIndex"].number()) if detail.has("wordIndex") else -1
            word = texts[index].strip() if 0 <= index < len(texts) else ""
            for phone in detail["phones"].items():
                start_s = phone["startTimeSeconds"].number()
                visemes = visemes or not phone.has("phoneSymbol")
                label = phone.first("phoneSymbol", "visemeSymbol").text()
                phones.append(Entry(start_s, start_s + phone["durationSeconds"].number(), label, phone.where, word))
    if phones and visemes:
        return track_of(_cut(phones), "Inworld", alphabet="inworld-visemes", level="viseme")
    if phones:
        return track_of(_cut(phones), "Inworld", alphabet=alphabet)
    return track_of(timed_words(words, "Inworld", "ask for WORD"), "Inworld", level="word", spelled=True)


def is_fish(document: Node) -> bool:
    """Whether a document is a stream, or one answer, of Fish Audio with timestamps."""
    return any(list(walk(event, "alignment.segments[]")) for event in document.entries()[:200])


def parse_fish(data: bytes) -> PhoneTrack:
    """Read the last alignment of every chunk, each from the offset of its chunk."""
    chunks: dict[float, list[Entry]] = {}
    for event in parse_document(data, "Fish Audio").entries():
        if event.has("alignment"):
            number = event["chunk_seq"].number() if event.has("chunk_seq") else 0.0
            offset_s = event["chunk_audio_offset_sec"].number() if event.has("chunk_audio_offset_sec") else 0.0
            chunks[number] = [
                Entry(offset_s + row["start"].number(), offset_s + row["end"].number(), row["text"].text(), row.where)
                for row in event["alignment"]["segments"].items()
            ]
    words = [word for number in sorted(chunks) for word in chunks[number]]
    return track_of(timed_words(words, "Fish Audio", "ask for words"), "Fish Audio", level="word", spelled=True)
