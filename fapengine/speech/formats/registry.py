"""The table of timing formats, and finding the format of a file from its content."""

from collections.abc import Callable
from dataclasses import dataclass

from fapengine.errors import DataError, UsageError
from fapengine.speech.formats import animation, corpora, detection, services, singing, spoken_words
from fapengine.speech.formats.corpora import parse_mfa_csv, parse_mfa_json
from fapengine.speech.formats.services import parse_polly
from fapengine.speech.formats.synthesizers import (
    LISTS,
    parse_espeak_events,
    parse_headtts,
    parse_kokoro,
    parse_pho,
    parse_phone_list,
    parse_piper,
    parse_voicevox,
)
from fapengine.speech.formats.table import parse_columns, parse_table
from fapengine.speech.formats.textgrid import parse_textgrid
from fapengine.speech.formats.word_lists import WORD_LISTS, WordList, is_word_list, parse_subtitles, parse_word_list
from fapengine.speech.phone_track import PhoneTrack


@dataclass(frozen=True, slots=True)
class ParseOptions:
    """What the caller may say about a file that does not say it itself."""

    tier: str | None = None
    """Tier, or speaker of MFA's CSV."""
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
    parse: Callable[[bytes, ParseOptions], PhoneTrack]
    fits: Callable[[detection.Sample], bool]
    endings: tuple[str, ...] = ()
    """Endings of file names that decide where the content does not."""
    takes: tuple[str, ...] = ()
    """Names of the options in :class:`ParseOptions` that mean something for it."""
    rivals: tuple[str, ...] = ()
    """Formats that some content fits as well, and means something else by it: then the user must say which."""


def _word_list(kind: WordList) -> Format:
    return Format(
        kind.name,
        kind.tool,
        lambda data, wishes: parse_word_list(data, kind=kind, tier=wishes.tier),
        lambda sample: is_word_list(kind, sample.document),
        (),
        ("tier",) if kind.name == "deepgram" else (),
        ("elevenlabs",) if kind.name == "assemblyai" else (),
    )


# fmt: off
FORMATS: dict[str, Format] = {each.name: each for each in (
    Format("textgrid", "Praat, MFA", lambda d, w: parse_textgrid(d, tier=w.tier, alphabet=w.alphabet),
           detection.is_textgrid, (".textgrid",), ("tier", "alphabet")),
    Format("mfa-json", "Montreal Forced Aligner", lambda d, w: parse_mfa_json(d, tier=w.tier, alphabet=w.alphabet),
           detection.has("tiers"), (), ("tier", "alphabet")),
    Format("mfa-csv", "Montreal Forced Aligner",
           lambda d, w: parse_mfa_csv(d, tier=w.tier, alphabet=w.alphabet),
           lambda s: bool(s.rows) and s.rows[0].strip() == "Begin,End,Label,Type,Speaker", (), ("tier", "alphabet")),
    Format("gentle", "Gentle", lambda d, w: spoken_words.parse_gentle(d, alphabet=w.alphabet),
           lambda s: spoken_words.is_gentle(s.first()), (), ("alphabet",)),
    Format("pocketsphinx", "PocketSphinx 5, pocketsphinx align",
           lambda d, w: spoken_words.parse_pocketsphinx(d, alphabet=w.alphabet), detection.has("b", "d", "w"), (),
           ("alphabet",)),
    Format("aeneas", "aeneas", lambda d, w: spoken_words.parse_aeneas(d), detection.has("fragments")),
    Format("inworld", "Inworld TTS", lambda d, w: spoken_words.parse_inworld(d, alphabet=w.alphabet),
           lambda s: s.document is not None and spoken_words.is_inworld(s.document), (), ("alphabet",)),
    Format("fish", "Fish Audio", lambda d, w: spoken_words.parse_fish(d),
           lambda s: s.document is not None and spoken_words.is_fish(s.document)),
    Format("diffsinger", "DiffSinger", lambda d, w: singing.parse_diffsinger(d, alphabet=w.alphabet),
           detection.has("ph_seq"), (".ds",), ("alphabet",)),
    Format("phone-list", "PocketSphinx, others", lambda d, w: parse_phone_list(d, alphabet=w.alphabet),
           detection.has_list(*LISTS), (), ("alphabet",)),
    *map(_word_list, WORD_LISTS),
    Format("espeak-json", "espeak-ng", lambda d, w: parse_espeak_events(d, alphabet=w.alphabet),
           detection.is_espeak, (), ("alphabet",)),
    Format("polly", "Amazon Polly speech marks", lambda d, w: parse_polly(d), detection.has("time", "type", "value")),
    Format("azure", "Azure Speech visemes", lambda d, w: services.parse_azure(d),
           lambda s: services.is_event(s.first())),
    Format("elevenlabs", "ElevenLabs alignments", lambda d, w: services.parse_elevenlabs(d), detection.is_elevenlabs),
    Format("cartesia", "Cartesia timestamps", lambda d, w: services.parse_cartesia(d),
           detection.any_event_has(*services.TIMESTAMPS)),
    Format("voicevox", "VOICEVOX audio queries", lambda d, w: parse_voicevox(d), detection.has("accent_phrases")),
    Format("kokoro", "Kokoro tokens", lambda d, w: parse_kokoro(d), detection.is_kokoro),
    Format("headtts", "HeadTTS visemes", lambda d, w: parse_headtts(d), detection.is_headtts),
    Format("piper", "Piper phoneme alignments", lambda d, w: parse_piper(d), detection.is_piper),
    Format("rhubarb-json", "Rhubarb Lip Sync", lambda d, w: animation.parse_rhubarb_json(d),
           detection.has("mouthCues")),
    Format("rhubarb-xml", "Rhubarb Lip Sync", lambda d, w: animation.parse_rhubarb_xml(d),
           lambda s: b"<rhubarbResult" in s.head),
    Format("rhubarb-tsv", "Rhubarb Lip Sync", lambda d, w: corpora.parse_rhubarb_tsv(d),
           lambda s: s.every_row(rf"{detection.NUMBER}\t[A-HX]\s*")),
    Format("subtitles", "SRT and WebVTT with words: edge-tts, Whisper, YouTube", lambda d, w: parse_subtitles(d),
           detection.is_subtitles, (".srt", ".vtt")),
    Format("papagayo", "Papagayo", lambda d, w: animation.parse_papagayo(d, tier=w.tier, alphabet=w.alphabet),
           detection.starts_with("lipsync version 1"), (".pgo",), ("tier", "alphabet")),
    Format("moho", "Moho switch layers",
           lambda d, w: animation.parse_moho(d, rate_hz=parse_columns(w.columns or "").rate_hz, alphabet=w.alphabet),
           detection.starts_with("MohoSwitch1"), (), ("alphabet", "columns")),
    Format("utau", "UTAU, OpenUtau", lambda d, w: singing.parse_utau(d, alphabet=w.alphabet), detection.is_utau,
           (".ust", ".ustx"), ("alphabet",)),
    Format("timit", "TIMIT .PHN and .WRD", lambda d, w: corpora.parse_timit(d, alphabet=w.alphabet),
           detection.is_timit, (".phn", ".wrd"), ("alphabet",), ("align",)),
    Format("align", "GRID corpus", lambda d, w: corpora.parse_align(d), detection.is_grid, (".align",), (), ("timit",)),
    Format("xlabel", "Festival, MARY", lambda d, w: corpora.parse_xlabel(d, alphabet=w.alphabet),
           detection.is_xlabel, (), ("alphabet",)),
    Format("htk", "HTK, Merlin, Julius, Audacity labels", lambda d, w: corpora.parse_htk(
               d, alphabet=w.alphabet, rate_hz=parse_columns(w.columns or "").rate_hz),
           detection.is_three_columns, (".lab",), ("alphabet", "columns")),
    Format("ctm", "CTM: Kaldi, NeMo", lambda d, w: corpora.parse_ctm(d, tier=w.tier, alphabet=w.alphabet),
           detection.is_ctm, (".ctm",), ("tier", "alphabet")),
    Format("flite", "flite -psdur", lambda d, w: corpora.parse_flite(d, alphabet=w.alphabet),
           lambda s: s.every_row(rf"(\S+:{detection.NUMBER}\s*)+"), (), ("alphabet",)),
    Format("pho", "MBROLA, espeak-ng --pho", lambda d, w: parse_pho(d, alphabet=w.alphabet or "x-sampa"),
           detection.is_pho, (".pho",), ("alphabet",)),
    Format("table", "CSV, TSV and JSON lists", lambda d, w: parse_table(d, columns=w.columns, alphabet=w.alphabet),
           detection.is_table, (".csv", ".tsv"), ("alphabet", "columns")),
)}
"""All formats; where the content fits several, the first."""
# fmt: on
def guess_format(data: bytes, *, ending: str = "") -> Format | None:
    """Find the format from the content, else from the ending of the name; None if neither tells."""
    found = _fitting(data, ending)
    return found[0] if found else None


def _fitting(data: bytes, ending: str) -> list[Format]:
    """Return the format, and behind it those that mean something else by the same content."""
    sample = detection.sample_of(data)
    named = [each for each in FORMATS.values() if ending.lower() in each.endings]
    best = next((each for each in FORMATS.values() if each.fits(sample)), None)
    if best is None:
        return named[:1]
    rivals = [FORMATS[name] for name in best.rivals if FORMATS[name].fits(sample)]
    said = [each for each in (best, *rivals) if each in named]
    return said if len(said) == 1 else [best, *rivals]


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
        Tier, alphabet, columns.
    """
    wishes = wishes or ParseOptions()
    if file_format is not None and file_format not in FORMATS:
        raise UsageError(f"file_format: unknown value {file_format!r}; use one of {', '.join(FORMATS)}")
    fitting = [FORMATS[file_format]] if file_format else _fitting(data, ending)
    if not fitting:
        raise DataError(
            f"timings: got {data[:24]!r}.., which is no format that is known; file_format=NAME says which:"
            f" {', '.join(FORMATS)}"
        )
    if len(fitting) > 1:
        readings = " and ".join(f"{each.name} ({each.tool})" for each in fitting)
        raise DataError(f"timings: {readings} mean different times by this content; file_format=NAME says which it is")
    chosen = fitting[0]
    for wish in ("tier", "alphabet", "columns"):
        if getattr(wishes, wish) is not None and wish not in chosen.takes:
            raise UsageError(f"{wish}: got {getattr(wishes, wish)!r}, but the format {chosen.name} has no choice of it")
    return chosen.parse(data, wishes)
