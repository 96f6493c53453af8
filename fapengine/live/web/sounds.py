"""Sounds that pages may still fetch: the last few of each session, none for ever."""

import io
import wave
from collections import OrderedDict
from dataclasses import dataclass, field

from fapengine.voices.protocol import Speech

MAX_BYTES = 64 << 20
"""Size of all sounds together, at two bytes a sample."""


@dataclass(slots=True)
class SoundCache:
    """A cache of spoken sounds; the oldest give way to newer ones.

    Stateful.
    """

    most_bytes: int = MAX_BYTES
    _kept: "OrderedDict[tuple[str, int], Speech]" = field(default_factory=OrderedDict)
    _bytes: int = 0

    def put(self, session: str, utterance: int, speech: Speech) -> None:
        """Keep a sound."""
        self._drop(session, utterance)
        self._kept[session, utterance] = speech
        self._bytes += speech.samples.nbytes
        while self._bytes > self.most_bytes and len(self._kept) > 1:
            self._drop(*next(iter(self._kept)))

    def wav(self, session: str, utterance: int) -> bytes | None:
        """Return it as a WAV file; None if it is not there any more."""
        speech = self._kept.get((session, utterance))
        if speech is None:
            return None
        buffer = io.BytesIO()
        with wave.open(buffer, "wb") as file:
            file.setparams((1, 2, speech.sample_rate_hz, 0, "NONE", ""))
            file.writeframes(speech.samples.astype("<i2").tobytes())
        return buffer.getvalue()

    def _drop(self, session: str, utterance: int) -> None:
        speech = self._kept.pop((session, utterance), None)
        if speech is not None:
            self._bytes -= speech.samples.nbytes
