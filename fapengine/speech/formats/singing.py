"""Songs whose phones or morae have times: DiffSinger and UTAU.

DiffSinger ``.ds`` (openvpi): a list of phrases with ``offset``, ``ph_seq`` and ``ph_dur`` (texts, s). UTAU ``.ust``:
sections ``[#0000]`` with ``Length`` in ticks (480 a quarter), ``Lyric`` and ``Tempo``; OpenUtau exports it.
"""

import re

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import parse_document
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.textgrid import decode_text
from fapengine.speech.phone_track import PhoneTrack

TICKS_A_QUARTER = 480
DEFAULT_BPM = 120.0
_REST = frozenset({"", "r", "rest", "sp", "ap", "-", "息", "br"})
_LANGUAGE = re.compile(r"^[a-z]{2,3}/(?=.)")


def parse_diffsinger(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones of all phrases; ``zh/`` before a phone is its language, and falls away."""
    entries: list[Entry] = []
    for phrase in parse_document(data, "DiffSinger").entries():
        labels = phrase["ph_seq"].text().split()
        if not phrase.has("ph_dur"):
            raise DataError("DiffSinger: ph_dur is missing; let the variance model fill it in", where=phrase.where)
        lengths = [_number(text, phrase.where) for text in phrase["ph_dur"].text().split()]
        if len(lengths) != len(labels):
            raise DataError(f"ph_dur: got {len(lengths)} durations, expected {len(labels)}", where=phrase.where)
        now_s = phrase["offset"].number() if phrase.has("offset") else 0.0
        if entries and entries[-1].end_s > now_s:  # the breath before a phrase overlaps the rest behind the last
            last = entries[-1]
            entries[-1] = Entry(last.start_s, max(last.start_s, now_s), last.label, last.where)
        for label, length_s in zip(labels, lengths, strict=True):
            entries.append(Entry(now_s, now_s + length_s, _LANGUAGE.sub("", label), phrase.where))
            now_s += length_s
    return track_of(entries, "DiffSinger", alphabet=alphabet)


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < 1e6:
        raise DataError(f"ph_dur: got {text[:40]!r}, expected a number of seconds", where=where)
    return value


def parse_utau(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the notes of a song: kana and pinyin are sung as they are, words are pronounced.

    Of a lyric such as ``a か`` the second part is sung, a sign behind it (``か_強``) falls away.
    """
    text = _shift_jis_or_utf8(data)
    if re.search(r"^ustx_version:", text, re.MULTILINE):
        raise UnsupportedError("UTAU: got a project of OpenUtau (.ustx), expected .ust; export one from its file menu")
    bpm, now_s = DEFAULT_BPM, 0.0
    entries: list[Entry] = []
    for number, section in enumerate(re.split(r"^\[#(?=\d|SETTING)", text, flags=re.MULTILINE)):
        values = dict(re.findall(r"^(Tempo|Length|Lyric)=(.*?)\s*$", section, re.MULTILINE))
        if "Tempo" in values:
            bpm = _ust_number(values["Tempo"].replace(",", "."), "Tempo", number)
            if bpm < 1:
                raise DataError(f"Tempo: got {bpm:g}, expected 1 or more", where=f"section {number}")
        if "Length" in values:
            length_s = _ust_number(values["Length"], "Length", number) / TICKS_A_QUARTER * 60 / bpm
            entries.append(Entry(now_s, now_s + length_s, _lyric(values.get("Lyric", "")), f"section {number}"))
            now_s += length_s
    labels = [entry.label for entry in entries if entry.label != "_"]
    sung = guess(labels)
    if (alphabet is None and sung.alphabet not in ("kana", "pinyin")) or sung.words:
        return track_of(entries, "UTAU", level="word", spelled=True)
    return track_of(entries, "UTAU", alphabet=alphabet or sung.alphabet, level="character")


def _shift_jis_or_utf8(data: bytes) -> str:
    """Decode; UTAU itself writes Shift JIS, OpenUtau UTF-8."""
    try:
        return decode_text(data, "UTAU").replace("\r\n", "\n")
    except DataError:
        return data.decode("shift_jis", "replace").replace("\r\n", "\n")


def _ust_number(text: str, name: str, number: int) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < 1e9:
        raise DataError(f"{name}: got {text[:40]!r}, expected a number", where=f"section {number}")
    return value


def _lyric(text: str) -> str:
    sung = text.split()[-1] if text.split() else ""
    sung = re.sub(r"(?<=.)[_0-9A-Z↑↓'].*$", "", sung) if re.search(r"[\u3040-\u30ff]", sung) else sung
    return "_" if sung.lower() in _REST else sung
