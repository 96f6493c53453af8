"""The web side of an agent: its page, and the offers of browsers and of Pipecat's JavaScript client.

``POST /api/offer`` gets an offer and returns the answer, ``PATCH /api/offer`` gets late candidates: the requests of
Pipecat's ``SmallWebRTCTransport``.
"""

import json
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from aiohttp import web

from fapengine import _resources
from fapengine.server.web.access import Access
from fapengine.server.web.app import KINDS
from fapengine.server.web.site import harden

if TYPE_CHECKING:
    from fapengine.agents.bot import Bot  # which needs Pipecat

PAGE = {"/": "agent.html", "/agent.js": "agent.js", "/call.css": "call.css", "/icon.svg": "icon.svg"}
"""Paths and files of the page."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def application(visitors: "Bot", access: Access) -> web.Application:
    """Make the web application of a bot, or of what answers the same requests."""
    files = _resources.page_files()

    def page(name: str) -> Handler:
        async def give(_: web.Request) -> web.StreamResponse:
            return web.Response(body=files[name], content_type=KINDS[name[name.rindex(".") :]], charset="utf-8")

        return give

    async def offer(request: web.Request) -> web.StreamResponse:
        access.admit(request)
        given = await object_of(request)
        connection = given.get("pc_id")
        if (
            given.get("type") != "offer"
            or not isinstance(given.get("sdp"), str)
            or not isinstance(connection, str | None)
        ):
            raise web.HTTPBadRequest(text="Expected an object with sdp and type 'offer'.")
        if not visitors.may_talk(connection):
            raise web.HTTPServiceUnavailable(text="Others are talking to the agent: try again later.")
        try:
            answer = await visitors.offer(given["sdp"], connection, restarts=bool(given.get("restart_pc")))
        except ValueError as error:
            raise web.HTTPBadRequest(text="The offer cannot be read.") from error
        return web.json_response(answer)

    async def candidates(request: web.Request) -> web.StreamResponse:
        access.admit(request)
        given = await object_of(request)
        try:
            connection = str(given["pc_id"])
            late = [(one["candidate"], one.get("sdp_mid"), one.get("sdp_mline_index")) for one in given["candidates"]]
        except (KeyError, TypeError, AttributeError) as error:
            raise web.HTTPBadRequest(text="Expected an object with pc_id and candidates.") from error
        try:
            for line, mid, index in late:
                await visitors.candidate(connection, line, mid, index)
        except KeyError as error:
            raise web.HTTPNotFound(text="There is no such connection.") from error
        except ValueError as error:
            raise web.HTTPBadRequest(text="A candidate cannot be read.") from error
        return web.json_response({"status": "success"})

    async def allow(request: web.Request) -> web.StreamResponse:
        return access.allow(request, "POST, PATCH")

    app = web.Application()
    harden(app, access.origins)
    app.add_routes([web.get(path, page(name)) for path, name in PAGE.items()])
    app.add_routes([web.post("/api/offer", offer), web.patch("/api/offer", candidates)])
    app.router.add_route("OPTIONS", "/api/offer", allow)
    return app


async def object_of(request: web.Request) -> dict[str, Any]:
    """Return the JSON object of a request. Raises HTTPBadRequest if there is none."""
    try:
        given = json.loads(await request.read())
    except (ValueError, RecursionError) as error:
        raise web.HTTPBadRequest(text="Expected JSON.") from error
    if not isinstance(given, dict):
        raise web.HTTPBadRequest(text="Expected a JSON object.")
    return given
