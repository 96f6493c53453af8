"""The suites for WebSocket servers and clients: the messages of docs/page.md, with aiohttp."""

import asyncio
import contextlib
import json
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fapengine.clients.websocket_viewer import web_socket_of
from fapengine.conformance.cases import Case, NotTriedError, demand
from fapengine.errors import DataError, ResourceError
from fapengine.mpeg4 import fap
from fapengine.server.web.messages import FRAME, FRAME_KIND, parse_request, parse_sound, text_of

SOCKET, WRONG = "docs/page.md: The WebSocket", "docs/page.md: What each side sees when something goes wrong"
FRAME_BYTES = 288
LISTENED_S, QUIET_S = 3.0, 0.5
PROTOCOL = "fapengine-web/1"
HELLO: dict[str, tuple[type, ...]] = {
    "session": (str,), "rate_hz": (int, float), "profile": (str,), "voice": (bool,), "recognizer": (bool,),
    "sound": (str,), "paused": (bool,),
}  # fmt: skip
"""Fields of the first message, and their types."""


@dataclass(slots=True)
class PageServer:
    """A server under test: the address of its web page."""

    url: str

    def exchange(self, *texts: str | bytes, **options: Any) -> list[Any]:
        """Run :meth:`talk`."""
        return asyncio.run(self.talk(*texts, **options))

    def answers(self, kind: str, *texts: str | bytes, **options: Any) -> list[dict[str, Any]]:
        """Connect, send, and collect answers until one is of a kind; return those of that kind."""
        return _texts(self.exchange(*texts, until=lambda heard: bool(_texts(heard, kind)), **options), kind)

    async def talk(
        self,
        *texts: str | bytes,
        until: Callable[[list[Any]], bool] = lambda heard: False,
        for_s: float = LISTENED_S,
        session: str = "conformance",
    ) -> list[Any]:
        """Connect, send, and collect answers: texts as dicts, frames as bytes, the close as its code."""
        from aiohttp import ClientError, ClientSession, WSMsgType

        heard: list[Any] = []
        try:
            async with ClientSession() as client, client.ws_connect(web_socket_of(self.url, session)) as socket:
                for text in texts:
                    await (socket.send_bytes(text) if isinstance(text, bytes) else socket.send_str(text))
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(for_s):
                        while not until(heard):
                            message = await socket.receive()
                            if message.type is WSMsgType.TEXT:
                                heard.append(json.loads(message.data))
                            elif message.type is WSMsgType.BINARY:
                                heard.append(message.data)
                            else:
                                heard.append(socket.close_code)
                                break
        except (ClientError, OSError) as error:
            raise ResourceError(f"{self.url}: {error}") from error
        return heard


def _texts(heard: list[Any], kind: str) -> list[dict[str, Any]]:
    return [one for one in heard if isinstance(one, dict) and one.get("type") == kind]


def _frames(heard: list[Any]) -> list[tuple[int, float, tuple[int, ...]]]:
    frames = []
    for one in heard:
        if isinstance(one, bytes) and len(one) >= 4 and struct.unpack_from("<I", one)[0] == FRAME_KIND:
            demand(len(one) == FRAME_BYTES, f"got a frame of {len(one)} bytes, expected {FRAME_BYTES}")
            _, number, time_s = struct.unpack_from("<IId", one)
            frames.append((number, time_s, struct.unpack_from(f"<{fap.FAP_COUNT}i", one, 16)))
    return frames


def _greets(server: PageServer) -> None:
    heard = server.exchange(until=bool)
    demand(heard and isinstance(heard[0], dict) and heard[0].get("type") == "hello", "its first message is not a hello")
    demand(heard[0].get("protocol") == PROTOCOL, f"got protocol {heard[0].get('protocol')!r}, expected {PROTOCOL!r}")
    for name, kind in HELLO.items():
        demand(isinstance(heard[0].get(name), kind), f"hello: {name}: got {heard[0].get(name)!r}")
    demand(heard[0]["session"] == "conformance", f"got session {heard[0]['session']!r}, expected 'conformance'")


def _shows(server: PageServer) -> None:
    frames = _frames(server.exchange(until=lambda heard: len(_frames(heard)) >= 20, for_s=2 * LISTENED_S))
    demand(len(frames) >= 20, f"got {len(frames)} frames")
    numbers, times = [frame[0] for frame in frames], [frame[1] for frame in frames]
    demand(numbers == sorted(set(numbers)), "frame numbers do not rise")
    demand(times == sorted(times) and all(map(math.isfinite, times)), "frame times do not rise")


def _pongs(server: PageServer) -> None:
    pongs = server.answers("pong", text_of("ping", number=42))
    demand(pongs and pongs[0].get("number") == 42, f"got {pongs[:1]} to ping 42")
    demand(isinstance(pongs[0].get("time_s"), int | float), "a pong has no time_s")


def _pins(server: PageServer) -> None:
    def is_pinned(heard: list[Any]) -> bool:
        return any(values[16 - 1] == 123 for _, _, values in _frames(heard))

    heard = server.exchange(text_of("pin", values={"16": 123}), until=is_pinned, session="conformance-pin")
    demand(is_pinned(heard), "FAP 16 was pinned to 123, but no frame shows it")
    demand(_texts(heard, "pins"), "the pin was not reported")


INVALID = (
    "{", "[]", '{"type": "nothing"}', '{"type": "blink", "misspelt": 1}', '{"type": "look", "yaw": 9, "pitch": 0}',
)  # fmt: skip


def _refuses_nonsense(server: PageServer) -> None:
    for text in INVALID:
        demand(server.answers("error", text), f"{text}: got no error")


def _survives_nonsense(server: PageServer) -> None:
    wrong = ('{"type": "nothing"}', b"\xff" * 20, b"")
    pongs = server.answers("pong", *wrong, text_of("ping", number=1))
    demand(pongs, "it no longer answers after three invalid messages")


def _closes_on_long(server: PageServer) -> None:
    heard = server.exchange("x" * 70_000)
    demand(1009 in heard, f"a message of 70000 characters was accepted (closed with {heard[-1] if heard else None})")


def _guards_origin(server: PageServer) -> None:
    async def status() -> int:
        from aiohttp import ClientSession, WSServerHandshakeError

        try:
            async with ClientSession() as client, client.ws_connect(
                web_socket_of(server.url), headers={"Origin": "http://evil.example"}
            ):  # fmt: skip
                return 101
        except WSServerHandshakeError as error:
            return error.status

    found = asyncio.run(status())
    demand(found == 403, f"a page of another site got {found}, expected 403")


SERVER_CASES: tuple[Case[PageServer], ...] = (
    Case("1.1", SOCKET, "its first message is hello, with every field", _greets),
    Case("1.2", SOCKET, "frames have 288 bytes; numbers and times rise", _shows),
    Case("1.3", SOCKET, "ping is answered by pong with its number and the engine's time", _pongs),
    Case("1.4", SOCKET, "a pinned FAP is shown and reported", _pins),
    Case("2.1", SOCKET, "an invalid message, also one with a misspelt field, is answered by error", _refuses_nonsense),
    Case("2.2", WRONG, "it continues after invalid messages", _survives_nonsense),
    Case("2.3", WRONG, "a message longer than 64 KiB closes the connection with 1009", _closes_on_long),
    Case("2.4", WRONG, "a page of another site is refused with 403", _guards_origin),
)


# Clients --------------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class PageClient:
    """A record of what a client did.

    Stateful.
    """

    connections: int = 0
    breaches: list[str] = field(default_factory=list)
    types: list[str] = field(default_factory=list)
    sounds: int = 0
    left_after_unknown: bool = False


async def watch(port: int, for_s: float, tell: Callable[[str], None], host: str = "127.0.0.1") -> PageClient:
    """Serve one client for ``for_s``: a moving face, messages of a later version, and one disconnection."""
    from aiohttp import WSMsgType, web

    client = PageClient()
    loop = asyncio.get_running_loop()

    async def answer(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        client.connections += 1
        session = request.query.get("session", "face")
        hello = {
            "session": session, "rate_hz": 60.0, "profile": "none", "voice": False, "recognizer": True, "sound": "page",
        }  # fmt: skip
        await socket.send_str(text_of("hello", protocol=PROTOCOL, paused=False, **hello))
        sending = asyncio.create_task(_show(socket))
        stop_s = loop.time() + for_s / 3  # then the connection ends, as if the server had restarted
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(stop_s if client.connections == 1 else None):
                async for message in socket:
                    if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                        _note(client, message.data)
                client.left_after_unknown = client.connections == 1
        sending.cancel()
        await socket.close()
        return socket

    async def _show(socket: web.WebSocketResponse) -> None:
        number = 0
        with contextlib.suppress(ConnectionError):
            while not socket.closed:
                values = [0] * fap.FAP_COUNT
                values[2] = round(200 + 200 * math.sin(number / 6))
                await socket.send_bytes(FRAME.pack(FRAME_KIND, number, loop.time(), *values))
                if number % 30 == 7:
                    await socket.send_bytes(struct.pack("<I", 77) + b"of a later version")
                    await socket.send_str(text_of("later", version=2))
                number += 1 + (number % 50 == 0)  # some are skipped
                await asyncio.sleep(1 / 60)

    app = web.Application()
    app.router.add_get("/ws", answer)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.2)
    await runner.setup()
    try:
        await web.TCPSite(runner, host, port).start()
    except OSError as error:
        await runner.cleanup()
        raise ResourceError(f"TCP port {port}: {error.strerror}") from error
    tell(f"connect a client to ws://{host}:{runner.addresses[0][1]}/ws?session=face, for {for_s:.0f} s")
    await asyncio.sleep(for_s)
    await runner.cleanup()
    return client


def _note(client: PageClient, data: str | bytes) -> None:
    try:
        if isinstance(data, bytes):
            parse_sound(data)
            client.sounds += 1
        else:
            client.types.append(str(json.loads(data).get("type")))
            parse_request(data)
    except (DataError, ValueError, AttributeError) as error:
        client.breaches.append(str(error))


def _connects(client: PageClient) -> None:
    demand(client.connections, "no client connected")


def _readable(client: PageClient) -> None:
    _connects(client)
    if not client.types and not client.sounds:
        raise NotTriedError("it sent nothing")
    demand(not client.breaches, "; ".join(dict.fromkeys(client.breaches)))


def _stays(client: PageClient) -> None:
    _connects(client)
    demand(not client.left_after_unknown, "it left before the server did: skipped frames, or unknown messages")


def _returns(client: PageClient) -> None:
    demand(client.connections > 1, "it did not reconnect after the connection had ended")


def _clock(client: PageClient) -> None:
    _connects(client)
    demand("ping" in client.types, "it sent no ping, so it cannot know the server's clock")


CLIENT_CASES: tuple[Case[PageClient], ...] = (
    Case("1.1", SOCKET, "it connects to /ws", _connects),
    Case("1.2", SOCKET, "every message that it sends is readable", _readable),
    Case("1.3", SOCKET, "skipped frames, and messages of a later version, are ignored", _stays),
    Case("1.4", "docs/page.md: How it keeps time", "it pings", _clock),
    Case("2.1", WRONG, "it reconnects when the connection has ended", _returns),
)
