"""The one-file agents of ``examples/agents`` in their frameworks: ``make oracles`` runs it beside the other checks."""

import asyncio
import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from aiohttp import ClientSession, web
from aiortc import RTCPeerConnection, RTCSessionDescription
from pipecat.frames.frames import OutputImageRawFrame, TTSAudioRawFrame, TTSTextFrame
from pipecat.pipeline.pipeline import Pipeline
from pipecat.processors.frameworks.rtvi import RTVIClientMessageFrame
from pipecat.tests.utils import SleepFrame, run_test

AGENTS = Path(__file__).resolve().parents[2] / "examples" / "agents"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, AGENTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


async def _answered() -> list[Any]:
    made = example("pipecat_agent").processors((64, 64))
    await made[-1]._face.ready()
    asked = RTVIClientMessageFrame(msg_id="1", type="say", data={"text": "my mama"})
    down, _ = await run_test(Pipeline(made), frames_to_send=[asked, SleepFrame(4.0)], start_timeout=20)
    return list(down)


@pytest.mark.timeout(90)
def test_the_agent_of_pipecat_answers_with_a_face() -> None:
    down = asyncio.run(_answered())
    sound = b"".join(frame.audio for frame in down if isinstance(frame, TTSAudioRawFrame))
    assert np.abs(np.frombuffer(sound, np.int16)).max() > 1000
    assert [frame.text for frame in down if isinstance(frame, TTSTextFrame)] == ["You", "said", "my", "mama"]
    talking = [frame for frame in down if isinstance(frame, OutputImageRawFrame) and frame.sync_with_audio]
    assert len(talking) > 20
    assert len({frame.image for frame in talking}) > 10


async def _called() -> tuple[list[int], int]:
    module = example("pipecat_agent")
    runner = web.AppRunner(module.application((128, 128)))
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = site._server.sockets[0].getsockname()[1]  # type: ignore[union-attr]
    peer, pictures, loudest = RTCPeerConnection(), [], [0]

    async def read(track: Any) -> None:
        while True:
            frame = await track.recv()
            if track.kind == "video":
                pictures.append(frame.width)
            else:
                loudest[0] = max(loudest[0], int(np.abs(frame.to_ndarray()).max()))

    readers = []
    peer.on("track", lambda track: readers.append(asyncio.ensure_future(read(track))))
    channel = peer.createDataChannel("chat")
    for kind in ("audio", "video"):
        peer.addTransceiver(kind, direction="recvonly")
    await peer.setLocalDescription(await peer.createOffer())
    async with ClientSession() as http:
        description = {"sdp": peer.localDescription.sdp, "type": peer.localDescription.type}
        async with http.post(f"http://127.0.0.1:{port}/offer", json=description) as reply:
            answer = await reply.json()
    await peer.setRemoteDescription(RTCSessionDescription(**answer))
    async with asyncio.timeout(60):
        while not pictures or channel.readyState != "open":
            await asyncio.sleep(0.1)
        say = {"t": "say", "d": {"text": "plum jam"}}
        channel.send(json.dumps({"label": "rtvi-ai", "type": "client-message", "id": "1", "data": say}))
        while loudest[0] < 1000:
            await asyncio.sleep(0.1)
    await asyncio.sleep(1.0)
    for reader in readers:
        reader.cancel()
    await peer.close()
    await asyncio.sleep(0.5)
    await runner.cleanup()
    return pictures, loudest[0]


@pytest.mark.timeout(120)
def test_a_visitor_of_its_page_sees_and_hears_the_answer() -> None:
    pictures, loudest = asyncio.run(_called())
    assert len(pictures) > 5
    assert loudest >= 1000


async def _said() -> tuple[Any, list[Any], list[str]]:
    from tests.frameworks.check_livekit import Room

    module = example("livekit_agent")
    avatar, session, events = module.AvatarSession(size=(64, 64)), module.session_of(), []
    avatar._wait_avatar_join = lambda: asyncio.sleep(0)
    await avatar.start(session, Room())
    session.output.audio.on("playback_finished", events.append)
    told, act = [], avatar._act
    avatar._act = lambda name, *given: (told.append(given[0].strip()) if name == "word" else None, act(name, *given))
    await session.start(module.Assistant(avatar))
    handle = session.say(module.answer("plum jam"))
    await asyncio.wait_for(handle.wait_for_playout(), 30)
    await session.aclose()
    await avatar.aclose()
    return handle, events, told


@pytest.mark.timeout(90)
def test_the_agent_of_livekit_says_what_it_is_asked_to() -> None:
    handle, events, told = asyncio.run(_said())
    assert not handle.interrupted
    assert [event.interrupted for event in events] == [False]
    assert events[0].playback_position > 0.8
    assert told == ["You", "said", "plum", "jam"]
