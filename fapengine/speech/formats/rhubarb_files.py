"""Mouth cues as the files of Rhubarb Lip Sync 1.14, for the many programs that import them.

Keys, order, spaces and two decimals are those of Rhubarb's own files (README, "Output formats"; layout seen in files
that 1.14.0 wrote), because some importers search the text. ``.dat`` is a switch file of Moho: its first line is
``MohoSwitch1``, frames count from 1, and the last line closes the mouth at the end.
"""

import html
import json
from collections.abc import Sequence

from fapengine.errors import UsageError
from fapengine.speech.formats.mouth_cues import GRID_HZ, MouthCue

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

    Raises
    ------
    UsageError
        If there is no such format, or no cue.
    """
    if ending not in _WRITERS:
        raise UsageError(f"path: got {ending!r}, expected a name that ends with {', '.join(ENDINGS)}")
    if not cues:
        raise UsageError("mouth cues: got none, expected at least one")
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
