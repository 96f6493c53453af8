"""Video files: frames and audio through PyAV, whose wheel includes FFmpeg; frames of a camera.

Input is untrusted, so FFmpeg gets a file that is already open, no protocol to open another, and only containers that
name no further files.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError, TruncatedError, UsageError
from fapengine.files.paths import open_file, replacing
from fapengine.files.provenance import check_signable, mark, mark_film

if TYPE_CHECKING:
    import av as av
else:
    av = Late("av", "av", "video and sound files")

FILMS = frozenset(
    {".mp4", ".m4v", ".mov", ".webm", ".mkv", ".avi", ".mpg", ".mpeg", ".ts", ".flv", ".wmv", ".ogv", ".gif"}
)
"""Endings of videos."""
CONTAINERS = {"format_whitelist": "mov,matroska,avi,mpegts,mpeg,flv,asf,ogg,gif", "protocol_whitelist": "none"}
"""FFmpeg options that allow self-contained videos only."""
MAX_PIXELS = 8192 * 4608
"""Largest frame that is decoded."""
SAMPLES = {b"stsz": 16, b"trun": 12}
"""Boxes of MP4 that state a number of samples, and where."""
BOXES = frozenset({b"moov", b"trak", b"mdia", b"minf", b"stbl", b"moof", b"traf"})
"""Boxes of MP4 that hold those."""
MAX_BOXES = 100_000
"""Boxes that are looked at."""
TAGGED = (".webm", ".mkv")
"""Matroska: tags, and no place for XMP."""
SOUND_RATE_HZ = 48000
"""Audio sample rate that both AAC and Opus support."""

Picture = NDArray[np.uint8]
Packet: TypeAlias = "av.Packet[Any]"


def check_samples(file: BinaryIO, path: Path) -> None:
    """Reject an empty file, and an MP4 that states more samples than bytes: FFmpeg allocates 24 or more for each.

    Raises
    ------
    DataError
        If the file is empty, or a table of samples is a lie; TruncatedError if an MP4 ends before its index does.
    """
    ends = [file.seek(0, os.SEEK_END)]
    if not ends[0]:
        raise DataError("the file is empty", where=str(path))
    size, at, whole = ends[0], 0, set[bytes]()
    for _ in range(MAX_BOXES):
        file.seek(at)
        head = file.read(20)
        length, kind, body = int.from_bytes(head[:4], "big"), head[4:8], 8
        if length == 1:
            length, body = int.from_bytes(head[8:16], "big"), 16
        if at + length <= size:
            whole.add(kind)
        if kind in SAMPLES and int.from_bytes(head[SAMPLES[kind] :][:4], "big") > size:
            raise DataError(f"{path}: states more samples than it has bytes")
        if kind in BOXES and body <= length:
            ends.append(min(at + length, ends[-1]))
            at += body
        else:
            at = min(at + length, ends[-1]) if length >= body else ends[-1]
        while at >= ends[-1]:
            if not ends.pop() or not ends:
                file.seek(0)
                if b"ftyp" in whole and b"moov" not in whole:
                    raise TruncatedError(f"{path}: its index, moov, is not complete: cut off, or never closed")
                return
    file.seek(0)


def reason(error: Exception) -> str:
    """Return an error's text, without the file name that PyAV adds."""
    return str(getattr(error, "strerror", None) or error)


@contextmanager
def reading(path: Path, purpose: str) -> Iterator[Any]:
    """Open an untrusted video as a PyAV container.

    ``purpose`` completes the message "cannot be ...", e.g. ``"decoded as video"``.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it cannot be opened, and for errors of FFmpeg inside the block.
    """
    try:
        with open_file(path) as file:
            check_samples(file, path)
            with av.open(file, mode="r", options=CONTAINERS) as container:
                yield container
    except (DataError, UsageError):
        raise
    except (av.FFmpegError, ValueError, OSError) as error:
        raise DataError(f"{path}: cannot be {purpose} ({reason(error)})") from error


@contextmanager
def writing(
    path: Path, options: dict[str, str], file_format: str | None = None, *, source: str | None = None
) -> Iterator[Any]:
    """Open a PyAV container that replaces a file when it is complete; ``options`` are those of the muxer.

    With a ``source``, a term of :mod:`fapengine.files.provenance`, the file says where its images come from.

    Raises
    ------
    ResourceError
        If it cannot be written, and for errors of FFmpeg inside the block.
    """
    if source:
        check_signable(path)
    if path.suffix.lower() == ".webp":  # in a folder such as a%d FFmpeg would take it for a numbered image
        file_format = "webp"
    try:
        with replacing(path) as new:
            with av.open(str(new), "w", format=file_format, options=options) as container:
                if source and path.suffix in TAGGED:
                    container.metadata.update(mark(source))
                yield container
            if source:
                mark_film(new, path.suffix, source)
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(f"{path}: cannot be written ({reason(error)})") from error


def mux(
    container: Any, packets: Iterator[Packet], codec: str | None, sound: tuple[NDArray[np.int16], int] | None
) -> None:
    """Write the packets of a visual stream, and audio from time 0, interleaved so that neither waits in memory.

    ``sound`` is (N,) mono samples and their rate, ``codec`` its encoder; without a codec there is no audio.
    """
    streams = [packets]
    if sound and codec:
        streams.append(_encoded_audio(container.add_stream(codec, rate=SOUND_RATE_HZ, layout="mono"), *sound))
    for packet in heapq.merge(*streams, key=lambda packet: (packet.dts or 0) * packet.time_base):
        container.mux(packet)


def _encoded_audio(stream: av.AudioStream, samples: NDArray[np.int16], rate_hz: int) -> Iterator[Packet]:
    """Encode mono samples, (N,), one second at a time."""
    resampler = av.AudioResampler(format=stream.format, layout="mono", rate=SOUND_RATE_HZ, frame_size=stream.frame_size)
    for start in range(0, len(samples), rate_hz):
        second = np.ascontiguousarray(samples[start : start + rate_hz]).reshape(1, -1)
        whole = av.AudioFrame.from_ndarray(second, format="s16", layout="mono")
        whole.sample_rate, whole.pts, whole.time_base = rate_hz, start, Fraction(1, rate_hz)
        for piece in resampler.resample(whole):
            yield from stream.encode(piece)
    for piece in resampler.resample(None):
        yield from stream.encode(piece)
    yield from stream.encode(None)


@dataclass(frozen=True, slots=True)
class FilmInfo:
    """Image properties that a file states, before decoding."""

    width: int
    height: int
    rate_hz: float
    """Frame rate; 0 if missing."""
    codec: str
    has_sound: bool
    frames: int
    """Number of frames; 0 if missing."""


def inspect_film(path: Path) -> FilmInfo | None:
    """Read the image properties of a video without decoding; None if it has no images, or cannot be opened."""
    try:
        with reading(path, "opened") as container:
            if not (streams := decodable(container)):
                return None
            stream, has_sound = streams[0], bool(container.streams.audio)
            rate_hz = float(stream.average_rate or 0)
            return FilmInfo(stream.width, stream.height, rate_hz, stream.codec.name, has_sound, stream.frames)
    except (DataError, UsageError):
        return None


ATTACHED_PICTURE = 0x400
"""FFmpeg's mark of a cover."""


def decodable(container: Any) -> list[Any]:
    """Streams of moving images whose codec FFmpeg has; the others lack most attributes, or are covers of sound."""
    return [
        stream
        for stream in container.streams.video
        if stream.codec_context is not None and not getattr(stream, "disposition", 0) & ATTACHED_PICTURE
    ]


def count_pictures(path: Path) -> int:
    """Return the number of frames that a video states; 0 if missing, or if it cannot be read."""
    film = inspect_film(path)
    return film.frames if film else 0


def stream_pictures(path: Path, *, max_side: int) -> Iterator[tuple[float, Picture]]:
    """Decode the frames of a video one by one.

    Parameters
    ----------
    path : Path
    max_side : int
        Longer side of the images, pixels; larger ones are scaled down.

    Yields
    ------
    time_s : float
        Rising.
    picture : (height, width, 3) uint8
        sRGB, all of one size.

    Raises
    ------
    DataError
        If the file cannot be read, contains no images or is damaged.
    """
    with reading(path, "decoded as video") as container:
        if not (streams := decodable(container)):
            raise DataError(f"{path}: contains no image")
        if streams[0].width * streams[0].height > MAX_PIXELS:
            got = f"{streams[0].width}x{streams[0].height} pixels"
            raise DataError(f"{path}: got {got}, expected at most {MAX_PIXELS} in all")
        size = _fitted(streams[0], max_side)
        last_s = -np.inf
        for frame in container.decode(streams[0]):
            time_s = float(frame.time or 0.0)
            if time_s > last_s:  # a damaged file may repeat a time
                last_s = time_s
                yield time_s, _scaled(frame, size)


def camera_pictures(number: int, *, seconds: float, max_side: int = 640) -> Iterator[tuple[float, Picture]]:
    """Capture images from a camera of this machine (Video4Linux) for ``seconds``: time in s and (H, W, 3) sRGB.

    Larger ones are scaled down to a longer side of ``max_side`` pixels.

    Raises
    ------
    ResourceError
        If there is no such camera, or it delivers no images.
    """
    device = f"/dev/video{number}"
    try:
        with av.open(device, mode="r", format="v4l2") as container:
            first_s: float | None = None
            for frame in container.decode(video=0):
                time_s = float(frame.time or 0.0)
                first_s = time_s if first_s is None else first_s
                if time_s - first_s >= seconds:
                    return
                yield time_s - first_s, _scaled(frame, _fitted(frame, max_side))
    except (av.FFmpegError, ValueError, OSError) as error:
        raise ResourceError(f"camera: {device} gives no image ({reason(error)})") from error


def _fitted(source: Any, max_side: int) -> tuple[int, int]:
    """Width and height of a stream or frame, scaled down to a longer side of ``max_side``."""
    scale = min(max_side / max(source.width, source.height, 1), 1.0)
    return max(round(source.width * scale), 1), max(round(source.height * scale), 1)


def _scaled(frame: av.VideoFrame, size: tuple[int, int]) -> Picture:
    return frame.reformat(*size, "rgb24").to_ndarray().astype(np.uint8)
