"""Packets on their way to the receiver: senders take turns, in time slices short enough that no frame is late.

Theory of operation
-------------------
Reading a datagram takes a microsecond, decoding it a hundred. So sockets are emptied at once (:mod:`.listeners`) into
a queue with a bounded number of places per sender (:class:`FairQueue`), and packets are decoded in turn, one
millisecond at a time; between two slices the loop shows the frames that are due. A sender that floods loses only its
own packets. A stream that sends faster is not read until its queue is shorter, so it loses nothing.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Protocol, cast

from fapengine._counters import Counts, Family, metric
from fapengine.wire.speech_osc.receiver import OscReceiver

SLICE_S = 0.001
BACKLOG, BACKLOG_SLICE_S = 64, 0.004
"""Number of waiting packets beyond which a slice is longer, even if frames are skipped for it: senders repeat packets
that are handled too late, so the backlog would only grow."""
BUSY = 8
"""Datagrams within one frame from which on the server counts as busy."""
PACKETS_A_PEER = 256
"""Waiting packets per sender: one second of a fast sender."""
PEERS = 4096
TURN = 6
"""Packets per turn; a clause of speech has about six. Packets that come together are planned together."""

log = logging.getLogger("fapengine.server")
Replies = list[tuple[Hashable, bytes]]


class FairQueue:
    """A bounded queue that serves its peers in turn, a few packets each (fair queuing).

    Stateful.

    Parameters
    ----------
    packets_a_peer, peers : int
        Limits; packets beyond them are refused.
    turn : int
        Packets of one peer that are taken before the next peer's turn.

    Attributes
    ----------
    flooded : int
        Packets refused because their peer had too many waiting.
    crowded : int
        Packets refused because too many peers had packets waiting.

    Examples
    --------
    >>> queue = FairQueue(turn=1)
    >>> for peer, packet in (("a", b"1"), ("a", b"2"), ("b", b"3")):
    ...     _ = queue.put(peer, packet)
    >>> [queue.take() for _ in range(4)]
    [('a', b'1'), ('b', b'3'), ('a', b'2'), None]
    """

    def __init__(self, *, packets_a_peer: int = PACKETS_A_PEER, peers: int = PEERS, turn: int = TURN) -> None:
        self.flooded = self.crowded = 0
        self._turn = self._left = turn
        self._room, self._peers = packets_a_peer, peers
        self._waiting: dict[Hashable, deque[bytes]] = {}
        self._turns: deque[Hashable] = deque()
        self._count = 0

    def __len__(self) -> int:
        """Return the number of waiting packets."""
        return self._count

    def put(self, peer: Hashable, packet: bytes) -> bool:
        """Add a packet; False, and counted, if there is no room for it."""
        packets = self._waiting.get(peer)
        if packets is None:
            if len(self._waiting) >= self._peers:
                self.crowded += 1
                return False
            packets = self._waiting[peer] = deque()
            self._turns.append(peer)
        elif len(packets) >= self._room:
            self.flooded += 1
            return False
        packets.append(packet)
        self._count += 1
        return True

    def take(self) -> tuple[Hashable, bytes] | None:
        """Remove the next packet in turn; return its peer and the packet, or None if the queue is empty."""
        if not self._turns:
            return None
        peer = self._turns[0]
        packets = self._waiting[peer]
        packet = packets.popleft()
        self._count -= 1
        self._left -= 1
        if not packets:
            del self._waiting[self._turns.popleft()]
            self._left = self._turn
        elif not self._left:
            self._turns.rotate(-1)
            self._left = self._turn
        return peer, packet

    def waiting(self, peer: Hashable) -> int:
        """Return the number of waiting packets of a peer."""
        return len(self._waiting.get(peer, ()))


class Peer(Protocol):
    """The sender of a packet, who can be answered."""

    def send(self, data: bytes) -> bool:
        """Send a packet; False if that is not possible now."""


@dataclass(slots=True)
class IngressCounts(Counts):
    """Counts of received packets and sent replies. Stateful."""

    METRIC = "intake", "What came in and what was refused, by kind."

    datagrams: int = 0
    stream_packets: int = 0
    replies: int = 0
    unsent: int = 0
    """Replies that could not be sent."""
    faults: int = 0
    """Packets on which the receiver failed: each is a bug, and is logged."""
    streams: int = metric("streams", "Open TCP connections.", is_gauge=True)
    streams_refused: int = 0
    """Connections beyond the limit, or with unknown framing."""
    streams_broken: int = 0
    """Connections that ended inside a packet, or had an impossible packet length."""


class Ingress:
    """The path of packets from all sockets to one receiver. Stateful.

    Parameters
    ----------
    receiver : OscReceiver
        Decodes the packets.
    clock, wall : callable
        Time in s: monotonic, as the engine's; and since 1970.
    queue : FairQueue, optional
    """

    def __init__(
        self,
        receiver: OscReceiver,
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
        self.readers: list[Callable[[], int]] = []
        """Functions that empty a socket into the queue; called before every frame."""
        self.held_back: dict[Hashable, Callable[[], None]] = {}
        """Streams that are not read at the moment, with the function to call after one of their packets is handled."""
        self.closed = False
        self.is_mute = False
        """True if nothing more is sent to senders, because another server takes over their sessions."""
        self.is_busy = False
        """Many datagrams came for the last frame."""
        self._counted = 0

    def families(self) -> Iterator[Family]:
        """Metrics of the ingress."""
        yield from self.counts.families()
        lost = (("flooded", self.queue.flooded), ("crowded", self.queue.crowded))
        yield Family(*IngressCounts.METRIC, tuple(((("kind", kind),), number) for kind, number in lost))
        yield Family.of("packets_waiting", "Packets not yet understood.", len(self.queue), is_gauge=True)

    def put(self, peer: Hashable, packet: bytes) -> bool:
        """Queue a packet and schedule its handling; False if there is no room."""
        if self.closed:
            return False
        taken = self.queue.put(peer, packet)
        if taken and not self._working:
            self._working = True
            asyncio.get_running_loop().call_soon(self._continue)
        return taken

    def before_frame(self) -> None:
        """Handle the packets that have arrived, for one time slice, or a longer one if there is a backlog."""
        for reader in self.readers:
            reader()
        self.is_busy = self.counts.datagrams - self._counted > BUSY
        self._counted = self.counts.datagrams
        self.work(SLICE_S if len(self.queue) <= BACKLOG else BACKLOG_SLICE_S)

    def after_frame(self, now_s: float) -> None:
        """Send the receiver's own messages: acknowledgements, requests, events."""
        self.send(self.receiver.tick(now_s, lambda peer: self.queue.waiting(peer) > 0))

    def work(self, budget_s: float) -> bool:
        """Handle packets in turn for a time; False if none is left."""
        stop_s = self._clock() + budget_s
        while (entry := self.queue.take()) is not None:
            peer, packet = entry
            now_s = self._clock()
            try:
                replies = self.receiver.receive(packet, peer, now_s, self._wall())
            except Exception:  # a bug, but of one packet: the other faces continue
                self.counts.faults += 1
                log.exception("a packet could not be handled: %s", packet[:64].hex(" "))
                continue
            if peer in self.held_back:
                self.held_back[peer]()
            if replies:
                self.send(replies)
            if now_s >= stop_s:
                break
        return len(self.queue) > 0

    def close(self) -> None:
        """Accept no more packets."""
        self.closed = True
        self.readers.clear()

    def send(self, replies: Replies) -> None:
        """Send packets to peers."""
        if self.is_mute:
            return
        for peer, data in replies:
            sent = cast("Peer", peer).send(data)
            self.counts.replies += sent
            self.counts.unsent += not sent

    def _continue(self) -> None:
        self._working = self.work(SLICE_S)
        if self._working:
            asyncio.get_running_loop().call_soon(self._continue)
