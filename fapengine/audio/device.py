"""Edge: sound out through PortAudio, with the device's clock as the one that the face follows.

:func:`open_output` gives a :class:`Player`, or where there is no device, or not any more, silence of the same length:
:mod:`.output`.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import gcd
from threading import Lock
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.audio.clock import Fetch, PlaybackClock
from fapengine.audio.mixer import Mixer
from fapengine.audio.output import LastingOutput, Output, SilentOutput
from fapengine.errors import ResourceError, UsageError

LATENCY_S = 0.08
"""Asked of the device: a busy machine needs it, and a face that follows the sound is not late by it."""
SETTLE_S = 0.2
"""Silence, played before a device's clock is trusted: PulseAudio's first reports are 45 ms early, for 0.1 s."""
DEAD_S = 4.0
"""A device that has fetched nothing for so long is gone; a sink of PulseAudio may sleep for 2 s."""
MEND_LIBRARY = "sudo apt-get install -y libportaudio2"


@dataclass(frozen=True, slots=True)
class Device:
    """A place where sound goes out."""

    number: int
    name: str
    sample_rate_hz: float
    is_default: bool


def devices() -> list[Device]:
    """List output devices.

    Raises
    ------
    ResourceError
        If PortAudio is not there.
    """
    sounddevice = _portaudio()
    default = sounddevice.default.device[1]
    return [
        Device(number, str(description["name"]), float(description["default_samplerate"]), number == default)
        for number, description in enumerate(sounddevice.query_devices())
        if description["max_output_channels"] > 0
    ]


def open_output(sample_rate_hz: int, *, device: str | None = None, silent: bool = False) -> Output:
    """Open the device, or without one an output that only keeps time.

    Parameters
    ----------
    sample_rate_hz : int
        Of the sounds.
    device : str, optional
        Its number, or a part of its name; by default the system's. One that is named must be there.
    silent : bool
        Open none.

    Raises
    ------
    ResourceError
        If a device that was named cannot be opened.
    """
    if silent:
        return SilentOutput(sample_rate_hz, "no sound was wished for")
    try:
        player = Player(sample_rate_hz, device=int(device) if device is not None and device.isdecimal() else device)
    except ResourceError as error:
        if device is not None:
            raise
        return SilentOutput(sample_rate_hz, str(error).removeprefix("sound: "))
    return LastingOutput(player, sample_rate_hz)


class Player:
    """Playback on a sound device. Use it as a context manager, or close it.

    Stateful.

    Parameters
    ----------
    sample_rate_hz : int
        Of the sounds; a device that does not know it gets them resampled.
    device : int or str, optional
        As PortAudio names it.
    latency_s : float, s
        Asked of the device.
    now : callable
        The monotonic clock.

    Raises
    ------
    ResourceError
        If PortAudio is missing, or the device cannot be opened.
    """

    is_silent = False

    def __init__(
        self,
        sample_rate_hz: int,
        *,
        device: int | str | None = None,
        latency_s: float = LATENCY_S,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        if not sample_rate_hz > 0:
            raise UsageError(f"sample_rate_hz: got {sample_rate_hz}, expected a positive number")
        sounddevice = _portaudio()
        if device is None and sounddevice.default.device[1] < 0:
            raise ResourceError("sound: there is no output device; `fapengine doctor` tells more")
        self._lock, self._now = Lock(), now
        try:
            about = sounddevice.query_devices(device, "output")
            self._rate_hz = _rate_of(sounddevice, device, sample_rate_hz, about)
            self._given_hz = sample_rate_hz
            self.clock = PlaybackClock(self._rate_hz)
            self._queue = Mixer(self._rate_hz)
            self._stream = sounddevice.OutputStream(
                samplerate=self._rate_hz, channels=1, dtype="int16", device=device, latency=latency_s,
                callback=self._fetch,
            )  # fmt: skip
            self._opened_s = now()
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise ResourceError(f"sound: {_plain(error)}; `fapengine doctor` lists the devices") from error
        self.description = f"{about['name']}, {self._rate_hz} Hz"

    def __enter__(self) -> "Player":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _fetch(self, out: NDArray[np.int16], frames: int, times: Any, status: Any) -> None:
        """PortAudio's own thread calls this."""
        called_s = self._now()
        with self._lock:
            out[:, 0] = self._queue.take(frames)
            heard_s = times.outputBufferDacTime
            self.clock.tell(Fetch(called_s, times.currentTime, heard_s, frames, bool(status.output_underflow)))

    def is_settled(self, now_s: float) -> bool:
        """See :class:`Output`."""
        with self._lock:
            return self.clock.position_s(now_s) >= SETTLE_S

    def is_alive(self, now_s: float) -> bool:
        """See :class:`~fapengine.audio.output.DeviceOutput`."""
        with self._lock:
            told_s = self.clock.told_s or self._opened_s
        return bool(self._stream.active) and now_s - told_s < DEAD_S

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        pcm = frozen(samples, "samples", ("N",), np.int16)
        sound = _resample(pcm, self._given_hz, self._rate_hz)
        with self._lock:
            return self._queue.add(sound)

    def position_s(self, sound: int, now_s: float) -> float | None:
        """See :class:`Output`."""
        with self._lock:
            return self._queue.position_s(sound, self.clock.position_s(now_s))

    def is_over(self, sound: int, now_s: float) -> bool:
        """See :class:`Output`."""
        with self._lock:
            return self._queue.is_over(sound, self.clock.position_s(now_s))

    def pause(self, on: bool) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._queue.pause(on)

    def drop(self, sound: int) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._queue.drop(sound)

    def stop(self) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._queue.stop()

    def close(self) -> None:
        """See :class:`Output`."""
        self._stream.close()


def _portaudio() -> Any:
    try:
        import sounddevice
    except (ImportError, OSError) as error:
        raise ResourceError(f"sound: {_plain(error)}. Install it with: {MEND_LIBRARY}") from error
    return sounddevice


def _rate_of(sounddevice: Any, device: int | str | None, wanted_hz: int, about: dict[str, Any]) -> int:
    """Find the wished rate if the device knows it, else its own."""
    try:
        sounddevice.check_output_settings(device=device, channels=1, dtype="int16", samplerate=wanted_hz)
    except sounddevice.PortAudioError:
        return int(about["default_samplerate"])
    return wanted_hz


def _resample(samples: NDArray[np.int16], from_hz: int, to_hz: int) -> NDArray[np.int16]:
    if from_hz == to_hz or not len(samples):
        return samples
    from scipy.signal import resample_poly

    shared = gcd(from_hz, to_hz)
    finer = resample_poly(samples.astype(np.float64), to_hz // shared, from_hz // shared)
    return np.clip(np.rint(finer), -32768, 32767).astype(np.int16)


def _plain(error: BaseException) -> str:
    """Spell an error of PortAudio in one line."""
    return " ".join(str(error).split()) or type(error).__name__
