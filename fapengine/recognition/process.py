"""A recognizer in a child process (:mod:`fapengine._child`), so that frames do not wait for it.

Theory of operation
-------------------
PocketSphinx holds Python's lock while it works, 20 ms for 80 ms of audio and more on a busy machine; a face shows a
frame every 17 ms. So it runs in another process, and neither end of :class:`RecognizerProcess` waits for the other.
Audio that was not sent to the process yet (all but :data:`AHEAD_S`) stays here, so it can be dropped at once.

A live face shows audio a fixed delay later. Where the machine is too slow for that, phones would come when their time
is over, and the face would not move. So :meth:`RecognizerProcess.poll` compares what was processed with what the face
shows. If it was late in :data:`PATIENCE` polls in a row, the recognizer leaves out its costly part for
:data:`REDUCED_S`. If that is not enough, audio that is about to be shown is skipped: what follows continues what came
before, and the phone at that place lasts longer.

A message to the child has the stream's number, the rate in Hz, whether to leave out the costly part, and int16 samples,
little-endian, or the number of samples that are skipped; a rate of 0 ends the stream. A message back is a
:class:`.protocol.RecognizedPhones`; the first one gives the recognizer's look-ahead. A new stream number drops the
stream before.
"""

from bisect import bisect
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from math import inf
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._child import Child, Head, Message, Parent, command
from fapengine.recognition.choice import check_installed, new_recognizer
from fapengine.recognition.loudness import RunningSoundings
from fapengine.recognition.protocol import RATE_HZ, RecognizedPhones, Recognizer
from fapengine.speech.phone_track import Phone
from fapengine.speech.prosody import RunningProsody

AHEAD_S = 0.5
"""Length of audio that is sent ahead of the process."""
LIVE_AHEAD_S = 0.1
"""The same where the face shows audio as soon as this: what was sent cannot be skipped."""
SLOW_AHEAD_S = 0.04
"""The same for a recognizer that is late."""
PIECE_S = 0.08
"""Longest piece of audio that is sent at a time."""
LEAD_S = 0.1
"""Least time from what the face shows to what was processed; phones need it to shape the lips before them."""
SKIP_LEAD_S, LEAD_AFTER_S = 0.07, 0.2
"""Lead under which audio is skipped, and up to which."""
USUAL_S = 0.05
"""Length of audio that waits in a poll although the recognizer keeps up."""
PATIENCE = 6
"""Polls with less lead, in a row, after which a recognizer is too slow: late packets of a network are fewer."""
PATIENCE_AGAIN = 2
"""The same after audio was skipped."""
GRACE = 30
"""The same at the beginning of a stream, when audio has waited for the process to start."""
REDUCED_S = 8.0
"""Length of audio for which the costly part is left out, before it is tried again."""


@dataclass(slots=True, eq=False)
class RecognizerProcess:
    """The parent's end of a recognizer process; opened by :meth:`open`. Stateful.

    Nothing here waits; call :meth:`poll` about once a frame.
    """

    child: Child
    is_ready: bool = False
    """True when the recognizer has started; earlier audio is kept."""
    look_ahead_s: float = 0.0
    """Delay of phones after their audio; known when it is ready."""
    waiting_s: float = 0.0
    """Length of audio that was not processed yet."""
    stream: int = 0
    """Number of the current stream; 0 before the first."""
    _pieces: deque[tuple[int, bytes]] = field(default_factory=deque)
    """Pieces of the stream that were not sent yet: rate in Hz, samples; rate 0: the end."""
    _sent_s: float = 0.0
    _processed_s: float = 0.0
    _late: int = 0
    """Polls in a row with too little lead, minus those that may have it."""
    _reduced_until_s: float = 0.0
    """Time in the stream up to which the costly part is left out."""

    @classmethod
    def open(cls, model: Path | None = None) -> "RecognizerProcess":
        """Start a process; it is ready after about a second.

        Parameters
        ----------
        model : Path, optional
            Name of a built-in recognizer, or file of a model (:mod:`.choice`).
        """
        check_installed(model)
        return cls(Child("recognizer", command(__name__, *([str(model)] if model else [])), waits=False))

    def begin(self) -> int:
        """Drop audio that was not processed yet, and begin a stream; returns its number."""
        self.stream += 1
        self._pieces.clear()
        is_slow = self._reduced_until_s > self._sent_s
        self.waiting_s = self._sent_s = self._processed_s = 0.0
        self._late, self._reduced_until_s = -GRACE, REDUCED_S if is_slow else 0.0
        return self.stream

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add audio to the stream: (N,) int16, mono; ``rate_hz`` is constant within a stream."""
        step = max(round(PIECE_S * rate_hz), 1)
        for start in range(0, len(samples), step):
            self._pieces.append((rate_hz, samples[start : start + step].astype("<i2").tobytes()))
        self.waiting_s += len(samples) / rate_hz

    def end(self) -> None:
        """End the stream."""
        self._pieces.append((0, b""))

    def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
        """Send audio as far as the process keeps up, and return the new results of this stream.

        Parameters
        ----------
        shown_s : float
            Time in the stream that the face shows now; -inf if it waits for the phones.
        """
        found = self._read()
        if self.is_ready:
            self._keep_up(shown_s)
            lead_s = self._processed_s - shown_s
            self._write(AHEAD_S if lead_s > AHEAD_S else LIVE_AHEAD_S if self._late <= 0 else SLOW_AHEAD_S)
        return found

    def close(self) -> None:
        """End the process; closing again does nothing."""
        self.child.close()

    def _keep_up(self, shown_s: float) -> None:
        if self.waiting_s < USUAL_S or self._processed_s - shown_s >= LEAD_S:
            self._late = 0
            return
        self._late += 1
        if self._late < PATIENCE:
            return
        self._reduced_until_s = self._sent_s + REDUCED_S
        if self._processed_s - shown_s < SKIP_LEAD_S:
            self._skip(shown_s + LEAD_AFTER_S)
            self._late = PATIENCE - PATIENCE_AGAIN

    def _skip(self, until_s: float) -> None:
        """Leave out pieces that were not sent and begin before a time in the stream."""
        count, rate = 0, 0
        while self._pieces and self._pieces[0][0] and self._sent_s < until_s:
            rate, samples = self._pieces.popleft()
            count += len(samples) // 2
            self._sent_s += len(samples) / 2 / rate
        if count:
            self._put(rate, skips=count)

    def _write(self, ahead_s: float) -> None:
        while self.child.flush():
            if not self._pieces or self._sent_s - self._processed_s > ahead_s:
                return
            rate_hz, samples = self._pieces.popleft()
            self._put(rate_hz, samples)
            self._sent_s += len(samples) / 2 / rate_hz if rate_hz else 0.0

    def _put(self, rate_hz: int, samples: bytes = b"", *, skips: int = 0) -> None:
        is_reduced = self._sent_s < self._reduced_until_s
        head = {"stream": self.stream, "rate_hz": rate_hz, "skips": skips, "is_reduced": is_reduced}
        self.child.put(head, samples)

    def _read(self) -> list[RecognizedPhones]:
        found = []
        for entry, _ in self.child.poll():
            if "look_ahead_s" in entry:
                self.is_ready, self.look_ahead_s = True, entry["look_ahead_s"]
            elif entry["stream"] == self.stream:
                phones = {name: tuple(Phone(**phone) for phone in entry[name]) for name in ("phones", "partial")}
                result = RecognizedPhones(**{**entry, **phones})
                self.waiting_s = max(self.waiting_s - (result.position_s - self._processed_s), 0.0)
                self._processed_s = result.position_s
                found.append(result)
        return found


# The process itself -------------------------------------------------------------------------------------------------


class _Stream:
    """One stream, resampled to the recognizer's rate. Stateful."""

    def __init__(self, recognizer: Recognizer, number: int, rate_hz: int) -> None:
        self.number, self._recognizer, self._rate_hz = number, recognizer, rate_hz
        self._came = 0
        """Samples that were not skipped."""
        self._cuts = [(0.0, 0.0)]
        """Times after which audio was skipped, in the audio without it, and the length skipped up to each."""
        self._prosody = RunningProsody()
        self._soundings = RunningSoundings()
        self._looked_at: list[Phone] = []
        """Phones of the recognizer that may still change, and the same with loudness and stress."""
        self._partial: list[Phone] = []
        self._resampler: Any = None
        if rate_hz != RATE_HZ:
            from av import AudioResampler

            self._resampler = AudioResampler(format="s16", layout="mono", rate=RATE_HZ)
        recognizer.reset()

    def push(self, samples: NDArray[np.int16] | None) -> RecognizedPhones:
        """Process samples, (N,) int16, or the end of the stream; adds loudness and stress to phones."""
        self._came += 0 if samples is None else len(samples)
        phones: list[Phone] = []
        for piece in self._resampled(samples):
            self._soundings.push(piece)
            phones += self._recognizer.push(piece)
        if samples is None:
            phones += self._recognizer.end()
            self._soundings.push(np.zeros(0, np.int16), is_last=True)
        if phones or self._recognizer.partial is not self._looked_at:
            self._looked_at = self._recognizer.partial
            partial = self._soundings.look(self._looked_at)
            phones, self._partial = self._prosody.push(phones, self._soundings.of(phones), self._looked_at, partial)
        found = RecognizedPhones(self.number, self._position_s, self._placed(phones), samples is None)
        return replace(found, partial=self._placed(self._partial))

    def skip(self, count: int) -> RecognizedPhones:
        """Leave out samples: what follows continues what came before, later."""
        skipped_s = count / self._rate_hz
        self._cuts.append((self._came / self._rate_hz, self._cuts[-1][1] + skipped_s))
        partial = self._placed(self._partial)
        return RecognizedPhones(self.number, self._position_s, partial=partial, skipped_s=skipped_s)

    @property
    def _position_s(self) -> float:
        return self._came / self._rate_hz + self._cuts[-1][1]

    def _placed(self, phones: list[Phone]) -> tuple[Phone, ...]:
        """Phones in the stream's time; one that contains a cut lasts longer."""

        def at_s(time_s: float) -> float:
            return time_s + self._cuts[bisect(self._cuts, time_s, key=itemgetter(0)) - 1][1]

        return tuple(replace(one, start_s=at_s(one.start_s), end_s=at_s(one.end_s)) for one in phones)

    def _resampled(self, samples: NDArray[np.int16] | None) -> list[NDArray[np.int16]]:
        if self._resampler is None:
            return [] if samples is None else [samples]
        frame = None
        if samples is not None:
            if not len(samples):
                return []
            from av import AudioFrame

            frame = AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
            frame.sample_rate = self._rate_hz
        return [out.to_ndarray()[0] for out in self._resampler.resample(frame)]


def answers(messages: Iterable[Message], recognizer: Recognizer) -> Iterator[Head]:
    """Answer the parent: first the look-ahead, then each message."""
    yield {"look_ahead_s": recognizer.look_ahead_s}
    stream: _Stream | None = None
    for head, data in messages:
        number = head["stream"]
        is_reduced = recognizer.reduce_work(head["is_reduced"])
        if head["rate_hz"]:
            if stream is None or stream.number != number:
                stream = _Stream(recognizer, number, head["rate_hz"])
            skips = head["skips"]
            found = stream.skip(skips) if skips else stream.push(np.frombuffer(data, "<i2").astype(np.int16))
            found = replace(found, is_reduced=is_reduced)
        elif stream is not None and stream.number == number:
            found, stream = stream.push(None), None
        else:
            found = RecognizedPhones(number, 0.0, is_over=True)
        yield asdict(found)


def main(parent: Parent, model: str | None = None) -> None:
    """Run the process."""
    for answer in answers(parent.messages(), new_recognizer(Path(model) if model else None)):
        parent.tell(answer)
