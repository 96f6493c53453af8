"""Calls: who watches a session by WebRTC, and whose sound moves one.

Theory of operation
-------------------
A caller's offer is answered at once, with the address and the UDP port at which its checks are awaited: the address by
which it asked, or the one that the configuration names, and no other. A call that is not connected :data:`CONNECT_S`
later is over, and so is one whose caller no longer answers (consent, RFC 7675) or says goodbye. Nothing but what the
caller proves to receive is ever sent: the addresses in its offer are not even read (:mod:`.offer`).

Offers come by WHEP and WHIP (RFC 9725) at the page's port: ``POST /whep?session=NAME`` lets the caller watch, ``POST
/whip?session=NAME`` lets its sound move the session, DELETE ends the call. Who may is as for the page: its token
(``Authorization: Bearer``, or ``?token=``), its ``Host`` and ``Origin``. Candidates are all in the answer, so there is
no PATCH (405).
"""

import asyncio
import contextlib
import functools
import logging
import secrets
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlencode

from aiohttp import web

from fapengine._counters import Counts, metric
from fapengine._late import missing, needed
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.server.calls.offer import MAX_OFFER, Kind, Offer, read_offer
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.film.soundtrack import RATE_HZ, Samples
from fapengine.server.web.admission import asked_session, refusal

CONNECT_S = 15.0
"""Time from the answer to the first media."""
SDP = "application/sdp"
OPEN = "calls", "Open calls by WebRTC, by what they do."
MAX_REASONS = 64
"""Calls of which it is remembered why they ended."""

log = logging.getLogger("fapengine.web")
Begin = Callable[[str, bytes, str], Awaitable[tuple[str, str]]]


@dataclass(slots=True)
class CallCounts(Counts):
    """Counts of calls since the start. Stateful."""

    METRIC = "call", "What became of calls, and of what was sent over them, by kind."

    watching: int = metric(*OPEN, is_gauge=True, has_kind=True)
    """A session is watched."""
    speaking: int = metric(*OPEN, is_gauge=True, has_kind=True)
    """Sound comes in."""
    begun: int = 0
    refused: int = 0
    """Offers that were not answered: strangers, one too many, no offer at all."""
    lost: int = 0
    """Calls that did not connect, or whose caller no longer answered."""
    unheard: int = 0
    """Pieces of sound that no ear took."""
    dropped: int = 0
    """Pictures and pieces of sound that a caller's encoder had no time for."""


@dataclass(slots=True, eq=False)
class Call:
    """One call. Stateful."""

    name: str
    """A word that is hard to guess; who knows it may end the call."""
    session: str
    peer: Any
    """The library's RTCPeerConnection."""
    leave: list[Callable[[], None]] = field(default_factory=list)
    tasks: list[asyncio.Task[None]] = field(default_factory=list)
    tracks: Any = None
    """Tracks that a watcher is shown."""


class Calls:
    """All calls of a server. Stateful; close it.

    Parameters
    ----------
    hub : Hub
    studio : Studio
    hearing : Hearing, optional
        Hears the sound of callers; by default none is taken.
    form : FilmForm
        What callers see.
    most : int
        Calls at a time.
    host : str, optional
        Address of this machine at which callers reach it; by default the one at which they asked.

    Raises
    ------
    ResourceError
        If the library is not installed.
    """

    def __init__(
        self,
        hub: Hub,
        studio: Studio,
        hearing: Hearing | None,
        *,
        form: FilmForm | None = None,
        most: int = 8,
        host: str | None = None,
    ) -> None:
        need_aiortc()
        self.hub, self._studio, self._hearing = hub, studio, hearing
        self.form, self._most, self._host = form or FilmForm(), most, host
        self.counts = CallCounts()
        self._calls: dict[str, Call] = {}
        self._reasons: OrderedDict[str, str] = OrderedDict()
        self._answering = 0
        self._ending: set[asyncio.Task[None]] = set()

    def __len__(self) -> int:
        return len(self._calls)

    async def watch(self, session: str, offer: bytes, address: str) -> tuple[str, str]:
        """Let a caller watch a session.

        Parameters
        ----------
        session : str
        offer : bytes
            SDP.
        address : str
            Of this machine, by which the caller asked.

        Returns
        -------
        (str, str)
            Name of the call, and the answer, SDP.

        Raises
        ------
        DataError
            If the offer cannot be understood.
        UsageError
            If there is no room for one more call or session.
        ResourceError
            If nothing can be drawn, or no port be opened.
        """
        return await self._begin(session, offer, address, self._show)

    async def speak(self, session: str, offer: bytes, address: str) -> tuple[str, str]:
        """Let a caller's sound move a session; see :meth:`watch`.

        Raises
        ------
        DataError
            If the offer cannot be understood, or has no sound.
        UsageError
            If there is no room for one more call or session.
        ResourceError
            If there is no ear, or no port can be opened.
        """
        if self._hearing is None or not self._hearing.is_possible:
            raise missing("PocketSphinx", "calls")
        return await self._begin(session, offer, address, self._listen)

    async def end(self, name: str) -> str | None:
        """End a call; gives why it had ended before, "" if it had not, None if there was none."""
        call = self._calls.get(name)
        if call is None:
            return self._reasons.get(name)
        await self._end(call, "")
        return ""

    async def close(self) -> None:
        """End all calls."""
        await asyncio.gather(*(self._end(call, "the server stops") for call in tuple(self._calls.values())))
        await asyncio.gather(*self._ending, return_exceptions=True)

    # One call

    async def _begin(
        self, session: str, data: bytes, address: str, join: Callable[[Call, Offer], Awaitable[None]]
    ) -> tuple[str, str]:
        offer = read_offer(data)
        if len(self._calls) + self._answering >= self._most:
            raise UsageError(f"calls: got one more than {self._most}")
        from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

        self._answering += 1
        call = Call(secrets.token_urlsafe(16), session, RTCPeerConnection(RTCConfiguration(iceServers=[])))
        try:
            try:
                await call.peer.setRemoteDescription(RTCSessionDescription(offer.sdp, "offer"))
            except Exception as error:  # the library fails in many ways on what is no offer
                log.debug("an offer was not understood", exc_info=True)
                raise DataError(f"offer: it cannot be understood ({type(error).__name__}: {error})"[:300]) from error
            await join(call, offer)
            _gather_only(call.peer, self._host or address)
            try:
                await call.peer.setLocalDescription(await call.peer.createAnswer())
            except Exception as error:  # as above: no codec in common, a direction that cannot be, ...
                log.debug("an offer cannot be answered", exc_info=True)
                raise DataError(f"offer: it cannot be answered ({type(error).__name__}: {error})"[:300]) from error
            if "a=candidate:" not in call.peer.localDescription.sdp:
                raise ResourceError(f"no UDP port can be opened at {self._host or address}")
        except BaseException:
            self._leave(call)
            await call.peer.close()
            raise
        finally:
            self._answering -= 1
        self._calls[call.name] = call
        self.counts.begun += 1
        call.peer.on("connectionstatechange", functools.partial(self._changed, call))
        call.tasks.append(asyncio.create_task(self._expect(call)))
        return call.name, call.peer.localDescription.sdp

    async def _show(self, call: Call, offer: Offer) -> None:
        from fapengine.server.calls.tracks import FilmTracks

        call.tracks = tracks = FilmTracks(self.form.size, self.hub.clock, lambda reason: self._let_go(call, reason))
        wanted: dict[Kind, Any] = {"audio": tracks.audio, "video": tracks.video}
        for transceiver in call.peer.getTransceivers():
            if transceiver.direction not in ("sendonly", "sendrecv", "recvonly"):
                continue
            transceiver.sender.replaceTrack(wanted[transceiver.kind])
            transceiver.direction = "sendonly"
        call.leave.append(self._studio.watch(call.session, self.form, tracks))
        self.counts.watching += 1
        call.leave.append(functools.partial(self._count, "watching"))

    async def _listen(self, call: Call, offer: Offer) -> None:
        if "audio" not in offer.kinds:
            raise DataError("offer: got no audio, expected sound that moves a face")
        call.leave.append(self.hub.hold(call.session))
        self.counts.speaking += 1
        call.leave.append(functools.partial(self._count, "speaking"))
        for transceiver in call.peer.getTransceivers():
            transceiver.direction = "recvonly" if transceiver.kind == "audio" else "inactive"
            if transceiver.kind == "audio":
                from fapengine.server.calls.tracks import listen

                take = functools.partial(self._take, call)
                call.tasks.append(asyncio.create_task(listen(transceiver.receiver.track, take)))

    def _take(self, call: Call, samples: Samples) -> None:
        assert self._hearing is not None
        if call.session not in self.hub.engine:
            return
        try:
            is_heard = self._hearing.listen(call.session, samples, RATE_HZ, source=call)
        except ResourceError as error:
            self.counts.unheard += 1
            self._let_go(call, str(error))
        else:
            self.counts.unheard += not is_heard

    async def _expect(self, call: Call) -> None:
        await asyncio.sleep(CONNECT_S)
        if call.peer.connectionState != "connected":
            self.counts.lost += 1
            self._let_go(call, f"it was not connected within {CONNECT_S:g} s: no way for UDP between the two")

    async def _changed(self, call: Call) -> None:
        if call.peer.connectionState in ("failed", "closed") and call.name in self._calls:
            self.counts.lost += call.peer.connectionState == "failed"
            self._let_go(call, "the connection was lost")

    def _let_go(self, call: Call, reason: str) -> None:
        """End a call from inside one of its own tasks."""
        ending = asyncio.get_running_loop().create_task(self._end(call, reason))
        self._ending.add(ending)
        ending.add_done_callback(self._ending.discard)

    async def _end(self, call: Call, reason: str) -> None:
        if self._calls.pop(call.name, None) is None:
            return
        log.info("a call ends%s", f": {reason}" if reason else "", extra={"session": call.session})
        self._reasons[call.name] = reason or "it was ended"
        while len(self._reasons) > MAX_REASONS:
            self._reasons.popitem(last=False)
        self._leave(call)
        with contextlib.suppress(ConnectionError):
            await call.peer.close()

    def _leave(self, call: Call) -> None:
        if call.tracks is not None:
            for track in (call.tracks.audio, call.tracks.video):
                self.counts.dropped += track.dropped
                track.stop()
        for task in call.tasks:
            if task is not asyncio.current_task():
                task.cancel()
        for leave in call.leave:
            leave()
        call.leave.clear()

    def _count(self, kind: str) -> None:
        setattr(self.counts, kind, getattr(self.counts, kind) - 1)


def need_aiortc() -> None:
    """See that the library is there.

    Raises
    ------
    ResourceError
        If it is not installed.
    """
    needed("aiortc", "aiortc", "webrtc")


def _gather_only(peer: Any, address: str) -> None:
    """Let a peer open ports at one address: the library's way would be all that the machine has but loopback."""
    for transceiver in peer.getTransceivers():
        connection = transceiver.sender.transport.transport.iceGatherer._connection
        gather = connection.get_component_candidates
        connection.get_component_candidates = functools.partial(_gathered, gather, address)


async def _gathered(gather: Callable[..., Awaitable[Any]], address: str, component: int, **_: object) -> Any:
    return await gather(component=component, addresses=[address])


# WHEP and WHIP -----------------------------------------------------------------------------------------------------


def add_calls(app: web.Application, calls: Calls, token: str | None, origins: tuple[str, ...] = ()) -> None:
    """Give a web application the two doors; see :func:`fapengine.server.web.app.make_app` for the arguments."""

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
        session = asked_session(request, calls.hub)
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
