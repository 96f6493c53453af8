"""Sinks: what sends frames on, to the addresses of :mod:`.sink_address`."""

import asyncio
import errno
import socket
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from secrets import randbits
from uuid import NAMESPACE_DNS, uuid5

from fapengine.errors import ResourceError, UsageError
from fapengine.live.film.film import Studio
from fapengine.live.hub.hub import Hub
from fapengine.live.hub.messages import HubFrames
from fapengine.live.server import frame_encoders
from fapengine.live.server.frame_encoders import FrameEncoder, joined
from fapengine.live.server.listeners import bound
from fapengine.live.server.sink_address import FILMS, SOCKETS, Sink, SinkAddress, SinkCounts
from fapengine.live.wire import vmc

UNREAD_BYTES = 64 << 10
"""Bytes of a face stream that a receiver may leave unread, some seconds; beyond them it begins again at an I plane."""
STREAMS = 256
UDP_SEGMENT = 103
"""Socket option of Linux: linux/udp.h."""
SEGMENTS, SEGMENTED_BYTES = 64, 60_000
"""Largest number of datagrams, and of their bytes, that the system takes in one call."""
GSO_UNSUPPORTED_ERRNOS = (errno.EINVAL, errno.EIO, errno.EOPNOTSUPP, errno.EMSGSIZE, errno.ENOPROTOOPT)
"""Errors by which a system says that it has no generic segmentation offload; any other: nothing can be sent now."""


def encoder_of(address: SinkAddress, rate_hz: float, epochs: Mapping[str, int] | None = None) -> FrameEncoder:
    """Make what writes the frames of a sink.

    Parameters
    ----------
    address : SinkAddress
    rate_hz : float
        Frames a second.
    epochs : mapping of str to int, optional
        Of the sessions, where they have such (:mod:`.placement`).

    Raises
    ------
    UsageError
        If an option's value cannot be.
    """
    session, options = address.session, address.options
    if address.kind == "osc":
        return frame_encoders.OscFrameEncoder(session, epochs)
    if address.kind == "named":
        return frame_encoders.named_faps(session)
    if address.kind == "vmc":
        performer = address.port == vmc.PERFORMER_PORT
        return frame_encoders.vmc_face(
            session, spelling=options.get("names", "arkit"), performer=performer, rate_hz=rate_hz
        )  # fmt: skip
    if address.kind == "vrchat":
        return frame_encoders.vrchat_face(session, prefix=options.get("prefix", ""), rate_hz=rate_hz)
    if address.kind == "livelink":
        device = options.get("device") or str(uuid5(NAMESPACE_DNS, f"fapengine.{socket.gethostname()}")).upper()
        return frame_encoders.livelink_face(device, session, name=options.get("name", ""), rate_hz=rate_hz)
    if address.kind == "rtp":
        first = {"ssrc": randbits(32), "sequence": randbits(16), "time": randbits(32)}
        return frame_encoders.RtpFrameEncoder(session, rate_hz=rate_hz, intra_s=_intra_s(address), **first)
    return frame_encoders.FbaFrameEncoder(session, rate_hz=rate_hz, intra_s=_intra_s(address))


def _intra_s(address: SinkAddress) -> float:
    """Seconds between I planes."""
    spelled = address.options.get("intra", "1")
    try:
        return float(spelled)
    except ValueError as error:
        raise UsageError(f"sink {address.kind}: intra: got {spelled!r:.40}, expected seconds") from error


async def open_sink(
    hub: Hub,
    address: SinkAddress,
    epochs: Mapping[str, int] | None = None,
    studio: Studio | None = None,
    head: str = "default",
) -> Sink:
    """Begin to send; see :func:`encoder_of` for the epochs. Pictures of a head are drawn by a studio.

    Raises
    ------
    UsageError
        If an option's value cannot be.
    ResourceError
        If the host is unknown, or the port taken.
    """
    if address.kind in FILMS:
        if studio is None:
            raise UsageError(f"sink {address}: nothing draws its pictures here")
        from fapengine.live.server.film_sinks import open_film_sink  # PyAV is imported then

        return await open_film_sink(studio, address, head)
    if address.kind in SOCKETS:
        from fapengine.live.server.socket_sinks import VtsSink, WeightStreams  # aiohttp is imported then

        return VtsSink(hub, address) if address.kind == "vts" else await WeightStreams.open(hub, address)
    if address.kind == "fba+tcp":
        return await FaceStreams.open(hub, address)
    return DatagramSink(hub, address, epochs)


class Post:
    """A UDP socket that sends many datagrams to one address and never waits.

    Runs of datagrams of one length go to the system in one piece, which it cuts (UDP segmentation, Linux 4.18): a
    seventh of the time. Where it does not, or a network card will not, they go one by one.

    Stateful.

    Raises
    ------
    ResourceError
        If the host is unknown.
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
        """Send; gives how many the system took."""
        sent, start = 0, 0
        while start < len(datagrams):
            run = self._run(datagrams, start) if self._cuts else 1
            try:
                sent += self._send_run(datagrams[start : start + run]) if run > 1 else self._send_one(datagrams[start])
            except OSError as error:
                if run > 1 and error.errno in GSO_UNSUPPORTED_ERRNOS:
                    self._cuts = False
                    continue  # the same again, one by one
            start += run
        return sent

    def close(self) -> None:
        """Send no more."""
        self._socket.close()

    def _run(self, datagrams: Sequence[bytes], start: int) -> int:
        """Count the datagrams from here on that go in one piece."""
        size = len(datagrams[start])
        max_run = min(SEGMENTS, SEGMENTED_BYTES // max(size, 1), len(datagrams) - start)
        stop = start + 1
        while stop < start + max_run and len(datagrams[stop]) == size:
            stop += 1
        return stop - start

    def _send_run(self, run: Sequence[bytes]) -> int:
        length = struct.pack("@H", len(run[0]))
        self._socket.sendmsg([b"".join(run)], [(socket.IPPROTO_UDP, UDP_SEGMENT, length)], 0, self._target)
        return len(run)

    def _send_one(self, datagram: bytes) -> int:
        self._socket.sendto(datagram, self._target)
        return 1


class DatagramSink:
    """A sink that sends every frame as datagrams and never waits.

    Stateful.
    """

    def __init__(self, hub: Hub, address: SinkAddress, epochs: Mapping[str, int] | None = None) -> None:
        self.address, self.counts = address, SinkCounts()
        self._encoder = encoder_of(address, hub.pacer.rate_hz, epochs)
        self._post = Post(address.host, address.port)
        self._waits_for = address.session if epochs is not None else None  # until then another worker may show it
        self._stop = hub.listeners.on_frames(self._show)

    async def close(self) -> None:
        """Send no more."""
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


class FaceStreams:
    """A sink that streams one face to every connection; each begins, and begins again when too slow, at an I plane.

    Stateful.
    """

    def __init__(self, hub: Hub, address: SinkAddress, face: frame_encoders.FbaFrameEncoder) -> None:
        self.address, self.counts = address, SinkCounts()
        self._face = face
        self._server: asyncio.Server | None = None
        self.listeners: set[_FaceStream] = set()
        self._stop = hub.listeners.on_frames(self._show)

    @classmethod
    async def open(cls, hub: Hub, address: SinkAddress) -> "FaceStreams":
        """Listen; see :func:`open_sink`."""
        rate_hz = hub.pacer.rate_hz
        face = frame_encoders.FbaFrameEncoder(address.session, rate_hz=rate_hz, intra_s=_intra_s(address))
        listening = bound(address.host, address.port, socket.SOCK_STREAM)
        sink = cls(hub, address, face)
        loop = asyncio.get_running_loop()
        sink._server = await loop.create_server(lambda: _FaceStream(sink.listeners, face.request_intra), sock=listening)
        return sink

    @property
    def port(self) -> int:
        """Where it listens."""
        port: int = 0 if self._server is None else self._server.sockets[0].getsockname()[1]
        return port

    async def close(self) -> None:
        """End all streams."""
        self._stop()
        if self._server is not None:
            self._server.close()
        for listener in tuple(self.listeners):
            listener.end()

    def _show(self, frames: HubFrames) -> None:
        for plane in self._face.encode(frames):
            for listener in tuple(self.listeners):
                taken = listener.show(plane)
                self.counts.sent += taken
                self.counts.dropped += not taken


class _FaceStream(asyncio.Protocol):
    """The connection of one receiver of a face stream.

    Stateful.
    """

    def __init__(self, listeners: "set[_FaceStream]", request_intra: Callable[[], None]) -> None:
        self._listeners, self._request_intra = listeners, request_intra
        self._transport: asyncio.Transport | None = None
        self._begun = self._follows = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if len(self._listeners) >= STREAMS:
            transport.abort()
            return
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._listeners.add(self)
        self._request_intra()

    def connection_lost(self, error: Exception | None) -> None:
        self._listeners.discard(self)

    def show(self, plane: bytes) -> bool:
        """Send a plane, if it can be followed; False where it was not sent."""
        if self._transport is None or self._transport.is_closing():
            return False
        if self._follows and self._transport.get_write_buffer_size() > UNREAD_BYTES:
            self._follows = False
        if not self._follows:
            start = joined(plane)
            if start is None or self._transport.get_write_buffer_size() > UNREAD_BYTES // 2:
                return False
            plane = plane if self._begun else start
            self._begun = self._follows = True
        self._transport.write(plane)
        return True

    def end(self) -> None:
        if self._transport is not None:
            if self._begun:
                self._transport.write(END)
            self._transport.close()


END = b"\x00\x00\x01\xb1"
"""Ends a face stream."""
