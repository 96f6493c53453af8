"""Sound files: any container that FFmpeg reads in, WAV out."""

import io
import wave
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.files.paths import read_bytes, write_bytes


def load_sound(path: Path) -> tuple[NDArray[np.int16], int]:
    """Read a sound file.

    Returns
    -------
    samples : (N,) int16
        Mono; several channels are averaged.
    sample_rate_hz : int

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it holds no sound.
    """
    import av

    data = read_bytes(path)
    try:
        with av.open(io.BytesIO(data), mode="r") as container:
            if not container.streams.audio:
                raise DataError(f"{path}: holds no sound")
            rate_hz = container.streams.audio[0].rate
            resampler = av.AudioResampler(format="s16", layout="mono", rate=rate_hz)
            pieces = [
                piece.to_ndarray().reshape(-1)
                for frame in container.decode(audio=0)
                for piece in resampler.resample(frame)
            ]
            pieces += [piece.to_ndarray().reshape(-1) for piece in resampler.resample(None)]
    except av.FFmpegError as error:
        raise DataError(f"{path}: cannot be decoded as sound ({error.strerror})") from error
    samples = np.concatenate(pieces) if pieces else np.zeros(0, np.int16)
    if not len(samples):
        raise DataError(f"{path}: holds no sound")
    return samples.astype(np.int16), rate_hz


def save_wav(path: Path, samples: NDArray[np.int16], sample_rate_hz: int) -> None:
    """Write mono samples, (N,) int16, as a WAV file.

    Raises
    ------
    ResourceError
        If the file cannot be written.
    """
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(sample_rate_hz)
        out.writeframes(np.ascontiguousarray(samples, dtype="<i2").tobytes())
    write_bytes(path, buffer.getvalue())
