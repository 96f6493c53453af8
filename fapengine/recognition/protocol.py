"""What a recognizer is: sound in, phones out, as it comes; and which phones of a changing hypothesis are final."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine.speech.phone_track import Phone

RATE_HZ = 16_000
"""Sample rate of every recognizer's input; :func:`fapengine.files.sound.stream_sound` converts any file to it."""


class Recognizer(Protocol):
    """Finds phones in sound. Stateful: it keeps the sound of one utterance."""

    look_ahead_s: float
    """Delay after the sound before which a phone is not reported, because it may still change."""

    def push(self, samples: NDArray[np.int16]) -> list[Phone]:
        """Process more sound; return the phones that are final now.

        Parameters
        ----------
        samples : (N,) int16
            At :data:`RATE_HZ`, mono; pieces of any length give the same phones.

        Returns
        -------
        list of Phone
            Those after the ones returned before, without holes, silence included. Their times count from the first
            sample since the last :meth:`reset`. ``confidence`` says how sure it is.
        """
        ...

    def end(self) -> list[Phone]:
        """End the sound; return the rest of its phones."""
        ...

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        ...


@dataclass(frozen=True, slots=True)
class RecognizedPhones:
    """What a recognizer has found in a stream."""

    stream: int
    position_s: float
    """Length of the stream's sound that was processed."""
    phones: tuple[Phone, ...] = ()
    """Phones after those returned before; times count from the stream's first sample."""
    is_over: bool = False
    """True when the stream's end was processed."""


class StreamRecognizer(Protocol):
    """A recognizer for sound of any rate, with results to poll; no method waits. Stateful."""

    is_ready: bool
    """True when it has started; earlier sound is kept."""
    look_ahead_s: float
    """Delay of phones after their sound; known when it is ready."""
    waiting_s: float
    """Length of sound that was not processed yet."""

    def begin(self) -> int:
        """Drop sound that was not processed yet, and begin a stream; returns its number."""
        ...

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add sound to the stream: (N,) int16, mono; ``rate_hz`` is the same in all of a stream."""
        ...

    def end(self) -> None:
        """End the stream."""
        ...

    def poll(self) -> list[RecognizedPhones]:
        """Return what was found in this stream since the last call; ``ResourceError`` if the recognizer has ended."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


MIN_FRAMES = 3
"""Shortest phone in frames of 10 ms, the shortest that the model can find; a shorter one goes to the next."""

Labelled = tuple[str, int, int]
"""A label, its first frame and the one after its last."""


def due(
    segments: Sequence[Labelled], told: int, horizon: int, *, silence: str, at_end: bool = False
) -> list[Labelled]:  # fmt: skip
    """Choose the segments of a new hypothesis that are final now.

    Parameters
    ----------
    segments : sequence of (label, first, behind)
        The whole hypothesis, in order and without holes; ``behind`` is the frame after the last.
    told : int
        First frame that has not been reported. Earlier frames stay as reported, whatever the hypothesis says now.
    horizon : int
        Frame up to which the hypothesis is old enough.
    silence : str
        Label of silence, which is reported as far as it reaches; other phones wait until they are over.
    at_end : bool
        Nothing follows, so everything is final.

    Returns
    -------
    list of (label, first, behind)
        Without holes, from ``told`` on.

    Examples
    --------
    >>> due([("m", 0, 8), ("a", 8, 20), ("_", 20, 50)], 8, 40, silence="_")
    [('a', 8, 20), ('_', 20, 40)]
    >>> due([("b", 0, 9), ("a", 9, 30)], 8, 15, silence="_")
    []
    """
    chosen: list[Labelled] = []
    now = told
    for label, _, behind in segments:
        if behind <= now:
            continue
        if behind > horizon and not at_end:
            if label == silence and horizon - now >= MIN_FRAMES:
                chosen.append((label, now, horizon))
            break
        if behind - now < MIN_FRAMES and not at_end:
            continue  # the next begins earlier
        chosen.append((label, now, behind))
        now = behind
    return chosen
