"""WebRTC calls: callers watch a session, or drive one by their audio.

Theory of operation
-------------------
An offer is answered at once, with the address and the UDP port at which the caller's connectivity checks are expected:
the address that the caller used, or the one in the configuration, and no other. A call that is not connected
:data:`CONNECT_S` later ends, and so does one whose caller no longer answers (consent, RFC 7675) or disconnects. Data is
sent only to addresses that the caller has proven to receive. The addresses in an offer are removed
(:func:`read_offer`): a server that checked them could be made to send packets to any address. It needs none of them,
because a caller's own checks come from its real address, and prove it (peer-reflexive candidates, RFC 8445, 7.3.1.3).

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
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, Literal
from urllib.parse import urlencode

from aiohttp import web

from fapengine._counters import Counts, metric
from fapengine._late import missing, needed
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.film.soundtrack import RATE_HZ, Samples
from fapengine.server.web.site import admit, asked_session

CONNECT_S = 15.0
"""Time from the answer to the first media."""
SDP = "application/sdp"
MAX_OFFER = 64 << 10
"""Bytes of an offer; a browser's are about 6 KiB."""
MAX_LINE, MAX_LINES = 2048, 1500
OPEN = "calls", "Open calls by WebRTC, by what they do."
MAX_REASONS = 64
"""Number of ended calls whose reason is kept."""

log = logging.getLogger("fapengine.web")
Kind = Literal["audio", "video"]
Begin = Callable[[str, bytes, str], Awaitable[tuple[str, str]]]


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


@dataclass(frozen=True, slots=True)
class Offer:
    """A session description without addresses."""

    sdp: str
    kinds: tuple[Kind, ...]
    """Its media, in order: at most one of each."""


def read_offer(data: bytes) -> Offer:
    r"""Check an offer, which may be any bytes, and remove the addresses.

    Raises
    ------
    DataError
        If it is too long, not SDP, or has more than one audio and one video.

    Examples
    --------
    >>> offer = read_offer(b"v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\na=candidate:1 1 udp 1 10.0.0.1 9 typ host\r\n")
    >>> offer.kinds, offer.sdp
    (('audio',), 'v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\n')
    """
    if len(data) > MAX_OFFER:
        raise DataError(f"offer: got {len(data)} bytes, expected at most {MAX_OFFER}")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise DataError("offer: got bytes that are not UTF-8, expected SDP") from error
    lines = text.replace("\r\n", "\n").split("\n")
    if lines[0] != "v=0":
        raise DataError(f"offer: got {lines[0]!r:.60} at first, expected SDP, 'v=0'")
    if len(lines) > MAX_LINES or max(map(len, lines)) > MAX_LINE:
        raise DataError(f"offer: got more than {MAX_LINES} lines or {MAX_LINE} characters in one")
    media = [line[2:].partition(" ")[0] for line in lines if line.startswith("m=")]
    kinds: list[Kind] = []
    for kind in media:
        if kind not in ("audio", "video") or kind in kinds:
            raise DataError(f"offer: got {kind!r:.40} beside {kinds}, expected one audio and one video at most")
        kinds.append("audio" if kind == "audio" else "video")
    if not kinds:
        raise DataError("offer: got no media, expected audio or video")
    kept = [line for line in lines if not line.startswith(("a=candidate:", "a=end-of-candidates"))]
    return Offer("\r\n".join(kept), tuple(kinds))


@dataclass(slots=True, eq=False)
class Call:
    """One call. Stateful."""

    name: str
    """A secret; a client that knows it may end the call."""
    session: str
    peer: Any
    """The library's RTCPeerConnection."""
    leave: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    """Undoes what the call has begun."""


class Calls:
    """All calls of a server. Stateful; close it.

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
        """Answer a caller that watches a session.

        Parameters
        ----------
        session : str
        offer : bytes
            SDP.
        address : str
            Address of this machine that the caller used.

        Returns
        -------
        (str, str)
            Name of the call, and the answer, SDP.

        Raises
        ------
        DataError
            If the offer is not valid.
        UsageError
            If there is no room for another call or session.
        ResourceError
            If nothing can be rendered, or no port be opened.
        """
        return await self._begin(session, offer, address, self._show)

    async def speak(self, session: str, offer: bytes, address: str) -> tuple[str, str]:
        """Answer a caller whose audio drives a session; see :meth:`watch`.

        Raises
        ------
        DataError
            If the offer is not valid, or has no audio.
        UsageError
            If there is no room for another call or session.
        ResourceError
            If there is no recognizer, or no port can be opened.
        """
        if self._hearing is None or not self._hearing.is_possible:
            raise missing("PocketSphinx", "calls")
        return await self._begin(session, offer, address, self._listen)

    async def end(self, name: str) -> str | None:
        """End a call; return why it had ended before, "" if it had not, or None if the name is unknown."""
        call = self._calls.get(name)
        if call is None:
            return self._reasons.get(name)
        await self._end(call, "")
        return ""

    async def close(self) -> None:
        """End all calls."""
        await asyncio.gather(*(self._end(call, "the server stops") for call in tuple(self._calls.values())))
        await asyncio.gather(*self._ending, return_exceptions=True)

    async def _begin(
        self, session: str, data: bytes, address: str, join: Callable[[Call, Offer], None]
    ) -> tuple[str, str]:
        offer = read_offer(data)
        if len(self._calls) + self._answering >= self._most:
            raise UsageError(f"calls: got one more than {self._most}")
        from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

        self._answering += 1
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        call = Call(secrets.token_urlsafe(16), session, peer)
        try:
            await _asked(peer.setRemoteDescription(RTCSessionDescription(offer.sdp, "offer")), "understood")
            join(call, offer)
            _gather_only(peer, self._host or address)
            answer = await _asked(peer.createAnswer(), "answered")
            await _asked(peer.setLocalDescription(answer), "answered")
            if "a=candidate:" not in peer.localDescription.sdp:
                raise ResourceError(f"no UDP port can be opened at {self._host or address}")
        except BaseException:
            call.leave.close()
            await peer.close()
            raise
        finally:
            self._answering -= 1
        self._calls[call.name] = call
        self.counts.begun += 1
        peer.on("connectionstatechange", functools.partial(self._changed, call))
        call.leave.callback(asyncio.create_task(self._expect(call)).cancel)
        return call.name, peer.localDescription.sdp

    def _show(self, call: Call, offer: Offer) -> None:
        from fapengine.server.calls.tracks import FilmTracks

        tracks = FilmTracks(self.form.size, self.hub.clock, lambda reason: self._let_go(call, reason))
        own: dict[Kind, Any] = {"audio": tracks.audio, "video": tracks.video}
        for transceiver in call.peer.getTransceivers():
            if transceiver.direction not in ("sendonly", "sendrecv", "recvonly"):
                continue
            transceiver.sender.replaceTrack(own[transceiver.kind])
            transceiver.direction = "sendonly"

        def leave() -> None:
            self.counts.watching -= 1
            for track in own.values():
                self.counts.dropped += track.dropped
                track.stop()

        call.leave.callback(self._studio.watch(call.session, self.form, tracks))
        self.counts.watching += 1
        call.leave.callback(leave)

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
            self._let_go(call, str(error))
        else:
            self.counts.unheard += not is_heard

    async def _expect(self, call: Call) -> None:
        await asyncio.sleep(CONNECT_S)
        if call.peer.connectionState != "connected":
            self.counts.lost += 1
            self._let_go(call, f"it was not connected within {CONNECT_S:g} s: UDP does not pass between the two")

    async def _changed(self, call: Call) -> None:
        if call.peer.connectionState in ("failed", "closed") and call.name in self._calls:
            self.counts.lost += call.peer.connectionState == "failed"
            self._let_go(call, "the connection was lost")

    def _let_go(self, call: Call, reason: str) -> None:
        """End a call in a task of its own, because its tasks are cancelled."""
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
        call.leave.close()
        with contextlib.suppress(ConnectionError):
            await call.peer.close()


def need_aiortc() -> None:
    """Check that the library is installed.

    Raises
    ------
    ResourceError
        If it is not.
    """
    needed("aiortc", "aiortc", "webrtc")


async def _asked(step: Awaitable[Any], done: str) -> Any:
    """Await a step of the library, which fails in many ways on an invalid offer."""
    try:
        return await step
    except Exception as error:
        log.debug("an offer cannot be %s", done, exc_info=True)
        raise DataError(f"offer: it cannot be {done} ({type(error).__name__}: {error})"[:300]) from error


def _gather_only(peer: Any, address: str) -> None:
    """Make a peer open ports at one address only; by default the library uses all addresses but loopback."""
    for transceiver in peer.getTransceivers():
        connection = transceiver.sender.transport.transport.iceGatherer._connection
        gather = connection.get_component_candidates
        connection.get_component_candidates = functools.partial(_gathered, gather, address)


async def _gathered(gather: Callable[..., Awaitable[Any]], address: str, component: int, **_: object) -> Any:
    return await gather(component=component, addresses=[address])


# WHEP and WHIP -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Endpoints:
    calls: Calls
    token: str | None
    origins: tuple[str, ...]

    async def begin(self, start: Begin, request: web.Request) -> web.StreamResponse:
        """Answer an offer."""
        counts = self.calls.counts
        admit(request, self.token, self.origins, counts)
        try:
            if request.content_type != SDP:
                raise web.HTTPUnsupportedMediaType(text=f"offer: got {request.content_type!r:.60}, expected {SDP}")
            session = asked_session(request, self.calls.hub)
            offer = await request.content.read(MAX_OFFER + 1)
            while len(offer) <= MAX_OFFER and (more := await request.content.read(MAX_OFFER + 1 - len(offer))):
                offer += more
            address = request.transport.get_extra_info("sockname")[0] if request.transport is not None else ""
            name, answer = await start(session, offer, address)
        except web.HTTPException:
            counts.refused += 1
            raise
        except DataError as error:
            counts.refused += 1
            raise web.HTTPBadRequest(text=str(error)) from error
        except (UsageError, ResourceError) as error:
            counts.refused += 1
            raise web.HTTPServiceUnavailable(text=str(error), headers={"Retry-After": "5"}) from error
        query = urlencode({"session": session})
        headers = {"Location": f"{request.path}/{name}?{query}", "Access-Control-Expose-Headers": "Location"}
        return web.Response(status=201, text=answer, content_type=SDP, headers=headers)

    async def end(self, request: web.Request) -> web.StreamResponse:
        """End a call."""
        admit(request, self.token, self.origins, self.calls.counts)
        reason = await self.calls.end(request.match_info["name"])
        if reason is None:
            raise web.HTTPNotFound(text="There is no such call.")
        if reason:
            raise web.HTTPGone(text=f"This call is over: {reason}")
        return web.Response()

    async def allow(self, request: web.Request) -> web.StreamResponse:
        """Answer a browser that asks whether a page of another site may call; this needs no permission."""
        headers = {}
        if request.headers.get("Origin") in self.origins:
            headers = {
                "Access-Control-Allow-Methods": "POST, DELETE",
                "Access-Control-Allow-Headers": "Authorization, Content-Type",
            }
        return web.Response(status=204, headers=headers)


def add_calls(app: web.Application, calls: Calls, token: str | None, origins: tuple[str, ...] = ()) -> None:
    """Add WHEP and WHIP to a web application; see :func:`fapengine.server.web.app.make_app` for the arguments."""
    endpoints = _Endpoints(calls, token, origins)
    for path, start in (("/whep", calls.watch), ("/whip", calls.speak)):
        app.router.add_post(path, functools.partial(endpoints.begin, start))
        app.router.add_delete(f"{path}/{{name}}", endpoints.end)
        for place in (path, f"{path}/{{name}}"):
            app.router.add_route("OPTIONS", place, endpoints.allow)
