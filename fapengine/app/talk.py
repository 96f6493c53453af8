"""Everything that ``say`` and ``animate`` write of a performance: moving picture, FAPs, sound, and a contact sheet."""

import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import numpy as np

from fapengine.app.manner import Manner, check_expressions
from fapengine.app.mouth_cues import check_cues, is_cues, save_cues_of_phones
from fapengine.app.performance import Performance
from fapengine.app.report import Report
from fapengine.app.scene_choice import Into, check_scene, is_scene
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.load import DEFAULT_HEAD, load_head
from fapengine.files.motion import save_fap
from fapengine.files.moving import CODECS, KINDS, beside, check_moving, is_moving, moving_files, write_moving
from fapengine.files.paths import is_standard
from fapengine.files.pictures import contact_sheet, save_png, straight
from fapengine.files.sound import save_wav
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import Drawing, Picture
from fapengine.render.renderer import FaceRenderer
from fapengine.speech.phone_track import Phone, PhoneTrack, find_unknown

MAX_SHEET_PHONES = 40
"""Phones on a contact sheet; of longer speech, evenly chosen ones."""
KEY_FRACTION = 0.3
"""Part of a phone's duration after which it is shown: its keyframe."""


def check(path: Path, manner: Manner, drawing: Drawing, *, shapes: str | None = None, into: Into | None = None) -> None:
    """Refuse choices that cannot be met before any work is done.

    Raises
    ------
    UsageError
        For a name of unknown ending, an expression, or a picture that the file cannot hold.
    """
    check_cues(path, shapes)
    check_expressions(manner.expressions)
    check_scene(path, into)
    if is_cues(path) or is_scene(path):
        return
    if not (is_moving(path) or path.suffix == ".fap"):
        raise UsageError(f"path: got {path}, expected a name that ends with {KINDS}, or .fap")
    if path.suffix != ".fap":
        check_moving(path, rate_hz=manner.rate_hz, size=drawing.size, alpha=drawing.components == 4)


def outputs_of(path: Path, *, sound: bool, inputs: Collection[Path] = (), recording: bool = False) -> list[Path]:
    """Names that :func:`write_talk` writes.

    Parameters
    ----------
    path : Path
    sound : bool
        True if there is a sound.
    inputs : collection of Path
        As of :func:`write_talk`.
    recording : bool
        True if the sound comes from a file of the user's.
    """
    wav = beside(path, ".wav")
    if is_standard(path):
        return [path]
    if is_cues(path):
        return [path, *([wav] if sound and not recording else [])]
    names = [beside(path, ".fap"), *([wav] if sound and not _is_among(wav, inputs) else [])]
    if is_scene(path):
        return [path, *names]
    return names if path.suffix == ".fap" else [*moving_files(path), *names, beside(path, ".png")]


def refuse_unknown(phones: PhoneTrack, where: str) -> None:
    """Refuse a track with labels that are no IPA, that are doubtful, or that two alphabets read otherwise.

    Raises
    ------
    DataError
        Its message lists them; ``where`` is the file or the voice.
    """
    if phones.reading is not None and phones.reading.others:
        raise DataError(f"alphabet: got {phones.reading}, expected labels of one alphabet", where=where)
    if unknown := find_unknown(phones):
        raise DataError(f"unknown phones: got {'; '.join(map(str, unknown))}, expected IPA", where=where)


def note_speech(performance: Performance, report: Report) -> None:
    """Fill in the figures of a report that describe the speech."""
    phones = performance.phones
    report.frames, report.rate_hz = len(performance.track), performance.track.rate_hz
    report.duration_s, report.level = performance.duration_s, phones.level
    report.phones = sum(not phone.is_silence for phone in phones.phones)
    report.unknown, report.reading = find_unknown(phones), phones.reading


def write_talk(
    performance: Performance,
    path: Path,
    report: Report,
    *,
    head: str = DEFAULT_HEAD,
    drawing: Drawing,
    inputs: Collection[Path] = (),
    recording: Path | None = None,
    into: Into | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Write every file, and fill in the report.

    Parameters
    ----------
    performance : Performance
    path : Path
        A moving picture, ``.fap`` for FAPs and sound alone, or one of Rhubarb's files for mouth shapes. What belongs to
        it stands beside it.
    report : Report
    head : str
        Whose face: see :func:`fapengine.files.heads.load.load_head`.
    drawing : Drawing
    inputs : collection of Path
        The user's own files: a recording that stands where the sound would be written stays as it is.
    recording : Path, optional
        File that the sound came from; files of mouth shapes name it.
    into : Into, optional
        Somebody's avatar, into which the motion goes: it is not drawn.
    on_frame : callable
        Called after each frame that is drawn.

    Raises
    ------
    UsageError
        If a choice cannot be met.
    ResourceError
        If a file cannot be written, or there is no OpenGL.
    """
    note_speech(performance, report)
    track, sound = performance.track, performance.sound
    if is_cues(path):
        _write_cues(performance, path, report, recording)
        return
    if is_standard(path):
        save_fap(path, track)
        return
    save_fap(beside(path, ".fap"), track)
    own_sound = _is_among(beside(path, ".wav"), inputs)
    if sound is not None and not own_sound:
        save_wav(beside(path, ".wav"), *sound)
    if is_scene(path):
        from fapengine.app.scene_files import save_scene  # other programs' files, which a film does without

        with report.stage("avatar"):
            report.moved = save_scene(path, track, into, name=path.stem)
        report.files.append((path, "avatar"))
    elif path.suffix != ".fap":
        kept = _draw(performance, path, report, head=head, drawing=drawing, on_frame=on_frame)
        if kept:
            with report.stage("contact sheet"):
                sheet = beside(path, ".png")
                labels = [(phone.label, f"{number / track.rate_hz:.2f} s") for number, (phone, _) in kept.items()]
                pictures = [picture for _, picture in kept.values()]
                save_png(sheet, contact_sheet(pictures, labels, title=performance.text))
                report.files.append((sheet, "contact sheet"))
        report.files.append((path, "video" if path.suffix in CODECS else "pictures"))
    report.files.append((beside(path, ".fap"), "FAPs"))
    if sound is not None:
        report.files.append((beside(path, ".wav"), "sound, as it was" if own_sound else "sound"))


def _write_cues(performance: Performance, path: Path, report: Report, recording: Path | None) -> None:
    """Write mouth shapes, and the sound if no file has it yet."""
    if performance.sound is not None and recording is None and not is_standard(path):
        recording = beside(path, ".wav")
        save_wav(recording, *performance.sound)
        report.files.append((recording, "sound"))
    save_cues_of_phones(path, performance.phones, performance.duration_s, recording)
    report.files.insert(0, (path, "mouth shapes"))


def _is_among(path: Path, files: Collection[Path]) -> bool:
    """Tell whether a path is one of these files, under whatever name."""
    return path.exists() and any(file.exists() and path.samefile(file) for file in files)


def _draw(
    performance: Performance,
    path: Path,
    report: Report,
    *,
    head: str,
    drawing: Drawing,
    on_frame: Callable[[], None],
) -> dict[int, tuple[Phone, Picture]]:
    """Write the moving picture; return the frames of a contact sheet by number, each with its phone."""
    track, shown = performance.track, _sheet_phones(performance.phones, performance.track)
    kept: dict[int, tuple[Phone, Picture]] = {}
    with report.stage("head"):
        mesh = load_head(head)
    with report.stage("upload"):
        renderer = FaceRenderer(mesh, drawing)
    with renderer:

        def frames() -> Iterator[Picture]:
            pictures = map(straight, renderer.frames(track.values))
            for number in range(len(track)):
                with report.stage("draw"):
                    picture = next(pictures)
                if number in shown:
                    kept[number] = shown[number], picture
                yield picture

        started_s = time.perf_counter()
        write_moving(path, frames(), rate_hz=track.rate_hz, sound=performance.sound, on_frame=on_frame)
        report.stages["encode"] = time.perf_counter() - started_s - report.stages["draw"]
    return kept


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
