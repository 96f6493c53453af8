"""Timings of animation programs: Papagayo, Moho, Rhubarb Lip Sync.

Papagayo ``.pgo`` (version 1): name, audio file, frame rate, length, then voices of phrases of words of ``frame mouth``;
Papagayo-NG saves JSON of the same.
Moho switch ``.dat``: after ``MohoSwitch1``, lines ``frame mouth``; a few give the frame rate, by ``FPS 24``. Rhubarb
1.14: JSON and XML (its TSV is in :mod:`.corpora`); the start of a cue ends the one before, because cues of ports of
Rhubarb overlap.
"""

import re
from dataclasses import dataclass

from fapengine.errors import DataError
from fapengine.speech.formats.documents import Node, decode_text, number_of, parse_document, parse_xml, walk
from fapengine.speech.formats.entries import LAST_S, Entry, track_of, until_next, without_overlaps
from fapengine.speech.formats.table import parse_columns
from fapengine.speech.phone_track import PhoneTrack


@dataclass(slots=True)
class _Lines:
    """The lines of a file, in order. Stateful."""

    lines: list[str]
    at: int = 0

    def take(self, wanted: str) -> str:
        if self.at >= len(self.lines):
            raise DataError(f"mouths: the file ends where {wanted} is expected", where="the end")
        self.at += 1
        return self.lines[self.at - 1].strip()

    def count(self, wanted: str) -> int:
        text = self.take(wanted)
        if not (text.isascii() and text.isdigit()) or len(text) > 9:
            raise DataError(f"{wanted}: got {text[:40]!r}, expected a count", where=f"line {self.at}")
        return int(text)


def parse_papagayo(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the mouths of one voice; ``tier`` names it, if there are several."""
    if decode_text(data, "Papagayo").lstrip().startswith("{"):
        voices, end_s = _voices_in_json(parse_document(data, "Papagayo"))
    else:
        voices, end_s = _voices_in_lines(data)
    if len(voices) > 1 and tier not in voices:
        raise DataError(f"Papagayo: got the voices {sorted(voices)}, expected one; name one with tier=NAME")
    onsets = voices[tier] if tier in voices else next(iter(voices.values()), [])
    return track_of(until_next(onsets, end_s), "Papagayo", alphabet=alphabet or "preston-blair", level="viseme")


Voices = dict[str, list[tuple[float, str, str, str]]]
"""Onsets of each voice: time in s, mouth, place, word."""


def _voices_in_json(document: Node) -> tuple[Voices, float]:
    """Read what Papagayo-NG 1.6 and later save: ``fps`` and voices of phrases of words of phonemes, each at a frame."""
    rate_hz = document["fps"].number()
    if rate_hz <= 0:
        raise DataError(f"fps: got {rate_hz:g}, expected more than 0")
    voices: Voices = {}
    for voice in document["voices"].items():
        words = walk(voice, "phrases[].words[]")
        voices[voice.text_or("name")] = [
            (max(0.0, mouth["frame"].number() - 1) / rate_hz, mouth["text"].text(), mouth.where, word.text_or("text"))
            for word in words
            for mouth in word["phonemes"].items()
        ]
    last_s = max((onset[0] for onsets in voices.values() for onset in onsets), default=0.0)
    return voices, max(document.number_or("sound_duration", 0.0) / rate_hz, last_s + LAST_S)


def _voices_in_lines(data: bytes) -> tuple[Voices, float]:
    lines = _Lines(decode_text(data, "Papagayo").splitlines())
    if lines.take("its first line") != "lipsync version 1":
        raise DataError("Papagayo: expected a file that begins with 'lipsync version 1'", where="line 1")
    lines.take("the name of the sound")
    rate_hz = lines.count("frames a second")
    if rate_hz < 1:
        raise DataError("frames a second: got 0, expected 1 or more", where=f"line {lines.at}")
    end_s = lines.count("length") / rate_hz
    voices: Voices = {}
    for _ in range(lines.count("number of voices")):
        name = lines.take("a voice")
        lines.take("its text")
        voices[name] = _voice(lines, rate_hz)
    return voices, end_s


def _voice(lines: _Lines, rate_hz: int) -> list[tuple[float, str, str, str]]:
    onsets: list[tuple[float, str, str, str]] = []
    for _ in range(lines.count("number of phrases")):
        lines.take("a phrase"), lines.count("its first frame"), lines.count("its last frame")
        for _ in range(lines.count("number of words")):
            word, *numbers = lines.take("a word").rsplit(None, 3) or [""]
            if len(numbers) != 3 or not numbers[2].isdigit() or len(numbers[2]) > 9:
                raise DataError(f"word: got {word[:40]!r}, expected a word and three numbers", where=f"line {lines.at}")
            onsets += [(*_mouth(lines, rate_hz), word) for _ in range(int(numbers[2]))]
    return onsets


def _mouth(lines: _Lines, rate_hz: float) -> tuple[float, str, str]:
    text = lines.take("a mouth")
    where = f"line {lines.at}"
    frame, _, label = text.partition(" ")
    if not (frame.isascii() and frame.isdigit()) or len(frame) > 9 or not label.strip():
        raise DataError(f"mouth: got {text[:40]!r}, expected a frame and a mouth", where=where)
    return max(0, int(frame) - 1) / rate_hz, label.strip(), where  # frames count from 1


def parse_moho(data: bytes, *, alphabet: str | None = None, columns: str | None = None) -> PhoneTrack:
    """Read a Moho switch file; ``columns`` gives the frame rate as ``fps=24``.

    Its mouths are those of Preston Blair, or, where all are single letters of Rhubarb, Rhubarb's.
    """
    rate_hz = parse_columns(columns).rate_hz
    lines = _Lines(decode_text(data, "Moho").rstrip().splitlines())
    if lines.take("its first line") != "MohoSwitch1":
        raise DataError("Moho: expected a file that begins with MohoSwitch1", where="line 1")
    if match := re.fullmatch(r"FPS (\d{1,3})", lines.lines[lines.at].strip() if len(lines.lines) > 1 else ""):
        lines.take("frames a second")
        rate_hz = rate_hz or float(match[1]) or None
    if rate_hz is None:
        raise DataError("Moho: the file does not say how many frames make a second; say it with columns='fps=24'")
    onsets = [_mouth(lines, rate_hz) for _ in range(len(lines.lines) - lines.at)]
    mouths = {mouth for _, mouth, _ in onsets}
    usual = "rhubarb-shapes" if mouths <= set("ABCDEFGHX") and mouths != {"E"} else "preston-blair"
    return track_of(until_next(onsets), "Moho", alphabet=alphabet or usual, level="viseme")


def parse_rhubarb_json(data: bytes) -> PhoneTrack:
    """Read ``{"mouthCues": [{"start", "end", "value"}]}``."""
    cues = parse_document(data, "Rhubarb JSON")["mouthCues"]
    return _cues([Entry(c["start"].number(), c["end"].number(), c["value"].text(), c.where) for c in cues.items()])


def parse_rhubarb_xml(data: bytes) -> PhoneTrack:
    """Read ``<mouthCue start= end=>shape</mouthCue>``."""
    root = parse_xml(data, "Rhubarb")
    entries: list[Entry] = []
    for number, cue in enumerate(root.iter("mouthCue"), start=1):
        where = f"mouthCue {number}"
        start_s, end_s = (number_of(cue.get(name, ""), name, where) for name in ("start", "end"))
        entries.append(Entry(start_s, end_s, (cue.text or "").strip(), where))
    return _cues(entries)


def _cues(cues: list[Entry]) -> PhoneTrack:
    cues = without_overlaps(sorted(cues, key=lambda cue: cue.start_s))
    return track_of(cues, "Rhubarb", alphabet="rhubarb-shapes", level="viseme")
