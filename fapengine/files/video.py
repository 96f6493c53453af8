"""Video files with sound, through PyAV (FFmpeg inside the wheel)."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.paths import replacing

if TYPE_CHECKING:
    import av
else:
    av = Late("av", "av", "video and sound files")


CODECS = {
    ".mp4": ("libx264", "aac"), ".webm": ("libvpx-vp9", "libopus"), ".mkv": ("libx264", "aac"),
    ".mov": ("prores_ks", "pcm_s16le"),
}  # fmt: skip
"""Video and sound codec by suffix."""
STRANGERS = {"format_whitelist": "mov,matroska,avi,mpegts,mpeg,flv,asf,ogg,gif", "protocol_whitelist": "none"}
"""Options for untrusted videos: containers that name no further files, and no protocol to open one."""
FILMS = frozenset(
    {".mp4", ".m4v", ".mov", ".webm", ".mkv", ".avi", ".mpg", ".mpeg", ".ts", ".flv", ".wmv", ".ogv", ".gif"}
)
"""Endings of videos."""
ALPHA_KINDS = (".webm", ".mov")
FORMATS = {3: "rgb24", 4: "rgba"}
"""FFmpeg's pixel format by number of components."""
X264_OPTIONS = {"preset": "veryfast", "crf": "20", "tune": "animation"}
VP9_OPTIONS = {"deadline": "realtime", "cpu-used": "8", "crf": "32", "b": "0", "row-mt": "1"}
PRORES_OPTIONS = {"profile": "4444", "vendor": "apl0", "alpha_bits": "16"}
"""ProRes 4444, which editors read with its alpha; some check the vendor."""
OPTIONS = {"libx264": X264_OPTIONS, "libvpx-vp9": VP9_OPTIONS, "prores_ks": PRORES_OPTIONS}
PIXELS = {"prores_ks": ("yuv444p10le", "yuva444p10le")}
"""Pixel formats without and with alpha, where they differ from :data:`USUAL_PIXELS`."""
USUAL_PIXELS = ("yuv420p", "yuva420p")
MUXER_OPTIONS = {".mp4": {"movflags": "faststart"}}
"""Puts the index of an MP4 first, so that a browser plays it while it loads."""
SOUND_RATE_HZ = 48000
"""Supported by both AAC and Opus."""

Picture = NDArray[np.uint8]
Packet: TypeAlias = "av.Packet[Any]"


def write_video(
    path: Path,
    frames: Iterable[Picture],
    *,
    rate_hz: float,
    sound: tuple[NDArray[np.int16], int] | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> int:
    """Encode frames, and sound from time 0, into one file.

    Parameters
    ----------
    path : Path
        ``.mp4``, ``.webm``, ``.mkv`` or ``.mov`` (ProRes 4444).
    frames : iterable of (height, width, 3) uint8
        sRGB; all of one size, with even sides. A fourth component is straight alpha, for ``.webm`` and ``.mov``.
    rate_hz : float
        Frame rate.
    sound : ((N,) int16, int), optional
        Mono samples and their rate.
    on_frame : callable
        Called after each frame, for progress.

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    UsageError
        For an unknown suffix, odd sides, or alpha that the format does not support.
    ResourceError
        If the file cannot be written or a codec is missing.
    """
    if path.suffix not in CODECS:
        raise UsageError(f"video: got {path.name}, expected a name that ends with {', '.join(CODECS)}")
    video_codec, sound_codec = CODECS[path.suffix]
    count = 0

    def encoded() -> None:
        nonlocal count
        count += 1
        on_frame()

    try:
        with replacing(path) as new, av.open(str(new), "w", options=MUXER_OPTIONS.get(path.suffix, {})) as container:
            stream: Any = container.add_stream(video_codec, rate=Fraction(rate_hz).limit_denominator(1001))
            stream.options = OPTIONS[video_codec]
            stream.codec_context.thread_count = 0
            packets = [_encoded_pictures(stream, frames, path, encoded)]
            if sound:
                voice: Any = container.add_stream(sound_codec, rate=SOUND_RATE_HZ, layout="mono")
                packets.append(encoded_sound(voice, *sound))
            # Side by side in the file, so that neither waits in memory for the other.
            for packet in heapq.merge(*packets, key=time_of):
                container.mux(packet)
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error
    return count


def time_of(packet: Packet) -> Fraction:
    """Return the decoding time of a packet, s."""
    return (packet.dts or 0) * packet.time_base


def _encoded_pictures(
    stream: Any, frames: Iterable[Picture], path: Path, on_frame: Callable[[], None]
) -> Iterator[Packet]:
    """Encode images; the first one sets size and format of the stream."""
    for number, picture in enumerate(frames):
        if not number:
            _take_form(stream, picture, path)
        yield from stream.encode(av.VideoFrame.from_ndarray(picture, format=FORMATS[picture.shape[2]]))
        on_frame()
    yield from stream.encode(None)


def _take_form(stream: Any, picture: Picture, path: Path) -> None:
    """Configure a stream for images of this size and number of components."""
    stream.height, stream.width, components = picture.shape
    if stream.height % 2 or stream.width % 2:
        raise UsageError(f"size: got {stream.width}x{stream.height}, expected even sides for video")
    if components == 4 and path.suffix not in ALPHA_KINDS:
        raise UsageError(f"video: got pictures with alpha, but {path.suffix} holds none; expected .webm or .mov")
    stream.pix_fmt = PIXELS.get(stream.codec_context.name, USUAL_PIXELS)[components == 4]
    if components == 4 and path.suffix == ".webm":
        stream.metadata["alpha_mode"] = "1"  # players look there
        stream.options = {**stream.options, "auto-alt-ref": "0"}  # libvpx refuses both together


def encoded_sound(stream: av.AudioStream, samples: NDArray[np.int16], rate_hz: int) -> Iterator[Packet]:
    """Encode mono samples, (N,) int16, second by second."""
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


def inspect_film(path: Path) -> FilmInfo | None:
    """Read the image properties of a video without decoding; None if it has no images, or cannot be opened."""
    try:
        with path.open("rb") as file, av.open(file, mode="r", options=STRANGERS) as container:
            if not container.streams.video:
                return None
            stream = container.streams.video[0]
            rate_hz = float(stream.average_rate or 0)
            return FilmInfo(stream.width, stream.height, rate_hz, stream.codec.name, bool(container.streams.audio))
    except (av.FFmpegError, ValueError, OSError):
        return None


def count_pictures(path: Path) -> int:
    """Return the number of frames that a video states; 0 if missing, or if it cannot be read."""
    try:
        with path.open("rb") as file, av.open(file, mode="r", options=STRANGERS) as container:
            return container.streams.video[0].frames if container.streams.video else 0
    except (av.FFmpegError, ValueError, OSError):
        return 0


def stream_pictures(path: Path, *, max_side: int) -> Iterator[tuple[float, NDArray[np.uint8]]]:
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
    UsageError
        If the file cannot be read.
    DataError
        If it contains no images or is damaged.
    """
    try:
        with path.open("rb") as file, av.open(file, mode="r", options=STRANGERS) as container:
            if not container.streams.video:
                raise DataError(f"{path}: holds no picture")
            stream = container.streams.video[0]
            scale = min(max_side / max(stream.width, stream.height, 1), 1.0)
            width, height = max(round(stream.width * scale), 1), max(round(stream.height * scale), 1)
            last_s = -np.inf
            for frame in container.decode(video=0):
                time_s = float(frame.time or 0.0)
                if time_s > last_s:  # a film of one time only cannot be told in order
                    last_s = time_s
                    picture: NDArray[np.uint8] = frame.reformat(width, height, "rgb24").to_ndarray().astype(np.uint8)
                    yield time_s, picture
    except (av.FFmpegError, ValueError, OSError) as error:
        if isinstance(error, DataError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise DataError(f"{path}: cannot be decoded as video ({reason})") from error


def camera_pictures(number: int, *, seconds: float, max_side: int = 640) -> Iterator[tuple[float, NDArray[np.uint8]]]:
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
                scale = min(max_side / max(frame.width, frame.height, 1), 1.0)
                width, height = max(round(frame.width * scale), 1), max(round(frame.height * scale), 1)
                yield time_s - first_s, frame.reformat(width, height, "rgb24").to_ndarray().astype(np.uint8)
    except (av.FFmpegError, ValueError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ResourceError(f"camera: {device} gives no picture ({reason})") from error


@dataclass(frozen=True, slots=True, eq=False)
class Video:
    """A decoded video."""

    frames: NDArray[np.uint8]
    """(T, height, width, 3) uint8, sRGB."""
    rate_hz: float
    duration_s: float
    """Duration of the images, s."""
    sound_duration_s: float
    """0 without sound."""


def load_video(path: Path) -> Video:
    """Decode a whole, short video.

    Raises
    ------
    DataError
        If it cannot be decoded or contains no images.
    """
    try:
        with av.open(str(path), mode="r") as container:
            if not container.streams.video:
                raise DataError(f"{path}: holds no picture")
            rate_hz = float(container.streams.video[0].average_rate or 0)
            frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        sound_s = 0.0
        with av.open(str(path), mode="r") as container:
            if container.streams.audio:
                sound_s = sum(frame.samples / frame.sample_rate for frame in container.decode(audio=0))
    except (av.FFmpegError, OSError) as error:
        raise DataError(f"{path}: cannot be decoded as video ({error.strerror or error})") from error
    return Video(np.stack(frames), rate_hz, len(frames) / rate_hz, sound_s)
