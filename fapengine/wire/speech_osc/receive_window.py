"""Receive windows of one utterance: :class:`ReceiveWindow` for phones, :class:`SoundWindow` for audio.

Theory of operation
-------------------
*Phones*: selective repeat (ARQ). Phones have indices and may arrive in any order, more than once, and before their
``begin``. All below :attr:`ReceiveWindow.next_index` have arrived; a bitmap reports those beyond it. An acknowledgement
waits :data:`ACK_S`, so that it covers what arrives together. A gap waits :data:`REORDER_S` for a reordered datagram,
then the window requests the missing phones (``nack``). A higher revision empties the window. An ``end`` that arrives
before its ``begin`` is kept until then. A window that is over or cancelled still acknowledges, because repeats of its
phones may be under way.

*Audio*: each datagram carries the index of its first sample in the utterance, so repeats and reordering do no harm.
Samples after a gap are held for :data:`HOLD_S`; then the gap is filled: its first :data:`MIRROR_S` with the samples
before it in reverse, the rest with silence.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.wire.speech_osc.schema import BeginUtterance, EndUtterance, Phones, WirePhone, checksum

ACK_S = 0.02
"""Time in which acknowledgements are gathered into one."""
REORDER_S = 0.03
"""Time that a missing phone may be late by reordering; then it is requested."""
NACK_AGAIN_S = 0.1
MAX_NACKS = 30
UNBEGUN_S = 0.3
"""Time between notices to a sender that a begin has not arrived."""
MAX_UNBEGUN = 10
"""Number of such notices; then the phones are dropped."""
BITS = 64
MAX_PASSED = 64

HOLD_S = 0.06
"""Time that samples after a gap are held."""
MIRROR_S = 0.06
MAX_GAP_S = 10.0
"""Longest gap that is filled; samples beyond it are refused."""
JOIN_S = 2.0
"""Longest gap at the beginning that is waited for; audio that starts later is joined where it starts."""


@dataclass(slots=True)
class SoundWindow:
    """Audio of one utterance on arrival. Stateful."""

    rate_hz: int
    first: int = -1
    """Index of the first sample; -1 before any has arrived."""
    next: int = 0
    """Index below which all samples were released."""
    stop: int | None = None
    """Index after the last sample, once it is known."""
    lost: int = 0
    """Number of samples that were filled in."""
    is_released: bool = False
    """True when all samples up to the end were released."""
    _held: dict[int, NDArray[np.int16]] = field(default_factory=dict)
    _since_s: float = inf
    """Time since which samples are held, or the end is waited for."""
    _last: NDArray[np.int16] = field(default_factory=lambda: np.zeros(0, np.int16))

    def take(self, first: int, samples: NDArray[np.int16], now_s: float) -> bool | None:
        """Add samples, (N,) int16; False if none of them is new, None if they are too far ahead."""
        if self.first < 0:
            self.first = self.next = first if first > JOIN_S * self.rate_hz else 0
        if first - self.next > MAX_GAP_S * self.rate_hz:
            return None
        is_old = first + len(samples) <= self.next or first in self._held
        if is_old or (self.stop is not None and first >= self.stop):
            return False
        self._held[first] = samples
        self._since_s = min(self._since_s, now_s)
        return True

    def finish(self, stop: int | None, now_s: float) -> None:
        """Set the index after the last sample; None: after what has arrived."""
        if self.stop is None:
            arrived = max([self.next, *(first + len(held) for first, held in self._held.items())])
            latest = arrived + round(MAX_GAP_S * self.rate_hz)
            self.stop = arrived if stop is None else min(max(stop, arrived), latest)
            self._since_s = min(self._since_s, now_s)

    def release(self, now_s: float) -> list[NDArray[np.int16]]:
        """Return the next samples in order, (N,) int16 each; fill gaps that are old enough."""
        pieces = self._in_order()
        is_late = self._since_s <= now_s - HOLD_S
        while is_late and self._held:
            pieces += [self._fill(min(self._held) - self.next), *self._in_order()]
        if self.stop is not None and not self._held and not self.is_released:
            if is_late and self.next < self.stop:
                pieces.append(self._fill(self.stop - self.next))
            self.is_released = self.next >= self.stop
        if pieces or not self._held:
            self._since_s = now_s if self._held or (self.stop is not None and not self.is_released) else inf
        return pieces

    def _in_order(self) -> list[NDArray[np.int16]]:
        pieces = []
        while self._held and (first := min(self._held)) <= self.next:
            piece = self._held.pop(first)[self.next - first :]
            if self.stop is not None:
                piece = piece[: max(self.stop - self.next, 0)]
            if len(piece):
                pieces.append(piece)
                self._last = piece
                self.next += len(piece)
        return pieces

    def _fill(self, count: int) -> NDArray[np.int16]:
        filled = np.zeros(count, np.int16)
        mirrored = self._last[::-1][: min(count, round(MIRROR_S * self.rate_hz))]
        filled[: len(mirrored)] = mirrored
        self.next += count
        self.lost += count
        return filled


@dataclass(slots=True)
class ReceiveWindow:
    """Phones of one utterance, as they were sent, for the checksum.

    An infinite time is a timer that does not run. Stateful.
    """

    engine_number: int
    """Number of the utterance in the engine."""
    phone_set: str
    begun: BeginUtterance | None = None
    """Its begin, once it has arrived."""
    revision: int = 0
    phones: dict[int, WirePhone] = field(default_factory=dict)
    next_index: int = 0
    """Index below which all phones have arrived."""
    end: EndUtterance | None = None
    """Its end, once it has arrived; phones may still be missing."""
    is_cancelled: bool = False
    over_s: float = inf
    """Time at which the engine closed the utterance."""
    is_corrupt: bool = False
    """True if its checksum does not match."""
    sequence: int = -1
    """Highest sequence number of its datagrams."""
    ack_s: float = inf
    """Time of the next acknowledgement."""
    nack_s: float = inf
    """Time of the next request for missing phones."""
    nacks: int = 0
    unbegun_s: float = inf
    """Time of the next notice that its begin has not arrived."""
    unbegun: int = 0
    """Number of such notices."""
    follow_s: float = inf
    """Time of the next comparison of its position with the sender's clock."""
    clock_steps: int = 0
    """Steps of this clock when the utterance began."""
    heard_s: float = -inf
    """Time of the sender's last report of its audio position."""
    sound: SoundWindow | None = None
    """Its audio, if the recognizer finds its phones."""
    words: int | None = None
    """Index below which words have arrived or were skipped; None if phones are sent."""
    voice: str = ""
    """Language of its words."""
    is_placed: bool = True
    """False if the recognizer sets its start."""
    _skipped: set[int] = field(default_factory=set)
    """Sequence numbers of skipped datagrams that may still arrive."""

    @property
    def is_over(self) -> bool:
        """Whether the engine has closed the utterance."""
        return self.over_s < inf

    @property
    def is_stopped(self) -> bool:
        """Whether the utterance is over or cancelled."""
        return self.is_cancelled or self.is_over

    @property
    def is_whole(self) -> bool:
        """Whether the end has arrived and no phone is missing."""
        return self.end is not None and (self.words is not None or self.next_index >= self.end.phone_count)

    @property
    def bitmap64(self) -> int:
        """Bit n: phone ``next_index + 1 + n`` has arrived; as a signed int64."""
        bits = sum(1 << n for n in range(BITS) if self.next_index + 1 + n in self.phones)
        return bits - (1 << BITS) if bits >> (BITS - 1) else bits

    def begin(self, message: BeginUtterance, phone_set: str) -> None:
        """Store the begin, or that of a new revision, whose phones will all be sent again."""
        if self.begun is not None and message.revision > self.revision:
            self._revise(message.revision)
        if self.begun is None or message.revision >= self.revision:
            self.begun, self.phone_set, self.is_cancelled = message, phone_set, False
            self.revision = max(self.revision, message.revision)
        self.unbegun_s = inf

    def take(self, message: Phones) -> bool:
        """Store phones; return whether any of them is new."""
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
        """Store the end; return whether it is new."""
        if message.revision not in (-1, self.revision) or self.end is not None:
            return False
        self.end = message
        self.phones = {index: phone for index, phone in self.phones.items() if index < message.phone_count}
        self.next_index = min(self.next_index, message.phone_count)
        return True

    def close(self, now_s: float) -> None:
        """Note that the engine has closed the utterance; keep only what acknowledgements need."""
        self.over_s = now_s
        self.phones = {index: _RECEIVED for index in self.phones if index > self.next_index}
        self.nack_s = self.follow_s = inf

    def missing(self) -> list[tuple[int, int]]:
        """Gaps: first index, index after the last."""
        return gaps(self.phones, self.next_index, self.end.phone_count if self.end is not None else None)

    def count_lost(self, sequence: int) -> int:
        """Count the datagrams that this one skipped; -1 if it was counted as lost and is only reordered."""
        if sequence <= self.sequence:
            if sequence not in self._skipped:
                return 0
            self._skipped.remove(sequence)
            return -1
        skipped = range(max(self.sequence + 1, sequence - MAX_PASSED), sequence)
        self.sequence = sequence
        self._skipped.update(skipped)
        while len(self._skipped) > MAX_PASSED:
            self._skipped.remove(min(self._skipped))
        return len(skipped)

    def check(self, now_s: float) -> bool:
        """Set the timer of requests after news; return True if all has arrived and the checksum does not match."""
        has_gap = len(self.phones) != self.next_index or (self.end is not None and not self.is_whole)
        if not has_gap or self.is_over:
            self.nack_s, self.nacks = inf, 0
        elif self.nack_s == inf and self.nacks < MAX_NACKS:
            self.nack_s = now_s + REORDER_S
        if self.end is None or not self.is_whole or self.is_corrupt or not self.end.checksum:
            return False
        found = checksum(self.phones[index] for index in range(self.end.phone_count))
        self.is_corrupt = found != self.end.checksum
        return self.is_corrupt

    def _revise(self, revision: int) -> None:
        self.revision = revision
        self.phones, self.next_index, self.end = {}, 0, None
        self.is_corrupt = False
        self.nack_s, self.nacks = inf, 0


_RECEIVED = WirePhone("", 0, 0)


def gaps(known: Iterable[int], first: int, stop: int | None) -> list[tuple[int, int]]:
    """Return what is missing in ``known`` from ``first`` on, as (first index, index after the last)."""
    stops = sorted(index for index in known if index >= first and (stop is None or index < stop))
    if stop is not None:
        stops.append(stop)
    starts = [first, *(index + 1 for index in stops)]
    return [(start, end) for start, end in zip(starts, stops, strict=False) if start < end]
