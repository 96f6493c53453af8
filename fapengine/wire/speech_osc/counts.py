"""Counters and limits of a receiver, and its requests to the server's voice and recognizer."""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine._counters import Counts


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
