"""Workers that show the faces of LiveKit agents (extras ``livekit``, ``voice``, ``recognizer``).

Examples
--------
A pool waits for agents with ``AvatarSession(remote="http://this-machine:9120")``; a face leaves with its agent::

    FAPENGINE_TOKEN=... python -m fapengine.agents.livekit_worker --serve 0.0.0.0:9120 --head woman

A single worker joins a room with a token and answers the agent's ``DataStreamAudioOutput``::

    LIVEKIT_TOKEN=... python -m fapengine.agents.livekit_worker wss://host --head woman
"""

import argparse
import asyncio
import json
import logging
import os
import sys

from aiohttp import web
from livekit import rtc
from livekit.agents.types import (
    ATTRIBUTE_AGENT_STATE,
    ATTRIBUTE_PUBLISH_ON_BEHALF,
    ATTRIBUTE_TRANSCRIPTION_EXPRESSION,
    TOPIC_TRANSCRIPTION,
)
from livekit.agents.utils import wait_for_participant
from livekit.agents.voice import avatar

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.livekit_tracks import FACE_RPC, acts_of, runner_of
from fapengine.agents.pool import MAX_FACES, TOKEN, Pool
from fapengine.agents.warm import open_face, prewarm
from fapengine.errors import FapEngineError, ResourceError
from fapengine.render.drawing import EDGES
from fapengine.server.config import Listen
from fapengine.server.intake.tasks import Tasks
from fapengine.server.web.access import Access

log = logging.getLogger("fapengine.agents")
JOINS_S = 30.0
"""Time for an agent to be in the room."""


async def work(url: str, token: str, options: AgentOptions) -> None:
    """Run an avatar in a room until it is disconnected or its agent leaves.

    It reads ``lk.audio_stream``, answers its RPCs, and follows the agent's state and who speaks. It shows the
    expression of a transcription (``lk.expression``) that comes while it speaks; LiveKit sends it with the end of a
    segment, so before the audio has ended only with ``sync_transcription=False``. Its agent is the one that its token
    names (``lk.publish_on_behalf``), else the first in the room. Raises ResourceError if the face cannot be rendered,
    or the room cannot be joined.

    Parameters
    ----------
    url, token : str
        Address of the LiveKit server, and access token of the room.
    options : AgentOptions
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
        _Follower(room, face, agent, left).start()
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


class _Follower:
    """Moves the face by what happens in the room, and sets ``left`` when the agent leaves it. Stateful."""

    def __init__(self, room: rtc.Room, face: AgentFace, agent: str | None, left: asyncio.Event) -> None:
        self._room, self._face, self._agent, self._left = room, face, agent, left
        self._own = room.local_participant.identity
        self._acts = acts_of(face)
        self._reading = Tasks()

    def start(self) -> None:
        """Listen to the room."""
        self._room.on("participant_disconnected", self._disconnected)
        self._room.on("participant_attributes_changed", self._changed)
        self._room.on("active_speakers_changed", self._speaking)
        self._room.local_participant.register_rpc_method(FACE_RPC, self._act)
        self._room.register_text_stream_handler(TOPIC_TRANSCRIPTION, self._transcribed)

    def _is_agent(self, participant: rtc.Participant | None) -> bool:
        if participant is None or self._agent is not None:
            return participant is not None and bool(participant.identity == self._agent)
        return bool(participant.kind == rtc.ParticipantKind.PARTICIPANT_KIND_AGENT)

    def _disconnected(self, participant: rtc.RemoteParticipant) -> None:
        if self._is_agent(participant):
            self._left.set()

    def _changed(self, attributes: dict[str, str], participant: rtc.Participant) -> None:
        if self._is_agent(participant) and ATTRIBUTE_AGENT_STATE in attributes:
            self._face.attend("thinking", attributes[ATTRIBUTE_AGENT_STATE] == "thinking")

    def _speaking(self, speakers: list[rtc.Participant]) -> None:
        users = [one for one in speakers if one.identity != self._own and not self._is_agent(one)]
        self._face.attend("listening", bool(users))

    def _act(self, call: rtc.RpcInvocationData) -> str:
        """Do what an RPC of the agent asks for: :data:`FACE_RPC`."""
        if not self._is_agent(self._room.remote_participants.get(call.caller_identity)):
            raise rtc.RpcError(rtc.RpcError.ErrorCode.APPLICATION_ERROR, "only its agent moves this face")
        try:
            for name, *given in json.loads(call.payload):
                self._acts[name](*given)
        except (LookupError, TypeError, ValueError) as error:
            wrong = f"got {call.payload!r:.60}, expected a list of [name, argument...] with {', '.join(self._acts)}"
            raise rtc.RpcError(rtc.RpcError.ErrorCode.APPLICATION_ERROR, wrong) from error
        return ""

    def _transcribed(self, reader: rtc.TextStreamReader, identity: str) -> None:
        if identity == self._own or self._is_agent(self._room.remote_participants.get(identity)):
            self._reading.start(self._feel(reader))
        else:
            reader.close()

    async def _feel(self, reader: rtc.TextStreamReader) -> None:
        """Show the expression that comes with a transcription."""
        await reader.read_all()
        expression = (reader.info.attributes or {}).get(ATTRIBUTE_TRANSCRIPTION_EXPRESSION)
        if expression is None:
            return
        try:
            self._face.feel(str(json.loads(expression)["expression"]))
        except (LookupError, TypeError, ValueError):
            log.warning("lk.expression: got %.60r, expected JSON with an expression", expression)


def main() -> None:
    """Run the worker's command line."""
    parser = argparse.ArgumentParser(prog="python -m fapengine.agents.livekit_worker", description="An avatar worker.")
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
