"""The send window of one utterance, and cancels that wait for their answers.

Theory of operation
-------------------
Selective repeat (ARQ): each phone has its own timer. It runs out after the recent answer time plus :data:`MARGIN_S`,
longer by the factor :data:`BACKOFF` each time, until the phone is too late to be shown. All phones below
:attr:`SendWindow.next_index` are acknowledged, and those of :attr:`SendWindow.acknowledged` beyond it.
"""

import heapq
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.speech.phone_track import Phone
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.schema import Ack, WirePhone

CHUNK = 8
"""Number of new phones in one datagram."""
PACE_S = 0.01
"""Time between the datagrams of an utterance whose phones are all known: far faster than speech, without bursts."""
SOUND_PACE = 4.0
"""Speed at which audio is sent that is all known, relative to real time."""
SOUND_AGAIN_S = 0.03
"""Time after which a piece of audio is sent again over UDP, against single losses and most short bursts of them."""
END_REPEATS_S = (0.0, 0.02, 0.06)
DEADLINE_S = 0.3
"""Time after its end from which a phone is too late."""
MIN_REPEAT_S, MAX_REPEAT_S = 0.06, 0.25
"""Bounds of the timer of a phone. It is longer for an engine that takes longer to answer, so as not to add to its
load."""
MARGIN_S = 0.015
"""Time that a phone's timer adds to the answer time."""
BUSY = 3.0
"""Largest timer, relative to the first."""
BACKOFF = 1.5
MAX_TRIES = 60
CANCEL_TRIES = 12
FORGOTTEN_S = 60.0
"""Time without news after which an utterance is forgotten."""


@dataclass(slots=True)
class _Sent:
    first_s: float
    at_s: float
    """Time at which the phone was sent last."""
    tries: int = 1


@dataclass(slots=True)
class SendWindow:
    """Phones of one utterance, and which of them have arrived. Times are of the sender's clock.

    Stateful.
    """

    number: int
    anchor: schema.WireAnchor
    anchor_s: float
    """Start of the utterance's time, for ``"at"``."""
    created_s: float
    phones: list[WirePhone] = field(default_factory=list)
    revision: int = 0
    zero_s: float | None = None
    """Start of the utterance, once it is known."""
    duration_us: int = -1
    is_ended: bool = False
    is_announced: bool = False
    """True if its begin was sent before its first phones."""
    is_begun: bool = False
    """True once the engine has acknowledged it."""
    is_end_known: bool = False
    chunks: list[tuple[int, int]] = field(default_factory=list)
    """Runs of phones that were new in one datagram: first index, index after the last."""
    next_s: float = -inf
    """Earliest time of the next chunk."""
    sequence: int = 0
    end_sent: int = 0
    end_s: float = inf
    """Time at which the end is sent again."""
    next_index: int = 0
    """Index below which all phones are acknowledged."""
    acknowledged: set[int] = field(default_factory=set)
    """Acknowledged indices beyond it."""
    active_s: float = -inf
    """Time of the last acknowledgement."""
    is_corrected: bool = False
    sounds: list[tuple[float, int, schema.Sound]] = field(default_factory=list)
    """Pieces of audio that are still to be sent, as a heap: time, sample, message."""
    samples: int = 0
    """Number of audio samples so far."""
    rate_hz: int = 0
    """Sample rate of its audio; 0 if phones are sent."""
    sound_s: float = -inf
    """Time at which the next piece of audio may be sent."""
    _sent: dict[int, _Sent] = field(default_factory=dict)

    @property
    def stop_sent(self) -> int:
        """Index after the last phone that was sent."""
        return self.chunks[-1][1] if self.chunks else 0

    @property
    def is_acknowledged(self) -> bool:
        """Whether all phones so far are known to have arrived."""
        return self.is_begun and self.next_index >= len(self.phones) and not self.sounds

    def next_chunk(self, now_s: float) -> tuple[int, int] | None:
        """Start the next chunk of new phones, if it is time."""
        first = self.stop_sent
        if first >= len(self.phones) or now_s < self.next_s:
            return None
        chunk = (first, min(first + CHUNK, len(self.phones)))
        self.chunks.append(chunk)
        self.next_s = now_s + PACE_S
        return chunk

    def add_sound(self, session: str, samples: NDArray[np.int16], rate_hz: int, now_s: float, again_s: float) -> None:
        """Queue audio, (N,) int16, in pieces, each again after ``again_s`` if that is not infinite."""
        self.rate_hz = rate_hz
        for start in range(0, len(samples), schema.MAX_SAMPLES):
            piece = samples[start : start + schema.MAX_SAMPLES].astype("<i2").tobytes()
            message = schema.Sound(session, self.number, self.samples, rate_hz, piece)
            at_s = max(now_s, self.sound_s)
            for due_s in (at_s, at_s + again_s):
                if due_s < inf:
                    heapq.heappush(self.sounds, (due_s, self.samples, message))
            self.samples += len(piece) // 2
            self.sound_s = at_s + len(piece) / 2 / rate_hz / SOUND_PACE

    def note_sent(self, first: int, stop: int, now_s: float) -> None:
        """Note that phones were sent."""
        for index in range(first, stop):
            before = self._sent.get(index)
            if before is None:
                self._sent[index] = _Sent(now_s, now_s)
            else:
                before.at_s, before.tries = now_s, before.tries + 1

    def overdue(self, now_s: float, answer_s: float) -> list[tuple[int, int]]:
        """Return runs of phones that should have been acknowledged by now."""
        return schema.runs(index for index in self._outstanding(now_s) if now_s >= self._timeout_s(index, answer_s))

    def next_timeout_s(self, now_s: float, answer_s: float) -> float:
        """Time at which the next phone is overdue."""
        return min((self._timeout_s(index, answer_s) for index in self._outstanding(now_s)), default=inf)

    def requested(self, first: int, stop: int, now_s: float, rtt_s: float) -> tuple[int, int] | None:
        """Clip a request to phones that were sent; None if all of them were sent only just now."""
        stop = min(stop, self.stop_sent)
        if first >= stop or all(now_s - self._sent[index].at_s < rtt_s for index in range(first, stop)):
            return None
        return first, stop

    def acknowledge(self, ack: Ack, now_s: float) -> float | None:
        """Note what has arrived; return the answer time of the latest phone, if it is news."""
        if ack.revision != self.revision:
            return None
        self.is_begun, self.active_s = True, now_s
        before = self.next_index
        self.next_index = max(self.next_index, ack.next_index)
        bits = ack.bitmap64 & (2**64 - 1)
        self.acknowledged.update(ack.next_index + 1 + n for n in range(64) if bits >> n & 1)
        self.acknowledged = {index for index in self.acknowledged if index > self.next_index}
        if ack.is_ended and self.is_ended:
            self.is_end_known, self.end_s = True, inf
        newest = self._sent.get(self.next_index - 1) if self.next_index > before else None
        return None if newest is None else now_s - newest.first_s

    def note_end_sent(self, now_s: float, repeats: bool, answer_s: float) -> None:
        """Note that the end was sent, and when to send it again."""
        self.end_sent += 1
        if self.end_sent < len(END_REPEATS_S) and repeats:
            self.end_s = now_s + _repeat_s(self.end_sent)
        elif self.end_sent < MAX_TRIES and not self.is_end_known:
            self.end_s = now_s + _wait_s(self.end_sent, answer_s)
        else:
            self.end_s = inf

    def restart(self, now_s: float) -> None:
        """Send everything again, with the original times."""
        self.created_s = now_s
        if self.zero_s is not None:
            self.anchor, self.anchor_s = "at", self.zero_s
        self.is_begun = self.is_end_known = False
        self.chunks, self.acknowledged, self._sent = [], set(), {}
        self.next_index, self.end_sent = 0, 0
        self.next_s = -inf
        self.end_s = -inf if self.is_ended else inf

    def is_past(self, now_s: float) -> bool:
        """Whether it is over by its own times, or nothing was heard of it for too long."""
        if not self.is_ended:
            return False
        if self.zero_s is None:
            return now_s - max(self.active_s, self.created_s) > FORGOTTEN_S
        length_s = max([self.duration_us, *(phone.start_us + phone.duration_us for phone in self.phones)]) / 1e6
        return now_s > self.zero_s + length_s + 2.0

    def _outstanding(self, now_s: float) -> list[int]:
        """Return the indices of phones that were sent, are not acknowledged and not too late."""
        waiting = []
        for index in range(self.next_index, self.stop_sent):
            if index in self.acknowledged or self._sent[index].tries > MAX_TRIES:
                continue
            phone = self.phones[index]
            end_s = (phone.start_us + phone.duration_us) / 1e6 + DEADLINE_S
            if self.zero_s is None or now_s <= self.zero_s + end_s:
                waiting.append(index)
        return waiting

    def _timeout_s(self, index: int, answer_s: float) -> float:
        sent = self._sent[index]
        return sent.at_s + _wait_s(sent.tries, answer_s)


def _wait_s(tries: int, answer_s: float) -> float:
    first_s = max(answer_s + MARGIN_S, MIN_REPEAT_S)
    return min(first_s * BACKOFF ** min(tries - 1, 20), max(MAX_REPEAT_S, BUSY * first_s))


def _repeat_s(tries: int) -> float:
    """Time from one of the first tries of a message to the next."""
    return END_REPEATS_S[tries] - END_REPEATS_S[tries - 1]


@dataclass(slots=True)
class PendingCancel:
    """A cancel, until it is answered.

    Stateful.
    """

    message: schema.CancelUtterance
    next_s: float
    tries: int = 0

    def note_sent(self, now_s: float, *, asks: bool, reliable: bool) -> None:
        """Note that it was sent, and when to send it again."""
        self.tries += 1
        if reliable or (self.tries >= len(END_REPEATS_S) and not asks) or self.tries >= CANCEL_TRIES:
            self.next_s = inf
        else:
            self.next_s = now_s + (_repeat_s(self.tries) if self.tries < len(END_REPEATS_S) else MAX_REPEAT_S)

    def is_answered_by(self, notice: schema.Notice) -> bool:
        """Whether a notice answers this cancel."""
        is_all = self.message.utterance == schema.NOW
        return notice.utterance == self.message.utterance and (not is_all or notice.count == self.message.number)


def to_wire(phone: Phone | schema.WirePhone) -> schema.WirePhone:
    """Convert a phone to its form on the wire, and check it.

    Raises UsageError if it is later than half an hour, or its label is too long.
    """
    if isinstance(phone, Phone):
        start_us, end_us = round(phone.start_s * 1e6), round(phone.end_s * 1e6)
        flags = {1: schema.PRIMARY_STRESS, 2: schema.SECONDARY_STRESS}.get(phone.stress, 0)
        phone = schema.WirePhone(phone.label, start_us, end_us - start_us, flags)
    if not (0 <= phone.start_us <= schema.MAX_DURATION_US and 0 <= phone.duration_us <= schema.MAX_DURATION_US):
        raise UsageError(f"phone {phone.label!r:.30}: got {phone.start_us} us, expected 0 to {schema.MAX_DURATION_US}")
    if len(phone.label.encode()) > schema.LABEL_BYTES or not isfinite(phone.weight):
        raise UsageError(f"phone: got {phone.label!r:.40}, expected at most {schema.LABEL_BYTES} bytes")
    return phone
