"""Rhubarb's mouth shapes into a file, from a motion or from the phones of a performance."""

from pathlib import Path

from fapengine.errors import UsageError
from fapengine.files.paths import write_bytes
from fapengine.mpeg4.track import FapTrack
from fapengine.speech.formats.rhubarb import ENDINGS, MouthCue, cues_of_frames, cues_of_phones, format_rhubarb
from fapengine.speech.phone_track import PhoneTrack

RHUBARB = "rhubarb"
"""Name of the set of shapes."""


def is_cues(path: Path) -> bool:
    """Tell whether a name is that of a file of mouth shapes."""
    return path.suffix in ENDINGS


def check_cues(path: Path, shapes: str | None) -> None:
    """Refuse a name and a set of shapes that do not belong together.

    Raises
    ------
    UsageError
        If ``shapes`` is missing or another set, or the name has another ending.
    """
    if is_cues(path) and shapes != RHUBARB:
        raise UsageError(f"shapes: got {shapes or 'none'}, expected shapes={RHUBARB} for a name as {path.name}")
    if shapes == RHUBARB and not is_cues(path):
        raise UsageError(f"path: got {path}, expected a name that ends with {', '.join(ENDINGS)} for shapes={RHUBARB}")


def save_cues_of_phones(path: Path, phones: PhoneTrack, duration_s: float, sound_file: Path | None = None) -> None:
    """Write the shapes that show phones. Raises ResourceError if the file cannot be written."""
    _save(path, cues_of_phones(phones, duration_s=duration_s), sound_file)


def save_cues_of_motion(path: Path, track: FapTrack, sound_file: Path | None = None) -> None:
    """Write the shapes that look like a motion. Raises ResourceError if the file cannot be written."""
    from fapengine.retarget.rhubarb import approximate_shapes

    _save(path, cues_of_frames(approximate_shapes(track.even_values(), track.rate_hz), track.rate_hz), sound_file)


def _save(path: Path, cues: tuple[MouthCue, ...], sound_file: Path | None) -> None:
    named = str(sound_file.resolve()) if sound_file else ""
    write_bytes(path, format_rhubarb(cues, path.suffix, sound_file=named))
