"""What a receiver has met with, of each peer and of all together."""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._counters import Counts


@dataclass(slots=True)
class PeerCounts(Counts):
    """Counts of what came from one peer, or from all.

    Stateful.
    """

    METRIC = "wire", "What senders sent, by kind."

    packets: int = 0
    bytes: int = 0
    messages: int = 0
    malformed: int = 0
    """Packets that are no OSC or too large, and messages whose arguments are wrong."""
    unknown: int = 0
    """Messages of an address that means nothing here."""
    surplus: int = 0
    """Arguments behind those that mean something."""
    refused: int = 0
    """Messages beyond a limit, or without the token."""
    repeated: int = 0
    """Messages that told nothing new."""
    lost: int = 0
    """Datagrams of phones that were sent and have not come (yet)."""
    sound_lost: int = 0
    """Samples of sound that did not come in time."""
    clamped: int = 0
    """Time tags that could not be meant."""
    odd_times: int = 0
    """Positions of the sound whose time does not fit the sender's clock."""
    clock_steps: int = 0
    """Times that a sender's clock was set."""
    checksums: int = 0
    """Utterances that came otherwise than they were sent."""
    resets: int = 0
    """Senders that began anew."""
    unproved: int = 0
    """Packets that were not sent, because it was not sure who would get them."""
    moved: int = 0
    """Hellos for sessions that are elsewhere."""


@dataclass(frozen=True, slots=True)
class TextRequest:
    """A text that a sender wants spoken; who has a voice does it."""

    session: str
    text: str
    voice: str
    """Name as the sender gives it; empty: any."""
    peer: Hashable


@dataclass(frozen=True, slots=True)
class WordsRequest:
    """Words of an utterance that was begun; who has a voice finds their phones."""

    session: str
    utterance: int
    """The engine's number."""
    words: tuple[tuple[str, float, float], ...]
    """Word, start and end in s from the utterance's beginning."""
    voice: str
    """Name as the sender gives it; empty: any."""
    peer: Hashable
    is_last: bool = False
    duration_s: float = 0.0
    """Length of the utterance, with the last, if longer than its words."""


@dataclass(frozen=True, slots=True)
class SoundRequest:
    """Sound of an utterance in order and without holes; who has an ear finds its phones."""

    session: str
    utterance: int
    """The engine's number."""
    first_s: float
    """Time in the utterance at which it was joined, mostly 0."""
    rate_hz: int
    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    is_placed: bool
    """True where the engine was told when the utterance begins; else it is for the ear to say."""
    is_last: bool


@dataclass(frozen=True, slots=True)
class WireLimits:
    """What one receiver takes."""

    packet: int = 16_384
    """Bytes. The largest message of the schema has 9 KB."""
    messages: int = 128
    """Messages in a packet: some 3 ms of work."""
    peers: int = 1024
    """Peers that said hello, and as many that did not; the ones not heard of longest are forgotten."""
    utterances: int = 64
    """Utterances of a session that are remembered; the oldest are forgotten."""
    texts: int = 16
    """Not yet taken by the voice."""


@dataclass(slots=True)
class Tally:
    """Counts for a peer and for all.

    Stateful.
    """

    peer: PeerCounts
    total: PeerCounts

    def add(self, name: str, number: int = 1) -> None:
        """Count."""
        if number:
            setattr(self.peer, name, max(getattr(self.peer, name) + number, 0))
            setattr(self.total, name, max(getattr(self.total, name) + number, 0))
