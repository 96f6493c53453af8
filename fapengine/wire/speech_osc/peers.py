"""Senders as the receiver knows them, their messages on arrival, counters, limits, and the proof of their addresses.

Anybody can write any address on a datagram. An answer sent there would hit somebody who never asked, with more bytes
than were sent: a reflection attack. So an address that is not proved gets at most :data:`AMPLIFICATION` times the bytes
that came from it, as in QUIC (RFC 9000, section 8), until a hello returns the cookie of a welcome.
"""

import hmac
import math
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine._counters import Counts
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.clock import SenderClock, TagClock

Replies = list[tuple[Hashable, bytes]]
"""Packets to send, each with its receiver."""
AMPLIFICATION = 3
"""Bytes that an address gets per byte that came from it, before it is proved."""
GUESSED_FROM = 32
"""Number of labels from which the phone set of the simple mode is guessed."""
UNKNOWN_S = 0.5
"""Shortest time between two notices that a session or utterance is unknown."""


@dataclass(slots=True)
class WireCounts(Counts):
    """Counts of what senders sent.

    Stateful.
    """

    METRIC = "wire", "What senders sent, by kind."

    packets: int = 0
    bytes: int = 0
    messages: int = 0
    malformed: int = 0
    """Packets that are not OSC or too large, and messages with wrong arguments."""
    unknown: int = 0
    """Messages with an unknown address."""
    surplus: int = 0
    """Arguments after those of the schema."""
    refused: int = 0
    """Messages beyond a limit, or without the token."""
    repeated: int = 0
    """Messages without news."""
    lost: int = 0
    """Datagrams of phones that were sent and have not arrived (yet)."""
    sound_lost: int = 0
    """Audio samples that did not arrive in time."""
    clamped: int = 0
    """Time tags that are too far from now."""
    odd_times: int = 0
    """Audio positions whose time does not fit the sender's clock."""
    clock_steps: int = 0
    """Times that a sender's clock was set."""
    checksums: int = 0
    """Utterances whose checksum does not match."""
    resets: int = 0
    """Senders that were restarted."""
    unproved: int = 0
    """Packets that were not sent, because the address was not proved."""
    moved: int = 0
    """Hellos for sessions of another process."""


@dataclass(frozen=True, slots=True)
class TextRequest:
    """A text for the server's voice to speak."""

    session: str
    text: str
    voice: str
    """Name that the sender gave; empty: any."""
    peer: Hashable


@dataclass(frozen=True, slots=True)
class WordsRequest:
    """Words of an utterance that was begun; the server's voice finds their phones."""

    session: str
    utterance: int
    """The engine's number."""
    words: tuple[tuple[str, float, float], ...]
    """Word, start and end in s from the beginning of the utterance."""
    voice: str
    """Name that the sender gave; empty: any."""
    peer: Hashable
    is_last: bool = False
    duration_s: float = 0.0
    """Length of the utterance, if longer than its words; with the last request."""


@dataclass(frozen=True, slots=True)
class SoundRequest:
    """Audio of an utterance in order and without gaps; the recognizer finds its phones."""

    session: str
    utterance: int
    """The engine's number."""
    first_s: float
    """Time in the utterance of the first sample that arrived, mostly 0."""
    rate_hz: int
    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    is_placed: bool
    """True if the engine knows when the utterance begins; else the recognizer sets its start."""
    is_last: bool


@dataclass(frozen=True, slots=True)
class WireLimits:
    """Limits of one receiver."""

    packet: int = 16_384
    """Bytes. The largest message of the schema has 9 KB."""
    messages: int = 128
    """Messages in a packet: about 3 ms of work."""
    peers: int = 1024
    """Peers that said hello, and as many that did not; the longest silent ones are forgotten."""
    utterances: int = 64
    """Utterances of a session that are remembered; the oldest are forgotten."""
    texts: int = 16
    """Texts that wait for the voice, and as many words."""


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
