"""Image sequences in the format that a name asks for: a video, an animated GIF or WebP, or numbered PNG files."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late, require
from fapengine.errors import ResourceError, UsageError
from fapengine.files.paths import refuse_standard_output, replacing, replacing_folder
from fapengine.files.pictures import save_png
from fapengine.files.video import ALPHA_KINDS, CODECS, FORMATS, write_video

if TYPE_CHECKING:
    import av
    import av.filter
else:
    av = Late("av", "av", "animations")

Picture = NDArray[np.uint8]

ENCODERS = {".gif": "gif", ".webp": "libwebp_anim"}
"""FFmpeg's encoder by suffix."""
GIF_MAX_HZ = 50.0
"""GIF counts hundredths of a second, and viewers slow down frames shorter than two of them."""
PALETTE_FRAMES = 100
"""Number of frames for choosing a GIF's colours: few enough to hold, enough to include an open mouth."""
WEBP_OPTIONS = {"quality": "80", "compression_level": "2"}
NUMBER = re.compile(r"%(?:0[1-9])?d")


def write_animation(
    path: Path, frames: Iterable[Picture], *, rate_hz: float, on_frame: Callable[[], None] = lambda: None
) -> int:
    """Write an animation that loops.

    Parameters
    ----------
    path : Path
        ``.gif`` (256 colours, one palette for all frames to avoid flicker) or ``.webp`` (all colours, a quarter of the
        size).
    frames, rate_hz, on_frame
        See :func:`fapengine.files.video.write_video`; at most 50 Hz for GIF, and alpha for ``.webp`` only.

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    UsageError
        For an unknown suffix, a rate or alpha that GIF does not support, or no frame.
    ResourceError
        If the file cannot be written.
    """
    if path.suffix not in ENCODERS:
        raise UsageError(f"animation: got {path.name}, expected a name that ends with {' or '.join(ENCODERS)}")
    if path.suffix == ".gif" and rate_hz > GIF_MAX_HZ:
        raise UsageError(f"GIF: got {rate_hz:g} Hz, expected at most {GIF_MAX_HZ:g}; .webp has no such limit")
    pictures = iter(frames)
    start = list(itertools.islice(pictures, PALETTE_FRAMES if path.suffix == ".gif" else 1))
    if start and start[0].shape[2] == 4 and path.suffix == ".gif":
        raise UsageError(f"{path.name}: got pictures with alpha, but .gif holds none; expected .webp")
    if not start:
        raise UsageError(f"{path.name}: got no frame, expected one or more")
    rate = Fraction(rate_hz).limit_denominator(1001)
    count = 0
    try:
        with replacing(path) as new, av.open(str(new), "w", options={"loop": "0"}) as container:
            stream: Any = container.add_stream(ENCODERS[path.suffix], rate=rate)
            stream.height, stream.width = start[0].shape[:2]
            stream.pix_fmt = "pal8" if path.suffix == ".gif" else {3: "yuv420p", 4: "yuva420p"}[start[0].shape[2]]
            stream.options = {} if path.suffix == ".gif" else WEBP_OPTIONS
            shown = _timed(itertools.chain(start, pictures), rate)
            for frame in _in_palette(shown, _palette(start), rate) if path.suffix == ".gif" else shown:
                container.mux(stream.encode(frame))
                count += 1
                on_frame()
            container.mux(stream.encode(None))
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error
    return count


def is_sequence(path: Path) -> bool:
    """Whether a name is a pattern for numbered files, such as ``frame_%04d.png``."""
    return "%" in path.name


def write_sequence(pattern: Path, frames: Iterable[Picture], *, on_frame: Callable[[], None] = lambda: None) -> int:
    """Write each frame to a separate PNG file, numbered from 0.

    Parameters
    ----------
    pattern : Path
        With one ``%d`` or ``%04d`` in its name, as in FFmpeg and other programs.
    frames, on_frame
        See :func:`fapengine.files.video.write_video`; alpha is kept.

    Returns
    -------
    int
        Number of files written. They replace existing files together at the end; files of an earlier run with higher
        numbers are removed.

    Raises
    ------
    UsageError
        If the name is not such a pattern.
    ResourceError
        If a file cannot be written.
    """
    rest, numbers = NUMBER.subn("", pattern.name)
    if numbers != 1 or "%" in rest or pattern.suffix != ".png":
        raise UsageError(f"frames: got {pattern.name}, expected one number in a PNG's name, as frame_%04d.png")
    with replacing_folder(pattern.parent, owned=[NUMBER.sub("[0-9]*", pattern.name)]) as folder:
        count = 0
        for picture in frames:
            save_png(folder / (pattern.name % count), picture)
            count += 1
            on_frame()
    return count


def sequence_files(pattern: Path) -> list[Path]:
    """Existing numbered files, in order."""
    spelled = re.compile(re.escape(NUMBER.sub("\0", pattern.name)).replace("\0", r"\d+"))
    found = [path for path in pattern.parent.glob("*") if spelled.fullmatch(path.name)]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def _timed(pictures: Iterable[Picture], rate: Fraction) -> Iterator[av.VideoFrame]:
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(picture, format=FORMATS[picture.shape[2]])
        frame.pts, frame.time_base = number, 1 / rate
        yield frame


def _source(graph: av.filter.Graph, frame: av.VideoFrame, rate: Fraction) -> av.filter.context.FilterContext:
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
    for frame in frames:
        source.push(frame)
    source.push(None)
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


def _pulled(sink: av.filter.context.FilterContext) -> Iterator[av.VideoFrame]:
    while True:
        try:
            frame = sink.pull()
        except (av.BlockingIOError, av.EOFError):
            return
        assert isinstance(frame, av.VideoFrame)
        frame.pict_type = 0  # the encoder decides of which type a frame is
        yield frame


FOLDER_PATTERN = "frame_%04d.png"
KINDS = f"{', '.join((*CODECS, *ENCODERS))}, a pattern as frame_%04d.png, or a folder's"
"""Supported names, as text."""


def is_folder(path: Path) -> bool:
    """Whether a name is a folder for an image sequence: it has no suffix."""
    return not path.suffix and not is_sequence(path)


def is_moving(path: Path) -> bool:
    """Whether :func:`write_moving` supports a name."""
    return path.suffix in CODECS or path.suffix in ENCODERS or is_sequence(path) or is_folder(path)


def check_moving(path: Path, *, rate_hz: float, size: tuple[int, int], alpha: bool) -> None:
    """Reject options that a format does not support, before anything is drawn.

    Raises
    ------
    UsageError
        For an unknown suffix, a rate too high for GIF, odd sides of a video, or alpha where it is not supported.
    ResourceError
        If a library for writing is not installed.
    """
    refuse_standard_output(path)
    if not is_moving(path):
        raise UsageError(f"path: got {path}, expected a name that ends with {KINDS}")
    if path.suffix == ".gif" and rate_hz > GIF_MAX_HZ:
        raise UsageError(f"GIF: got {rate_hz:g} Hz, expected at most {GIF_MAX_HZ:g}; .webp has no such limit")
    if path.suffix in CODECS and any(side % 2 for side in size):
        raise UsageError(f"size: got {size[0]}x{size[1]}, expected even sides for video")
    if alpha and (path.suffix == ".gif" or (path.suffix in CODECS and path.suffix not in ALPHA_KINDS)):
        raise UsageError(f"background: got none, but {path.suffix} has no alpha; expected .webm, .mov, .webp or .png")
    require("films and pictures", av="av", PIL="pillow")


def write_moving(
    path: Path,
    frames: Iterable[Picture],
    *,
    rate_hz: float,
    sound: tuple[NDArray[np.int16], int] | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> int:
    """Write frames in the format that the name asks for: a video, an animation, or numbered files.

    Parameters
    ----------
    path : Path
        A folder gets ``frame_0000.png`` and so on. Only videos have sound.
    frames, rate_hz, sound, on_frame
        Images (height, width, 3 or 4) uint8; the rest as for :func:`fapengine.files.video.write_video`.

    Returns
    -------
    int
        Number of frames written.
    """
    if path.suffix in CODECS:
        return write_video(path, frames, rate_hz=rate_hz, sound=sound, on_frame=on_frame)
    if path.suffix in ENCODERS:
        return write_animation(path, frames, rate_hz=rate_hz, on_frame=on_frame)
    pattern = path if is_sequence(path) else path / FOLDER_PATTERN
    return write_sequence(pattern, frames, on_frame=on_frame)


def moving_files(path: Path) -> list[Path]:
    """Names that :func:`write_moving` writes; a pattern means all files of a sequence."""
    return [path / FOLDER_PATTERN if is_folder(path) else path]


def beside(path: Path, suffix: str) -> Path:
    """Name of a file that accompanies a video: ``talk.mp4`` has ``talk.wav``, and so has the folder ``talk``.

    For numbered files it is next to their folder.
    """
    owner = path.parent if is_sequence(path) and path.parent.name else path
    return path.with_name("frames" + suffix) if is_sequence(owner) else owner.with_name(owner.stem + suffix)
