"""Words with times: JSON of speech recognizers and voices, and subtitles.

Every tool's JSON has a list of words somewhere, each with a text, a start and an end; where the list is, what the keys
are called and what a time means differs. One reader serves them all, with a table for each tool (``word_lists.toml``).
A word without times, which aligners leave where they fail, gets the time between its neighbours, or joins the word
before. Lists that are timed in phrases are refused, and the message says how to ask for words. Sources: the tools' own
documentation, as of 2026-11.

Subtitles, SRT (as SubRip writes it) and WebVTT (W3C, 2019), are read where words have times: one word a cue (edge-tts,
Whisper with one word a line), times inside a cue (WebVTT, ``<00:00:01.120>``), or one underlined word in each cue
(Whisper, ``highlight_words``). Cues of phrases are refused, because they do not say when each word is spoken.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from fapengine._arrays import read_tables
from fapengine.errors import DataError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import Node, decode_text, parse_document, walk
from fapengine.speech.formats.entries import Entry, shared_out, track_of, without_overlaps
from fapengine.speech.phone_track import PhoneTrack

MIN_WORD_S = 0.05
"""Shortest time in s that a word without times is given between its neighbours."""
_EDGES = ' \t\r\n.,!?;:…"“”„«»‹›()[]{}¿¡–—-*♪'
_SPECIAL = re.compile(r"\[.*\]|<.*>|\{.*\}")
"""Labels that are not text: [_BEG_], [Music], <end>, {B_TRANS}."""


@dataclass(frozen=True, slots=True)
class WordList:
    """Shape of one tool's list of timed words."""

    name: str
    tool: str
    rows: tuple[str, ...]
    """Paths of the list, the best first, as for :func:`.documents.walk`."""
    label: tuple[str, ...]
    """Paths of the text within a row, the best first."""
    start: tuple[str, ...] = ("start",)
    end: tuple[str, ...] = ("end",)
    length: tuple[str, ...] = ()
    """Keys of the duration, used if there is no end."""
    unit_s: float = 1.0
    """Length in s of the unit of times."""
    pieces: bool = False
    """True where the texts are pieces of words; one that begins with a blank begins a word."""
    only: tuple[str, str] | None = None
    """Key and value of the rows that are words, in a list of mixed rows."""
    phrases: tuple[str, ...] = ()
    """Paths of a list of phrases that the tool writes unless it was asked for words."""
    never: tuple[str, ...] = ()
    """Keys that no row has."""
    hint: str = "ask the tool for word timestamps"


def _word_list(name: str, row: dict[str, Any]) -> WordList:
    fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
    return WordList(name, **fields)


WORD_LISTS = tuple(_word_list(*table) for table in read_tables(__package__, "word_lists.toml").items())


def value_of(row: Node, keys: Sequence[str]) -> Node | None:
    """Return the value of the first path that leads to one."""
    return next((node for key in keys for node in walk(row, key) if node.value is not None), None)


def _is_word(row: Node, kind: WordList) -> bool:
    if kind.only is None:
        return True
    key, wanted = kind.only
    said = value_of(row, (key, key.capitalize(), "boundary_type", "boundaryType", "privBoundaryType"))
    return said is None or said.value in (wanted, "Word", wanted.lower())


def _times(row: Node, kind: WordList) -> tuple[float, float] | None:
    """Start and end in s; None if the row has no times."""
    start, end = value_of(row, kind.start), value_of(row, kind.end)
    length = value_of(row, kind.length)
    if end is None and length is None:
        return None
    start_s = seconds(start) * kind.unit_s if start is not None else 0.0
    end_s = seconds(end) * kind.unit_s if end is not None else start_s + seconds(length or row) * kind.unit_s
    return start_s, max(start_s, end_s)


def seconds(node: Node) -> float:
    """Return a number, ``"1.300s"``, or an object of seconds and nanos.

    Examples
    --------
    >>> seconds(Node(1.3)), seconds(Node("1.300s")), seconds(Node({"seconds": "1", "nanos": 300000000}))
    (1.3, 1.3, 1.3)
    """
    if isinstance(node.value, dict):
        return node.number_or("seconds", 0.0) + node.number_or("nanos", 0.0) / 1e9
    if isinstance(node.value, str) and node.value.endswith("s"):
        return Node(node.value[:-1], node.where).number()
    return node.number()


def rows_of(document: Node, kind: WordList) -> list[Node]:
    """Find the rows of a tool's list of words; empty for documents of other tools."""
    for path in kind.rows:
        rows = list(walk(document, path if isinstance(document.value, list) else path.removeprefix("[].")))
        words = [row for row in rows if value_of(row, kind.label) is not None and _is_word(row, kind)]
        timed = [row for row in words[:40] if value_of(row, (*kind.end, *kind.length)) is not None]
        if len(timed) > 1 and not any(value_of(row, kind.start) for row in timed):
            continue  # their starts have another name; one alone may leave out its 0
        if timed and not any(timed[0].has(key) for key in kind.never):
            return words
    return []


def is_word_list(kind: WordList, document: Node | None) -> bool:
    """Return whether a document is one of this tool's, with words or with phrases only."""
    if document is None:
        return False
    if rows_of(document, kind):
        return True
    phrases = (row for path in kind.phrases for row in walk(document, path))
    return any(value_of(row, ("text",)) is not None and _times(row, kind) is not None for row in phrases)


def _plain_word(label: str) -> str:
    """Remove punctuation around a word, except the last point of an abbreviation with points inside.

    Examples
    --------
    >>> [_plain_word(word) for word in (" Hello,", "“we'll”", "a.m.", "—", "3.5%", "[Music]")]
    ['Hello', "we'll", 'a.m.', '', '3.5%', '']
    """
    if _SPECIAL.fullmatch(label.strip()):
        return ""
    plain = label.strip(_EDGES)
    return plain + "." if "." in plain and label.strip().startswith(plain + ".") and not plain[0].isdigit() else plain


def joined_pieces(entries: Sequence[Entry]) -> list[Entry]:
    """Join pieces of words: one that begins with a blank, or comes after one, begins a word.

    Examples
    --------
    >>> [e.label for e in joined_pieces([Entry(0, 1, " Beau", ""), Entry(1, 2, "ti", ""), Entry(2, 3, " day", "")])]
    ['Beauti', 'day']
    """
    words: list[Entry] = []
    open_word = False
    for entry in entries:
        text = entry.label
        if _SPECIAL.fullmatch(text.strip()):
            open_word = False
            continue
        if text[:1].isspace() or not open_word:
            words.append(replace(entry, label=text.strip()))
        else:
            words[-1] = replace(
                words[-1], end_s=max(words[-1].end_s, entry.end_s), label=words[-1].label + text.strip()
            )
        open_word = not text[-1:].isspace()
    return words


def timed_words(entries: Sequence[Entry] | Sequence[Entry | tuple[str, str]], what: str, hint: str) -> list[Entry]:
    """Words in sequence: without punctuation and overlaps, with times for the untimed ones.

    Parameters
    ----------
    entries : sequence of Entry, or of (label, where)
        In the order in which they are spoken; the latter have no times.
    what, hint : str
        Format and advice, for messages.
    """
    words: list[Entry] = []
    waiting: list[tuple[str, str]] = []
    for entry in entries:
        label, where = (entry.label, entry.where) if isinstance(entry, Entry) else entry
        plain = _plain_word(label)
        if not plain:
            continue
        if re.search(r"\s", plain):
            raise DataError(f"{what}: got {plain[:40]!r}, expected one word in each entry; {hint}", where=where)
        if not isinstance(entry, Entry):
            waiting.append((plain, where))
            continue
        words += _placed(waiting, words, entry.start_s)
        waiting = []
        words.append(replace(entry, label=plain))
    if not any(isinstance(entry, Entry) for entry in entries):
        raise DataError(f"{what}: contains no timed word; {hint}")
    words += _placed(waiting, words, None)
    return without_overlaps(words)


def words_track(entries: Sequence[Entry] | Sequence[Entry | tuple[str, str]], what: str, hint: str) -> PhoneTrack:
    """Make a track of words, as of :func:`timed_words`."""
    return track_of(timed_words(entries, what, hint), what, level="word", spelled=True)


def labelled_track(
    entries: Sequence[Entry], what: str, alphabet: str | None, *, default: str | None = None, row: str = "line"
) -> PhoneTrack:
    """Make a track of labels that may be phones or words.

    They are words if no alphabet is given and they look like words. ``default`` is the alphabet of phones without
    ``alphabet``; by default it is guessed. ``row`` is what the file has for each word.
    """
    if alphabet is None and guess(entry.label for entry in entries).words:
        if all(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", entry.label) for entry in entries):
            raise DataError(f"{what}: got numbers, expected phones or words", where=entries[0].where)
        return words_track(entries, what, f"one word a {row}")
    return track_of(entries, what, alphabet=alphabet or default)


def _placed(waiting: list[tuple[str, str]], words: list[Entry], until_s: float | None) -> list[Entry]:
    """Place words without times before ``until_s``; without room, they join the word before."""
    if not waiting:
        return []
    from_s = words[-1].end_s if words else 0.0
    if until_s is not None and until_s - from_s >= MIN_WORD_S * len(waiting):
        return shared_out(from_s, until_s, [label for label, _ in waiting], waiting[0][1])
    if words:
        words[-1] = replace(words[-1], label=" ".join([words[-1].label, *(label for label, _ in waiting)]))
    return []


def parse_word_list(data: bytes, *, kind: WordList, tier: str | None = None) -> PhoneTrack:
    """Read the words of a tool's document.

    Parameters
    ----------
    data : bytes
        JSON, or JSON lines.
    kind : WordList
        The tool.
    tier : str, optional
        Number of the channel, where a recording has several.
    """
    document = _one_channel(parse_document(data, kind.tool), tier, kind)
    rows = rows_of(document, kind)
    if not rows:
        raise DataError(f"{kind.name}: contains no word with times; {kind.hint}")
    entries: list[Entry | tuple[str, str]] = []
    for row in rows:
        label, times = value_of(row, kind.label), _times(row, kind)
        text = label.text() if label is not None else ""
        entries.append((text, row.where) if times is None else Entry(*times, text, row.where))
    if kind.pieces:
        entries = [*joined_pieces([entry for entry in entries if isinstance(entry, Entry)])]
    return words_track(entries, kind.name, kind.hint)


def _one_channel(document: Node, tier: str | None, kind: WordList) -> Node:
    channels = list(walk(document, "results.channels[]"))
    if len(channels) < 2:
        return document
    names = [str(number) for number in range(len(channels))]
    if tier not in names:
        raise DataError(
            f"{kind.name}: got {len(channels)} channels, expected one; name one of {names} with tier=NUMBER"
        )
    return Node({"results": {"channels": [channels[int(tier or 0)].value]}})


_CLOCK = r"(?:(\d+):)?(\d{1,2}):(\d{1,2})[.,](\d{1,3})"
CUE = re.compile(rf"\s*{_CLOCK}\s*-->\s*{_CLOCK}(\s.*)?")
"""Times of a cue: hours are optional, a comma or a point goes before the milliseconds."""
_INSIDE = re.compile(rf"<{_CLOCK}>")
_TAG = re.compile(r"</?[a-zA-Z][^>]*>|\{\\[^}]*\}")
_MARKED = re.compile(r"<(u|font)\b[^>]*>(.*?)</\1>", re.DOTALL)
"""The word of a cue that is spoken: underlined by Whisper, coloured by stable-ts."""
MIN_MARKED = 0.3
"""Share of cues with a marked word from which these are the words: between words cues have none."""
_HINT = (
    "words need times of their own: one word a cue, or <00:00:01.120> before each word; or give"
    " the sound, and these as its transcript"
)


def _clock_s(groups: tuple[str | None, ...]) -> float:
    hours, minutes, seconds, fraction = (group or "0" for group in groups)
    return 3600 * float(hours) + 60 * float(minutes) + float(seconds) + float(f"0.{fraction}")


def parse_subtitles(data: bytes) -> PhoneTrack:
    """Read the words of an SRT or WebVTT file."""
    cues = _cues(decode_text(data, "subtitles").splitlines())
    if not cues:
        raise DataError("subtitles: contains no cue; times look like 00:00:01,000 --> 00:00:01,500")
    words: list[Entry | tuple[str, str]] = []
    if any(_INSIDE.search(cue.label) for cue in cues):
        said: list[str] = []
        for cue in cues:
            lines = [" ".join(line.split()) for line in _TAG.sub("", _INSIDE.sub("", cue.label)).split("\n")]
            if _INSIDE.search(cue.label):
                words += _inside(cue)
            else:  # it repeats what was said; a line of one word has no times inside
                new = [word for line in lines if line not in said for word in line.split()]
                words += shared_out(cue.start_s, cue.end_s, new, cue.where)
            said = lines
    elif sum(bool(_MARKED.search(cue.label)) for cue in cues) >= MIN_MARKED * len(cues):
        words += [Entry(c.start_s, c.end_s, m[2], c.where) for c in cues for m in _MARKED.finditer(c.label)]
    else:
        words += [Entry(cue.start_s, cue.end_s, _TAG.sub("", cue.label), cue.where) for cue in cues]
    return words_track(words, "subtitles", _HINT)


def subtitle_text(text: str) -> str | None:
    r"""Return the text of SRT or WebVTT without its times, for an alignment with the sound; None for other text.

    Examples
    --------
    >>> subtitle_text("1\n00:00:01,000 --> 00:00:02,000\n<i>Hello</i> there.\n")
    'Hello there.'
    """
    cues = _cues(text.splitlines())
    lines = [line for cue in cues for line in _TAG.sub("", _INSIDE.sub("", cue.label)).split("\n")]
    return (
        "\n".join(line for before, line in zip(["", *lines], lines, strict=False) if line != before) if cues else None
    )


def _cues(lines: list[str]) -> list[Entry]:
    cues: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        if match := CUE.fullmatch(line):
            start_s, end_s = _clock_s(match.groups()[:4]), _clock_s(match.groups()[4:8])
            cues.append(Entry(start_s, max(start_s, end_s), _text(lines[number:]), f"line {number}"))
    return cues


def _text(lines: list[str]) -> str:
    """Lines of a cue, up to the empty one or the next cue's times; YouTube begins with a line of a blank."""
    text: list[str] = []
    for at, line in enumerate(lines):
        following = lines[at + 1] if at + 1 < len(lines) else ""
        if not line or CUE.fullmatch(line) or (line.strip().isdigit() and CUE.fullmatch(following)):
            break
        text += [line.strip()] if line.strip() else []
    return "\n".join(text)


def _inside(cue: Entry) -> list[Entry]:
    """Words of the line that has times: each lasts until the next time."""
    line = next(line for line in cue.label.split("\n") if _INSIDE.search(line))
    found = list(_INSIDE.finditer(line))
    times_s = [cue.start_s, *(_clock_s(match.groups()) for match in found), cue.end_s]
    texts = [line[: found[0].start()], *(line[a.end() : b] for a, b in zip(
        found, [*(match.start() for match in found[1:]), len(line)], strict=True))]  # fmt: skip
    return [
        Entry(start_s, max(start_s, end_s), _TAG.sub("", text), cue.where)
        for start_s, end_s, text in zip(times_s[:-1], times_s[1:], texts, strict=True)
        if _TAG.sub("", text).strip()
    ]
