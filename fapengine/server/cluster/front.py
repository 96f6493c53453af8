"""The known ports of a server with workers: requests are passed to the worker that has their session.

A datagram is forwarded to the worker, which answers from the known port itself. A sender whose hello says that it
follows redirections is sent the worker's port instead. A connection is handed over before anything is read from it:
the first request, or the first packet, is only peeked at (MSG_PEEK).

For a session of another machine (:mod:`.bus`), a sender that follows is sent that machine's known port. Datagrams of
other senders are relayed, each sender's from a socket of its own, which receives the answers. Connections are copied in
both directions.
"""

import asyncio
import errno
import logging
import socket
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, TypeVar

from fapengine._counters import Counts
from fapengine.errors import DataError
from fapengine.server.cluster import channel
from fapengine.server.intake.doors import Door
from fapengine.server.intake.listeners import FIRST_S, READ_AT_ONCE, RECEIVE_BUFFER, SLIP_FIRST, bound, bound_pair
from fapengine.server.intake.tasks import Tasks
from fapengine.server.ownership import Home, session_of_request
from fapengine.server.partitions import Machine
from fapengine.wire.framing import MAX_PACKET, LengthDecoder, SlipDecoder
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.codec import encode
from fapengine.wire.speech_osc.routing import hello_of, session_of

MAX_RELAYS = 256
"""Senders for which a socket is kept; the one that was silent for the longest is dropped first."""
ANSWERS_AT_ONCE = 64
CHUNK = 64 << 10
CONNECT_S = 3.0
Address = tuple[str, int]
PEEKED_BYTES = 32 << 10
PEEK_S = 0.02
"""Time after which an incomplete beginning of a connection is read again, if more has come; each time twice as long."""
MAX_CALLERS = 8192
"""Senders whose destination is kept, because their pings have no session."""
BACKLOG = 128
NO_FILE_S = 0.2

log = logging.getLogger("fapengine.server")
Found = TypeVar("Found", str, bytes)


class Relays:
    """Sockets to other machines, one for each sender and machine. Stateful.

    Parameters
    ----------
    answer : callable
        Called with a machine's answer and the sender's address.
    """

    def __init__(self, answer: Callable[[bytes, Address], None]) -> None:
        self._answer = answer
        self._sockets: OrderedDict[tuple[Address, str, int], socket.socket] = OrderedDict()

    def send(self, machine: Machine, sender: Address, data: bytes) -> bool:
        """Forward a sender's datagram; False if that is not possible now."""
        key = sender, machine.host, machine.port
        try:
            one = self._sockets.get(key) or self._opened(key)
            self._sockets.move_to_end(key)
            one.send(data)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close all sockets."""
        while self._sockets:
            self._forget(next(iter(self._sockets)))

    def _opened(self, key: tuple[Address, str, int]) -> socket.socket:
        _, host, port = key
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        one = socket.socket(family, kind, protocol)
        try:
            one.setblocking(False)
            one.connect(address)
        except OSError:
            one.close()
            raise
        self._sockets[key] = one
        asyncio.get_running_loop().add_reader(one.fileno(), self._read, one, key[0])
        if len(self._sockets) > MAX_RELAYS:
            self._forget(next(iter(self._sockets)))
        return one

    def _forget(self, key: tuple[Address, str, int]) -> None:
        one = self._sockets.pop(key)
        asyncio.get_running_loop().remove_reader(one.fileno())
        one.close()

    def _read(self, one: socket.socket, sender: Address) -> None:
        for _ in range(ANSWERS_AT_ONCE):
            try:
                data = one.recv(MAX_PACKET)
            except BlockingIOError:
                return
            except OSError:  # no server listens there
                continue
            self._answer(data, sender)


async def copied(accepted: socket.socket, there: Address) -> None:
    """Copy data between a connection and another machine until either side ends it.

    Raises OSError if the other machine cannot be reached.
    """
    async with asyncio.timeout(CONNECT_S):
        theirs_in, theirs_out = await asyncio.open_connection(*there)
    ours_in, ours_out = await asyncio.open_connection(sock=accepted.dup())
    copies = {asyncio.create_task(_copy(ours_in, theirs_out)), asyncio.create_task(_copy(theirs_in, ours_out))}
    try:
        await asyncio.wait(copies, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for copy in copies:
            copy.cancel()
        await asyncio.gather(*copies, return_exceptions=True)
        for end in (ours_out, theirs_out):
            end.close()


async def _copy(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    while data := await source.read(CHUNK):
        target.write(data)
        await target.drain()


class _Workers(Protocol):
    """The part of :class:`fapengine.server.cluster.workers.Workers` that the front calls."""

    def owner(self, session: str) -> Home | Machine | None: ...
    def settle(self, session: str, again: Callable[[], None]) -> bool: ...
    def port(self, home: Home) -> int: ...
    def send(self, worker: int, message: channel.Message, handed: socket.socket | None = None) -> bool: ...
    def send_any(self, message: channel.Message, handed: socket.socket) -> None: ...


@dataclass(slots=True)
class FrontCounts(Counts):
    """Counts of requests at the known ports. Stateful."""

    METRIC = "front", "What came at the known ports, by kind."

    forwarded: int = 0
    """Datagrams that were forwarded to a worker."""
    lost: int = 0
    """Datagrams that no worker could accept."""
    strange: int = 0
    """Datagrams and connections without a session."""
    moved: int = 0
    """Senders that were redirected to a worker."""
    handed: int = 0
    """Connections that were handed over to a worker."""
    relayed: int = 0
    """Datagrams and connections that were forwarded to another machine."""


class Front:
    """The known ports. Stateful.

    Parameters
    ----------
    workers : Workers
    door : Door
        Limits the connections that are not handed over yet.
    """

    def __init__(self, workers: _Workers, door: Door) -> None:
        self._workers, self._door = workers, door
        self.counts = FrontCounts()
        self._callers: OrderedDict[Address, int | Machine] = OrderedDict()
        self._relays = Relays(self._answer)
        self._tasks = Tasks()
        self._sockets: list[socket.socket] = []
        self.datagrams: socket.socket | None = None
        self.osc_address, self.page_address = ("", 0), ("", 0)

    def bind(self, host: str, port: int, page_port: int | None) -> None:
        """Bind the ports; nothing is read before :meth:`open`. Raises ResourceError if one is in use."""
        streams, self.datagrams = bound_pair(host, port)
        self.datagrams.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._sockets = [self.datagrams, streams]
        self.osc_address = self.datagrams.getsockname()[:2]
        if page_port is not None:
            page = bound(host, page_port, socket.SOCK_STREAM)
            self._sockets.append(page)
            self.page_address = page.getsockname()[:2]

    def open(self) -> None:
        """Begin to read."""
        loop = asyncio.get_running_loop()
        datagrams, *listeners = self._sockets
        datagrams.setblocking(False)
        loop.add_reader(datagrams.fileno(), self._read)
        for listening, is_page in zip(listeners, (False, True), strict=False):
            listening.setblocking(False)
            listening.listen(BACKLOG)
            self._tasks.start(self._accept(listening, is_page=is_page))

    def close(self) -> None:
        """Close the ports."""
        self._tasks.cancel()
        self._relays.close()
        for one in self._sockets:
            asyncio.get_running_loop().remove_reader(one.fileno())
            one.close()
        self._sockets.clear()

    # Datagrams ------------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        datagrams = self._sockets[0]
        for _ in range(READ_AT_ONCE):
            try:
                data, address = datagrams.recvfrom(MAX_PACKET)
            except BlockingIOError:
                return
            except OSError:  # the error of an earlier answer
                continue
            self._route(data, address)

    def _route(self, data: bytes, address: Address, *, is_settled: bool = False) -> None:
        session, caller = session_of(data), self._callers.get(address)
        if session is None:
            if caller is None:
                self.counts.strange += 1
            else:
                self._forward(caller, address, data)
            return
        if not is_settled and self._workers.settle(session, lambda: self._route(data, address, is_settled=True)):
            return
        owner, hello = self._workers.owner(session), hello_of(data)
        if owner is None:
            self.counts.lost += 1
        elif hello is not None and hello.flags & schema.FOLLOWS:
            host, port = (owner.host, owner.port) if isinstance(owner, Machine) else ("", self._workers.port(owner))
            self.counts.moved += 1
            self._answer(encode(schema.Moved(hello.session, host, port, hello.instance)), address)
        else:
            destination = owner if isinstance(owner, Machine) else owner.worker
            if self._forward(destination, address, data):
                self._callers[address] = destination
                self._callers.move_to_end(address)
                if len(self._callers) > MAX_CALLERS:
                    self._callers.popitem(last=False)

    def _forward(self, destination: int | Machine, address: Address, data: bytes) -> bool:
        """Send a datagram to a worker or another machine, and count it."""
        if isinstance(destination, Machine):
            is_sent = self._relays.send(destination, address, data)
            self.counts.relayed += is_sent
        else:
            is_sent = self._workers.send(destination, channel.Packet(address, data))
            self.counts.forwarded += is_sent
        self.counts.lost += not is_sent
        return is_sent

    def _answer(self, data: bytes, address: Address) -> None:
        """Answer from the known port."""
        try:
            self._sockets[0].sendto(data, address)
        except OSError:
            self.counts.lost += 1

    # Connections ----------------------------------------------------------------------------------------------------

    async def _accept(self, listening: socket.socket, *, is_page: bool) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, address = await loop.sock_accept(listening)
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    log.error("no connection can be accepted: %s", error)
                    await asyncio.sleep(NO_FILE_S)
                continue
            if self._door.enter(address[0]):
                self._tasks.start(self._take(accepted, address[0], is_page=is_page))
            else:
                accepted.close()

    async def _take(self, accepted: socket.socket, address: str, *, is_page: bool) -> None:
        try:
            async with asyncio.timeout(FIRST_S):
                there = await self._hand_over(accepted, is_page=is_page)
            if there is not None:
                self.counts.relayed += 1
                await copied(accepted, there)
        except TimeoutError:
            self._door.counts.timed_out += 1
        except OSError:
            pass
        finally:
            self._door.leave(address)
            accepted.close()  # the worker has its own

    async def _hand_over(self, accepted: socket.socket, *, is_page: bool) -> Address | None:
        """Hand a connection over to the worker of its session; return the address if it is another machine's."""
        session = None
        if is_page:
            target = await _peeked(accepted, _target_of)
            is_strange = target is None
            with suppress(DataError):  # any worker can answer with that error
                session = session_of_request(target or "")
        else:
            packet = await _peeked(accepted, _first_packet)
            session = session_of(packet) if packet else None
            is_strange = session is None
        if is_strange:
            self.counts.strange += 1
            return None
        message = channel.Connection(is_page, session)
        if session is None:
            self._workers.send_any(message, accepted.dup())
        else:
            settled = asyncio.Event()
            if self._workers.settle(session, settled.set):
                await settled.wait()
            owner = self._workers.owner(session)
            if isinstance(owner, Machine):
                return owner.host, owner.page_port if is_page else owner.port
            if owner is not None:
                self._workers.send(owner.worker, message, accepted.dup())
        self.counts.handed += 1
        return None


async def _peeked(accepted: socket.socket, find: Callable[[bytes], Found | None]) -> Found | None:
    """Peek at the beginning of a connection until ``find`` returns a value; None if it never will."""
    loop = asyncio.get_running_loop()
    accepted.setblocking(False)
    pause_s = PEEK_S
    while True:
        readable = asyncio.Event()
        loop.add_reader(accepted.fileno(), readable.set)
        try:
            await readable.wait()
        finally:
            loop.remove_reader(accepted.fileno())
        begun = accepted.recv(PEEKED_BYTES, socket.MSG_PEEK)
        found = find(begun) if begun else None
        if found is not None or not begun or len(begun) == PEEKED_BYTES:
            accepted.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, 1)
            return found
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, len(begun) + 1)  # readable only when there is more
        await asyncio.sleep(pause_s)
        pause_s *= 2


def _target_of(begun: bytes) -> str | None:
    """Return the target of a request, which is in its first line; "/" if that is invalid."""
    line, end, _ = begun.partition(b"\r\n")
    parts = line.split(b" ")
    if not end:
        return None
    return parts[1].decode("utf-8", "surrogateescape") if len(parts) == len(("method", "target", "version")) else "/"


def _first_packet(begun: bytes) -> bytes | None:
    """Return the first packet of a stream; empty if it is not a valid stream."""
    decoder = LengthDecoder() if begun[0] == 0 else SlipDecoder() if begun[0] in SLIP_FIRST else None
    if decoder is None:
        return b""
    try:
        packets = decoder.feed(begun)
    except DataError:
        return b""
    return packets[0] if packets else None
