"""The audio of one session, block by block, in sync with its face.

Theory of operation
-------------------
The face leads: each clip knows its position at an engine time, an utterance's from the utterance itself, a microphone's
from the delay of its face. :meth:`Soundtrack.block` requests the position for every block and reads the clip there. A
small offset is corrected by reading up to :data:`SLEW` faster or slower; beyond :data:`LEAP_S` (after a seek or a
pause, or if another player leads the face) the clip is cross-faded to its new position. So audio is never farther than
that from the lips. Sample rates are converted by a windowed sinc of :data:`TAPS` samples.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from math import ceil, floor, inf

import numpy as np
from numpy.typing import NDArray

from fapengine.audio.sound_queue import SampleQueue
from fapengine.host.listeners import Place

RATE_HZ, BLOCK = 48_000, 960
"""Sample rate of the track, and samples of a block: 20 ms, as Opus has it."""
BLOCK_S = BLOCK / RATE_HZ
LEAP_S, SLEW = 0.02, 0.02
FADE = 240
"""Samples over which a clip fades in, out, or to a new position: 5 ms."""
KEPT_S = 0.1
"""Audio that an endless clip keeps before the position where it is read."""
AHEAD_S = 5.0
"""Audio of an endless clip that may wait; beyond it the oldest is dropped."""
TAPS, PHASES = 32, 1024

Samples = NDArray[np.int16]
Block = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class Clip:
    """Audio that may still grow, and the position that is read next. Stateful."""

    rate_hz: int
    position: Place
    is_endless: bool = False
    samples: SampleQueue = field(default_factory=SampleQueue)
    _next_s: float | None = None

    @property
    def length_s(self) -> float:
        """Time of the end of its last sample."""
        return self.samples.end / self.rate_hz

    def push(self, samples: Samples) -> None:
        """Append (N,) int16."""
        self.samples.push(samples)
        if self.is_endless:
            at_s = 0.0 if self._next_s is None else self._next_s
            before = floor(max(at_s - KEPT_S, self.length_s - AHEAD_S) * self.rate_hz)
            if before - self.samples.first > self.rate_hz // 2:  # not for every piece
                self.samples.forget(before)

    def block(self, start_s: float) -> Block | None:
        """Return the block at an engine time, (BLOCK,) float64; None if the clip has ended and faded out."""
        there_s = self.position(start_s)
        before_s, self._next_s = self._next_s, None
        if there_s is None or there_s == -inf:
            ends = there_s is None
            if before_s is None:
                return None if ends else np.zeros(BLOCK)
            return self._read(before_s) * _FALLING
        if before_s is None or abs(there_s - before_s) > LEAP_S:
            block = self._read(there_s) * _RISING
            if before_s is not None:
                block += self._read(before_s) * _FALLING
            self._next_s = there_s + BLOCK_S
            return block
        step_s = BLOCK_S + float(np.clip(there_s - before_s, -SLEW * BLOCK_S, SLEW * BLOCK_S))
        self._next_s = before_s + step_s
        return self._read(before_s, step_s)

    def _read(self, start_s: float, length_s: float = BLOCK_S) -> Block:
        """Return (BLOCK,) float64 from a time on, with silence outside the clip."""
        origin, kept = self.samples.first, self.samples.end - self.samples.first
        first, step = start_s * self.rate_hz - origin, length_s * self.rate_hz / BLOCK
        begin, end = floor(first) - TAPS // 2, ceil(first + step * BLOCK) + TAPS // 2 + 1
        if end <= 0 or begin >= kept:
            return np.zeros(BLOCK)
        window = self.samples.read(origin + begin, origin + end).astype(np.float64)
        return resampled(window, first - begin, step, BLOCK)


class Soundtrack:
    """All clips of a session, mixed. Stateful."""

    def __init__(self) -> None:
        self._clips: dict[object, Clip] = {}

    def __len__(self) -> int:
        return len(self._clips)

    def clip(
        self, key: object, rate_hz: int, position: Place, *, is_endless: bool = False, first_s: float = 0.0
    ) -> Clip:
        """Return a clip, or begin it at ``first_s``; another sample rate begins another clip."""
        clip = self._clips.get(key)
        if clip is None or clip.rate_hz != rate_hz:
            clip = self._clips[key] = Clip(rate_hz, position, is_endless, SampleQueue(round(first_s * rate_hz)))
        return clip

    def block(self, start_s: float) -> Samples:
        """Mix the clips from an engine time on: (BLOCK,) int16. Times increase by one block from call to call."""
        mixed = np.zeros(BLOCK)
        for key, clip in tuple(self._clips.items()):
            block = clip.block(start_s)
            if block is None:
                del self._clips[key]
            else:
                mixed += block
        return np.clip(np.rint(mixed), -32768, 32767).astype(np.int16)


def resampled(samples: NDArray[np.float64], first: float, step: float, count: int) -> Block:
    """Interpolate band-limited audio between its samples.

    Parameters
    ----------
    samples : (N,) float64
    first : float
        Position of the first value, in samples; there are :data:`TAPS` / 2 samples before and after all positions.
    step : float
        Samples from one position to the next; above 1, frequencies that would alias are removed.
    count : int

    Returns
    -------
    (count,) float64

    Examples
    --------
    >>> resampled(np.arange(50.0), 20.0, 0.5, 4).round(1).tolist()
    [20.0, 20.5, 21.0, 21.5]
    """
    places = first + step * np.arange(count)
    whole = np.floor(places).astype(np.intp)
    if step == 1.0 and first == whole[0]:
        return samples[whole[0] : whole[0] + count].copy()
    phase = np.rint((places - whole) * PHASES).astype(np.intp)
    table = _kernel(min(1.0, round(1.0 / step, 2)))
    taken = samples[whole[:, None] + np.arange(1 - TAPS // 2, TAPS // 2 + 1)]
    return np.asarray((taken * table[phase]).sum(axis=1))


@lru_cache
def _kernel(share: float = 1.0) -> NDArray[np.float64]:
    """Return weights of the samples around a position, (PHASES + 1, TAPS) float64, for a fraction of the band."""
    away = np.arange(1 - TAPS // 2, TAPS // 2 + 1) - np.linspace(0.0, 1.0, PHASES + 1)[:, None]
    weights = np.sinc(share * away) * np.cos(np.pi * np.clip(away / TAPS, -0.5, 0.5)) ** 2
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


_RISING: NDArray[np.float64] = np.minimum(np.arange(BLOCK) / FADE, 1.0)
_FALLING: NDArray[np.float64] = 1.0 - _RISING
