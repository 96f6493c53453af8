"""A recognizer in a child process (:mod:`fapengine._child`), so that frames do not wait for it.

Theory of operation
-------------------
PocketSphinx holds Python's lock while it works, 20 ms for 80 ms of audio and more on a busy machine; a face shows a
frame every 17 ms. So it runs in another process, and neither end of :class:`RecognizerProcess` waits for the other.
Audio that was not sent to the process yet (all but :data:`AHEAD_S`) stays here, so it can be dropped at once.

A message to the child has the stream's number and the rate in Hz, and int16 samples, little-endian; a rate of 0 ends
the stream. A message back is a :class:`.protocol.RecognizedPhones`; the first one gives the recognizer's look-ahead. A
new stream number drops the stream before.
"""

from collections import deque
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._child import Child, Parent, command
from fapengine.recognition.choice import check_installed, new_recognizer
from fapengine.recognition.loudness import RunningSoundings
from fapengine.recognition.protocol import RATE_HZ, RecognizedPhones, Recognizer
from fapengine.speech.phone_track import Phone
from fapengine.speech.prosody import RunningProsody

AHEAD_S = 0.5
"""Length of audio that is sent ahead of the process."""
PIECE_S = 0.08
"""Length of audio that is sent at a time: the recognizer's block."""


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
        self.waiting_s = self._sent_s = self._processed_s = 0.0
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

    def poll(self) -> list[RecognizedPhones]:
        """Send audio as far as the process keeps up, and return the new results of this stream."""
        found = self._read()
        self._write()
        return found

    def close(self) -> None:
        """End the process; closing again does nothing."""
        self.child.close()

    def _write(self) -> None:
        while self.is_ready and self.child.flush():
            if not self._pieces or self._sent_s - self._processed_s > AHEAD_S:
                return
            rate_hz, samples = self._pieces.popleft()
            self._sent_s += len(samples) / 2 / rate_hz if rate_hz else 0.0
            self.child.put({"stream": self.stream, "rate_hz": rate_hz}, samples)

    def _read(self) -> list[RecognizedPhones]:
        found = []
        for entry, _ in self.child.poll():
            if "look_ahead_s" in entry:
                self.is_ready, self.look_ahead_s = True, entry["look_ahead_s"]
            elif entry["stream"] == self.stream:
                told = {name: tuple(Phone(**phone) for phone in entry[name]) for name in ("phones", "partial")}
                result = RecognizedPhones(**{**entry, **told})
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
        self._prosody = RunningProsody()
        self._soundings = RunningSoundings()
        self._looked_at: list[Phone] = []
        """Phones of the recognizer that may still change, and the same with loudness and stress."""
        self._partial: tuple[Phone, ...] = ()
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
        phones = self._prosody.push(phones, self._soundings.of(phones))
        if self._recognizer.partial is not self._looked_at:
            self._looked_at = self._recognizer.partial
            self._partial = tuple(self._prosody.look(self._looked_at, self._soundings.look(self._looked_at)))
        position_s = self._came / self._rate_hz
        return RecognizedPhones(self.number, position_s, tuple(phones), samples is None, self._partial)

    def _resampled(self, samples: NDArray[np.int16] | None) -> list[NDArray[np.int16]]:
        if self._resampler is None:
            return [] if samples is None else [samples]
        frame = None
        if samples is not None:
            from av import AudioFrame

            frame = AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
            frame.sample_rate = self._rate_hz
        return [out.to_ndarray()[0] for out in self._resampler.resample(frame)]


def serve(parent: Parent, recognizer: Recognizer) -> None:
    """Process the parent's messages until they end."""
    parent.tell({"look_ahead_s": recognizer.look_ahead_s})
    stream: _Stream | None = None
    for head, data in parent.messages():
        number = head["stream"]
        if head["rate_hz"]:
            if stream is None or stream.number != number:
                stream = _Stream(recognizer, number, head["rate_hz"])
            found = stream.push(np.frombuffer(data, "<i2").astype(np.int16))
        elif stream is not None and stream.number == number:
            found, stream = stream.push(None), None
        else:
            found = RecognizedPhones(number, 0.0, is_over=True)
        parent.tell(asdict(found))


def main(parent: Parent, model: str | None = None) -> None:
    """Run the process."""
    serve(parent, new_recognizer(Path(model) if model else None))
