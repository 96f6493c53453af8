"""Audio files: reading every container that FFmpeg supports and we allow, completely or in pieces; writing WAV.

Input is untrusted, so FFmpeg gets a file that is already open, no protocol to open another, and only the containers in
:data:`CONTAINERS`: some of the others are lists of further files and addresses.
"""

import wave
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from errno import EINVAL
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import replacing

if TYPE_CHECKING:
    import av
else:
    av = Late("av", "av", "sound files other than WAV")

CONTAINERS = (
    "wav", "w64", "flac", "mp3", "ogg", "mov", "matroska", "aac", "aiff", "caf", "au", "avi", "asf", "mpegts", "mpeg",
    "flv", "amr", "ac3", "eac3",
)  # fmt: skip
"""FFmpeg's names of the containers that are read: audio and video, each in one file."""
MAX_RATE_HZ = 48_000
"""Highest rate of a file that is read completely; higher ones are resampled."""
RATES_HZ = (1_000, 768_000)
"""Lowest and highest rate of a file."""
MAX_S = 86_400.0
"""A day: longer files are mistakes or attacks."""
WRITTEN_AT_ONCE = 1 << 20
"""Samples written at a time."""
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
    with _opened(path) as container:
        stream = container.streams.audio[0]
        stated = stream.duration * stream.time_base if stream.duration and stream.time_base else 0
        duration_s = float(stated or (container.duration or 0) / 1e6)
        return SoundInfo(stream.rate, stream.channels, max(duration_s, 0.0))


def stream_sound(path: Path, *, rate_hz: int | None = None, channel: int | None = None) -> Iterator[NDArray[np.int16]]:
    """Decode a file in pieces, so that memory does not grow with its length.

    Parameters
    ----------
    path : Path
    rate_hz : int, optional
        Rate of the pieces; by default the file's own.
    channel : int, optional
        Channel to read, 1 for the first; by default the mean of all.

    Yields
    ------
    (N,) int16
        Mono.

    Raises
    ------
    UsageError
        If the file cannot be read or has no such channel.
    DataError
        If its container is not supported, or it contains no audio or is damaged.
    """
    with _opened(path) as container:
        stream = container.streams.audio[0]
        if channel is not None and not 1 <= channel <= stream.channels:
            raise UsageError(f"channel: got {channel}, expected 1..{stream.channels}, the channels of {path}")
        source_hz, target_hz = stream.rate, rate_hz or stream.rate
        resampler = None if target_hz == source_hz else _Resampler(source_hz, target_hz)
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
                mono = _mono(frame, channel, path)
                if resampler is None:
                    yield _to_int16(mono)
                else:
                    yield from resampler.push(mono)
        except (_av_error(), ValueError, MemoryError) as error:
            if isinstance(error, DataError):
                raise
            where = f"{decoded / source_hz:.2f} s"
            raise DataError(f"{path}: cannot be decoded as sound ({_reason(error)})", where=where) from error
        if resampler is not None:
            yield from resampler.end()


def load_sound(
    path: Path, *, rate_hz: int | None = None, channel: int | None = None
) -> tuple[NDArray[np.int16], int]:  # fmt: skip
    """Read a whole audio file.

    Parameters
    ----------
    path : Path
    rate_hz : int, optional
        Rate to resample to; by default the file's own, up to :data:`MAX_RATE_HZ`.
    channel : int, optional
        Channel to read, 1 for the first; by default the mean of all.

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
    gathered = bytearray()  # grows in place: an hour of sound is held once, not twice
    for piece in stream_sound(path, rate_hz=rate_hz, channel=channel):
        gathered += piece.data
    samples = np.frombuffer(gathered, np.int16)
    if not len(samples):
        raise DataError(f"{path}: holds no sound")
    return samples, rate_hz


def save_wav(path: Path, samples: NDArray[np.int16], sample_rate_hz: int) -> None:
    """Write mono samples, (N,) int16, as a WAV file.

    Raises
    ------
    ResourceError
        If the file cannot be written.
    """
    with replacing(path) as new, wave.open(str(new), "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(sample_rate_hz)
        out.setnframes(len(samples))
        for start in range(0, len(samples), WRITTEN_AT_ONCE):
            out.writeframesraw(samples[start : start + WRITTEN_AT_ONCE].astype("<i2").tobytes())


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a container with decodable audio; it is closed at the end."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    with file:
        try:
            options = {"format_whitelist": ",".join(CONTAINERS), "protocol_whitelist": "none"}
            container = av.open(file, mode="r", options=options, metadata_errors="ignore")
        except (av.FFmpegError, ValueError, OSError) as error:
            known = (
                getattr(error, "errno", None) != EINVAL
            )  # what FFmpeg answers to a container that is not in the list
            reason = _reason(error) if known else "a kind of file that is not read here"
            raise DataError(
                f"{path}: cannot be decoded as sound ({reason}); expected WAV, FLAC, MP3, Ogg, M4A or a video"
            ) from error
        with container:
            _check(container, path)
            yield container


def _check(container: Any, path: Path) -> None:
    """Reject files without decodable audio."""
    if not container.streams.audio:
        raise DataError(f"{path}: holds no sound")
    stream = container.streams.audio[0]
    rate_hz = getattr(stream, "rate", None)  # a codec that FFmpeg lacks has none
    if not rate_hz:
        raise DataError(f"{path}: holds sound of a codec that is not known")
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1] or not stream.channels:
        raise DataError(
            f"{path}: got {rate_hz} Hz and {stream.channels} channels, expected {RATES_HZ[0]}..{RATES_HZ[1]} Hz and 1"
            " or more"
        )


class _Resampler:
    """Mono float samples of one rate to int16 of another. Stateful."""

    def __init__(self, source_hz: int, target_hz: int) -> None:
        self._source_hz = source_hz
        self._resampler = av.AudioResampler(format="s16", layout="mono", rate=target_hz)

    def push(self, mono: NDArray[np.float32]) -> list[NDArray[np.int16]]:
        frame = av.AudioFrame.from_ndarray(mono.reshape(1, -1), format="flt", layout="mono")
        frame.sample_rate = self._source_hz
        return _samples(self._resampler.resample(frame))

    def end(self) -> list[NDArray[np.int16]]:
        return _samples(self._resampler.resample(None))


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
    mono: NDArray[np.float32] = np.clip(finite, -1.0, 1.0).astype(np.float32)
    return mono


def _to_int16(mono: NDArray[np.float32]) -> NDArray[np.int16]:
    return np.clip(np.rint(mono.astype(np.float64) * 2**15), -(2**15), 2**15 - 1).astype(np.int16)


def _av_error() -> type[Exception]:
    """Return the base class of PyAV's errors; PyAV is imported when first needed."""
    return av.FFmpegError


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
