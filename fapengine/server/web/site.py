"""Web ports: who may send requests, the headers of every response, and limits on connections.

Only pages of this server, and of the origins that its configuration names, may send requests; other pages are refused.
Without a token, a host name that is not an address is refused too, because anyone can make a name resolve to this
machine (DNS rebinding).

aiohttp limits neither the time that the head of a request takes, nor the number of connections. Here a connection has
:data:`IDLE_S` from its beginning to the end of the first head, and from each response to the end of the next head; a
response may take longer while it is being read.
"""

import asyncio
import hmac
import ipaddress
import logging
import socket
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from typing import Any, Protocol, cast
from urllib.parse import urlsplit

from aiohttp import web

from fapengine.errors import DataError
from fapengine.host.hub import Hub
from fapengine.server.intake.doors import Door
from fapengine.server.intake.listeners import port_error
from fapengine.server.ownership.rule import session_of_request

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
"""Time for the head of a request, including the silence before it."""

log = logging.getLogger("fapengine.web")
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class _CountsRefused(Protocol):
    refused: int


def admit(
    request: web.Request, token: str | None, origins: Collection[str] = (), counts: _CountsRefused | None = None
) -> None:
    """Refuse a request that is not allowed, and count it.

    Parameters
    ----------
    request : Request
    token : str, optional
        Secret that a request must present; None: none, but then the host must be an address.
    origins : collection of str
        Other sites whose pages are allowed: ``"https://example.org"``.
    counts : optional
        Counters with a field ``refused``.

    Raises
    ------
    HTTPForbidden
    """
    origin, host = request.headers.get("Origin"), request.host
    given = request.query.get("token") or request.headers.get("Authorization", "").removeprefix("Bearer ")
    if origin is not None and origin.partition("://")[2] != host and origin not in origins:
        reason = f"Pages of {origin} may not use this server."
    elif token is None and not _is_address(host):
        reason = f"The host name {host!r} is not allowed: use the IP address, or start the server with a token."
    elif token is not None and not hmac.compare_digest(given.encode("utf-8", "surrogateescape"), token.encode()):
        reason = "The token is missing or wrong: open the address that the server printed."
    else:
        return
    if counts is not None:
        counts.refused += 1
    raise web.HTTPForbidden(text=reason)


def asked_session(request: web.Request, hub: Hub) -> str:
    """Return the session of a request.

    Raises
    ------
    DataError
        If the request has no unambiguous session.
    HTTPMisdirectedRequest
        If another process shows it.
    """
    session = session_of_request(request.raw_path)
    if session is None:
        raise DataError(f"path: got {request.raw_path!r:.60}, expected {request.path!r:.60}")
    if session not in hub.engine and not hub.engine.may_open(session):
        raise web.HTTPMisdirectedRequest(text="Another process shows this session: retry.")
    return session


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


def _is_address(host: str) -> bool:
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or name.endswith(".localhost") or bool(ipaddress.ip_address(name))
    except ValueError:
        return False


@dataclass(slots=True)
class Site:
    """A running web application. Stateful."""

    runner: web.AppRunner
    listening: asyncio.Server | None
    address: tuple[str, int]
    make: "Callable[[], GuardedHandler]"

    async def adopt(self, accepted: socket.socket) -> None:
        """Serve a connection that another process accepted."""
        await asyncio.get_running_loop().connect_accepted_socket(self.make, accepted)

    async def close(self) -> None:
        """Close all connections."""
        if self.listening is not None:
            self.listening.close()
        await self.runner.cleanup()


class GuardedHandler(web.RequestHandler):
    """One connection of a site. Stateful."""

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
        else:  # sent only if the system accepts it at once
            cast("asyncio.Transport", transport).write(FULL_ANSWER)
            cast("asyncio.Transport", transport).close()

    def connection_lost(self, exc: BaseException | None) -> None:
        """Release its place."""
        self.go()
        if self._address is not None:
            self._door.leave(self._address)
            self._address = None
        super().connection_lost(exc)

    def wait(self) -> None:
        """Start the time limit of the next request."""
        self.go()
        self._unread = 0
        self._timer = self._timing.call_later(IDLE_S, self._check)

    def go(self) -> None:
        """Stop the time limit: a request is being answered."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _check(self) -> None:
        if self.transport is None:
            return
        unread = self.transport.get_write_buffer_size()
        if unread and (not self._unread or unread < self._unread):  # the response is still being read
            self._unread = unread
            self._timer = self._timing.call_later(IDLE_S, self._check)
            return
        self._door.counts.timed_out += 1
        self.transport.abort()

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
    """Stop the time limit while a request is answered."""
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
    """Open a web application at a port.

    Parameters
    ----------
    app : Application
    host : str
    port : int or None
        None: it does not listen, but gets connections by :meth:`Site.adopt`, one per request, because the next request
        may be for another process.
    door : Door

    Raises
    ------
    ResourceError
        If the port is in use.
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
        raise port_error("TCP", host, port, error) from error
    address = listening.sockets[0].getsockname()
    return Site(runner, listening, (address[0], address[1]), make)
