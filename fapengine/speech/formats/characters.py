"""Alignments of ElevenLabs and Cartesia: times of characters, words or phones in parallel lists.

ElevenLabs (2026-07): REST ``characters`` with starts and ends in seconds; WebSocket and agents ``chars`` with starts
and lengths in ms, counted from the beginning of each chunk; forced alignment ``words`` of ``text``, ``start``, ``end``.
Cartesia Sonic (2026): ``phoneme_timestamps`` in IPA and ``word_timestamps``. Characters are joined into words: letters
have no sound of their own until they are pronounced.
"""

from dataclasses import replace

from fapengine.errors import DataError
from fapengine.speech.formats.documents import Node, parse_document, same_length
from fapengine.speech.formats.entries import OVERLAP_S, Entry, track_of, with_words
from fapengine.speech.phone_track import PhoneTrack

ALIGNMENTS = ("normalized_alignment", "normalizedAlignment", "alignment")
"""The spoken text first: in it, numbers are written out."""
CHARACTERS = ("characters", "chars")
STARTS_S, ENDS_S = "character_start_times_seconds", "character_end_times_seconds"
STARTS_MS, LENGTHS_MS = ("charStartTimesMs", "char_start_times_ms"), ("charDurationsMs", "char_durations_ms")
TIMESTAMPS = ("phoneme_timestamps", "word_timestamps")


def parse_elevenlabs(data: bytes) -> PhoneTrack:
    """Read one alignment, the chunks of a stream, or a forced alignment.

    A chunk that begins before the one before ends counts from that end.

    Raises
    ------
    DataError
        If keys lack, lists differ in length, or times are wrong.
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
    """Read the messages of a context: phones with the words around them; of words alone, the words.

    Raises
    ------
    DataError
        If keys lack, lists differ in length, or times are wrong.
    """
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
        raise DataError(f"Cartesia: got no message with {' or '.join(TIMESTAMPS)}")
    return track_of(by_level["words"], "Cartesia", level="word", spelled=True)
