"""The table of timing formats; a file's format is found from its content.

The language of timed words: recognizers name it in JSON: Whisper, OpenAI, ElevenLabs and Rev ``language`` (a code or a
name), AssemblyAI and Amazon ``language_code``, Google ``languageCode``, Deepgram ``detected_language``, Azure
``locale``, whisper.cpp ``result.language``, Speechmatics ``metadata.transcription_config.language``. WebVTT files of
YouTube name it in the header: ``Language: fr``.
"""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from fapengine.errors import DataError, UsageError
from fapengine.speech.alphabets.convert import ALPHABETS
from fapengine.speech.formats import animation, corpora, detection, services, synthesizers
from fapengine.speech.formats.detection import Sample, has
from fapengine.speech.formats.documents import NUMBER, decode_text, parse_document
from fapengine.speech.formats.table import parse_columns, parse_table
from fapengine.speech.formats.textgrid import parse_elan, parse_textgrid
from fapengine.speech.formats.word_lists import WORD_LISTS, parse_subtitles, parse_word_list
from fapengine.speech.phone_track import PhoneTrack


@dataclass(frozen=True, slots=True)
class ParseOptions:
    """Options for a file that does not contain them."""

    tier: str | None = None
    """Tier, speaker, recording, voice or channel."""
    alphabet: str | None = None
    """One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`."""
    columns: str | None = None
    """Mapping of a list's columns, its unit, or a rate: see :func:`fapengine.speech.formats.table.parse_columns`."""


@dataclass(frozen=True, slots=True)
class Format:
    """One timing format."""

    name: str
    """Name by which the format is chosen."""
    tool: str
    """Programs that write it."""
    parse: Callable[..., PhoneTrack]
    """Function of the file's bytes, with the options of ``takes`` as keywords."""
    fits: Callable[[Sample], bool]
    endings: tuple[str, ...] = ()
    """Endings of file names, which decide if the content does not."""
    takes: tuple[str, ...] = ()
    """Options of :class:`ParseOptions` that it uses."""
    rivals: tuple[str, ...] = ()
    """Formats that read other times from the same content: then the user must choose."""


_ALPHABET, _TIER_ALPHABET, _ALPHABET_COLUMNS = ("alphabet",), ("tier", "alphabet"), ("alphabet", "columns")
# fmt: off
FORMATS: dict[str, Format] = {each.name: each for each in (
    Format("textgrid", "Praat, MFA", parse_textgrid, detection.is_textgrid, (".textgrid",), _TIER_ALPHABET),
    Format("mfa-json", "Montreal Forced Aligner", corpora.parse_mfa_json, has("tiers"), (), _TIER_ALPHABET),
    Format("mfa-csv", "Montreal Forced Aligner", corpora.parse_mfa_csv,
           detection.starts_with("Begin,End,Label,Type,Speaker"), (), _TIER_ALPHABET),
    Format("gentle", "Gentle", corpora.parse_gentle, lambda s: corpora.is_gentle(s.first()), (), _ALPHABET),
    Format("pocketsphinx", "PocketSphinx 5, pocketsphinx align", corpora.parse_pocketsphinx, has("b", "d", "w"), (),
           _ALPHABET),
    Format("aeneas", "aeneas", corpora.parse_aeneas, has("fragments")),
    Format("inworld", "Inworld TTS", services.parse_inworld,
           lambda s: s.document is not None and any(services.inworld_infos(s.document)), (), _ALPHABET),
    Format("hume", "Hume Octave", services.parse_hume,
           lambda s: s.document is not None and any(services.hume_stamps(s.document)), (), ("tier",)),
    Format("resemble", "Resemble AI", services.parse_resemble,
           lambda s: s.document is not None and any(services.resemble_timings(s.document))),
    Format("fish", "Fish Audio", services.parse_fish,
           lambda s: s.document is not None and services.is_fish(s.document)),
    Format("diffsinger", "DiffSinger", synthesizers.parse_diffsinger, has("ph_seq"), (".ds",), _ALPHABET),
    Format("phone-list", "PocketSphinx, others", synthesizers.parse_phone_list, detection.is_phone_list, (), _ALPHABET),
    *(Format(kind.name, kind.tool, partial(parse_word_list, kind=kind), detection.has_words(kind), (),
             ("tier",) if kind.name == "deepgram" else (), ("elevenlabs",) if kind.name == "assemblyai" else ())
      for kind in WORD_LISTS),
    Format("espeak-json", "espeak-ng", synthesizers.parse_espeak_events, detection.is_espeak, (), _ALPHABET),
    Format("polly", "Amazon Polly speech marks", services.parse_polly, has("time", "type", "value")),
    Format("azure", "Azure Speech visemes", services.parse_azure,
           lambda s: s.document is not None and bool(services.azure_events(s.document)), (), ("columns",)),
    Format("elevenlabs", "ElevenLabs alignments", services.parse_elevenlabs, detection.is_elevenlabs),
    Format("cartesia", "Cartesia timestamps", services.parse_cartesia, detection.any_event_has(*services.TIMESTAMPS)),
    Format("voicevox", "VOICEVOX audio queries", synthesizers.parse_voicevox, has("accent_phrases")),
    Format("kokoro", "Kokoro tokens", synthesizers.parse_kokoro, detection.is_kokoro),
    Format("headtts", "HeadTTS visemes", synthesizers.parse_headtts, detection.is_headtts),
    Format("piper", "Piper phoneme alignments", synthesizers.parse_piper, detection.is_piper),
    Format("rhubarb-json", "Rhubarb Lip Sync", animation.parse_rhubarb_json, has("mouthCues")),
    Format("rhubarb-xml", "Rhubarb Lip Sync", animation.parse_rhubarb_xml, lambda s: b"<rhubarbResult" in s.head),
    Format("rhubarb-tsv", "Rhubarb Lip Sync", corpora.parse_rhubarb_tsv,
           lambda s: s.every_row(rf"{NUMBER}\t[A-HX]\s*")),
    Format("subtitles", "SRT and WebVTT with words: edge-tts, Whisper, YouTube", parse_subtitles,
           detection.is_subtitles, (".srt", ".vtt")),
    Format("papagayo", "Papagayo", animation.parse_papagayo, detection.is_papagayo, (".pgo",), _TIER_ALPHABET),
    Format("elan", "ELAN", parse_elan, lambda s: b"<ANNOTATION_DOCUMENT" in s.head, (".eaf",), _TIER_ALPHABET),
    Format("moho", "Moho switch layers", animation.parse_moho, detection.starts_with("MohoSwitch1"), (),
           _ALPHABET_COLUMNS),
    Format("utau", "UTAU, OpenUtau", synthesizers.parse_utau, detection.is_utau, (".ust", ".ustx"), _ALPHABET),
    Format("timit", "TIMIT .PHN and .WRD", corpora.parse_timit, detection.is_timit, (".phn", ".wrd"), _ALPHABET,
           ("align",)),
    Format("align", "GRID corpus", corpora.parse_align, detection.is_grid, (".align",), (), ("timit",)),
    Format("xlabel", "Festival, MARY", corpora.parse_xlabel, detection.is_xlabel, (), _ALPHABET),
    Format("mlf", "HTK master label files: FAVE, P2FA", corpora.parse_mlf, detection.starts_with("#!MLF!#"), (".mlf",),
           _TIER_ALPHABET),
    Format("allosaurus", "Allosaurus", corpora.parse_allosaurus, detection.is_allosaurus),
    Format("htk", "HTK, Merlin, Julius, Audacity labels", corpora.parse_htk, detection.is_three_columns, (".lab",),
           _ALPHABET_COLUMNS),
    Format("ctm", "CTM: Kaldi, NeMo", corpora.parse_ctm, detection.is_ctm, (".ctm",), _TIER_ALPHABET),
    Format("flite", "flite -psdur", corpora.parse_flite, lambda s: s.every_row(rf"(\S+:{NUMBER}\s*)+"), (), _ALPHABET),
    Format("pho", "MBROLA, espeak-ng --pho", synthesizers.parse_pho, detection.is_pho, (".pho",), _ALPHABET),
    Format("table", "CSV, TSV and JSON lists", parse_table, detection.is_table, (".csv", ".tsv"), _ALPHABET_COLUMNS),
)}
"""All formats; where the content fits several, the first."""
# fmt: on


def guess_format(data: bytes, *, ending: str = "") -> Format | None:
    """Find the format from the content, else from the ending of the name; None for an unknown format."""
    found = _fitting(data, ending)
    return found[0] if found else None


def _fitting(data: bytes, ending: str) -> list[Format]:
    """Return the format, followed by its rivals."""
    sample = detection.sample_of(data)
    named = [each for each in FORMATS.values() if ending.lower() in each.endings]
    best = next((each for each in FORMATS.values() if each.fits(sample)), None)
    if best is None:
        return named[:1]
    rivals = [FORMATS[name] for name in best.rivals if FORMATS[name].fits(sample)]
    decided = [each for each in (best, *rivals) if each in named]
    return decided if len(decided) == 1 else [best, *rivals]


def check_options(file_format: str | None, options: ParseOptions) -> None:
    """Reject unknown formats, alphabets and columns. Raises UsageError."""
    if file_format is not None and file_format not in FORMATS:
        raise UsageError(f"format: unknown value {file_format!r}; use one of {', '.join(FORMATS)}")
    if options.alphabet is not None and options.alphabet not in ALPHABETS:
        raise UsageError(f"alphabet: unknown value {options.alphabet!r}; use one of {', '.join(ALPHABETS)}")
    parse_columns(options.columns)


def parse_timings(
    data: bytes, *, file_format: str | None = None, ending: str = "", options: ParseOptions | None = None
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
    options : ParseOptions, optional
        Tier, alphabet, columns.
    """
    options = options or ParseOptions()
    check_options(file_format, options)
    if file_format is None and parse_columns(options.columns).names:
        file_format = "table"
    fitting = [FORMATS[file_format]] if file_format else _fitting(data, ending)
    if not data.strip():
        raise DataError("timings: the file is empty")
    if not fitting:
        raise DataError(
            f"timings: got {data[:24]!r}.., expected a known format; choose one with format=NAME: {', '.join(FORMATS)}"
        )
    if len(fitting) > 1:
        readings = " and ".join(f"{each.name} ({each.tool})" for each in fitting)
        raise DataError(f"timings: {readings} read different times from this content; choose with format=NAME")
    chosen = fitting[0]
    for name, value in asdict(options).items():
        if value is not None and name not in chosen.takes:
            raise UsageError(f"{name}: got {value!r}, but the format {chosen.name} has no such option")
    track = chosen.parse(data, **{name: getattr(options, name) for name in chosen.takes})
    if not track.spelled or track.reading.language:
        return track
    return replace(track, reading=replace(track.reading, language=language_of(data)))


_KEYS = (
    "language", "language_code", "languageCode", "detected_language", "detectedLanguage", "lang", "locale", "Language"
)  # fmt: skip
_UNKNOWN = frozenset({"", "auto", "detect", "unknown", "und", "multi", "mul", "none", "null"})
_HEADER = re.compile(r"^(?:X-)?Language\s*[:=]\s*\"?([A-Za-z0-9_-]+)\"?\s*$", re.MULTILINE | re.IGNORECASE)
_SPAN = re.compile(r"<lang ([A-Za-z0-9-]+)>")
_DEPTH, _ITEMS = 9, 20
"""Levels of a document, and items of a list, that are searched."""


def language_of(data: bytes) -> str:
    r"""Find the language in a file, as it is spelled there; empty if the file names none.

    Examples
    --------
    >>> language_of(b'{"segments": [], "language": "french"}'), language_of(b"WEBVTT\nLanguage: pt-BR\n\n")
    ('french', 'pt-BR')
    """
    try:
        text = decode_text(data, "file").lstrip()
        if text.startswith("WEBVTT"):
            header = _HEADER.search(re.split(r"\r?\n\r?\n", text, maxsplit=1)[0]) or _SPAN.search(text)
            return header[1] if header else ""
        return _named([parse_document(data, "file").value])
    except DataError:  # neither: lines of labels
        return ""


def _named(values: list[Any]) -> str:
    """Search values level by level; where a level names several languages, the commonest counts."""
    for _ in range(_DEPTH):
        below: list[Any] = []
        found: Counter[str] = Counter()
        for value in values:
            if isinstance(value, list):
                below += value[:_ITEMS]
            elif isinstance(value, dict):
                listed = value.get("languages")
                named = [*(value.get(key) for key in _KEYS), *(listed if isinstance(listed, list) else ())]
                known = [str(name).strip() for name in named if isinstance(name, str)]
                found.update([name for name in known if name.lower() not in _UNKNOWN][:1])
                below += value.values()
        if found:
            return found.most_common(1)[0][0]
        values = below
    return ""
