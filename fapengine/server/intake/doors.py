"""Limits on connections: in total, per address, and in time.

All connections fit below the number of files that the system lets a process open. One that keeps the server waiting is
closed.
"""

import asyncio
import math
import socket
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import cast

from fapengine._counters import Counts, metric

SPARE_FILES = 96
"""Files reserved for everything but connections: listeners, sinks, audio, a profile being read, growth."""
SEND_BUFFER = 32 << 10
"""Size of the system's buffer that is requested for frames; by default minutes of frames may wait there."""
UNREAD_S = 20.0
"""Time within which a connection must read some of what was sent, once more than its limit is unread."""
MAX_FILES = 65_536
"""Soft limit of open files to ask for; more is useless, and some libraries iterate over all of them."""


@dataclass(slots=True)
class DoorCounts(Counts):
    """Counts of connections at one port. Stateful."""

    METRIC = "connections_lost", "Those refused or hung up on."

    open: int = metric("connections", "Open connections, by port.", is_gauge=True)
    refused: int = 0
    """Connections, and requests through proxies, beyond the total limit or that of one address."""
    timed_out: int = 0
    """Connections closed because they were silent."""


@dataclass(slots=True)
class Door:
    """The connection limit of one port. Stateful.

    Examples
    --------
    >>> door = Door(most=3, most_an_address=2)
    >>> [door.enter(address) for address in ("10.0.0.1", "10.0.0.1", "10.0.0.1", "10.0.0.2", "10.0.0.3")]
    [True, True, False, True, False]
    >>> door.leave("10.0.0.1")
    >>> door.enter("10.0.0.3"), door.counts
    (True, DoorCounts(open=3, refused=2, timed_out=0))
    """

    most: int
    most_an_address: int
    counts: DoorCounts = field(default_factory=DoorCounts)
    proxies: tuple[str, ...] = ()
    """Addresses whose connections have no limit but the total: those who ask through them are counted by
    :meth:`begin`."""
    _inside: Counter[str] = field(default_factory=Counter)

    @classmethod
    def shared(cls, most: int) -> "Door":
        """Make a door at which one address gets a quarter of the places."""
        return cls(most, -(-most // 4))

    def enter(self, address: str) -> bool:
        """Accept a connection if there is room; each accepted one must :meth:`leave`."""
        if self.counts.open >= self.most:
            self.counts.refused += 1
            return False
        if address not in self.proxies and not self.begin(address):
            return False
        self.counts.open += 1
        return True

    def leave(self, address: str) -> None:
        """Free the place of a connection."""
        self.counts.open -= 1
        if address not in self.proxies:
            self.end(address)

    def begin(self, address: str) -> bool:
        """Give an address one of its places, for a connection or for a request through a proxy, until :meth:`end`."""
        if self._inside[address] >= self.most_an_address:
            self.counts.refused += 1
            return False
        self._inside[address] += 1
        return True

    def end(self, address: str) -> None:
        """Free a place of an address."""
        self._inside[address] -= 1
        if not self._inside[address]:
            del self._inside[address]


class Guarded(asyncio.BaseProtocol):
    """A connection that has a place at a door, and is closed if it keeps the server waiting. Stateful.

    A protocol that inherits from this says what it waits for (:meth:`expect`). That the other end reads is expected of
    every connection.
    """

    host = "?"
    """Address of the other end."""
    door: Door
    _link: asyncio.Transport | None = None
    _patience_s: float | None = None
    _due_s = math.inf
    _is_stuck = False
    _unread = 0
    _timer: asyncio.TimerHandle | None = None

    def enter(self, door: Door, transport: asyncio.BaseTransport) -> bool:
        """Take a place; False if there is none."""
        self.host = str(transport.get_extra_info("peername")[0])
        if not door.enter(self.host):
            return False
        self.door, self._link = door, cast("asyncio.Transport", transport)
        return True

    def connection_lost(self, exc: BaseException | None) -> None:
        """Leave the place."""
        if self._link is not None:
            self._link = None
            self.door.leave(self.host)
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(cast("Exception | None", exc))

    def expect(self, within_s: float | None) -> None:
        """Close the connection unless this is called again within a time; None: it may be silent."""
        self._patience_s = within_s
        self._begin(min(within_s or UNREAD_S, UNREAD_S) if self._is_stuck else within_s)

    def pause_writing(self) -> None:
        """Begin to wait until the other end reads."""
        super().pause_writing()
        self._is_stuck = True
        self._begin(UNREAD_S)

    def resume_writing(self) -> None:
        """Note that the other end has read."""
        super().resume_writing()
        self._is_stuck = False
        self._begin(self._patience_s)

    def late(self) -> None:
        """End the connection at once: it has kept the server waiting for too long, or is broken."""
        if self._link is not None:
            self._link.abort()

    def _begin(self, within_s: float | None) -> None:
        if self._link is None:
            return
        loop, self._unread = asyncio.get_running_loop(), 0
        self._due_s = math.inf if within_s is None else loop.time() + within_s
        if self._timer is not None and self._timer.when() > self._due_s:
            self._timer.cancel()
            self._timer = None
        if self._timer is None and within_s is not None:
            self._timer = loop.call_at(self._due_s, self._check)

    def _check(self) -> None:
        self._timer = None
        if self._link is None or self._due_s == math.inf:
            return
        loop, unread = asyncio.get_running_loop(), self._link.get_write_buffer_size()
        if loop.time() >= self._due_s:
            if not unread or 0 < self._unread <= unread:
                self.door.counts.timed_out += 1
                self.late()
                return
            self._due_s, self._unread = loop.time() + UNREAD_S, unread
        self._timer = loop.call_at(self._due_s, self._check)


def limit_unread(transport: asyncio.BaseTransport, most_bytes: int, resume_bytes: int) -> None:
    """Limit what a receiver of frames may leave unread; beyond that, the transport pauses until less is left."""
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    cast("asyncio.Transport", transport).set_write_buffer_limits(most_bytes, resume_bytes)


def open_doors(most: Mapping[str, int], most_an_address: int, files: int | None = None) -> dict[str, Door]:
    """Make the limits of several ports, reduced in proportion so that all connections fit below the limit of files.

    Parameters
    ----------
    most : mapping of str to int
        Connections of each port.
    most_an_address : int
        Connections of each port from one address.
    files : int, optional
        Files that the process may open; None: unlimited.

    Examples
    --------
    >>> [door.most for door in open_doors({"osc": 256, "page": 512, "metrics": 512}, 128, files=256).values()]
    [32, 64, 64]
    """
    total = sum(most.values())
    room = total if files is None else min(total, max(files - SPARE_FILES, len(most)))
    shares = {name: max(1, number * room // total) for name, number in most.items()}
    return {name: Door(share, min(share, most_an_address)) for name, share in shares.items()}


def raise_file_limit() -> int | None:
    """Let this process open as many files as the system allows; return that number, or None if it is unlimited."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        return wanted
    return None if soft == resource.RLIM_INFINITY else soft
