"""Sinks of every kind, opened by their addresses. Optional libraries are imported when a sink needs them."""

from collections.abc import Mapping
from secrets import randbits
from socket import gethostname
from typing import TYPE_CHECKING
from uuid import NAMESPACE_DNS, uuid5

from fapengine.errors import UsageError
from fapengine.host.hub import Hub
from fapengine.server.sinks import encoders
from fapengine.server.sinks.datagrams import DatagramSink
from fapengine.server.sinks.face_streams import FaceStreams
from fapengine.server.sinks.kinds import Sink, SinkAddress, kind_of

if TYPE_CHECKING:
    from fapengine.server.film.film import Studio

PERFORMER_PORT = 39540
"""Port of VMC programs that move their model themselves and read shapes only; see :mod:`fapengine.wire.vmc`."""
Epochs = Mapping[str, int] | None
"""Epoch of each session (:mod:`fapengine.server.ownership.rule`), if several processes show sessions."""


def encoder_of(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> encoders.FrameEncoder:
    """Make the encoder of a sink that sends datagrams.

    Parameters
    ----------
    address : SinkAddress
    rate_hz : float
        Frame rate.
    epochs : mapping, optional

    Raises
    ------
    UsageError
        If the kind does not send datagrams, or an option's value is wrong.
    """
    session, options = address.session, address.options
    match address.kind:
        case "osc":
            return encoders.OscFrameEncoder(session, epochs)
        case "named":
            return encoders.named_faps(session)
        case "vmc":
            is_performer = address.port == PERFORMER_PORT
            return encoders.vmc_face(
                session, spelling=options.get("names", "arkit"), performer=is_performer, rate_hz=rate_hz
            )
        case "vrchat":
            return encoders.vrchat_face(session, prefix=options.get("prefix", ""), rate_hz=rate_hz)
        case "livelink":
            device = options.get("device") or str(uuid5(NAMESPACE_DNS, f"fapengine.{gethostname()}")).upper()
            return encoders.livelink_face(device, session, name=options.get("name", ""), rate_hz=rate_hz)
        case "fba":
            return encoders.FbaFrameEncoder(session, rate_hz=rate_hz, intra_s=address.intra_s)
        case "rtp":
            first = {"ssrc": randbits(32), "sequence": randbits(16), "time": randbits(32)}
            return encoders.RtpFrameEncoder(session, rate_hz=rate_hz, intra_s=address.intra_s, **first)
    raise UsageError(
        f"sinks: got {str(address)!r}, expected one that sends datagrams; `fapengine serve` has the others"
    )


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
    hub: Hub,
    address: SinkAddress,
    epochs: Epochs = None,
    studio: "Studio | None" = None,
    head: str = "default",
) -> Sink:
    """Open a sink of any kind. A studio renders the images of a head.

    Raises
    ------
    UsageError
        If an option's value is wrong.
    ResourceError
        If the host is unknown, the port in use, or a library or a device is missing.
    """
    if kind_of(address).medium == "video":
        from fapengine.server.sinks.video import CameraSink, StreamSink

        if studio is None:
            raise UsageError(f"sink {address}: nothing renders its images here")
        if address.kind == "camera":
            return CameraSink(studio, address, head)
        return await StreamSink.open(studio, address, head)
    match address.kind:
        case "fba+tcp":
            return await FaceStreams.open(hub, address)
        case "ws-json":
            from fapengine.server.sinks.websockets import WeightStreams

            return await WeightStreams.open(hub, address)
        case "vts":
            from fapengine.server.sinks.websockets import VtsSink

            return VtsSink(hub, address)
    return datagram_sink(hub, address, epochs)
