"""The voice of the hub: it speaks texts piece by piece, in turn between sessions.

Theory of operation
-------------------
A text is cut into pieces (:mod:`fapengine.speech.text.words`). The voice speaks one piece at a time, and each session
has at most one piece in the queue, so sessions take turns: a long text of one delays the others by a piece each, not by
all of it. A text whose audio exceeds its limit is given up with an error.

Words that have times are pronounced in a thread, those of one utterance one message after the other.
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol
from weakref import WeakValueDictionary

import numpy as np

from fapengine.errors import NothingToSpeakError, UsageError
from fapengine.speech.marks import MarkedText, read_marks
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.speech.text.words import ends_sentence, pieces_of
from fapengine.voices.choice import VoiceChoice, pronouncer_of
from fapengine.voices.protocol import Speech

Words = Sequence[tuple[str, float, float]]
"""Word, start and end in s from the utterance's beginning."""
SENTENCE_PAUSE_S, PAUSE_S = 0.35, 0.15
"""Silence between pieces, as espeak-ng puts it after a sentence and after a comma (measured with 1.52)."""
MAX_TEXTS = 4
"""Number of texts of one session that may wait; more are refused."""


class PieceVoice(Protocol):
    """A voice that speaks one piece at a time."""

    async def speak(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        """Speak a piece.

        Raises UsageError if there is nothing to speak, or its audio exceeds ``most_s`` seconds; ResourceError if the
        voice is not installed, or was ended.
        """

    def close(self) -> None:
        """Stop at once."""


class ThreadVoice:
    """A voice in a thread: it starts quickly, but cannot be stopped."""

    async def speak(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        """Speak a piece; see :class:`PieceVoice`."""
        return await asyncio.to_thread(lambda: choice.load(most_s).speak(text))

    def close(self) -> None:
        """Nothing to stop."""


@dataclass(slots=True, eq=False)
class Asked:
    """A request to the voice.

    Stateful.
    """

    session: str
    is_cancelled: bool = False


@dataclass(slots=True, eq=False)
class _Line:
    """The texts of one session.

    Stateful.
    """

    first: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held by the text whose pieces are spoken."""
    texts: int = 0


class Speaker:
    """Texts of all sessions to audio, and words with times to phones; see the theory of operation.

    Stateful.

    Parameters
    ----------
    voice : PieceVoice
    most_s : float
        Longest audio of a text, s.
    """

    def __init__(self, voice: PieceVoice, most_s: float) -> None:
        self._voice, self._most_s = voice, most_s
        self._lines: dict[str, _Line] = {}
        self._turn = asyncio.Lock()
        """Locks of asyncio are first come, first served; a session has at most one piece in the queue."""
        self._asked: list[Asked] = []
        self._word_turns: WeakValueDictionary[tuple[str, int], asyncio.Lock] = WeakValueDictionary()

    def cancel(self, session: str) -> None:
        """Drop all requests of a session."""
        for asked in self._asked:
            asked.is_cancelled |= asked.session == session

    async def speak(self, session: str, text: str, choice: VoiceChoice) -> Speech | None:
        """Speak a text; None if it was cancelled in the meantime.

        Raises UsageError if it is empty or too long, or the session has too many texts waiting; ResourceError if the
        voice is not installed, or was ended.
        """
        line = self._lines.setdefault(session, _Line())
        if line.texts >= MAX_TEXTS:
            raise UsageError(f"text: got one more than {MAX_TEXTS} that wait for the voice")
        line.texts += 1
        asked = Asked(session)
        self._asked.append(asked)
        try:
            async with line.first:
                return await self._speak_pieces(asked, text, choice)
        finally:
            self._asked.remove(asked)
            line.texts -= 1
            if not line.texts:
                del self._lines[session]

    async def pronounce(self, session: str, words: Words, voice: str) -> list[Phone] | None:
        """Pronounce words in a language; None if it was cancelled in the meantime.

        Raises UsageError if the times are out of order, or the voice is unknown; ResourceError if the voice is not
        installed.
        """
        asked = Asked(session)
        self._asked.append(asked)
        try:
            spoken = await asyncio.to_thread(lambda: pronouncer_of(VoiceChoice(voice)).words(words))
        finally:
            self._asked.remove(asked)
        return None if asked.is_cancelled else spoken

    def turn(self, session: str, utterance: int) -> asyncio.Lock:
        """Return the lock under which more words of an utterance are pronounced, one message after the other."""
        return self._word_turns.setdefault((session, utterance), asyncio.Lock())

    async def _speak_pieces(self, asked: Asked, text: str, choice: VoiceChoice) -> Speech | None:
        spoken: list[tuple[Speech, float]] = []
        nothing: NothingToSpeakError | None = None
        left_s = self._most_s
        marked = MarkedText(text) if choice.ssml else read_marks(text)  # before the text is cut
        pieces = [text] if choice.ssml else pieces_of(marked.with_sounds)
        if not pieces:
            raise NothingToSpeakError(f"text: {text!r:.60} contains nothing to speak")
        for piece in pieces:
            async with self._turn:
                if asked.is_cancelled:
                    return None
                try:
                    speech = await self._voice.speak(piece, choice, left_s)
                except NothingToSpeakError as error:
                    nothing = nothing or error  # no text at all, unless another piece has some
                    continue
            left_s -= speech.duration_s
            spoken.append((speech, SENTENCE_PAUSE_S if ends_sentence(piece) else PAUSE_S))
        if nothing is not None and not spoken:
            raise nothing
        if asked.is_cancelled:
            return None
        speech = joined(spoken)
        return speech.marked(replace(marked, sounds=())) if marked.marks or marked.unknown else speech

    def close(self) -> None:
        """Stop at once."""
        self._voice.close()


def joined(spoken: list[tuple[Speech, float]]) -> Speech:
    """Join pieces, each but the last with the silence after it."""
    if len(spoken) == 1:
        return spoken[0][0]
    rate_hz = spoken[0][0].sample_rate_hz
    sounds, phones, remarks, begin = [], [], [], 0
    for place, (speech, pause_s) in enumerate(spoken, 1):
        shift_s = begin / rate_hz
        phones += [replace(p, start_s=p.start_s + shift_s, end_s=p.end_s + shift_s) for p in speech.phones.phones]
        sounds.append(speech.samples)
        begin += len(speech.samples)
        remarks += [remark for remark in speech.remarks if remark not in remarks]
        if place < len(spoken):
            pause = round(pause_s * rate_hz)
            sounds.append(np.zeros(pause, np.int16))
            phones.append(Phone(SILENCE, phones[-1].end_s, (begin + pause) / rate_hz))
            begin += pause
    return Speech(
        samples=np.concatenate(sounds),
        sample_rate_hz=rate_hz,
        phones=PhoneTrack.from_phones(phones),
        remarks=tuple(remarks),
    )
