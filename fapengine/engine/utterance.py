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

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
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
    """Set its place in the session's time."""
    UNPLACE = "unplace"
    """Remove its place: what came before it has changed."""
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
    revised: int = 0
    """Index below which phones may replace others that were shown (:attr:`.commands.Append.keeps_earlier`): these are
    not counted as late."""
    phones: dict[int, Phone] = field(default_factory=dict)
    order: list[int] = field(default_factory=list)
    """Their indices, rising. That of a later index is said later."""
    taken: int = 0
    """Number of these that have been sent to the planner."""
    known: list[int] = field(default_factory=list)
    """Indices of phones that have arrived or were bridged, rising; first and last are those of phones."""
    from_s: float = 0.0
    """Stream time from which it is spoken; what was to be said before is left out."""
    phone_count: int | None = None
    """Number of its phones; None before its ``End``."""
    duration_s: float | None = None
    zero_s: float | None = None
    """Stream time of its start, while it has a place."""
    latest_s: float = -inf
    """Engine time of the last message about it."""
    is_dry: bool = False
    """Whether its last phone is over and more should come."""
    resume_s: float | None = None
    """Position in its own time, while it is stopped."""
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

    def place(self, zero_s: float, from_s: float = 0.0) -> None:
        """Set its place: stream time of its start, and stream time from which it is spoken."""
        self.step(Step.PLACE)
        self.zero_s, self.resume_s = zero_s, None
        self.take_again(from_s)

    def unplace(self) -> None:
        """Remove its place."""
        self.step(Step.UNPLACE)
        self.zero_s = None

    def pause(self, now_s: float) -> None:
        """Remove its place, but keep its position."""
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

    @property
    def size(self) -> int:
        """One more than the highest index that has arrived."""
        return self.order[-1] + 1 if self.order else 0

    @property
    def lost(self) -> int:
        """Number of phones that have neither arrived nor been bridged, once the end is known."""
        return 0 if self.phone_count is None else self.phone_count - bisect_left(self.known, self.phone_count)

    def add(self, command: Append) -> list[Phone]:
        """Add phones; return those that come before one that was taken."""
        late, newest_s = [], inf
        for index, phone in enumerate(command.phones, command.first_index):
            if index in self.phones or (self.phone_count is not None and index >= self.phone_count):
                continue
            self.phones[index] = phone
            self.last_s = max(self.last_s, phone.end_s)
            newest_s, self.is_dry = min(newest_s, phone.start_s), False
            place = bisect_left(self.order, index)
            self.order.insert(place, index)
            if place < self.taken:
                self.taken += 1
                late.append(phone)
            place = bisect_left(self.known, index)
            if self.known[place : place + 1] != [index]:
                self.known.insert(place, index)
        if newest_s < inf:
            self._newest_s = newest_s
        return late

    def revise(self, command: Begin | Append, from_s: float) -> float:
        """Drop its end and the phones that a command of a higher revision replaces.

        These are those that start at or after ``from_s``, or those from the command's first on
        (:attr:`.commands.Append.keeps_earlier`); but the first of them stay if the command has them unchanged.

        Returns
        -------
        float
            Start of the first phone that is dropped; infinity if none is.
        """
        order, phones = self.order, self.phones
        new = dict(enumerate(command.phones, command.first_index)) if isinstance(command, Append) else {}
        if isinstance(command, Append) and command.keeps_earlier:
            place = bisect_left(order, command.first_index)
            self.revised = max(self.revised, self.size)
        else:
            place = bisect_left(order, from_s, key=lambda index: phones[index].start_s)
        while place < len(order) and new.get(order[place]) == phones[order[place]]:
            place += 1
        dropped_s = phones[order[place]].start_s if place < len(order) else inf
        self.revision, self.is_dry = command.revision, False
        self.phone_count = self.duration_s = None
        for index in order[place:]:
            del phones[index]
        del order[place:]
        del self.known[bisect_left(self.known, self.size) :]
        self.taken = min(self.taken, place)
        self.last_s = phones[order[-1]].end_s if order else 0.0
        return dropped_s

    def gap(self) -> tuple[Phone, Phone, range] | None:
        """First gap that is not bridged: the phones on both sides, and the indices between them."""
        known, order = self.known, self.order
        if not known or known[-1] - known[0] == len(known) - 1:
            return None
        behind = bisect_right(range(len(known)), known[0], key=lambda place: known[place] - place)
        # beside it there may be others than phones, after a revision
        place = bisect_left(order, known[behind])
        before, after = order[place - 1], order[place]
        return self.phones[before], self.phones[after], range(before + 1, after)

    def bridge(self, gap: range) -> None:
        """Close a gap."""
        first, stop = bisect_left(self.known, gap.start), bisect_left(self.known, gap.stop)
        self.known[first:stop] = gap

    def take_again(self, from_s: float) -> None:
        """Allow phones that end after ``from_s``, in stream time, to be sent again."""
        self.from_s, since_s = from_s, from_s - (self.zero_s or 0.0)
        self.taken = bisect_right(self.order, since_s, key=lambda index: self.phones[index].end_s)

    def coming(self) -> Iterator[tuple[Phone, "Utterance", int]]:
        """Phones that were not taken, in stream time, and the value of ``taken`` after each."""
        for place in range(self.taken, len(self.order)):
            left = self.in_stream([self.phones[self.order[place]]], self.from_s)
            if left:
                yield left[0], self, place + 1
            elif place == self.taken:
                self.taken += 1  # it ends before the position from which the utterance is spoken

    def in_stream(self, phones: Iterable[Phone], from_s: float = 0.0) -> list[Phone]:
        """Shift phones into stream time; drop what is before ``from_s`` there."""
        if self.zero_s is None:
            return []
        shifted = []
        for phone in phones:
            start_s, end_s = max(phone.start_s + self.zero_s, from_s, 0.0), phone.end_s + self.zero_s
            if end_s > start_s:
                shifted.append(replace(phone, start_s=start_s, end_s=end_s))
        return shifted
