"""Who may ask a web port, and what every answer carries.

Only pages of this very server may talk to it, and those of the origins that its owner names: any other page is refused,
and so is a name that is no address while no token is asked for, for anybody can make a name point here (DNS rebinding).
"""

import hmac
import ipaddress
from collections.abc import Collection
from urllib.parse import urlsplit

from aiohttp import web

from fapengine.errors import DataError
from fapengine.host.hub import Hub
from fapengine.server.ownership.rule import session_of_request

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
SERVER = "fapengine"
"""Name that answers carry; no version, which would tell what to try."""


def refusal(request: web.Request, token: str | None, origins: Collection[str] = ()) -> str:
    """Say why a request is refused; empty if it is not.

    Parameters
    ----------
    origins : collection of str
        Whose pages may ask beside the server's own: ``"https://example.org"``.
    token : str, optional
        What must be brought along; None: nothing, then only names that are addresses are answered.
    """
    origin, host = request.headers.get("Origin"), request.host
    if origin is not None and origin.partition("://")[2] != host and origin not in origins:
        return f"A page of {origin} may not talk to this server."
    if token is not None:
        brought = request.query.get("token") or request.headers.get("Authorization", "").removeprefix("Bearer ")
        if not hmac.compare_digest(brought.encode("utf-8", "surrogateescape"), token.encode()):
            return "The token is missing or wrong: open the address that the server printed."
    elif not _is_address(host):
        return f"Asked for as {host!r}: use the address, or start the server with a token."
    return ""


def asked_session(request: web.Request, hub: Hub) -> str:
    """Find the session that a request is for.

    Raises
    ------
    DataError
        If it is not clear which one that is.
    HTTPMisdirectedRequest
        If another process shows it.
    """
    session = session_of_request(request.raw_path)
    if session is None:
        raise DataError(f"path: got {request.raw_path!r:.60}, expected {request.path!r:.60}")
    if session not in hub.engine and not hub.engine.may_open(session):
        raise web.HTTPMisdirectedRequest(text="Another process shows this session: ask again.")
    return session


def harden(app: web.Application, origins: Collection[str] = ()) -> None:
    """Let every answer of an application carry :data:`HEADERS`, errors included; pages of ``origins`` may read it."""

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
