"""A face for LiveKit Agents (``pip install fapengine[livekit,voice,recognizer]``).

Examples
--------
In the agent's entry point, before ``session.start``::

    avatar = AvatarSession(head="woman", size=(512, 512))
    await avatar.start(session, room=ctx.room)

It shows at once if its process was started before the job came::

    server.setup_fnc = partial(prewarm_fnc, head="woman", size=(512, 512))  # of an older WorkerOptions: prewarm_fnc

Words with times make better lip motion than audio alone, and inline cues such as ``[laughs]`` move the face::

    class Assistant(Agent):
        async def tts_node(self, text, settings):
            async for frame in Agent.default.tts_node(self, avatar.without_marks(text), settings):
                yield frame

        async def transcription_node(self, text, settings):  # with use_tts_aligned_transcript=True
            async for piece in avatar.read(text):
                yield piece

The face can be a participant of its own, shown by a worker on another machine (:mod:`fapengine.agents.livekit_worker`),
which leaves with its agent. Words and cues reach it, too::

    avatar = AvatarSession(remote="http://that-machine:9120")  # remote=True: on this machine

While the user speaks the face looks at them and nods, while the agent thinks it looks aside. It pauses where LiveKit
waits to know whether it was interrupted (``resume_false_interruption``).
"""

import os
import re
from collections.abc import AsyncIterable, AsyncIterator, Callable
from typing import Any

import aiohttp
from livekit import api, rtc
from livekit.agents import voice
from livekit.agents.types import ATTRIBUTE_PUBLISH_ON_BEHALF
from livekit.agents.voice import avatar

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.livekit_tracks import IDENTITY, FaceOutput, RemoteOutput, acts_of, runner_of
from fapengine.agents.pool import TOKEN
from fapengine.agents.warm import open_face, prewarm
from fapengine.errors import ResourceError, UsageError
from fapengine.speech.marks import read_marks

POOL = "http://127.0.0.1:9120"
"""Address of the workers, unless another one is given."""
ANSWERS_S = 30.0
"""Time for the workers to answer."""
_SENTENCE = re.compile(r"[.!?…]+[\"')\]]*\s+|\n+")


class AvatarSession(avatar.AvatarSession):  # type: ignore[misc, unused-ignore]
    """A face in the agent's process, published by the agent's own participant; or a remote one, a participant.

    Raises UsageError if a remote face has options, or a credential of LiveKit is missing.

    Parameters
    ----------
    remote : bool or str
        True: workers on this machine show it (``python -m fapengine.agents.livekit_worker --serve``), or those at the
        address.
    livekit_url, livekit_api_key, livekit_api_secret : str, optional
        For the token of a remote face; by default LIVEKIT_URL, LIVEKIT_API_KEY and LIVEKIT_API_SECRET.
    **options
        Fields of :class:`fapengine.agents.face.AgentOptions`: ``head``, ``size``, ``frame_rate_hz``, ... Those of a
        remote face are options of the workers.
    """

    def __init__(
        self,
        *,
        remote: bool | str = False,
        livekit_url: str | None = None,
        livekit_api_key: str | None = None,
        livekit_api_secret: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__()
        self._room: rtc.Room | None = None
        self._pool = POOL if remote is True else (remote or "").rstrip("/") or None
        self._face: AgentFace | None = None
        self._runner: avatar.AvatarRunner | None = None
        self._act: Callable[..., object] = lambda *_: None
        """Does an act of :func:`acts_of`."""
        self._listeners: list[tuple[voice.AgentSession, str, Any]] = []
        if self._pool is None:
            self._options = AgentOptions(**options)
            self._face = open_face(self._options)
            acts = acts_of(self._face)
            self._act = lambda name, *given: acts[name](*given)
            return
        if options:
            raise UsageError(f"{next(iter(options))}: a remote face has the options of its workers; give it to them")
        given = {"url": livekit_url, "api_key": livekit_api_key, "api_secret": livekit_api_secret}
        self._livekit = {name: value or os.environ.get(f"LIVEKIT_{name.upper()}", "") for name, value in given.items()}
        if missing := next((name for name, value in self._livekit.items() if not value), None):
            raise UsageError(f"livekit_{missing}: missing; give it, or set LIVEKIT_{missing.upper()}")

    @property
    def avatar_identity(self) -> str:
        """Identity of the participant that shows the face: the agent's own, or the remote one."""
        if self._pool is not None:
            return IDENTITY
        return str(self._room.local_participant.identity) if self._room is not None else ""

    @property
    def provider(self) -> str:
        """Name for metrics."""
        return "fapengine"

    async def start(self, agent_session: voice.AgentSession, room: rtc.Room) -> None:
        """Begin to show the face in a room, and to receive the session's audio.

        Raises ResourceError if the face cannot be rendered, or no worker takes it.
        """
        await super().start(agent_session, room)
        if self._face is None:
            await self._dispatch(room)
            output = RemoteOutput(room)
            self._act = output.act
        else:
            await self._face.ready()
            output = FaceOutput(self._face)
            self._runner = runner_of(room, output, self._face, self._options)
            await self._runner.start()
            self._attend(agent_session, self._face)
        agent_session.output.replace_audio_tail(output)

    def _attend(self, session: voice.AgentSession, face: AgentFace) -> None:
        """Have the face follow the states of the session, which a remote one reads in the room."""

        def agent(event: Any) -> None:
            face.attend("thinking", event.new_state == "thinking")

        def user(event: Any) -> None:
            face.attend("listening", event.new_state == "speaking")

        for name, listener in (("agent_state_changed", agent), ("user_state_changed", user)):
            session.on(name, listener)
            self._listeners.append((session, name, listener))

    async def _dispatch(self, room: rtc.Room) -> None:
        """Have a worker join the room with a token of its own."""
        grants = api.VideoGrants(room_join=True, room=room.name)
        token = api.AccessToken(self._livekit["api_key"], self._livekit["api_secret"])
        token = token.with_kind("agent").with_identity(IDENTITY).with_grants(grants)
        token = token.with_attributes({ATTRIBUTE_PUBLISH_ON_BEHALF: room.local_participant.identity})
        job = {"url": self._livekit["url"], "token": token.to_jwt()}
        headers = {"Authorization": f"Bearer {os.environ.get(TOKEN, '')}"}
        try:
            limit = aiohttp.ClientTimeout(ANSWERS_S)
            async with (
                aiohttp.ClientSession(timeout=limit) as http,
                http.post(f"{self._pool}/faces", json=job, headers=headers) as answer,
            ):
                if answer.status != 201:
                    raise ResourceError(f"remote: {self._pool} answered {answer.status}: {await answer.text():.200}")
        except (aiohttp.ClientError, TimeoutError) as error:
            raise ResourceError(
                f"remote: no workers at {self._pool} ({str(error) or 'no answer'}); start them with --serve"
            ) from error

    async def aclose(self) -> None:
        """End it. The agent's own participant stays; a remote one leaves."""
        for session, name, listener in self._listeners:
            session.off(name, listener)
        self._listeners.clear()
        if self._room is not None and self._pool is None:
            self._room.off("connection_state_changed", self._on_connection_state_changed)
            self._room = None
        await super().aclose()
        runner, self._runner = self._runner, None
        if runner is not None:
            await runner.aclose()
        if self._face is not None:
            self._face.close()

    async def read(self, text: AsyncIterable[Any]) -> AsyncIterator[Any]:
        """Pass on a transcription, and read its words with times; for ``Agent.transcription_node``.

        A TTS that does not stream has times of sentences only; then the recognizer is more precise.
        """
        async for piece in text:
            start_s, end_s = getattr(piece, "start_time", None), getattr(piece, "end_time", None)
            is_word = len(str(piece).split()) == 1 or (self._face is not None and self._face.recognizer is None)
            if is_word and isinstance(start_s, int | float):
                self._act("word", str(piece), float(start_s), float(end_s) if isinstance(end_s, int | float) else None)
            yield piece

    async def without_marks(self, text: AsyncIterable[str]) -> AsyncIterator[str]:
        """Remove inline cues from a text, sentence by sentence, and keep them for the face; for ``Agent.tts_node``."""

        def taken(given: str) -> str:
            self._act("expect", given)
            return read_marks(given).text

        waiting = ""
        async for piece in text:
            waiting += piece
            ends = [match.end() for match in _SENTENCE.finditer(waiting)]
            if ends:
                ready, waiting = waiting[: ends[-1]], waiting[ends[-1] :]
                yield taken(ready).rstrip() + " "
        if waiting.strip():
            yield taken(waiting)


def prewarm_fnc(_: object, **options: Any) -> None:
    """Start a face for the next job of a LiveKit process; the options are those of :class:`AvatarSession`."""
    prewarm(1, **options)
