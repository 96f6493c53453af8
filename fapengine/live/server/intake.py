"""What came in, on its way to the receiver: in turn, in slices short enough that no frame is late.

Theory of operation
-------------------
Reading a datagram costs a microsecond, understanding it a hundred. So sockets are emptied at once (:mod:`.doors`), into
a queue with a bounded place for each peer (:class:`.FairQueue`), and packets are understood in turn, a millisecond at a
time; between two slices the loop shows frames that are due. A peer that floods loses its own packets and nobody else's.
A stream that sends faster is not read until its queue is shorter: nothing of it is lost.
"""

import asyncio
import logging
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Protocol, cast

from fapengine.live.server.fairness import FairQueue

SLICE_S = 0.001
BACKLOG, BACKLOG_SLICE_S = 64, 0.004
"""With more packets waiting, so much is done before a frame, even if frames are skipped for it: what comes too late is
sent again by its senders, and planned in pieces, so that ever more would wait."""
BUSY = 8
"""Datagrams for one frame that are many."""

log = logging.getLogger("fapengine.server")
Replies = list[tuple[Hashable, bytes]]


class Receiver(Protocol):
    """What understands packets: :class:`fapengine.live.protocol.OscReceiver`."""

    def receive(self, packet: bytes, peer: Hashable, now_s: float, wall_s: float) -> Replies:
        """Take a packet in; what is to be answered, and to whom."""
        ...

    def tick(self, now_s: float, is_behind: Callable[[Hashable], bool]) -> Replies:
        """Give what is to be said unasked; ``is_behind`` tells whether packets of a peer wait."""
        ...


class Peer(Protocol):
    """Whom a packet came from, and who can be answered."""

    def send(self, data: bytes) -> bool:
        """Send a packet; False if that is not possible now."""
        ...


@dataclass(slots=True)
class IntakeCounts:
    """Stateful: what came and went."""

    datagrams: int = 0
    stream_packets: int = 0
    replies: int = 0
    unsent: int = 0
    """Replies that could not be sent."""
    faults: int = 0
    """Packets on which the receiver failed: each is a bug, told of in the log."""
    streams: int = 0
    """Open now."""
    streams_refused: int = 0
    """Beyond the limit, or neither SLIP nor lengths."""
    streams_broken: int = 0
    """Ended inside a packet, or by a length that cannot be."""


class Intake:
    """Stateful: packets of all sockets on their way to one receiver.

    Parameters
    ----------
    receiver : Receiver
        It alone knows what packets mean.
    clock, wall : callable
        Seconds: monotonic, which is the engine's; and since 1970.
    queue : FairQueue, optional
    """

    def __init__(
        self,
        receiver: Receiver,
        *,
        clock: Callable[[], float],
        wall: Callable[[], float],
        queue: FairQueue | None = None,
    ) -> None:
        self.receiver = receiver
        self.queue = FairQueue() if queue is None else queue
        self.counts = IntakeCounts()
        self._clock, self._wall = clock, wall
        self._working = False
        self._readers: list[Callable[[], int]] = []
        self.held_back: dict[Hashable, Callable[[], None]] = {}
        """Streams that are not read on; each is told when a packet of it was understood."""
        self.closed = False
        self.is_busy = False
        """Many datagrams came for the last frame."""
        self._counted = 0

    def add_reader(self, reader: Callable[[], int]) -> None:
        """Have a socket emptied before every frame; the function tells how many packets it put in the queue."""
        self._readers.append(reader)

    def put(self, peer: Hashable, packet: bytes) -> bool:
        """Queue a packet, and see to it that somebody works."""
        if self.closed:
            return False
        taken = self.queue.put(peer, packet)
        if taken and not self._working:
            self._working = True
            asyncio.get_running_loop().call_soon(self._work_on)
        return taken

    def before_frame(self, now_s: float) -> None:
        """Take what has come up to now, so that this frame holds it; a slice of it at most, or several behind a jam."""
        for reader in self._readers:
            reader()
        self.is_busy = self.counts.datagrams - self._counted > BUSY
        self._counted = self.counts.datagrams
        self.work(SLICE_S if len(self.queue) <= BACKLOG else BACKLOG_SLICE_S)

    def after_frame(self, now_s: float) -> None:
        """Send what the receiver has to say unasked: acknowledgements, requests, events."""
        self._send(self.receiver.tick(now_s, lambda peer: self.queue.waiting(peer) > 0))

    def work(self, budget_s: float) -> bool:
        """Understand packets in turn for so long; False when none is left."""
        stop_s = self._clock() + budget_s
        while (entry := self.queue.take()) is not None:
            peer, packet = entry
            now_s = self._clock()
            try:
                replies = self.receiver.receive(packet, peer, now_s, self._wall())
            except Exception:  # a bug, but one packet's: the other faces go on
                self.counts.faults += 1
                log.exception("a packet could not be taken in: %s", packet[:64].hex(" "))
                continue
            if self.held_back and peer in self.held_back:
                self.held_back[peer]()
            if replies:
                self._send(replies)
            if now_s >= stop_s:
                break
        return len(self.queue) > 0

    def close(self) -> None:
        """Take nothing more in."""
        self.closed = True
        self._readers.clear()

    def _work_on(self) -> None:
        self._working = self.work(SLICE_S)
        if self._working:
            asyncio.get_running_loop().call_soon(self._work_on)

    def _send(self, replies: Replies) -> None:
        for peer, data in replies:
            sent = cast("Peer", peer).send(data)
            self.counts.replies += sent
            self.counts.unsent += not sent
