"""A recognizer that needs no text: PocketSphinx's phone loop, on a stream or on a whole recording."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.recognition.loudness import FRAME_HZ, HOP, loudness_db, pitch_hz, spoken_frames
from fapengine.recognition.protocol import RATE_HZ, BlockRecognizer, due, phones_of
from fapengine.recognition.sphinx import Frames, frames_of, ipa_of, new_phone_loop
from fapengine.speech.phone_track import SILENCE, Phone

LOOK_AHEAD_S = 0.2
"""Look-ahead that costs nothing (``bench/recognizers.py``: 100 ms cost .02 of r, 150 ms none). Its blocks are 60 ms
longer than those of the small recognizer, so a live face is 50 ms later (``host/hearing.py``)."""
BLOCK = 8 * HOP
"""Samples between two readings of the hypothesis, 80 ms: a reading costs more than decoding."""
UTTERANCE_S = 8.0
"""Length of an utterance after which a pause ends it internally; the cost of a reading grows with the utterance."""
MAX_UTTERANCE_S = 20.0
"""Length that ends an utterance even without a pause."""
PAUSE_S = 0.3
FIRST_MEAN_S, MEAN_OF_S = 0.4, 8.0
"""Length of audio after which the mean spectrum is measured first, and longest audio for one measurement."""
_CONTEXT = 2
"""Frames at the end of the audio without a pitch yet."""


class SphinxRecognizer(BlockRecognizer):
    """PocketSphinx's phone loop as a :class:`.protocol.Recognizer`. Stateful.

    Music and noise are silence (:func:`.loudness.spoken_frames`), and so are whispers.

    Parameters
    ----------
    look_ahead_s : float
        Delay of phones after their audio, 0.05 to 1 s; they come at most one block (80 ms) later.

    Examples
    --------
    >>> recognizer = SphinxRecognizer()
    >>> phones = recognizer.push(np.zeros(16_000, np.int16)) + recognizer.end()
    >>> {phone.label for phone in phones}, phones[-1].end_s
    ({'_'}, 1.0)
    """

    _block = BLOCK

    def __init__(self, look_ahead_s: float = LOOK_AHEAD_S) -> None:
        if not 0.05 <= look_ahead_s <= 1.0:
            raise UsageError(f"look_ahead_s: must be 0.05 to 1, got {look_ahead_s}")
        self.look_ahead_s = look_ahead_s
        self._loop = new_phone_loop()
        self._meter = new_phone_loop()
        """Decoder that computes features only, to measure the mean spectrum."""
        self._first_mean = self._loop.get_cmn()
        self._begun = False
        self.reset()

    def end(self) -> list[Phone]:
        """End the audio; return the rest of its phones."""
        if len(self._waiting):
            self._feed(self._waiting)
            self._waiting = self._waiting[:0]
        return self._close()

    def skip(self, count: int) -> None:
        """Leave out samples, whole frames; the utterance ends, and phones that were not reported are dropped."""
        self.end()
        self._passed += count
        self._came += count

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        super().reset()
        if self._begun:
            self._loop.end_utt()
        self._begun = False
        self._loop.set_cmn(self._first_mean)
        self._sound = self._recent = np.zeros(0, np.int16)
        self._pitch = np.zeros(0)
        self._fed = self._measured = 0
        """Samples so far, and at the last measurement of the mean spectrum."""
        self._passed = 0
        """Samples of the utterances before this one."""
        self._reported = 0
        """Frames of this utterance that were reported."""
        self._found: list[Frames] = []
        """Hypothesis after the last block."""

    def hypothesis(self) -> list[Frames]:
        """Return the phones of this utterance up to the last block, in IPA without gaps; they may still change."""
        before = self._passed // HOP
        return [(label, before + a, before + b) for label, a, b in self._found] if self._begun else []

    def _process(self, block: NDArray[np.int16]) -> list[Phone]:
        self._feed(block)
        now = len(self._sound) // HOP
        segments = self._found = self._segments()
        phones = self._report(due(segments, self._reported, now - round(self.look_ahead_s * FRAME_HZ)))
        self.partial = self._phones(due(segments, self._reported, now))
        length_s = now / FRAME_HZ
        label, first, end = segments[-1] if segments else (SILENCE, 0, now)
        paused = label == SILENCE and end - first >= (PAUSE_S + self.look_ahead_s) * FRAME_HZ
        if (length_s > UTTERANCE_S and paused) or length_s > MAX_UTTERANCE_S:
            phones += self._close()
        return phones

    def _feed(self, block: NDArray[np.int16]) -> None:
        if not self._begun:
            self._loop.start_utt()
            self._begun = True
        self._loop.process_raw(block.tobytes())
        self._measure_mean(block)
        self._sound = np.concatenate([self._sound, block])
        self._extend_pitch(keep=_CONTEXT)

    def _measure_mean(self, block: NDArray[np.int16]) -> None:
        """Measure the mean spectrum of the recent audio, at first often; the model subtracts it."""
        self._recent = np.concatenate([self._recent, block])[-round(MEAN_OF_S * RATE_HZ) :]
        self._fed += len(block)
        next_at = min(2 * self._measured, self._measured + round(MEAN_OF_S * RATE_HZ))
        if self._fed < max(next_at, FIRST_MEAN_S * RATE_HZ):
            return
        self._measured = self._fed
        self._meter.start_utt()
        self._meter.process_raw(self._recent.tobytes(), no_search=True, full_utt=True)
        self._meter.end_utt()
        self._loop.set_cmn(self._meter.get_cmn())

    def _extend_pitch(self, *, keep: int) -> None:
        """Find the pitch of the new frames, except the last ``keep``."""
        known, frames = len(self._pitch), -(-len(self._sound) // HOP)
        first = max(known - _CONTEXT, 0)
        fresh = pitch_hz(self._sound[first * HOP :])[known - first : frames - first - keep]
        self._pitch = np.concatenate([self._pitch, fresh])

    def _segments(self) -> list[Frames]:
        """Return the hypothesis in IPA, without gaps, from the utterance's first frame to now."""
        frames = -(-len(self._sound) // HOP)
        found = frames_of(self._loop.seg() or [])
        levels = loudness_db(self._sound)
        pitch = np.concatenate([self._pitch, np.zeros(max(frames - len(self._pitch), 0))])[:frames]
        return labelled(found, spoken_frames(found, pitch, levels))

    def _close(self) -> list[Phone]:
        """End the utterance and report all of it."""
        if not self._begun:
            return []
        self._loop.end_utt()
        self._extend_pitch(keep=0)
        phones = self._report(due(self._segments(), self._reported, 0, at_end=True))
        self.partial = []
        self._passed += len(self._sound)
        self._begun, self._reported = False, 0
        self._sound, self._pitch = self._sound[:0], self._pitch[:0]
        return phones

    def _report(self, chosen: Sequence[Frames]) -> list[Phone]:
        if chosen:
            self._reported = chosen[-1][2]
        return self._phones(chosen)

    def _phones(self, chosen: Sequence[Frames]) -> list[Phone]:
        return phones_of(chosen, self._passed / RATE_HZ, self._came / RATE_HZ)


def labelled(segments: Sequence[Frames], spoken: NDArray[np.bool_]) -> list[Frames]:
    """Turn segments into IPA without gaps; frames without speech are silence.

    Parameters
    ----------
    segments : sequence of Frames
        In the model's phones.
    spoken : (T,) bool
    """
    names: list[tuple[str, int]] = [(SILENCE, -1)] * len(spoken)
    for number, (name, start, end) in enumerate(segments):
        for frame in range(start, min(end, len(spoken))) if ipa_of(name) != SILENCE else ():
            if spoken[frame]:
                names[frame] = ipa_of(name), number
    found: list[Frames] = []
    for (label, _), group in groupby(enumerate(names), key=lambda entry: entry[1]):
        numbers = [frame for frame, _ in group]
        found.append((label, numbers[0], numbers[-1] + 1))
    return found
