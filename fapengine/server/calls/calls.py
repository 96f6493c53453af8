"""WebRTC calls: callers watch a session, or drive one by their audio.

Theory of operation
-------------------
An offer is answered at once, with the address and the UDP port at which the caller's connectivity checks are expected:
the address that the caller used, or the one in the configuration; on the loopback the machine's own as well, because
Firefox does not check from the loopback. Addresses in an offer are not used (:mod:`fapengine.server.calls.offer`).
Data is sent only to addresses that the caller has proven to receive.

A call that is not connected :data:`CONNECT_S` later ends, and so does one whose caller no longer answers (consent, RFC
7675) or disconnects. One address may have :data:`MAX_WAITING` calls that are not connected; one more ends its oldest.
Where all places are taken, a new call ends the oldest that is not connected. An answer and its handshake take 6 ms of
the loop's time, so offers are answered one at a time, at most one each :data:`ANSWER_EVERY_S`. Images are rendered only
for calls that are connected, and for one address at most one rendering process starts each :data:`START_EVERY_S`.

Offers come by WHEP and WHIP (RFC 9725) at the page's port: with ``POST /whep?session=NAME`` the caller watches, with
``POST /whip?session=NAME`` its audio drives the session, DELETE ends the call. Access is limited as for the page: token
(``Authorization: Bearer``, or ``?token=``), ``Host`` and ``Origin``. All candidates are in the answer, so there is no
PATCH (405).
"""

import asyncio
import contextlib
import functools
import logging
import secrets
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from aiohttp import web

from fapengine._counters import Counts, metric
from fapengine._late import missing, needed
from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
from fapengine.files.provenance import NAME, mark
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.server.calls.offer import MAX_OFFER, Offer, answer_offer, read_offer
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.film.soundtrack import RATE_HZ, Samples
from fapengine.server.intake.rates import TokenBucket
from fapengine.server.web.access import Access
from fapengine.server.web.site import asked_session

CONNECT_S = 15.0
"""Time from the answer to the first media."""
CLOSE_S = 5.0
"""Time in which the library closes a call; it may wait for ever if one of its tasks has failed."""
MAX_WAITING = 2
"""Calls of one address that are not connected."""
START_EVERY_S = 2.0
ANSWER_EVERY_S = 0.05
"""Time between two answers, whoever has called: three frames."""
OFFERS_HZ, OFFERS = 2.0, 10
"""Offers of one address per second, and at once."""
MAX_CALLERS = 1000
"""Number of addresses whose offers are counted."""
SDP = "application/sdp"
MARK_HEADER = "Digital-Source-Type"
"""Header of an answer that says that the caller will see a synthetic face."""
OPEN = "calls", "Open calls by WebRTC, by what they do."
MAX_REASONS = 64
"""Number of ended calls whose reason is kept."""

if TYPE_CHECKING:
    from fapengine.server.calls.tracks import PictureEncoder, SoundTrack

log = logging.getLogger("fapengine.web")
Begin = Callable[[str, bytes, str, str], Awaitable[tuple[str, str]]]


@dataclass(slots=True)
class CallCounts(Counts):
    """Counts of calls since the start. Stateful."""

    METRIC = "call", "What became of calls, and of what was sent over them, by kind."

    watching: int = metric(*OPEN, is_gauge=True, has_kind=True)
    """Calls that watch a session."""
    speaking: int = metric(*OPEN, is_gauge=True, has_kind=True)
    """Calls that send audio."""
    begun: int = 0
    refused: int = 0
    """Offers that were not answered: not allowed, beyond the limit, or invalid."""
    lost: int = 0
    """Calls that did not connect, or whose caller no longer answered."""
    unheard: int = 0
    """Pieces of audio that no recognizer accepted."""
    dropped: int = 0
    """Images and pieces of audio that a caller's encoder had no time for."""


@dataclass(slots=True, eq=False)
class Call:
    """One call. Stateful."""

    name: str
    """A secret; a client that knows it may end the call."""
    session: str
    caller: str
    """Address from which the offer came."""
    peer: Any
    """The library's RTCPeerConnection."""
    begin: Callable[[], Coroutine[None, None, None]] | None = None
    """What begins when it is connected."""
    leave: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    """Undoes what the call has begun."""


class Calls:
    """All calls of a server. Stateful; close it.

    Raises ResourceError if the library is not installed.

    Parameters
    ----------
    hub : Hub
    studio : Studio
    hearing : Hearing, optional
        Recognizes the audio of callers; by default none is accepted.
    form : FilmForm
        Head, size and frame rate of the video.
    most : int
        Maximum number of simultaneous calls.
    host : str, optional
        Address of this machine for calls; by default the one that the caller used.
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
        self.counts, self.marks = CallCounts(), mark()
        self._calls: dict[str, Call] = {}
        self._reasons: OrderedDict[str, str] = OrderedDict()
        self._offers: OrderedDict[str, TokenBucket] = OrderedDict()
        self._started_s: dict[str, float] = {}
        """When the last rendering process started for an address."""
        self._encoders: dict[tuple[str, str], PictureEncoder] = {}
        """One for all viewers of a session with the same codec."""
        self._ending: set[asyncio.Future[Any]] = set()
        self._turn = asyncio.Lock()

    def __len__(self) -> int:
        return len(self._calls)

    async def watch(self, session: str, offer: bytes, address: str, caller: str) -> tuple[str, str]:
        """Answer a caller that watches a session.

        Raises DataError if the offer is not valid; UsageError if there is no room for another call or session;
        ResourceError if no port can be opened.

        Parameters
        ----------
        session : str
        offer : bytes
            SDP.
        address : str
            Address of this machine that the caller used.
        caller : str
            Address of the caller.

        Returns
        -------
        (str, str)
            Name of the call, and the answer, SDP.
        """
        return await self._begin(session, offer, address, caller, self._show)

    async def speak(self, session: str, offer: bytes, address: str, caller: str) -> tuple[str, str]:
        """Answer a caller whose audio drives a session; see :meth:`watch`.

        Raises DataError if the offer is not valid, or has no audio; UsageError if there is no room for another call or
        session; ResourceError if there is no recognizer, or no port can be opened.
        """
        if self._hearing is None or not self._hearing.is_possible:
            raise missing("PocketSphinx", "calls")
        return await self._begin(session, offer, address, caller, self._listen)

    async def end(self, name: str) -> str | None:
        """End a call; return why it had ended before, "" if it had not, or None if the name is unknown."""
        call = self._calls.get(name)
        if call is None:
            return self._reasons.get(name)
        self._end(call, "")
        await self._ended()
        return ""

    async def close(self) -> None:
        """End all calls."""
        for call in tuple(self._calls.values()):
            self._end(call, "the server stops")
        await self._ended()

    async def _ended(self) -> None:
        if self._ending:
            await asyncio.wait(self._ending, timeout=CLOSE_S)

    async def _begin(
        self, session: str, data: bytes, address: str, caller: str, join: Callable[[Call, Offer], None]
    ) -> tuple[str, str]:
        allowance = self._offers.setdefault(caller, TokenBucket(OFFERS_HZ, OFFERS))
        if len(self._offers) > MAX_CALLERS:
            self._offers.popitem(last=False)
        if not allowance.take(asyncio.get_running_loop().time()):
            raise UsageError(f"calls: got more offers from one address than {OFFERS_HZ:g} per second")
        async with self._turn:
            try:
                return await self._answer(session, data, address, caller, join)
            finally:
                await asyncio.sleep(ANSWER_EVERY_S)

    async def _answer(
        self, session: str, data: bytes, address: str, caller: str, join: Callable[[Call, Offer], None]
    ) -> tuple[str, str]:
        from aiortc import RTCConfiguration, RTCPeerConnection

        offer = read_offer(data)
        self._make_room(caller)
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        call = Call(secrets.token_urlsafe(16), session, caller, peer)
        self._calls[call.name] = call
        peer.on("connectionstatechange", functools.partial(self._changed, call))
        try:
            answer = await answer_offer(peer, offer, self._host or address, functools.partial(join, call, offer))
        except BaseException:
            self._end(call, "its offer could not be answered")
            raise
        self.counts.begun += 1
        call.leave.callback(asyncio.create_task(self._expect(call)).cancel)
        return call.name, answer

    def _make_room(self, caller: str) -> None:
        """End the oldest call that is not connected where there is no place for another."""
        waiting = [call for call in self._calls.values() if call.peer.connectionState != "connected"]
        own = [call for call in waiting if call.caller == caller]
        if len(own) < MAX_WAITING and len(self._calls) < self._most:
            return
        if not waiting:
            raise UsageError(f"calls: got one more than {self._most}")
        oldest = own[0] if len(own) >= MAX_WAITING else waiting[0]
        self._lose(oldest, "another call needed its place before it was connected")

    def _show(self, call: Call, offer: Offer) -> None:
        for transceiver in call.peer.getTransceivers():
            if transceiver.direction in ("sendonly", "sendrecv", "recvonly"):
                transceiver.direction = "sendonly"

        def leave() -> None:
            self.counts.watching -= 1

        call.leave.callback(self.hub.hold(call.session))
        self.counts.watching += 1
        call.leave.callback(leave)
        call.begin = functools.partial(self._draw, call)

    async def _draw(self, call: Call) -> None:
        from fapengine.server.calls.tracks import FilmTracks

        now_s, film = asyncio.get_running_loop().time, (call.session, self.form)
        while film not in self._studio:
            wait_s = self._started_s.get(call.caller, -inf) + START_EVERY_S - now_s()
            if wait_s <= 0.0:
                recent = {one: at_s for one, at_s in self._started_s.items() if now_s() - at_s < START_EVERY_S}
                self._started_s = recent | {call.caller: now_s()}
                break
            await asyncio.sleep(wait_s)
        senders = [one for one in call.peer.getTransceivers() if one.direction == "sendonly"]
        encoder = None
        for transceiver in senders:
            if transceiver.kind == "video":
                encoder = self._join(call, transceiver)
        tracks = FilmTracks(encoder, self.hub.clock, functools.partial(self._end, call))
        for transceiver in senders:
            if transceiver.kind == "audio":
                tracks.audio.send_by(transceiver.sender, transceiver._codecs[0])
                call.leave.callback(self._drop, tracks.audio)
        try:
            call.leave.callback(self._studio.watch(*film, tracks))
        except (UsageError, ResourceError) as error:
            self._end(call, str(error))

    def _join(self, call: Call, transceiver: Any) -> "PictureEncoder":
        """Send a call the images of the encoder that all viewers of its session share."""
        from fapengine.server.calls.tracks import PictureEncoder

        codec = transceiver._codecs[0]
        key = (call.session, codec.mimeType)
        encoder = self._encoders.get(key)
        if encoder is None:
            encoder = self._encoders[key] = PictureEncoder(self.form.size, self.hub.clock, codec)
        track = encoder.join()
        track.send_by(transceiver.sender)

        def leave() -> None:
            if encoder.leave(track):
                self.counts.dropped += encoder.dropped
                del self._encoders[key]

        call.leave.callback(leave)
        return encoder

    def _drop(self, audio: "SoundTrack") -> None:
        self.counts.dropped += audio.dropped
        audio.stop()

    def _listen(self, call: Call, offer: Offer) -> None:
        from fapengine.server.calls.tracks import listen

        if "audio" not in offer.kinds:
            raise DataError("offer: got no audio, expected audio that drives a face")

        def leave() -> None:
            self.counts.speaking -= 1

        call.leave.callback(self.hub.hold(call.session))
        self.counts.speaking += 1
        call.leave.callback(leave)
        for transceiver in call.peer.getTransceivers():
            transceiver.direction = "recvonly" if transceiver.kind == "audio" else "inactive"
            if transceiver.kind == "audio":
                receive = functools.partial(self._receive, call)
                call.leave.callback(asyncio.create_task(listen(transceiver.receiver.track, receive)).cancel)

    def _receive(self, call: Call, samples: Samples) -> None:
        assert self._hearing is not None
        if call.session not in self.hub.engine:
            return
        try:
            is_heard = self._hearing.listen(call.session, samples, RATE_HZ, source=call)
        except ResourceError as error:
            self.counts.unheard += 1
            self._end(call, str(error))
        else:
            self.counts.unheard += not is_heard

    async def _expect(self, call: Call) -> None:
        await asyncio.sleep(CONNECT_S)
        if call.peer.connectionState != "connected":
            self._lose(call, f"it was not connected within {CONNECT_S:g} s: UDP does not pass between the two")

    async def _changed(self, call: Call) -> None:
        state = call.peer.connectionState
        if state == "connected" and call.begin is not None:
            call.leave.callback(asyncio.create_task(call.begin()).cancel)
            call.begin = None
        elif state == "failed":
            self._lose(call, "the connection was lost")
        elif state == "closed":
            self._end(call, "the connection was lost")

    def _lose(self, call: Call, reason: str) -> None:
        self.counts.lost += call.name in self._calls
        self._end(call, reason)

    def _end(self, call: Call, reason: str) -> None:
        if self._calls.pop(call.name, None) is None:
            return
        log.info("a call ends%s", f": {reason}" if reason else "", extra={"session": call.session})
        self._reasons[call.name] = reason or "it was ended"
        while len(self._reasons) > MAX_REASONS:
            self._reasons.popitem(last=False)
        call.leave.close()
        ending = asyncio.gather(call.peer.close(), return_exceptions=True)
        self._ending.add(ending)
        ending.add_done_callback(self._ending.discard)


def need_aiortc() -> None:
    """Check that the library is installed. Raises ResourceError if it is not."""
    needed("aiortc", "aiortc", "webrtc")


# WHEP and WHIP -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Endpoints:
    calls: Calls
    access: Access

    async def begin(self, start: Begin, request: web.Request) -> web.StreamResponse:
        """Answer an offer."""
        counts = self.calls.counts
        self.access.admit(request, counts)
        try:
            if request.content_type != SDP:
                raise web.HTTPUnsupportedMediaType(text=f"offer: got {request.content_type!r:.60}, expected {SDP}")
            session = asked_session(request)
            offer = await request.content.read(MAX_OFFER + 1)
            while len(offer) <= MAX_OFFER and (more := await request.content.read(MAX_OFFER + 1 - len(offer))):
                offer += more
            address = request.transport.get_extra_info("sockname")[0] if request.transport is not None else ""
            name, answer = await start(session, offer, address, self.access.caller(request))
        except (web.HTTPException, FapEngineError) as error:
            counts.refused += 1
            if isinstance(error, web.HTTPException):
                raise
            if isinstance(error, DataError):
                raise web.HTTPBadRequest(text=str(error)) from error
            raise web.HTTPServiceUnavailable(text=str(error), headers={"Retry-After": "5"}) from error
        query = urlencode({"session": session})
        headers = {"Location": f"{request.path}/{name}?{query}", "Access-Control-Expose-Headers": "Location"}
        if source := self.calls.marks.get(NAME):
            headers |= {MARK_HEADER: source, "Access-Control-Expose-Headers": f"Location, {MARK_HEADER}"}
        return web.Response(status=201, text=answer, content_type=SDP, headers=headers)

    async def end(self, request: web.Request) -> web.StreamResponse:
        """End a call."""
        self.access.admit(request, self.calls.counts)
        reason = await self.calls.end(request.match_info["name"])
        if reason is None:
            raise web.HTTPNotFound(text="There is no such call.")
        if reason:
            raise web.HTTPGone(text=f"This call is over: {reason}")
        return web.Response()

    async def allow(self, request: web.Request) -> web.StreamResponse:
        """Answer a browser that asks whether a page of another site may call."""
        return self.access.allow(request, "POST, DELETE")


def add_calls(app: web.Application, calls: Calls, access: Access) -> None:
    """Add WHEP and WHIP to a web application."""
    endpoints = _Endpoints(calls, access)
    for path, start in (("/whep", calls.watch), ("/whip", calls.speak)):
        app.router.add_post(path, functools.partial(endpoints.begin, start))
        app.router.add_delete(f"{path}/{{name}}", endpoints.end)
        for place in (path, f"{path}/{{name}}"):
            app.router.add_route("OPTIONS", place, endpoints.allow)
