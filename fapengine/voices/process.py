"""Voices in child processes (:mod:`fapengine._child`): for servers, which can end them, and for repeatable audio.

espeak-ng keeps state that nothing resets: the second text of a process differs slightly from the first (54,842 and
54,852 samples for one sentence), whatever is initialised or seeded in between. So :class:`FreshVoices` speaks each text
in a new process. Where there is ``fork``, that is a copy of one that has only loaded the library.
"""

import asyncio
import contextlib
import os
import pickle

from fapengine._child import NICENESS, Child, Parent, command
from fapengine.errors import FapEngineError, ResourceError
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import catalogue
from fapengine.voices.protocol import Speech

PIECE_LIMIT_S = 60.0
"""Time limit of a piece, including the start of the process; 300 characters 字 take 0.4 s."""


def main(parent: Parent, kind: str) -> None:
    """Speak the parent's texts; kind "fresh" speaks each in a process that has not spoken yet: this one or a copy."""
    is_fresh = kind == "fresh"
    with contextlib.suppress(FapEngineError):
        catalogue()  # loads the library, so that copies of this process need not
    for _, data in parent.messages():
        copy = os.fork() if is_fresh and hasattr(os, "fork") else 0
        if copy:
            if os.waitpid(copy, 0)[1]:
                return  # the library has crashed; the parent finds the end of our output
            continue
        text, choice, most_s = pickle.loads(data)
        try:
            parent.tell({}, pickle.dumps(choice.load(most_s).speak(text)))
        except FapEngineError as error:
            parent.fail(error)
        if is_fresh:
            os._exit(0)


def _started(kind: str) -> Child:
    return Child("voice", command("fapengine.voices.process", kind, niceness=NICENESS))


def _spoken(child: Child, text: str, choice: VoiceChoice, most_s: float) -> Speech:
    """Speak a text in the child; raises the voice's errors, and EOFError if the process has ended."""
    speech = pickle.loads(child.ask({}, pickle.dumps((text, choice, most_s)))[1])
    assert isinstance(speech, Speech)
    return speech


class FreshVoices:
    """Voices that speak each text as if it were their first. Stateful; close it."""

    def __init__(self) -> None:
        self._child: Child | None = None

    def speak(self, text: str, choice: VoiceChoice) -> Speech:
        """Speak a text."""
        if self._child is None or not self._child.is_alive:
            self._child = _started("fresh")
        try:
            return _spoken(self._child, text, choice, float("inf"))
        except EOFError as error:
            self.close()
            raise ResourceError("voice: its process has ended; ask again") from error
        finally:
            if not hasattr(os, "fork"):
                self.close()  # it has spoken

    def close(self) -> None:
        """End the process."""
        child, self._child = self._child, None
        if child is not None:
            child.close()

    def __enter__(self) -> "FreshVoices":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class VoiceProcess:
    """A voice in a process, which is started with the first text, and again when it has ended. Stateful.

    A text whose process ends is spoken once more by a new one. A text that is cancelled is spoken to its end, so that
    the next one need not wait for a new process.
    """

    def __init__(self) -> None:
        self._child: Child | None = None
        self._turn = asyncio.Lock()
        self._work: set[asyncio.Task[Speech]] = set()
        self._is_closed = False

    async def speak(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        """Speak a piece; see :class:`fapengine.host.speaker.PieceVoice`."""
        task = asyncio.create_task(self._ask(text, choice, most_s))
        self._work.add(task)
        task.add_done_callback(self._forget)
        return await asyncio.shield(task)

    def close(self) -> None:
        """End the process at once."""
        self._is_closed = True
        if self._child is not None:
            self._child.kill()

    async def wait_closed(self) -> None:
        """Wait for the process that :meth:`close` has ended."""
        await asyncio.gather(*self._work, return_exceptions=True)
        await self._end()

    def _forget(self, task: asyncio.Task[Speech]) -> None:
        self._work.discard(task)
        if not task.cancelled():
            task.exception()  # the asker has it, or is gone

    async def _ask(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        async with self._turn:
            try:
                try:
                    return await self._answer(text, choice, most_s)
                except EOFError:  # once more, in a new process
                    await self._end()
                    return await self._answer(text, choice, most_s)
            except TimeoutError as error:
                await self._end()
                raise ResourceError(f"voice: no answer for {PIECE_LIMIT_S:.0f} s; its process was stopped") from error
            except EOFError as error:
                await self._end()
                raise ResourceError("voice: its process has ended; ask again") from error

    async def _answer(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        if self._is_closed:
            raise EOFError
        if self._child is None:
            self._child = _started("server")
        async with asyncio.timeout(PIECE_LIMIT_S):
            return await asyncio.to_thread(_spoken, self._child, text, choice, most_s)

    async def _end(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            await asyncio.to_thread(child.close)
