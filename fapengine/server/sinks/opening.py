"""Sinks of every kind, opened by their addresses, and the one that sends every frame over UDP.

Optional libraries are imported when a sink needs them.
"""

import errno
import socket
import struct
import sys
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from importlib import import_module
from inspect import isawaitable
from operator import attrgetter
from socket import gethostname
from typing import TYPE_CHECKING, Any
from uuid import NAMESPACE_DNS, uuid5

from fapengine.errors import ResourceError, UsageError
from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrames
from fapengine.server.sinks.encoders import Epochs, FrameEncoder, livelink_face
from fapengine.server.sinks.kinds import Sink, SinkAddress, SinkCounts, SinkKind, kind_of

if TYPE_CHECKING:
    from fapengine.server.film.film import Studio

Encoding = Callable[[SinkAddress, float, Epochs], FrameEncoder]
"""Opens a kind that sends datagrams (:mod:`.encoders`): of its address, the frame rate in Hz, and epochs."""
Connecting = Callable[[Hub, SinkAddress], Sink | Awaitable[Sink]]
"""Opens a kind that has connections."""
Showing = Callable[["Studio", SinkAddress, str], Sink | Awaitable[Sink]]
"""Opens a kind that sends video: of what renders, its address, and a head."""


UDP_SEGMENT = 103
"""Socket option of Linux: linux/udp.h."""
SEGMENTS, SEGMENTED_BYTES = 64, 60_000
"""Maximum number of datagrams, and of their bytes, that the system accepts in one call."""
GSO_UNSUPPORTED_ERRNOS = (errno.EINVAL, errno.EIO, errno.EOPNOTSUPP, errno.EMSGSIZE, errno.ENOPROTOOPT)
"""Errors that mean that the system has no generic segmentation offload; others mean that nothing can be sent now."""


class Post:
    """A UDP socket that sends many datagrams to one address without blocking. Stateful.

    Runs of datagrams of equal length are passed to the system in one call (UDP segmentation, Linux 4.18), which takes a
    seventh of the time. If the system or the network card does not support that, they are sent one by one. Raises
    ResourceError if the host is unknown.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            addresses = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise ResourceError(f"UDP {host}:{port}: got {error}, expected a host that can be found") from error
        self._socket = socket.socket(*addresses[0][:2])
        self._target = addresses[0][4]
        self._socket.setblocking(False)
        self._cuts = sys.platform == "linux"

    def send(self, datagrams: Sequence[bytes]) -> int:
        """Send datagrams; return how many the system accepted."""
        sent, start = 0, 0
        while start < len(datagrams):
            run = self._run(datagrams, start) if self._cuts else 1
            try:
                if run > 1:
                    length = struct.pack("@H", len(datagrams[start]))
                    data = b"".join(datagrams[start : start + run])
                    self._socket.sendmsg([data], [(socket.IPPROTO_UDP, UDP_SEGMENT, length)], 0, self._target)
                else:
                    self._socket.sendto(datagrams[start], self._target)
                sent += run
            except OSError as error:
                if run > 1 and error.errno in GSO_UNSUPPORTED_ERRNOS:
                    self._cuts = False
                    continue  # send them again, one by one
            start += run
        return sent

    def close(self) -> None:
        """Stop sending."""
        self._socket.close()

    def _run(self, datagrams: Sequence[bytes], start: int) -> int:
        """Return the number of datagrams from here on that can be sent in one call."""
        size = len(datagrams[start])
        max_run = min(SEGMENTS, SEGMENTED_BYTES // max(size, 1), len(datagrams) - start)
        stop = start + 1
        while stop < start + max_run and len(datagrams[stop]) == size:
            stop += 1
        return stop - start


class DatagramSink:
    """A sink that sends every frame as datagrams without blocking. Stateful.

    With ``waits_for`` it sends nothing before that session's first frame.
    """

    def __init__(self, hub: Hub, address: SinkAddress, encoder: FrameEncoder, *, waits_for: str | None = None) -> None:
        self.address, self.counts = address, SinkCounts()
        self._encoder = encoder
        self._post = Post(address.host, address.port)
        self._waits_for = waits_for
        self._stop = hub.listeners.on_frames(self._show)

    async def close(self) -> None:
        """Stop sending."""
        self._stop()
        self._post.close()

    def _show(self, frames: HubFrames) -> None:
        if self._waits_for is not None and self._waits_for not in frames.sessions:
            return
        self._waits_for = None
        datagrams = self._encoder.encode(frames)
        sent = self._post.send(datagrams)
        self.counts.sent += sent
        self.counts.dropped += len(datagrams) - sent


def livelink(address: SinkAddress, rate_hz: float, epochs: Epochs) -> FrameEncoder:
    """Encode Live Link Face; the device's default follows the name of this machine."""
    device = address.options.get("device") or str(uuid5(NAMESPACE_DNS, f"fapengine.{gethostname()}")).upper()
    return livelink_face(replace(address, options=address.options | {"device": device}), rate_hz)


def opener(kind: SinkKind) -> Any:
    """Import what opens a kind: :data:`Encoding`, :data:`Connecting` or :data:`Showing`."""
    module, _, name = kind.opens.partition(":")
    return attrgetter(name)(import_module(f"fapengine.server.sinks.{module}"))


def encoder_of(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> FrameEncoder:
    """Make the encoder of a sink that sends datagrams.

    Raises UsageError if the kind does not send datagrams, or an option's value is wrong.
    """
    kind = kind_of(address)
    if kind.medium != "datagrams":
        raise UsageError(
            f"sinks: got {str(address)!r}, expected one that sends datagrams; `fapengine serve` has the others"
        )
    encode: Encoding = opener(kind)
    try:
        return encode(address, rate_hz, epochs)
    except UsageError as error:
        reason = str(error).removeprefix(f"sink {kind.name}: ")
        raise UsageError(f"sink {kind.name}: {reason}") from error


def datagram_sink(hub: Hub, address: SinkAddress, epochs: Epochs = None) -> DatagramSink:
    """Open a sink that sends datagrams.

    Raises UsageError if the kind does not send datagrams, or an option's value is wrong; ResourceError if the host is
    unknown.
    """
    # Before a session is shown here, another worker may show it.
    waits_for = address.session if epochs is not None else None
    return DatagramSink(hub, address, encoder_of(address, hub.pacer.rate_hz, epochs), waits_for=waits_for)


async def open_sink(
    hub: Hub, address: SinkAddress, epochs: Epochs = None, studio: "Studio | None" = None, head: str = "default"
) -> Sink:
    """Open a sink of any kind. A studio renders the images of a head.

    Raises UsageError if an option's value is wrong; ResourceError if the host is unknown, the port in use, or a library
    or a device is missing.
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
