"""Sounds one behind the other, handed out a buffer at a time: what a sound card's callback needs, without the card."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError

Samples = NDArray[np.int16]
FADE_S = 0.01
"""Over which a sound that is stopped dies away; shorter ones click."""
KEPT = 64
"""Sounds that are over and still remembered."""


@dataclass(slots=True)
class _Sound:
    samples: Samples
    first: int | None = None
    """Frame of the stream at which it begins; None while it waits."""
    done: int = 0
    """Frames of it that were handed out."""

    @property
    def end(self) -> int:
        """Frame of the stream behind its last, once it has begun."""
        return (self.first or 0) + len(self.samples)


@dataclass(slots=True)
class SoundQueue:
    """Stateful: mono 16-bit sounds in, buffers out; silence where there is none.

    Parameters
    ----------
    sample_rate_hz : float
    """

    sample_rate_hz: float
    taken: int = 0
    """Frames that were handed out, silence included."""
    _count: int = 0
    _waiting: deque[_Sound] = field(default_factory=deque)
    _known: dict[int, _Sound] = field(default_factory=dict)

    def add(self, samples: ArrayLike) -> int:
        """Put a sound behind all others; return its number: (N,) int16."""
        sound = _Sound(frozen(samples, "samples", ("N",), np.int16))
        self._waiting.append(sound)
        self._count += 1
        self._known[self._count] = sound
        self._forget()
        return self._count

    def _forget(self) -> None:
        """Forget the oldest sounds that are over."""
        for number in list(self._known)[: max(len(self._known) - KEPT, 0)]:
            sound = self._known[number]
            if sound.first is None or sound.end > self.taken:
                return
            del self._known[number]

    def take(self, frames: int) -> Samples:
        """Hand out the next buffer, (frames,) int16."""
        buffer = np.zeros(frames, np.int16)
        filled = 0
        while filled < frames and self._waiting:
            sound = self._waiting[0]
            if sound.first is None:
                sound.first = self.taken + filled
            piece = sound.samples[sound.done : sound.done + frames - filled]
            buffer[filled : filled + len(piece)] = piece
            sound.done += len(piece)
            filled += len(piece)
            if sound.done == len(sound.samples):
                self._waiting.popleft()
        self.taken += frames
        return buffer

    def stop(self) -> None:
        """Let what is handed out die away over :data:`FADE_S`, and drop what waits."""
        for number, sound in list(self._known.items()):
            if sound.first is None:
                del self._known[number]
        playing = self._waiting[0] if self._waiting and self._waiting[0].first is not None else None
        self._waiting.clear()
        if playing is None:
            return
        tail = playing.samples[playing.done : playing.done + round(FADE_S * self.sample_rate_hz)]
        faded = tail * np.linspace(1.0, 0.0, len(tail), endpoint=False)
        playing.samples = np.concatenate([playing.samples[: playing.done], faded.astype(np.int16)])
        self._waiting.append(playing)

    def position_s(self, sound: int, stream_s: float) -> float | None:
        """Find where a sound is when the stream is at ``stream_s``; None while it waits, or was dropped.

        Before 0: it is fetched and not yet heard. Not past its end.

        Raises
        ------
        UsageError
            If there was no sound of that number.
        """
        one = self._find(sound)
        if one is None or one.first is None:
            return None
        return min(stream_s - one.first / self.sample_rate_hz, len(one.samples) / self.sample_rate_hz)

    def is_over(self, sound: int, stream_s: float) -> bool:
        """Tell whether it was heard to its end, or was dropped.

        Raises
        ------
        UsageError
            If there was no sound of that number.
        """
        one = self._find(sound)
        return one is None or (one.first is not None and stream_s * self.sample_rate_hz >= one.end - 0.5)

    def _find(self, number: int) -> _Sound | None:
        if not 1 <= number <= self._count:
            raise UsageError(f"sound: got {number}, expected 1..{self._count}")
        return self._known.get(number)
