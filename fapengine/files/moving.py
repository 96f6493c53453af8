"""Image sequences in the format that a name asks for: a video, an animated GIF or WebP, or numbered PNG files."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import require
from fapengine.errors import UsageError
from fapengine.files.paths import refuse_standard_output, replacing_folder
from fapengine.files.pictures import Picture, save_png
from fapengine.files.provenance import SYNTHETIC
from fapengine.files.video import av, mux, writing

GIF_MAX_HZ = 50.0
"""GIF counts hundredths of a second, and viewers slow down frames shorter than two of them."""
PALETTE_FRAMES = 100
"""Number of frames for choosing a GIF's colours: few enough to hold, enough to include an open mouth."""
NUMBER = re.compile(r"%(?:0[1-9])?d")
FOLDER_PATTERN = "frame_%04d.png"


@dataclass(frozen=True, slots=True)
class Format:
    """How FFmpeg encodes a kind of file."""

    codec: str
    sound_codec: str | None
    """None for animations, which have no audio."""
    pixels: str
    alpha_pixels: str | None
    """Pixel format with alpha; None if alpha is not supported."""
    options: dict[str, str]
    """Those of the codec."""
    muxer: dict[str, str] = field(default_factory=dict)


X264 = {"preset": "veryfast", "crf": "20", "tune": "animation"}
VP9 = {"deadline": "realtime", "cpu-used": "8", "crf": "32", "b": "0", "row-mt": "1"}
PRORES = {"profile": "4444", "vendor": "apl0", "alpha_bits": "16"}
"""ProRes 4444, which editors read with its alpha; some check the vendor."""
WEBP = {"quality": "90", "compression_level": "2"}
"""At 80, blocks of earlier frames stay in hair and cheeks: the encoder takes nearly equal pixels for equal ones."""
REPEATABLE = {"fflags": "+bitexact"}
"""Matroska without random ids: the same frames give the same bytes."""
FORMATS = {
    ".mp4": Format("libx264", "aac", "yuv420p", None, X264, {"movflags": "faststart"}),
    ".webm": Format("libvpx-vp9", "libopus", "yuv420p", "yuva420p", VP9, REPEATABLE),
    ".mkv": Format("libx264", "aac", "yuv420p", None, X264, REPEATABLE),
    ".mov": Format("prores_ks", "pcm_s16le", "yuv444p10le", "yuva444p10le", PRORES),
    ".gif": Format("gif", None, "pal8", None, {}, {"loop": "0"}),
    ".webp": Format("libwebp_anim", None, "yuv420p", "yuva420p", WEBP, {"loop": "0"}),
}
"""Formats by suffix; ``faststart`` puts the index of an MP4 first, so that a browser plays it while it loads."""
CODECS = tuple(suffix for suffix, kind in FORMATS.items() if kind.sound_codec)
"""Suffixes of videos, which may have audio."""
KINDS = f"{', '.join(FORMATS)}, a pattern such as frame_%04d.png, or a folder"
"""Supported names, as text."""


def is_sequence(path: Path) -> bool:
    """Whether a name is a pattern for numbered files, such as ``frame_%04d.png``."""
    return "%" in path.name


def sequence_files(pattern: Path) -> list[Path]:
    """Existing numbered files, in order."""
    numbered = re.compile(re.escape(NUMBER.sub("\0", pattern.name)).replace("\0", r"\d+"))
    found = [path for path in pattern.parent.glob("*") if numbered.fullmatch(path.name)]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def moving_file(path: Path) -> Path:
    """Name that :func:`write_moving` writes: a file, or the pattern of a sequence, which a folder gets."""
    return path if path.suffix or is_sequence(path) else path / FOLDER_PATTERN


def beside(path: Path, suffix: str) -> Path:
    """Name of a file that accompanies a video: ``talk.mp4`` has ``talk.wav``, and so has the folder ``talk``.

    For numbered files it is next to their folder.

    Raises
    ------
    UsageError
        If the path has no name, as ``.`` or ``..``.
    """
    if path.name in ("", ".."):
        raise UsageError(f"path: got {path}, expected a file name; the files next to it are named after it")
    owner = path.parent if is_sequence(path) and path.parent.name else path
    return path.with_name("frames" + suffix) if is_sequence(owner) else owner.with_name(owner.stem + suffix)


def is_moving(path: Path) -> bool:
    """Whether :func:`write_moving` supports a name."""
    return path.suffix in FORMATS or is_sequence(moving_file(path))


def takes_planes(path: Path) -> bool:
    """Whether :func:`write_moving` takes images as I420, which is what the encoder of this kind takes."""
    return path.suffix in CODECS and FORMATS[path.suffix].pixels == "yuv420p"


def check_moving(path: Path, *, rate_hz: float, size: tuple[int, int], alpha: bool) -> None:
    """Reject options that a format does not support, before anything is drawn.

    Raises
    ------
    UsageError
        For an unknown suffix, a rate too high for GIF, odd sides of a video, or alpha where it is not supported.
    ResourceError
        If a library for writing is not installed.
    """
    _check_name(path)
    if path.suffix == ".gif" and rate_hz > GIF_MAX_HZ:
        raise UsageError(f"GIF: got {rate_hz:g} Hz, expected at most {GIF_MAX_HZ:g}; .webp has no such limit")
    if path.suffix in CODECS and any(side % 2 for side in size):
        raise UsageError(f"size: got {size[0]}x{size[1]}, expected even sides for video")
    if alpha and path.suffix in FORMATS and not FORMATS[path.suffix].alpha_pixels:
        raise UsageError(f"background: got none, but {path.suffix} has no alpha; expected .webm, .mov, .webp or .png")
    require("films and pictures", av="av", PIL="pillow")


def _check_name(path: Path) -> None:
    refuse_standard_output(path)
    if not is_moving(path):
        raise UsageError(f"path: got {path}, expected a name that ends with {KINDS}")


def write_moving(
    path: Path,
    frames: Iterable[Picture],
    *,
    rate_hz: float,
    sound: tuple[NDArray[np.int16], int] | None = None,
    on_frame: Callable[[], None] = lambda: None,
    source: str = SYNTHETIC,
) -> int:
    """Write frames in the format that the name asks for: a video, an animation that loops, or numbered files.

    Parameters
    ----------
    path : Path
        A suffix of :data:`FORMATS`; a pattern with one ``%d`` or ``%04d``, as in FFmpeg; or a folder, which gets
        ``frame_0000.png`` and so on. GIF has one palette of 256 colours for all frames, to avoid flicker; WebP has
        all colours, in a third of the size.
    frames : iterable of (height, width, 3) uint8
        sRGB; all of one size, for videos with even sides. A fourth component is straight alpha. Where
        :func:`takes_planes`, also (height * 3 // 2, width): I420, Rec. 601 of limited range.
    rate_hz : float
        Frame rate; at most 50 for GIF.
    sound : ((N,) int16, int), optional
        Mono samples from time 0 and their rate; only videos have audio.
    on_frame : callable
        Called after each frame, for progress.
    source : str
        Where the images come from, which the file states: a term of :mod:`fapengine.files.provenance`.

    Returns
    -------
    int
        Number of frames written. Numbered files replace existing ones together at the end; files of an earlier run
        with higher numbers are removed.

    Raises
    ------
    UsageError
        As :func:`check_moving`, or if there is no frame.
    ResourceError
        If a file cannot be written or a codec is missing.
    """
    _check_name(path)
    count = 0

    def counted() -> Iterator[Picture]:
        nonlocal count
        for picture in frames:
            yield picture
            count += 1
            on_frame()

    if path.suffix in FORMATS:
        _write_video(path, counted(), Fraction(rate_hz).limit_denominator(1001), sound, source)
    else:
        _write_sequence(moving_file(path), counted(), source)
    return count


def _write_sequence(pattern: Path, frames: Iterable[Picture], source: str) -> None:
    rest, numbers = NUMBER.subn("", pattern.name)
    if numbers != 1 or "%" in rest or pattern.suffix != ".png":
        raise UsageError(f"frames: got {pattern.name}, expected one number in a PNG's name, as frame_%04d.png")
    with replacing_folder(pattern.parent, owned=[NUMBER.sub("[0-9]*", pattern.name)]) as folder:
        for number, picture in enumerate(frames):
            save_png(folder / (pattern.name % number), picture, source=source)


def _write_video(
    path: Path, frames: Iterator[Picture], rate: Fraction, sound: tuple[NDArray[np.int16], int] | None, source: str
) -> None:
    kind, is_gif = FORMATS[path.suffix], path.suffix == ".gif"
    start = list(itertools.islice(frames, PALETTE_FRAMES if is_gif else 1))
    if not start:
        raise UsageError(f"{path.name}: got no frame, expected one or more")
    height, width = start[0].shape[:2] if start[0].ndim == 3 else (start[0].shape[0] * 2 // 3, start[0].shape[1])
    has_alpha = start[0].shape[2:] == (4,)
    check_moving(path, rate_hz=float(rate), size=(width, height), alpha=has_alpha)
    with writing(path, kind.muxer, source=source) as container:
        stream: Any = container.add_stream(kind.codec, rate=rate)
        stream.height, stream.width = height, width
        stream.pix_fmt = kind.alpha_pixels if has_alpha else kind.pixels
        stream.options = kind.options
        if kind.sound_codec:
            stream.codec_context.thread_count = 0
        if has_alpha and path.suffix == ".webm":
            stream.metadata["alpha_mode"] = "1"  # players look there
            stream.options = {**stream.options, "auto-alt-ref": "0"}  # libvpx refuses both together
        timed = _timed(itertools.chain(start, frames), rate)
        if is_gif:
            timed = _in_palette(timed, _palette(start), rate)
        packets = (packet for frame in itertools.chain(timed, [None]) for packet in stream.encode(frame))
        mux(container, packets, kind.sound_codec, sound)


def rgb_of(picture: Picture) -> Picture:
    """Return an image of a film as (height, width, 3 or 4) sRGB, also if it came as planes."""
    if picture.ndim == 3:
        return picture
    return np.asarray(av.VideoFrame.from_ndarray(picture, format="yuv420p").to_ndarray(format="rgb24"), np.uint8)


def _timed(pictures: Iterable[Picture], rate: Fraction) -> Iterator[av.VideoFrame]:
    formats = {(): "yuv420p", (3,): "rgb24", (4,): "rgba"}
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(picture, format=formats[picture.shape[2:]])
        frame.pts, frame.time_base = number, 1 / rate
        yield frame


def _source(graph: Any, frame: av.VideoFrame, rate: Fraction) -> Any:
    return graph.add(
        "buffer",
        f"video_size={frame.width}x{frame.height}:pix_fmt={frame.format.name}"
        f":time_base={rate.denominator}/{rate.numerator}:pixel_aspect=1/1",
    )


def _palette(pictures: Sequence[Picture]) -> av.VideoFrame:
    """Choose 256 colours for all images."""
    graph, rate = av.filter.Graph(), Fraction(1)
    frames = list(_timed(pictures, rate))
    source = _source(graph, frames[0], rate)
    chooser, sink = graph.add("palettegen", "stats_mode=full:reserve_transparent=0"), graph.add("buffersink")
    source.link_to(chooser)
    chooser.link_to(sink)
    graph.configure()
    for frame in (*frames, None):
        source.push(frame)
    palette = sink.pull()
    assert isinstance(palette, av.VideoFrame)
    return palette


def _in_palette(frames: Iterator[av.VideoFrame], palette: av.VideoFrame, rate: Fraction) -> Iterator[av.VideoFrame]:
    """Convert frames to the palette, with a fixed dither pattern."""
    first = next(frames)
    graph = av.filter.Graph()
    source, colours = _source(graph, first, rate), _source(graph, palette, rate)
    painter = graph.add("paletteuse", "dither=bayer:bayer_scale=3:diff_mode=rectangle")
    sink = graph.add("buffersink")
    source.link_to(painter, 0, 0)
    colours.link_to(painter, 0, 1)
    painter.link_to(sink)
    graph.configure()
    palette.pts = 0
    colours.push(palette)
    colours.push(None)
    for frame in itertools.chain([first], frames, [None]):
        source.push(frame)
        yield from _pulled(sink)


def _pulled(sink: Any) -> Iterator[av.VideoFrame]:
    while True:
        try:
            frame = sink.pull()
        except (av.BlockingIOError, av.EOFError):
            return
        assert isinstance(frame, av.VideoFrame)
        frame.pict_type = 0  # the encoder chooses the frame type
        yield frame
