"""The avatar worker in rooms of the real ``rtc.Room``, on a stand-in for the server (:mod:`.livekit_server`).

Real are LiveKit's SDK with its WebRTC, its agents' classes, and the worker; not the server. The SDK gives up a remote
procedure call after 7 s: on a machine that is so busy that the stand-in passes one on later, the end of an utterance is
never told, and the test is skipped (:func:`until`).
"""

import asyncio
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from livekit import api, rtc
from livekit.agents.types import ATTRIBUTE_AGENT_STATE, ATTRIBUTE_TRANSCRIPTION_EXPRESSION, TOPIC_TRANSCRIPTION
from livekit.agents.voice.avatar import DataStreamAudioOutput

from fapengine.agents import livekit_worker
from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.livekit import AvatarSession
from fapengine.agents.livekit_tracks import FACE_RPC, IDENTITY, SAMPLE_RATE_HZ, RemoteOutput
from fapengine.engine.commands import Express
from fapengine.errors import ResourceError, UsageError
from tests.frameworks.check_livekit import Room, Session, pieces, sound
from tests.frameworks.clock import skip_if_busy
from tests.frameworks.livekit_server import LiveKitDouble
from tests.processes import free_port, start

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300


def token(identity: str, **attributes: str) -> str:
    grants = api.VideoGrants(room_join=True, room="room")
    made = api.AccessToken("key", "secret" * 8).with_identity(identity).with_grants(grants).with_attributes(attributes)
    return str(made.with_kind("standard" if identity == "visitor" else "agent").to_jwt())


class Visitor:
    """Counts what it sees and hears. Stateful."""

    def __init__(self) -> None:
        self.room, self.pictures, self.loudest = rtc.Room(), 0, 0
        self._tasks: list[asyncio.Task[None]] = []
        self.room.on("track_subscribed", lambda track, *_: self._tasks.append(asyncio.create_task(self._read(track))))

    async def _read(self, track: Any) -> None:
        if track.kind == rtc.TrackKind.KIND_VIDEO:
            async for event in rtc.VideoStream(track):
                self.pictures += event.frame.width == 128
        else:
            async for event in rtc.AudioStream(track):
                self.loudest = max(self.loudest, int(np.abs(np.frombuffer(event.frame.data, np.int16)).max()))

    async def leave(self) -> None:
        for task in self._tasks:
            task.cancel()
        await self.room.disconnect()


@asynccontextmanager
async def worker(url: str) -> AsyncIterator["subprocess.Popen[bytes]"]:
    """A worker in a process of its own."""
    arguments = [url, token("avatar"), "--size", "128", "128", "--rate", "10", "--antialias", "none"]
    process = start([sys.executable, "-m", "fapengine.agents.livekit_worker", *arguments], cwd=ROOT)
    try:
        yield process
    finally:
        process.kill()
        await asyncio.to_thread(process.wait)


@asynccontextmanager
async def room_with(url: str) -> AsyncIterator[tuple[Visitor, rtc.Room, DataStreamAudioOutput, list[Any]]]:
    """A visitor, an agent that speaks by the avatar, and what it is told of its speech."""
    visitor, agent, events = Visitor(), rtc.Room(), []
    await visitor.room.connect(url, token("visitor"))
    await agent.connect(url, token("agent"), rtc.RoomOptions(auto_subscribe=False))
    output = DataStreamAudioOutput(
        agent, destination_identity="avatar", sample_rate=SAMPLE_RATE_HZ, wait_remote_track=rtc.TrackKind.KIND_VIDEO,
        wait_playback_start=True,
    )  # fmt: skip
    output.on("playback_started", lambda _: events.append("started"))
    output.on("playback_finished", lambda event: events.append(event))
    try:
        yield visitor, agent, output, events
    finally:
        await visitor.leave()
        await agent.disconnect()


async def say(output: DataStreamAudioOutput, length_s: float) -> None:
    """Say something; the first audio waits for the face."""
    try:
        async with asyncio.timeout(LIMIT_S):
            for frame in pieces(sound(length_s)):
                await output.capture_frame(frame)
    except TimeoutError:
        skip_if_busy("no face came")
        raise
    output.flush()


async def say_low(output: DataStreamAudioOutput, length_s: float) -> None:
    """Say something of few bytes: RPCs come after them in the same channel, which is slow in the stand-in."""
    samples = sound(length_s)[::3]
    for piece in np.split(samples, range(800, len(samples), 800)):
        await output.capture_frame(rtc.AudioFrame(piece.tobytes(), SAMPLE_RATE_HZ // 3, 1, len(piece)))
    output.flush()


async def until(condition: Any) -> None:
    """Wait until something is so; where it never comes, and the machine has far too much to do, the test is skipped."""
    stop_s = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > stop_s:
            skip_if_busy("what was waited for did not come")
            raise AssertionError(f"it did not come in {LIMIT_S} s")
        await asyncio.sleep(0.05)


def finished(events: list[Any]) -> list[Any]:
    """The ends of utterances; a call that tells of a begin may have been given up."""
    return [event for event in events if event != "started"]


@pytest.mark.timeout(1200)
def test_an_agent_speaks_by_a_worker_in_its_room() -> None:
    """Audio by byte streams, tracks to a visitor, the end by RPC; then an interruption."""

    async def spoken() -> tuple[Visitor, list[Any]]:
        async with LiveKitDouble().open() as url, worker(url), room_with(url) as (visitor, _, output, events):
            await say(output, 2.0)
            await until(lambda: finished(events))
            await say_low(output, 30.0)
            await until(lambda: events.count("started") == 2 or len(finished(events)) == 2)
            output.clear_buffer()
            await until(lambda: len(finished(events)) == 2)
            await until(lambda: visitor.pictures > 5 and visitor.loudest > 2000)
            return visitor, events

    visitor, events = asyncio.run(spoken())
    whole, interrupted = finished(events)
    assert "started" in events
    assert not whole.interrupted
    assert whole.playback_position == pytest.approx(2.0, abs=0.05)
    assert interrupted.interrupted
    assert interrupted.playback_position < 30.0
    print(
        f"{visitor.pictures} pictures; loudest {visitor.loudest}; interrupted at {interrupted.playback_position:.2f} s"
    )


@pytest.mark.timeout(1200)
def test_a_worker_that_is_killed_leaves_and_the_next_one_speaks() -> None:
    async def spoken() -> list[Any]:
        async with LiveKitDouble().open() as url, room_with(url) as (visitor, agent, output, events):
            async with worker(url) as first:
                await say(output, 1.0)
                await until(lambda: finished(events))
                first.kill()
                await until(lambda: "avatar" not in agent.remote_participants)
            async with worker(url):
                await until(lambda: "avatar" in agent.remote_participants)
                await until(lambda: len(agent.remote_participants["avatar"].track_publications) == 2)
                await say(output, 1.0)
                await until(lambda: len(finished(events)) == 2)
            assert visitor.loudest > 2000
            return events

    events = asyncio.run(spoken())
    assert [event.interrupted for event in finished(events)] == [False, False]


@asynccontextmanager
async def pool() -> AsyncIterator[str]:
    """Workers that wait; their address."""
    port = free_port()
    command = [
        sys.executable,
        "-m",
        "fapengine.agents.livekit_worker",
        "--serve",
        str(port),
        "--size",
        "128",
        "128",
        "--rate",
        "10",
        "--antialias",
        "none",
    ]
    process = start(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert "Running" in await asyncio.to_thread(process.stdout.readline)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        await asyncio.to_thread(process.wait)


@pytest.mark.timeout(1200)
def test_a_remote_face_joins_speaks_and_leaves_with_its_agent() -> None:
    async def spoken() -> tuple[dict[str, str], list[Any]]:
        async with LiveKitDouble().open() as url, pool() as workers:
            visitor, agent, session, events = Visitor(), rtc.Room(), Session(), []
            await visitor.room.connect(url, token("visitor"))
            await agent.connect(url, token("agent"))
            secrets = {"livekit_url": url, "livekit_api_key": "key", "livekit_api_secret": "secret" * 8}
            avatar = AvatarSession(remote=workers, **secrets)
            await avatar.start(session, agent)  # type: ignore[arg-type]
            session.output.tail.on("playback_finished", events.append)
            await say(session.output.tail, 2.0)
            await until(lambda: events and visitor.pictures > 5 and visitor.loudest > 2000)
            attributes = dict(visitor.room.remote_participants[avatar.avatar_identity].attributes)
            await avatar.aclose()
            await agent.disconnect()
            await until(lambda: not visitor.room.remote_participants)
            await visitor.leave()
            return attributes, events

    attributes, events = asyncio.run(spoken())
    assert attributes["lk.publish_on_behalf"] == "agent"
    assert [(event.interrupted, round(event.playback_position, 1)) for event in events] == [(False, 2.0)]


@pytest.mark.timeout(1200)
def test_a_worker_follows_what_its_agent_does_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """``lk.agent.state``, ``lk.expression``, and the acts of an ``AvatarSession``: words, cues, pauses."""
    faces: list[AgentFace] = []
    monkeypatch.setattr(livekit_worker, "open_face", lambda options: faces.append(AgentFace.open(options)) or faces[0])
    options = AgentOptions(size=(128, 128), edges="none", frame_rate_hz=10.0, hears=False)

    async def followed() -> list[Any]:
        async with LiveKitDouble().open() as url, room_with(url) as (visitor, agent, _, _):
            working = asyncio.create_task(livekit_worker.work(url, token(IDENTITY), options))
            await until(lambda: IDENTITY in agent.remote_participants)
            await until(lambda: len(agent.remote_participants[IDENTITY].track_publications) == 2)
            face, given = faces[0], []
            send = face.host.send_command
            face.host.send_command = lambda command: (given.append(command), send(command))
            for state, then in (("thinking", "thinking"), ("listening", "idle")):
                await agent.local_participant.set_attributes({ATTRIBUTE_AGENT_STATE: state})
                await until(lambda then=then: face.attention.state == then)
            with pytest.raises(rtc.RpcError) as refused:
                await visitor.room.local_participant.perform_rpc(
                    destination_identity=IDENTITY, method=FACE_RPC, payload='[["pause"]]'
                )
            if refused.value.code == rtc.RpcError.ErrorCode.CONNECTION_TIMEOUT:
                skip_if_busy("no answer came")
            assert "only its agent" in refused.value.message
            for wrong in ("hello", '[["dance"]]', "3"):
                with pytest.raises(rtc.RpcError, match=r"expected a list of \[name, argument"):
                    await agent.local_participant.perform_rpc(
                        destination_identity=IDENTITY, method=FACE_RPC, payload=wrong
                    )
            output, events = RemoteOutput(agent), []
            output.on("playback_finished", events.append)
            output.pause()
            output.act("expect", "[nod] Hello there.")
            output.act("word", "Hello", 0.1, 0.4)
            await say(output, 2.0)
            await until(lambda: face.host.is_paused and face.host.is_speaking)
            expression = {ATTRIBUTE_TRANSCRIPTION_EXPRESSION: '{"expression":"say happily","mood":"happy"}'}
            writer = await agent.local_participant.stream_text(topic=TOPIC_TRANSCRIPTION)
            await writer.write("Hello there.")
            await writer.aclose(attributes=expression)
            await until(lambda: any(isinstance(command, Express) for command in given))
            assert len(face.host._cues[1]) == 2  # the nod, at its word
            assert (events, face.host.position_s) == ([], 0.0)
            output.resume()
            await until(lambda: events)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            return events

    (event,) = asyncio.run(followed())
    assert not event.interrupted
    assert event.playback_position == pytest.approx(2.0, abs=0.05)


def test_a_remote_face_needs_workers_and_credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("URL", "API_KEY", "API_SECRET"):
        monkeypatch.delenv(f"LIVEKIT_{name}", raising=False)
    with pytest.raises(UsageError, match="livekit_url: missing; give it, or set LIVEKIT_URL"):
        AvatarSession(remote=True)
    with pytest.raises(UsageError, match="head: a remote face has the options of its workers"):
        AvatarSession(remote=True, head="woman")
    secrets = {"livekit_url": "ws://127.0.0.1:1", "livekit_api_key": "key", "livekit_api_secret": "secret"}
    with pytest.raises(ResourceError, match=r"remote: no workers at http://127\.0\.0\.1:1 .*start them with --serve"):
        asyncio.run(AvatarSession(remote="http://127.0.0.1:1", **secrets).start(Session(), Room()))  # type: ignore[arg-type]
