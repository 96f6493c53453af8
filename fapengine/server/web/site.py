"""A web application at a port: connections counted, slow and silent ones hung up on.

aiohttp has no limit for the time that the head of a request takes, nor for connections. A connection has
:data:`IDLE_S` from its beginning to the end of the first head, and as long from each answer to the end of the next
head; an answer may take longer as long as it is being read.
"""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, cast

from aiohttp import web

from fapengine.errors import ResourceError
from fapengine.server.intake.doors import Door
from fapengine.server.web.admission import HEADERS, SERVER

FULL_ANSWER = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Length: 0\r\n"
    + "".join(f"{name}: {value}\r\n" for name, value in {**HEADERS, "Server": SERVER}.items()).encode()
    + b"\r\n"
)
"""Answer to a connection beyond the limits."""
IDLE_S = 10.0
"""Time for the head of a request, silence before it included."""

log = logging.getLogger("fapengine.web")
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(slots=True)
class Site:
    """A running web application.

    Stateful.
    """

    runner: web.AppRunner
    listening: asyncio.Server | None
    address: tuple[str, int]
    make: "Callable[[], GuardedHandler]"

    async def adopt(self, accepted: socket.socket) -> None:
        """Take a connection that was accepted elsewhere."""
        await asyncio.get_running_loop().connect_accepted_socket(self.make, accepted)

    async def close(self) -> None:
        """End all connections."""
        if self.listening is not None:
            self.listening.close()
        await self.runner.cleanup()


class GuardedHandler(web.RequestHandler):
    """One connection of a site.

    Stateful.
    """

    def __init__(self, manager: web.Server, door: Door, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(manager, loop=loop, access_log=cast("Any", None), logger=cast("Any", log))
        self._door, self._timing = door, loop
        self._address: str | None = None
        self._unread = 0
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, if there is room."""
        address = str(transport.get_extra_info("peername")[0])
        super().connection_made(transport)
        if self._door.enter(address):
            self._address = address
            self.wait()
        else:  # a word, if the system takes it at once, and the end
            cast("asyncio.Transport", transport).write(FULL_ANSWER)
            cast("asyncio.Transport", transport).close()

    def connection_lost(self, exc: BaseException | None) -> None:
        """Forget it."""
        self.go()
        if self._address is not None:
            self._door.leave(self._address)
            self._address = None
        super().connection_lost(exc)

    def wait(self) -> None:
        """Give it time for the next request."""
        self.go()
        self._unread = 0
        self._timer = self._timing.call_later(IDLE_S, self._hang_up)

    def go(self) -> None:
        """Stop the time: a request is being answered."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _hang_up(self) -> None:
        if self.transport is None:
            return
        unread = self.transport.get_write_buffer_size()
        if unread and (not self._unread or unread < self._unread):  # the answer is still on its way, and is being read
            self._unread = unread
            self._timer = self._timing.call_later(IDLE_S, self._hang_up)
            return
        self._door.counts.timed_out += 1
        self.transport.abort()

    def handle_error(
        self, request: web.BaseRequest, status: int = 500, exc: BaseException | None = None, message: str | None = None
    ) -> web.StreamResponse:
        """Answer what is no request in one line, and without a word in the log: anybody can send it."""
        if status >= 500:
            answer = super().handle_error(request, status, exc, message)
        else:
            answer = web.Response(status=status, text="This is not HTTP as it is spoken here.\n")
            answer.force_close()
        answer.headers.update(HEADERS | {"Server": SERVER})
        return answer


@web.middleware
async def _timed(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Stop the time while a request is answered."""
    guard = request.protocol
    if not isinstance(guard, GuardedHandler):
        return await handler(request)
    guard.go()
    try:
        return await handler(request)
    finally:
        if guard.transport is not None:
            guard.wait()


async def _end_of_connection(_: web.Request, answer: web.StreamResponse) -> None:
    if isinstance(answer, web.Response):
        answer.force_close()


async def open_site(app: web.Application, host: str, port: int | None, door: Door) -> Site:
    """Let a web application listen.

    Parameters
    ----------
    app : Application
    host : str
    port : int or None
        None: it listens nowhere, and gets connections by :meth:`Site.adopt`, one for each request: the next may be for
        another process.
    door : Door

    Raises
    ------
    ResourceError
        If the port is taken.
    """
    app.middlewares.append(_timed)
    if port is None:
        app.on_response_prepare.append(_end_of_connection)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    loop, manager = asyncio.get_running_loop(), cast("web.Server", runner.server)

    def make() -> GuardedHandler:
        return GuardedHandler(manager, door, loop)

    if port is None:
        return Site(runner, None, (host, 0), make)
    try:
        listening = await loop.create_server(make, host, port, reuse_address=True)
    except OSError as error:
        await runner.cleanup()
        raise ResourceError(
            f"TCP port {port} on {host}: {error.strerror or error}; choose another port, or see who has it: ss -lnp"
        ) from error
    address = listening.sockets[0].getsockname()
    return Site(runner, listening, (address[0], address[1]), make)
