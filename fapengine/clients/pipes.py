"""A client's connection to an engine, as packets: :class:`Datagrams` over UDP, :class:`Stream` over TCP."""

import select
import socket
from typing import Literal

from fapengine.errors import ResourceError, UsageError
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip

CONNECT_S = 5.0
MAX_AT_ONCE = 64
"""Datagrams that are read before something is sent again."""
TcpFraming = Literal["slip", "length"]


class Datagrams:
    """A UDP socket that speaks with one address. Stateful.

    Parameters
    ----------
    host : str
    port : int

    Raises
    ------
    ResourceError
        If the host is not known.
    """

    def __init__(self, host: str, port: int) -> None:
        self.name = f"udp://{host}:{port}"
        self.is_refused = False
        """Whether the system has told that nobody listens there."""
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.connect(address)
        except OSError as error:
            raise ResourceError(f"engine at {self.name}: {error}") from error
        self._socket.setblocking(False)

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        try:
            self._socket.send(packet)
        except OSError as error:  # nobody listens, no room, no network: as a datagram that is lost
            self.is_refused |= isinstance(error, ConnectionRefusedError)

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait until packets come, time is up or ``wake`` is written to; gives the packets that are there."""
        _wait([self._socket, wake], wait_s, wake)
        packets: list[bytes] = []
        for _ in range(MAX_AT_ONCE):
            try:
                packets.append(self._socket.recv(65_536))
            except BlockingIOError:
                break
            except OSError as error:  # what was sent before did not go: nobody listens, no network
                self.is_refused |= isinstance(error, ConnectionRefusedError)
        return packets

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Stream:
    """A TCP connection. Stateful.

    Parameters
    ----------
    host : str
    port : int
    framing : ``"slip"`` or ``"length"``
        How packets are told apart: SLIP (OSC 1.1), or lengths before them (OSC 1.0).

    Raises
    ------
    ResourceError
        If nobody listens there.
    UsageError
        For another framing.
    """

    is_refused = False
    """Never: such a connection ends instead, and :meth:`receive` raises."""

    def __init__(self, host: str, port: int, framing: TcpFraming) -> None:
        self.name = f"tcp://{host}:{port}"
        if framing not in ("slip", "length"):
            raise UsageError(f"tcp: got {framing!r}, expected 'slip' or 'length'")
        try:
            self._socket = socket.create_connection((host, port), timeout=CONNECT_S)
        except OSError as error:
            raise ResourceError(f"engine at {self.name}: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._encode = encode_slip if framing == "slip" else encode_length
        self._decoder = SlipDecoder() if framing == "slip" else LengthDecoder()

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        self._socket.sendall(self._encode(packet))

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait as :meth:`Datagrams.receive` does; raises ``OSError`` or ``DataError`` where the connection ended."""
        if self._socket not in _wait([self._socket, wake], wait_s, wake):
            return []
        data = self._socket.recv(65_536)
        if not data:
            raise ConnectionError("closed by the engine")
        return self._decoder.feed(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _wait(sockets: list[socket.socket], wait_s: float, wake: socket.socket) -> list[socket.socket]:
    ready, _, _ = select.select(sockets, [], [], wait_s)
    if wake in ready:
        wake.recv(4096)
    return ready
