"""Songs with times of phones or morae: DiffSinger and UTAU.

DiffSinger ``.ds`` (openvpi): a list of phrases with ``offset``, ``ph_seq`` and ``ph_dur`` (texts, s). UTAU ``.ust``:
sections ``[#0000]`` with ``Length`` in ticks (480 a quarter), ``Lyric`` and ``Tempo``; OpenUtau exports it.
"""

import re
from dataclasses import replace

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import decode_text, number_of, parse_document
from fapengine.speech.formats.entries import Entry, in_sequence, track_of
from fapengine.speech.phone_track import PhoneTrack

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
