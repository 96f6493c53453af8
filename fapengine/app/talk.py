"""What ``say`` and ``animate`` write: a file of any kind, and next to it FAPs, sound and a contact sheet."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from fapengine.app.outputs import OutputKind, SaveOptions, find_kind
from fapengine.app.performance import Performance
from fapengine.files.moving import beside, moving_file, rgb_of
from fapengine.files.outputs import identities
from fapengine.files.paths import is_standard
from fapengine.files.pictures import contact_sheet, save_png
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import Picture
from fapengine.speech.phone_track import Phone, PhoneTrack, find_unknown

MAX_SHEET_PHONES = 40
"""Phones on a contact sheet; of longer speech, evenly chosen ones."""
KEY_FRACTION = 0.3
"""Part of a phone's duration after which it is shown: its keyframe."""


def outputs_of(
    path: Path, *, sound: bool, inputs: Collection[Path] = (), recording: bool = False
) -> tuple[list[Path], list[Path]]:
    """List the files that :func:`write_talk` writes: the output, and those beside it.

    Parameters
    ----------
    path : Path
    sound : bool
        True if there is sound.
    inputs : collection of Path
        As of :func:`write_talk`.
    recording : bool
        True if the sound comes from a file of the user.
    """
    kind = find_kind(path)
    companions = _companions(path, kind, sound=sound, inputs=inputs, recording=recording)
    return [moving_file(path) if kind.is_image else path], companions


def _companions(path: Path, kind: OutputKind, *, sound: bool, inputs: Collection[Path], recording: bool) -> list[Path]:
    """List the files beside an output; a recording of the user is not written over, nor copied for mouth shapes."""
    if is_standard(path):
        return []
    names = [beside(path, ending) for ending in kind.beside]
    has_sound = sound and not (recording and kind.names_sound)
    return [name for name in names if name.suffix != ".wav" or (has_sound and not _is_among(name, inputs))]


def write_talk(performance: Performance, path: Path, options: SaveOptions, *, inputs: Collection[Path] = ()) -> None:
    """Write every file, and fill in the report of the options.

    Raises UsageError if an option is not supported; ResourceError if a file cannot be written, or there is no OpenGL.

    Parameters
    ----------
    performance : Performance
    path : Path
        Any kind of file that ``say`` writes: see :data:`fapengine.app.outputs.OUTPUT_KINDS`.
    options : SaveOptions
        Its ``recording`` is the file that the sound came from, if any.
    inputs : collection of Path
        The user's own files: a recording where the sound would be written stays as it is.
    """
    kind, report, track = find_kind(path), options.report, performance.track
    spoken = performance.phones
    report.frames, report.rate_hz = len(track), track.rate_hz
    report.duration_s, report.level = performance.duration_s, spoken.level
    report.phones = sum(not phone.is_silence for phone in spoken.phones)
    report.unknown, report.reading, report.remarks = find_unknown(spoken), spoken.reading, performance.remarks
    has_sound, has_recording = performance.sound is not None, options.recording is not None
    companions = _companions(path, kind, sound=has_sound, inputs=inputs, recording=has_recording)
    wav, sheet = beside(path, ".wav"), beside(path, ".png")
    phones = _sheet_phones(spoken, track)
    kept: dict[int, Picture] = {}

    def keep(number: int, picture: Picture) -> None:
        if number in phones:
            kept[number] = picture

    options = replace(
        options, sound=performance.sound, phones=spoken, on_image=keep,
        recording=options.recording or (wav if wav in companions else None),
    )  # fmt: skip
    for name in companions:
        if name != sheet:
            find_kind(name).write(track, name, options)
    kind.write(track, path, options)
    files = [name for name in (path, *(each for each in companions if each != sheet)) if not is_standard(name)]
    report.files += [(name, find_kind(name).name) for name in files]
    if has_sound and _is_among(wav, inputs) and not kind.names_sound:
        report.files.append((wav, "sound, as it was"))
    if kept:
        with report.stage("contact sheet"):
            labels = [(phones[number].label, f"{number / track.rate_hz:.2f} s") for number in kept]
            save_png(sheet, contact_sheet([rgb_of(each) for each in kept.values()], labels, title=performance.text))
        report.files.append((sheet, "contact sheet"))


def _is_among(path: Path, files: Collection[Path]) -> bool:
    """Whether a path is one of these files, under any name."""
    keys = {*identities(path)} if path.exists() else set()
    return any(file.exists() and keys.intersection(identities(file)) for file in files)


def _sheet_phones(phones: PhoneTrack, track: FapTrack) -> dict[int, Phone]:
    """Frame number to phone, for the contact sheet."""
    spoken = [phone for phone in phones.phones if not phone.is_silence]
    if len(spoken) > MAX_SHEET_PHONES:
        spoken = [spoken[index] for index in np.linspace(0, len(spoken) - 1, MAX_SHEET_PHONES).round().astype(int)]
    chosen: dict[int, Phone] = {}
    for phone in spoken:
        number = round((phone.start_s + KEY_FRACTION * phone.duration_s) * track.rate_hz)
        chosen.setdefault(min(number, len(track) - 1), phone)
    return chosen
