"""Timings of text-to-speech services: Azure, Amazon Polly, ElevenLabs, Cartesia, Inworld, Fish Audio, Hume, Resemble.

Azure Speech viseme events (SDK ``VisemeReceived``): onset in ticks of 100 ns, or in another unit by the program that
stored it, and one of 22 ids, as JSON (lines).

Amazon Polly speech marks: JSON lines ``{"time": ms, "type", "value"}``; each lasts until the next of its kind.

ElevenLabs (2026-07): REST ``characters`` with starts and ends in seconds; WebSocket and agents ``chars`` with starts
and lengths in ms, counted from the beginning of each chunk; forced alignment ``words`` of ``text``, ``start``, ``end``.
Cartesia Sonic (2026): ``phoneme_timestamps`` in IPA and ``word_timestamps``. Characters are joined into words, because
a character has no pronunciation of its own until the word is pronounced.
Inworld TTS 1.5: ``timestampInfo.wordAlignment``, parallel lists, with ``phoneticDetails`` of IPA and visemes.
Fish Audio: events with ``alignment.segments``, snapshots that replace each other, and the offset of their chunk.
Hume Octave 2: ``timestamp`` messages, or ``timestamps`` of snippets: ``type`` (word, phoneme), ``text`` (IPA), ``time``
in ms (dev.hume.ai, "Timestamps Guide"; types of hume-python-sdk).
Resemble AI: lists ``graph_chars`` and ``phon_chars`` (IPA) with pairs of times in s that overlap (docs.resemble.ai).
"""

import re
from collections.abc import Iterator
from dataclasses import replace

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech import ipa
from fapengine.speech.formats.documents import Node, only_name, parse_document, rows_of_lists, walk
from fapengine.speech.formats.entries import OVERLAP_S, Entry, track_of, until_next, with_words, without_overlaps
from fapengine.speech.formats.table import UNITS, list_in, parse_columns, plain_name, unit_in
from fapengine.speech.formats.word_lists import words_track
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.plausible import likely_unit

TICKS_HZ = 1e7
"""Ticks of Azure's offsets per second."""
OFFSETS = ("audiooffset", "privaudiooffset", "offset", "time", "timestamp", "start")
IDS = ("visemeid", "privvisemeid", "viseme", "id")
"""Keys of the SDKs for Python, C#, JavaScript, of the REST batch result, and of programs that store the events; spelled
as :func:`.table.plain_name` does."""
MAX_ID = 21
_OTHER_KEYS = frozenset({"end", "text", "word", "phoneme", "phone", "label", "nbest", "displaytext", "duration"})


def azure_keys(event: Node) -> tuple[str, str] | None:
    """Keys of the offset and the viseme of an event of Azure; None for anything else."""
    if not isinstance(event.value, dict):
        return None
    keys = {plain_name(str(key)): str(key) for key in reversed(event.value)}
    offset, viseme = (next((keys[name] for name in names if name in keys), None) for names in (OFFSETS, IDS))
    if offset is None or viseme is None or not _OTHER_KEYS.isdisjoint(keys):
        return None
    numbered = re.fullmatch(r"\d{1,2}(\.0)?", str(event[viseme].value))
    return (offset, viseme) if numbered and float(numbered[0]) <= MAX_ID else None


def azure_events(document: Node) -> list[Node]:
    """Events of a document, in the list that it is or contains, or alone; empty for documents of other tools."""
    alone = isinstance(document.value, dict) and (document.has("BlendShapes") or azure_keys(document))
    try:
        events = [document] if alone else list(list_in(document).items())
    except DataError:
        return []
    return events if events and (events[0].has("BlendShapes") or azure_keys(events[0])) else []


def parse_azure(data: bytes, *, columns: str | None = None) -> PhoneTrack:
    """Read the viseme events; each lasts until the next.

    The SDK counts ticks of 100 ns, but programs mostly store milliseconds. ``columns`` says which (``unit=ms``), or the
    key does (``offset_ms``); otherwise the distances tell.
    """
    events = azure_events(parse_document(data, "Azure visemes"))
    if any(event.has("BlendShapes") for event in events):
        raise UnsupportedError(
            "Azure: got blend-shape frames (55 weights at 60 Hz), expected viseme events; frames are a motion, not"
            " phones: `fapengine render` and `convert` take them"
        )
    if not events:
        raise DataError(
            "Azure visemes: contains no event with an offset (audio_offset) and an id of 0 to 21 (viseme_id)"
        )
    offset, viseme = azure_keys(events[0]) or ("", "")
    times = [event.first(offset).number() for event in events]
    unit_s = parse_columns(columns).unit_s or unit_in(offset)
    remarks: tuple[str, ...] = ()
    if unit_s is None:
        whole = all(time == int(time) for time in times)
        unit = likely_unit(times, {name: UNITS[name] for name in ("ticks", "ms", "s")[0 if whole else 1 :]})
        unit_s = UNITS[unit]
        if unit != "ticks":
            remarks = (f"Azure visemes: {offset!r} read in {unit}, by its distances; the SDK's unit is 100 ns:"
                       f" columns='unit=ticks', or columns='unit={unit}' if {unit} is right",)  # fmt: skip
    onsets = [
        (time * unit_s, f"{event.first(viseme).number():g}", event.where)
        for time, event in zip(times, events, strict=True)
    ]
    return track_of(until_next(onsets), "Azure visemes", alphabet="azure-visemes", level="viseme", remarks=remarks)


def parse_polly(data: bytes) -> PhoneTrack:
    """Read the viseme marks, with the words around them if they were requested; without visemes, the words."""
    onsets: dict[str, list[tuple[float, str, str]]] = {"viseme": [], "word": []}
    for mark in parse_document(data, "Polly speech marks").entries():
        kind = mark["type"].text()
        if kind in onsets:
            onsets[kind].append((mark["time"].number() / 1000, mark["value"].text(), mark.where))
        elif kind not in ("sentence", "ssml"):
            raise DataError(f"type: got {kind[:40]!r}, expected viseme, word, sentence or ssml", where=mark.where)
    visemes, words = until_next(onsets["viseme"]), until_next(onsets["word"])
    if not visemes and not words:
        raise DataError("Polly speech marks: got sentences alone, expected visemes: request the types viseme and word")
    if not visemes:
        return track_of(words, "Polly speech marks", level="word", spelled=True)
    if words:  # the last word lasts to the end
        words[-1] = replace(words[-1], end_s=max(words[-1].end_s, visemes[-1].end_s))
    return track_of(with_words(visemes, words), "Polly speech marks", alphabet="polly-visemes", level="viseme")


ALIGNMENTS = ("normalized_alignment", "normalizedAlignment", "alignment")
"""The spoken text first: in it, numbers are written out."""
CHARACTERS = ("characters", "chars")
SECONDS = ("character_start_times_seconds", "character_end_times_seconds")
STARTS_MS = ("charStartTimesMs", "char_start_times_ms", "charsStartTimesMs")
LENGTHS_MS = ("charDurationsMs", "char_durations_ms", "charsDurationsMs")
TIMESTAMPS = {"phoneme_timestamps": "phonemes", "word_timestamps": "words"}
"""Cartesia's keys of timings, and of the texts within."""


def parse_elevenlabs(data: bytes) -> PhoneTrack:
    """Read one alignment, the chunks of a stream, or a forced alignment.

    A chunk that begins before the one before ends counts from that end.
    """
    document = parse_document(data, "ElevenLabs")
    if document.has("words"):
        words = [
            Entry(word["start"].number(), word["end"].number(), word["text"].text(), word.where)
            for word in document["words"].items()
            if word["text"].text().strip()
        ]
        return track_of(words, "ElevenLabs", level="word", spelled=True)
    characters: list[Entry] = []
    for chunk in document.entries():
        inner = chunk.first(*ALIGNMENTS) if any(chunk.has(key) for key in ALIGNMENTS) else chunk
        if any(inner.has(key) for key in CHARACTERS):  # the last chunk of a stream has none
            added = characters_of(inner)
            before_s = characters[-1].end_s if characters else 0.0
            shift_s = before_s if added and added[0].start_s < before_s - OVERLAP_S else 0.0
            characters += [replace(each, start_s=each.start_s + shift_s, end_s=each.end_s + shift_s) for each in added]
    return track_of(words_of(characters), "ElevenLabs", level="character", spelled=True)


def characters_of(node: Node) -> list[Entry]:
    """Characters of one alignment of ElevenLabs, timed in seconds or in milliseconds."""
    key = next((key for key in CHARACTERS if node.has(key)), CHARACTERS[0])
    if node.has(SECONDS[0]):
        rows = rows_of_lists(node, key, *SECONDS)
    else:
        starts, lengths = (next((key for key in keys if node.has(key)), keys[0]) for keys in (STARTS_MS, LENGTHS_MS))
        rows = [
            (start_ms / 1000, start_ms / 1000 + length_ms / 1000, text)
            for start_ms, length_ms, text in rows_of_lists(node, key, starts, lengths)
        ]
    return [Entry(*row, f"{node.where}[{index}]") for index, row in enumerate(rows)]


def words_of(characters: list[Entry]) -> list[Entry]:
    """Join characters into words; anything but letters, digits, apostrophes and hyphens separates them.

    What square brackets enclose is a tag of Eleven v3, which is not spoken.

    Examples
    --------
    >>> [word.label for word in words_of([Entry(i, i + 1, c, "") for i, c in enumerate("[laughs] it's so.")])]
    ["it's", 'so']
    """
    text = "".join(character.label[:1] or " " for character in characters)
    tagged = {place for tag in re.finditer(r"\[[^][]*\]", text) for place in range(*tag.span())}
    words: list[Entry] = []
    inside = False
    for place, character in enumerate(characters):
        if place in tagged:
            inside = False
            continue
        belongs = any(letter.isalnum() for letter in character.label) or (inside and character.label in "'’-")
        if belongs and inside:
            last = words[-1]
            words[-1] = replace(last, end_s=max(last.end_s, character.end_s), label=last.label + character.label)
        elif belongs:
            words.append(character)
        inside = belongs
    return words


def timed(node: Node, texts: str, starts: str = "start", ends: str = "end") -> list[Entry]:
    """Entries from parallel lists of starts and ends in s and texts, named by their keys."""
    return [Entry(*row, node.where) for row in rows_of_lists(node, texts, starts, ends)]


def parse_cartesia(data: bytes) -> PhoneTrack:
    """Read the messages of a context: phones with the words around them; without phones, the words."""
    found: dict[str, list[Entry]] = {"phonemes": [], "words": []}
    for message in parse_document(data, "Cartesia").entries():
        for key, texts in TIMESTAMPS.items():
            if message.has(key):
                found[texts] += timed(message[key], texts)
    if found["phonemes"]:
        return track_of(with_words(found["phonemes"], found["words"]), "Cartesia", alphabet="ipa")
    if not found["words"]:
        raise DataError(f"Cartesia: contains no message with {' or '.join(TIMESTAMPS)}")
    return track_of(found["words"], "Cartesia", level="word", spelled=True)


INWORLD = ("timestampInfo", "result.timestampInfo", "[].timestampInfo", "[].result.timestampInfo")


def inworld_infos(document: Node) -> Iterator[Node]:
    """Find the timings in an answer of Inworld's, whole or streamed."""
    listed = isinstance(document.value, list)
    for path in INWORLD:
        if listed == path.startswith("[]"):
            yield from walk(document, path)


def inworld_words(info: Node) -> list[Entry]:
    """Words of a ``wordAlignment``."""
    return timed(info, "words", "wordStartTimeSeconds", "wordEndTimeSeconds")


def inworld_phones(alignment: Node) -> list[Entry]:
    """Phones of a ``wordAlignment``, each with its word; visemes where there are no phones."""
    words = alignment["words"].texts()
    phones: list[Entry] = []
    for detail in walk(alignment, "phoneticDetails[]"):
        index = int(detail.number_or("wordIndex", -1))
        word = words[index].strip() if 0 <= index < len(words) else ""
        for phone in detail["phones"].items():
            start_s = phone["startTimeSeconds"].number()
            label = phone.first("phoneSymbol", "visemeSymbol").text()
            phones.append(Entry(start_s, start_s + phone["durationSeconds"].number(), label, phone.where, word))
    return phones


def parse_inworld(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones; without phones the visemes, without both the words."""
    phones: list[Entry] = []
    words: list[Entry] = []
    visemes = False
    for info in inworld_infos(parse_document(data, "Inworld")):
        if not info.has("wordAlignment"):
            raise DataError("Inworld: wordAlignment is missing; ask for timestampType WORD", where=info.where)
        alignment = info["wordAlignment"]
        words += inworld_words(alignment)
        phones += inworld_phones(alignment)
        visemes |= any(not phone.has("phoneSymbol") for phone in walk(alignment, "phoneticDetails[].phones[]"))
    if phones and visemes:
        return track_of(without_overlaps(phones), "Inworld", alphabet="inworld-visemes", level="viseme")
    if phones:
        return track_of(without_overlaps(phones), "Inworld", alphabet=alphabet)
    return words_track(words, "Inworld", "ask for WORD")


def is_fish(document: Node) -> bool:
    """Return whether a document is a stream, or one answer, of Fish Audio with timestamps."""
    return any(list(walk(event, "alignment.segments[]")) for event in document.entries()[:200])


def fish_words(event: Node) -> list[Entry]:
    """Words of one event of Fish Audio, from the offset of its chunk."""
    offset_s = event.number_or("chunk_audio_offset_sec", 0.0)
    return [
        Entry(offset_s + row["start"].number(), offset_s + row["end"].number(), row["text"].text().strip(), row.where)
        for row in event["alignment"]["segments"].items()
    ]


def parse_fish(data: bytes) -> PhoneTrack:
    """Read the last alignment of every chunk."""
    chunks: dict[float, list[Entry]] = {}
    for event in parse_document(data, "Fish Audio").entries():
        if event.has("alignment"):
            chunks[event.number_or("chunk_seq", 0.0)] = fish_words(event)
    words = [word for number in sorted(chunks) for word in chunks[number]]
    return words_track(words, "Fish Audio", "ask for words")


def hume_stamps(document: Node) -> Iterator[tuple[str, Node]]:
    """Find the generation and the timestamps of Hume's messages, or of one answer."""
    for event in document.entries():
        for part in [event, *walk(event, "generations[]")]:
            for path in ("timestamp", "timestamps[]", "snippets[].[].timestamps[]"):
                for stamp in walk(part, path):
                    if stamp.has("text", "time", "type"):
                        yield part.text_or("generation_id"), stamp


def parse_hume(data: bytes, *, tier: str | None = None) -> PhoneTrack:
    """Read the phones, or the words if no phones were requested; ``tier`` is the id of one of several generations."""
    found: dict[str, dict[str, list[Entry]]] = {}
    for generation, stamp in hume_stamps(parse_document(data, "Hume")):
        start_ms, end_ms = (stamp["time"][key].number() for key in ("begin", "end"))
        entry = Entry(start_ms / 1000, end_ms / 1000, stamp["text"].text(), stamp.where)
        found.setdefault(generation, {}).setdefault(stamp["type"].text(), []).append(entry)
    if not found:
        raise DataError("Hume: contains no timestamp; ask for include_timestamp_types, of version 2")
    chosen = found[only_name(set(found), tier, "Hume", "generations")]
    words, phones = (sorted(chosen.get(kind, []), key=lambda each: each.start_s) for kind in ("word", "phoneme"))
    if not phones:
        return words_track(words, "Hume", "ask for include_timestamp_types=['word', 'phoneme']")
    return track_of(with_words(without_overlaps(phones), words), "Hume", alphabet="ipa")


def resemble_timings(document: Node) -> Iterator[Node]:
    """Find the timings in an answer of Resemble's, a clip, or the messages of a stream."""
    for event in document.entries():
        for path in ("audio_timestamps", "item.timestamps", "timestamps"):
            yield from (node for node in walk(event, path) if node.has("graph_chars"))


def parse_resemble(data: bytes) -> PhoneTrack:
    """Read the phones with the words around them; without phones the words. A phone lasts until the next."""
    onsets: list[tuple[float, str, str]] = []
    characters: list[Entry] = []
    end_s = 0.0
    for timings in resemble_timings(parse_document(data, "Resemble")):
        characters += _pairs(timings, "graph")
        for entry in _pairs(timings, "phon") if timings.has("phon_chars") else []:
            is_phone, end_s = bool(ipa.letters(entry.label)), entry.end_s
            if is_phone or entry.label.strip(" ːˑ"):  # a blank or a length mark belongs to the phone before
                onsets.append((entry.start_s, entry.label if is_phone else "_", entry.where))
    words = without_overlaps(words_of(characters))
    if not onsets:
        return track_of(words, "Resemble", level="character", spelled=True)
    return track_of(with_words(until_next(onsets, end_s), words), "Resemble", alphabet="ipa")


def _pairs(timings: Node, kind: str) -> list[Entry]:
    """Entries of ``<kind>_chars``, each with its pair of ``<kind>_times``."""
    labels, pairs = timings[f"{kind}_chars"].texts(), [pair.numbers() for pair in timings[f"{kind}_times"].items()]
    count = sum(len(pair) == 2 for pair in pairs)
    if not count == len(pairs) == len(labels):
        where = timings.where or "the top"
        raise DataError(f"{kind}_times: got {count} pairs of times, expected {len(labels)}", where=where)
    rows = enumerate(zip(labels, pairs, strict=True))
    return [Entry(pair[0], pair[1], label, f"{kind}_times[{at}]") for at, (label, pair) in rows]
