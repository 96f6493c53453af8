"""Sinks that send every frame over UDP."""

import errno
import socket
import struct
import sys
from collections.abc import Sequence

from fapengine.errors import ResourceError
from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrames
from fapengine.server.sinks.address import SinkAddress, SinkCounts
from fapengine.server.sinks.encoders import FrameEncoder

UDP_SEGMENT = 103
"""Socket option of Linux: linux/udp.h."""
SEGMENTS, SEGMENTED_BYTES = 64, 60_000
"""Largest number of datagrams, and of their bytes, that the system takes in one call."""
GSO_UNSUPPORTED_ERRNOS = (errno.EINVAL, errno.EIO, errno.EOPNOTSUPP, errno.EMSGSIZE, errno.ENOPROTOOPT)
"""Errors by which a system says that it has no generic segmentation offload; any other: nothing can be sent now."""


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
    """A sink that sends every frame as datagrams and never waits; with ``waits_for``, from that session's first on.

    Stateful.
    """

    def __init__(
        self, hub: Hub, address: SinkAddress, encoder: FrameEncoder, *, waits_for: str | None = None
    ) -> None:  # fmt: skip
        self.address, self.counts = address, SinkCounts()
        self._encoder = encoder
        self._post = Post(address.host, address.port)
        self._waits_for = waits_for
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
