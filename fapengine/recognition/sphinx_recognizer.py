"""A recognizer that needs no text: PocketSphinx's phone loop, on a stream or on a whole recording."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.recognition.loudness import FRAME_HZ, HOP, loudness_db, pitch_hz
from fapengine.recognition.protocol import RATE_HZ, due
from fapengine.recognition.speechlike import spoken_frames
from fapengine.recognition.sphinx import Frames, frames_of, ipa_of, new_phone_loop
from fapengine.speech.phone_track import SILENCE, Phone

LOOK_AHEAD_S = 0.15
"""Look-ahead that costs nothing (``bench/ears.py``: 100 ms cost .02 of r, 200 ms gain nothing)."""
BLOCK = 8 * HOP
"""Samples between two looks at the hypothesis, 80 ms: a look costs more than decoding."""
UTTERANCE_S = 8.0
"""Length of an utterance after which a pause ends it internally; the cost of a look grows with the utterance."""
MAX_UTTERANCE_S = 20.0
"""Length that ends an utterance even without a pause."""
PAUSE_S = 0.3
FIRST_MEAN_S, MEAN_OF_S = 0.4, 8.0
"""Length of sound after which the mean spectrum is measured first, and most sound that it is measured of."""
UNSURE = 0.5
"""Confidence of phones that are found without a text: they are not judged one by one."""
_CONTEXT = 2
"""Frames at the end of the sound whose pitch is not known yet."""


class SphinxRecognizer:
    """Hears phones in sound alone; see :class:`.protocol.Recognizer`. Stateful.

    Parameters
    ----------
    look_ahead_s : float
        Delay of phones after their sound, 0.05 to 1 s; they come at most one block (80 ms) later.
    only_speech : bool
        Report music and noise as silence (:mod:`.speechlike`). False also finds whispers.

    Examples
    --------
    >>> recognizer = SphinxRecognizer()
    >>> told = recognizer.push(np.zeros(16_000, np.int16)) + recognizer.end()
    >>> {phone.label for phone in told}, told[-1].end_s
    ({'_'}, 1.0)
    """

    def __init__(self, look_ahead_s: float = LOOK_AHEAD_S, *, only_speech: bool = True) -> None:
        if not 0.05 <= look_ahead_s <= 1.0:
            raise UsageError(f"look_ahead_s: must be 0.05 to 1, got {look_ahead_s}")
        self.look_ahead_s = look_ahead_s
        self._only_speech = only_speech
        self._loop = new_phone_loop()
        self._meter = new_phone_loop()
        """Takes features alone, to measure the mean spectrum."""
        self._first_mean = self._loop.get_cmn()
        self._recent = np.zeros(0, np.int16)
        self._total = self._measured = 0
        self._heard = False
        self._waiting = np.zeros(0, np.int16)
        self._sound = np.zeros(0, np.int16)
        self._pitch = np.zeros(0)
        self._passed = 0
        """Samples of the utterances before this one."""
        self._told = 0
        """Frames of this utterance that were reported."""

    def push(self, samples: NDArray[np.int16]) -> list[Phone]:
        """Hear more sound; see :meth:`.protocol.Recognizer.push`."""
        self._waiting = np.concatenate([self._waiting, np.asarray(samples, dtype=np.int16)])
        phones: list[Phone] = []
        while len(self._waiting) >= BLOCK:
            block, self._waiting = self._waiting[:BLOCK], self._waiting[BLOCK:]
            phones += self._hear(block)
        return phones

    def end(self) -> list[Phone]:
        """End the sound; return the rest of its phones."""
        phones: list[Phone] = []
        total = self._passed + len(self._sound) + len(self._waiting)
        if len(self._waiting):
            self._feed(self._waiting)
            self._waiting = self._waiting[:0]
        phones += self._close()
        self._waiting = self._waiting[:0]
        end_s = total / RATE_HZ
        if phones and phones[-1].end_s > end_s > phones[-1].start_s:  # a last frame may be a part of one
            last = phones[-1]
            phones[-1] = Phone(last.label, last.start_s, end_s, confidence=last.confidence)
        return phones

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        if self._heard:
            self._loop.end_utt()
        self._heard = False
        self._loop.set_cmn(self._first_mean)
        self._waiting, self._sound, self._pitch = self._waiting[:0], self._sound[:0], self._pitch[:0]
        self._passed = self._told = 0
        self._recent = self._recent[:0]
        self._total = self._measured = 0

    def hypothesis(self) -> list[Frames]:
        """Return the phones of this utterance, in IPA without holes; they may still change."""
        before = self._passed // HOP
        return [(label, before + a, before + b) for label, a, b in self._segments()] if self._heard else []

    def _hear(self, block: NDArray[np.int16]) -> list[Phone]:
        self._feed(block)
        now = len(self._sound) // HOP
        segments = self._segments()
        phones = self._tell(due(segments, self._told, now - self._ahead, silence=SILENCE))
        length_s = now / FRAME_HZ
        label, first, behind = segments[-1] if segments else (SILENCE, 0, now)
        paused = label == SILENCE and behind - first >= (PAUSE_S + self.look_ahead_s) * FRAME_HZ
        if (length_s > UTTERANCE_S and paused) or length_s > MAX_UTTERANCE_S:
            phones += self._close()
        return phones

    @property
    def _ahead(self) -> int:
        return round(self.look_ahead_s * FRAME_HZ)

    def _feed(self, block: NDArray[np.int16]) -> None:
        if not self._heard:
            self._loop.start_utt()
            self._heard = True
        self._loop.process_raw(block.tobytes())
        self._follow_the_voice(block)
        self._sound = np.concatenate([self._sound, block])
        self._extend_pitch(keep=_CONTEXT)

    def _follow_the_voice(self, block: NDArray[np.int16]) -> None:
        """Measure the mean spectrum of what came so far, soon and then less often; the model subtracts it."""
        self._recent = np.concatenate([self._recent, block])[-round(MEAN_OF_S * RATE_HZ) :]
        self._total += len(block)
        due = min(2 * self._measured, self._measured + round(MEAN_OF_S * RATE_HZ))
        if self._total < max(due, FIRST_MEAN_S * RATE_HZ):
            return
        self._measured = self._total
        self._meter.start_utt()
        self._meter.process_raw(self._recent.tobytes(), no_search=True, full_utt=True)
        self._meter.end_utt()
        self._loop.set_cmn(self._meter.get_cmn())

    def _extend_pitch(self, *, keep: int) -> None:
        """Find the pitch of the frames that came; of the last ``keep`` it is not known yet."""
        known, frames = len(self._pitch), -(-len(self._sound) // HOP)
        first = max(known - _CONTEXT, 0)
        fresh = pitch_hz(self._sound[first * HOP :])[known - first : frames - first - keep]
        self._pitch = np.concatenate([self._pitch, fresh])

    def _segments(self) -> list[Frames]:
        """Return the hypothesis in IPA, without holes, from the utterance's first frame to now."""
        frames = -(-len(self._sound) // HOP)
        found = frames_of(self._loop.seg() or [])
        levels = loudness_db(self._sound)
        pitch = np.concatenate([self._pitch, np.zeros(max(frames - len(self._pitch), 0))])[:frames]
        spoken = spoken_frames(found, pitch, levels) if self._only_speech else None
        return labelled(found, frames, spoken)

    def _close(self) -> list[Phone]:
        """End the utterance and report all of it."""
        if not self._heard:
            return []
        self._loop.end_utt()
        self._extend_pitch(keep=0)
        phones = self._tell(due(self._segments(), self._told, 0, silence=SILENCE, at_end=True))
        self._passed += len(self._sound)
        self._heard, self._told = False, 0
        self._sound, self._pitch = self._sound[:0], self._pitch[:0]
        return phones

    def _tell(self, chosen: Sequence[Frames]) -> list[Phone]:
        if chosen:
            self._told = chosen[-1][2]
        start_s = self._passed / RATE_HZ
        return [
            Phone(label, start_s + a / FRAME_HZ, start_s + b / FRAME_HZ, confidence=1.0 if label == SILENCE else UNSURE)
            for label, a, b in chosen
        ]


def labelled(segments: Sequence[Frames], frames: int, spoken: NDArray[np.bool_] | None) -> list[Frames]:
    """Turn segments into IPA without holes; frames without speech are silence.

    Parameters
    ----------
    segments : sequence of Frames
        In the model's phones.
    spoken : (T,) bool, optional
        By default all phones are.
    """
    names: list[tuple[str, int]] = [(SILENCE, -1)] * frames
    for number, (name, start, end) in enumerate(segments):
        label = ipa_of(name)
        if label != SILENCE:
            for frame in range(start, min(end, frames)):
                if spoken is None or spoken[frame]:
                    names[frame] = label, number
    found: list[Frames] = []
    for (label, _), group in groupby(enumerate(names), key=lambda entry: entry[1]):
        numbers = [frame for frame, _ in group]
        found.append((label, numbers[0], numbers[-1] + 1))
    return found
