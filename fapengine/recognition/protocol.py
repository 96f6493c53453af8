"""Interfaces of recognizers: audio in, phones out, as a stream; and the final phones of a changing hypothesis."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine.speech.phone_track import SILENCE, Phone

RATE_HZ = 16_000
"""Sample rate of every recognizer's input; :func:`fapengine.files.sound.stream_sound` converts any file to it."""
FRAME_HZ = 100
"""Frames of 10 ms, in which recognizers count."""
UNSURE = 0.5
"""Confidence of phones that are found without a text: they are not judged one by one."""


class Recognizer(Protocol):
    """Finds phones in audio. Stateful: it keeps the audio of one utterance."""

    look_ahead_s: float
    """Least delay of a final phone after its audio."""
    partial: list[Phone]
    """Phones after the final ones, up to the audio's end as far as it was decoded: the best path at the moment, without
    gaps. They may still change; the last one is not over yet."""

    def push(self, samples: NDArray[np.int16]) -> list[Phone]:
        """Process more audio; return the phones that are final now.

        Parameters
        ----------
        samples : (N,) int16
            At :data:`RATE_HZ`, mono; pieces of any length give the same phones.

        Returns
        -------
        list of Phone
            The next ones, without gaps, silence included. Their times count from the first sample since the last
            :meth:`reset`.
        """

    def end(self) -> list[Phone]:
        """End the audio; return the rest of its phones."""

    def reset(self) -> None:
        """Start again: the next sample is the first."""

    def reduce_work(self, is_wanted: bool) -> bool:
        """Leave out the costly part of the work from now on, or no longer; return whether it is left out."""


class BlockRecognizer:
    """Base of the built-in recognizers, which process blocks of audio: pieces of any length give the same phones."""

    _block: int
    """Samples of a block."""
    _waiting: NDArray[np.int16]
    """Samples of an incomplete block."""
    _came: int
    """Samples so far."""
    partial: list[Phone]
    """See :class:`Recognizer`."""

    def push(self, samples: NDArray[np.int16]) -> list[Phone]:
        """Process more audio; see :meth:`Recognizer.push`."""
        self._came += len(samples)
        self._waiting = np.concatenate([self._waiting, np.asarray(samples, dtype=np.int16)])
        phones: list[Phone] = []
        while len(self._waiting) >= self._block:
            block, self._waiting = self._waiting[: self._block], self._waiting[self._block :]
            phones += self._process(block)
        return phones

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        self._waiting = np.zeros(0, np.int16)
        self._came = 0
        self.partial = []

    def reduce_work(self, is_wanted: bool) -> bool:
        """Return False: it has no part that can be left out."""
        return False

    def _process(self, block: NDArray[np.int16]) -> list[Phone]:
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class RecognizedPhones:
    """Results of a recognizer for a stream."""

    stream: int
    position_s: float
    """Length of the stream's audio that was processed."""
    phones: tuple[Phone, ...] = ()
    """Phones after those returned before; times count from the stream's first sample."""
    is_over: bool = False
    """True when the stream's end was processed."""
    partial: tuple[Phone, ...] = ()
    """Phones after these that may still change; each result replaces those of the one before."""
    skipped_s: float = 0.0
    """Length of audio that was skipped to keep up; the phone at that place lasts longer."""
    is_reduced: bool = False
    """True if the recognizer left out its costly part to keep up."""


class StreamRecognizer(Protocol):
    """A recognizer for audio of any rate, with results to poll; no method waits. Stateful."""

    is_ready: bool
    """True when it has started; earlier audio is kept."""
    look_ahead_s: float
    """Delay of phones after their audio; known when it is ready."""
    waiting_s: float
    """Length of audio that was not processed yet."""

    def begin(self) -> int:
        """Drop audio that was not processed yet, and begin a stream; returns its number."""

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add audio to the stream: (N,) int16, mono; ``rate_hz`` is constant within a stream."""

    def end(self) -> None:
        """End the stream."""

    def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
        """Return the new results of this stream; raises ``ResourceError`` if the recognizer has ended.

        ``shown_s`` is the time in the stream that the face shows now; a recognizer that is later does less work.
        """

    def close(self) -> None:
        """Close it."""


MIN_FRAMES = 3
"""Shortest phone of the models, in frames of 10 ms; a shorter one is joined to the next."""

Labelled = tuple[str, int, int]
"""A label, its first frame and the one after its last."""


def phones_of(segments: Iterable[Labelled], start_s: float, end_s: float) -> list[Phone]:
    """Turn frames that count from ``start_s`` into phones that end by ``end_s``.

    Examples
    --------
    >>> phones_of([("m", 0, 8)], 1.0, 1.05)
    [Phone(label='m', start_s=1.0, end_s=1.05, stress=0, word='', confidence=0.5, loudness_db=0.0)]
    """
    return [
        Phone(
            label,
            start_s + first / FRAME_HZ,
            min(start_s + end / FRAME_HZ, end_s),
            confidence=1.0 if label == SILENCE else UNSURE,
        )
        for label, first, end in segments
        if start_s + first / FRAME_HZ < end_s
    ]


def due(segments: Sequence[Labelled], reported: int, horizon: int, *, at_end: bool = False) -> list[Labelled]:
    """Choose the segments of a new hypothesis that are final now.

    Parameters
    ----------
    segments : sequence of (label, first, end)
        The whole hypothesis, in order and without gaps; ``end`` is the frame after the last.
    reported : int
        First frame that has not been reported. Earlier frames stay as reported, also if the hypothesis has changed.
    horizon : int
        Frame up to which the hypothesis is old enough. Silence is reported up to there; phones when they are over.
    at_end : bool
        Nothing follows, so everything is final.

    Returns
    -------
    list of (label, first, end)
        Without gaps, from ``reported`` on.

    Examples
    --------
    >>> due([("m", 0, 8), ("a", 8, 20), ("_", 20, 50)], 8, 40)
    [('a', 8, 20), ('_', 20, 40)]
    >>> due([("b", 0, 9), ("a", 9, 30)], 8, 15), due([("b", 0, 9), ("a", 9, 10)], 8, 10)
    ([], [('a', 8, 10)])
    """
    chosen: list[Labelled] = []
    now = reported
    for label, _, end in segments:
        if end <= now:
            continue
        if end > horizon and not at_end:
            if label == SILENCE and horizon - now >= MIN_FRAMES:
                chosen.append((label, now, horizon))
            break
        if end - now < MIN_FRAMES and end < segments[-1][2] and not at_end:
            continue  # the next begins earlier
        chosen.append((label, now, end))
        now = end
    return chosen
