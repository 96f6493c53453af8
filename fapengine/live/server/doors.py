"""Where packets come in: a UDP socket, and TCP streams in SLIP or with lengths.

The first byte of a stream tells its framing: a length below 64 KiB begins with 0, OSC with ``/`` or ``#``, and SLIP
with those or its END. Anything else is hung up on.
"""

import asyncio
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from fapengine.errors import DataError, ResourceError
from fapengine.live.framing import MAX_PACKET, LengthDecoder, SlipDecoder, encode_length, encode_slip
from fapengine.live.server.intake import Intake

READ_AT_ONCE = 512
"""Datagrams between two slices."""
RECEIVE_BUFFER = 4 << 20
"""Bytes, asked of the system; it may give less."""
REST_S = 0.003
"""When much comes, sockets are looked at so often, and before each frame."""
STREAMS = 256
UNREAD_BYTES = 256 << 10
"""Replies that a stream's peer may leave unread; more are dropped."""
STREAM_WAITING = 32
"""Packets of a stream in the queue; more wait unread in the network."""
CROWDED_S = 0.05
"""A stream that finds no place in the queue tries again after so long."""
MOST_CALLERS = 8192
"""Addresses remembered, so that a caller is not made anew for each datagram."""
SLIP_FIRST = b"\xc0/#"


@dataclass(frozen=True, slots=True)
class Caller:
    """A peer that sends datagrams."""

    door: "DatagramDoor"
    address: tuple[str, int]
    """As the system tells it; longer for IPv6."""

    def send(self, data: bytes) -> bool:
        """Send a datagram."""
        return self.door.send(data, self.address)

    def __str__(self) -> str:
        return f"udp://{self.address[0]}:{self.address[1]}"


class DatagramDoor:
    """Stateful: a UDP socket that is emptied at once.

    Raises
    ------
    ResourceError
        If it cannot be bound.
    """

    def __init__(self, intake: Intake, host: str, port: int) -> None:
        self._intake = intake
        self._socket = bound(host, port, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._socket.setblocking(False)
        self._callers: dict[tuple[str, int], Caller] = {}
        self.address: tuple[str, int] = self._socket.getsockname()[:2]
        self._loop = asyncio.get_running_loop()
        self._rest: asyncio.TimerHandle | None = None
        self._listen()
        intake.add_reader(self.read)

    def read(self) -> int:
        """Empty the socket, or take as much as may be taken at once."""
        receive, put = self._socket.recvfrom, self._intake.put
        count = 0
        for _ in range(READ_AT_ONCE):
            try:
                data, address = receive(MAX_PACKET)
            except BlockingIOError:
                break
            except OSError:  # what an earlier datagram of ours met with; Linux tells it here
                continue
            count += 1
            put(self._callers.get(address) or self._caller(address), data)
        self._intake.counts.datagrams += count
        return count

    def send(self, data: bytes, address: tuple[str, int]) -> bool:
        """Send a datagram; False if the system cannot take it."""
        try:
            self._socket.sendto(data, address)
        except OSError:
            return False
        return True

    def _listen(self) -> None:
        self._rest = None
        self._loop.add_reader(self._socket.fileno(), self._wake)

    def _wake(self) -> None:
        """Read; when much comes, be woken for many datagrams together, not for each."""
        if self.read() < READ_AT_ONCE and self._intake.is_busy:
            self._loop.remove_reader(self._socket.fileno())
            self._rest = self._loop.call_later(REST_S, self._listen)

    def _caller(self, address: tuple[str, int]) -> Caller:
        if len(self._callers) >= MOST_CALLERS:
            self._callers.clear()  # an equal one is as good
        made = self._callers[address] = Caller(self, address)
        return made

    def close(self) -> None:
        """Stop listening."""
        if self._rest is not None:
            self._rest.cancel()
        self._loop.remove_reader(self._socket.fileno())
        self._socket.close()


class Stream(asyncio.Protocol):
    """Stateful: one TCP connection; packets in, packets out in the same framing."""

    def __init__(self, intake: Intake, streams: set["Stream"], most: int) -> None:
        self._intake, self._streams, self._most = intake, streams, most
        self._decoder: SlipDecoder | LengthDecoder | None = None
        self._frame: Callable[[bytes], bytes] = encode_slip
        self._held: deque[bytes] = deque()
        self._paused = False
        self._transport: asyncio.Transport | None = None
        self.name = "tcp://?"

    def __str__(self) -> str:
        return self.name

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, if there is room."""
        self._transport = cast("asyncio.Transport", transport)
        own = transport.get_extra_info("socket")
        own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        own.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        host, port = transport.get_extra_info("peername")[:2]
        self.name = f"tcp://{host}:{port}"
        if len(self._streams) >= self._most or self._intake.closed:
            self._intake.counts.streams_refused += 1
            self._transport.abort()
            return
        self._streams.add(self)
        self._intake.counts.streams += 1

    def data_received(self, data: bytes) -> None:
        """Cut the stream into packets."""
        if self not in self._streams or not data:
            return
        if self._decoder is None and not self._begin(data[0]):
            self._intake.counts.streams_refused += 1
            self._drop()
            return
        try:
            packets = cast("LengthDecoder | SlipDecoder", self._decoder).feed(data)
        except DataError:
            self._intake.counts.streams_broken += 1
            self._drop()
            return
        self._intake.counts.stream_packets += len(packets)
        self._held += packets
        self.go_on()

    def go_on(self) -> None:
        """Queue what is held back, as far as there is room; read on when all of it is queued."""
        if not self._held and not self._paused:
            return
        intake, queue = self._intake, self._intake.queue
        while self._held and queue.waiting(self) < STREAM_WAITING and intake.put(self, self._held[0]):
            self._held.popleft()
        if self._transport is None or self._transport.is_closing():
            intake.held_back.pop(self, None)
            return
        if self._held:
            intake.held_back[self] = self.go_on
        else:
            intake.held_back.pop(self, None)
        if self._held and not queue.waiting(self):
            asyncio.get_running_loop().call_later(CROWDED_S, self.go_on)
        if self._held and not self._paused:
            self._paused = True
            self._transport.pause_reading()
        elif self._paused and not self._held:
            self._paused = False
            self._transport.resume_reading()

    def send(self, data: bytes) -> bool:
        """Send a packet; False where the peer does not read or is gone."""
        if self._transport is None or self._transport.is_closing():
            return False
        if self._transport.get_write_buffer_size() > UNREAD_BYTES:
            return False
        self._transport.write(self._frame(data))
        return True

    def eof_received(self) -> bool | None:
        """Notice a packet that will never be whole."""
        if self._decoder is not None:
            try:
                self._decoder.close()
            except DataError:
                self._intake.counts.streams_broken += 1
        return None

    def connection_lost(self, error: Exception | None) -> None:
        """Forget the peer."""
        self._intake.held_back.pop(self, None)
        if self in self._streams:
            self._streams.discard(self)
            self._intake.counts.streams -= 1
        forget = getattr(self._intake.receiver, "forget", None)
        if forget is not None:
            forget(self)

    def close(self) -> None:
        """Send what is still to be sent, and end."""
        if self._transport is not None:
            self._transport.close()

    def _begin(self, first: int) -> bool:
        if first == 0:
            self._decoder, self._frame = LengthDecoder(), encode_length
        elif first in SLIP_FIRST:
            self._decoder, self._frame = SlipDecoder(), encode_slip
        return self._decoder is not None

    def _drop(self) -> None:
        if self._transport is not None:
            self._transport.abort()


class StreamDoor:
    """Stateful: listens for TCP connections. Made by :meth:`open`."""

    def __init__(self, server: asyncio.Server, streams: set[Stream]) -> None:
        self._server, self._streams = server, streams
        self.address: tuple[str, int] = server.sockets[0].getsockname()[:2]

    @classmethod
    async def open(cls, intake: Intake, host: str, port: int, *, most: int = STREAMS) -> "StreamDoor":
        """Listen.

        Raises
        ------
        ResourceError
            If the port cannot be bound.
        """
        streams: set[Stream] = set()
        listening = bound(host, port, socket.SOCK_STREAM)
        server = await asyncio.get_running_loop().create_server(lambda: Stream(intake, streams, most), sock=listening)
        return cls(server, streams)

    async def close(self) -> None:
        """Send what is still to be sent, and end all connections."""
        self._server.close()
        for stream in tuple(self._streams):
            stream.close()
        for _ in range(20):
            if not self._streams:
                break
            await asyncio.sleep(0.01)


def bound(host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """Bind a socket.

    Raises
    ------
    ResourceError
        If the name is unknown or the port taken; it says how to mend that.
    """
    what = "UDP" if kind is socket.SOCK_DGRAM else "TCP"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind, flags=socket.AI_PASSIVE)[0]
        own = socket.socket(family, kind)
    except OSError as error:
        raise ResourceError(f"{what} {host}:{port}: got {error}, expected an address of this machine") from error
    try:
        if kind is socket.SOCK_STREAM:
            own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a restart need not wait for old connections
        own.bind(address)
    except OSError as error:
        own.close()
        raise ResourceError(
            f"{what} port {port} on {host}: {error.strerror}; choose another port, or see who has it: ss -lnp"
        ) from error
    return own
