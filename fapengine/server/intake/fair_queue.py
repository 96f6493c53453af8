"""Packets wait here, a queue for each peer, and are taken in turn: a flood fills its own queue and no other.

A turn is a few packets, because what comes together is answered and planned together.
"""

from collections import deque
from collections.abc import Hashable

from fapengine.errors import UsageError

PACKETS_A_PEER = 256
"""A second of a lively sender."""
PEERS = 4096
TURN = 6
"""Packets: a clause of speech has about so many."""


class FairQueue:
    """A bounded queue that serves its peers in turn, a few packets each (fair queuing).

    Stateful.

    Parameters
    ----------
    packets_a_peer, peers : int
        A packet beyond is refused.
    turn : int
        Packets of one peer that are taken before it is another's turn.

    Attributes
    ----------
    flooded : int
        Packets refused because their peer had too many waiting.
    crowded : int
        Packets refused because too many peers had some.

    Raises
    ------
    UsageError
        If a bound is not positive.

    Examples
    --------
    >>> queue = FairQueue(turn=1)
    >>> for peer, packet in (("a", b"1"), ("a", b"2"), ("b", b"3")):
    ...     _ = queue.put(peer, packet)
    >>> [queue.take() for _ in range(4)]
    [('a', b'1'), ('b', b'3'), ('a', b'2'), None]
    """

    def __init__(self, *, packets_a_peer: int = PACKETS_A_PEER, peers: int = PEERS, turn: int = TURN) -> None:
        if packets_a_peer < 1 or peers < 1 or turn < 1:
            raise UsageError(
                f"queue: got {packets_a_peer} packets of {peers} peers, {turn} a turn, expected 1 or more of each"
            )
        self.flooded = self.crowded = 0
        self._turn = self._left = turn
        self._room, self._peers = packets_a_peer, peers
        self._waiting: dict[Hashable, deque[bytes]] = {}
        self._turns: deque[Hashable] = deque()
        self._count = 0

    def __len__(self) -> int:
        """Packets that wait."""
        return self._count

    def put(self, peer: Hashable, packet: bytes) -> bool:
        """Let a packet wait; False, and counted, where there is no room for it."""
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
        """Take the next packet in turn, and whose it is; None where none waits."""
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
        """How many packets of a peer wait."""
        return len(self._waiting.get(peer, ()))
