"""A recognizer without a process, for tests that count frames and not time."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition.process import _Stream
from fapengine.recognition.protocol import RecognizedPhones, Recognizer


class DirectRecognizer:
    """A recognizer of this process as a ``StreamRecognizer``; :meth:`push` waits for it. Stateful."""

    def __init__(self, recognizer: Recognizer) -> None:
        self.is_ready, self.look_ahead_s, self.waiting_s = True, recognizer.look_ahead_s, 0.0
        self._recognizer = recognizer
        self._number = 0
        self._stream: _Stream | None = None
        self._told: list[RecognizedPhones] = []

    def begin(self) -> int:
        """Begin a stream."""
        self._number += 1
        self._stream = None
        self._told.clear()
        return self._number

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Process audio, (N,) int16."""
        self._stream = self._stream or _Stream(self._recognizer, self._number, rate_hz)
        self._told.append(self._stream.push(samples))

    def end(self) -> None:
        """End the stream."""
        self._told.append(
            self._stream.push(None) if self._stream else RecognizedPhones(self._number, 0.0, is_over=True)
        )
        self._stream = None

    def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
        """Return the new results."""
        found, self._told = self._told, []
        return found

    def close(self) -> None:
        """Do nothing."""
