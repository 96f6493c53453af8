"""Who sends, and a message on its way through."""

import math
from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field

from fapengine.wire.speech_osc.clock import SenderClock
from fapengine.wire.speech_osc.counts import Tally
from fapengine.wire.speech_osc.time_tags import TagClock

Replies = list[tuple[Hashable, bytes]]
"""Packets to be sent, each with whom to."""
GUESSED_FROM = 32
"""Labels from which the phone set of the simple mode is guessed."""


@dataclass(slots=True, eq=False)
class Peer:
    """One address or connection.

    Stateful.
    """

    name: Hashable
    tally: Tally
    is_trusted: bool
    """True where it may say more than hello."""
    clock: SenderClock = field(default_factory=SenderClock)
    tags: TagClock = field(default_factory=TagClock)
    phone_set: str = ""
    """Phone set of the simple mode; empty: to be guessed."""
    labels: deque[str] = field(default_factory=lambda: deque(maxlen=GUESSED_FROM))
    told_unknown_s: float = -math.inf
    is_proved: bool = False
    """True where it has shown that it is where its packets say that they come from."""
    sent: int = 0
    """Bytes that it was sent before it had."""
    heard_s: float = -math.inf
    """Time of its last packet."""


@dataclass(slots=True, frozen=True, eq=False)
class Arrival:
    """Where a message came from, and when."""

    peer: Peer
    now_s: float
    at_s: float
    """Engine time that its time tag means."""
    replies: Replies
