"""Queues of audio samples that arrive in pieces: by sample number, and by time in an utterance."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_ROUNDING = 1e-6
"""Error of sums of frame times, in samples."""


@dataclass(slots=True, eq=False)
class SampleQueue:
    """Mono samples that arrive in pieces and are read by number. Stateful."""

    first: int = 0
    """Number of the first sample that is kept."""
    _bytes: bytearray = field(default_factory=bytearray)

    @property
    def end(self) -> int:
        """Number after the last sample."""
        return self.first + len(self._bytes) // 2

    def push(self, samples: NDArray[np.int16]) -> None:
        """Add (N,) int16."""
        self._bytes += np.asarray(samples, "<i2").tobytes()

    def read(self, start: int, stop: int) -> NDArray[np.int16]:
        """Return samples ``start`` to ``stop``, (N,) int16; 0 for those that are not kept."""
        samples = np.zeros(max(stop - start, 0), np.int16)
        begin, end = max(start, self.first), min(stop, self.end)
        if end > begin:
            kept = np.frombuffer(self._bytes, "<i2", end - begin, 2 * (begin - self.first))
            samples[begin - start : end - start] = kept
        return samples

    def forget(self, before: int) -> None:
        """Drop the samples before a number."""
        del self._bytes[: 2 * (before - self.first)]
        self.first = before


@dataclass(frozen=True, slots=True, eq=False)
class Sound:
    """A piece of audio."""

    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    rate_hz: int

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self.samples) / self.rate_hz


@dataclass(slots=True, eq=False)
class Run:
    """A part of an utterance's audio that has one rate. Stateful."""

    rate_hz: int
    start_s: float
    """Time in the utterance of its first sample."""
    is_over: bool = False
    """True if no samples follow."""
    taken: int = 0
    """Samples that were returned."""
    is_heard: bool = False
    """True if the recognizer has reported all of it, or never will."""
    is_end_told: bool = False
    """True if the recognizer knows that it is over."""
    _samples: SampleQueue = field(default_factory=SampleQueue)
    _given: int = 0
    """Samples that the recognizer has."""

    @property
    def end_s(self) -> float:
        """Time in the utterance after its last sample."""
        return self.start_s + self._samples.end / self.rate_hz

    @property
    def position_s(self) -> float:
        """Time in the utterance of the next sample that is returned."""
        return self.start_s + self.taken / self.rate_hz

    def push(self, samples: NDArray[np.int16]) -> None:
        """Add (N,) int16."""
        self._samples.push(samples)

    def take(self, until_s: float) -> Sound | None:
        """Return the samples before a time in the utterance."""
        until = min(int((until_s - self.start_s) * self.rate_hz + _ROUNDING), self._samples.end)
        if until <= self.taken:
            return None
        samples, self.taken = self._samples.read(self.taken, until), until
        done = min(self.taken, self._samples.end if self.is_heard else self._given)
        if done - self._samples.first > self.rate_hz:
            self._samples.forget(done)
        return Sound(samples, self.rate_hz)

    def unheard(self) -> NDArray[np.int16]:
        """Return the samples that the recognizer does not have yet, (N,) int16."""
        samples, self._given = self._samples.read(self._given, self._samples.end), self._samples.end
        return samples


@dataclass(slots=True, eq=False)
class SoundQueue:
    """The audio of one utterance, in runs. Stateful."""

    runs: list[Run] = field(default_factory=list)
    due_s: float = 0.0
    """Time in the utterance of the last frame that was shown."""

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add (N,) int16; another rate begins another run."""
        run = self.runs[-1] if self.runs else None
        if run is None or run.is_over or run.rate_hz != rate_hz:
            self.close()
            run = Run(rate_hz, self.end_s)
            self.runs.append(run)
        run.push(samples)

    def close(self) -> None:
        """End the current run."""
        if self.runs:
            self.runs[-1].is_over = True

    @property
    def is_over(self) -> bool:
        """Whether all that arrived is complete, until more arrives."""
        return not self.runs or self.runs[-1].is_over

    @property
    def end_s(self) -> float:
        """Length of the audio that arrived."""
        return self.runs[-1].end_s if self.runs else 0.0

    @property
    def position_s(self) -> float:
        """Length of the audio that was returned."""
        return max((run.position_s for run in self.runs if run.taken), default=0.0)

    def take(self, dt_s: float) -> tuple[Sound, ...]:
        """Return the audio of the next ``dt_s``: one piece per run."""
        self.due_s += dt_s
        sounds = [sound for run in self.runs if (sound := run.take(self.due_s)) is not None]
        self.due_s = min(self.due_s, self.end_s)
        return tuple(sounds)
