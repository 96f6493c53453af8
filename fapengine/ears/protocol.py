"""What an ear is: sound in, phones out, as it comes; and an ear whose answers come later, from a process of its own."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine.speech.phone_track import Phone

RATE_HZ = 16_000
"""Samples a second that every ear takes; :func:`fapengine.files.sound.stream_sound` makes them of any file."""


class Ear(Protocol):
    """Anything that hears phones. Stateful: it remembers the sound of one utterance."""

    look_ahead_s: float
    """Time behind the sound before which no phone is told: it may still change."""

    def push(self, samples: NDArray[np.int16]) -> list[Phone]:
        """Hear more sound; return the phones that are certain now.

        Parameters
        ----------
        samples : (N,) int16
            At :data:`RATE_HZ`, mono; pieces of any length give the same phones.

        Returns
        -------
        list of Phone
            Those that follow the ones told before, without holes, silence included. Their times count from the first
            sample since the last :meth:`reset`; what is told stays. ``confidence`` says how sure it is.
        """
        ...

    def end(self) -> list[Phone]:
        """Say that the sound is over; return the rest."""
        ...

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        ...


@dataclass(frozen=True, slots=True)
class Heard:
    """What an ear has told of a stream."""

    stream: int
    position_s: float
    """Length of the stream's sound that was heard."""
    phones: tuple[Phone, ...] = ()
    """Phones that follow those told before; times count from the stream's first sample."""
    is_over: bool = False
    """True when the stream's end was heard."""


class StreamEar(Protocol):
    """An ear that is given sound of any rate and asked later what it heard; none of its methods waits. Stateful."""

    is_ready: bool
    """True when it is there; sound that comes before is kept."""
    look_ahead_s: float
    """Time behind the sound at which its phones are told; known when it is ready."""
    waiting_s: float
    """Length of sound that was not heard yet."""

    def begin(self) -> int:
        """Forget what was not heard yet, and begin a stream; returns its number."""
        ...

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add sound to the stream: (N,) int16, mono; ``rate_hz`` is the same in all of a stream."""
        ...

    def end(self) -> None:
        """Say that the stream is over."""
        ...

    def poll(self) -> list[Heard]:
        """Return what was told of this stream since the last call; ``ResourceError`` if the ear has ended."""
        ...

    def close(self) -> None:
        """End it."""
        ...
