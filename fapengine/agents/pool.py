"""A pool of avatar workers: agents ask it for a face in their room (``POST /faces``)."""

import logging
from collections.abc import Awaitable, Callable

from aiohttp import web

from fapengine.agents.web import object_of
from fapengine.errors import FapEngineError
from fapengine.server.intake.tasks import Tasks
from fapengine.server.web.access import Access
from fapengine.server.web.site import harden

MAX_FACES = 4
"""Faces at once, unless another number is given."""
TOKEN = "FAPENGINE_TOKEN"
"""Environment variable with the secret that agents present."""

log = logging.getLogger("fapengine.agents")


class Pool:
    """The workers. Stateful.

    Parameters
    ----------
    work : callable
        Shows a face in a room until its agent leaves: gets the address of a server and a token of the room.
    most : int
        Number of faces at once.
    access : Access
    """

    def __init__(self, work: Callable[[str, str], Awaitable[None]], most: int, access: Access) -> None:
        self.most = most
        self._work, self._access = work, access
        self._faces = Tasks()

    async def take(self, request: web.Request) -> web.StreamResponse:
        """Answer 201 if a worker joins the room, 503 if all are busy."""
        self._access.admit(request)
        job = await object_of(request)
        url, token = job.get("url"), job.get("token")
        if not isinstance(url, str) or not isinstance(token, str):
            raise web.HTTPBadRequest(text="Expected a JSON object with url and token.")
        if len(self._faces) >= self.most:
            raise web.HTTPServiceUnavailable(text=f"faces: got one more than {self.most}")
        self._faces.start(self._show(url, token))
        return web.Response(status=201)

    async def close(self, _: web.Application) -> None:
        """End all faces."""
        await self._faces.close()

    def application(self) -> web.Application:
        """Make the web application."""
        app = web.Application()
        harden(app)
        app.add_routes([web.post("/faces", self.take)])
        app.on_shutdown.append(self.close)
        return app

    async def _show(self, url: str, token: str) -> None:
        try:
            await self._work(url, token)
        except FapEngineError as error:
            log.error("a face ended: %s", error)
        except Exception:  # of one room: the others continue
            log.exception("a face ended")
