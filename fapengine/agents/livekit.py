"""A face for LiveKit Agents, in the agent or as a worker (``pip install fapengine[livekit,voice,recognizer]``).

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

The face can be a participant of its own, shown by another machine: workers wait there, and leave with their agent.
Words and cues reach it, too::

    FAPENGINE_TOKEN=... python -m fapengine.agents.livekit --serve 0.0.0.0:9120 --head woman
    avatar = AvatarSession(remote="http://that-machine:9120")  # in the agent; remote=True: on this machine

A single worker joins a room with a token and answers the agent's ``DataStreamAudioOutput``::

    LIVEKIT_TOKEN=... python -m fapengine.agents.livekit wss://host --head woman

While the user speaks the face looks at them and nods, while the agent thinks it looks aside. It pauses where LiveKit
waits to know whether it was interrupted (``resume_false_interruption``).
"""

import argparse
import asyncio
import json
import logging
import os
import re
import sys
import time
from collections import deque
from collections.abc import AsyncIterable, AsyncIterator, Callable
from typing import Any

import aiohttp
from aiohttp import web
from livekit import api, rtc
from livekit.agents import voice
from livekit.agents.types import (
    ATTRIBUTE_AGENT_STATE,
    ATTRIBUTE_PUBLISH_ON_BEHALF,
    ATTRIBUTE_TRANSCRIPTION_EXPRESSION,
    TOPIC_TRANSCRIPTION,
)
from livekit.agents.utils import wait_for_participant, wait_for_track_publication
from livekit.agents.voice import avatar
from livekit.agents.voice.io import AudioOutputCapabilities

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.pool import MAX_FACES, TOKEN, Pool
from fapengine.agents.warm import open_face, prewarm
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.render.drawing import EDGES
from fapengine.server.config import Listen
from fapengine.server.web.access import Access
from fapengine.speech.marks import read_marks

log = logging.getLogger("fapengine.agents")
SAMPLE_RATE_HZ = 24_000
LIVEKIT_AHEAD_S = 0.05
"""Time by which frames are early: with a frame of 0.04 s it nearly fills the queue of LiveKit's runner, 0.1 s. A
generator that is held up there would begin to play again after an interruption."""
IDENTITY = "fapengine-avatar"
"""Identity of a remote face in the room."""
POOL = "http://127.0.0.1:9120"
"""Address of the workers, unless another one is given."""
JOINS_S = 30.0
"""Time for the pool to answer, and for an agent to be in the room."""
FACE_RPC = "fapengine.face"
"""RPC by which an agent sends its remote face words, cues and pauses: JSON, a list of [name of an act, argument...]."""
MAX_ACTS = 50
"""Number of them in one call; LiveKit carries 15 kB."""
_SENTENCE = re.compile(r"[.!?…]+[\"')\]]*\s+|\n+")


class FaceGenerator(avatar.VideoGenerator):  # type: ignore[misc, unused-ignore]
    """Turns the agent's audio into images; an image follows its audio, which does not wait for it.

    Parameters
    ----------
    face : AgentFace
    size : (int, int)
        Width and height of its images.
    """

    def __init__(self, face: AgentFace, size: tuple[int, int]) -> None:
        self.face, self._size = face, size
        self._ends_s: deque[float] = deque()
        """Times at which the audio of finished utterances has been played."""
        self._resampler: rtc.AudioResampler | None = None
        self._resampled: tuple[int, int] | None = None
        """Sample rate and channels that the resampler takes."""

    async def push_audio(self, frame: rtc.AudioFrame | avatar.AudioSegmentEnd) -> None:
        """Add audio of any sample rate, or end an utterance."""
        if isinstance(frame, avatar.AudioSegmentEnd):
            self._finish_resampling()
            self.face.end()
            return
        form = frame.sample_rate, frame.num_channels
        if form != self._resampled:
            self._finish_resampling()
        if frame.sample_rate == SAMPLE_RATE_HZ:
            self._add([frame])
            return
        if self._resampler is None:
            self._resampler = rtc.AudioResampler(frame.sample_rate, SAMPLE_RATE_HZ, num_channels=frame.num_channels)
            self._resampled = form
        self._add(self._resampler.push(frame))

    def _add(self, frames: list[rtc.AudioFrame]) -> None:
        for frame in frames:
            self.face.sound(bytes(frame.data), frame.sample_rate, frame.num_channels)

    def _finish_resampling(self) -> None:
        if self._resampler is not None:
            self._add(self._resampler.flush())
        self._resampler = self._resampled = None

    def clear_buffer(self) -> None:
        """Stop speaking."""
        self._resampler = self._resampled = None
        self.face.interrupt(time.monotonic())
        self._ends_s.clear()

    async def __aiter__(self) -> AsyncIterator[rtc.VideoFrame | rtc.AudioFrame | avatar.AudioSegmentEnd]:
        """Yield audio and images in real time, and the end of each utterance when it has been played."""
        await self.face.hears()
        while True:
            await asyncio.sleep(self.face.wait_s(time.monotonic(), LIVEKIT_AHEAD_S))
            now_s = time.monotonic()
            frame, events = self.face.frame(now_s)
            self._ends_s.extend(now_s + self.face.unplayed_s(now_s) for event in events if event.kind == "finished")
            self.face.show(frame)
            for sound in frame.sounds:
                data = sound.samples.astype("<i2").tobytes()
                yield rtc.AudioFrame(data, sound.rate_hz, 1, len(sound.samples))
            picture = await self.face.drawn(self.face.wait_s(time.monotonic(), LIVEKIT_AHEAD_S))
            if picture is not None:
                yield rtc.VideoFrame(*self._size, rtc.VideoBufferType.RGB24, picture.pixels)
            while self._ends_s and self._ends_s[0] <= time.monotonic():
                self._ends_s.popleft()
                yield avatar.AudioSegmentEnd()


class FaceOutput(avatar.QueueAudioOutput):  # type: ignore[misc, unused-ignore]
    """The session's audio for a face in this process; it can be paused."""

    def __init__(self, face: AgentFace) -> None:
        super().__init__(sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True)
        self._capabilities = AudioOutputCapabilities(pause=True)  # the base class cannot be told
        self._host = face.host

    def pause(self) -> None:
        """Hold the audio."""
        self._host.pause()

    def resume(self) -> None:
        """Continue."""
        self._host.resume()


class RemoteOutput(avatar.DataStreamAudioOutput):  # type: ignore[misc, unused-ignore]
    """The session's audio for a remote face, which also receives pauses, words and cues (:data:`FACE_RPC`)."""

    def __init__(self, room: rtc.Room) -> None:
        super().__init__(
            room, destination_identity=IDENTITY, sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True,
            wait_remote_track=rtc.TrackKind.KIND_VIDEO,
        )  # fmt: skip
        self._capabilities = AudioOutputCapabilities(pause=True)
        self._acts: list[tuple[Any, ...]] = []
        self._acting: asyncio.Task[None] | None = None

    def act(self, name: str, *given: Any) -> None:
        """Send an act of :func:`acts_of`, in order, as soon as the face shows itself."""
        self._acts.append((name, *given))
        if self._acting is None or self._acting.done():
            self._acting = asyncio.create_task(self._send())

    async def _send(self) -> None:
        while self._acts:
            try:
                await wait_for_track_publication(self._room, identity=IDENTITY, kind=rtc.TrackKind.KIND_VIDEO)
            except RuntimeError as error:  # the face or the agent has left
                log.warning("the remote face did not receive words, cues or a pause: %s", error)
                self._acts.clear()
                return
            acts, self._acts = self._acts[:MAX_ACTS], self._acts[MAX_ACTS:]
            try:
                await self._room.local_participant.perform_rpc(
                    destination_identity=IDENTITY, method=FACE_RPC, payload=json.dumps(acts)
                )
            except rtc.RpcError as error:
                log.warning("the remote face did not receive words, cues or a pause: %s", error)

    def pause(self) -> None:
        """Hold the audio."""
        self.act("pause")

    def resume(self) -> None:
        """Continue."""
        self.act("resume")

    def clear_buffer(self) -> None:
        """Stop speaking; words and cues that were not sent yet are dropped."""
        self._acts = [act for act in self._acts if act[0] in ("pause", "resume")]
        super().clear_buffer()


def acts_of(face: AgentFace) -> dict[str, Callable[..., object]]:
    """Return what a session does to its face besides its audio, by name."""
    host = face.host
    return {"word": face.word, "expect": face.marks.expect, "pause": host.pause, "resume": host.resume}


class AvatarSession(avatar.AvatarSession):  # type: ignore[misc, unused-ignore]
    """A face in the agent's process, published by the agent's own participant; or a remote one, a participant.

    Parameters
    ----------
    remote : bool or str
        True: workers on this machine show it (``python -m fapengine.agents.livekit --serve``), or those at the address.
    livekit_url, livekit_api_key, livekit_api_secret : str, optional
        For the token of a remote face; by default LIVEKIT_URL, LIVEKIT_API_KEY and LIVEKIT_API_SECRET.
    **options
        Fields of :class:`fapengine.agents.face.AgentOptions`: ``head``, ``size``, ``frame_rate_hz``, ... Those of a
        remote face are options of the workers.

    Raises
    ------
    UsageError
        If a remote face has options, or a credential of LiveKit is missing.
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

        Raises
        ------
        ResourceError
            If the face cannot be rendered, or no worker takes it.
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
            limit = aiohttp.ClientTimeout(JOINS_S)
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


def runner_of(
    room: rtc.Room, sound: avatar.AudioReceiver, face: AgentFace, options: AgentOptions
) -> avatar.AvatarRunner:
    """Make LiveKit's runner, which publishes both tracks in sync."""
    width, height = options.size
    return avatar.AvatarRunner(
        room,
        audio_recv=sound,
        video_gen=FaceGenerator(face, options.size),
        options=avatar.AvatarOptions(
            video_width=width, video_height=height, video_fps=options.frame_rate_hz,
            audio_sample_rate=SAMPLE_RATE_HZ, audio_channels=1,
        ),
    )  # fmt: skip


async def work(url: str, token: str, options: AgentOptions) -> None:
    """Run an avatar in a room until it is disconnected or its agent leaves.

    It reads ``lk.audio_stream``, answers its RPCs, and follows the agent's state and who speaks. It shows the
    expression of a transcription (``lk.expression``) that comes while it speaks; LiveKit sends it with the end of a
    segment, so before the audio has ended only with ``sync_transcription=False``. Its agent is the one that its token
    names (``lk.publish_on_behalf``), else the first in the room.

    Parameters
    ----------
    url, token : str
        Address of the LiveKit server, and access token of the room.
    options : AgentOptions

    Raises
    ------
    ResourceError
        If the face cannot be rendered, or the room cannot be joined.
    """
    face, room = open_face(options), rtc.Room()
    left = asyncio.Event()
    room.on("disconnected", lambda _: left.set())
    runner = None
    try:
        await face.ready()
        await room.connect(url, token)
        own = room.local_participant
        agent = own.attributes.get(ATTRIBUTE_PUBLISH_ON_BEHALF) or None
        _follow(room, face, agent, left)
        sound = avatar.DataStreamAudioReceiver(room, sender_identity=agent)
        runner = runner_of(room, sound, face, options)
        await runner.start()
        if agent is not None:  # it may have left meanwhile
            try:
                async with asyncio.timeout(JOINS_S):
                    await wait_for_participant(room, identity=agent)
            except TimeoutError:
                log.warning("the agent %s is not in the room: its face leaves", agent)
                return
        await left.wait()
    except rtc.ConnectError as error:
        raise ResourceError(f"url: the room cannot be joined ({error})") from error
    finally:
        if runner is not None:
            await runner.aclose()
        await room.disconnect()
        face.close()


def _follow(room: rtc.Room, face: AgentFace, agent: str | None, left: asyncio.Event) -> None:
    """Set ``left`` when the agent leaves, and have the face attend to the agent's state and to who speaks."""
    own = room.local_participant.identity
    tasks: set[asyncio.Task[None]] = set()
    acts = acts_of(face)

    def is_agent(participant: rtc.Participant | None) -> bool:
        if participant is None or agent is not None:
            return participant is not None and bool(participant.identity == agent)
        return bool(participant.kind == rtc.ParticipantKind.PARTICIPANT_KIND_AGENT)

    def gone(participant: rtc.RemoteParticipant) -> None:
        if is_agent(participant):
            left.set()

    def changed(attributes: dict[str, str], participant: rtc.Participant) -> None:
        if is_agent(participant) and ATTRIBUTE_AGENT_STATE in attributes:
            face.attend("thinking", attributes[ATTRIBUTE_AGENT_STATE] == "thinking")

    def speaking(speakers: list[rtc.Participant]) -> None:
        users = [one for one in speakers if one.identity != own and not is_agent(one)]
        face.attend("listening", bool(users))

    def obey(call: rtc.RpcInvocationData) -> str:
        if not is_agent(room.remote_participants.get(call.caller_identity)):
            raise rtc.RpcError(rtc.RpcError.ErrorCode.APPLICATION_ERROR, "only its agent moves this face")
        try:
            for name, *given in json.loads(call.payload):
                acts[name](*given)
        except (LookupError, TypeError, ValueError) as error:
            wrong = f"got {call.payload!r:.60}, expected a list of [name, argument...] with {', '.join(acts)}"
            raise rtc.RpcError(rtc.RpcError.ErrorCode.APPLICATION_ERROR, wrong) from error
        return ""

    async def feel(reader: rtc.TextStreamReader) -> None:
        await reader.read_all()
        expression = (reader.info.attributes or {}).get(ATTRIBUTE_TRANSCRIPTION_EXPRESSION)
        if expression is None:
            return
        try:
            face.feel(str(json.loads(expression)["expression"]))
        except (LookupError, TypeError, ValueError):
            log.warning("lk.expression: got %.60r, expected JSON with an expression", expression)

    def transcribed(reader: rtc.TextStreamReader, identity: str) -> None:
        if identity == own or is_agent(room.remote_participants.get(identity)):
            task = asyncio.create_task(feel(reader))
            tasks.add(task)
            task.add_done_callback(tasks.discard)
        else:
            reader.close()

    room.on("participant_disconnected", gone)
    room.on("participant_attributes_changed", changed)
    room.on("active_speakers_changed", speaking)
    room.local_participant.register_rpc_method(FACE_RPC, obey)
    room.register_text_stream_handler(TOPIC_TRANSCRIPTION, transcribed)


def main() -> None:
    """Run the worker's command line."""
    parser = argparse.ArgumentParser(prog="python -m fapengine.agents.livekit", description="An avatar worker.")
    parser.add_argument("url", nargs="?", help="LiveKit server, as wss://host")
    parser.add_argument(
        "token",
        nargs="?",
        help="access token of the avatar's participant (default: LIVEKIT_TOKEN, which process lists do not show)",
    )
    parser.add_argument(
        "--serve", metavar="[HOST:]PORT", help=f"wait for agents (AvatarSession(remote=...)) that present {TOKEN}"
    )
    parser.add_argument("--most", type=int, default=MAX_FACES, help="with --serve: number of faces at once")
    parser.add_argument("--head", default="default", help="name or folder of a head")
    parser.add_argument("--size", type=int, nargs=2, default=(512, 512), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--antialias", choices=EDGES, default="soft", help="antialiasing")
    parser.add_argument("--rate", type=float, default=25.0, help="frames per second")
    given = parser.parse_args()
    try:
        _run(parser, given)
    except (FapEngineError, OSError) as error:
        sys.exit(f"error: {error}")


def _run(parser: argparse.ArgumentParser, given: argparse.Namespace) -> None:
    """Run one worker, or a pool of them."""
    looks = {"head": given.head, "size": tuple(given.size), "edges": given.antialias, "frame_rate_hz": given.rate}
    options = AgentOptions(**looks)
    if given.serve is None:
        token = given.token or os.environ.get("LIVEKIT_TOKEN")
        if given.url is None or not token:
            parser.error("give the address of a LiveKit server and a token, or --serve PORT")
        asyncio.run(work(given.url, token, options))
        return
    host, _, port = given.serve.rpartition(":")
    secret, host = os.environ.get(TOKEN) or None, host or "127.0.0.1"
    if not port.isdigit():
        parser.error(f"--serve: got {given.serve!r}, expected PORT or HOST:PORT")
    if secret is None and host not in ("127.0.0.1", "localhost"):
        parser.error(f"--serve: set {TOKEN}, or anyone on the network can send the face to a room")
    if given.most < 1:
        parser.error(f"--most: got {given.most}, expected 1 or more")
    listen = Listen(host, int(port), token=secret)
    prewarm(1, **looks)
    pool = Pool(lambda url, token: work(url, token, options), given.most, Access(listen.token))
    web.run_app(pool.application(), host=listen.host, port=listen.port, access_log=None)


if __name__ == "__main__":
    main()
