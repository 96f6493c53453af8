"""The receive window of one utterance: what has come, what is missing, whether it is whole.

Theory of operation
-------------------
Selective repeat (ARQ): phones have indices and may come in any order, more than once, and before their ``begin``. All
below :attr:`ReceiveWindow.next_index` have come; those beyond it are told by a bitmap. An acknowledgement waits
:data:`ACK_S`, so that it covers what comes together; a gap waits :data:`REORDER_S` for a datagram that was overtaken,
then it is asked for (``nack``). A higher revision empties the window. States::

               begin               end
    WAITING ----------->  OPEN  ---------->  ENDED
       |                   ^ |                | |
       |                   | +--- revision ---+ |      (to OPEN)
       |                   |                    |
       +----- cancel ------+-------- cancel ----+---->  CANCELLED
                           +-- engine is through -+-->  OVER

An ``end`` that overtakes its ``begin`` is kept, and counts when that comes. A window that is OVER or CANCELLED still
acknowledges, because repeats of its phones may be under way.
"""

from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf

from fapengine.engine.utterance import gaps
from fapengine.wire.speech_osc.schema import BeginUtterance, EndUtterance, Phones, WirePhone, checksum
from fapengine.wire.speech_osc.sound_window import SoundWindow

ACK_S = 0.02
"""Time in which acknowledgements are gathered into one."""
REORDER_S = 0.03
"""Time in which a missing phone may only have been overtaken; then it is asked for."""
NACK_AGAIN_S = 0.1
MAX_NACKS = 30
UNBEGUN_S = 0.3
"""Time between notices to a sender that a begin has not come."""
MAX_UNBEGUN = 10
"""Number of such notices; then its phones are forgotten."""
BITS = 64
MAX_PASSED = 64


class State(Enum):
    """State of a receive window; see the theory of operation."""

    WAITING = auto()
    """Its begin has not come."""
    OPEN = auto()
    ENDED = auto()
    """Its end is known; phones may still be missing."""
    CANCELLED = auto()
    OVER = auto()
    """The engine is through with it."""


@dataclass(slots=True)
class ReceiveWindow:
    """Phones of one utterance, as they were sent, for the checksum.

    Times that are infinite are timers that do not run. Stateful.
    """

    engine_number: int
    """Number of the utterance in the engine."""
    phone_set: str
    state: State = State.WAITING
    begun: BeginUtterance | None = None
    revision: int = 0
    phones: dict[int, WirePhone] = field(default_factory=dict)
    next_index: int = 0
    """Index below which all phones have come."""
    end: EndUtterance | None = None
    over_s: float = inf
    """Time at which the engine was through with it."""
    is_corrupt: bool = False
    """True where its checksum does not fit."""
    sequence: int = -1
    """Highest sequence number of its datagrams."""
    ack_s: float = inf
    """Time of the next acknowledgement."""
    nack_s: float = inf
    """Time of the next request for what is missing."""
    nacks: int = 0
    unbegun_s: float = inf
    """Time of the next notice that its begin has not come."""
    unbegun: int = 0
    """Number of such notices."""
    follow_s: float = inf
    """Time of the next comparison of its position with the sender's clock."""
    clock_steps: int = 0
    """Number of times that this clock had been set when it began."""
    heard_s: float = -inf
    """Time of the sender's last report of its sound."""
    sound: SoundWindow | None = None
    """Sound from which its phones are heard; None where they are told."""
    words: int | None = None
    """Index below which words have come or were passed over; None where its phones are told."""
    voice: str = ""
    """Language of its words."""
    is_placed: bool = True
    """False where the ear is to say when it begins."""
    _passed: set[int] = field(default_factory=set)
    """Sequence numbers of datagrams that were passed over and may still come."""

    @property
    def is_over(self) -> bool:
        """Whether the engine is through with it."""
        return self.over_s < inf

    @property
    def is_stopped(self) -> bool:
        """Whether it is over, or about to be."""
        return self.state in (State.CANCELLED, State.OVER)

    @property
    def is_whole(self) -> bool:
        """Whether its end is known and no phone is missing."""
        return self.end is not None and (self.words is not None or self.next_index >= self.end.phone_count)

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
            self.state = State.OPEN if self.end is None else State.ENDED
        self.unbegun_s = inf

    def take(self, message: Phones) -> bool:
        """Take phones in; whether there was anything new."""
        revision = self.revision if message.revision is None else message.revision
        if revision < self.revision:
            return False
        if revision > self.revision:
            self._revise(revision)
        before = len(self.phones)
        for index, phone in enumerate(message.phones, message.first_index):
            if index not in self.phones and (self.end is None or index < self.end.phone_count):
                self.phones[index] = phone
        while self.next_index in self.phones:
            self.next_index += 1
        return len(self.phones) > before

    def finish(self, message: EndUtterance) -> bool:
        """Learn its end; whether that was new."""
        if message.revision not in (-1, self.revision) or self.end is not None:
            return False
        self.end = message
        if self.state is State.OPEN:
            self.state = State.ENDED
        for index in [index for index in self.phones if index >= message.phone_count]:
            del self.phones[index]
        self.next_index = min(self.next_index, message.phone_count)
        return True

    def cancel(self) -> None:
        """Take nothing more in."""
        self.state = State.CANCELLED

    def close(self, now_s: float) -> None:
        """Learn that the engine is through with it; remember only what an acknowledgement tells."""
        if self.state is not State.CANCELLED:
            self.state = State.OVER
        self.over_s = now_s
        self.phones = {index: _RECEIVED for index in self.phones if index > self.next_index}
        self.nack_s = self.follow_s = inf

    def missing(self) -> list[tuple[int, int]]:
        """Gaps: first index, index behind the last."""
        return gaps(self.phones, self.next_index, self.end.phone_count if self.end is not None else None)

    def is_sound(self) -> bool:
        """Whether what came is what was sent, as far as it is whole."""
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
        first = max(self.sequence + 1, sequence - MAX_PASSED)
        passed = range(first, sequence)
        self.sequence = sequence
        self._passed.update(passed)
        while len(self._passed) > MAX_PASSED:
            self._passed.remove(min(self._passed))
        return len(passed)

    def watch(self, now_s: float) -> None:
        """After news: be ready to ask for what is missing."""
        gap = len(self.phones) != self.next_index or (self.end is not None and not self.is_whole)
        if not gap or self.is_over:
            self.nack_s, self.nacks = inf, 0
        elif self.nack_s == inf and self.nacks < MAX_NACKS:
            self.nack_s = now_s + REORDER_S

    def _revise(self, revision: int) -> None:
        self.revision = revision
        self.phones, self.next_index, self.end = {}, 0, None
        if self.state is State.ENDED:
            self.state = State.OPEN
        self.is_corrupt = False
        self.nack_s, self.nacks = inf, 0


_RECEIVED = WirePhone("", 0, 0)
