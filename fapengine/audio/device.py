"""Edge: sound devices through PortAudio: playback whose clock the face follows, and microphones.

:func:`open_output` returns a :class:`Player`, or silence of the same length if there is no device: :mod:`.output`.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from math import gcd
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.audio.clock import Fetch, PlaybackClock
from fapengine.audio.output import Output, SilentOutput
from fapengine.errors import ResourceError, UsageError

LATENCY_S = 0.08
"""Requested latency of the device: a busy machine needs it, and a face that follows the sound is not late by it."""
SETTLE_S = 0.2
"""Silence, played before a device's clock is trusted: PulseAudio's first reports are 45 ms early, for 0.1 s."""
DEAD_S = 4.0
"""Time without a fetch after which a device is gone; a sink of PulseAudio may sleep for 2 s."""
INSTALL_COMMAND = "sudo apt-get install -y libportaudio2"

Direction = Literal["input", "output"]


@dataclass(frozen=True, slots=True)
class Device:
    """An input or output device."""

    number: int
    name: str
    sample_rate_hz: float
    is_default: bool


def devices(direction: Direction = "output") -> list[Device]:
    """List the devices.

    Raises
    ------
    ResourceError
        If PortAudio is missing.
    """
    sounddevice = portaudio()
    default = sounddevice.default.device[direction == "output"]
    return [
        Device(number, str(description["name"]), float(description["default_samplerate"]), number == default)
        for number, description in enumerate(sounddevice.query_devices())
        if description[f"max_{direction}_channels"] > 0
    ]


def open_output(sample_rate_hz: int, *, device: str | None = None, silent: bool = False) -> Output:
    """Open the device, or an output that only keeps time.

    Parameters
    ----------
    sample_rate_hz : int
        Of the sounds.
    device : str, optional
        Its number, or a part of its name, which must exist; by default the system's.
    silent : bool
        Open none.

    Raises
    ------
    ResourceError
        If the named device cannot be opened.
    """
    if silent:
        return SilentOutput(sample_rate_hz, "no sound was wished for")
    try:
        return Player(sample_rate_hz, device=_number_or_name(device))
    except ResourceError as error:
        if device is not None:
            raise
        return SilentOutput(sample_rate_hz, str(error).removeprefix("sound: "))


class Player(Output):
    """Playback on a sound device. Use it as a context manager, or close it.

    Stateful.

    Parameters
    ----------
    sample_rate_hz : int
        Of the sounds, which are resampled for a device that does not support it.
    device : int or str, optional
        As PortAudio names it.
    now : callable
        The monotonic clock.

    Raises
    ------
    ResourceError
        If PortAudio is missing, or the device cannot be opened.
    """

    settle_s = SETTLE_S

    def __init__(
        self, sample_rate_hz: int, *, device: int | str | None = None, now: Callable[[], float] = time.monotonic
    ) -> None:
        if not sample_rate_hz > 0:
            raise UsageError(f"sample_rate_hz: got {sample_rate_hz}, expected a positive number")
        sounddevice = portaudio()
        if device is None and sounddevice.default.device[1] < 0:
            raise ResourceError("sound: there is no output device; see `fapengine doctor`")
        try:
            about = sounddevice.query_devices(device, "output")
            rate_hz = supported_rate_hz("output", device, (sample_rate_hz,), about)
            super().__init__(rate_hz, f"{about['name']}, {rate_hz} Hz", now)
            self._given_hz, self._opened_s = sample_rate_hz, now()
            self.clock = PlaybackClock(self._rate_hz)
            self._stream = sounddevice.OutputStream(
                samplerate=self._rate_hz, channels=1, dtype="int16", device=device, latency=LATENCY_S,
                callback=self._fetch,
            )  # fmt: skip
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise ResourceError(f"sound: {plain(error)}; `fapengine doctor` lists the devices") from error

    def _fetch(self, out: NDArray[np.int16], frames: int, times: Any, status: Any) -> None:
        """PortAudio's own thread calls this."""
        called_s = self._now()
        with self._lock:
            out[:, 0] = self._mixer.take(frames)
            heard_s = times.outputBufferDacTime
            self.clock.tell(Fetch(called_s, times.currentTime, heard_s, frames, bool(status.output_underflow)))

    def is_alive(self, now_s: float) -> bool:
        """See :class:`Output`."""
        with self._lock:
            fetched_s = self.clock.fetched_s or self._opened_s
        return bool(self._stream.active) and now_s - fetched_s < DEAD_S

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        pcm = frozen(samples, "samples", ("N",), np.int16)
        return super().play(_resample(pcm, self._given_hz, self._rate_hz))

    def close(self) -> None:
        """See :class:`Output`."""
        self._stream.close()

    def _device_s(self, now_s: float) -> float:
        return self.clock.position_s(now_s)


def portaudio() -> Any:
    """Import sounddevice.

    Raises
    ------
    ResourceError
        If it, or PortAudio, is missing.
    """
    try:
        import sounddevice
    except (ImportError, OSError) as error:
        raise ResourceError(f"sound: {plain(error)}. Install it with: {INSTALL_COMMAND}") from error
    return sounddevice


def supported_rate_hz(
    direction: Direction, device: int | str | None, rates_hz: Iterable[int], about: dict[str, Any]
) -> int:
    """Return the first rate that a device supports, or else its own."""
    sounddevice = portaudio()
    check = getattr(sounddevice, f"check_{direction}_settings")
    for rate_hz in rates_hz:
        with suppress(sounddevice.PortAudioError):
            check(device=device, channels=1, dtype="int16", samplerate=rate_hz)
            return rate_hz
    return int(about["default_samplerate"])


def _number_or_name(device: str | None) -> int | str | None:
    return int(device) if device is not None and device.isdecimal() else device


def plain(error: BaseException) -> str:
    """Return an error of PortAudio in one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _resample(samples: NDArray[np.int16], from_hz: int, to_hz: int) -> NDArray[np.int16]:
    if from_hz == to_hz or not len(samples):
        return samples
    from scipy.signal import resample_poly

    shared = gcd(from_hz, to_hz)
    resampled = resample_poly(samples.astype(np.float64), to_hz // shared, from_hz // shared)
    return np.clip(np.rint(resampled), -32768, 32767).astype(np.int16)


RATES_HZ = (16_000, 48_000, 44_100)
"""Rates that are tried before the device's own."""
PIECE_S = 0.02
MAX_PIECES = 100
"""Pieces that wait, 2 s; then the oldest is dropped."""
DEFAULT = "default"
"""Name of the system's microphone."""


class Microphone:
    """Sound of an input device. Use it as a context manager, or close it. Stateful.

    Parameters
    ----------
    device : str, optional
        Its number, or a part of its name; None or :data:`DEFAULT`: the system's.

    Raises
    ------
    ResourceError
        If PortAudio is missing, or the device cannot be opened.
    """

    def __init__(self, device: str | None = None) -> None:
        sounddevice = portaudio()
        chosen = None if device == DEFAULT else _number_or_name(device)
        if chosen is None and sounddevice.default.device[0] < 0:
            raise ResourceError("microphone: there is no input device; see `fapengine doctor`")
        self._pieces: deque[NDArray[np.int16]] = deque(maxlen=MAX_PIECES)
        self.dropped = 0
        try:
            about = sounddevice.query_devices(chosen, "input")
            self.rate_hz = supported_rate_hz("input", chosen, RATES_HZ, about)
            self._stream = sounddevice.InputStream(
                samplerate=self.rate_hz, channels=1, dtype="int16", device=chosen, latency="low",
                blocksize=round(PIECE_S * self.rate_hz), callback=self._take,
            )  # fmt: skip
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise ResourceError(f"microphone: {plain(error)}; `fapengine doctor` lists the devices") from error
        self.description = f"{about['name']}, {self.rate_hz} Hz"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def take(self) -> NDArray[np.int16]:
        """Return the samples since the last call, (N,) int16, mono, at ``rate_hz``."""
        pieces = [np.zeros(0, np.int16)]
        while self._pieces:
            pieces.append(self._pieces.popleft())
        return np.concatenate(pieces)

    def close(self) -> None:
        """Close the device."""
        self._stream.close()

    def _take(self, data: NDArray[np.int16], frames: int, times: Any, status: Any) -> None:
        """PortAudio's own thread calls this."""
        self.dropped += len(self._pieces) == MAX_PIECES
        self._pieces.append(data[:, 0].copy())
