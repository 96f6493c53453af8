"""WHEP and WHIP (RFC 9725) on the page's port: an offer is posted, the answer comes back, DELETE ends the call.

``POST /whep?session=NAME`` lets the caller watch, ``POST /whip?session=NAME`` lets its sound move the session. Who may
is as for the page: its token (``Authorization: Bearer``, or ``?token=``), its ``Host`` and ``Origin``. Candidates are
all in the answer, so there is no PATCH (405).
"""

import functools
from collections.abc import Awaitable, Callable
from urllib.parse import urlencode

from aiohttp import web

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.live.calls.calls import Calls
from fapengine.live.calls.offer import MAX_OFFER
from fapengine.live.web.admission import refusal
from fapengine.live.web.app import DEFAULT_SESSION
from fapengine.live.web.messages import session_name

SDP = "application/sdp"
Begin = Callable[[str, bytes, str], Awaitable[tuple[str, str]]]


def add_calls(app: web.Application, calls: Calls, token: str | None, origins: tuple[str, ...] = ()) -> None:
    """Give a web application the two doors; see :func:`fapengine.live.web.app.make_app` for the arguments."""

    def admit(request: web.Request) -> None:
        if trouble := refusal(request, token, origins):
            calls.counts.refused += 1
            raise web.HTTPForbidden(text=trouble)

    for path, begin in (("/whep", calls.watch), ("/whip", calls.speak)):
        app.router.add_post(path, functools.partial(_begin, calls, admit, begin))
        app.router.add_delete(f"{path}/{{name}}", functools.partial(_end, calls, admit))
        for place in (path, f"{path}/{{name}}"):
            app.router.add_route("OPTIONS", place, functools.partial(_allow, origins))


async def _begin(
    calls: Calls, admit: Callable[[web.Request], None], begin: Begin, request: web.Request
) -> web.StreamResponse:
    admit(request)
    try:
        if request.content_type != SDP:
            raise web.HTTPUnsupportedMediaType(text=f"offer: got {request.content_type!r:.60}, expected {SDP}")
        session = session_name(request.query.get("session", DEFAULT_SESSION))
        offer = await request.content.read(MAX_OFFER + 1)
        while len(offer) <= MAX_OFFER and (more := await request.content.read(MAX_OFFER + 1 - len(offer))):
            offer += more
        address = request.transport.get_extra_info("sockname")[0] if request.transport is not None else ""
        name, answer = await begin(session, offer, address)
    except (DataError, UsageError, ResourceError, web.HTTPException) as error:
        calls.counts.refused += 1
        if isinstance(error, DataError):
            raise web.HTTPBadRequest(text=str(error)) from error
        if isinstance(error, UsageError | ResourceError):
            raise web.HTTPServiceUnavailable(text=str(error), headers={"Retry-After": "5"}) from error
        raise
    query = urlencode({"session": session})
    headers = {"Location": f"{request.path}/{name}?{query}", "Access-Control-Expose-Headers": "Location"}
    return web.Response(status=201, text=answer, content_type=SDP, headers=headers)


async def _end(calls: Calls, admit: Callable[[web.Request], None], request: web.Request) -> web.StreamResponse:
    admit(request)
    reason = await calls.end(request.match_info["name"])
    if reason is None:
        raise web.HTTPNotFound(text="There is no such call.")
    if reason:
        raise web.HTTPGone(text=f"This call is over: {reason}")
    return web.Response()


async def _allow(origins: tuple[str, ...], request: web.Request) -> web.StreamResponse:
    """Answer a browser that asks whether a page of another site may call here; it says nothing of the server."""
    headers = {}
    if request.headers.get("Origin") in origins:
        headers = {
            "Access-Control-Allow-Methods": "POST, DELETE",
            "Access-Control-Allow-Headers": "Authorization, Content-Type",
        }
    return web.Response(status=204, headers=headers)
