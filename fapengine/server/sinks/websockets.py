"""WebSocket sinks: JSON weights for all who connect here, and a client of VTube Studio.

A receiver gets the newest frame. Frames that it is too slow for are dropped and counted, never queued.
"""

import asyncio
import contextlib
import logging
import os
from functools import partial
from pathlib import Path
from typing import Any

import aiohttp
from aiohttp import web

from fapengine.errors import DataError, ResourceError
from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrames
from fapengine.server.intake.doors import Door, limit_unread
from fapengine.server.sinks import encoders
from fapengine.server.sinks.kinds import SinkAddress, SinkCounts
from fapengine.server.web.access import Access
from fapengine.server.web.site import Site, harden, open_site
from fapengine.wire.vts import MAX_TOKEN, VtsDialog

CONNECTIONS = 64
UNREAD_BYTES = 8 << 10
"""Unsent bytes, some frames, beyond which frames are dropped."""
MAX_RECEIVED = 1024
"""Bytes of a message from a reader; its messages are ignored."""
HEARTBEAT_S, CLOSE_S, CONNECT_S = 20.0, 1.0, 5.0
RETRIES_S = (1.0, 2.0, 5.0, 10.0)
UNANSWERED = 30
"""Unanswered frames, half a second, beyond which VTube Studio is sent no frames until it answers."""
MAX_ANSWER = 1 << 20

log = logging.getLogger("fapengine.server")


class _Outbox:
    """The newest text for one socket. Stateful."""

    def __init__(self, transport: asyncio.WriteTransport | None = None) -> None:
        self._transport = transport
        self._text: str | None = None
        self._filled = asyncio.Event()

    def offer(self, text: str) -> bool:
        """Replace the waiting text; False if a text is dropped."""
        waiting = self._transport.get_write_buffer_size() if self._transport is not None else 0
        if waiting > UNREAD_BYTES:
            return False
        is_free = self._text is None
        self._text = text
        self._filled.set()
        return is_free

    async def send(self, to: web.WebSocketResponse | aiohttp.ClientWebSocketResponse) -> None:
        """Send until the socket is closed."""
        with contextlib.suppress(ConnectionError):
            while not to.closed:
                await self._filled.wait()
                self._filled.clear()
                text, self._text = self._text, None
                if text is not None:
                    await to.send_str(text)


class WeightStreams:
    """A WebSocket server that sends one face's weights to every connection. Stateful."""

    def __init__(self, hub: Hub, address: SinkAddress) -> None:
        self.address, self.counts = address, SinkCounts()
        self.door = Door.shared(CONNECTIONS)
        self.listeners: dict[web.WebSocketResponse, _Outbox] = {}
        self._new_face = partial(encoders.weights_face, address.session, rate_hz=hub.pacer.rate_hz)
        self._face = self._new_face()
        self._newest = ""
        self._site: Site | None = None
        self._stop = hub.listeners.on_frames(self._show)

    @classmethod
    async def open(cls, hub: Hub, address: SinkAddress) -> "WeightStreams":
        """Listen for connections. Raises ResourceError if the port is in use."""
        sink = cls(hub, address)
        app = web.Application()
        app.router.add_get("/", sink._answer)
        harden(app)
        try:
            sink._site = await open_site(app, address.host, address.port, sink.door)
        except ResourceError:
            await sink.close()
            raise
        return sink

    @property
    def port(self) -> int:
        """Port on which it listens."""
        return 0 if self._site is None else self._site.address[1]

    async def close(self) -> None:
        """Close all connections."""
        self._stop()
        await asyncio.gather(*(one.close(code=aiohttp.WSCloseCode.GOING_AWAY) for one in tuple(self.listeners)))
        if self._site is not None:
            await self._site.close()

    def _show(self, frames: HubFrames) -> None:
        if not self.listeners:
            return
        for data in self._face.encode(frames):
            self._newest = data.decode()
            for outbox in self.listeners.values():
                taken = outbox.offer(self._newest)
                self.counts.sent += taken
                self.counts.dropped += not taken

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        Access().admit(request)
        receiver = web.WebSocketResponse(
            heartbeat=HEARTBEAT_S, max_msg_size=MAX_RECEIVED, compress=False, timeout=CLOSE_S
        )
        if not receiver.can_prepare(request).ok:
            return web.Response(status=426, text="This address serves WebSocket.\n", headers={"Upgrade": "websocket"})
        await receiver.prepare(request)
        if request.transport is not None:
            limit_unread(request.transport, UNREAD_BYTES, UNREAD_BYTES)
        if not self.listeners:  # nothing was written meanwhile: the next frame is the first, or neutral
            self._face, self._newest = self._new_face(), ""
        outbox = self.listeners[receiver] = _Outbox(request.transport)
        if self._newest:
            outbox.offer(self._newest)
        sending = asyncio.create_task(outbox.send(receiver))
        try:
            async for _ in receiver:
                pass
        finally:
            del self.listeners[receiver]
            await _ended(sending)
        return receiver


class VtsSink:
    """A client of VTube Studio that reconnects, and waits for the user's permission. Stateful."""

    def __init__(self, hub: Hub, address: SinkAddress) -> None:
        self.address, self.counts = address, SinkCounts()
        name = address.options.get("token_file")
        self._token_file = Path(name) if name else None
        self.dialog = VtsDialog(self._kept_token())
        self._new_face = partial(encoders.vts_face, self.dialog, address.session, rate_hz=hub.pacer.rate_hz)
        self._face = self._new_face()
        self._outbox: _Outbox | None = None
        self._reported = ""
        self._task = asyncio.create_task(self._keep())
        self._stop = hub.listeners.on_frames(self._show)

    async def close(self) -> None:
        """Stop sending."""
        self._stop()
        await _ended(self._task)

    def _show(self, frames: HubFrames) -> None:
        if self._outbox is None or self.dialog.state != "ready":
            return
        if self.dialog.unanswered >= UNANSWERED:
            self.counts.dropped += 1
            return
        for data in self._face.encode(frames):
            taken = self._outbox.offer(data.decode())
            self.dialog.unanswered -= not taken
            self.counts.sent += taken
            self.counts.dropped += not taken

    async def _keep(self) -> None:
        tries = 0
        async with aiohttp.ClientSession() as session:
            while not self.dialog.is_denied:
                try:
                    async with asyncio.timeout(CONNECT_S):
                        link = await session.ws_connect(
                            f"ws://{self.address.url_host}:{self.address.port}",
                            max_msg_size=MAX_ANSWER,
                            heartbeat=HEARTBEAT_S,
                        )
                    tries = 0
                    async with link:
                        await self._talk(link)
                    self._report("the connection ended; reconnecting")
                except (aiohttp.ClientError, OSError, DataError) as error:
                    self._report(f"{error or type(error).__name__}; reconnecting")
                if not self.dialog.is_denied:
                    self.dialog.state = "closed"
                    await asyncio.sleep(RETRIES_S[min(tries, len(RETRIES_S) - 1)])
                    tries += 1
        self._report("the user denied permission; it is not requested again")

    async def _talk(self, link: aiohttp.ClientWebSocketResponse) -> None:
        self._face = self._new_face()
        self._outbox = _Outbox()
        await link.send_str(self.dialog.begin())
        if self.dialog.state == "asking":
            self._report("asks for permission: allow fapengine in VTube Studio's window")
        sending = asyncio.create_task(self._outbox.send(link))
        try:
            async for message in link:
                if message.type is aiohttp.WSMsgType.TEXT:
                    await self._take(link, message.data)
                if self.dialog.is_denied:
                    return
        finally:
            self._outbox = None
            await _ended(sending)

    async def _take(self, link: aiohttp.ClientWebSocketResponse, text: str) -> None:
        before = self.dialog.state
        answer = self.dialog.take(text)
        if answer is not None:
            await link.send_str(answer)
        if self.dialog.state == "listing":
            self._keep_token()
        elif self.dialog.state == "asking" != before:
            self._report("asks for permission: allow fapengine in VTube Studio's window")
        elif self.dialog.state == "ready" != before:
            self._report("receives the face")
        if self.dialog.complaint:
            self._report(self.dialog.complaint)

    def _report(self, what: str) -> None:
        """Log a message unless it repeats the last one."""
        if what != self._reported:
            log.warning("sink %s: %s", self.address, what)
        self._reported = what

    def _kept_token(self) -> str | None:
        try:
            kept = self._token_file.read_text("ascii").strip() if self._token_file else ""
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise ResourceError(f"sink vts: token_file: got {error}, expected a file that can be read") from error
        return kept if 0 < len(kept) <= MAX_TOKEN else None

    def _keep_token(self) -> None:
        if self._token_file is None or self.dialog.token is None:
            return
        try:
            number = os.open(self._token_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(number, "w", encoding="ascii") as file:
                file.write(self.dialog.token)
        except (OSError, ValueError) as error:
            self._report(f"token_file: {error}; permission is requested again next time")


async def _ended(task: "asyncio.Task[Any]") -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError, ConnectionError):
        await task
