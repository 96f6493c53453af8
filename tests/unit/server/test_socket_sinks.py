"""Sinks over WebSockets: readers of JSON weights, and a stand-in for VTube Studio with its documented messages."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest
from aiohttp import web
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import OCULUS_NAMES
from fapengine.server.cluster.workers import check_workers
from fapengine.server.config import Listen, ServerConfig
from fapengine.server.intake import doors
from fapengine.server.sinks import websockets as socket_sinks
from fapengine.server.sinks.kinds import SinkAddress, parse_sink
from fapengine.server.sinks.opening import open_sink
from fapengine.server.sinks.websockets import VtsSink, WeightStreams
from fapengine.wire.shapes import VisemeFollower
from fapengine.wire.vts import VtsDialog, vts_values
from tests.processes import free_port
from tests.unit.server.test_server_sinks import Stage, until

DEGREE = np.pi / 180 / 1e-5
"""Head and eyes count in 1e-5 rad."""
STANDARD = [
    "FaceAngleX",
    "FaceAngleY",
    "FaceAngleZ",
    "MouthOpen",
    "MouthSmile",
    "EyeOpenLeft",
    "EyeOpenRight",
    "VoiceA",
]
TOKEN = "adcd-123-ef09-some-token"


async def streams(stage: Stage, session: str | None = None) -> WeightStreams:
    sink = await open_sink(stage.hub, SinkAddress("ws-json", "127.0.0.1", 0, session))
    assert isinstance(sink, WeightStreams)
    return sink


async def wait_for(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(300):
        while not true():
            await asyncio.sleep(0.002)


def test_every_connection_gets_each_frame_and_a_face_at_rest_when_it_goes() -> None:
    async def main() -> None:
        stage = Stage("anna", "ben")
        sink = await streams(stage, "ben")
        url = f"ws://127.0.0.1:{sink.port}/"
        stage.talk("ben")
        async with aiohttp.ClientSession() as session, session.ws_connect(url) as one, session.ws_connect(url) as two:
            await until(lambda: len(sink.listeners) == 2)
            shown, found = [], []
            for _ in range(40):
                shown += stage.run(1)
                found.append(await one.receive_json())
                assert await two.receive_json() == found[-1]
            faps = np.array([frames.faps[1] for frames in shown])
            assert faps[:, fap.column(3)].max() > 0
            assert [frame["t"] for frame in found] == [round(frames.time_s, 4) for frames in shown]
            assert {frame["session"] for frame in found} == {"ben"}
            assert {tuple(frame["arkit"]) for frame in found} == {ARKIT_NAMES}
            assert {tuple(frame["visemes"]) for frame in found} == {OCULUS_NAMES}
            shapes = np.array([list(frame["arkit"].values()) for frame in found])
            mouth = np.array([list(frame["visemes"].values()) for frame in found])
            np.testing.assert_allclose(shapes, approximate_arkit(faps), atol=0.001)  # less than gradients leave
            follower = VisemeFollower()
            np.testing.assert_allclose(mouth, [follower.follow(row) for row in faps], atol=1e-4)
            stage.hub.host("ben").pin(48, round(10 * DEGREE))
            stage.hub.host("ben").pin(49, round(-20 * DEGREE))
            stage.run(1)
            assert (await one.receive_json())["head"][:2] == pytest.approx([10, -20], abs=0.01)
            stage.hub.close("ben")
            stage.run(1)
            rest = await one.receive_json()
            assert (rest["session"], rest["head"]) == ("ben", [0, 0, 0])
            assert not any(rest["arkit"].values())
            assert rest["visemes"]["sil"] == 1
            async with session.ws_connect(url) as late:  # who comes later is told how the face is, too
                assert await late.receive_json() == rest
            await sink.close()
            last = await one.receive()
            assert (last.type, last.data) == (aiohttp.WSMsgType.CLOSE, aiohttp.WSCloseCode.GOING_AWAY)

    asyncio.run(main())


def test_nothing_is_written_while_nobody_listens() -> None:
    async def main() -> None:
        stage = Stage("anna")
        sink = await streams(stage)
        stage.run(5)
        assert (sink.counts.sent, sink._newest) == (0, "")
        async with aiohttp.ClientSession() as session:
            async with session.ws_connect(f"ws://127.0.0.1:{sink.port}/") as one:
                await until(lambda: bool(sink.listeners))
                stage.run(1)
                assert (await one.receive_json())["session"] == "anna"
            await wait_for(lambda: not sink.listeners)
        stage.run(5)
        assert sink.counts.sent == 1
        await sink.close()

    asyncio.run(main())


def test_a_slow_reader_loses_frames_and_others_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "SEND_BUFFER", 4096)
    monkeypatch.setattr(socket_sinks, "UNREAD_BYTES", 4096)

    async def main() -> None:
        stage = Stage("anna")
        sink = await streams(stage)
        slow = socket.socket()
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", sink.port))
        slow.sendall(
            b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        )
        await until(lambda: len(sink.listeners) == 1)
        (stuck,) = sink.listeners.values()
        async with aiohttp.ClientSession() as session:
            async with session.ws_connect(f"ws://127.0.0.1:{sink.port}/") as quick:
                await until(lambda: len(sink.listeners) == 2)
                for _ in range(60):
                    (frames,) = stage.run(1)
                    assert (await quick.receive_json())["t"] == round(frames.time_s, 4)
            assert sink.counts.dropped > 20
            assert sink.counts.sent + sink.counts.dropped == 120
            assert stuck._transport is not None
            assert stuck._transport.get_write_buffer_size() < 3 * 4096
            slow.close()
        await sink.close()

    asyncio.run(main())


def test_connections_are_capped_and_pages_of_others_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket_sinks, "CONNECTIONS", 1)

    async def main() -> None:
        sink = await streams(Stage("anna"))
        url = f"http://127.0.0.1:{sink.port}/"
        async with aiohttp.ClientSession() as session:
            async with session.get(url) as answer:
                assert answer.status == 426
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await session.ws_connect(url, headers={"Origin": "http://evil.example"})
        async with aiohttp.ClientSession() as session, session.ws_connect(url) as only:
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await session.ws_connect(url)
            await only.send_bytes(bytes(5000))  # a reader has nothing to say
            assert (await only.receive()).type is aiohttp.WSMsgType.CLOSE
        taken = SinkAddress("ws-json", "127.0.0.1", sink.port)
        with pytest.raises(ResourceError, match=f"TCP port {sink.port}"):
            await open_sink(Stage("anna").hub, taken)
        await sink.close()

    asyncio.run(main())


def test_addresses_of_socket_sinks() -> None:
    assert parse_sink("ws-json://:9200?session=a") == SinkAddress("ws-json", "127.0.0.1", 9200, "a")
    assert parse_sink("vts://localhost").port == 8001
    assert parse_sink("vts://h?token_file=t").options == {"token_file": "t"}
    for wrong in ("vts://", "ws-json://127.0.0.1", "ws-json://h:1?names=x"):
        with pytest.raises(UsageError, match="sink"):
            parse_sink(wrong)
    for url in ("ws-json://:9200?session=a", "vts://h?session=a"):
        with pytest.raises(UsageError, match="expected one that sends datagrams"):
            check_workers(ServerConfig(listen=Listen(workers=2), sinks=(url,)))


class Studio:
    """Stateful: the API's messages as DenchiSoft/VTubeStudio documents them, with a user who answers."""

    def __init__(self, *, allows: bool = True) -> None:
        self.allows, self.tokens = allows, {TOKEN}
        self.asked = asyncio.Event()
        self.may_answer = asyncio.Event()
        self.requests: list[str] = []
        self.injected: list[dict[str, float]] = []
        self.connections: set[web.WebSocketResponse] = set()
        self.answers = True

    async def answer(self, request: web.Request) -> web.WebSocketResponse:
        link = web.WebSocketResponse()
        await link.prepare(request)
        self.connections.add(link)
        is_open = False
        async for message in link:
            asked = json.loads(message.data)
            assert (asked["apiName"], asked["apiVersion"]) == ("VTubeStudioPublicAPI", "1.0")
            kind, data = asked["messageType"], asked["data"]
            if kind != "InjectParameterDataRequest":
                self.requests.append(kind)
            if kind == "AuthenticationTokenRequest":
                assert 3 <= len(data["pluginName"]) <= 32
                assert 3 <= len(data["pluginDeveloper"]) <= 32
                self.asked.set()
                await self.may_answer.wait()
            reply, content = self.reply(kind, data, is_open)
            is_open = is_open or content.get("authenticated") is True
            if self.answers or kind != "InjectParameterDataRequest":
                stamp = {"timestamp": 1625405710728, "requestID": asked["requestID"]}
                head = {"apiName": "VTubeStudioPublicAPI", "apiVersion": "1.0"}
                await link.send_json({**head, **stamp, "messageType": reply, "data": content})
        self.connections.discard(link)
        return link

    def reply(self, kind: str, data: dict[str, Any], is_open: bool) -> tuple[str, dict[str, Any]]:
        if kind == "AuthenticationTokenRequest":
            if not self.allows:
                return "APIError", {"errorID": 50, "message": "User has denied API access for your plugin."}
            return "AuthenticationTokenResponse", {"authenticationToken": TOKEN}
        if kind == "AuthenticationRequest":
            good = data["authenticationToken"] in self.tokens
            return "AuthenticationResponse", {"authenticated": good, "reason": "as the token is"}
        if not is_open:
            return "APIError", {"errorID": 8, "message": "This request requires authentication."}
        if kind == "InputParameterListRequest":
            rows = [{"name": n, "addedBy": "VTube Studio", "value": 0, "min": 0, "max": 1} for n in STANDARD]
            return "InputParameterListResponse", {
                "modelLoaded": True,
                "defaultParameters": rows,
                "customParameters": [],
            }
        values = {row["id"]: row["value"] for row in data["parameterValues"]}
        if not set(values) <= set(STANDARD):
            return "APIError", {"errorID": 453, "message": "Parameter not found."}
        self.injected.append(values)
        return "InjectParameterDataResponse", {}


@asynccontextmanager
async def running(studio: Studio, port: int) -> AsyncIterator[None]:
    app = web.Application()
    app.router.add_get("/", studio.answer)
    runner = web.AppRunner(app, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    try:
        yield
    finally:
        for link in tuple(studio.connections):
            await link.close()
        await runner.cleanup()


def test_vtube_studio_is_waited_for_asked_and_shown_the_face(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(socket_sinks, "RETRIES_S", (0.01,))
    port, kept = free_port(), tmp_path / "token"

    async def main() -> None:
        stage = Stage("anna")
        sink = await open_sink(stage.hub, SinkAddress("vts", "127.0.0.1", port, None, {"token_file": str(kept)}))
        assert isinstance(sink, VtsSink)
        stage.talk("anna")
        stage.run(5)  # it is not there yet
        await asyncio.sleep(0.03)
        studio = Studio()
        async with running(studio, port):
            await asyncio.wait_for(studio.asked.wait(), 300)
            stage.run(5)
            assert not studio.injected  # the user has not answered
            studio.may_answer.set()
            await wait_for(lambda: sink.dialog.state == "ready")
            for _ in range(30):
                stage.run(1)
                await wait_for(lambda: sink.dialog.unanswered == 0)
            assert len(studio.injected) == 30
            assert {tuple(sorted(values)) for values in studio.injected} == {tuple(sorted(STANDARD))}
            assert max(values["MouthOpen"] for values in studio.injected) > 0.1
            studio.answers = False
            for _ in range(40):
                stage.run(1)
                await asyncio.sleep(0)
            await wait_for(lambda: sink.dialog.unanswered == socket_sinks.UNANSWERED)
            assert sink.counts.dropped >= 10
        again = Studio()
        async with running(again, port):  # it was restarted: the token is still good
            await wait_for(lambda: sink.dialog.state == "ready")
            assert again.requests == ["AuthenticationRequest", "InputParameterListRequest"]
            stage.hub.close("anna")
            stage.run(2)
            await wait_for(lambda: bool(again.injected))
            assert (again.injected[-1]["MouthOpen"], again.injected[-1]["MouthSmile"]) == (0, 0.5)
            await sink.close()
        assert kept.read_text() == TOKEN
        assert kept.stat().st_mode & 0o077 == 0
        revoked = Studio()
        revoked.tokens = set()
        revoked.may_answer.set()
        async with running(revoked, port):
            other = VtsSink(stage.hub, SinkAddress("vts", "127.0.0.1", port, None, {"token_file": str(kept)}))
            await wait_for(lambda: len(revoked.requests) >= 3)
            asked = ["AuthenticationRequest", "AuthenticationTokenRequest", "AuthenticationRequest"]
            assert revoked.requests[:3] == asked
            await other.close()

    asyncio.run(main())
    assert "allow fapengine in VTube Studio's window" in caplog.text
    assert TOKEN not in caplog.text


def test_a_user_who_says_no_is_not_asked_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(socket_sinks, "RETRIES_S", (0.0,))
    port = free_port()

    async def main() -> None:
        studio = Studio(allows=False)
        studio.may_answer.set()
        async with running(studio, port):
            sink = VtsSink(Stage("anna").hub, SinkAddress("vts", "127.0.0.1", port))
            await wait_for(sink._task.done)
            assert studio.requests == ["AuthenticationTokenRequest"]
            await sink.close()

    asyncio.run(main())
    assert "it is not requested again" in caplog.text


def test_turns_and_lids_of_vtube_studio() -> None:
    faps, shapes = np.zeros(68), np.zeros(52)
    for number, degrees in ((48, 5), (49, 10), (50, 15), (23, 15), (26, 60)):
        faps[fap.column(number)] = degrees * DEGREE
    shapes[ARKIT_NAMES.index("eyeBlinkLeft")] = 1
    values = vts_values(shapes, [1.0] + [0.0] * 14, faps)
    assert [values[f"FaceAngle{axis}"] for axis in "XYZ"] == pytest.approx([10, -5, -15], abs=0.001)
    assert (values["EyeLeftX"], values["EyeRightY"]) == (pytest.approx(0.5, abs=0.001), -1)
    assert (values["EyeOpenLeft"], values["EyeOpenRight"]) == (0, 0.8)
    assert (values["Brows"], values["BrowLeftY"], values["VoiceO"]) == (0.5, 0.5, 0)


KINDS = ["APIError", "AuthenticationTokenResponse", "AuthenticationResponse", "InputParameterListResponse",
         "InjectParameterDataResponse"]  # fmt: skip
FIELDS = ["errorID", "message", "authenticationToken", "authenticated", "defaultParameters", "name"]
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(FIELDS), inner, max_size=3),
    max_leaves=6,
)
SAID = st.one_of(st.text(max_size=20), JUNK.map(json.dumps), st.builds(
    lambda kind, data: json.dumps({"messageType": kind, "data": data}), st.sampled_from(KINDS), JUNK
))  # fmt: skip


@settings(max_examples=60)
@given(said=st.lists(SAID, max_size=6), token=st.none() | st.just(TOKEN))
def test_whatever_is_said_the_dialog_goes_on_or_says_what_is_wrong(said: list[str], token: str | None) -> None:
    dialog = VtsDialog(token)
    json.loads(dialog.begin())
    for text in said:
        try:
            answer = dialog.take(text)
        except DataError:
            return
        assert answer is None or json.loads(answer)["apiVersion"] == "1.0"
        assert dialog.unanswered == 0
