"""Words with times become phones of an utterance, however many messages they come in."""

import asyncio
from collections.abc import Callable, Sequence
from weakref import WeakValueDictionary

from fapengine.live.hub.speaker import Asked
from fapengine.speech.phone_track import Phone
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.pronounce import Pronouncer

Words = Sequence[tuple[str, float, float]]
"""Word, start and end in s from the utterance's beginning."""
MAX_VOICES = 8
"""Voices that are remembered, with the words that they know; more begin anew."""


class TimedWords:
    """Pronounces words beside the event loop, those of one utterance one message after the other.

    Stateful.

    Parameters
    ----------
    asked : list of Asked
        What voices are busy with; a cancel marks those of its session.
    """

    def __init__(self, asked: list[Asked]) -> None:
        self._asked = asked
        self._pronouncers: dict[str, Pronouncer] = {}
        self._turns: WeakValueDictionary[tuple[str, int], asyncio.Lock] = WeakValueDictionary()

    async def pronounce(self, session: str, words: Words, voice: str) -> list[Phone] | None:
        """Pronounce words in a language; None if the session was told to stop meanwhile.

        Raises
        ------
        UsageError
            If the times are out of order, or the voice is unknown.
        ResourceError
            If the voice is not installed.
        """
        request = Asked(session)
        self._asked.append(request)
        try:
            spoken = await asyncio.to_thread(lambda: self._pronouncer(voice).words(words))
        finally:
            self._asked.remove(request)
        return None if request.is_cancelled else spoken

    def _pronouncer(self, voice: str) -> Pronouncer:
        """Load a voice once; a name that no voice has is not remembered."""
        pronouncer = self._pronouncers.get(voice)
        if pronouncer is None:
            pronouncer = Pronouncer(VoiceChoice(voice).load())
            if len(self._pronouncers) >= MAX_VOICES:
                self._pronouncers.clear()
            self._pronouncers[voice] = pronouncer
        return pronouncer

    async def go_on(
        self, session: str, utterance: int, words: Words, voice: str, tell: Callable[[list[Phone]], None]
    ) -> None:
        """Pronounce more words of an utterance and tell their phones, when those that came before were told.

        Raises as :meth:`pronounce`, and what ``tell`` raises.
        """
        async with self._turns.setdefault((session, utterance), asyncio.Lock()):
            phones = await self.pronounce(session, words, voice) if words else []
            if phones is not None:
                tell(phones)
