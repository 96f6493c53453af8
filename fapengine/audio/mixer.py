"""Mixer of sounds for the callback of a sound card: one sound after the other, in buffers of any length."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError

Samples = NDArray[np.int16]
FADE_S = 0.01
"""Fade of a sound that is dropped, paused or resumed; a shorter fade clicks."""
KEPT = 64
"""Number of sounds that are remembered after their end."""
SKIPPED = 1 << 14
"""Frames that are skipped at a time while something sounds."""


@dataclass(slots=True, eq=False)
class _Sound:
    samples: Samples
    first: int | None = None
    """Frame of the stream at which the sound begins; None while it waits."""
    done: int = 0
    """Frames of the sound that were returned."""
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """Pauses of the sound: frame of the stream, and number of frames."""

    @property
    def end(self) -> int:
        """Frame of the stream after its last frame, once it has begun."""
        return (self.first or 0) + len(self.samples) + sum(length for _, length in self.gaps)

    def place(self, frame: float) -> float:
        """Return the sound's frame at a frame of the stream."""
        lost = sum(min(max(frame - start, 0.0), length) for start, length in self.gaps)
        return min(frame - (self.first or 0) - lost, len(self.samples))


@dataclass(slots=True)
class Mixer:
    """Queue of mono 16-bit sounds, returned in buffers, with silence between and after them.

    Stateful.

    Parameters
    ----------
    sample_rate_hz : float
    """

    sample_rate_hz: float
    taken: int = 0
    """Frames that were returned, silence included."""
    _count: int = 0
    _waiting: deque[_Sound] = field(default_factory=deque)
    _known: dict[int, _Sound] = field(default_factory=dict)
    _is_paused: bool = False
    _ramp: int = 0
    """Remaining frames of a fade."""

    def add(self, samples: ArrayLike) -> int:
        """Queue a sound, (N,) int16; return its number."""
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
        """Return the next buffer, (frames,) int16."""
        buffer = np.zeros(frames, np.int16)
        sounding = min(self._ramp, frames) if self._is_paused else frames
        self._fill(buffer[:sounding])
        ramp = min(self._ramp, sounding)
        if ramp:
            left = np.arange(self._ramp, self._ramp - ramp, -1) / self._fade
            buffer[:ramp] = buffer[:ramp] * (left if self._is_paused else 1.0 - left)
            self._ramp -= ramp
        self.taken += sounding
        self._keep_silent(frames - sounding)
        return buffer

    def skip(self, frames: int) -> None:
        """Advance like :meth:`take` without a buffer; silence of any length costs nothing."""
        while frames and self._waiting and (self._ramp or not self._is_paused):
            piece = min(frames, SKIPPED)
            self.take(piece)
            frames -= piece
        self._ramp = max(self._ramp - frames, 0)
        self._keep_silent(frames)

    def pause(self, on: bool) -> None:
        """Pause, or resume; nothing is dropped."""
        if on != self._is_paused:
            self._is_paused, self._ramp = on, self._fade

    @property
    def _fade(self) -> int:
        return max(round(FADE_S * self.sample_rate_hz), 1)

    def _fill(self, buffer: Samples) -> None:
        filled = 0
        while filled < len(buffer) and self._waiting:
            sound = self._waiting[0]
            if sound.first is None:
                sound.first = self.taken + filled
            piece = sound.samples[sound.done : sound.done + len(buffer) - filled]
            buffer[filled : filled + len(piece)] = piece
            sound.done += len(piece)
            filled += len(piece)
            if sound.done == len(sound.samples):
                self._waiting.popleft()

    def _keep_silent(self, frames: int) -> None:
        sound = self._waiting[0] if self._waiting else None
        if sound is not None and sound.first is not None and frames:
            if sound.gaps and sum(sound.gaps[-1]) == self.taken:
                frames_before = sound.gaps[-1][1]
                sound.gaps[-1] = (sound.gaps[-1][0], frames_before + frames)
            else:
                sound.gaps.append((self.taken, frames))
        self.taken += frames

    def stop(self) -> None:
        """Drop every sound, see :meth:`drop`; a pause ends."""
        for number in list(self._known):
            self.drop(number)
        self._is_paused, self._ramp = False, 0

    def drop(self, sound: int) -> None:
        """Fade a sound out over :data:`FADE_S`, or never begin it; later sounds move up.

        Raises
        ------
        UsageError
            If there is no sound of that number.
        """
        entry = self._find(sound)
        if entry is None or entry not in self._waiting:
            return
        if entry.first is None:
            del self._known[sound]
            self._waiting.remove(entry)
            return
        tail = entry.samples[entry.done : entry.done + (0 if self._is_paused else self._fade)]
        faded = tail * np.linspace(1.0, 0.0, len(tail), endpoint=False)
        entry.samples = np.concatenate([entry.samples[: entry.done], faded.astype(np.int16)])
        if not len(tail):
            self._waiting.remove(entry)

    def position_s(self, sound: int, stream_s: float) -> float | None:
        """Return the position of a sound when the stream is at ``stream_s``, at most its end.

        Negative if it is fetched and not yet heard; None while it waits, or if it was dropped.

        Raises
        ------
        UsageError
            If there is no sound of that number.
        """
        entry = self._find(sound)
        if entry is None or entry.first is None:
            return None
        return entry.place(stream_s * self.sample_rate_hz) / self.sample_rate_hz

    def is_over(self, sound: int, stream_s: float) -> bool:
        """Return whether a sound was heard to its end, or was dropped.

        Raises
        ------
        UsageError
            If there is no sound of that number.
        """
        entry = self._find(sound)
        return entry is None or (entry.first is not None and stream_s * self.sample_rate_hz >= entry.end - 0.5)

    def _find(self, number: int) -> _Sound | None:
        if not 1 <= number <= self._count:
            raise UsageError(f"sound: got {number}, expected 1 to {self._count}")
        return self._known.get(number)
