"""Web ports: the headers of every response, whose sessions are answered for, and limits on connections.

aiohttp limits neither the time that a request takes to come, nor the number of connections. Here a connection has
:data:`IDLE_S` from its beginning to the end of the first head, and from each response to the end of the next head; as
much between two pieces of a body, and :data:`BODY_S` for all of it. A response may take as long as it is being read.
This holds for every handler of every site. Connections are counted by their address, but those of proxies that are
believed by who asks through them (``X-Forwarded-For``), request by request.
"""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from typing import Any, Protocol, cast

from aiohttp import StreamReader, web
from aiohttp.typedefs import Middleware

from fapengine.errors import DataError
from fapengine.host.hub import Hub
from fapengine.server.intake.doors import Door, Guarded
from fapengine.server.intake.listeners import port_error
from fapengine.server.ownership import session_of_request
from fapengine.server.web.access import caller_of

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
SERVER = "fapengine"
"""Server name in responses; it has no version, which would help an attacker."""
FULL_ANSWER = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Length: 0\r\n"
    + "".join(f"{name}: {value}\r\n" for name, value in {**HEADERS, "Server": SERVER}.items()).encode()
    + b"\r\n"
)
"""Response to a connection beyond the limits."""
IDLE_S = 10.0
"""Time for the head of a request, including the silence before it; and between two pieces of its body."""
BODY_S = 60.0
"""Time for the body of a request."""

log = logging.getLogger("fapengine.web")
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class _CountsMisdirected(Protocol):
    refused: int
    misdirected: int


def asked_session(request: web.Request) -> str:
    """Return the session of a request that :func:`own_sessions` has checked.

    Raises HTTPBadRequest if its path does not tell a session.
    """
    session = session_of_request(request.raw_path)
    if session is None:
        raise web.HTTPBadRequest(text=f"path: got {request.raw_path!r:.60}, expected {request.path!r:.60}")
    return session


def own_sessions(hub: Hub, counts: _CountsMisdirected) -> Middleware:
    """Make a middleware that refuses each request whose session is ambiguous (400), or another process's (421)."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            session = session_of_request(request.raw_path)
        except DataError as error:
            counts.refused += 1
            raise web.HTTPBadRequest(text=str(error)) from error
        guard = request.protocol
        is_own = not isinstance(guard, GuardedHandler) or guard.handed_for in ("", session)
        if not is_own or (session is not None and session not in hub.engine and not hub.engine.may_open(session)):
            counts.misdirected += 1
            raise web.HTTPMisdirectedRequest(text="Another process shows this session: retry.")
        return await handler(request)

    return check


def harden(app: web.Application, origins: Collection[str] = ()) -> None:
    """Add :data:`HEADERS` to every response of an application, errors included; pages of ``origins`` may read it."""

    async def add(request: web.Request, answer: web.StreamResponse) -> None:
        if (origin := request.headers.get("Origin")) in origins and origin is not None:
            answer.headers["Access-Control-Allow-Origin"] = origin
            answer.headers["Cross-Origin-Resource-Policy"] = "cross-origin"
        if origins:
            answer.headers["Vary"] = "Origin"
        for name, value in HEADERS.items():
            answer.headers.setdefault(name, value)
        answer.headers["Server"] = SERVER

    app.on_response_prepare.append(add)


@dataclass(slots=True)
class Site:
    """A running web application. Stateful."""

    runner: web.AppRunner
    listening: asyncio.Server | None
    address: tuple[str, int]
    make: "Callable[[], GuardedHandler]"

    async def adopt(self, accepted: socket.socket, session: str | None) -> None:
        """Serve a connection that another process accepted, for the session that it has read in the request."""

        def make() -> GuardedHandler:
            guard = self.make()
            guard.handed_for = session
            return guard

        await asyncio.get_running_loop().connect_accepted_socket(make, accepted)

    async def close(self) -> None:
        """Close all connections."""
        if self.listening is not None:
            self.listening.close()
        await self.runner.cleanup()


class GuardedHandler(Guarded, web.RequestHandler):
    """One connection of a site. Stateful."""

    def __init__(self, manager: web.Server, door: Door, loop: asyncio.AbstractEventLoop) -> None:
        logs = {"access_log": cast("Any", None), "logger": cast("Any", log)}
        super().__init__(manager, loop=loop, auto_decompress=False, **logs)  # unpacking would take the time of frames
        self.door = door
        self._body: StreamReader | None = None
        self._body_end_s = 0.0
        self.handed_for: str | None = ""
        """Session for which another process handed this connection over; "": it was accepted here."""
        self.is_late = False
        """True if a body did not come in time."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, if there is room."""
        super().connection_made(transport)
        if self.enter(self.door, transport):
            self.expect(IDLE_S)
        else:  # sent only if the system accepts it at once
            cast("asyncio.Transport", transport).write(FULL_ANSWER)
            cast("asyncio.Transport", transport).close()

    def data_received(self, data: bytes) -> None:
        """Read more of a head or a body."""
        super().data_received(data)
        self._expect_body()

    def answers(self, body: StreamReader) -> None:
        """Note that a handler begins to answer a request whose body may still come."""
        self._body, self._body_end_s = body, self._loop.time() + BODY_S
        self.expect(None)
        self._expect_body()

    def _expect_body(self) -> None:
        if self._body is None:
            return
        if self._body.is_eof():
            self._body = None
            self.expect(None)
        else:
            self.expect(min(IDLE_S, max(self._body_end_s - self._loop.time(), 0.0)))

    def late(self) -> None:
        """Have the handler answer that the body did not come in time; else end the connection."""
        if self._body is None:
            super().late()
        else:
            self.is_late = True
            self._body.set_exception(TimeoutError())
            self._body = None

    def handle_error(
        self, request: web.BaseRequest, status: int = 500, exc: BaseException | None = None, message: str | None = None
    ) -> web.StreamResponse:
        """Answer an invalid request in one line, and without a log record, because any client can send it."""
        if status >= 500:
            answer = super().handle_error(request, status, exc, message)
        else:
            answer = web.Response(status=status, text="Invalid HTTP request.\n")
            answer.force_close()
        answer.headers.update(HEADERS | {"Server": SERVER})
        return answer


@web.middleware
async def _timed(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Limit the time of the body while a request is answered, and that of the next head afterwards."""
    guard = request.protocol
    if not isinstance(guard, GuardedHandler):
        return await handler(request)
    guard.answers(request.content)
    try:
        return await handler(request)
    except web.RequestPayloadError as error:
        raise web.HTTPBadRequest(text="Invalid HTTP request.\n") from error
    except OSError as error:
        if guard.transport is not None and not guard.is_late:
            raise
        raise web.HTTPRequestTimeout(text="The body of the request did not come in time.") from error
    finally:
        guard.expect(IDLE_S)


@web.middleware
async def _counted(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Count a request through a proxy as a connection of whoever asks through it."""
    guard = request.protocol
    if not isinstance(guard, GuardedHandler) or guard.host not in guard.door.proxies:
        return await handler(request)
    caller = caller_of(request, guard.door.proxies)
    if not guard.door.begin(caller):
        raise web.HTTPServiceUnavailable(text="Too many requests of one address.", headers={"Retry-After": "5"})
    try:
        return await handler(request)
    finally:
        guard.door.end(caller)


async def _end_of_connection(_: web.Request, answer: web.StreamResponse) -> None:
    if isinstance(answer, web.Response):
        answer.force_close()
        answer.headers["Connection"] = "close"  # aiohttp has written its own headers before it calls this


async def open_site(app: web.Application, host: str, port: int | None, door: Door) -> Site:
    """Open a web application at a port.

    Raises ResourceError if the port is in use.

    Parameters
    ----------
    app : Application
    host : str
    port : int or None
        None: it does not listen, but gets connections by :meth:`Site.adopt`, one per request, because the next request
        may be for another process.
    door : Door
    """
    app.middlewares.extend((_counted, _timed))
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
        raise port_error("TCP", host, port, error) from error
    address = listening.sockets[0].getsockname()
    return Site(runner, listening, (address[0], address[1]), make)
