"""Packet listeners: a UDP socket, and TCP streams framed by SLIP or by lengths.

The first byte of a stream tells its framing: a length below 64 KiB begins with 0, OSC with ``/`` or ``#``, and SLIP
with those or its END. A connection that begins otherwise is closed.
"""

import asyncio
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from fapengine.errors import DataError, ResourceError
from fapengine.server.intake.doors import Door, Guarded
from fapengine.server.intake.ingress import Ingress
from fapengine.wire.framing import MAX_PACKET, LengthDecoder, SlipDecoder, encode_length, encode_slip

READ_AT_ONCE = 512
"""Datagrams read between two slices."""
RECEIVE_BUFFER = 4 << 20
"""Requested size of the receive buffer, bytes; the system may grant less."""
REST_S = 0.003
"""Interval at which a busy socket is read; it is also read before each frame."""
UNREAD_BYTES = 256 << 10
"""Replies that a stream's peer may leave unread; further ones are dropped."""
STREAM_WAITING = 32
"""Packets of a stream in the queue; further ones wait unread in the network."""
CROWDED_S = 0.05
"""Time after which a stream that finds no place in the queue tries again."""
FIRST_S, IDLE_S = 10.0, 600.0
"""Time in which a stream must send its first packet, and after each packet the next; then it is closed."""
SLIP_FIRST = b"\xc0/#"


@dataclass(frozen=True, slots=True)
class Caller:
    """A peer that sends datagrams."""

    socket: socket.socket
    """Socket from which it expects answers."""
    address: tuple[str, int]
    """Address as the system reports it; longer for IPv6."""

    @property
    def host(self) -> str:
        """IP address."""
        return self.address[0]

    def send(self, data: bytes) -> bool:
        """Send a datagram; False if the system cannot take it."""
        try:
            self.socket.sendto(data, self.address)
        except OSError:
            return False
        return True

    def __str__(self) -> str:
        return f"udp://{self.address[0]}:{self.address[1]}"


class UdpListener:
    """A bound UDP socket that is emptied at once. Stateful."""

    def __init__(self, ingress: Ingress, datagrams: socket.socket) -> None:
        self._ingress, self._socket = ingress, datagrams
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()[:2]
        self._loop = asyncio.get_running_loop()
        self._rest: asyncio.TimerHandle | None = None
        self._listen()
        ingress.readers.append(self.read)

    def read(self) -> int:
        """Queue the datagrams that have arrived, at most :data:`READ_AT_ONCE`; return their number."""
        count = 0
        for _ in range(READ_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(MAX_PACKET)
            except BlockingIOError:
                break
            except OSError:  # the error of an earlier datagram that was sent; Linux reports it here
                continue
            count += 1
            self._ingress.put(Caller(self._socket, address), data)
        self._ingress.counts.datagrams += count
        return count

    def close(self) -> None:
        """Stop listening."""
        if self._rest is not None:
            self._rest.cancel()
        self._loop.remove_reader(self._socket.fileno())
        self._socket.close()

    def _listen(self) -> None:
        self._rest = None
        self._loop.add_reader(self._socket.fileno(), self._wake)

    def _wake(self) -> None:
        """Read; if the server is busy, wait a while so that many datagrams are read together."""
        if self.read() < READ_AT_ONCE and self._ingress.is_busy:
            self._loop.remove_reader(self._socket.fileno())
            self._rest = self._loop.call_later(REST_S, self._listen)


class Stream(Guarded, asyncio.Protocol):
    """A TCP connection: packets in, packets out with the same framing. Stateful."""

    def __init__(self, ingress: Ingress, streams: set["Stream"], door: Door) -> None:
        self._ingress, self._streams, self.door = ingress, streams, door
        self._decoder: SlipDecoder | LengthDecoder | None = None
        self._frame: Callable[[bytes], bytes] = encode_slip
        self._held: deque[bytes] = deque()
        self._paused = False
        self._port = 0

    def __str__(self) -> str:
        return f"tcp://{self.host}:{self._port}"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, if there is room."""
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._port = transport.get_extra_info("peername")[1]
        if self._ingress.closed or not self.enter(self.door, transport):
            self._ingress.counts.streams_refused += 1
            cast("asyncio.Transport", transport).abort()
            return
        # never reached: replies that are unread are dropped
        cast("asyncio.Transport", transport).set_write_buffer_limits(2 * UNREAD_BYTES)
        self._streams.add(self)
        self._ingress.counts.streams += 1
        self.expect(FIRST_S)

    def data_received(self, data: bytes) -> None:
        """Cut the stream into packets."""
        if self not in self._streams or not data:
            return
        if self._decoder is None:
            if data[0] == 0:
                self._decoder, self._frame = LengthDecoder(), encode_length
            elif data[0] in SLIP_FIRST:
                self._decoder = SlipDecoder()
            else:
                self._ingress.counts.streams_refused += 1
                self.late()
                return
        try:
            packets = self._decoder.feed(data)
        except DataError:
            self._ingress.counts.streams_broken += 1
            self.late()
            return
        if packets:
            self.expect(IDLE_S)
        self._ingress.counts.stream_packets += len(packets)
        self._held += packets
        self._resume()

    def _resume(self) -> None:
        """Queue held packets as far as there is room; continue reading when all are queued."""
        if not self._held and not self._paused:
            return
        ingress, queue = self._ingress, self._ingress.queue
        while self._held and queue.waiting(self) < STREAM_WAITING and ingress.put(self, self._held[0]):
            self._held.popleft()
        if self._link is None or self._link.is_closing():
            ingress.held_back.pop(self, None)
            return
        if self._held:
            ingress.held_back[self] = self._resume
        else:
            ingress.held_back.pop(self, None)
        if self._held and not queue.waiting(self):
            asyncio.get_running_loop().call_later(CROWDED_S, self._resume)
        if self._held and not self._paused:
            self._paused = True
            self.expect(None)  # the server makes it wait
            self._link.pause_reading()
        elif self._paused and not self._held:
            self._paused = False
            self.expect(IDLE_S)
            self._link.resume_reading()

    def send(self, data: bytes) -> bool:
        """Send a packet; False if the peer does not read, or is gone."""
        if self._link is None or self._link.is_closing():
            return False
        if self._link.get_write_buffer_size() > UNREAD_BYTES:
            return False
        self._link.write(self._frame(data))
        return True

    def eof_received(self) -> bool | None:
        """Count a packet that will never be complete."""
        if self._decoder is not None:
            try:
                self._decoder.close()
            except DataError:
                self._ingress.counts.streams_broken += 1
        return None

    def connection_lost(self, exc: BaseException | None) -> None:
        """Forget the peer."""
        super().connection_lost(exc)
        self._ingress.held_back.pop(self, None)
        if self in self._streams:
            self._streams.discard(self)
            self._ingress.counts.streams -= 1
        self._ingress.receiver.forget(self)

    def close(self) -> None:
        """Close the connection after the pending data is sent."""
        if self._link is not None:
            self._link.close()


class TcpListener:
    """A listener for TCP connections, made by :meth:`open`. Stateful."""

    def __init__(self, server: asyncio.Server, streams: set[Stream], make: Callable[[], Stream]) -> None:
        self._server, self._streams, self._make = server, streams, make
        self.address: tuple[str, int] = server.sockets[0].getsockname()[:2]

    @classmethod
    async def open(cls, ingress: Ingress, listening: socket.socket, door: Door) -> "TcpListener":
        """Listen at a bound socket."""
        streams: set[Stream] = set()

        def make() -> Stream:
            return Stream(ingress, streams, door)

        server = await asyncio.get_running_loop().create_server(make, sock=listening)
        return cls(server, streams, make)

    async def adopt(self, accepted: socket.socket) -> None:
        """Serve a connection that another process accepted."""
        await asyncio.get_running_loop().connect_accepted_socket(self._make, accepted)

    async def close(self) -> None:
        """Close all connections after their pending data is sent."""
        self._server.close()
        for stream in tuple(self._streams):
            stream.close()
        for _ in range(20):
            if not self._streams:
                break
            await asyncio.sleep(0.01)


def bound(host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """Bind a socket. Raises ResourceError if the name is unknown or the port in use."""
    what = "UDP" if kind is socket.SOCK_DGRAM else "TCP"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind, flags=socket.AI_PASSIVE)[0]
        sock = socket.socket(family, kind)
    except OSError as error:
        raise ResourceError(f"{what} {host}:{port}: got {error}, expected an address of this machine") from error
    try:
        if kind is socket.SOCK_STREAM:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a restart does not wait for old connections
        sock.bind(address)
    except OSError as error:
        sock.close()
        raise port_error(what, host, port, error) from error
    return sock


def port_error(what: str, host: str, port: int, error: OSError) -> ResourceError:
    """Make the error of a port that cannot be opened."""
    reason = error.strerror or error
    return ResourceError(f"{what} port {port} on {host}: {reason}; choose another, or find the program on it: ss -lnp")


def bound_pair(host: str, port: int) -> tuple[socket.socket, socket.socket]:
    """Bind TCP and UDP to the same port; with port 0, to one that is free for both. Raises as :func:`bound`."""
    for left in range(9, -1, -1):
        streams = bound(host, port, socket.SOCK_STREAM)
        try:
            return streams, bound(host, streams.getsockname()[1], socket.SOCK_DGRAM)
        except ResourceError:
            streams.close()
            if port or not left:
                raise
    raise AssertionError("the loop returns or raises")
