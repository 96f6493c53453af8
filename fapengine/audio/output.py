"""Outputs that play sounds one after the other and know the position of each, and the player of utterances' sounds.

An output without a device, or whose device was unplugged, is silent and keeps time by the monotonic clock, so that a
face continues as if its sound were heard.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from threading import Lock
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.audio.mixer import Mixer

log = logging.getLogger("fapengine.sound")


class Output:
    """Plays sounds one after the other. Use it as a context manager, or close it.

    Stateful. All times are of the monotonic clock.

    Parameters
    ----------
    sample_rate_hz : int
    description : str
        Name of the device.
    now : callable
        The monotonic clock.
    """

    settle_s = 0.0
    """Length of the silence that a device plays before its clock is reliable."""

    def __init__(self, sample_rate_hz: int, description: str, now: Callable[[], float] = time.monotonic) -> None:
        self.description = description
        self.is_silent = False
        """True without a device."""
        self._mixer, self._rate_hz, self._now, self._lock = Mixer(sample_rate_hz), sample_rate_hz, now, Lock()
        self._silent_from: tuple[float, float] | None = None
        """Time since when the output is silent, and the position of its stream at that time."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def is_alive(self, now_s: float) -> bool:
        """Whether the device still fetches samples."""
        return True

    def is_settled(self, now_s: float) -> bool:
        """Whether the clock is reliable: that of a device that was just opened is not."""
        stream_s = self._reach(now_s)
        return self.is_silent or stream_s >= self.settle_s

    def play(self, samples: ArrayLike) -> int:
        """Queue a sound, (N,) int16 mono; return its number."""
        self._reach(self._now())
        with self._lock:
            return self._mixer.add(samples)

    def position_s(self, sound: int, now_s: float) -> float | None:
        """Position that is heard; negative just before the sound begins, None while it waits or if it was dropped."""
        stream_s = self._reach(now_s)
        with self._lock:
            return self._mixer.position_s(sound, stream_s)

    def is_over(self, sound: int, now_s: float) -> bool:
        """Whether a sound was heard to its end, or was dropped."""
        stream_s = self._reach(now_s)
        with self._lock:
            return self._mixer.is_over(sound, stream_s)

    def pause(self, on: bool) -> None:
        """Pause, or resume."""
        self._reach(self._now())
        with self._lock:
            self._mixer.pause(on)

    def drop(self, sound: int) -> None:
        """Fade a sound out within 10 ms, or never begin it."""
        self._reach(self._now())
        with self._lock:
            self._mixer.drop(sound)

    def stop(self) -> None:
        """Drop every sound; a pause ends."""
        self._reach(self._now())
        with self._lock:
            self._mixer.stop()

    def close(self) -> None:
        """Release the device."""

    def _device_s(self, now_s: float) -> float:
        """Return the position of the stream that is heard from the device."""
        raise NotImplementedError

    def _reach(self, now_s: float) -> float:
        """Return the position of the stream that is heard; silence begins there if the device was unplugged."""
        if self._silent_from is None and not self.is_alive(now_s):
            with self._lock:
                self._silent_from = now_s, self._device_s(now_s)
            self.is_silent, self.description = True, f"{self.description}: is gone"
            log.warning("no sound any more; the face keeps time by the clock: %s", self.description)
            self.close()  # without the lock, for which a callback may wait
        with self._lock:
            if self._silent_from is None:
                return self._device_s(now_s)
            at_s, stream_s = self._silent_from
            return self._skip_to(stream_s + now_s - at_s)

    def _skip_to(self, stream_s: float) -> float:
        """Discard samples up to a position of the stream; return the position."""
        self._mixer.skip(max(round(stream_s * self._rate_hz) + 1 - self._mixer.taken, 0))
        return stream_s


class SilentOutput(Output):
    """An output without a device, with a description that says why."""

    def __init__(self, sample_rate_hz: int, description: str, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__(sample_rate_hz, description, now)
        self.is_silent, self._silent_from = True, (now(), 0.0)


TELL_EVERY_S = 0.02
"""Interval between two reports of a sound's position."""
STILL_S = 0.1
"""Time without a change of its position after which a sound counts as paused; longer than a late callback."""
SETTLE_S = 1.2
"""Longest wait for a device that was just opened; a hub begins without sound after 1.5 s."""

OpenOutput = Callable[[int], Output]
"""Sample rate in Hz to an output; called once for each rate."""


@dataclass(slots=True, eq=False)
class Playing:
    """The sound of an utterance. Stateful."""

    utterance: int
    output: Output
    samples: NDArray[np.int16]
    since_s: float
    sound: int | None = None
    """Number of the sound in its output; None while it waits for the device."""
    place_s: float | None = None
    """Position at the last call of :meth:`is_due`."""
    zero_s: float | None = None
    """Engine time of the beginning of the sound."""
    is_still: bool = False
    _moved_s: float = 0.0
    """Time at which the position last changed."""
    _told_s: float = -inf

    def is_due(self, place_s: float, now_s: float) -> bool:
        """Return whether to report this position: at intervals while it moves, once when it pauses."""
        if place_s != self.place_s:
            self.place_s, self._moved_s = place_s, now_s
        was_still, self.is_still = self.is_still, now_s - self._moved_s > STILL_S
        if self.is_still == was_still and (self.is_still or now_s - self._told_s < TELL_EVERY_S):
            return False
        self._told_s = now_s
        return True

    def position_s(self, now_s: float) -> float | None:
        """Return the position that is heard; None before it is known."""
        return None if self.sound is None else self.output.position_s(self.sound, now_s)


@dataclass(slots=True)
class SoundPlayer:
    """Plays sounds through one output for each rate. Stateful; close it."""

    opens: OpenOutput
    playing: list[Playing] = field(default_factory=list)
    """Sounds that play or wait."""
    is_paused: bool = False
    outputs: dict[int, Output] = field(default_factory=dict)

    def open(self, sample_rate_hz: int) -> Output:
        """Open the output of a rate, before the first sound needs it."""
        if sample_rate_hz not in self.outputs:
            self.outputs[sample_rate_hz] = self.opens(sample_rate_hz)
            self.outputs[sample_rate_hz].pause(self.is_paused)
        return self.outputs[sample_rate_hz]

    def add(self, utterance: int, samples: NDArray[np.int16], sample_rate_hz: int, now_s: float) -> None:
        """Queue the sound of an utterance, (N,) int16."""
        self.playing.append(Playing(utterance, self.open(sample_rate_hz), samples, now_s))

    def follow(self, now_s: float) -> list[Playing]:
        """Start sounds whose device has settled, remove those that are over, and return those that play."""
        for entry in tuple(self.playing):
            if entry.sound is None and (entry.output.is_settled(now_s) or now_s - entry.since_s > SETTLE_S):
                entry.sound = entry.output.play(entry.samples)
            if entry.sound is not None and entry.output.is_over(entry.sound, now_s):
                self.playing.remove(entry)
        return [entry for entry in self.playing if entry.sound is not None]

    def drop(self, utterance: int) -> None:
        """Stop the sound of an utterance."""
        for entry in [entry for entry in self.playing if entry.utterance == utterance]:
            if entry.sound is not None:
                entry.output.drop(entry.sound)
            self.playing.remove(entry)

    def pause(self, on: bool) -> None:
        """Pause, or resume."""
        self.is_paused = on
        for output in self.outputs.values():
            output.pause(on)

    def stop(self) -> list[int]:
        """Drop all sounds and return their utterances. A pause ends."""
        for output in self.outputs.values():
            output.stop()
        stopped = [entry.utterance for entry in self.playing]
        self.is_paused = False
        self.playing.clear()
        return stopped

    def close(self) -> None:
        """Close the devices."""
        for output in self.outputs.values():
            output.close()
