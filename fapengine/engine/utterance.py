"""One utterance: its phones by index, in any order of arrival, its place in stream time, and its state.

Every change of state goes through :meth:`Utterance.step`. A step that is not in :data:`TRANSITIONS` is a bug of the
engine: the session that meets it ends as a :class:`.engine.Fault`.

::

    new ──begin──> waiting ──place──> placed ──start──> speaking
     └────────────place──────────────────┘ │ ^            │ ^
                                     pause v │ place pause v │ place
                                           held          paused

    any of them ──close──> over
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import pairwise
from math import inf
from types import MappingProxyType

from fapengine.engine.commands import Anchor, Append, Begin
from fapengine.speech.phone_track import Phone


class UtteranceState(Enum):
    """State of an utterance."""

    NEW = "new"
    """Phones or an end have come, but no ``Begin``."""
    WAITING = "waiting"
    """Begun; its place in the session's time is not known yet."""
    PLACED = "placed"
    """Its place is known; its time has not been reached."""
    SPEAKING = "speaking"
    """Its time has been reached. Stays so when phones are missing."""
    HELD = "held"
    """Paused before it started."""
    PAUSED = "paused"
    """Paused after it started."""
    OVER = "over"
    """Finished, cancelled or given up."""

    @property
    def is_placed(self) -> bool:
        """Whether it has a place in the session's time."""
        return self in (UtteranceState.PLACED, UtteranceState.SPEAKING)

    @property
    def has_started(self) -> bool:
        """Whether a part of it has been shown."""
        return self in (UtteranceState.SPEAKING, UtteranceState.PAUSED)

    @property
    def is_stopped(self) -> bool:
        """Whether it keeps a position from which it will resume."""
        return self in (UtteranceState.HELD, UtteranceState.PAUSED)


class Step(Enum):
    """A step that changes the state of an utterance."""

    BEGIN = "begin"
    PLACE = "place"
    """Give it a place in the session's time, or another one."""
    UNPLACE = "unplace"
    """Take its place away: what came before it has changed."""
    START = "start"
    PAUSE = "pause"
    CLOSE = "close"


_S = UtteranceState
TRANSITIONS = MappingProxyType(
    {
        _S.NEW: {Step.BEGIN: _S.WAITING, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.WAITING: {Step.BEGIN: _S.WAITING, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.PLACED: {
            Step.BEGIN: _S.PLACED,  # its sound came before its Begin
            Step.PLACE: _S.PLACED,
            Step.UNPLACE: _S.WAITING,
            Step.START: _S.SPEAKING,
            Step.PAUSE: _S.HELD,
            Step.CLOSE: _S.OVER,
        },
        _S.SPEAKING: {Step.BEGIN: _S.SPEAKING, Step.PLACE: _S.SPEAKING, Step.PAUSE: _S.PAUSED, Step.CLOSE: _S.OVER},
        _S.HELD: {Step.BEGIN: _S.HELD, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.PAUSED: {Step.BEGIN: _S.PAUSED, Step.PLACE: _S.SPEAKING, Step.CLOSE: _S.OVER},
        _S.OVER: {},
    }
)
"""The state after each step, by the state before it."""


@dataclass(slots=True)
class StreamClock:
    """A session's clock, which follows the audio of its utterances.

    Stateful.
    """

    begins_s: float
    """Engine time at stream time 0."""

    def stream_s(self, now_s: float) -> float:
        """Convert engine time to stream time."""
        return now_s - self.begins_s


@dataclass(slots=True)
class Utterance:
    """An utterance, as far as it has arrived. Its time 0 is the start of its audio.

    Stateful.
    """

    number: int
    clock: StreamClock
    state: UtteranceState = UtteranceState.NEW
    """Changed by :meth:`step` alone."""
    anchor: Anchor | None = None
    """How its beginning is set; None before its ``Begin``."""
    at_s: float = 0.0
    """Stream time of its start, for ``"at"``."""
    revision: int = 0
    phones: dict[int, Phone] = field(default_factory=dict)
    phone_count: int | None = None
    """Number of its phones; None before its ``End``."""
    duration_s: float | None = None
    zero_s: float | None = None
    """Stream time of its start, while it has a place."""
    next_index: int = 0
    """All phones below this index have arrived."""
    latest_s: float = -inf
    """Engine time of the last message about it."""
    is_dry: bool = False
    """Whether its last phone is over and more should come."""
    resume_s: float | None = None
    """Position in its own time, while it is stopped."""
    concealed: set[int] = field(default_factory=set)
    """Indices of phones that were bridged."""
    last_s: float = 0.0
    """End of its last phone."""
    _newest_s: float = inf
    """Start of the phones that arrived last."""

    def step(self, step: Step) -> None:
        """Go to the next state.

        Raises
        ------
        RuntimeError
            If the step is impossible in this state.
        """
        following = TRANSITIONS[self.state].get(step)
        if following is None:
            raise RuntimeError(f"utterance: cannot {step.value} while {self.state.value}")
        self.state = following

    def begin(self, command: Begin) -> None:
        """Set how its start is found."""
        self.step(Step.BEGIN)
        self.anchor, self.at_s = command.anchor, self.clock.stream_s(command.at_s)
        self.revision = max(self.revision, command.revision)

    def place(self, zero_s: float) -> None:
        """Give it a place: stream time of its start."""
        self.step(Step.PLACE)
        self.zero_s, self.resume_s = zero_s, None

    def unplace(self) -> None:
        """Take its place away."""
        self.step(Step.UNPLACE)
        self.zero_s = None

    def pause(self, now_s: float) -> None:
        """Take its place and keep its position."""
        self.resume_s = self.position_s(now_s)
        self.step(Step.PAUSE)
        self.zero_s = None

    @property
    def end_s(self) -> float:
        """End of the utterance if no more phones come."""
        return max(self.duration_s or 0.0, self.last_s)

    def position_s(self, now_s: float) -> float:
        """Return its own time; minus infinity while it has no place."""
        return -inf if self.zero_s is None else self.clock.stream_s(now_s) - self.zero_s

    def slack_s(self, now_s: float) -> float:
        """Time by which the latest phones arrived early; negative if late."""
        return self._newest_s - self.position_s(now_s)

    def missing(self) -> list[tuple[int, int]]:
        """Gaps as (first index, index after the last), with the tail once the end is known."""
        return gaps(self.phones, self.next_index, self.phone_count)

    def add(self, command: Append) -> list[Phone]:
        """Add phones; return those that are new."""
        new = []
        for index, phone in enumerate(command.phones, command.first_index):
            if index not in self.phones and (self.phone_count is None or index < self.phone_count):
                self.phones[index] = phone
                self.last_s = max(self.last_s, phone.end_s)
                new.append(phone)
        while self.next_index in self.phones:
            self.next_index += 1
        if new:
            self._newest_s = min(phone.start_s for phone in new)
        return new

    def revise(self, revision: int, from_s: float) -> None:
        """Drop its end and the phones that start at or after ``from_s``; new ones will come."""
        self.revision = revision
        self.phones = {index: phone for index, phone in self.phones.items() if phone.start_s < from_s}
        self.last_s = max((phone.end_s for phone in self.phones.values()), default=0.0)
        self.phone_count = self.duration_s = None
        self.is_dry = False
        self.next_index = 0
        while self.next_index in self.phones:
            self.next_index += 1
        last = max(self.phones, default=0)
        self.concealed = {index for index in self.concealed if index < last}

    def gap(self) -> tuple[Phone, Phone, range] | None:
        """First gap that is not bridged: the phones on both sides, and the indices between them."""
        indices = sorted(self.phones)
        for before, after in pairwise(indices):
            if after > before + 1 and not self.concealed.issuperset(range(before + 1, after)):
                return self.phones[before], self.phones[after], range(before + 1, after)
        return None

    def in_stream(self, phones: Iterable[Phone], from_s: float) -> list[Phone]:
        """Shift phones into stream time; drop what is before ``from_s`` there."""
        if self.zero_s is None:
            return []
        shifted = []
        for phone in phones:
            start_s, end_s = max(phone.start_s + self.zero_s, from_s, 0.0), phone.end_s + self.zero_s
            if end_s > start_s:
                shifted.append(replace(phone, start_s=start_s, end_s=end_s))
        return shifted


def gaps(known: Iterable[int], first: int, stop: int | None) -> list[tuple[int, int]]:
    """Return what is missing in ``known`` from ``first`` on, as (first index, index after the last)."""
    stops = sorted(index for index in known if index >= first and (stop is None or index < stop))
    if stop is not None:
        stops.append(stop)
    starts = [first, *(index + 1 for index in stops)]
    return [(start, end) for start, end in zip(starts, stops, strict=False) if start < end]
