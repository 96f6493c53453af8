"""One session: a queue of utterances on one stream of phones.

Theory of operation
-------------------
A session has its own clock, *stream time*. It runs with engine time; only :class:`.commands.Audio` speeds it up or
slows it down, by at most :data:`SLEW`. Each utterance gets a place in stream time, its *zero*. From then on its phones
go to the session's planner. Pausing, seeking and audio that jumps take the phones back, fade the face to neutral and
give the utterance another zero. :data:`.utterance.TRANSITIONS` lists the states of an utterance.

Phones are sent to the planner a few at a time (:data:`TAKEN_LETTERS`), so that no frame takes long, however many wait.

Nothing runs per frame: a session says when it must be woken (:attr:`Session.wake_s`), and every command wakes it.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import accumulate, groupby
from math import inf, nextafter
from operator import itemgetter
from typing import Any, Literal

from fapengine._counters import Counts
from fapengine.engine.commands import Append, Audio, Begin, Cancel, Command, End, Pause, Resume, Seek, SetParameter
from fapengine.engine.gestures import BatchGestures
from fapengine.engine.utterance import Step, StreamClock, Utterance
from fapengine.errors import UsageError
from fapengine.speaking import GENERATORS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.speech.plausible import remarks_on
from fapengine.trajectory.batch import BatchPlanner
from fapengine.trajectory.stream import AHEAD_PHONES, SAME_S
from fapengine.trajectory.style import Style

EventKind = Literal["started", "underrun", "late", "concealed", "finished", "cancelled", "error", "remark"]
State = Literal["idle", "waiting", "speaking", "paused"]

SLEW = 0.02
"""Largest relative change of speed of stream time."""
JUMP_S = 0.08
"""Audio offset above which the face jumps instead of slewing."""
JUMP_FADE_S = 0.15
TAKEN_LETTERS = 64
"""Characters of the labels of phones that are planned at a time: some 5 s of speech, planned in 1 ms."""
TAKEN_S = 5.0
"""Phones are taken this early; the first few that the planner looks ahead to, however early."""
GATHER_S, URGENT_S = 0.05, 0.3
"""A clause arrives in several datagrams. Its first phones wait this long for the others, unless they are due within the
second time."""
CONCEAL_S = 0.06
"""A gap of missing phones is concealed this long before it would be shown."""
REMARKED = 64
"""Phones of an utterance that are held against what is plausible."""
REMEMBERED = 64
"""Number of finished utterances whose repeated messages are still recognized."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of an engine and of each session."""

    sessions: int = 1000
    name_bytes: int | None = 32
    """Length of a session's name in UTF-8, which every wire can send; None: any name."""
    utterances: int = 32
    """Unfinished utterances per session."""
    phones: int = 20_000
    """Phones of all unfinished utterances of a session, half an hour of speech."""
    queued_s: float = 600.0
    """Longest utterance, and how far ahead one may be scheduled."""
    silence_s: float = 2.0
    """An utterance without an ``End`` finishes when no phone has come for this long."""
    wait_s: float = 30.0
    """An utterance that waits for its audio is given up after this long."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event in the life of an utterance."""

    session: str
    utterance: int
    kind: EventKind
    time_s: float
    """Engine time."""
    count: int = 1
    """Number of phones, for events about phones."""
    position_s: float = 0.0
    """Position in the utterance's own time; 0 before it has a place."""
    reason: str = ""
    """What looks wrong, for a remark."""


@dataclass(slots=True)
class Counters(Counts):
    """Counters of one session.

    Stateful.
    """

    METRIC = "speech", "What sessions have met with, by kind."

    utterances: int = 0
    finished: int = 0
    unended: int = 0
    """Utterances that finished without an ``End``."""
    cancelled: int = 0
    """Utterances that were stopped."""
    late: int = 0
    """Phones that came after their start had been shown."""
    dropped: int = 0
    """Phones that came after their end."""
    concealed: int = 0
    """Missing phones that were bridged by the phone before them."""
    lost: int = 0
    """Phones that had not come when their utterance finished."""
    revised: int = 0
    """Phones that later ones replaced or shortened."""
    unknown: int = 0
    """Phones whose label is not IPA."""
    underruns: int = 0
    """Times that speech stopped because phones were missing."""
    jumps: int = 0
    """Jumps of the face to the position of its audio."""
    ignored: int = 0
    """Commands without effect: for finished utterances, or of a lower revision."""
    refused: int = 0
    """Commands beyond a limit."""


@dataclass(slots=True, eq=False)
class Session:
    """One session of an engine; see the theory of operation.

    Stateful.
    """

    name: str
    number: int
    """Number in the batch."""
    batch: BatchPlanner
    gestures: BatchGestures
    limits: Limits
    style: Style
    clock: StreamClock
    emit: Callable[[Event], None]
    counters: Counters = field(default_factory=Counters)
    queue: list[Utterance] = field(default_factory=list)
    over: dict[int, int] = field(default_factory=dict)
    """Revision of each utterance that is over."""
    is_paused: bool = False
    wake_s: float = -inf
    """Engine time at which :meth:`advance` must be called."""
    slew_left_s: float = 0.0
    """Remaining offset between audio and face; positive if the face is late."""
    cancels: list[tuple[float, Cancel]] = field(default_factory=list)
    fresh: list[tuple[int | None, Phone]] = field(default_factory=list)
    """Phones for the planner, at the next frame, with their utterances; None for those that the session made up, which
    are not counted as late."""
    fresh_since_s: float = -inf
    """Engine time at which the first of them arrived."""

    @property
    def state(self) -> State:
        """Current state."""
        if self.is_paused:
            return "paused"
        if any(utterance.state.has_started for utterance in self.queue):
            return "speaking"
        return "waiting" if self.queue else "idle"

    def find(self, number: int) -> Utterance | None:
        """Find an unfinished utterance."""
        return next((utterance for utterance in self.queue if utterance.number == number), None)

    # Commands -------------------------------------------------------------------------------------------------------

    def begin(self, command: Begin, now_s: float) -> None:
        """Open an utterance."""
        if command.anchor == "at" and command.at_s > now_s + self.limits.queued_s:  # all later ones would wait for it
            raise UsageError(
                f"utterance: begins in {command.at_s - now_s:g} s, expected {self.limits.queued_s:g} at most"
            )
        utterance = self._open(command.utterance, command.revision, now_s)
        if utterance is None:
            return
        if utterance.anchor is None:
            utterance.begin(command)
        elif command.revision > utterance.revision:
            self._revise(utterance, command, now_s)
        self._settle(now_s)

    def append(self, command: Append, now_s: float) -> None:
        """Add phones to an utterance."""
        if not command.phones or command.first_index < 0:
            raise UsageError("phones: must not be empty, with an index of 0 or more")
        end_s = max(phone.end_s for phone in command.phones)
        if end_s > self.limits.queued_s:
            raise UsageError(f"phones: end at {end_s:g} s, expected {self.limits.queued_s:g} s at most")
        others = sum(utterance.size for utterance in self.queue if utterance.number != command.utterance)
        if others + command.first_index + len(command.phones) > self.limits.phones:
            raise UsageError(f"phones: got more than the {self.limits.phones} that may wait in a session")
        utterance = self._open(command.utterance, command.revision, now_s)
        if utterance is None:
            return
        if command.revision < utterance.revision:
            self.counters.ignored += 1
            return
        if command.revision > utterance.revision:
            self._revise(utterance, command, now_s)
        utterance.latest_s = now_s
        self._prepare(utterance.number, utterance.in_stream(utterance.add(command)), now_s)
        self._take(now_s)

    def end(self, command: End, now_s: float) -> None:
        """Set the length of an utterance."""
        utterance = self._open(command.utterance, command.revision, now_s)
        if utterance is None or command.revision != utterance.revision or utterance.phone_count is not None:
            return
        if command.phone_count > self.limits.phones or not 0 <= command.duration_s <= self.limits.queued_s:
            raise UsageError(f"end: got {command.phone_count} phones in {command.duration_s:g} s, more than may wait")
        utterance.latest_s = now_s
        utterance.phone_count, utterance.duration_s = command.phone_count, command.duration_s
        self._settle(now_s)

    def cancel(self, command: Cancel, now_s: float) -> None:
        """Stop utterances, now or at a time."""
        if command.at_s is not None and command.at_s > now_s:
            if len(self.cancels) == self.limits.utterances:
                raise UsageError(f"cancel: got one more than the {self.limits.utterances} that may wait")
            if (command.at_s, command) not in self.cancels:
                self.cancels.append((command.at_s, command))
            return
        stopped = [utterance for utterance in self.queue if command.means(utterance.number)]
        was_speaking = any(utterance.state.is_placed for utterance in stopped)
        if was_speaking:
            self._silence(now_s, command.fade_s)
        for utterance in stopped:
            self.counters.cancelled += 1
            self._close(utterance, "cancelled", now_s)
        if not self.queue:
            self.is_paused = False
        if was_speaking:
            self._replace_rest(now_s, self.clock.stream_s(now_s) + command.fade_s)

    def pause(self, command: Pause, now_s: float) -> None:
        """Pause at the current position."""
        if self.is_paused or not self.queue:
            return
        if any(utterance.state.is_placed for utterance in self.queue):
            self._silence(now_s, command.fade_s)
        self.is_paused = True
        for utterance in self.queue:
            if utterance.state.is_placed:
                utterance.pause(now_s)

    def resume(self, _: Resume, now_s: float) -> None:
        """Continue from the paused position."""
        if not self.is_paused:
            return
        self.is_paused = False
        for utterance in self.queue:
            utterance.latest_s = now_s
            if utterance.resume_s is not None:
                self._put(utterance, self.clock.stream_s(now_s) - utterance.resume_s, now_s)
        self._settle(now_s)

    def seek(self, command: Seek, now_s: float) -> None:
        """Continue from another position."""
        utterance = self.find(command.utterance)
        if utterance is None or not (utterance.state.has_started or utterance.state.is_stopped):
            self.counters.ignored += 1
        elif utterance.state.is_stopped:
            utterance.resume_s = command.position_s
        else:
            self._jump(utterance, command.position_s, now_s)

    def audio(self, command: Audio, now_s: float) -> None:
        """Follow the position of the audio."""
        utterance = self.find(command.utterance)
        if utterance is None:
            self.counters.ignored += 1
            return
        utterance.latest_s = now_s
        heard_s = command.position_s + command.rate * (now_s - command.at_s)
        if command.rate == 0:
            if utterance.state.is_placed:
                self.pause(Pause(), now_s)
                utterance.resume_s = heard_s
        elif not utterance.state.is_placed:
            if not utterance.state.is_stopped:  # another sound than the one that paused: all continue
                self.resume(Resume(), now_s)
            self.is_paused = False
            self._put(utterance, self.clock.stream_s(now_s) - heard_s, now_s)
            self._settle(now_s)
        else:
            error_s = heard_s - utterance.position_s(now_s)
            if abs(error_s) > JUMP_S:
                self.counters.jumps += 1
                self._jump(utterance, heard_s, now_s)
            else:
                self.slew_left_s = error_s

    def set_parameter(self, command: SetParameter, now_s: float) -> None:
        """Change the style."""
        changes: dict[str, Any] = {
            command.parameter: bool(command.value) if command.parameter in GENERATORS else command.value
        }
        self.style = replace(self.style, **changes)
        self.gestures.behave(self._row, self.style, now_s)

    def gesture(self, command: Command, now_s: float) -> None:
        """Make a gesture, or show an expression."""
        self.gestures.make(self._row, command, now_s)

    # Time -----------------------------------------------------------------------------------------------------------

    def advance(self, now_s: float) -> None:
        """Do what is due, and set the next wake-up time."""
        for at_s, command in [due for due in self.cancels if due[0] <= now_s]:
            self.cancels.remove((at_s, command))
            self.cancel(command, now_s)
        for place, utterance in enumerate(list(self.queue)):
            if utterance.state.is_placed:
                self._advance(utterance, now_s)
            elif place or self.is_paused:
                utterance.latest_s = now_s  # it waits for the others
            elif now_s >= utterance.latest_s + self.limits.wait_s:
                self._give_up(utterance, now_s)
        self._settle(now_s)
        self.wake_s = min((at_s for at_s, _ in self.cancels), default=inf)
        for utterance in self.queue:
            self.wake_s = min(self.wake_s, self._due_s(utterance, now_s))

    def slew(self, elapsed_s: float) -> None:
        """Move stream time a little towards the audio."""
        most_s = SLEW * elapsed_s
        step_s = min(max(self.slew_left_s, -most_s), most_s)
        self.slew_left_s -= step_s
        self.clock.begins_s -= step_s
        self.batch.retime(self.number, self.clock.begins_s)

    def flush(self, now_s: float) -> None:
        """Send the first of the phones that were taken to the planner, and report those that came late."""
        self._take(now_s)
        letters = accumulate(map(len, [phone.label for _, phone in self.fresh]))
        count = bisect_right(list(letters), TAKEN_LETTERS) or 1
        late: Counter[int | None] = Counter()
        for number, phones in groupby(self.fresh[:count], key=itemgetter(0)):
            late[number] += self.batch.feed(self.number, [phone for _, phone in phones], is_counted=number is not None)
        del self.fresh[:count]
        for utterance in self.queue:
            if late[utterance.number]:
                self._tell(utterance, "late", now_s, late[utterance.number])
        self._take(now_s)
        if self.fresh:
            self.wake_s = -inf

    def plan_by_s(self) -> tuple[float, float]:
        """Engine times by which fresh phones must be planned, and should be; in between more may arrive."""
        planned = self.batch.planned(self.number)
        first_s = min([phone.start_s for _, phone in self.fresh])
        if planned and first_s < planned[-1].end_s - SAME_S:
            return -inf, -inf
        matter_s = max(self.fresh_since_s + GATHER_S, self.batch.sure_s(self.number) + self.clock.begins_s)
        urgent_s = first_s + self.clock.begins_s - URGENT_S
        return urgent_s, min(matter_s, urgent_s)

    def report(self) -> Counters:
        """Return the counters, with those of the planner."""
        counts = self.batch.counts(self.number)
        for name in ("late", "dropped", "revised", "unknown"):
            setattr(self.counters, name, getattr(counts, name))
        return self.counters

    def _advance(self, utterance: Utterance, now_s: float) -> None:
        at_s = utterance.position_s(now_s)
        if at_s >= 0 and not utterance.state.has_started:
            utterance.step(Step.START)
            self._tell(utterance, "started", now_s)
        gap = utterance.gap()
        if gap and gap[0].end_s <= at_s + CONCEAL_S:
            self._conceal(utterance, gap[0], gap[1], gap[2], now_s)
        if utterance.phone_count is not None:
            if at_s >= utterance.end_s:
                self._finish(utterance, now_s)
            return
        if at_s > utterance.last_s and utterance.phones and not utterance.is_dry:
            utterance.is_dry = True
            self.counters.underruns += 1
            self._tell(utterance, "underrun", now_s)
        if at_s > utterance.last_s and now_s >= utterance.latest_s + self.limits.silence_s:
            self._give_up(utterance, now_s)

    def _due_s(self, utterance: Utterance, now_s: float) -> float:
        """Engine time at which :meth:`_advance` must look at an utterance again."""
        if self.is_paused:
            return inf
        if utterance.zero_s is None:
            return utterance.latest_s + self.limits.wait_s
        due_s = 0.0 if not utterance.state.has_started else inf
        gap = utterance.gap()
        if gap:
            due_s = min(due_s, gap[0].end_s - CONCEAL_S)
        if utterance.phone_count is not None:
            due_s = min(due_s, utterance.end_s)
        elif utterance.phones and not utterance.is_dry:
            due_s = min(due_s, utterance.last_s + 1e-6)
        due_s += utterance.zero_s + self.clock.begins_s
        if utterance.phone_count is None:
            silent_s = utterance.latest_s + self.limits.silence_s
            due_s = min(due_s, max(silent_s, utterance.last_s + utterance.zero_s + self.clock.begins_s + 1e-6))
        return max(due_s, nextafter(now_s, inf))

    def _settle(self, now_s: float) -> None:
        """Set the place of each utterance as soon as it is known."""
        if self.is_paused:
            return
        before: Utterance | None = None
        for utterance in self.queue:
            if not utterance.state.is_placed:
                if utterance.anchor == "at":
                    self._put(utterance, utterance.at_s, now_s)
                elif utterance.anchor == "now" and before is None:
                    self._put(utterance, self.clock.stream_s(now_s), now_s)
                elif (
                    utterance.anchor == "now"
                    and before
                    and before.zero_s is not None
                    and before.phone_count is not None
                ):
                    self._put(utterance, max(before.zero_s + before.end_s, self.clock.stream_s(now_s)), now_s)
            before = utterance
        self._take(now_s)

    def _put(self, utterance: Utterance, zero_s: float, now_s: float) -> None:
        skips = utterance.state.has_started or utterance.anchor != "at"
        utterance.place(zero_s, self.clock.stream_s(now_s) if skips else 0.0)

    def _take(self, now_s: float, utterances: Sequence[Utterance] | None = None) -> None:
        """Plan the phones that are said next, a limited number at a time."""
        room = TAKEN_LETTERS - sum(map(len, [phone.label for _, phone in self.fresh]))
        count, soon_s = len(self.fresh), self.clock.stream_s(now_s) + TAKEN_S
        taken: dict[int | None, list[Phone]] = {}
        coming = merge(
            *(utterance.coming() for utterance in utterances or self.queue if utterance.zero_s is not None),
            key=lambda item: item[0].start_s,
        )
        while room > 0 and (following := next(coming, None)):
            phone, utterance, utterance_taken = following
            if phone.start_s > soon_s and count > AHEAD_PHONES:
                break
            utterance.taken = utterance_taken
            is_new = utterance.order[utterance_taken - 1] >= utterance.revised
            taken.setdefault(utterance.number if is_new else None, []).append(phone)
            room, count = room - len(phone.label), count + 1
        for number, phones in taken.items():
            self._prepare(number, phones, now_s)

    def _prepare(self, number: int | None, phones: list[Phone], now_s: float) -> None:
        if not phones:
            return
        if not self.fresh:
            self.fresh_since_s = now_s
        self.fresh += [(number, phone) for phone in phones]
        begins_s = self.clock.begins_s
        self.gestures.hear(self._row, [(phone.start_s + begins_s, phone) for phone in phones], now_s)

    @property
    def _row(self) -> int:
        return self.batch.row(self.number)

    def _open(self, number: int, revision: int, now_s: float) -> Utterance | None:
        """Find an utterance, or add it to the queue; None if it is finished or the queue is full."""
        utterance = self.find(number)
        if utterance is not None:
            return utterance
        if revision <= self.over.get(number, -1):
            self.counters.ignored += 1
            return None
        if len(self.queue) == self.limits.utterances:
            raise UsageError(f"utterance {number}: got one more than the {self.limits.utterances} that may wait")
        utterance = Utterance(number, self.clock, revision=revision, latest_s=now_s)
        self.counters.utterances += 1
        self.queue.append(utterance)
        return utterance

    def _revise(self, utterance: Utterance, command: Begin | Append, now_s: float) -> None:
        last_s = utterance.last_s
        from_s = utterance.revise(command, max(utterance.position_s(now_s), 0.0))
        if utterance.zero_s is None:
            return
        start_s = max(self.clock.stream_s(now_s), utterance.zero_s + from_s, 0.0)
        if start_s < utterance.zero_s + last_s:
            self.fresh.append((None, Phone(SILENCE, start_s, utterance.zero_s + last_s)))
            self.gestures.forget(self._row, start_s + self.clock.begins_s)

    def _conceal(self, utterance: Utterance, before: Phone, after: Phone, between: range, now_s: float) -> None:
        utterance.bridge(between)
        self.counters.concealed += len(between)
        self._tell(utterance, "concealed", now_s, len(between))
        if not before.is_silence and after.start_s > before.end_s:
            bridge = replace(before, start_s=before.end_s, end_s=after.start_s, stress=0)
            self._prepare(None, utterance.in_stream([bridge]), now_s)

    def _silence(self, now_s: float, fade_s: float) -> None:
        """Drop all planned speech and fade to neutral."""
        self.fresh = []
        self.batch.cancel(self.number, self.clock.stream_s(now_s), fade_s=fade_s)
        self.gestures.hush(self._row, now_s)

    def _jump(self, utterance: Utterance, position_s: float, now_s: float) -> None:
        self._silence(now_s, JUMP_FADE_S)
        self.slew_left_s = 0.0
        self._put(utterance, self.clock.stream_s(now_s) - position_s, now_s)
        self._take(now_s, [utterance])  # the others' phones take precedence
        self._replace_rest(now_s, utterance.zero_s or 0.0, beside=utterance)

    def _replace_rest(self, now_s: float, from_s: float, beside: Utterance | None = None) -> None:
        """Plan the other utterances again after :meth:`_silence`; queued ones get a new place."""
        for utterance in self.queue:
            if utterance is beside or utterance.zero_s is None:
                continue
            if utterance.anchor == "now" and not utterance.state.has_started:
                utterance.unplace()
            else:
                utterance.take_again(self.clock.stream_s(now_s))
        first = next((utterance for utterance in self.queue if utterance.zero_s is None), None)
        if first is not None and first is self.queue[0] and first.anchor == "now" and not self.is_paused:
            self._put(first, max(from_s, self.clock.stream_s(now_s)), now_s)
        self._settle(now_s)

    def _finish(self, utterance: Utterance, now_s: float) -> None:
        self.counters.lost += utterance.lost
        self.counters.finished += 1
        self._close(utterance, "finished", now_s)

    def _give_up(self, utterance: Utterance, now_s: float) -> None:
        self.counters.unended += 1
        self._close(utterance, "finished" if utterance.state.has_started else "error", now_s)

    def _close(self, utterance: Utterance, kind: EventKind, now_s: float) -> None:
        self.queue.remove(utterance)
        self.over[utterance.number] = utterance.revision
        while len(self.over) > REMEMBERED:
            del self.over[next(iter(self.over))]
        first = [utterance.phones[index] for index in utterance.order[:REMARKED]]
        for remark in remarks_on(PhoneTrack.from_phones(first, tolerance_s=inf)):
            self._tell(utterance, "remark", now_s, reason=remark)
        self._tell(utterance, kind, now_s)
        utterance.step(Step.CLOSE)

    def _tell(self, utterance: Utterance, kind: EventKind, now_s: float, count: int = 1, reason: str = "") -> None:
        position_s = utterance.position_s(now_s) if utterance.state.is_placed else 0.0
        self.emit(Event(self.name, utterance.number, kind, now_s, count, position_s, reason))
