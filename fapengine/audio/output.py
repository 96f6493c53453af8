"""Outputs that play sounds one after the other and know the position of each.

An output without a device, or whose device was unplugged, is silent and keeps time by the monotonic clock, so that a
face continues as if its sound were heard.
"""

import logging
import time
from collections.abc import Callable
from threading import Lock
from typing import Self

from numpy.typing import ArrayLike

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
        """Fetch samples up to a position of the stream, for nobody to hear; return the position."""
        self._mixer.skip(max(round(stream_s * self._rate_hz) + 1 - self._mixer.taken, 0))
        return stream_s


class SilentOutput(Output):
    """An output without a device, with a description that says why."""

    def __init__(self, sample_rate_hz: int, description: str, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__(sample_rate_hz, description, now)
        self.is_silent, self._silent_from = True, (now(), 0.0)
