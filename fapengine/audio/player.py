"""Player of the sounds of utterances, one after the other, each at its own rate, and the position of each."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.audio.output import Output

TELL_EVERY_S = 0.02
"""Interval between two reports of a sound's position."""
STILL_S = 0.1
"""Time without a change of its position after which a sound stands still; longer than a late callback."""
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
        """Return whether to report this position: at intervals while it moves, once when it stands still."""
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
