"""Limits of a call's UDP port, which the library does not have: whose datagrams count, how many, from how many sources.

The library opens ports at all addresses but loopback, sends checks to every address that it learns, and processes
datagrams of any sender: a datagram without a byte would end a call. Here ports are opened at chosen addresses. Whoever
has proven its address by a check is a caller; of all others only checks are read (RFC 7983: a first byte below 4).
"""

import contextlib
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from fapengine.server.intake.rates import TokenBucket

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
