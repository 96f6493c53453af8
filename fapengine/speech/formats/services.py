"""Timings of text-to-speech services: Azure, Amazon Polly, ElevenLabs, Cartesia.

Azure Speech viseme events (SDK ``VisemeReceived``): onset in ticks of 100 ns and one of 22 ids, as JSON (lines).

Amazon Polly speech marks: JSON lines ``{"time": ms, "type", "value"}``; each lasts until the next of its kind.

ElevenLabs (2026-07): REST ``characters`` with starts and ends in seconds; WebSocket and agents ``chars`` with starts
and lengths in ms, counted from the beginning of each chunk; forced alignment ``words`` of ``text``, ``start``, ``end``.
Cartesia Sonic (2026): ``phoneme_timestamps`` in IPA and ``word_timestamps``. Characters are joined into words, because
a character has no sound of its own until the word is pronounced.
"""

from dataclasses import replace

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.formats.documents import Node, parse_document, same_length
from fapengine.speech.formats.entries import OVERLAP_S, Entry, track_of, until_next, with_words
from fapengine.speech.phone_track import PhoneTrack

TICKS_HZ = 1e7
OFFSETS = ("audio_offset", "AudioOffset", "audioOffset", "privAudioOffset", "Offset", "offset")
IDS = ("viseme_id", "VisemeId", "visemeId", "privVisemeId")
"""Spellings of the Python, C#, JavaScript SDKs and of the REST batch result."""


def is_event(node: Node) -> bool:
    """Whether a value looks like an event of Azure, visemes or blend shapes."""
    return any(node.has(key) for key in IDS) or node.has("BlendShapes")


def parse_azure(data: bytes) -> PhoneTrack:
    """Read the viseme events; each lasts until the next."""
    document = parse_document(data, "Azure visemes")
    events = document.entries()
    if any(event.has("BlendShapes") for event in events):
        raise UnsupportedError(
            "Azure: got blend-shape frames (55 weights at 60 Hz), expected viseme events; frames are a motion, not"
            " phones: `fapengine render` and `convert` take them"
        )
    onsets = [
        (event.first(*OFFSETS).number() / TICKS_HZ, f"{event.first(*IDS).number():g}", event.where) for event in events
    ]
    return track_of(until_next(onsets), "Azure visemes", alphabet="azure-visemes", level="viseme")


def parse_polly(data: bytes) -> PhoneTrack:
    """Read viseme marks, with the words around them if asked for; of words alone, the words."""
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


ALIGNMENTS = ("normalized_alignment", "normalizedAlignment", "alignment")
"""The spoken text first: in it, numbers are written out."""
CHARACTERS = ("characters", "chars")
STARTS_S, ENDS_S = "character_start_times_seconds", "character_end_times_seconds"
STARTS_MS, LENGTHS_MS = ("charStartTimesMs", "char_start_times_ms"), ("charDurationsMs", "char_durations_ms")
TIMESTAMPS = ("phoneme_timestamps", "word_timestamps")


def parse_elevenlabs(data: bytes) -> PhoneTrack:
    """Read one alignment, the chunks of a stream, or a forced alignment.

    A chunk that begins before the one before ends counts from that end.
    """
    document = parse_document(data, "ElevenLabs")
    if document.has("words"):
        words = [
            Entry(word["start"].number(), word["end"].number(), word["text"].text(), word.where)
            for word in document["words"].items()
        ]
        spoken = [word for word in words if word.label.strip()]
        return track_of(spoken, "ElevenLabs", level="word", spelled=True)
    characters: list[Entry] = []
    for chunk in document.entries():
        inner = chunk.first(*ALIGNMENTS) if any(chunk.has(key) for key in ALIGNMENTS) else chunk
        if any(inner.has(key) for key in CHARACTERS):  # the last chunk of a stream has none
            characters += _chunk(inner, characters[-1].end_s if characters else 0.0)
    return track_of(words_of(characters), "ElevenLabs", level="character", spelled=True)


def _chunk(node: Node, before_s: float) -> list[Entry]:
    texts = node.first(*CHARACTERS).texts()
    if node.has(STARTS_S):
        starts_s, ends_s = node[STARTS_S].numbers(), node[ENDS_S].numbers()
    else:
        starts_s = [ms / 1000 for ms in node.first(*STARTS_MS).numbers()]
        lengths = node.first(*LENGTHS_MS).numbers()
        same_length(starts_s, lengths, where=node.where)
        ends_s = [start_s + ms / 1000 for start_s, ms in zip(starts_s, lengths, strict=True)]
    same_length(starts_s, ends_s, texts, where=node.where)
    shift_s = before_s if starts_s and starts_s[0] < before_s - OVERLAP_S else 0.0
    return [
        Entry(start_s + shift_s, end_s + shift_s, text, f"{node.where}[{index}]")
        for index, (start_s, end_s, text) in enumerate(zip(starts_s, ends_s, texts, strict=True))
    ]


def words_of(characters: list[Entry]) -> list[Entry]:
    """Join characters into words; what is neither letter, digit, apostrophe nor hyphen parts them.

    Examples
    --------
    >>> [word.label for word in words_of([Entry(i, i + 1, c, "") for i, c in enumerate("it's so.")])]
    ["it's", 'so']
    """
    words: list[Entry] = []
    inside = False
    for character in characters:
        belongs = any(letter.isalnum() for letter in character.label) or (inside and character.label in "'’-")
        if belongs and inside:
            last = words[-1]
            words[-1] = replace(last, end_s=max(last.end_s, character.end_s), label=last.label + character.label)
        elif belongs:
            words.append(character)
        inside = belongs
    return words


def parse_cartesia(data: bytes) -> PhoneTrack:
    """Read the messages of a context: phones with the words around them; of words alone, the words."""
    by_level: dict[str, list[Entry]] = {"phonemes": [], "words": []}
    for message in parse_document(data, "Cartesia").entries():
        for key, inner in zip(TIMESTAMPS, by_level, strict=True):
            if message.has(key):
                stamps = message[key]
                texts, starts_s = stamps[inner].texts(), stamps["start"].numbers()
                ends_s = stamps["end"].numbers()
                same_length(starts_s, ends_s, texts, where=stamps.where)
                by_level[inner] += [Entry(*row, stamps.where) for row in zip(starts_s, ends_s, texts, strict=True)]
    if by_level["phonemes"]:
        return track_of(with_words(by_level["phonemes"], by_level["words"]), "Cartesia", alphabet="ipa")
    if not by_level["words"]:
        raise DataError(f"Cartesia: contains no message with {' or '.join(TIMESTAMPS)}")
    return track_of(by_level["words"], "Cartesia", level="word", spelled=True)
