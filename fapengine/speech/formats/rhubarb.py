"""Rhubarb Lip Sync 1.14: its nine mouth shapes from phones or frames, and its files, written.

Theory of operation
-------------------
The shapes are those of Rhubarb's documentation (README, "Mouth shapes"): A lips closed, B teeth together or nearly, C
open, D wide open, E slightly rounded, F puckered, G teeth on the lower lip, H tongue raised for a long l, X at rest. A
phone takes the shape that its articulation (:data:`fapengine.speech.ipa.SOUNDS`) asks for; h has none of its own and
takes the shape of the phone after it. Times lie on Rhubarb's grid of 10 ms.

A shape shorter than :data:`MIN_CUE_CS` would fall between the frames of a video. Lips and teeth that touch are what
people miss first, so A and G are lengthened, at the cost of their neighbours; other short shapes go to the longer
neighbour.

Files are written with the keys, order, spaces and two decimals of Rhubarb's own (README, "Output formats"; layout seen
in files that 1.14.0 wrote), because some importers search the text. ``.dat`` is a switch file of Moho: its first line
is ``MohoSwitch1``, frames count from 1, and the last line closes the mouth at the end. Files are read in
:mod:`.animation` and, as TSV, in :mod:`.corpora`.
"""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone, PhoneTrack

SHAPES = "ABCDEFGHX"
CONTACTS = "AG"
"""Shapes that touch."""
GRID_HZ = 100
"""Rhubarb's times are whole centiseconds."""
MIN_CUE_CS = 5
"""Shortest cue, centiseconds: a frame of a film at 24 Hz lasts 4.2."""
LONG_L_S = 0.09
"""Duration from which an l shows its tongue: longer than most (median of running English speech about 0.06 s)."""
FIRST_SHARE = 0.6
"""Part of a diphthong or affricate that its first letter takes."""
ROUNDED = 0.9
"""Rounding of :class:`fapengine.speech.ipa.Sound` from which lips are round; ɝ and ɚ have less and are named."""


@dataclass(frozen=True, slots=True)
class MouthCue:
    """One mouth shape and its time."""

    shape: str
    """A letter of :data:`SHAPES`."""
    start_cs: int
    end_cs: int
    """Centiseconds."""

    @property
    def length_cs(self) -> int:
        """Duration in centiseconds."""
        return self.end_cs - self.start_cs


def cues_of_phones(track: PhoneTrack, *, duration_s: float | None = None) -> tuple[MouthCue, ...]:
    """Find the mouth shapes that show phones.

    Parameters
    ----------
    track : PhoneTrack
        Phones in IPA, not words.
    duration_s : float, optional
        Length of the sound, at which the last cue ends; by default that of the phones.

    Returns
    -------
    tuple of MouthCue
        From 0 to the end without a gap; neighbours differ.
    """
    if track.spelled:
        raise UsageError("phones: got spelled words, expected phones; pronounce them first")
    parts: list[tuple[str, float]] = []
    for index, phone in enumerate(track.phones):
        following = track.phones[index + 1] if index + 1 < len(track.phones) else None
        shapes = _shapes_of(phone, following)
        middle_s = phone.start_s + FIRST_SHARE * phone.duration_s
        parts += zip(shapes, (phone.start_s, middle_s), strict=False)
    end_s = max(track.duration_s if duration_s is None else duration_s, 0.0)
    if end_s > track.duration_s:
        parts.append(("X", track.duration_s))
    return _settled([(shape, _grid(start_s)) for shape, start_s in parts], _grid(end_s))


def cues_of_frames(shapes: Sequence[str], rate_hz: float) -> tuple[MouthCue, ...]:
    """Join the shapes of frames, a letter a frame, into cues. Raises UsageError if there is no frame."""
    return _settled([(shape, _grid(n / rate_hz)) for n, shape in enumerate(shapes)], _grid(len(shapes) / rate_hz))


def _shapes_of(phone: Phone, following: Phone | None) -> list[str]:
    """Shapes of one phone, one or two."""
    if phone.is_silence:
        return ["X"]
    letters = ipa.letters(phone.label)
    if not letters:
        return ["B"]  # an unknown phone: the most common shape
    if set(letters) <= set("hɦʔ"):
        return ["B"] if following is None or following.is_silence else _shapes_of(following, None)[:1]
    shapes = [shape_of(letter, phone.duration_s / len(letters)) for letter in letters]
    return [next((shape for shape in shapes if shape in CONTACTS), shapes[0]), *shapes[-1:]]


def shape_of(letter: str, duration_s: float = 0.0) -> str:
    """Shape of one IPA letter of a duration in s.

    Examples
    --------
    >>> "".join(map(shape_of, "mviɛɑɔu"))
    'AGBCDEF'
    """
    sound = ipa.SOUNDS[letter]
    if sound.lips >= 1.0:
        return "A"
    if sound.lips >= 0.5:
        return "G"
    if letter in "ɝɚɜɞ":  # "bird" is Rhubarb's own example of E
        return "E"
    if sound.rounding >= ROUNDED:
        return "F" if not sound.vowel or sound.opening <= 0.2 else "E"
    if sound.vowel:
        if letter == "ə":
            return "B"
        return "D" if sound.opening >= 1.0 else "C" if sound.opening >= 0.35 else "B"
    return "H" if letter in "lɫ" and duration_s >= LONG_L_S else "B"


def _grid(time_s: float) -> int:
    return round(time_s * GRID_HZ)


def _settled(starts: Sequence[tuple[str, int]], end_cs: int) -> tuple[MouthCue, ...]:
    """Cues from shapes with their starts: neighbours joined, none too short where that can be had."""
    if end_cs <= 0 or not starts:
        raise UsageError(f"mouth cues: got {max(end_cs, 0) / GRID_HZ} s of motion, expected at least 0.01 s")
    cues: list[MouthCue] = []
    for (shape, begin), (_, end) in pairwise([*starts, ("", end_cs)]):
        _append(cues, MouthCue(shape, begin, min(end, end_cs)))
    cues[0] = replace(cues[0], start_cs=0)
    return tuple(_with_long_contacts(_without_short(cues)))


def _append(cues: list[MouthCue], cue: MouthCue) -> None:
    """Add a cue, or make the one before longer if it has the same shape; a cue without length is left out."""
    if cues and cues[-1].shape == cue.shape:
        cues[-1] = replace(cues[-1], end_cs=max(cue.end_cs, cues[-1].end_cs))
    elif cue.length_cs > 0:
        cues.append(cue)


def _without_short(cues: Sequence[MouthCue]) -> list[MouthCue]:
    """Merge each short cue without contact into its longer neighbour."""
    kept: list[MouthCue] = []
    begin = 0
    for index, cue in enumerate(cues):
        cue = replace(cue, start_cs=begin)
        begin = cue.end_cs
        if cue.shape in CONTACTS or cue.length_cs >= MIN_CUE_CS or len(cues) == 1:
            _append(kept, cue)
            continue
        before_cs = kept[-1].length_cs if kept else -1
        after_cs = cues[index + 1].length_cs if index + 1 < len(cues) else -1
        if after_cs >= before_cs:
            begin = cue.start_cs
        else:
            kept[-1] = replace(kept[-1], end_cs=cue.end_cs)
    return kept


def _with_long_contacts(cues: list[MouthCue]) -> list[MouthCue]:
    """Lengthen short contacts as far as their neighbours can spare it: at the end first, then at the start."""
    for index, cue in enumerate(cues):
        for neighbour in (index + 1, index - 1) if cue.shape in CONTACTS else ():
            if not 0 <= neighbour < len(cues):
                continue
            other = cues[neighbour]
            spare = max(min(MIN_CUE_CS - cues[index].length_cs, other.length_cs - MIN_CUE_CS), 0)
            if neighbour > index:
                cues[index] = replace(cues[index], end_cs=cues[index].end_cs + spare)
                cues[neighbour] = replace(other, start_cs=other.start_cs + spare)
            else:
                cues[index] = replace(cues[index], start_cs=cues[index].start_cs - spare)
                cues[neighbour] = replace(other, end_cs=other.end_cs - spare)
    return cues


ENDINGS = (".json", ".tsv", ".xml", ".dat")
"""Endings of the files."""
DAT_RATE_HZ = 24.0
"""Frames a second of ``.dat`` where nothing else is asked for, as Rhubarb does."""


def format_rhubarb(cues: Sequence[MouthCue], ending: str, *, sound_file: str = "") -> bytes:
    """Write cues as UTF-8.

    Parameters
    ----------
    cues : sequence of MouthCue
        At least one.
    ending : str
        One of :data:`ENDINGS`; it chooses the format.
    sound_file : str
        Path of the sound, for ``.json`` and ``.xml``.
    """
    if ending not in _WRITERS:
        raise UsageError(f"path: got {ending!r}, expected a name that ends with {', '.join(ENDINGS)}")
    if not cues:
        raise UsageError("mouth cues: empty; needs at least one")
    return _WRITERS[ending](cues, sound_file).encode()


def _seconds(time_cs: int) -> str:
    return f"{time_cs / GRID_HZ:.2f}"


def _json(cues: Sequence[MouthCue], sound_file: str) -> str:
    rows = ",\n".join(
        f'    {{ "start": {_seconds(cue.start_cs)}, "end": {_seconds(cue.end_cs)}, "value": "{cue.shape}" }}'
        for cue in cues
    )
    return (
        '{\n  "metadata": {\n'
        f'    "soundFile": {json.dumps(sound_file, ensure_ascii=False)},\n'
        f'    "duration": {_seconds(cues[-1].end_cs)}\n'
        f'  }},\n  "mouthCues": [\n{rows}\n  ]\n}}\n'
    )


def _tsv(cues: Sequence[MouthCue], _: str) -> str:
    rows = [f"{_seconds(cue.start_cs)}\t{cue.shape}\n" for cue in cues]
    return "".join([*rows, f"{_seconds(cues[-1].end_cs)}\tX\n"])


def _xml(cues: Sequence[MouthCue], sound_file: str) -> str:
    rows = "".join(
        f'    <mouthCue start="{_seconds(cue.start_cs)}" end="{_seconds(cue.end_cs)}">{cue.shape}</mouthCue>\n'
        for cue in cues
    )
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<rhubarbResult>\n  <metadata>\n'
        f"    <soundFile>{html.escape(sound_file, quote=False)}</soundFile>\n"
        f"    <duration>{_seconds(cues[-1].end_cs)}</duration>\n"
        f"  </metadata>\n  <mouthCues>\n{rows}  </mouthCues>\n</rhubarbResult>\n"
    )


def _dat(cues: Sequence[MouthCue], _: str) -> str:
    lines, last = ["MohoSwitch1"], 0
    for cue in cues:
        frame = _frame(cue.start_cs)
        if frame > last:
            lines.append(f"{frame} {cue.shape}")
            last = frame
    lines.append(f"{max(_frame(cues[-1].end_cs), last + 1)} X")
    return "\n".join(lines) + "\n"


def _frame(time_cs: int) -> int:
    return 1 + int(DAT_RATE_HZ * time_cs / GRID_HZ)


_WRITERS = {".json": _json, ".tsv": _tsv, ".xml": _xml, ".dat": _dat}
