"""The sound of an utterance, as it comes and as it is handed out: to the sample, whatever its pieces and rates."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_ROUNDING = 1e-6
"""Share of a sample that sums of frame times may be off."""


@dataclass(frozen=True, slots=True, eq=False)
class Sound:
    """A piece of sound."""

    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    rate_hz: int

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self.samples) / self.rate_hz


@dataclass(slots=True, eq=False)
class Run:
    """A stretch of an utterance's sound that has one rate. Stateful."""

    rate_hz: int
    start_s: float
    """Time in the utterance of its first sample."""
    is_over: bool = False
    """True when nothing of it follows."""
    length: int = 0
    """Samples that came."""
    taken: int = 0
    """Samples that were handed out."""
    unheard: list[NDArray[np.int16]] = field(default_factory=list)
    """Pieces that the ear was not given yet."""
    is_heard: bool = False
    """True when its ear has told all of it, or will never."""
    is_end_told: bool = False
    """True when the ear knows that it is over."""
    _pieces: deque[NDArray[np.int16]] = field(default_factory=deque)

    @property
    def end_s(self) -> float:
        """Time in the utterance behind its last sample."""
        return self.start_s + self.length / self.rate_hz

    @property
    def position_s(self) -> float:
        """Time in the utterance of the next sample that is handed out."""
        return self.start_s + self.taken / self.rate_hz

    def push(self, samples: NDArray[np.int16]) -> None:
        """Take (N,) int16."""
        self.length += len(samples)
        self._pieces.append(samples)
        self.unheard.append(samples)

    def take(self, until_s: float) -> Sound | None:
        """Hand out what lies before a time in the utterance."""
        until = min(int((until_s - self.start_s) * self.rate_hz + _ROUNDING), self.length)
        count = until - self.taken
        if count <= 0:
            return None
        parts = []
        while count:
            piece = self._pieces.popleft()
            if len(piece) > count:
                self._pieces.appendleft(piece[count:])
            parts.append(piece[:count])
            count -= len(parts[-1])
        self.taken = until
        return Sound(np.concatenate(parts), self.rate_hz)


@dataclass(slots=True, eq=False)
class SoundQueue:
    """The sound of one utterance: runs, one behind the other. Stateful."""

    runs: list[Run] = field(default_factory=list)
    due_s: float = 0.0
    """Time in the utterance up to which frames were shown."""

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Take (N,) int16; another rate begins another run."""
        run = self.runs[-1] if self.runs else None
        if run is None or run.is_over or run.rate_hz != rate_hz:
            self.close()
            run = Run(rate_hz, self.end_s)
            self.runs.append(run)
        run.push(samples)

    def close(self) -> None:
        """Say that the run that comes is over."""
        if self.runs:
            self.runs[-1].is_over = True

    @property
    def is_over(self) -> bool:
        """Whether all that came is known to be whole, until more comes."""
        return not self.runs or self.runs[-1].is_over

    @property
    def end_s(self) -> float:
        """Length of what came."""
        return self.runs[-1].end_s if self.runs else 0.0

    @property
    def position_s(self) -> float:
        """Length of what was handed out."""
        return max((run.position_s for run in self.runs if run.taken), default=0.0)

    def take(self, dt_s: float) -> tuple[Sound, ...]:
        """Hand out the sound of the next ``dt_s``: one piece, or one of each run that it touches."""
        self.due_s += dt_s
        sounds = [sound for run in self.runs if (sound := run.take(self.due_s)) is not None]
        self.due_s = min(self.due_s, self.end_s)
        return tuple(sounds)
