"""The kinds of files that face motion is saved as: one row per ending.

Python's ``save``, the commands ``say``, ``animate``, ``convert`` and ``batch`` and their errors use this table. To add
a kind, write its function here, or in :mod:`fapengine.app.scene_files`, and add its row.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Sound, SoundLike, as_sound
from fapengine.app.drawing import resized
from fapengine.app.heads import load_head
from fapengine.app.report import Report
from fapengine.errors import UsageError
from fapengine.files.heads.load import check_head_name
from fapengine.files.motion import as_visemes, save_fap, shown
from fapengine.files.moving import FOLDER_PATTERN, check_moving, is_sequence, takes_planes, write_moving
from fapengine.files.paths import write_bytes
from fapengine.files.pictures import save_png, straight
from fapengine.files.provenance import provenance
from fapengine.files.sound import save_wav
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.fap import FULL_WEIGHT, column
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, Picture, RenderOptions
from fapengine.render.native import open_renderer
from fapengine.speech.phone_track import PhoneTrack

if TYPE_CHECKING:
    from fapengine.app.scene_files import Into
    from fapengine.codec.encoder import EncoderOptions
    from fapengine.speech.formats.visemes import TimedViseme

WEIGHT_SETS = ("arkit", "oculus", "vrm0", "vrm1")
"""Sets of blendshapes, which have a weight in each frame: :data:`fapengine.retarget.blend_tracks.SHAPE_SETS`."""
RHUBARB = "rhubarb"
"""The set of nine mouth shapes of Rhubarb Lip Sync."""
TIMED_SETS = ("mpeg4", "oculus", "azure", RHUBARB)
"""Sets of visemes, which have times: :mod:`fapengine.speech.formats.visemes`."""
EVENT_SETS = tuple(name for name in TIMED_SETS if name not in WEIGHT_SETS)
"""Sets that are written to standard output as JSON."""
SETS = tuple(dict.fromkeys((*WEIGHT_SETS, *TIMED_SETS)))
RATE_TOLERANCE = 1.02
"""Fraction of a bit rate above which it is missed."""
log = logging.getLogger("fapengine.outputs")
OTHER_NAMES = {"vrm": "vrm1"}
"""Other names of sets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SaveOptions:
    """Data that is saved with the FAPs, and options of the formats."""

    sound: Sound | None = None
    phones: PhoneTrack | None = None
    """Source of mouth shapes; without phones they are found from the motion."""
    recording: Path | None = None
    """Sound file that mouth shapes refer to."""
    name: str = ""
    """Name of an avatar's animation; by default that of the file."""
    head: str | Path | FaceMesh = "default"
    drawing: RenderOptions = DEFAULT_RENDER_OPTIONS
    at_s: float | None = None
    """Time of the frame that a single image shows; by default that with the widest open jaw."""
    shapes: str | None = None
    encoding: EncoderOptions | None = None
    into: Into | None = None
    provenance: bool = True
    """Whether images, films and avatars say that they are synthetic: :mod:`fapengine.files.provenance`."""
    on_frame: Callable[[], None] = lambda: None
    on_image: Callable[[int, Picture], None] = lambda number, picture: None
    """Called with each image of a video, and its number; :func:`~fapengine.files.moving.rgb_of` makes it RGB."""
    report: Report = field(default_factory=Report)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", OTHER_NAMES.get(self.shapes or "", self.shapes))

    @classmethod
    def of(
        cls,
        *,
        sound: SoundLike | None = None,
        drawing: RenderOptions | None,
        size: tuple[int, int] | None,
        kbit_s: float | None,
        encoding: EncoderOptions | None,
        into: str | Path | Into | None,
        **others: Any,
    ) -> Self:
        """Make options from the parameters of :func:`fapengine.save`."""
        if kbit_s is not None:
            if encoding is not None:
                raise UsageError("kbit_s and encoding: got both, expected one; EncoderOptions has a kbit_s of its own")
            from fapengine.codec.encoder import EncoderOptions

            encoding = EncoderOptions(kbit_s=kbit_s)
        if isinstance(into, str | Path):
            from fapengine.app.scene_files import Into

            into = Into(Path(into))
        heard = None if sound is None else as_sound(sound)
        return cls(sound=heard, drawing=resized(drawing, size), encoding=encoding, into=into, **others)


@dataclass(frozen=True, slots=True)
class OutputKind:
    """One row: a kind of file."""

    ending: str
    """Ending of the file name; empty for a folder."""
    name: str
    """Its name in reports."""
    write: Callable[[FapTrack, Path, SaveOptions], None]
    beside: tuple[str, ...] = ()
    """Endings of the files that ``say`` and ``animate`` write next to it."""
    shapes: tuple[str | None, ...] = (None,)
    """Sets of shapes that it accepts. None: one need not be named."""
    takes_avatar: bool = False
    keeps_visemes: bool = False
    """FAP 1 and 2 are written as they are; elsewhere as the low-level FAPs that show them."""

    @property
    def names_sound(self) -> bool:
        """True for visemes, whose files name the recording that they belong to."""
        return self.write is _write_visemes

    @property
    def is_drawn(self) -> bool:
        """True for what needs a renderer."""
        return self.write in (_write_image, _write_images)

    @property
    def is_image(self) -> bool:
        """True for what needs a renderer for all frames: video, animation, image sequence."""
        return self.write is _write_images


def find_kind(path: Path) -> OutputKind:
    """Find the kind of a file name. Raises UsageError if the ending is unknown, or the path has no file name."""
    if not path.name:
        raise UsageError(f"path: got {path}, expected the name of a file or folder")
    ending = FOLDER_PATTERN if is_sequence(path) else path.suffix
    exact = [row for row in OUTPUT_KINDS if row.ending == ending]
    found = exact or [row for row in OUTPUT_KINDS if row.takes_avatar and row.ending == ending.lower()]
    if not found:
        endings = ", ".join(row.ending for row in OUTPUT_KINDS if row.ending)
        raise UsageError(f"path: got {path}, expected a name that ends with {endings}, or a folder")
    return found[0]


def check_output(path: Path, options: SaveOptions, *, rate_hz: float) -> OutputKind:
    """Find the kind of a file name, and reject options that it does not support, before any work is done.

    Raises UsageError for an unknown ending, or an option that the file cannot have; ResourceError if a library for
    writing is not installed.
    """
    kind = find_kind(path)
    if options.encoding is not None and kind.write is not _write_stream:
        raise UsageError(f"encoding: got one, or kbit_s, for {path}, expected a name that ends with .fba")
    if options.shapes is not None and options.shapes not in SETS:
        raise UsageError(f"shapes: got {options.shapes!r}, expected one of {', '.join((*SETS, *OTHER_NAMES))}")
    if options.shapes not in kind.shapes:
        if sets := " or ".join(f"shapes={name}" for name in kind.shapes if name):
            raise UsageError(f"shapes: got {options.shapes or 'none'} for {path.name}, expected {sets}")
        endings = ", ".join(row.ending for row in OUTPUT_KINDS if options.shapes in row.shapes)
        raise UsageError(f"path: got {path}, expected a name that ends with {endings} for shapes={options.shapes}")
    if options.into is None:
        if kind.takes_avatar:
            raise UsageError(f"into: missing; {path} needs an avatar (into=AVATAR.glb)")
    elif not kind.takes_avatar:
        endings = " or ".join(row.ending for row in OUTPUT_KINDS if row.takes_avatar)
        raise UsageError(f"path: got {path}, expected a name that ends with {endings} for into=AVATAR")
    else:
        from fapengine.app.scene_files import check_avatar

        check_avatar(path, options.into)
    if isinstance(options.head, str | Path):
        check_head_name(str(options.head))
    if kind.is_image:
        drawing = options.drawing
        check_moving(path, rate_hz=rate_hz, size=drawing.size, alpha=drawing.components == 4)
    return kind


def write_output(track: FapTrack, path: Path, options: SaveOptions) -> None:
    """Check the options, and write the kind of file that the name asks for.

    Raises UsageError as :func:`check_output`; ResourceError if the file cannot be written, or there is no OpenGL.
    """
    kind = check_output(path, options, rate_hz=track.rate_hz)
    with provenance(options.provenance):
        kind.write(track if kind.keeps_visemes else shown(track), path, options)


def _write_stream(track: FapTrack, path: Path, options: SaveOptions) -> None:
    from fapengine.codec.encoder import encode

    data = encode(track, options.encoding)
    write_bytes(path, data)
    if remark := missed_rate(len(data), track, options.encoding.kbit_s if options.encoding else None):
        log.warning("%s: %s", path, remark)
        options.report.remarks += (remark,)


def missed_rate(size: int, track: FapTrack, kbit_s: float | None) -> str:
    """Say that a stream of ``size`` bytes has more than the bit rate that was asked for; empty if not."""
    reached = 8 * size / track.duration_s / 1000 if len(track) else 0.0
    if kbit_s is None or reached <= kbit_s * RATE_TOLERANCE:
        return ""
    return f"{round(reached, 3)} kbit/s is more than the {kbit_s:g} asked for"


def _write_table(track: FapTrack, path: Path, options: SaveOptions) -> None:
    if options.shapes not in (*WEIGHT_SETS, None):
        _write_visemes(track, path, options)
        return
    from fapengine.retarget.blend_tracks import format_blend_csv

    write_bytes(path, format_blend_csv(track, options.shapes or "arkit"))


def _write_sound(track: FapTrack, path: Path, options: SaveOptions) -> None:
    if options.sound is None:
        raise UsageError(f"sound: missing; {path} needs samples and their rate")
    save_wav(path, *options.sound)


def _write_visemes(track: FapTrack, path: Path, options: SaveOptions) -> None:
    from fapengine.speech.formats.visemes import format_visemes

    shapes = options.shapes or ""
    rows = timed_visemes(track, options.phones, shapes, options.sound)
    recording = str(options.recording.resolve()) if options.recording else ""
    write_bytes(path, format_visemes(rows, shapes, path.suffix, sound_file=recording))


def timed_visemes(
    track: FapTrack, phones: PhoneTrack | None, shapes: str, sound: Sound | None = None
) -> list[TimedViseme]:
    """List the visemes of phones, or of a motion where there are none. Raises UsageError for an unknown set."""
    from fapengine.speech.formats.visemes import check_viseme_set, visemes_of_frames, visemes_of_phones

    check_viseme_set(shapes)
    if phones is not None:
        return visemes_of_phones(phones, shapes, duration_s=len(sound[0]) / sound[1] if sound else None)
    if not len(track):
        raise UsageError("track: contains no frames")
    faps = shown(track).filled_values()
    if shapes == RHUBARB:
        from fapengine.retarget.visemes import approximate_shapes

        return visemes_of_frames(approximate_shapes(faps, track.rate_hz), track.rate_hz, shapes)
    first, second, blend, _ = as_visemes(FapTrack.from_values(faps, rate_hz=track.rate_hz)).visemes.T
    return visemes_of_frames(np.where(2 * blend >= FULL_WEIGHT, first, second).tolist(), track.rate_hz, shapes)


def _write_image(track: FapTrack, path: Path, options: SaveOptions) -> None:
    times_s = track.times_s - track.times_s[0] if len(track) else np.zeros(0)
    last_s = float(times_s[-1]) if len(track) else 0.0
    at_s = options.at_s
    if not len(track) or not (at_s is None or 0 <= at_s <= last_s):
        raise UsageError(f"at_s: got {at_s} s, the track lasts {last_s:.2f} s")
    row = (
        np.argmax(track.values[:, column(3)])
        if at_s is None
        else np.searchsorted(times_s, at_s + 1e-9, side="right") - 1
    )
    save_png(path, next(draw_frames(track.values[[row]], options)))


def _write_images(track: FapTrack, path: Path, options: SaveOptions) -> None:
    def images() -> Iterator[Picture]:
        for number, picture in enumerate(draw_frames(track.filled_values(), options, planes=takes_planes(path))):
            options.on_image(number, picture)
            yield picture

    with options.report.stage("encode"):
        write_moving(path, images(), rate_hz=track.rate_hz, sound=options.sound, on_frame=options.on_frame)


def draw_frames(rows: NDArray[np.int32], options: SaveOptions, *, planes: bool = False) -> Iterator[Picture]:
    """Draw FAPs, (T, 68) FAPU: one image per frame, sRGB with straight alpha; with ``planes`` I420 where possible."""
    report = options.report
    with report.stage("head"):
        mesh = options.head if isinstance(options.head, FaceMesh) else load_head(options.head)
    with report.stage("upload"):
        renderer = open_renderer(mesh, options.drawing)
    with renderer:
        if planes and options.drawing.takes_i420:
            pictures = renderer.frames(rows, "i420")
        else:
            pictures = map(straight, renderer.frames(rows))
        for _ in range(len(rows)):
            with report.stage("draw"):
                picture = next(pictures)
            yield picture


def _write_scene(track: FapTrack, path: Path, options: SaveOptions) -> None:
    from fapengine.app.scene_files import save_scene  # formats of other programs, which a video does not need

    with options.report.stage("avatar"):
        options.report.moved = save_scene(
            path, track, options.into, shapes=options.shapes, name=options.name or path.stem
        )
        if options.into is not None and options.into.is_foreign:
            from fapengine.app.head_check import check_avatar

            tested = check_avatar(options.into.avatar, options.into.mapping)
            options.report.moved = "; ".join((options.report.moved, tested.summary, *tested.remarks))


FILM, SPOKEN = (".fap", ".wav", ".png"), (".fap", ".wav")
"""What ``say`` writes next to a video, and next to an avatar."""
OUTPUT_KINDS = (
    OutputKind(".fap", "FAPs", lambda track, path, _: save_fap(path, track), (".wav",), keeps_visemes=True),
    OutputKind(".fba", "FBA stream", _write_stream, (".wav",), keeps_visemes=True),
    OutputKind(".csv", "blendshapes", _write_table, (".wav",), (None, *SETS)),
    OutputKind(".json", "visemes", _write_visemes, (".wav",), TIMED_SETS),
    OutputKind(".tsv", "visemes", _write_visemes, (".wav",), TIMED_SETS),
    OutputKind(".xml", "visemes", _write_visemes, (".wav",), (RHUBARB,)),
    OutputKind(".dat", "visemes", _write_visemes, (".wav",), (RHUBARB,)),
    OutputKind(".glb", "avatar", _write_scene, SPOKEN, takes_avatar=True),
    OutputKind(".vrm", "avatar", _write_scene, SPOKEN, takes_avatar=True),
    OutputKind(".usda", "avatar", _write_scene, SPOKEN, takes_avatar=True),
    OutputKind(".usdc", "avatar", _write_scene, SPOKEN, takes_avatar=True),
    OutputKind(".usd", "avatar", _write_scene, SPOKEN, takes_avatar=True),
    OutputKind(".vrma", "avatar", _write_scene, SPOKEN, (None, "vrm1", "arkit")),
    OutputKind(".wav", "sound", _write_sound),
    OutputKind(".png", "image", _write_image),
    OutputKind(".mp4", "video", _write_images, FILM),
    OutputKind(".webm", "video", _write_images, FILM),
    OutputKind(".mkv", "video", _write_images, FILM),
    OutputKind(".mov", "video", _write_images, FILM),
    OutputKind(".gif", "pictures", _write_images, FILM),
    OutputKind(".webp", "pictures", _write_images, FILM),
    OutputKind(FOLDER_PATTERN, "pictures", _write_images, FILM),
    OutputKind("", "pictures", _write_images, FILM),
)
"""All kinds, in the order in which errors list them."""
