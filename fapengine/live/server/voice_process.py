"""The voice as a process of its own, which can be ended whatever it does (:mod:`fapengine.voices.worker`)."""

import asyncio
import contextlib
import pickle
import sys
from asyncio.subprocess import PIPE, Process

from fapengine.errors import FapEngineError, ResourceError
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech
from fapengine.voices.worker import LENGTH, packed

PIECE_LIMIT_S = 60.0
"""Time that a piece may take, the start of the process included; 300 letters of 字 take 0.4 s."""


class VoiceProcess:
    """A voice in a process, which is started with the first text, and again when it has ended.

    Stateful. A text whose asker is gone is spoken to its end, so that the next one need not wait for a new process.
    """

    def __init__(self) -> None:
        self._process: Process | None = None
        self._turn = asyncio.Lock()
        self._work: set[asyncio.Task[Speech]] = set()
        self._closed = False

    async def speak(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        """Speak a piece; see :class:`fapengine.live.hub.speaker.PieceVoice`."""
        task = asyncio.create_task(self._ask(text, choice, most_s))
        self._work.add(task)
        task.add_done_callback(self._forget)
        return await asyncio.shield(task)

    def close(self) -> None:
        """End the process at once."""
        self._closed = True
        self._kill()

    async def wait_closed(self) -> None:
        """Wait for the process that :meth:`close` has ended."""
        await asyncio.gather(*self._work, return_exceptions=True)
        await self._end()

    def _forget(self, task: asyncio.Task[Speech]) -> None:
        self._work.discard(task)
        if not task.cancelled():
            task.exception()  # somebody has heard of it, or is gone

    async def _ask(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        async with self._turn:
            try:
                async with asyncio.timeout(PIECE_LIMIT_S):
                    answer = await self._exchange(packed((text, choice, most_s)))
            except TimeoutError as error:
                await self._end()
                raise ResourceError(f"voice: got no answer for {PIECE_LIMIT_S:.0f} s, and was ended") from error
            except (OSError, EOFError) as error:
                await self._end()
                raise ResourceError("voice: its process has ended; ask again") from error
        if isinstance(answer, FapEngineError):
            raise answer
        assert isinstance(answer, Speech)
        return answer

    async def _exchange(self, request: bytes) -> object:
        if self._closed:
            raise EOFError
        if self._process is None:
            path = f"import sys; sys.path[:] = {sys.path!r}; from fapengine.voices.worker import main; main()"
            self._process = await asyncio.create_subprocess_exec(sys.executable, "-c", path, stdin=PIPE, stdout=PIPE)
            if self._closed:
                self._kill()
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(request)
        await stdin.drain()
        (length,) = LENGTH.unpack(await stdout.readexactly(LENGTH.size))
        return pickle.loads(await stdout.readexactly(length))

    def _kill(self) -> None:
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()

    async def _end(self) -> None:
        self._kill()
        process, self._process = self._process, None
        if process is not None:
            await process.communicate()
