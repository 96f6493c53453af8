"""Packets on their way to the receiver: peers in turn, in slices short enough that no frame is late.

Theory of operation
-------------------
Reading a datagram costs a microsecond, understanding it a hundred. So sockets are emptied at once
(:mod:`.listeners`), into a queue with a bounded place for each peer
(:class:`~fapengine.server.intake.fair_queue.FairQueue`), and packets are understood in turn, a millisecond at a time;
between two slices the loop shows frames that are due. A peer that floods loses its own packets and no others. A
stream that sends faster is not read until its queue is shorter: nothing of it is lost.
"""

import asyncio
import logging
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Protocol, cast

from fapengine._counters import Counts, Family, metric
from fapengine.server.intake.fair_queue import FairQueue

SLICE_S = 0.001
BACKLOG, BACKLOG_SLICE_S = 64, 0.004
"""Number of waiting packets beyond which a slice is longer, even if frames are skipped for it: senders repeat what is
taken in too late, and it is planned in pieces, so that ever more would wait."""
BUSY = 8
"""Datagrams within one frame from which on the server counts as busy."""

log = logging.getLogger("fapengine.server")
Replies = list[tuple[Hashable, bytes]]


class Receiver(Protocol):
    """The part of :class:`fapengine.wire.speech_osc.receiver.OscReceiver` that the ingress calls."""

    def receive(self, packet: bytes, peer: Hashable, now_s: float, wall_s: float) -> Replies:
        """Take a packet in; what is to be answered, and to whom."""
        ...

    def tick(self, now_s: float, is_behind: Callable[[Hashable], bool]) -> Replies:
        """Give what is to be said unasked; ``is_behind`` tells whether packets of a peer wait."""
        ...


class Peer(Protocol):
    """The sender of a packet, who can be answered."""

    def send(self, data: bytes) -> bool:
        """Send a packet; False if that is not possible now."""
        ...


@dataclass(slots=True)
class IngressCounts(Counts):
    """Counts of packets that came and replies that went.

    Stateful.
    """

    METRIC = "intake", "What came in and what was refused, by kind."

    datagrams: int = 0
    stream_packets: int = 0
    replies: int = 0
    unsent: int = 0
    """Replies that could not be sent."""
    faults: int = 0
    """Packets on which the receiver failed: each is a bug; the log has it."""
    streams: int = metric("streams", "Open TCP connections.", is_gauge=True)
    streams_refused: int = 0
    """Connections beyond the limit, or neither SLIP nor lengths."""
    streams_broken: int = 0
    """Connections that ended inside a packet, or with an impossible length."""


class Ingress:
    """The way of packets from all sockets to one receiver.

    Stateful.

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
        self.counts = IngressCounts()
        self._clock, self._wall = clock, wall
        self._working = False
        self._readers: list[Callable[[], int]] = []
        self.held_back: dict[Hashable, Callable[[], None]] = {}
        """Streams that are not read on, and what to call when a packet of theirs was handled."""
        self.closed = False
        self.is_mute = False
        """True if nothing more is sent to senders: another server goes on with what they say."""
        self.is_busy = False
        """Many datagrams came for the last frame."""
        self._counted = 0

    def families(self) -> Iterator[Family]:
        """Metrics of what came in."""
        yield from self.counts.families()
        lost = (("flooded", self.queue.flooded), ("crowded", self.queue.crowded))
        yield Family(*IngressCounts.METRIC, tuple(((("kind", kind),), number) for kind, number in lost))
        yield Family.of("packets_waiting", "Packets not yet understood.", len(self.queue), is_gauge=True)

    def add_reader(self, reader: Callable[[], int]) -> None:
        """Have a socket emptied before every frame; the function tells how many packets it put in the queue."""
        self._readers.append(reader)

    def put(self, peer: Hashable, packet: bytes) -> bool:
        """Queue a packet, and have it handled soon."""
        if self.closed:
            return False
        taken = self.queue.put(peer, packet)
        if taken and not self._working:
            self._working = True
            asyncio.get_running_loop().call_soon(self._work_on)
        return taken

    def before_frame(self, now_s: float) -> None:
        """Handle what has come up to now, so that this frame shows it: for a slice of time, or several after a jam."""
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

    def answer(self, peer: Hashable, data: bytes) -> None:
        """Send a packet to a peer that was heard."""
        self._send([(peer, data)])

    def close(self) -> None:
        """Take nothing more in."""
        self.closed = True
        self._readers.clear()

    def _work_on(self) -> None:
        self._working = self.work(SLICE_S)
        if self._working:
            asyncio.get_running_loop().call_soon(self._work_on)

    def _send(self, replies: Replies) -> None:
        if self.is_mute:
            return
        for peer, data in replies:
            sent = cast("Peer", peer).send(data)
            self.counts.replies += sent
            self.counts.unsent += not sent
