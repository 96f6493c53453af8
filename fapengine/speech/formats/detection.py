"""Tests of a file's content, which find its format."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from fapengine.errors import DataError
from fapengine.speech.alphabets.guess import MIN_EXPLAINED, guess
from fapengine.speech.formats import services
from fapengine.speech.formats.documents import NUMBER, Node, decode_text, parse_document, walk
from fapengine.speech.formats.synthesizers import LIST_KEYS, LISTS
from fapengine.speech.formats.table import header_of, is_row, list_in
from fapengine.speech.formats.word_lists import CUE, WordList, is_word_list

_ROWS = 50
_EVENTS = 200


@dataclass(frozen=True, slots=True)
class Sample:
    """The part of a file that the tests look at."""

    head: bytes
    rows: tuple[str, ...]
    """First lines that are not blank."""
    document: Node | None
    """The content if it is JSON or JSON lines; null for broken JSON."""

    def first(self) -> Node:
        """First value of a list, or the value itself."""
        if self.document is None:
            return Node(None)
        values = self.document.value
        return Node(values[0] if isinstance(values, list) and values else values)

    def every_row(self, pattern: str) -> bool:
        """Return whether there are rows, and all match a pattern."""
        return self.document is None and bool(self.rows) and all(re.fullmatch(pattern, row) for row in self.rows)


MAX_PHO_LABEL = 8
"""Longest name of a phone in a .pho file; recordings have longer names."""
GRID_WORDS = frozenset((
    *"abcdefghijklmnopqrstuvxyz", "bin", "lay", "place", "set", "blue", "green", "red", "white", "at", "by", "in",
    "with", "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "again", "now", "please",
    "soon", "sil", "sp",
))  # fmt: skip
"""Words of the GRID corpus (Cooke and others, JASA 120, 2006)."""
MAX_GRID_SAMPLES = 1_000_000
"""Largest number in three integer columns that means GRID's samples (40 s) rather than HTK's units (0.1 s)."""


def is_three_columns(sample: Sample) -> bool:
    """Return whether each row is two numbers and a label."""
    return sample.every_row(rf"\s*{NUMBER}\s+{NUMBER}(\s+\S.*|\t\s*)|\\\t.*")


def is_allosaurus(sample: Sample) -> bool:
    """Return whether each row is an onset, the same length and a phone."""
    if not sample.every_row(r"\s*\d+\.\d+\s+\d\.\d+\s+[^\s\d].*"):
        return False
    onsets, lengths = zip(*(map(float, row.split()[:2]) for row in sample.rows), strict=True)
    return len(set(lengths)) == 1 and max(onsets) > lengths[0]


def _sampled_labels(sample: Sample) -> list[str]:
    """Labels of three columns with times in samples; empty for other files."""
    if not sample.every_row(r"\s*\d+\s+\d+\s+\S.*"):
        return []
    if max(float(row.split()[1]) for row in sample.rows) >= MAX_GRID_SAMPLES:
        return []
    return [row.split(None, 2)[2].strip() for row in sample.rows]


def is_grid(sample: Sample) -> bool:
    """Return whether words are timed in samples, as in GRID, and in TIMIT at another rate."""
    labels = _sampled_labels(sample)
    return bool(labels) and (guess(labels).words or GRID_WORDS.issuperset(label.lower() for label in labels))


def is_timit(sample: Sample) -> bool:
    """Return whether phones of TIMIT, or words that GRID does not have, are timed in samples."""
    labels = _sampled_labels(sample)
    if not labels or GRID_WORDS.issuperset(label.lower() for label in labels):
        return False
    guessed = guess(labels)
    return guessed.words or (guessed.alphabet == "arpabet" and guessed.explained > MIN_EXPLAINED)


def is_ctm(sample: Sample) -> bool:
    """Return whether each row is a recording, a channel, start, length and label."""
    if not sample.every_row(rf"(;;.*|\S+\s+\S+\s+({NUMBER}\s+{NUMBER}|\*\s+\*)\s+\S.*)"):
        return False
    rows = [row.split() for row in sample.rows if not row.startswith(";;")]
    named = any(not re.fullmatch(NUMBER, row[4]) for row in rows)
    return bool(rows) and (named or all(len(row) == 5 for row in rows))


def is_pho(sample: Sample) -> bool:
    """Return whether each row is a phone, milliseconds, and pairs of per cent and hertz."""
    if not sample.every_row(rf"\s*(;.*|\S+\s+{NUMBER}(\s.*)?)"):
        return False
    for row in sample.rows:
        name, *numbers = row.split(";", 1)[0].split() or [""]
        points = [float(number.replace(",", ".")) for number in numbers[1::2] if re.fullmatch(NUMBER, number)]
        is_text = any(re.search("[^\\W\\d_]", number) for number in numbers)
        if len(name) > MAX_PHO_LABEL or is_text or (len(points) > 1 and points != sorted(points)):
            return False
    return True


def any_event_has(*keys: str) -> Callable[[Sample], bool]:
    """Test for any of some keys in the first objects: streams begin with audio, or repeat the request."""
    return lambda sample: any(
        event.has(key) for event in (sample.document or Node(None)).entries()[:_EVENTS] for key in keys
    )


def is_phone_list(sample: Sample) -> bool:
    """Return whether there is a list of phones with times without a unit."""
    items = (next(walk(sample.first(), f"{key}[]"), Node(None)) for key in LISTS)
    return any(item.has("start", "end") or item.has("offset", "duration") for item in items)


def has_words(kind: WordList) -> Callable[[Sample], bool]:
    """Test for a document of one tool's, with words or phrases."""
    return lambda sample: is_word_list(kind, sample.document)


def is_subtitles(sample: Sample) -> bool:
    """Return whether there are cues with times."""
    return sample.document is None and any(CUE.fullmatch(row) for row in sample.rows)


def starts_with(text: str) -> Callable[[Sample], bool]:
    """Test for the first line."""
    return lambda sample: bool(sample.rows) and sample.rows[0].strip() == text


def is_papagayo(sample: Sample) -> bool:
    """Return whether there are voices of Papagayo."""
    return starts_with("lipsync version 1")(sample) or (
        sample.first().has("fps", "voices") and any(walk(sample.first(), "voices[].phrases[].words[].phonemes[]"))
    )


def is_utau(sample: Sample) -> bool:
    """Return whether there are sections of a song."""
    return any(re.match(r"\[#(SETTING|\d{4})|ustx_version:", row) for row in sample.rows)


def is_table(sample: Sample) -> bool:
    """Return whether there is a list with columns of usual names."""
    if sample.document is None:
        return bool(header_of(sample.rows))
    try:
        return is_row(next(list_in(sample.document).items(), Node(None)))
    except DataError:
        return False


def has(*keys: str) -> Callable[[Sample], bool]:
    """Test for keys of the first object, none of them null."""
    return lambda sample: sample.first().has(*keys)


def is_piper(sample: Sample) -> bool:
    """Return whether phones of Piper have lengths."""
    node = sample.first()
    if node.has("last"):
        node = node["last"]
    return any(list(walk(node, f"{key}[0].phoneme")) for key in LIST_KEYS) or (
        node.has("phoneme") and (node.has("seconds") or node.has("num_samples"))
    )


def is_kokoro(sample: Sample) -> bool:
    """Return whether tokens of Kokoro have times or durations."""
    node = sample.first()
    tokens = node["tokens"] if node.has("tokens") else sample.document or Node(None)
    return node.has("pred_dur") or any(list(walk(tokens, f"[{n}].start_ts")) for n in range(20))


def is_espeak(sample: Sample) -> bool:
    """Return whether there are events of espeak-ng."""
    node = sample.first()
    event = next(walk(node, "events[0]"), node)
    return event.has("type") and any(event.has(key) for key in ("sample", "audio_position_ms", "audio_position"))


def is_elevenlabs(sample: Sample) -> bool:
    """Return whether there are characters or words as ElevenLabs times them."""
    node = sample.first()
    spoken = any(word.has("text") and not word.has("confidence") for word in walk(node, "words[0]"))
    return spoken or any(node.has(key) for key in (*services.ALIGNMENTS, *services.CHARACTERS))


def is_headtts(sample: Sample) -> bool:
    """Return whether there are visemes of HeadTTS."""
    node = sample.first()
    return (node["data"] if node.has("data") else node).has("visemes", "vtimes")


def is_textgrid(sample: Sample) -> bool:
    """Return whether this is an object of Praat."""
    head = sample.head.replace(b"\0", b"")
    return b"ooTextFile" in head or b"TextGrid" in head or b"ooBinaryFile" in head


def is_xlabel(sample: Sample) -> bool:
    """Return whether labels stand below a line with # alone."""
    rows = sample.rows
    labels = any(re.match(rf"\s*{NUMBER}\s+-?\d+\s", row) for row in rows)
    return sample.document is None and any(row.strip() == "#" for row in rows) and labels


def sample_of(data: bytes) -> Sample:
    """Read the part of a file that the tests look at."""
    try:
        text = decode_text(data, "file")
    except DataError:
        return Sample(data[:1000], (), None)
    document = None
    if text.lstrip()[:1] in ("{", "[") or text.startswith(("data:", "event:")):
        try:
            document = parse_document(data, "file")
        except DataError:
            document = Node(None)
    rows = tuple(row for row in text[:20_000].splitlines()[:_ROWS] if row.strip())
    return Sample(data[:1000], rows, document)
