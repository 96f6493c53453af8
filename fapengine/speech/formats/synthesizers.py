"""Timings of speech synthesizers that run locally: MBROLA, phone lists, espeak-ng, VOICEVOX, Kokoro, HeadTTS, Piper.

MBROLA ``.pho``: one phone a line, ``name milliseconds [percent hertz]...``; ``;`` begins a comment. Names are SAMPA of
the language (MBROLA documentation), ``_`` is silence.

Phone lists, as many small tools write them in JSON (wrappers of PocketSphinx, piper-plus, FastSpeech 2):
``{"phones": [...]}`` or ``{"phonemes": [...]}`` of objects with a label (``phone``, ``phoneme``, ``label``), and
``start`` and ``end`` in seconds or ``offset`` and ``duration`` in ms; a ``word`` if known.

VOICEVOX audio query (engine 0.14 and later): morae with the lengths of consonant and vowel, in seconds.

espeak-ng events as JSON, in the shape of ``espeak_EVENT`` (speak_lib.h, API revision 12), type by name or by number.
PHONEME marks the onset of a phone, in mnemonics of espeak-ng or in IPA. Pauses are ``_`` and ``_:``, in IPA the empty
text. A WORD event names a place in the text, if the file has the text.

Kokoro 0.9 (``KPipeline``): ``tokens`` have ``text``, ``phonemes`` (Misaki), ``start_ts``, ``end_ts`` in seconds: words
are timed, their phones spread evenly. With ``pred_dur`` the phones themselves are timed: one count for each character
of ``phonemes``, with one before and one after; a unit is 600 samples at 24 kHz. HeadTTS: parallel lists of Oculus
visemes in ms.

Piper 1.3 phoneme alignments: IPA code points, each with its length. Shapes: ``{"phoneme", "seconds"}`` (Piper's HTTP
server, GET /info, ``last.alignments``), ``PhonemeAlignment`` of ``piper.voice`` (``phoneme``, ``num_samples``, with
``sample_rate`` beside the list). A code point that only marks (stress, length, tie) belongs to its neighbour; blanks,
punctuation, ``^`` and ``$`` are pauses.
"""

import unicodedata
from collections.abc import Iterable, Iterator

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.alphabets.phone_sets import ESPEAK
from fapengine.speech.formats.documents import Node, parse_document, same_length
from fapengine.speech.formats.entries import Entry, shared_out, track_of, until_next
from fapengine.speech.formats.textgrid import decode_text
from fapengine.speech.phone_track import PhoneTrack

MAX_PHONE_MS = 600_000.0
"""Ten minutes: longer is a mistake, not a phone."""


def parse_pho(data: bytes, *, alphabet: str = "x-sampa") -> PhoneTrack:
    """Read a ``.pho`` file."""
    entries: list[Entry] = []
    now_s = 0.0
    for number, line in enumerate(decode_text(data, ".pho").splitlines(), start=1):
        fields = line.split(";", 1)[0].split()
        if not fields:
            continue
        where = f"line {number}"
        if len(fields) < 2:
            raise DataError(f".pho: got {line.strip()[:40]!r}, expected a phone and its milliseconds", where=where)
        try:
            numbers = [float(field) for field in fields[1:]]
        except ValueError as error:
            raise DataError(
                f".pho: got {line.strip()[:40]!r}, expected numbers behind the phone", where=where
            ) from error
        if not 0 <= numbers[0] <= MAX_PHONE_MS:
            raise DataError(f"duration: must be 0 to {MAX_PHONE_MS:g}, got {fields[1]} ms", where=where)
        end_s = now_s + numbers[0] / 1000
        entries.append(Entry(now_s, end_s, fields[0], where))
        now_s = end_s
    if not entries:
        raise DataError(".pho: contains no phone; lines look like 'b 65'")
    return track_of(entries, ".pho", alphabet=alphabet)


LISTS = ("phones", "phonemes")
LABELS = ("phone", "phoneme", "label")
_BORDERS = frozenset({"<sos/eos>", "<sos>", "<eos>", "<s>", "</s>", "<blank>", ".", ",", ";", ":", "!"})


def parse_phone_list(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the list."""
    entries = [_entry(item) for item in parse_document(data, "list of phones").first(*LISTS).items()]
    return track_of(entries, "list of phones", alphabet=alphabet)


def _entry(item: Node) -> Entry:
    label = item.first(*LABELS).text()
    if item.has("start"):
        start_s, end_s = item["start"].number(), item["end"].number()
    else:
        start_s = item["offset"].number() / 1000
        end_s = start_s + item["duration"].number() / 1000
    word = item["word"].text() if item.has("word") else ""
    return Entry(start_s, end_s, "_" if label in _BORDERS else label, item.where, word)


def parse_voicevox(data: bytes) -> PhoneTrack:
    """Read a query; all lengths are divided by ``speedScale``, pauses multiplied by ``pauseLengthScale``."""
    query = parse_document(data, "VOICEVOX")
    speed = _scale(query, "speedScale")
    pauses = _scale(query, "pauseLengthScale")
    pieces = [_piece(query, "prePhonemeLength", "pau")] if query.has("prePhonemeLength") else []
    for phrase in query["accent_phrases"].items():
        for mora in phrase["moras"].items():
            text = mora["text"].text() if mora.has("text") else ""
            if mora.has("consonant"):
                pieces.append(_piece(mora, "consonant_length", mora["consonant"].text(), text))
            pieces.append(_piece(mora, "vowel_length", mora["vowel"].text(), text))
        if phrase.has("pause_mora"):
            label, length_s, where, text = _piece(phrase["pause_mora"], "vowel_length", "pau")
            if query.has("pauseLength"):
                length_s = query["pauseLength"].number()
            pieces.append((label, length_s * pauses, where, text))
    if query.has("postPhonemeLength"):
        pieces.append(_piece(query, "postPhonemeLength", "pau"))
    entries: list[Entry] = []
    now_s = 0.0
    for label, length_s, where, text in pieces:
        if length_s < 0:
            raise DataError(f"length: must be 0 or more, got {length_s:g} s", where=where)
        entries.append(Entry(now_s, now_s + length_s / speed, label, where, text))
        now_s += length_s / speed
    return track_of(entries, "VOICEVOX", alphabet="voicevox")


def _piece(node: Node, key: str, label: str, text: str = "") -> tuple[str, float, str, str]:
    return label, node[key].number(), node[key].where, text


def _scale(query: Node, key: str) -> float:
    scale = query[key].number() if query.has(key) else 1.0
    if not 0.01 <= scale <= 100:
        raise DataError(f"{key}: must be 0.01 to 100, got {scale:g}", where=key)
    return scale


_TYPES = {1: "WORD", 2: "SENTENCE", 5: "END", 6: "MSG_TERMINATED", 7: "PHONEME"}
DEFAULT_RATE_HZ = 22050.0
_ADDITIONS = frozenset({"ʲ", "ʰ", "ː", ";"})
"""Events that only add to the phone before."""


def parse_espeak_events(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the events; mnemonics or IPA is guessed unless ``alphabet`` says it."""
    document = parse_document(data, "espeak-ng events")
    events = document["events"] if document.has("events") else document
    rate_hz = document["samplerate"].number() if document.has("samplerate") else DEFAULT_RATE_HZ
    if rate_hz <= 0:
        raise DataError(f"samplerate: must be above 0, got {rate_hz:g}", where="samplerate")
    text = document["text"].text() if document.has("text") else ""
    onsets: list[tuple[float, str, str]] = []
    words: list[str] = []
    word = ""
    end_s: float | None = document["samples"].number() / rate_hz if document.has("samples") else None
    for event in events.items():
        kind = _kind(event["type"])
        if kind == "WORD" and event.has("text_position", "length"):
            start, length = (int(event[key].number()) for key in ("text_position", "length"))
            word = text[start - 1 : start - 1 + length] if start > 0 else ""
        elif kind == "PHONEME":
            label = event["phoneme"].text()
            if label not in _ADDITIONS:
                onsets.append((_time_s(event, rate_hz), label, event.where))
                words.append(word)
        elif kind == "END" and end_s is None:
            end_s = _time_s(event, rate_hz)
    timed = [
        Entry(entry.start_s, entry.end_s, entry.label, entry.where, spoken)
        for entry, spoken in zip(until_next(onsets, end_s), words, strict=True)
    ]
    return track_of(timed, "espeak-ng events", alphabet=alphabet or _guess([label for _, label, _ in onsets]))


def _kind(node: Node) -> str:
    return node.text() if isinstance(node.value, str) else _TYPES.get(int(node.number()), "")


def _time_s(event: Node, rate_hz: float) -> float:
    if event.has("sample"):
        return event["sample"].number() / rate_hz
    return event.first("audio_position_ms", "audio_position").number() / 1000


def _guess(labels: list[str]) -> str:
    """IPA if more labels are IPA than mnemonics; of what both know, the longer marks decide."""
    spoken = [label for label in labels if label.strip("_:!|")]
    phones = ESPEAK
    as_ipa = sum(bool(ipa.letters(label)) and ":" not in label for label in spoken)
    mnemonic = sum(phones.to_ipa(label) is not None for label in spoken)
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
        word = token.first("text", "word").text()
        phones = _split(token["phonemes"].text() if token.has("phonemes") else "")
        entries += shared_out(token["start_ts"].number(), token["end_ts"].number(), phones, token.where, word)
    return track_of(entries, "Kokoro", alphabet="misaki", level="word")


def kokoro_entries(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
    """Put letters one behind the other, each (Misaki or IPA, length in s, where), and join those that only mark."""
    entries: list[Entry] = []
    stress = ""
    for letter, length_s, where in lengths:
        last = entries[-1] if entries else Entry(0.0, 0.0, "_", "the begin")
        end_s = last.end_s + length_s
        if letter in ipa.STRESS or letter in _MARKS.strip() or (letter == " " and last.label != "_"):
            stress = letter if letter in ipa.STRESS else stress
            entries[-1:] = [Entry(last.start_s, end_s, last.label, last.where)]
        else:
            entries.append(Entry(last.end_s, end_s, letter if letter == "_" else stress + letter, where))
            stress = ""
    return entries


def _split(phonemes: str) -> list[str]:
    """Split Misaki text into phones, marks with the letter they belong to."""
    ipa_labels: list[str] = []
    stress = ""
    for letter in phonemes:
        if letter in ipa.STRESS:
            stress = letter
        elif letter not in _MARKS and letter.isalpha():
            ipa_labels.append(stress + letter)
            stress = ""
    return ipa_labels


def parse_headtts(data: bytes) -> PhoneTrack:
    """Read ``visemes``, ``vtimes``, ``vdurations``; HeadTTS overlaps them by 20 ms: a start ends the one before."""
    document = parse_document(data, "HeadTTS")
    inner = document["data"] if document.has("data") else document
    labels = inner["visemes"].texts()
    starts, lengths = inner["vtimes"].numbers(), inner["vdurations"].numbers()
    same_length(starts, lengths, labels, where="vtimes, vdurations, visemes")
    starts = [max(start, 0.0) for start in starts]  # 10 ms early, so that the first may begin before 0
    entries: list[Entry] = []
    for index, (start, length, label) in enumerate(zip(starts, lengths, labels, strict=True)):
        end = min([start + length, *starts[index + 1 : index + 2]])
        entries.append(Entry(start / 1000, end / 1000, label, f"visemes[{index}]"))
    return track_of(entries, "HeadTTS", alphabet="oculus-visemes", level="viseme")


LIST_KEYS = ("phoneme_alignments", "alignments")


def parse_piper(data: bytes) -> PhoneTrack:
    """Read the alignments of one or several sentences, one behind the other."""
    chunks = _chunks(parse_document(data, "Piper alignments"))
    return track_of(piper_entries(_lengths(chunks)), "Piper alignments", alphabet="ipa")


def piper_entries(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
    """Put code points one behind the other, each (label, length in s, where), and join those that only mark."""
    entries: list[Entry] = []
    now_s = 0.0
    stress = ""
    for label, length_s, where in lengths:
        stress_mark, kind = label in ipa.STRESS, unicodedata.category(label[:1] or " ")
        if stress_mark or (entries and kind in ("Mn", "Lm", "Sk", "Cf")):
            stress = label if stress_mark else stress
            _lengthen(entries, now_s + length_s, "" if stress_mark else label)
        else:
            silent = not label or kind[0] in "PZSC"
            entries.append(Entry(now_s, now_s + length_s, "_" if silent else stress + label, where))
            stress = stress if silent else ""
        now_s += length_s
    return entries


def _lengths(chunks: Iterable[Node]) -> Iterator[tuple[str, float, str]]:
    for chunk in chunks:
        rate_hz = chunk["sample_rate"].number() if chunk.has("sample_rate") else 0.0
        for item in (chunk.first(*LIST_KEYS) if not isinstance(chunk.value, list) else chunk).items():
            yield item["phoneme"].text(), _length_s(item, rate_hz), item.where


def _chunks(document: Node) -> list[Node]:
    if document.has("last"):
        document = document["last"]
    if not isinstance(document.value, list):
        return [document]
    chunks = document.entries()
    return chunks if chunks and any(chunks[0].has(key) for key in LIST_KEYS) else [document]


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


def _lengthen(entries: list[Entry], end_s: float, mark: str) -> None:
    """Let the last entry last on; before the first phone there is none, and the time is a pause."""
    if entries:
        last = entries[-1]
        entries[-1] = Entry(last.start_s, end_s, last.label + mark if last.label != "_" else "_", last.where)
    else:
        entries.append(Entry(0.0, end_s, "_", "the first mark"))
