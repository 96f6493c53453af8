"""Kokoro tokens and predicted durations, and HeadTTS visemes.

Kokoro 0.9 (``KPipeline``): ``tokens`` have ``text``, ``phonemes`` (Misaki), ``start_ts``, ``end_ts`` in seconds: words
are timed, their phones spread evenly. With ``pred_dur`` the phones themselves are timed: one count a letter of
``phonemes``, with one before and one behind; a unit is 600 samples at 24 kHz.
HeadTTS: parallel lists of Oculus visemes in ms.
"""

from collections.abc import Iterable

from fapengine.errors import DataError
from fapengine.speech import ipa
from fapengine.speech.formats.documents import parse_document, same_length
from fapengine.speech.formats.entries import Entry, shared_out, track_of
from fapengine.speech.phone_track import PhoneTrack

UNIT_S = 600 / 24_000
_MARKS = "ː ʲʰ̩̃ᵝ→↗↘↓↑ꜜꜛ12345R"
"""Characters that change the phone before: length, tones, pitch."""


def parse_kokoro(data: bytes) -> PhoneTrack:
    """Read tokens, or ``phonemes`` with ``pred_dur``.

    Raises
    ------
    DataError
        If keys lack, counts do not fit, or times are wrong.
    """
    document = parse_document(data, "Kokoro")
    if document.has("pred_dur"):
        counts, text = document["pred_dur"].numbers(), document["phonemes"].text()
        if len(counts) != len(text) + 2:
            raise DataError(f"pred_dur: got {len(counts)} counts, expected {len(text) + 2}", where="pred_dur")
        lengths = zip(["_", *text, "_"], (count * UNIT_S for count in counts), strict=True)
        entries = entries_of((letter, length_s, f"pred_dur[{n}]") for n, (letter, length_s) in enumerate(lengths))
        return track_of(entries, "Kokoro", alphabet="misaki")
    entries = []
    for token in (document["tokens"] if document.has("tokens") else document).items():
        if not token.has("start_ts", "end_ts"):
            continue  # punctuation
        word = token.first("text", "word").text()
        phones = _split(token["phonemes"].text() if token.has("phonemes") else "")
        entries += shared_out(token["start_ts"].number(), token["end_ts"].number(), phones, token.where, word)
    return track_of(entries, "Kokoro", alphabet="misaki", level="word")


def entries_of(lengths: Iterable[tuple[str, float, str]]) -> list[Entry]:
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
    """Read ``visemes``, ``vtimes``, ``vdurations``; HeadTTS overlaps them by 20 ms, the later start ends the earlier.

    Raises
    ------
    DataError
        If keys lack, lists differ in length, or times fall.
    """
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
