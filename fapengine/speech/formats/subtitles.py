"""Subtitles whose words have times: SRT and WebVTT.

One word a cue (edge-tts, Whisper with one word a line), times inside a cue (WebVTT, ``<00:00:01.120>``), or one word
underlined in each of a row of cues (Whisper, ``highlight_words``). Cues of phrases are refused: where in a phrase its
words lie, they do not say. WebVTT: W3C, "WebVTT" (2019); SRT: as SubRip writes it.
"""

import re

from fapengine.errors import DataError
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.textgrid import decode_text
from fapengine.speech.formats.word_lists import timed_words
from fapengine.speech.phone_track import PhoneTrack

_CLOCK = r"(?:(\d+):)?(\d{1,2}):(\d{1,2})[.,](\d{1,3})"
CUE = re.compile(rf"\s*{_CLOCK}\s*-->\s*{_CLOCK}(\s.*)?")
"""Times of a cue: hours may lack, comma or point before the milliseconds."""
_INSIDE = re.compile(rf"<{_CLOCK}>")
_TAG = re.compile(r"</?[a-zA-Z][^>]*>|\{\\[^}]*\}")
_UNDERLINED = re.compile(r"<u>(.*?)</u>", re.DOTALL)
HINT = "words need times of their own: one word a cue, or <00:00:01.120> before each word"


def _clock_s(groups: tuple[str | None, ...]) -> float:
    hours, minutes, seconds, fraction = (group or "0" for group in groups)
    return 3600 * float(hours) + 60 * float(minutes) + float(seconds) + float(f"0.{fraction}")


def parse_subtitles(data: bytes) -> PhoneTrack:
    """Read the words of an SRT or WebVTT file.

    Raises
    ------
    DataError
        If there is no cue, or cues hold phrases.
    """
    cues = _cues(decode_text(data, "subtitles").splitlines())
    if not cues:
        raise DataError("subtitles: got no cue, expected lines such as 00:00:01,000 --> 00:00:01,500")
    words: list[Entry | tuple[str, str]] = []
    if any(_INSIDE.search(cue.label) for cue in cues):
        for cue in cues:
            words += _inside(cue) if _INSIDE.search(cue.label) else []  # a cue without repeats what was said
    elif any(_UNDERLINED.search(cue.label) for cue in cues):
        words += [Entry(c.start_s, c.end_s, m[1], c.where) for c in cues for m in _UNDERLINED.finditer(c.label)]
    else:
        words += [Entry(cue.start_s, cue.end_s, _TAG.sub("", cue.label), cue.where) for cue in cues]
    return track_of(timed_words(words, "subtitles", HINT), "subtitles", level="word", spelled=True)


def _cues(lines: list[str]) -> list[Entry]:
    cues: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        if match := CUE.fullmatch(line):
            start_s, end_s = _clock_s(match.groups()[:4]), _clock_s(match.groups()[4:8])
            cues.append(Entry(start_s, max(start_s, end_s), _text(lines[number:]), f"line {number}"))
    return cues


def _text(lines: list[str]) -> str:
    """Lines of a cue, up to the blank one or the next cue's times."""
    text: list[str] = []
    for at, line in enumerate(lines):
        following = lines[at + 1] if at + 1 < len(lines) else ""
        if not line.strip() or CUE.fullmatch(line) or (line.strip().isdigit() and CUE.fullmatch(following)):
            break
        text.append(line.strip())
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
