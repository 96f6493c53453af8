"""What an ear is: sound in, phones out, as it comes."""

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
