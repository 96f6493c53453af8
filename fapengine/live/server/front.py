"""The known ports of a server with workers: what comes there is sent on to the worker whose session it is for.

A datagram is copied to the worker, which answers from the known port itself. A sender whose hello says that it follows
is told the worker's port instead. A connection is handed over whole, before anything of it is read: the first request,
or the first packet, is only looked at (MSG_PEEK).

A session of another machine (:mod:`.bus`): a sender that follows is told that machine's known port. Of others, each
datagram is sent on from a socket of the sender's own, and answers come back by it. Connections are copied both ways.
"""

import asyncio
import errno
import logging
import socket
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar
from urllib.parse import parse_qsl

from fapengine.errors import DataError, ResourceError
from fapengine.live.server import channel
from fapengine.live.server.doors import Door
from fapengine.live.server.listeners import FIRST_S, READ_AT_ONCE, RECEIVE_BUFFER, SLIP_FIRST, bound
from fapengine.live.server.partitions import Machine
from fapengine.live.server.relay import Relays, copied
from fapengine.live.wire.framing import MAX_PACKET, LengthDecoder, SlipDecoder
from fapengine.live.wire.speech_osc import schema
from fapengine.live.wire.speech_osc.codec import encode
from fapengine.live.wire.speech_osc.routing import NAMELESS_SESSION, hello_of, session_of

PEEKED_BYTES = 32 << 10
PEEK_S = 0.02
"""Time after which a connection whose beginning is not whole is looked at again."""
MAX_CALLERS = 8192
"""Addresses of which is remembered where they spoke to: their pings name no session."""
BACKLOG = 128
NO_FILE_S = 0.2
CALLS = ("/whep/", "/whip/")
WITH_SESSION = ("/ws", "/sound.wav", "/whep", "/whip")
"""Paths of the page whose ``session`` says which worker must answer; calls have one each, and the answer names it."""

log = logging.getLogger("fapengine.server")
Found = TypeVar("Found", str, bytes)
Take = Callable[[socket.socket], Awaitable[tuple[str, int] | None]]
"""Function that looks at a connection, and hands it over; or gives host and port of another machine that it is for."""


class Router(Protocol):
    """The part of :class:`fapengine.live.server.workers.Workers` that the front calls."""

    def send(self, session: str, message: channel.Message, handed: socket.socket | None = None) -> int | None:
        """Send to the worker of a session; gives the worker, None where nobody took it."""
        ...

    def send_to(self, worker: int, message: channel.Message) -> bool:
        """Send to a worker."""
        ...

    def send_any(self, message: channel.Message, handed: socket.socket) -> None:
        """Send to some worker."""
        ...

    def port_of(self, session: str) -> int | None:
        """Give the port of a session's worker, which is told that the session is its own."""
        ...

    def settle(self, session: str, again: Callable[[], None]) -> bool:
        """Find out whose a session is, if that must be asked; then True, and what is given is called afterwards."""
        ...

    def elsewhere(self, session: str) -> Machine | None:
        """Give the machine that a session is known to be at, if it is another one."""
        ...


@dataclass(slots=True)
class FrontCounts:
    """Counts of what came at the known ports.

    Stateful.
    """

    forwarded: int = 0
    """Datagrams that were sent on."""
    lost: int = 0
    """Datagrams that no worker could take."""
    strange: int = 0
    """Datagrams and connections for no session."""
    moved: int = 0
    """Senders that were told to speak to a worker."""
    handed: int = 0
    """Connections that were handed over."""
    relayed: int = 0
    """Datagrams and connections that were sent on to another machine."""


class Front:
    """The known ports.

    Stateful.

    Parameters
    ----------
    router : Router
    counts : FrontCounts
    door : Door
        Limits the connections whose beginning has not come.
    """

    def __init__(self, router: Router, counts: FrontCounts, door: Door) -> None:
        self._router, self.counts, self._door = router, counts, door
        self._callers: OrderedDict[tuple[str, int], int | Machine] = OrderedDict()
        self._relays = Relays(self._answer)
        self._tasks: set[asyncio.Task[None]] = set()
        self._sockets: list[socket.socket] = []
        self.datagrams: socket.socket | None = None
        self.osc_address, self.page_address = ("", 0), ("", 0)

    def bind(self, host: str, port: int, page_port: int | None) -> None:
        """Take the ports; nothing is read before :meth:`open`.

        Raises
        ------
        ResourceError
            If one is taken.
        """
        for left in range(9, -1, -1):
            streams = bound(host, port, socket.SOCK_STREAM)
            try:
                self.datagrams = bound(host, streams.getsockname()[1], socket.SOCK_DGRAM)
            except ResourceError:
                streams.close()
                if port or not left:
                    raise
                continue
            break
        assert self.datagrams is not None
        self.datagrams.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._sockets = [self.datagrams, streams]
        self.osc_address = self.datagrams.getsockname()[:2]
        if page_port is not None:
            page = bound(host, page_port, socket.SOCK_STREAM)
            self._sockets.append(page)
            self.page_address = page.getsockname()[:2]

    def open(self) -> None:
        """Let what comes in."""
        loop = asyncio.get_running_loop()
        datagrams, *listeners = self._sockets
        datagrams.setblocking(False)
        loop.add_reader(datagrams.fileno(), self._read)
        for listening, take in zip(listeners, (self._take_stream, self._take_page), strict=False):
            listening.setblocking(False)
            listening.listen(BACKLOG)
            self._start(self._accept(listening, take))

    def close(self) -> None:
        """Let nothing more in."""
        for task in tuple(self._tasks):
            task.cancel()
        self._relays.close()
        for one in self._sockets:
            asyncio.get_running_loop().remove_reader(one.fileno())
            one.close()
        self._sockets.clear()

    def _start(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # Datagrams ------------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        datagrams = self._sockets[0]
        for _ in range(READ_AT_ONCE):
            try:
                data, address = datagrams.recvfrom(MAX_PACKET)
            except BlockingIOError:
                return
            except OSError:  # what an earlier answer met with
                continue
            self._route(data, address)

    def _route(self, data: bytes, address: tuple[str, int], *, is_settled: bool = False) -> None:
        session, caller = session_of(data), self._callers.get(address)
        if session is None:
            if caller is None:
                self.counts.strange += 1
            elif isinstance(caller, Machine):
                self._relay(caller, address, data)
            else:
                self._count(self._router.send_to(caller, channel.Packet(address, data)))
            return
        if not is_settled and self._router.settle(session, lambda: self._route(data, address, is_settled=True)):
            return
        machine = self._router.elsewhere(session)
        hello = hello_of(data)
        if hello is not None and hello.flags & schema.FOLLOWS:
            self._tell_where(hello, machine, address)
            return
        if machine is not None:
            self._relay(machine, address, data)
            self._remember(address, machine)
            return
        took = self._router.send(session, channel.Packet(address, data))
        self._count(took is not None)
        if took is not None:
            self._remember(address, took)

    def _remember(self, address: tuple[str, int], took: int | Machine) -> None:
        self._callers[address] = took
        self._callers.move_to_end(address)
        if len(self._callers) > MAX_CALLERS:
            self._callers.popitem(last=False)

    def _relay(self, machine: Machine, address: tuple[str, int], data: bytes) -> None:
        is_sent = self._relays.send(machine, address, data)
        self.counts.relayed += is_sent
        self.counts.lost += not is_sent

    def _answer(self, data: bytes, address: tuple[str, int]) -> None:
        """Answer from the known port."""
        try:
            self._sockets[0].sendto(data, address)
        except OSError:
            self.counts.lost += 1

    def _count(self, is_sent: bool) -> None:
        self.counts.forwarded += is_sent
        self.counts.lost += not is_sent

    def _tell_where(self, hello: schema.Hello, machine: Machine | None, address: tuple[str, int]) -> None:
        host, port = (machine.host, machine.port) if machine is not None else ("", self._router.port_of(hello.session))
        if port is None:
            self.counts.lost += 1
            return
        self.counts.moved += 1
        self._answer(encode(schema.Moved(hello.session, host, port, hello.instance)), address)

    # Connections ----------------------------------------------------------------------------------------------------

    async def _accept(self, listening: socket.socket, take: Take) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, address = await loop.sock_accept(listening)
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    log.error("no connection can be taken: %s", error)
                    await asyncio.sleep(NO_FILE_S)
                continue
            if self._door.enter(address[0]):
                self._start(self._take(accepted, address[0], take))
            else:
                accepted.close()

    async def _take(self, accepted: socket.socket, address: str, take: Take) -> None:
        try:
            async with asyncio.timeout(FIRST_S):
                there = await take(accepted)
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

    async def _take_page(self, accepted: socket.socket) -> tuple[str, int] | None:
        target = await _peeked(accepted, _target_of)
        if target is None:
            self.counts.strange += 1
            return None
        path, _, query = target.partition("?")
        session = dict(parse_qsl(query)).get("session", NAMELESS_SESSION)
        message = channel.Connection(is_page=True)
        if (path in WITH_SESSION or path.startswith(CALLS)) and 1 <= len(
            session.encode(errors="replace")
        ) <= schema.SESSION_BYTES:
            if (machine := await self._found(session)) is not None:
                return machine.host, machine.page_port
            self._router.send(session, message, accepted.dup())
        else:
            self._router.send_any(message, accepted.dup())
        self.counts.handed += 1
        return None

    async def _take_stream(self, accepted: socket.socket) -> tuple[str, int] | None:
        packet = await _peeked(accepted, _first_packet)
        session = session_of(packet) if packet else None
        if session is None:
            self.counts.strange += 1
            return None
        if (machine := await self._found(session)) is not None:
            return machine.host, machine.port
        self.counts.handed += 1
        self._router.send(session, channel.Connection(is_page=False), accepted.dup())
        return None

    async def _found(self, session: str) -> Machine | None:
        """Find out whose a session is; None: this machine's, or nobody's."""
        settled = asyncio.Event()
        if self._router.settle(session, settled.set):
            await settled.wait()
        return self._router.elsewhere(session)


async def _peeked(accepted: socket.socket, find: Callable[[bytes], Found | None]) -> Found | None:
    """Look at the beginning of a connection until something is found in it; None if it never will be."""
    loop = asyncio.get_running_loop()
    accepted.setblocking(False)
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
            return found
        await asyncio.sleep(PEEK_S)


def _target_of(begun: bytes) -> str | None:
    """Address of a request, of its first line."""
    line, end, _ = begun.partition(b"\r\n")
    parts = line.split(b" ")
    if not end:
        return None
    return parts[1].decode("latin1") if len(parts) == len(("method", "target", "version")) else "/"


def _first_packet(begun: bytes) -> bytes | None:
    """First packet of a stream; empty if it is none."""
    decoder = LengthDecoder() if begun[0] == 0 else SlipDecoder() if begun[0] in SLIP_FIRST else None
    if decoder is None:
        return b""
    try:
        packets = decoder.feed(begun)
    except DataError:
        return b""
    return packets[0] if packets else None
