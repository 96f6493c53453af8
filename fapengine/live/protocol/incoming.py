"""One utterance of the robust mode, as far as it has come: what is there, what is missing, whether it is whole."""

from dataclasses import dataclass, field
from math import inf

from fapengine.live.engine.utterance import gaps
from fapengine.live.protocol.schema import BeginUtterance, EndUtterance, Phones, WirePhone, checksum

ACK_S = 0.02
"""Acknowledgements of so long are sent as one."""
REORDER_S = 0.03
"""So long a missing phone may have been overtaken; then it is asked for."""
NACK_AGAIN_S = 0.1
MOST_NACKS = 30
UNBEGUN_S = 0.3
"""After this time its sender is told that an utterance was never begun; so often, then its phones are forgotten."""
MOST_UNBEGUN = 10
BITS = 64
MOST_PASSED = 64


@dataclass(slots=True)
class Incoming:
    """Stateful: one utterance. Its phones are kept as they were sent, for the checksum."""

    number: int
    """The engine's."""
    phone_set: str
    begun: BeginUtterance | None = None
    revision: int = 0
    phones: dict[int, WirePhone] = field(default_factory=dict)
    next_index: int = 0
    """All phones below it are there."""
    end: EndUtterance | None = None
    over_s: float = inf
    """When it was over."""
    is_cancelled: bool = False
    has_error: bool = False
    """Its checksum does not fit."""
    sequence: int = -1
    """Highest of its datagrams."""
    ack_s: float = inf
    """When to acknowledge."""
    nack_s: float = inf
    """When to ask for what is missing."""
    nacks: int = 0
    unbegun_s: float = inf
    unbegun: int = 0
    """How often its sender was told that it was never begun."""
    follow_s: float = inf
    """When to compare its position with the sender's clock."""
    clock_steps: int = 0
    """How often that clock had been set when it began."""
    heard_s: float = -inf
    """When the sender last told where its sound is."""
    _passed: set[int] = field(default_factory=set)
    """Datagrams that may still come."""

    @property
    def is_over(self) -> bool:
        """Whether it was finished or cancelled."""
        return self.over_s < inf

    @property
    def is_stopped(self) -> bool:
        """Whether it is over, or about to be."""
        return self.is_cancelled or self.is_over

    @property
    def is_whole(self) -> bool:
        """Whether its end is known and nothing is missing."""
        return self.end is not None and self.next_index >= self.end.phone_count

    @property
    def bitmap64(self) -> int:
        """Bit n: phone ``next_index + 1 + n`` is there; as a signed int64."""
        if max(self.phones, default=-1) < self.next_index:
            return 0
        bits = sum(1 << n for n in range(BITS) if self.next_index + 1 + n in self.phones)
        return bits - (1 << BITS) if bits >> (BITS - 1) else bits

    @property
    def due_s(self) -> float:
        """When something must be done."""
        return min(self.ack_s, self.nack_s, self.unbegun_s, self.follow_s)

    def begin(self, message: BeginUtterance, phone_set: str) -> None:
        """Learn its beginning, or of a new revision: what is still to come will be sent anew."""
        if self.begun is not None and message.revision > self.revision:
            self._revise(message.revision)
        if self.begun is None or message.revision >= self.revision:
            self.begun, self.phone_set = message, phone_set
            self.revision = max(self.revision, message.revision)
        self.unbegun_s = inf

    def take(self, message: Phones) -> bool:
        """Take phones in; whether there was anything new."""
        revision = self.revision if message.revision is None else message.revision
        if revision < self.revision:
            return False
        if revision > self.revision:
            self._revise(revision)
        known = len(self.phones)
        for index, phone in enumerate(message.phones, message.first_index):
            if index not in self.phones and (self.end is None or index < self.end.phone_count):
                self.phones[index] = phone
        while self.next_index in self.phones:
            self.next_index += 1
        return len(self.phones) > known

    def finish(self, message: EndUtterance) -> bool:
        """Learn its end; whether that was new."""
        if message.revision not in (-1, self.revision) or self.end is not None:
            return False
        self.end = message
        for index in [index for index in self.phones if index >= message.phone_count]:
            del self.phones[index]
        self.next_index = min(self.next_index, message.phone_count)
        return True

    def forget_phones(self) -> None:
        """Remember only what an acknowledgement tells: it is over, and a server remembers many."""
        self.phones = {index: _COME for index in self.phones if index > self.next_index}

    def missing(self) -> list[tuple[int, int]]:
        """Gaps: first index, index behind the last."""
        return gaps(self.phones, self.next_index, self.end.phone_count if self.end is not None else None)

    def is_sound(self) -> bool:
        """Whether what came is what was sent, once it is whole."""
        if self.end is None or not self.end.checksum or not self.is_whole:
            return True
        return checksum(self.phones[index] for index in range(self.end.phone_count)) == self.end.checksum

    def lost(self, sequence: int) -> int:
        """Count datagrams that were passed over; -1 for one that was only overtaken."""
        if sequence <= self.sequence:
            if sequence not in self._passed:
                return 0
            self._passed.remove(sequence)
            return -1
        first = max(self.sequence + 1, sequence - MOST_PASSED)
        passed = range(first, sequence)
        self.sequence = sequence
        self._passed.update(passed)
        while len(self._passed) > MOST_PASSED:
            self._passed.remove(min(self._passed))
        return len(passed)

    def watch(self, now_s: float) -> None:
        """After news: be ready to ask for what is missing."""
        gap = len(self.phones) != self.next_index or (self.end is not None and not self.is_whole)
        if not gap or self.is_over:
            self.nack_s, self.nacks = inf, 0
        elif self.nack_s == inf and self.nacks < MOST_NACKS:
            self.nack_s = now_s + REORDER_S

    def _revise(self, revision: int) -> None:
        self.revision = revision
        self.phones, self.next_index, self.end = {}, 0, None
        self.has_error = False
        self.nack_s, self.nacks = inf, 0


_COME = WirePhone("", 0, 0)
