"""Outputs that play sounds one after the other and know where each really is; and silence, where nothing can play them.

A :class:`SilentOutput` keeps time by the monotonic clock, so that a face continues as if it were heard.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.audio.mixer import Mixer

log = logging.getLogger("fapengine.sound")


class Output(Protocol):
    """Something that plays sounds one after the other. All times are of the monotonic clock."""

    @property
    def description(self) -> str:
        """Device, or why there is none."""
        ...

    @property
    def is_silent(self) -> bool:
        """Whether sounds are only kept time of."""
        ...

    def is_settled(self, now_s: float) -> bool:
        """Whether its clock is to be trusted: a device that was just opened starts when it likes."""
        ...

    def play(self, samples: ArrayLike) -> int:
        """Queue a sound, (N,) int16 mono; return its number."""
        ...

    def position_s(self, sound: int, now_s: float) -> float | None:
        """Where a sound is heard to be; negative just before it begins, None while it waits or was dropped."""
        ...

    def is_over(self, sound: int, now_s: float) -> bool:
        """Whether it was heard to its end, or was dropped."""
        ...

    def pause(self, on: bool) -> None:
        """Pause, or resume."""
        ...

    def drop(self, sound: int) -> None:
        """Let a sound fall silent within 10 ms of sound, or never begin."""
        ...

    def stop(self) -> None:
        """Drop every sound; a pause ends."""
        ...

    def close(self) -> None:
        """Give the device back."""
        ...


class DeviceOutput(Output, Protocol):
    """An output that may be pulled out."""

    def is_alive(self, now_s: float) -> bool:
        """Whether it still fetches sound."""
        ...


class SilentOutput:
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
        self.description = description
        self._queue, self._rate_hz = Mixer(sample_rate_hz), sample_rate_hz
        self._now, self._start_s = now, now()

    def is_settled(self, now_s: float) -> bool:
        """See :class:`Output`."""
        return True

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        self._reach(self._now())
        return self._queue.add(samples)

    def position_s(self, sound: int, now_s: float) -> float | None:
        """See :class:`Output`."""
        return self._queue.position_s(sound, self._reach(now_s))

    def is_over(self, sound: int, now_s: float) -> bool:
        """See :class:`Output`."""
        return self._queue.is_over(sound, self._reach(now_s))

    def pause(self, on: bool) -> None:
        """See :class:`Output`."""
        self._reach(self._now())
        self._queue.pause(on)

    def drop(self, sound: int) -> None:
        """See :class:`Output`."""
        self._reach(self._now())
        self._queue.drop(sound)

    def stop(self) -> None:
        """See :class:`Output`."""
        self._reach(self._now())
        self._queue.stop()

    def close(self) -> None:
        """See :class:`Output`."""

    def _reach(self, now_s: float) -> float:
        """Pass over all that would have been heard by now; where the stream is."""
        stream_s = now_s - self._start_s
        self._queue.skip(max(round(stream_s * self._rate_hz) + 1 - self._queue.taken, 0))
        return stream_s


@dataclass(slots=True)
class _Kept:
    """A sound that may have to continue on another output."""

    samples: NDArray[np.int16]
    number: int
    """Number of the sound in the output that plays it."""
    skipped_s: float = 0.0
    """Played by a device that is gone."""


class LastingOutput:
    """A sound device; once it is gone, silence that continues from where each sound was.

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
        return self._there(now_s).is_settled(now_s)

    def play(self, samples: ArrayLike) -> int:
        """See :class:`Output`."""
        pcm = frozen(samples, "samples", ("N",), np.int16)
        self._count += 1
        self._sounds[self._count] = _Kept(pcm, self._there(self._now()).play(pcm))
        return self._count

    def position_s(self, sound: int, now_s: float) -> float | None:
        """See :class:`Output`."""
        output, entry = self._there(now_s), self._sounds.get(sound)
        if entry is None:
            return None
        place_s = output.position_s(entry.number, now_s)
        return entry.skipped_s or None if place_s is None else entry.skipped_s + place_s

    def is_over(self, sound: int, now_s: float) -> bool:
        """See :class:`Output`."""
        output, entry = self._there(now_s), self._sounds.get(sound)
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

    def _there(self, now_s: float) -> Output:
        """Return the device, or what took its place."""
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
