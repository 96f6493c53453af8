"""What a voice is: text in, sound and the times of its phones out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.speech.phone_track import PhoneTrack


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Speech:
    """One spoken utterance."""

    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    sample_rate_hz: int
    phones: PhoneTrack
    """IPA; covers the whole sound, silence included."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", frozen(self.samples, "samples", ("N",), np.int16))
        if self.sample_rate_hz <= 0:
            raise UsageError(f"sample_rate_hz: got {self.sample_rate_hz}, expected a positive number")

    @property
    def duration_s(self) -> float:
        """Length of the sound in seconds."""
        return len(self.samples) / self.sample_rate_hz


class Voice(Protocol):
    """Anything that speaks and knows when each phone sounds."""

    def speak(self, text: str) -> Speech:
        """Speak ``text``.

        Raises
        ------
        UsageError
            If there is nothing to speak.
        ResourceError
            If the voice cannot be loaded on this machine.
        """
        ...
