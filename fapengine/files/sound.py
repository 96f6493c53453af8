"""Audio files: reads the containers of :data:`CONTAINERS`, completely or in pieces, and writes WAV.

Input is untrusted, so FFmpeg gets a file that is already open, no protocol to open another, and only these containers:
some of the others are lists of further files and addresses.
"""

import io
import logging
import os
import struct
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from errno import EINVAL
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import open_file, replacing
from fapengine.files.video import check_samples, reason

if TYPE_CHECKING:
    import av
else:
    av = Late("av", "av", "sound files other than WAV")

CONTAINERS = (
    "wav", "w64", "flac", "mp3", "ogg", "mov", "matroska", "aac", "aiff", "caf", "au", "avi", "asf", "mpegts", "mpeg",
    "flv", "amr", "ac3", "eac3",
)  # fmt: skip
"""FFmpeg's names of the containers that are read: self-contained audio and video."""
COUNTED = ("flac", "aiff", "au", "mov,mp4,m4a,3gp,3g2,mj2")
"""Containers that state the length of their sound."""
SOUND_SUFFIXES = frozenset({
    ".wav", ".wave", ".w64", ".flac", ".mp3", ".ogg", ".oga", ".opus", ".m4a", ".aac", ".aif", ".aiff", ".caf", ".au",
    ".wma", ".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi",
})  # fmt: skip
"""Endings that mean audio or video where phone timings or motion are possible, too."""
RECORDED = (".c3d", ".mat")
"""Endings of recordings of positions that may contain sound."""
MAX_RATE_HZ = 48_000
"""Highest sample rate of a file that is read completely; higher ones are resampled."""
RATES_HZ = (1_000, 768_000)
"""Lowest and highest sample rate of a file."""
MAX_S = 86_400.0
"""One day: longer files are mistakes or attacks."""
WAV_MARK = struct.pack("<4sI4s4sI10s", b"LIST", 22, b"INFO", b"ISFT", 10, b"fapengine")
"""Chunk that names the software, in front of the samples: RIFF's INFO list."""
SHORT_S, MIN_BYTES_PER_S = 300.0, 100.0
"""Least bytes per second of a file with more sound than :data:`SHORT_S`: an hour of silence in FLAC takes 45 kB."""
LONG_VARIABLE = "FAPENGINE_LONG"
"""Environment variable that allows any length up to :data:`MAX_S`."""
MARGIN_S = 60.0
"""Length of sound that is read beyond the motion or the timings that it belongs to."""
CHUNKED = {  # bytes before the first chunk, of a chunk's name, of its size; order; alignment; head in the size
    b"RIFF": (12, 4, 4, "little", 2, 0),
    b"riff": (40, 16, 8, "little", 8, 24),  # Sony's Wave64
    b"caff": (8, 4, 8, "big", 1, 0),
}
"""Containers of chunks, by their first bytes. FFmpeg tells the length of the bytes that they have."""
OGG_TAIL_BYTES = 1 << 17
"""Bytes in which Ogg's last page is sought, which has up to 65,307."""
SHORTER_S = 0.1
"""Difference to the stated length from which the rest of a file is missing; codecs pad by less."""
UNKNOWN_BYTES = 0x7FFF0000
"""Sizes of a chunk from here on mean that the program did not know it."""
WRITTEN_AT_ONCE = 1 << 20
"""Samples written at a time."""
log = logging.getLogger("fapengine.sound")
_FULL_SCALE = {"u1": 128.0, "i2": 2.0**15, "i4": 2.0**31, "i8": 2.0**63, "f4": 1.0, "f8": 1.0}


@dataclass(frozen=True, slots=True)
class SoundInfo:
    """Audio properties that a file states, before decoding."""

    sample_rate_hz: int
    channels: int
    duration_s: float
    """Length stated by the file; 0 if missing."""


def inspect_sound(path: Path) -> SoundInfo:
    """Read the audio properties of a file without decoding it. Raises as :func:`stream_sound`."""
    with _opened(path) as (container, _, _):
        stream = container.streams.audio[0]
        stated = stream.duration * stream.time_base if stream.duration and stream.time_base else 0
        duration_s = float(stated or (container.duration or 0) / 1e6)
        return SoundInfo(stream.rate, stream.channels, max(duration_s, 0.0))


def stream_sound(
    path: Path,
    *,
    rate_hz: int | None = None,
    channel: int | None = None,
    remark: Callable[[str], object] = log.warning,
) -> Generator[NDArray[np.int16]]:
    """Decode a file in pieces, so that memory does not grow with its length.

    Parameters
    ----------
    path : Path
    rate_hz : int, optional
        Rate of the pieces; by default the file's own.
    channel : int, optional
        Channel to read, 1 for the first; by default the mean of all.
    remark : callable
        Called with a sentence if a file ends before the length that it states, or within a frame.

    Yields
    ------
    (N,) int16
        Mono.

    Raises
    ------
    UsageError
        If the file cannot be read or has no such channel.
    DataError
        If its container is not supported, or it contains no audio, is damaged, or is longer than its size explains.
    """
    with _opened(path) as (container, stated_s, is_cut):
        stream = container.streams.audio[0]
        if channel is not None and not 1 <= channel <= stream.channels:
            raise UsageError(f"channel: got {channel}, expected 1 to {stream.channels}, the channels of {path}")
        most_s = MAX_S if os.environ.get(LONG_VARIABLE) else max(SHORT_S, path.stat().st_size / MIN_BYTES_PER_S)
        source_hz, target_hz = stream.rate, rate_hz or stream.rate
        resampler = None
        if target_hz != source_hz:
            resampler = av.AudioResampler(format="s16", layout="mono", rate=target_hz)
        decoded = 0
        try:
            for frame in container.decode(audio=0):
                if frame.sample_rate != source_hz:
                    raise DataError(
                        f"{path}: got {frame.sample_rate} Hz after {source_hz} Hz, expected one rate",
                        where=f"{decoded / source_hz:.2f} s",
                    )
                decoded += frame.samples
                if decoded > MAX_S * source_hz:
                    raise DataError(f"{path}: got more than {MAX_S:g} s of sound, expected at most a day")
                if decoded > most_s * source_hz:
                    raise DataError(
                        f"{path}: got more than {most_s:.0f} s of sound in {path.stat().st_size} bytes, expected"
                        f" {MIN_BYTES_PER_S:g} bytes or more for a second; {LONG_VARIABLE}=1 reads it"
                    )
                mono = _mono(frame, channel, path)
                if resampler is None:
                    yield np.clip(np.rint(mono.astype(np.float64) * 2**15), -(2**15), 2**15 - 1).astype(np.int16)
                else:
                    piece = av.AudioFrame.from_ndarray(mono.reshape(1, -1), format="flt", layout="mono")
                    piece.sample_rate = source_hz
                    yield from _samples(resampler.resample(piece))
        except DataError:
            raise
        except (av.FFmpegError, ValueError, MemoryError) as error:
            where = f"{decoded / source_hz:.2f} s"
            if not decoded or _goes_on(container):
                raise DataError(f"{path}: cannot be decoded as sound ({reason(error)})", where=where) from error
            is_cut = True
        if resampler is not None:
            yield from _samples(resampler.resample(None))
        if is_cut or decoded / source_hz < stated_s - SHORTER_S:
            stated = f" of the {stated_s:.2f} s that it states" if stated_s else ""
            remark(f"{path}: has {decoded / source_hz:.2f} s{stated}: damaged or cut off")


def _goes_on(container: Any) -> bool:
    """Whether there is sound after damage."""
    try:
        return next(container.decode(audio=0), None) is not None
    except (av.FFmpegError, ValueError, MemoryError):
        return True


def load_sound(
    path: Path,
    *,
    rate_hz: int | None = None,
    channel: int | None = None,
    spoken_s: float | None = None,
    remark: Callable[[str], object] = log.warning,
) -> tuple[NDArray[np.int16], int]:
    """Read an audio file.

    Parameters
    ----------
    path : Path
    rate_hz : int, optional
        Rate to resample to; by default the file's own, up to :data:`MAX_RATE_HZ`.
    channel : int, optional
        Channel to read, 1 for the first; by default the mean of all.
    spoken_s : float, optional
        Length of the timings or the motion: sound is read up to :data:`MARGIN_S` later. By default all is read.
    remark : callable
        Called with a sentence if there is more sound, or less than the file states.

    Returns
    -------
    samples : (N,) int16
        Mono.
    sample_rate_hz : int

    Raises
    ------
    UsageError
        If the file cannot be read or has no such channel.
    DataError
        If it contains no audio, or is damaged.
    """
    rate_hz = rate_hz or min(inspect_sound(path).sample_rate_hz, MAX_RATE_HZ)
    gathered = bytearray()  # grows in place: an hour of audio is held once, not twice
    most = None if spoken_s is None else round((spoken_s + MARGIN_S) * rate_hz)
    with closing(stream_sound(path, rate_hz=rate_hz, channel=channel, remark=remark)) as pieces:
        for piece in pieces:
            gathered += piece.data
            if most is not None and len(gathered) > 2 * most:
                del gathered[2 * most :]
                remark(
                    f"{path}: only the first {most / rate_hz:.0f} s were read, as the speech ends at {spoken_s:.2f} s"
                )
                break
    samples = np.frombuffer(gathered, np.int16)
    if not len(samples):
        raise DataError(f"{path}: holds no sound")
    return samples, rate_hz


def save_wav(path: Path, samples: NDArray[np.int16], sample_rate_hz: int) -> None:
    """Write mono samples, (N,) int16, as a WAV file that names fapengine as its software.

    Raises
    ------
    ResourceError
        If the file cannot be written.
    """
    with replacing(path) as new, new.open("wb") as out:
        _write_wav(out, samples, sample_rate_hz)


def _write_wav(out: BinaryIO, samples: NDArray[np.int16], sample_rate_hz: int) -> None:
    size = 2 * len(samples)
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, 1, sample_rate_hz, 2 * sample_rate_hz, 2, 16)
    out.write(struct.pack("<4sI4s", b"RIFF", 36 + size + len(WAV_MARK), b"WAVE") + form + WAV_MARK)
    out.write(struct.pack("<4sI", b"data", size))
    for start in range(0, len(samples), WRITTEN_AT_ONCE):
        out.write(samples[start : start + WRITTEN_AT_ONCE].astype("<i2").tobytes())


def _recorded(path: Path) -> BinaryIO:
    """The sound in a recording of positions, as a WAV file in memory."""
    from fapengine.files.recordings import load_recorded_sound  # late: sound files do not need it

    sound = load_recorded_sound(path)
    if sound is None:
        raise DataError(f"{path}: holds no sound")
    file = io.BytesIO()
    _write_wav(file, sound.samples, sound.rate_hz)
    file.seek(0)
    return file


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, float, bool]]:
    """Open a container with decodable audio; it is closed at the end.

    Also its stated length in s, 0 if missing, and whether its end is missing.
    """
    with _recorded(path) if path.suffix.lower() in RECORDED else open_file(path) as whole:
        file = _untagged(whole)
        check_samples(file, path)
        chunks_s, is_counted, has_end = _chunks_s(file), _is_counted(file), _has_end(file)
        file.seek(0)
        try:
            options = {"format_whitelist": ",".join(CONTAINERS), "protocol_whitelist": "none"}
            container = av.open(file, mode="r", options=options, **_any_metadata())
        except (av.FFmpegError, ValueError, OSError) as error:
            is_refused = getattr(error, "errno", None) == EINVAL  # by the list of containers
            why = "a kind of file that is not read here" if is_refused else reason(error)
            raise DataError(
                f"{path}: cannot be decoded as sound ({why}); expected WAV, FLAC, MP3, Ogg, M4A or a video"
            ) from error
        with container:
            _check(container, path)
            stream, name = container.streams.audio[0], container.format.name
            if chunks_s:
                stated_s = chunks_s
            elif name in COUNTED or (name == "mp3" and is_counted):
                stated_s = float(stream.duration * stream.time_base) if stream.duration and stream.time_base else 0.0
            elif name == "matroska,webm" and len(container.streams) == 1:
                stated_s = (container.duration or 0) / 1e6
            else:
                stated_s = 0.0
            yield container, stated_s, name == "ogg" and not has_end


class _Rest(io.RawIOBase):
    """A file from a position on, which is its position 0."""

    def __init__(self, file: BinaryIO, start: int) -> None:
        self._file, self._start = file, start
        self.seek(0)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        return self._file.readinto(buffer)  # type: ignore[attr-defined, no-any-return]  # files and BytesIO have it

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset + (self._start if whence == os.SEEK_SET else 0), whence) - self._start


def _untagged(file: BinaryIO) -> BinaryIO:
    """The file after an ID3 tag: some programs put it before any sound, FFmpeg expects it before some."""
    tag = file.read(10)
    file.seek(0)
    if len(tag) < 10 or tag[:3] != b"ID3":
        return file
    return io.BufferedReader(_Rest(file, 10 + sum(byte << 7 * (3 - n) for n, byte in enumerate(tag[6:]))))


def _chunks_s(file: BinaryIO) -> float:
    """Length that a file of chunks states, in s; 0 if it does not, or is another file."""
    file.seek(0)
    kind = CHUNKED.get(file.read(4))
    if kind is None:
        return 0.0
    at, name, width, order, aligned, counted = kind
    bytes_per_s = 0.0
    while True:
        file.seek(at)
        head = file.read(name + width + 24)
        body = head[name + width :]
        size = max(int.from_bytes(head[name : name + width], order) - counted, 0)  # type: ignore[arg-type]
        if head[:4] == b"data":
            return size / bytes_per_s if bytes_per_s and size < UNKNOWN_BYTES else 0.0
        if len(body) < 16 or size >= UNKNOWN_BYTES:
            return 0.0
        if head[:4] == b"fmt ":
            bytes_per_s = int.from_bytes(body[8:12], "little")
        elif head[:4] == b"desc" and len(body) == 24:
            rate_hz, packet_bytes, packet_frames = struct.unpack(">d8x2I", body)
            bytes_per_s = rate_hz * packet_bytes / packet_frames if packet_frames else 0.0
        at += name + width + size + -size % aligned


def _has_end(file: BinaryIO) -> bool:
    """Whether the last page of an Ogg is whole and marked as the end of its stream (RFC 3533)."""
    file.seek(max(file.seek(0, os.SEEK_END) - OGG_TAIL_BYTES, 0))
    tail = file.read(OGG_TAIL_BYTES)
    page = tail[max(tail.rfind(b"OggS"), 0) :]
    return len(page) > 27 and bool(page[5] & 4) and len(page) >= 27 + page[26] + sum(page[27 : 27 + page[26]])


def _is_counted(file: BinaryIO) -> bool:
    """Whether an MP3 states its number of frames; else its length is an estimate."""
    file.seek(0)
    head = file.read(4096)
    return any(mark in head for mark in (b"Xing", b"Info", b"VBRI"))


def _any_metadata() -> dict[str, Any]:
    """Options of PyAV that accept tags that are not UTF-8; version 19 and later need none."""
    return {"metadata_errors": "ignore"} if int(version("av").partition(".")[0]) < 19 else {}


def _check(container: Any, path: Path) -> None:
    """Reject files without decodable audio."""
    if not container.streams.audio:
        raise DataError(f"{path}: holds no sound")
    stream = container.streams.audio[0]
    rate_hz = getattr(stream, "rate", None)  # missing for a codec that FFmpeg does not have
    if not rate_hz:
        raise DataError(f"{path}: holds sound of a codec that is not known")
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1] or not stream.channels:
        raise DataError(
            f"{path}: got {rate_hz} Hz and {stream.channels} channels, expected {RATES_HZ[0]} to {RATES_HZ[1]} Hz and 1"
            " or more"
        )


def _samples(frames: list[Any]) -> list[NDArray[np.int16]]:
    return [frame.to_ndarray().reshape(-1) for frame in frames]


def _mono(frame: Any, channel: int | None, path: Path) -> NDArray[np.float32]:
    """(N,) float32, -1..1: one channel of a decoded frame, or the mean of all."""
    values = frame.to_ndarray()
    channels = frame.layout.nb_channels
    if not frame.format.is_planar:
        values = values.reshape(-1, channels).T
    kind = values.dtype.str[1:]
    if kind not in _FULL_SCALE or len(values) != channels:
        raise DataError(f"{path}: got samples of form {frame.format.name}, expected 8 to 64 bits")
    chosen = values.astype(np.float64) - (128.0 if kind == "u1" else 0.0)
    mixed = chosen[channel - 1] if channel is not None and channel <= channels else chosen.mean(axis=0)
    finite = np.nan_to_num(mixed / _FULL_SCALE[kind], nan=0.0, posinf=1.0, neginf=-1.0)
    return np.asarray(np.clip(finite, -1.0, 1.0), np.float32)
