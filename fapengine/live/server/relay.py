"""What is for another machine: datagrams that are sent on, answers that come back, connections that are copied."""

import asyncio
import socket
from collections import OrderedDict
from collections.abc import Callable

from fapengine.live.server.partitions import Machine
from fapengine.live.wire.framing import MAX_PACKET

MAX_RELAYS = 256
"""Senders for which a socket is kept; the one that was silent for the longest is forgotten first."""
ANSWERS_AT_ONCE = 64
CHUNK = 64 << 10
CONNECT_S = 3.0
Address = tuple[str, int]


class Relays:
    """Sockets to other machines, one for each sender and machine.

    Stateful.

    Parameters
    ----------
    answer : callable
        Takes what a machine answered, and the sender's address.
    """

    def __init__(self, answer: Callable[[bytes, Address], None]) -> None:
        self._answer = answer
        self._sockets: OrderedDict[tuple[Address, str, int], socket.socket] = OrderedDict()

    def send(self, machine: Machine, sender: Address, data: bytes) -> bool:
        """Send a sender's datagram on; False where that is not possible now."""
        key = sender, machine.host, machine.port
        try:
            one = self._sockets.get(key) or self._opened(key)
            self._sockets.move_to_end(key)
            one.send(data)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close all."""
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
            except OSError:  # nobody listens there now
                continue
            self._answer(data, sender)


async def copied(accepted: socket.socket, there: Address) -> None:
    """Copy a connection to another machine, and its answers back, until one of both ends it.

    Raises
    ------
    OSError
        If the other machine cannot be reached.
    """
    async with asyncio.timeout(CONNECT_S):
        theirs_in, theirs_out = await asyncio.open_connection(*there)
    ours_in, ours_out = await asyncio.open_connection(sock=accepted.dup())
    ways = {asyncio.create_task(_copy(ours_in, theirs_out)), asyncio.create_task(_copy(theirs_in, ours_out))}
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        for end in (ours_out, theirs_out):
            end.close()


async def _copy(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    while data := await source.read(CHUNK):
        target.write(data)
        await target.drain()
