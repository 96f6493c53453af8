"""The table of timing formats, and finding the format of a file from its content."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from fapengine.errors import DataError, UsageError
from fapengine.speech import azure, characters, documents, lines, rhubarb
from fapengine.speech.documents import Node
from fapengine.speech.espeak_events import parse_espeak_events
from fapengine.speech.kokoro import parse_headtts, parse_kokoro
from fapengine.speech.mfa import parse_mfa_json
from fapengine.speech.pho import parse_pho
from fapengine.speech.phone_list import LISTS, parse_phone_list
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.piper import LIST_KEYS, parse_piper
from fapengine.speech.polly import parse_polly
from fapengine.speech.textgrid import decode_text, parse_textgrid
from fapengine.speech.voicevox import parse_voicevox


@dataclass(frozen=True, slots=True)
class ParseOptions:
    """What the caller may say about a file that does not say it itself."""

    tier: str | None = None
    """Tier, or speaker of MFA's CSV."""
    alphabet: str | None = None
    """One of :data:`fapengine.speech.alphabets.ALPHABETS`."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What is looked at to find a format."""

    head: bytes
    rows: tuple[str, ...]
    """First lines that are not blank."""
    document: Node | None
    """The content, if it is JSON or JSON lines."""

    def first(self) -> Node:
        """First value of a list, or the value itself."""
        if self.document is None:
            return Node(None)
        values = self.document.value
        return Node(values[0] if isinstance(values, list) and values else values)

    def every_row(self, pattern: str) -> bool:
        """Whether every row looks so, and there is one."""
        return self.document is None and bool(self.rows) and all(re.fullmatch(pattern, row) for row in self.rows)


@dataclass(frozen=True, slots=True)
class Format:
    """One timing format."""

    name: str
    """Name by which the format is chosen."""
    tool: str
    """Programs that write it."""
    parse: Callable[[bytes, ParseOptions], PhoneTrack]
    fits: Callable[[Sample], bool]
    endings: tuple[str, ...] = ()
    """Endings of file names that decide where the content does not."""
    takes: tuple[str, ...] = ()
    """Names of the options in :class:`ParseOptions` that mean something for it."""


_NUMBER = r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?"
_MAX_GRID_SAMPLES = 1_000_000
"""Largest number in three integer columns that means GRID's samples (40 s) rather than HTK's units (0.1 s)."""


def _is_three_columns(sample: Sample) -> bool:
    return sample.every_row(rf"\s*{_NUMBER}\s+{_NUMBER}\s+\S.*")


def _is_grid(sample: Sample) -> bool:
    if not _is_three_columns(sample) or any("." in "".join(row.split()[:2]) for row in sample.rows):
        return False
    return max(float(row.split()[1]) for row in sample.rows) < _MAX_GRID_SAMPLES


def _has(*keys: str) -> Callable[[Sample], bool]:
    return lambda sample: sample.first().has(*keys)


def _has_any(*keys: str) -> Callable[[Sample], bool]:
    return lambda sample: any(sample.first().has(key) for key in keys)


def _is_piper(sample: Sample) -> bool:
    node = sample.first()
    if node.has("last"):
        node = node["last"]
    return any(node.has(key) and _listed(node[key], "phoneme") for key in LIST_KEYS) or (
        node.has("phoneme") and (node.has("seconds") or node.has("num_samples"))
    )


def _listed(node: Node, key: str) -> bool:
    return isinstance(node.value, list) and any(Node(item).has(key) for item in node.value[:1])


def _is_kokoro(sample: Sample) -> bool:
    node = sample.first()
    tokens = node["tokens"].value if node.has("tokens") else sample.document.value if sample.document else None
    timed = isinstance(tokens, list) and any(Node(item).has("start_ts") for item in tokens[:20])
    return node.has("pred_dur") or timed


def _is_espeak(sample: Sample) -> bool:
    node = sample.first()
    event = next(node["events"].items()) if node.has("events") and _listed(node["events"], "type") else node
    return event.has("type") and any(event.has(key) for key in ("sample", "audio_position_ms", "audio_position"))


def _is_elevenlabs(sample: Sample) -> bool:
    node = sample.first()
    spoken = node.has("words") and _listed(node["words"], "text")
    return spoken or any(node.has(key) for key in (*characters.ALIGNMENTS, *characters.CHARACTERS))


def _is_headtts(sample: Sample) -> bool:
    node = sample.first()
    return (node["data"] if node.has("data") else node).has("visemes", "vtimes")


def _is_textgrid(sample: Sample) -> bool:
    head = sample.head.replace(b"\0", b"")
    return b"ooTextFile" in head or b"TextGrid" in head or b"ooBinaryFile" in head


def _is_xlabel(sample: Sample) -> bool:
    rows = sample.rows
    return sample.document is None and "#" in rows and any(re.match(rf"{_NUMBER}\s+\d+\s", row) for row in rows)


# fmt: off
FORMATS: dict[str, Format] = {each.name: each for each in (
    Format("textgrid", "Praat, MFA", lambda d, w: parse_textgrid(d, tier=w.tier, alphabet=w.alphabet),
           _is_textgrid, (".textgrid",), ("tier", "alphabet")),
    Format("mfa-json", "Montreal Forced Aligner", lambda d, w: parse_mfa_json(d, tier=w.tier, alphabet=w.alphabet),
           _has("tiers"), (), ("tier", "alphabet")),
    Format("mfa-csv", "Montreal Forced Aligner",
           lambda d, w: lines.parse_mfa_csv(d, tier=w.tier, alphabet=w.alphabet),
           lambda s: bool(s.rows) and s.rows[0].strip() == "Begin,End,Label,Type,Speaker", (), ("tier", "alphabet")),
    Format("espeak-json", "espeak-ng", lambda d, w: parse_espeak_events(d, alphabet=w.alphabet), _is_espeak, (),
           ("alphabet",)),
    Format("polly", "Amazon Polly speech marks", lambda d, w: parse_polly(d), _has("time", "type", "value")),
    Format("azure", "Azure Speech visemes", lambda d, w: azure.parse_azure(d), lambda s: azure.is_event(s.first())),
    Format("elevenlabs", "ElevenLabs alignments", lambda d, w: characters.parse_elevenlabs(d), _is_elevenlabs),
    Format("cartesia", "Cartesia timestamps", lambda d, w: characters.parse_cartesia(d),
           _has_any(*characters.TIMESTAMPS)),
    Format("voicevox", "VOICEVOX audio queries", lambda d, w: parse_voicevox(d), _has("accent_phrases")),
    Format("kokoro", "Kokoro tokens", lambda d, w: parse_kokoro(d), _is_kokoro),
    Format("headtts", "HeadTTS visemes", lambda d, w: parse_headtts(d), _is_headtts),
    Format("piper", "Piper phoneme alignments", lambda d, w: parse_piper(d), _is_piper),
    Format("rhubarb-json", "Rhubarb Lip Sync", lambda d, w: rhubarb.parse_rhubarb_json(d), _has("mouthCues")),
    Format("rhubarb-xml", "Rhubarb Lip Sync", lambda d, w: rhubarb.parse_rhubarb_xml(d),
           lambda s: b"<rhubarbResult" in s.head),
    Format("rhubarb-tsv", "Rhubarb Lip Sync", lambda d, w: lines.parse_rhubarb_tsv(d),
           lambda s: s.every_row(rf"{_NUMBER}\t[A-HX]\s*"), (".tsv",)),
    Format("phone-list", "PocketSphinx, others", lambda d, w: parse_phone_list(d, alphabet=w.alphabet),
           _has_any(*LISTS), (), ("alphabet",)),
    Format("align", "GRID corpus", lambda d, w: lines.parse_align(d), _is_grid, (".align",)),
    Format("xlabel", "Festival, MARY", lambda d, w: lines.parse_xlabel(d, alphabet=w.alphabet), _is_xlabel, (),
           ("alphabet",)),
    Format("htk", "HTK, Merlin, Audacity labels", lambda d, w: lines.parse_htk(d, alphabet=w.alphabet),
           _is_three_columns, (".lab",), ("alphabet",)),
    Format("flite", "flite -psdur", lambda d, w: lines.parse_flite(d, alphabet=w.alphabet),
           lambda s: s.every_row(rf"(\S+:{_NUMBER}\s*)+"), (), ("alphabet",)),
    Format("pho", "MBROLA, espeak-ng --pho", lambda d, w: parse_pho(d, alphabet=w.alphabet or "x-sampa"),
           lambda s: s.every_row(rf"\s*(;.*|\S+\s+{_NUMBER}(\s.*)?)"), (".pho",), ("alphabet",)),
)}
"""All formats; where the content fits several, the first."""
# fmt: on
_ROWS = 50


def guess_format(data: bytes, *, ending: str = "") -> Format | None:
    """Find the format from the content, else from the ending of the name; None if neither tells."""
    sample = _sample(data)
    by_content = (each for each in FORMATS.values() if each.fits(sample))
    by_name = (each for each in FORMATS.values() if ending.lower() in each.endings)
    return next(by_content, None) or next(by_name, None)


def _sample(data: bytes) -> Sample:
    try:
        text = decode_text(data, "file")
    except DataError:
        return Sample(data[:1000], (), None)
    document = None
    if text.lstrip()[:1] in ("{", "["):
        try:
            document = documents.parse_document(data, "file")
        except DataError:
            document = Node(None)
    rows = tuple(row for row in text[:20_000].splitlines()[:_ROWS] if row.strip())
    return Sample(data[:1000], rows, document)


def parse_timings(
    data: bytes, *, file_format: str | None = None, ending: str = "", wishes: ParseOptions | None = None
) -> PhoneTrack:
    """Read timed phones, visemes or words in any format of :data:`FORMATS`.

    Parameters
    ----------
    data : bytes
        The whole file.
    file_format : str, optional
        Name of the format; by default found from the content, else from ``ending``.
    ending : str
        Ending of the file's name, such as ``".lab"``.
    wishes : ParseOptions, optional
        Tier and alphabet.

    Raises
    ------
    UsageError
        If there is no such format, or it has no such choice.
    DataError
        If the content is of no format, or damaged.
    """
    wishes = wishes or ParseOptions()
    if file_format is not None and file_format not in FORMATS:
        raise UsageError(f"file_format: got {file_format!r}, expected one of {', '.join(FORMATS)}")
    chosen = FORMATS[file_format] if file_format else guess_format(data, ending=ending)
    if chosen is None:
        raise DataError(
            f"timings: got {data[:24]!r}.., which is no format that is known; file_format=NAME says which:"
            f" {', '.join(FORMATS)}"
        )
    for wish in ("tier", "alphabet"):
        if getattr(wishes, wish) is not None and wish not in chosen.takes:
            raise UsageError(f"{wish}: got {getattr(wishes, wish)!r}, but the format {chosen.name} has no choice of it")
    return chosen.parse(data, wishes)
