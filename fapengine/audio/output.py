"""Outputs that play sounds one after the other and know the position of each; and silence, if no device can play them.

A :class:`SilentOutput` keeps time by the monotonic clock, so that a face continues as if its sound were heard.
"""

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.audio.mixer import Mixer

log = logging.getLogger("fapengine.sound")


class Output(Protocol):
    """Something that plays sounds one after the other. All times are of the monotonic clock."""

    @property
    def description(self) -> str:
        """Name of the device, or why there is none."""

    @property
    def is_silent(self) -> bool:
        """Whether nothing is heard."""

    def is_settled(self, now_s: float) -> bool:
        """Whether its clock is reliable: a device that was just opened is not."""

    def play(self, samples: ArrayLike) -> int:
        """Queue a sound, (N,) int16 mono; return its number."""

    def position_s(self, sound: int, now_s: float) -> float | None:
        """Position that is heard; negative just before the sound begins, None while it waits or if it was dropped."""

    def is_over(self, sound: int, now_s: float) -> bool:
        """Whether a sound was heard to its end, or was dropped."""

    def pause(self, on: bool) -> None:
        """Pause, or resume."""

    def drop(self, sound: int) -> None:
        """Fade a sound out within 10 ms, or never begin it."""

    def stop(self) -> None:
        """Drop every sound; a pause ends."""

    def close(self) -> None:
        """Release the device."""


class DeviceOutput(Output, Protocol):
    """An output that may be unplugged."""

    def is_alive(self, now_s: float) -> bool:
        """Whether it still fetches samples."""


class MixerOutput(ABC):
    """An output whose device takes its samples from a mixer; see :class:`Output`. Use it as a context manager.

    Stateful.
    """

    description: str
    is_silent = False

    def __init__(self, sample_rate_hz: int, now: Callable[[], float]) -> None:
        self._mixer, self._rate_hz, self._now = Mixer(sample_rate_hz), sample_rate_hz, now
        self._lock = Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @abstractmethod
    def is_settled(self, now_s: float) -> bool:
        """See :class:`Output`."""

    @abstractmethod
    def close(self) -> None:
        """See :class:`Output`."""

    @abstractmethod
    def _stream_s(self, now_s: float) -> float:
        """Return the position of the mixer's stream that is heard."""

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        with self._lock:
            self._stream_s(self._now())
            return self._mixer.add(samples)

    def position_s(self, sound: int, now_s: float) -> float | None:
        """See :class:`Output`."""
        with self._lock:
            return self._mixer.position_s(sound, self._stream_s(now_s))

    def is_over(self, sound: int, now_s: float) -> bool:
        """See :class:`Output`."""
        with self._lock:
            return self._mixer.is_over(sound, self._stream_s(now_s))

    def pause(self, on: bool) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._stream_s(self._now())
            self._mixer.pause(on)

    def drop(self, sound: int) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._stream_s(self._now())
            self._mixer.drop(sound)

    def stop(self) -> None:
        """See :class:`Output`."""
        with self._lock:
            self._stream_s(self._now())
            self._mixer.stop()


class SilentOutput(MixerOutput):
    """An output that plays nothing and takes as long as it would; for machines without a sound card.

    Stateful.

    Parameters
    ----------
    sample_rate_hz : int
    description : str
        Why it is silent.
    now : callable
        The monotonic clock.
    """

    is_silent = True

    def __init__(self, sample_rate_hz: int, description: str, *, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__(sample_rate_hz, now)
        self.description, self._start_s = description, now()

    def is_settled(self, now_s: float) -> bool:
        """See :class:`Output`."""
        return True

    def close(self) -> None:
        """See :class:`Output`."""

    def _stream_s(self, now_s: float) -> float:
        """Skip what would have been heard by now."""
        stream_s = now_s - self._start_s
        self._mixer.skip(max(round(stream_s * self._rate_hz) + 1 - self._mixer.taken, 0))
        return stream_s


@dataclass(slots=True)
class _Kept:
    """A sound that may have to continue on another output."""

    samples: NDArray[np.int16]
    number: int
    """Number of the sound in its output."""
    skipped_s: float = 0.0
    """Length that an unplugged device has played."""


class LastingOutput:
    """A sound device; if it is unplugged, silence that continues at the position of each sound.

    Stateful.

    Parameters
    ----------
    device : DeviceOutput
        Closed with this.
    sample_rate_hz : int
        Of the sounds.
    now : callable
        The monotonic clock.
    """

    def __init__(self, device: DeviceOutput, sample_rate_hz: int, *, now: Callable[[], float] = time.monotonic) -> None:
        self._device: DeviceOutput | None = device
        self._output: Output = device
        self._sample_rate_hz, self._now = sample_rate_hz, now
        self._sounds: dict[int, _Kept] = {}
        self._count = 0
        self._is_paused = False

    @property
    def description(self) -> str:
        """See :class:`Output`."""
        return self._output.description

    @property
    def is_silent(self) -> bool:
        """See :class:`Output`."""
        return self._output.is_silent

    def is_settled(self, now_s: float) -> bool:
        """See :class:`Output`."""
        return self._current(now_s).is_settled(now_s)

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        pcm = np.array(samples, np.int16)
        self._count += 1
        self._sounds[self._count] = _Kept(pcm, self._current(self._now()).play(samples))
        return self._count

    def position_s(self, sound: int, now_s: float) -> float | None:
        """See :class:`Output`."""
        output, entry = self._current(now_s), self._sounds.get(sound)
        if entry is None:
            return None
        place_s = output.position_s(entry.number, now_s)
        return entry.skipped_s or None if place_s is None else entry.skipped_s + place_s

    def is_over(self, sound: int, now_s: float) -> bool:
        """See :class:`Output`."""
        output, entry = self._current(now_s), self._sounds.get(sound)
        if entry is not None and output.is_over(entry.number, now_s):
            del self._sounds[sound]
        return sound not in self._sounds

    def pause(self, on: bool) -> None:
        """See :class:`Output`."""
        self._is_paused = on
        self._output.pause(on)

    def drop(self, sound: int) -> None:
        """See :class:`Output`."""
        entry = self._sounds.pop(sound, None)
        if entry is not None:
            self._output.drop(entry.number)

    def stop(self) -> None:
        """See :class:`Output`."""
        self._is_paused = False
        self._sounds.clear()
        self._output.stop()

    def close(self) -> None:
        """See :class:`Output`."""
        self._output.close()

    def _current(self, now_s: float) -> Output:
        """Return the device, or silence if it was unplugged."""
        lost = self._device
        if lost is not None and not lost.is_alive(now_s):
            silence = SilentOutput(self._sample_rate_hz, f"{lost.description}: is gone", now=self._now)
            log.warning("no sound any more; the face keeps time by the clock: %s", silence.description)
            silence.pause(self._is_paused)
            for entry in self._sounds.values():
                entry.skipped_s = max(lost.position_s(entry.number, now_s) or 0.0, 0.0)
                entry.number = silence.play(entry.samples[round(entry.skipped_s * self._sample_rate_hz) :])
            self._device, self._output = None, silence
            lost.close()
        return self._output
