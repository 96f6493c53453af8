"""Timings of speech synthesizers that run locally: MBROLA, phone lists, espeak-ng, VOICEVOX, Kokoro, HeadTTS, Piper.

MBROLA ``.pho``: one phone a line, ``name milliseconds [percent hertz]...``; ``;`` begins a comment. Names are SAMPA of
the language (MBROLA documentation), ``_`` is silence.

Phone lists, as many small tools write them in JSON (wrappers of PocketSphinx, piper-plus, FastSpeech 2):
``{"phones": [...]}`` or ``{"phonemes": [...]}`` of objects with a label (``phone``, ``phoneme``, ``label``), and
``start`` and ``end`` in seconds or ``offset`` and ``duration`` in ms; a ``word`` if known.

VOICEVOX audio query (engine 0.14 and later): morae with the lengths of consonant and vowel, in seconds.

espeak-ng events as JSON, in the shape of ``espeak_EVENT`` (speak_lib.h, API revision 12), type by name or by number.
PHONEME is the onset of a phone, in mnemonics of espeak-ng or in IPA. Pauses are ``_`` and ``_:``, in IPA the empty
text. A WORD event names a place in the text, if the file has the text.

Kokoro 0.9 (``KPipeline``): ``tokens`` have ``text``, ``phonemes`` (Misaki), ``start_ts``, ``end_ts`` in seconds: words
are timed, their phones spread evenly. With ``pred_dur`` the phones themselves are timed: one count for each character
of ``phonemes``, with one before and one after; a unit is 600 samples at 24 kHz. HeadTTS: parallel lists of Oculus
visemes in ms.

Piper 1.3 phoneme alignments: IPA code points, each with its length. Shapes: ``{"phoneme", "seconds"}`` (Piper's HTTP
server, GET /info, ``last.alignments``), ``PhonemeAlignment`` of ``piper.voice`` (``phoneme``, ``num_samples``, with
``sample_rate`` next to the list). A code point for a modifier (stress, length, tie) belongs to its neighbour; blanks,
punctuation, ``^`` and ``$`` are pauses.

Songs: DiffSinger ``.ds`` (openvpi): a list of phrases with ``offset``, ``ph_seq`` and ``ph_dur`` (texts, s). UTAU
``.ust``: sections ``[#0000]`` with ``Length`` in ticks (480 a quarter), ``Lyric`` and ``Tempo``; OpenUtau exports it.
"""

import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import replace

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech import ipa
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.alphabets.phone_sets import ESPEAK
from fapengine.speech.formats.documents import Node, decode_text, number_of, parse_document, rows_of_lists
from fapengine.speech.formats.entries import Entry, in_sequence, shared_out, track_of, until_next, without_overlaps
from fapengine.speech.phone_track import PhoneTrack

MAX_PHONE_MS = 600_000.0
"""Ten minutes: longer is a mistake, not a phone."""


def parse_pho(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read a ``.pho`` file."""
    lengths: list[tuple[str, float, str]] = []
    for number, line in enumerate(decode_text(data, ".pho").splitlines(), start=1):
        fields, where = line.split(";", 1)[0].split(), f"line {number}"
        if len(fields) == 1:
            raise DataError(f".pho: got {line.strip()[:40]!r}, expected a phone and its milliseconds", where=where)
        if fields:
            length_ms = number_of(fields[1], "duration in ms", where, 0, MAX_PHONE_MS)
            for field in fields[2:]:
                number_of(field, "per cent or Hz", where)
            lengths.append((fields[0], length_ms / 1000, where))
    if not lengths:
        raise DataError(".pho: contains no phone; lines look like 'b 65'")
    return track_of(in_sequence(lengths), ".pho", alphabet=alphabet or "x-sampa")


LISTS = ("phones", "phonemes")
LABELS = ("phone", "phoneme", "label")
_BORDERS = frozenset({"<sos/eos>", "<sos>", "<eos>", "<s>", "</s>", "<blank>", ".", ",", ";", ":", "!"})


def parse_phone_list(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the list."""
    entries: list[Entry] = []
    for item in parse_document(data, "list of phones").first(*LISTS).items():
        label = item.first(*LABELS).text()
        if item.has("start"):
            start_s, end_s = item["start"].number(), item["end"].number()
        else:
            start_s = item["offset"].number() / 1000
            end_s = start_s + item["duration"].number() / 1000
        entries.append(Entry(start_s, end_s, "_" if label in _BORDERS else label, item.where, item.text_or("word")))
    return track_of(entries, "list of phones", alphabet=alphabet)


def parse_voicevox(data: bytes) -> PhoneTrack:
    """Read a query; all lengths are divided by ``speedScale``, pauses multiplied by ``pauseLengthScale``."""
    query = parse_document(data, "VOICEVOX")
    speed, pauses = _scale(query, "speedScale"), _scale(query, "pauseLengthScale")
    pieces: list[tuple[str, float, str, str]] = []

    def add(node: Node, key: str, label: str = "pau", text: str = "", scale: float = 1.0) -> None:
        pieces.append((label, node[key].number() * scale / speed, node[key].where, text))

    if query.has("prePhonemeLength"):
        add(query, "prePhonemeLength")
    for phrase in query["accent_phrases"].items():
        for mora in phrase["moras"].items():
            text = mora.text_or("text")
            if mora.has("consonant"):
                add(mora, "consonant_length", mora["consonant"].text(), text)
            add(mora, "vowel_length", mora["vowel"].text(), text)
        if phrase.has("pause_mora") and query.has("pauseLength"):
            add(query, "pauseLength", scale=pauses)
        elif phrase.has("pause_mora"):
            add(phrase["pause_mora"], "vowel_length", scale=pauses)
    if query.has("postPhonemeLength"):
        add(query, "postPhonemeLength")
    return track_of(in_sequence(pieces), "VOICEVOX", alphabet="voicevox")


def _scale(query: Node, key: str) -> float:
    scale = query.number_or(key, 1.0)
    if not 0.01 <= scale <= 100:
        raise DataError(f"{key}: must be 0.01 to 100, got {scale:g}", where=key)
    return scale


_TYPES = {1: "WORD", 2: "SENTENCE", 5: "END", 6: "MSG_TERMINATED", 7: "PHONEME"}
DEFAULT_RATE_HZ = 22050.0
_ADDITIONS = frozenset({"ʲ", "ʰ", "ː", ";"})
"""Events that modify the phone before them."""


def parse_espeak_events(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the events; without ``alphabet``, guess between mnemonics and IPA."""
    document = parse_document(data, "espeak-ng events")
    events = document["events"] if document.has("events") else document
    rate_hz = document.number_or("samplerate", DEFAULT_RATE_HZ)
    if rate_hz <= 0:
        raise DataError(f"samplerate: must be above 0, got {rate_hz:g}", where="samplerate")
    text, word = document.text_or("text"), ""
    onsets: list[tuple[float, str, str, str]] = []
    end_s: float | None = document["samples"].number() / rate_hz if document.has("samples") else None
    for event in events.items():
        kind = event["type"].value
        kind = kind if isinstance(kind, str) else _TYPES.get(int(event["type"].number()), "")
        if kind == "WORD" and event.has("text_position", "length"):
            start, length = (int(event[key].number()) for key in ("text_position", "length"))
            word = text[start - 1 : start - 1 + length] if start > 0 else ""
        elif kind == "PHONEME":
            label = event["phoneme"].text()
            if label not in _ADDITIONS:
                onsets.append((_time_s(event, rate_hz), label, event.where, word))
        elif kind == "END" and end_s is None:
            end_s = _time_s(event, rate_hz)
    alphabet = alphabet or _guess([label for _, label, _, _ in onsets])
    return track_of(until_next(onsets, end_s), "espeak-ng events", alphabet=alphabet)


def _time_s(event: Node, rate_hz: float) -> float:
    if event.has("sample"):
        return event["sample"].number() / rate_hz
    return event.first("audio_position_ms", "audio_position").number() / 1000


def _guess(labels: list[str]) -> str:
    """IPA if more labels are IPA than mnemonics; a colon for length is a mnemonic's."""
    spoken = [label for label in labels if label.strip("_:!|")]
    as_ipa = sum(bool(ipa.letters(label)) and ":" not in label for label in spoken)
    mnemonic = sum(ESPEAK.to_ipa(label) is not None for label in spoken)
    return "ipa" if as_ipa > mnemonic else "espeak"


UNIT_S = 600 / 24_000
_MARKS = "ː ʲʰ̩̃ᵝ→↗↘↓↑ꜜꜛ12345R"
"""Characters that change the phone before: length, tones, pitch."""


def parse_kokoro(data: bytes) -> PhoneTrack:
    """Read tokens, or ``phonemes`` with ``pred_dur``."""
    document = parse_document(data, "Kokoro")
    if document.has("pred_dur"):
        counts, text = document["pred_dur"].numbers(), document["phonemes"].text()
        if len(counts) != len(text) + 2:
            raise DataError(f"pred_dur: got {len(counts)} counts, expected {len(text) + 2}", where="pred_dur")
        lengths = zip(["_", *text, "_"], (count * UNIT_S for count in counts), strict=True)
        entries = kokoro_entries((letter, length_s, f"pred_dur[{n}]") for n, (letter, length_s) in enumerate(lengths))
        return track_of(entries, "Kokoro", alphabet="misaki")
    entries = []
    for token in (document["tokens"] if document.has("tokens") else document).items():
        if not token.has("start_ts", "end_ts"):
            continue  # punctuation
        word, phones = token.first("text", "word").text(), _split(token.text_or("phonemes"))
        entries += shared_out(token["start_ts"].number(), token["end_ts"].number(), phones, token.where, word)
    return track_of(entries, "Kokoro", alphabet="misaki", level="word")


def kokoro_entries(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
    """Entries of consecutive symbols (Misaki or IPA, length in s, where); modifiers join the phone before them."""
    entries: list[Entry] = []
    stress = ""
    for letter, length_s, where in lengths:
        last = entries[-1] if entries else Entry(0.0, 0.0, "_", "the begin")
        end_s = last.end_s + length_s
        if letter in ipa.STRESS or letter in _MARKS.strip() or (letter == " " and last.label != "_"):
            stress = letter if letter in ipa.STRESS else stress
            entries[-1:] = [replace(last, end_s=end_s)]
        else:
            entries.append(Entry(last.end_s, end_s, letter if letter == "_" else stress + letter, where))
            stress = ""
    return entries


def _split(phonemes: str) -> list[str]:
    """Split Misaki text into phones, each with its stress mark; other modifiers are dropped."""
    phones: list[str] = []
    stress = ""
    for letter in phonemes:
        if letter in ipa.STRESS:
            stress = letter
        elif letter not in _MARKS and letter.isalpha():
            phones.append(stress + letter)
            stress = ""
    return phones


def parse_headtts(data: bytes) -> PhoneTrack:
    """Read ``visemes``, ``vtimes``, ``vdurations``; HeadTTS overlaps them by 20 ms: a start ends the one before."""
    document = parse_document(data, "HeadTTS")
    entries: list[Entry] = []
    rows = rows_of_lists(document["data"] if document.has("data") else document, "visemes", "vtimes", "vdurations")
    for index, (start_ms, length_ms, label) in enumerate(rows):
        start_ms = max(start_ms, 0.0)  # 10 ms early, so that the first may begin before 0
        entries.append(Entry(start_ms / 1000, (start_ms + length_ms) / 1000, label, f"visemes[{index}]"))
    return track_of(without_overlaps(entries), "HeadTTS", alphabet="oculus-visemes", level="viseme")


LIST_KEYS = ("phoneme_alignments", "alignments")


def parse_piper(data: bytes) -> PhoneTrack:
    """Read the alignments of one or several sentences, in sequence."""
    document = parse_document(data, "Piper alignments")
    document = document["last"] if document.has("last") else document
    chunks = document.entries()
    if not (chunks and any(chunks[0].has(key) for key in LIST_KEYS)):
        chunks = [document]
    return track_of(piper_entries(_lengths(chunks)), "Piper alignments", alphabet="ipa")


def piper_entries(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
    """Entries of consecutive code points (label, length in s, where); modifiers join the phone before them."""
    entries: list[Entry] = []
    now_s = 0.0
    stress = ""
    for label, length_s, where in lengths:
        stress_mark, kind = label in ipa.STRESS, unicodedata.category(label[:1] or " ")
        if stress_mark or (entries and kind in ("Mn", "Lm", "Sk", "Cf")):
            stress = label if stress_mark else stress
            last = entries[-1] if entries else Entry(0.0, 0.0, "_", "the first mark")
            added = "" if stress_mark or last.label == "_" else label
            entries[-1:] = [replace(last, end_s=now_s + length_s, label=last.label + added)]
        else:
            silent = not label or kind[0] in "PZSC"
            entries.append(Entry(now_s, now_s + length_s, "_" if silent else stress + label, where))
            stress = stress if silent else ""
        now_s += length_s
    return entries


def _lengths(chunks: Iterable[Node]) -> Iterator[tuple[str, float, str]]:
    for chunk in chunks:
        rate_hz = chunk.number_or("sample_rate", 0.0)
        for item in (chunk.first(*LIST_KEYS) if not isinstance(chunk.value, list) else chunk).items():
            yield item["phoneme"].text(), _length_s(item, rate_hz), item.where


def _length_s(item: Node, rate_hz: float) -> float:
    if item.has("seconds"):
        length_s = item["seconds"].number()
    elif rate_hz > 0:
        length_s = item["num_samples"].number() / rate_hz
    else:
        raise DataError("seconds and sample_rate are missing; one of them is needed", where=item.where)
    if length_s < 0:
        raise DataError(f"length: must be 0 or more, got {length_s:g} s", where=item.where)
    return length_s


TICKS_A_QUARTER = 480
DEFAULT_BPM = 120.0
_REST = frozenset({"", "r", "rest", "sp", "ap", "-", "息", "br"})
_LANGUAGE = re.compile(r"^[a-z]{2,3}/(?=.)")


def parse_diffsinger(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones of all phrases, without the language before a phone (``zh/``)."""
    entries: list[Entry] = []
    for phrase in parse_document(data, "DiffSinger").entries():
        labels = phrase["ph_seq"].text().split()
        if not phrase.has("ph_dur"):
            raise DataError("DiffSinger: ph_dur is missing; let the variance model fill it in", where=phrase.where)
        lengths = [number_of(text, "ph_dur", phrase.where, 0, 1e6) for text in phrase["ph_dur"].text().split()]
        if len(lengths) != len(labels):
            raise DataError(f"ph_dur: got {len(lengths)} durations, expected {len(labels)}", where=phrase.where)
        offset_s = phrase.number_or("offset", 0.0)
        if entries and entries[-1].end_s > offset_s:  # the breath before a phrase overlaps the rest after the last
            entries[-1] = replace(entries[-1], end_s=max(entries[-1].start_s, offset_s))
        plain = [_LANGUAGE.sub("", label) for label in labels]
        entries += in_sequence([(*pair, phrase.where) for pair in zip(plain, lengths, strict=True)], offset_s)
    return track_of(entries, "DiffSinger", alphabet=alphabet)


def parse_utau(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the notes of a song: kana and pinyin are sung as they are, words are pronounced.

    In a lyric such as ``a か`` the second part is sung, without a sign after it (``か_強``).
    """
    try:
        text = decode_text(data, "UTAU").replace("\r\n", "\n")
    except DataError:  # UTAU itself writes Shift JIS, OpenUtau UTF-8
        text = data.decode("shift_jis", "replace").replace("\r\n", "\n")
    if re.search(r"^ustx_version:", text, re.MULTILINE):
        raise UnsupportedError("UTAU: got a project of OpenUtau (.ustx), expected .ust; export one from its file menu")
    bpm = DEFAULT_BPM
    notes: list[tuple[str, float, str]] = []
    for number, section in enumerate(re.split(r"^\[#(?=\d|SETTING)", text, flags=re.MULTILINE)):
        values, where = dict(re.findall(r"^(Tempo|Length|Lyric)=(.*?)\s*$", section, re.MULTILINE)), f"section {number}"
        if "Tempo" in values:
            bpm = number_of(values["Tempo"].replace(",", "."), "Tempo", where, 1, 1e9)
        if "Length" in values:
            length_s = number_of(values["Length"], "Length", where, 0, 1e9) / TICKS_A_QUARTER * 60 / bpm
            notes.append((_lyric(values.get("Lyric", "")), length_s, where))
    entries = in_sequence(notes)
    sung = guess(entry.label for entry in entries if entry.label != "_")
    if (alphabet is None and sung.alphabet not in ("kana", "pinyin")) or sung.words:
        return track_of(entries, "UTAU", level="word", spelled=True)
    return track_of(entries, "UTAU", alphabet=alphabet or sung.alphabet, level="character")


def _lyric(text: str) -> str:
    sung = text.split()[-1] if text.split() else ""
    sung = re.sub(r"(?<=.)[_0-9A-Z↑↓'].*$", "", sung) if re.search(r"[\u3040-\u30ff]", sung) else sung
    return "_" if sung.lower() in _REST else sung
