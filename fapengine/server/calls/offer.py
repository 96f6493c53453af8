"""Offers of callers: parsed once, and printed again from the parsed parts without any address.

A server that checked the addresses in an offer could be made to send packets to any address. It needs none of them,
because a caller's own checks come from its real address, and prove it (peer-reflexive candidates, RFC 8445, 7.3.1.3).

The call's UDP port: the library lacks limits of whose datagrams count, how many, from how many sources. It opens ports
at all addresses but loopback, sends checks to every address that it learns, and processes datagrams of any sender: a
datagram without a byte would end a call. Here ports are opened at chosen addresses. Whoever has proven its address by a
check is a caller; of all others only checks are read (RFC 7983: a first byte below 4).
"""

import asyncio
import contextlib
import logging
import re
import socket
import struct
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any, Literal, cast

from fapengine.errors import DataError, ResourceError
from fapengine.server.intake.rates import TokenBucket

if TYPE_CHECKING:
    from aiortc import RTCPeerConnection
    from aiortc.sdp import SessionDescription

MAX_OFFER = 64 << 10
"""Bytes of an offer; a browser's are about 6 KiB."""
MAX_LINE, MAX_LINES = 2048, 500
FEEDBACK = ("nack", None), ("nack", "pli"), ("goog-remb", None)
"""The RTCP feedback that the library knows."""
ELSEWHERE = ("192.0.2.1", 9)
"""An address that is nobody's (RFC 5737), to find the way to others; nothing is sent to it."""
CREDENTIAL = re.compile(r"[A-Za-z0-9+/=_-]{4,256}")
"""An ICE user name or password (RFC 8839, 5.4), and three more characters that some clients use."""

log = logging.getLogger("fapengine.web")
Kind = Literal["audio", "video"]


@dataclass(frozen=True, slots=True)
class Offer:
    """A session description without addresses."""

    sdp: str
    kinds: tuple[Kind, ...]
    """Its media, in order: at most one of each."""


def read_offer(data: bytes) -> Offer:
    """Read an offer, which may be any bytes.

    Raises DataError if it is too long, not SDP, or has other media than at most one audio and one video.
    """
    from aiortc.sdp import SessionDescription

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
    for line in lines:
        if not line.isprintable():
            raise DataError(f"offer: got {line!r:.60}, expected printable characters, and lines that end with CR LF")
    try:
        description = SessionDescription.parse(text)
        kinds = _kinds(description)
        _reduce(description)
        return Offer(str(description), kinds)
    except DataError:
        raise
    except Exception as error:  # the library fails in many ways
        raise _misread("understood", error) from error


def _kinds(description: "SessionDescription") -> tuple[Kind, ...]:
    kinds: list[Kind] = []
    for media in description.media:
        if media.kind not in ("audio", "video") or media.kind in kinds:
            raise DataError(f"offer: got {media.kind!r:.40} beside {kinds}, expected one audio and one video at most")
        kinds.append(cast("Kind", media.kind))
        ice: Any = media.ice
        numbers = [codec.payloadType for codec in media.rtp.codecs]
        if len(numbers) != len(set(numbers)):
            raise DataError(f"offer: got one payload type of {media.kind} twice, expected each once")
        for name, value in (("ufrag", ice.usernameFragment), ("pwd", ice.password)):
            if not CREDENTIAL.fullmatch(value or ""):
                raise DataError(f"offer: got ice-{name} {value!r:.60}, expected 4 to 256 letters and digits")
    if not kinds:
        raise DataError("offer: got no media, expected audio or video")
    if len({media.rtp.muxId for media in description.media}) < len(kinds):
        raise DataError("offer: got one mid for both media, expected different ones")
    return tuple(kinds)


def _reduce(description: "SessionDescription") -> None:
    """Keep what a call needs."""
    description.host = None
    names = [media.rtp.muxId for media in description.media]
    for group in description.group:
        group.items = [name for name in group.items if name in names]
    for media in description.media:
        media.host, media.rtcp_host, media.rtcp_port = None, None, 9
        media.ice_candidates, media.ice_candidates_complete = [], False
        media.direction = media.direction or "sendrecv"
        media.rtp.codecs.sort(key=lambda codec: codec.name.upper() != "VP8")  # H.264 takes four times as long to encode
        for codec in media.rtp.codecs:
            given = {(entry.type, entry.parameter): entry for entry in codec.rtcpFeedback}
            codec.rtcpFeedback = [given[known] for known in FEEDBACK if known in given]


def addresses_for(address: str) -> tuple[str, ...]:
    """Return the addresses at which ports are opened for a caller that used an address of this machine.

    On the loopback that is the machine's address in its network, too: Firefox sends no checks from the loopback.
    """
    try:
        if not ip_address(address).is_loopback:
            return (address,)
    except ValueError:  # a name
        return (address,)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
        except OSError:  # there is no network
            return (address,)
        return tuple(dict.fromkeys((address, probe.getsockname()[0])))


async def answer_offer(peer: "RTCPeerConnection", offer: Offer, address: str, prepare: Callable[[], None]) -> str:
    """Answer an offer.

    Raises DataError if the library cannot answer; ResourceError if no port can be opened.

    Parameters
    ----------
    peer : RTCPeerConnection
    offer : Offer
    address : str
        Address of this machine at which a port is opened: see :func:`addresses_for`.
    prepare : callable
        Sets tracks and directions; called when the offer has been read.

    Returns
    -------
    str
        The answer, SDP.
    """
    from aiortc import RTCSessionDescription

    await _asked(peer.setRemoteDescription(RTCSessionDescription(offer.sdp, "offer")), "understood")
    prepare()
    for transceiver in peer.getTransceivers():  # nobody sends images; it has 1000 objects
        cast("Any", transceiver.receiver)._RTCRtpReceiver__remote_bitrate_estimator = None
    for transport in {transceiver.receiver.transport for transceiver in peer.getTransceivers()}:
        guard(transport, addresses_for(address), asyncio.get_running_loop().time)
    answer = await _asked(peer.createAnswer(), "answered")
    await _asked(peer.setLocalDescription(answer), "answered")
    if "a=candidate:" not in peer.localDescription.sdp:
        raise ResourceError(f"no UDP port can be opened at {address}")
    return peer.localDescription.sdp


async def _asked(step: Awaitable[Any], done: str) -> Any:
    """Await a step of the library, which fails in many ways on an invalid offer."""
    try:
        return await step
    except Exception as error:
        raise _misread(done, error) from error


def _misread(done: str, error: Exception) -> DataError:
    log.debug("an offer cannot be %s", done, exc_info=error)
    return DataError(f"offer: it cannot be {done} ({type(error).__name__}: {error})"[:300])


MAX_ADDRESSES = 16
"""Addresses that one call may prove, and that are checked in turn; a caller has one per network."""
PACKETS_HZ, BURST = 500.0, 500
"""Datagrams of a call's callers; audio has 50 per second."""
CHECKS_HZ, CHECKS = 20.0, 50
"""Checks from addresses that are not proven."""
MAX_SOURCES = 16
"""Sources (SSRC) of RTP in one call; a report has room for 31 (RFC 3550, 6.4.2)."""

Address = tuple[str, int]
Receive = Callable[[bytes, Address], None]


def guard(transport: Any, addresses: Sequence[str], now_s: Callable[[], float]) -> None:
    """Limit a call's transport.

    Parameters
    ----------
    transport : RTCDtlsTransport
        Before its ports are opened.
    addresses : sequence of str
        The addresses of this machine at which a port is opened.
    now_s : callable
        Any clock.
    """
    connection, router = transport.transport.iceGatherer._connection, transport._rtp_router
    gather, check, route = connection.get_component_candidates, connection.check_incoming, router.route_rtp
    callers, strangers = TokenBucket(PACKETS_HZ, BURST), TokenBucket(CHECKS_HZ, CHECKS)

    def proven() -> list[Address]:
        return [(candidate.host, candidate.port) for candidate in connection.remote_candidates]

    async def gathered(component: int, **_: object) -> Any:
        found = await gather(component=component, addresses=list(addresses))
        for protocol in connection._protocols:
            protocol.datagram_received = partial(received, protocol.datagram_received)
        return found

    def received(receive: Receive, data: bytes, sender: tuple[Any, ...]) -> None:
        is_caller = sender[:2] in proven()
        if data and (is_caller or data[0] < 4) and (callers if is_caller else strangers).take(now_s()):
            with contextlib.suppress(struct.error):  # an attribute of a check has a wrong length
                receive(data, sender[:2])

    def checked(message: Any, sender: Address, protocol: Any) -> None:
        known = proven()
        if "PRIORITY" in message.attributes and (len(known) < MAX_ADDRESSES or sender in known):
            check(message, sender, protocol)

    def routed(packet: Any) -> Any:
        is_known = packet.ssrc in router.ssrc_table or len(router.ssrc_table) < MAX_SOURCES
        return route(packet) if is_known else None

    connection._remote_candidates.clear()
    connection.get_component_candidates, connection.check_incoming, router.route_rtp = gathered, checked, routed
