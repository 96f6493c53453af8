"""An ear that hears a syllable in every 0.2 s of any sound, and tells it as late as a real one does."""

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ResourceError
from fapengine.recognition.protocol import RecognizedPhones
from fapengine.speech.phone_track import Phone

BEHIND_S = 0.23
"""PocketSphinx's look-ahead, and a block."""
PHONE_S = 0.1


@dataclass(eq=False)
class TickingRecognizer:
    """Says ``ma ma ma``."""

    is_ready: bool = True
    look_ahead_s: float = BEHIND_S
    waiting_s: float = 0.0
    is_mute: bool = False
    behind_s: float = BEHIND_S
    guess: str = ""
    """Two labels of phones that may still change; they reach up to 0.1 s before the end of the sound."""
    is_dead: bool = False
    stream: int = 0
    heard_s: float = 0.0
    told: int = 0
    waiting: list[RecognizedPhones] = field(default_factory=list)

    def begin(self) -> int:
        self.stream, self.heard_s, self.told = self.stream + 1, 0.0, 0
        self.waiting.clear()
        return self.stream

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        self.heard_s += len(samples) / rate_hz
        self._tell(int((self.heard_s - self.behind_s) / PHONE_S), is_over=False)

    def end(self) -> None:
        self._tell(int(np.ceil(self.heard_s / PHONE_S)), is_over=True)

    def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
        if self.is_dead:
            raise ResourceError("ear: its process has ended")
        told, self.waiting = self.waiting, []
        return [] if self.is_mute else told

    def close(self) -> None:
        pass

    def _tell(self, until: int, *, is_over: bool) -> None:
        phones = tuple(
            Phone("ma"[n % 2], n * PHONE_S, min((n + 1) * PHONE_S, max(self.heard_s, n * PHONE_S + 1e-3)))
            for n in range(self.told, max(until, self.told))
        )
        self.told += len(phones)
        until_s = 0.0 if is_over or not self.guess else self.heard_s - 0.1
        partial = tuple(
            Phone(self.guess[n % 2], n * PHONE_S, min((n + 1) * PHONE_S, until_s))
            for n in range(self.told, int(np.ceil(until_s / PHONE_S)))
            if n * PHONE_S < until_s
        )
        self.waiting.append(RecognizedPhones(self.stream, self.heard_s, phones, is_over, partial))
