"""Senders as the receiver knows them, their messages on arrival, and the proof that they own their addresses.

Anybody can write any address on a datagram. An answer sent there would hit somebody who never asked, with more bytes
than were sent: a reflection attack. So an address that is not proved gets at most :data:`AMPLIFICATION` times the bytes
that came from it, as in QUIC (RFC 9000, section 8), until a hello returns the cookie of a welcome.
"""

import hmac
import math
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.clock import SenderClock, TagClock
from fapengine.wire.speech_osc.counts import WireCounts

Replies = list[tuple[Hashable, bytes]]
"""Packets to send, each with its receiver."""
AMPLIFICATION = 3
"""Bytes that an address gets per byte that came from it, before it is proved."""
GUESSED_FROM = 32
"""Number of labels from which the phone set of the simple mode is guessed."""
UNKNOWN_S = 0.5
"""Shortest time between two notices that a session or utterance is unknown."""


@dataclass(frozen=True, slots=True)
class Proof:
    """Cookies, and what else is known about the addresses of peers. By default all peers are believed.

    Examples
    --------
    >>> proof = Proof(secret=b"of this run", is_sure_of=lambda peer: False)
    >>> proof.cookie_of("udp://192.0.2.1:9") == proof.cookie_of("udp://192.0.2.1:9") != proof.cookie_of("udp://192.0.2.2:9")
    True
    """

    secret: bytes = b""
    """Random bytes of this run of the server."""
    is_sure_of: Callable[[Hashable], bool] = lambda peer: True
    """Whether a peer needs no proof: a connection, or an address of this machine."""
    host_of: Callable[[Hashable], str] = lambda peer: ""
    """Host of a peer."""

    def cookie_of(self, peer: Hashable) -> int:
        """Return the number, 1 to 2**31 - 1, that only a receiver of the peer's packets can know."""
        digest = hmac.digest(self.secret, str(peer).encode(), "sha256")
        return int.from_bytes(digest[:4]) >> 1 or 1


@dataclass(slots=True, eq=False)
class Peer:
    """One address or connection.

    Stateful.
    """

    name: Hashable
    is_trusted: bool
    """True if messages other than hello are accepted."""
    is_proved: bool = False
    """True if the peer has shown that it receives at the address of its packets."""
    clock: SenderClock = field(default_factory=SenderClock)
    tags: TagClock = field(default_factory=TagClock)
    phone_set: str = ""
    """Phone set of the simple mode; empty: guessed."""
    labels: deque[str] = field(default_factory=lambda: deque(maxlen=GUESSED_FROM))
    told_unknown_s: float = -math.inf
    """Time of the last notice that a session or utterance is unknown."""
    received: int = 0
    """Bytes that came from it."""
    sent: int = 0
    """Bytes that it was sent before it was proved."""
    heard_s: float = -math.inf
    """Time of its last packet."""


@dataclass(slots=True, frozen=True, eq=False)
class Arrival:
    """Sender and time of a message, and where its answers go."""

    peer: Peer
    now_s: float
    at_s: float
    """Engine time of its time tag."""
    replies: Replies
    counts: WireCounts

    def answer(self, wire: schema.FromEngine) -> None:
        """Answer the sender."""
        self.replies.append((self.peer.name, codec.encode(wire)))

    def notify(self, session: str, utterance: int, kind: str, *, count: int = 1, reason: str = "") -> None:
        """Answer with an event that happens now."""
        self.answer(schema.Notice(session, utterance, kind, 0, count, round(self.now_s * 1e6), reason))

    def refuse(self, session: str, reason: str, utterance: int = -1) -> None:
        """Answer that the message is refused."""
        self.counts.refused += 1
        self.notify(session, utterance, "error", reason=reason)

    def notify_unknown(self, session: str, utterance: int) -> None:
        """Answer that the session or utterance is unknown, but not more often than every :data:`UNKNOWN_S`."""
        self.counts.refused += 1
        if self.now_s - self.peer.told_unknown_s > UNKNOWN_S:
            self.peer.told_unknown_s = self.now_s
            self.notify(session, utterance, "unknown")
