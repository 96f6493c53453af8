"""A client's connection to an engine: :class:`Datagrams` over UDP, :class:`Stream` over TCP."""

import select
import socket
from typing import Literal

from fapengine.errors import ResourceError, UsageError
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip

CONNECT_S = 5.0
MAX_AT_ONCE = 64
"""Datagrams that are received before the next packet is sent."""
TcpFraming = Literal["slip", "length"]


class Pipe:
    """A socket and its address. Stateful."""

    is_refused = False
    """Whether the system has reported that no program listens there; for UDP only."""

    def __init__(self, name: str, connected: socket.socket) -> None:
        self.name, self._socket = name, connected

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _wait(self, wait_s: float, wake: socket.socket) -> bool:
        """Wait up to ``wait_s`` for packets or a byte on ``wake``; return whether packets have arrived."""
        ready, _, _ = select.select([self._socket, wake], [], [], wait_s)
        if wake in ready:
            wake.recv(4096)
        return self._socket in ready


class Datagrams(Pipe):
    """A UDP socket for one address. Stateful.

    Parameters
    ----------
    host : str
    port : int

    Raises
    ------
    ResourceError
        If the host is unknown.
    """

    def __init__(self, host: str, port: int) -> None:
        name = f"udp://{host}:{port}"
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            super().__init__(name, socket.socket(family, kind, protocol))
            self._socket.connect(address)
        except OSError as error:
            raise ResourceError(f"engine at {name}: {error}") from error
        self._socket.setblocking(False)

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        try:
            self._socket.send(packet)
        except OSError as error:  # no listener, no buffer space or no network: the same as a lost datagram
            self.is_refused |= isinstance(error, ConnectionRefusedError)

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait up to ``wait_s`` for packets or a byte on ``wake``; return the packets that have arrived."""
        self._wait(wait_s, wake)
        packets: list[bytes] = []
        for _ in range(MAX_AT_ONCE):
            try:
                packets.append(self._socket.recv(65_536))
            except BlockingIOError:
                break
            except OSError as error:  # an earlier packet was not delivered: no listener, no network
                self.is_refused |= isinstance(error, ConnectionRefusedError)
        return packets


class Stream(Pipe):
    """A TCP connection. Stateful.

    Parameters
    ----------
    host : str
    port : int
    framing : ``"slip"`` or ``"length"``
        How packets are separated: SLIP (OSC 1.1), or lengths before them (OSC 1.0).

    Raises
    ------
    ResourceError
        If no program listens there.
    UsageError
        For another framing.
    """

    def __init__(self, host: str, port: int, framing: TcpFraming) -> None:
        name = f"tcp://{host}:{port}"
        if framing not in ("slip", "length"):
            raise UsageError(f"tcp: got {framing!r}, expected 'slip' or 'length'")
        try:
            super().__init__(name, socket.create_connection((host, port), timeout=CONNECT_S))
        except OSError as error:
            raise ResourceError(f"engine at {name}: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._encode = encode_slip if framing == "slip" else encode_length
        self._decoder = SlipDecoder() if framing == "slip" else LengthDecoder()

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        self._socket.sendall(self._encode(packet))

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait like :meth:`Datagrams.receive`; raises ``OSError`` or ``DataError`` if the connection ended."""
        if not self._wait(wait_s, wake):
            return []
        data = self._socket.recv(65_536)
        if not data:
            raise ConnectionError("closed by the engine")
        return self._decoder.feed(data)
