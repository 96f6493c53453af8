"""Sinks of every kind, opened by their addresses. Optional libraries are imported when a sink needs them."""

from collections.abc import Awaitable, Callable, Mapping
from importlib import import_module
from inspect import isawaitable
from operator import attrgetter
from secrets import randbits
from socket import gethostname
from typing import TYPE_CHECKING, Any
from uuid import NAMESPACE_DNS, uuid5

from fapengine.errors import UsageError
from fapengine.host.hub import Hub
from fapengine.server.sinks import encoders
from fapengine.server.sinks.datagrams import DatagramSink
from fapengine.server.sinks.kinds import Sink, SinkAddress, SinkKind, kind_of

if TYPE_CHECKING:
    from fapengine.server.film.film import Studio

PERFORMER_PORT = 39540
"""Port of VMC programs that move their model themselves and read shapes only; see :mod:`fapengine.wire.vmc`."""
Epochs = Mapping[str, int] | None
"""Epoch of each session (:mod:`fapengine.server.ownership.rule`), if several processes show sessions."""


Encoding = Callable[[SinkAddress, float, Epochs], encoders.FrameEncoder]
"""Opens a kind that sends datagrams: of its address, the frame rate in Hz, and epochs."""
Connecting = Callable[[Hub, SinkAddress], Sink | Awaitable[Sink]]
"""Opens a kind that has connections."""
Showing = Callable[["Studio", SinkAddress, str], Sink | Awaitable[Sink]]
"""Opens a kind that sends video: of what renders, its address, and a head."""


def osc(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode ``/fap/1/frame``."""
    return encoders.OscFrameEncoder(address.session, epochs)


def named(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode ``/fap/<n>``."""
    return encoders.named_faps(address.session)


def vmc(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode VMC."""
    spelling, is_performer = address.options.get("names", "arkit"), address.port == PERFORMER_PORT
    return encoders.vmc_face(address.session, spelling=spelling, performer=is_performer, rate_hz=rate_hz)


def vrchat(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode VRChat's parameters."""
    return encoders.vrchat_face(address.session, prefix=address.options.get("prefix", ""), rate_hz=rate_hz)


def livelink(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode Live Link Face; the device's default follows the name of this machine."""
    device = address.options.get("device") or str(uuid5(NAMESPACE_DNS, f"fapengine.{gethostname()}")).upper()
    return encoders.livelink_face(device, address.session, name=address.options.get("name", ""), rate_hz=rate_hz)


def fba(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode an MPEG-4 face stream."""
    return encoders.FbaFrameEncoder(address.session, rate_hz=rate_hz, intra_s=address.intra_s)


def rtp(address: SinkAddress, rate_hz: float, epochs: Epochs) -> encoders.FrameEncoder:
    """Encode the same stream as RTP, from random numbers on, as RFC 3550 asks."""
    first = {"ssrc": randbits(32), "sequence": randbits(16), "time": randbits(32)}
    return encoders.RtpFrameEncoder(address.session, rate_hz=rate_hz, intra_s=address.intra_s, **first)


def opener(kind: SinkKind) -> Any:
    """Import what opens a kind: :data:`Encoding`, :data:`Connecting` or :data:`Showing`."""
    module, _, name = kind.opens.partition(":")
    return attrgetter(name)(import_module(f"fapengine.server.sinks.{module}"))


def encoder_of(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> encoders.FrameEncoder:
    """Make the encoder of a sink that sends datagrams.

    Raises
    ------
    UsageError
        If the kind does not send datagrams, or an option's value is wrong.
    """
    kind = kind_of(address)
    if kind.medium != "datagrams":
        raise UsageError(
            f"sinks: got {str(address)!r}, expected one that sends datagrams; `fapengine serve` has the others"
        )
    encode: Encoding = opener(kind)
    return encode(address, rate_hz, epochs)


def datagram_sink(hub: Hub, address: SinkAddress, epochs: Epochs = None) -> DatagramSink:
    """Open a sink that sends datagrams.

    Raises
    ------
    UsageError
        If the kind does not send datagrams, or an option's value is wrong.
    ResourceError
        If the host is unknown.
    """
    # Before a session is shown here, another worker may show it.
    waits_for = address.session if epochs is not None else None
    return DatagramSink(hub, address, encoder_of(address, hub.pacer.rate_hz, epochs), waits_for=waits_for)


async def open_sink(
    hub: Hub, address: SinkAddress, epochs: Epochs = None, studio: "Studio | None" = None, head: str = "default"
) -> Sink:
    """Open a sink of any kind. A studio renders the images of a head.

    Raises
    ------
    UsageError
        If an option's value is wrong.
    ResourceError
        If the host is unknown, the port in use, or a library or a device is missing.
    """
    kind = kind_of(address)
    if kind.medium == "datagrams":
        return datagram_sink(hub, address, epochs)
    if kind.medium == "connections":
        connect: Connecting = opener(kind)
        opened = connect(hub, address)
    elif studio is None:
        raise UsageError(f"sink {address}: nothing renders its images here")
    else:
        show: Showing = opener(kind)
        opened = show(studio, address, head)
    return await opened if isawaitable(opened) else opened
