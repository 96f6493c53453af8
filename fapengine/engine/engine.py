"""The engine: many sessions, driven by an explicit clock."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf, nextafter
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.engine.command_table import checked
from fapengine.engine.commands import Append, Audio, Begin, Cancel, Command, End, Pause, Resume, Seek, SetParameter
from fapengine.engine.gestures import BatchGestures
from fapengine.engine.session import Counters, Event, Limits, Session, State
from fapengine.engine.utterance import StreamClock, Utterance
from fapengine.errors import ElsewhereError, UsageError
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.trajectory.batch import BatchPlanner
from fapengine.trajectory.style import Style

PLANS_A_FRAME, URGENT_PLANS = 6, 12
"""Plans that a frame makes for all sessions, and at most for those that cannot wait; beyond that these wait too, and
what comes for them meanwhile is planned with the rest. A frame of 500 sessions takes 6 ms, and each plan 0.5."""
MAX_SPEED_FAPU_S = 45_000.0
"""Speed that no FAP of the mouth exceeds, whatever is asked for: 1.5 times the fastest of random phones (FAP 16)."""
JAW_AND_LIPS = slice(fap.column(3), fap.column(18) + 1)
MOUTH = np.array(fap.columns(*range(3, 19), *range(43, 48), *range(51, 61)))
"""Jaw, lips inside and outside, tongue."""
MAX_EVENTS = 4096
"""Events that are kept for a caller of :meth:`Engine.events`."""


@dataclass(frozen=True, slots=True, eq=False)
class EngineFrame:
    """One frame of every session."""

    sessions: tuple[str, ...]
    faps: NDArray[np.int32]
    """(S, 68) FAPU; row s is ``sessions[s]``."""
    time_s: float
    """Engine time."""


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A session that was ended because its frame could not be made. Each is a bug."""

    session: str
    error: Exception
    counters: Counters


class Engine:
    """Faces that speak, look and show expressions as commands say.

    Stateful.

    Parameters
    ----------
    profile : Profile
        Of all sessions.
    rng : numpy.random.Generator
        Random numbers of the gestures; each session draws from its own streams. The first session's are those of
        :func:`fapengine.trajectory.planner.plan` with the same seed.
    limits : Limits
    style : Style
        Of every session at first.

    Examples
    --------
    One face says "ma", and its FAPs are read at 50 frames per second::

        engine = Engine(profile, rng=np.random.default_rng(1))
        engine.open("anna", now_s=0.0)
        engine.apply("anna", Begin(1), now_s=0.0)
        engine.apply("anna", Append(1, 0, (Phone("m", 0.1, 0.2), Phone("a", 0.2, 0.4))), now_s=0.0)
        engine.apply("anna", End(1, phone_count=2, duration_s=0.5), now_s=0.0)
        frames = [engine.frame(n / 50).faps[0] for n in range(25)]
    """

    def __init__(
        self, profile: Profile, *, rng: np.random.Generator, limits: Limits | None = None, style: Style | None = None
    ) -> None:
        self._rng, self._limits, self._style = rng, limits or Limits(), style or Style()
        self._batch = BatchPlanner(profile, Style.speech_only(method=self._style.method))
        self._gestures = BatchGestures(profile, self._style)
        self._by_name: dict[str, Session] = {}
        self._rows: list[Session] = []
        self.sessions: tuple[str, ...] = ()
        """Names, in the order of a frame's rows."""
        self.command_listeners: list[Callable[[str, Command, float], None]] = []
        """Called with session, command and engine time when a command was applied."""
        self.event_listeners: list[Callable[[Event], None]] = []
        """Called by :meth:`collect`."""
        self.open_listeners: list[Callable[[], None]] = []
        """Called when a session was opened."""
        self.may_open: Callable[[str], bool] = lambda session: True
        """Whether a session may be opened here: another process may have it."""
        self.room: int | None = None
        """Number of sessions that may still be opened, as the load allows; None: any number."""
        self.refused = 0
        """Sessions that were not opened because there was no room."""
        self.touched_s: dict[str, float] = {}
        """Time of the last command, or of the opening, of each session."""
        self._closed = Counters()
        self._new_events: list[Event] = []
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._faults: list[Fault] = []
        self._shown_s = -np.inf
        self._shown = EngineFrame((), np.zeros((0, fap.FAP_COUNT), np.int32), -np.inf)

    def __contains__(self, session: object) -> bool:
        """Whether a session is open."""
        return session in self._by_name

    def __len__(self) -> int:
        """Count the open sessions."""
        return len(self._rows)

    def open(self, session: str, now_s: float) -> None:
        """Begin a session: a face at rest.

        Raises UsageError if the limit is reached, there is no time for one more, it is open already, or its name cannot
        be sent on every wire: ``Limits.name_bytes`` of UTF-8 at most, printable.
        """
        if session in self._by_name:
            raise UsageError(f"session: got {session!r}, which is open already")
        if not self.may_open(session):
            raise ElsewhereError(f"session: got {session!r:.60}, which another process shows")
        if self.room is not None and self.room <= 0 and self._rows:
            self.refused += 1
            raise UsageError("sessions: got one more than this machine can show in time; ask again later")
        size, most = len(session.encode(errors="replace")), self._limits.name_bytes
        if most is not None and not (1 <= size <= most and session.isprintable()):
            raise UsageError(f"session: got {session!r:.60}, expected 1 to {most} bytes of printable characters")
        if len(self._rows) >= self._limits.sessions:
            raise UsageError(f"sessions: got one more than the limit of {self._limits.sessions}")
        number = self._batch.open(now_s)
        self._gestures.open(now_s, self._rng)
        clock = StreamClock(now_s)
        made = Session(
            session, number, self._batch, self._gestures, self._limits, self._style, clock, self._new_events.append
        )
        self._by_name[session] = made
        self._rows.append(made)
        self.sessions = tuple(opened.name for opened in self._rows)
        self.touched_s[session] = now_s
        if self.room is not None:
            self.room -= 1
        for listener in tuple(self.open_listeners):
            listener()

    def close(self, session: str, now_s: float) -> None:
        """End a session, and cancel what it was saying. Raises UsageError if it is not open."""
        self._session(session).cancel(Cancel(), max(now_s, self._shown_s))
        self._remove(session)

    def _remove(self, session: str) -> None:
        closed = self._session(session)
        self._closed = self._closed.plus(closed.report())
        self.touched_s.pop(session, None)
        row = self._batch.row(closed.number)
        self._batch.close(closed.number)
        self._gestures.close(row)
        self._rows[row] = self._rows[-1]
        self._rows.pop()
        self.sessions = tuple(opened.name for opened in self._rows)
        del self._by_name[session]

    def rest(self, session: str, at_s: float, now_s: float) -> None:
        """End a session's gestures by a time, as those of a file end; none follows.

        Raises UsageError if the session is not open.
        """
        self._gestures.end(self._batch.row(self._session(session).number), at_s, max(now_s, self._shown_s))

    def apply(self, session: str, command: Command, now_s: float) -> str:
        """Apply a command to a session. One that is out of range or cannot be used is counted (:meth:`counters`).

        Raises UsageError if the session is not open.

        Returns
        -------
        str
            Why it was refused; empty if it was not.
        """
        target = self._session(session)
        target.wake_s = -inf
        answer, refusal = _ANSWERS.get(type(command), Session.gesture), ""
        try:
            answer(target, checked(command), max(now_s, self._shown_s))
        except UsageError as error:
            target.counters.refused += 1
            refusal = str(error)
        self.touched_s[session] = now_s
        for listener in tuple(self.command_listeners):
            listener(session, command, now_s)
        return refusal

    def frame(self, now_s: float) -> EngineFrame:
        """Make one frame of every session. A session that fails is ended (:meth:`faults`); the others continue.

        Raises UsageError if time goes back, or is not finite.

        Parameters
        ----------
        now_s : float
            Engine time, not earlier than that of the last frame.
        """
        if not self._shown_s <= now_s < inf:
            raise UsageError(f"time_s: got {now_s:g} s, expected rising times from {self._shown_s:g} s")
        awake = sorted((session for session in self._rows if session.wake_s <= now_s), key=attrgetter("name"))
        awake = [session for session in awake if self._succeeds(session, session.advance, now_s)]
        self._plan([session for session in awake if session.fresh], now_s)
        elapsed_s = now_s - self._shown_s
        if elapsed_s < inf:
            for session in [session for session in self._rows if session.slew_left_s]:
                self._succeeds(session, session.slew, elapsed_s)
        try:
            faps = self._batch.frames(now_s, self._gestures.overlay(now_s))
        except Exception:  # one session's fault must not stop the other faces
            if not self._end_guilty(now_s):
                raise
            faps = self._batch.frames(now_s, self._gestures.overlay(now_s))
        self._slow_down(faps, now_s)
        self._shown_s = now_s
        self._shown = EngineFrame(self.sessions, faps.copy(order="K"), now_s)  # the caller may change its own
        return EngineFrame(self.sessions, faps, now_s)

    def _slow_down(self, faps: NDArray[np.int32], now_s: float) -> None:
        """Limit the speed of mouths by moving them a part of the way; so lips that do not cross never do."""
        shown, most = self._shown.faps, MAX_SPEED_FAPU_S * (now_s - self._shown_s)
        if self._shown.sessions is not self.sessions:
            rows = dict(zip(self._shown.sessions, shown, strict=True))
            shown = np.array([rows.get(name, np.zeros(fap.FAP_COUNT)) for name in self.sessions]).reshape(faps.shape)
        steps = np.abs(faps[:, JAW_AND_LIPS] - shown[:, JAW_AND_LIPS]).max(axis=1, initial=0)
        fast = (steps > most).nonzero()[0]
        if len(fast):
            mouths, share = np.ix_(fast, MOUTH), most / steps[fast, None]
            faps[mouths] = np.rint(shown[mouths] + share * (faps[mouths] - shown[mouths]))

    def _plan(self, sessions: Sequence[Session], now_s: float) -> None:
        """Plan for sessions with fresh phones, the most urgent first; the others are woken again."""
        planned = 0
        urgency = sorted(((session.plan_by_s(), session) for session in sessions), key=itemgetter(0))
        for (urgent_s, due_s), session in urgency:
            if due_s <= now_s and planned < (URGENT_PLANS if urgent_s <= now_s else PLANS_A_FRAME):
                self._succeeds(session, session.flush, now_s)
                planned += 1
            else:
                session.wake_s = min(session.wake_s, max(due_s, nextafter(now_s, inf)))

    def _succeeds(self, session: Session, step: Callable[[float], None], argument: float) -> bool:
        """Advance one session; end it if that fails."""
        try:
            step(argument)
        except Exception as error:  # noqa: BLE001  a bug, but one session's: the other faces continue
            self._faults.append(Fault(session.name, error, session.counters))
            self._new_events += [
                Event(session.name, utterance.number, "error", self._shown_s) for utterance in session.queue
            ]
            self._remove(session.name)
            return False
        return True

    def _end_guilty(self, now_s: float) -> bool:
        """Find the sessions because of which a frame failed, one by one, and end them."""
        before = len(self._faults)
        for session in tuple(self._rows):
            self._succeeds(session, partial(self._prepare, session), now_s)
        return len(self._faults) > before

    def _prepare(self, session: Session, now_s: float) -> None:
        self._gestures.draw(self._batch.row(session.number), now_s)
        self._batch.renew(session.number, now_s)

    def faults(self) -> list[Fault]:
        """Return the sessions that were ended for a fault since the last call."""
        faults, self._faults = self._faults, []
        return faults

    def events(self) -> list[Event]:
        """Return what has happened since the last call."""
        self.collect()
        drained = list(self._events)
        self._events.clear()
        return drained

    def collect(self) -> None:
        """Report what has happened to the listeners."""
        new = list(self._new_events)
        self._new_events.clear()
        for event in new:
            self._events.append(event)
            for listener in tuple(self.event_listeners):
                listener(event)

    def counters(self, session: str) -> Counters:
        """Return the counters of a session. Raises UsageError if it is not open."""
        return self._session(session).report()

    def totals(self) -> Counters:
        """Return the sum of the counters of all sessions, closed ones included."""
        return self._closed.plus(*(session.report() for session in self._rows))

    def state(self, session: str) -> State:
        """Return the state of a session. Raises UsageError if it is not open."""
        return self._session(session).state

    def utterance(self, session: str, number: int) -> Utterance | None:
        """Find an utterance that has not finished. Raises UsageError if the session is not open."""
        return self._session(session).find(number)

    def style(self, session: str) -> Style:
        """Return the style of a session. Raises UsageError if it is not open."""
        return self._session(session).style

    def _session(self, session: str) -> Session:
        if session not in self._by_name:
            raise UsageError(f"session: got {session!r}, which is not open")
        return self._by_name[session]


_ANSWERS: dict[type, Callable[[Session, Any, float], None]] = {
    Begin: Session.begin,
    Append: Session.append,
    End: Session.end,
    Cancel: Session.cancel,
    Pause: Session.pause,
    Resume: Session.resume,
    Seek: Session.seek,
    Audio: Session.audio,
    SetParameter: Session.set_parameter,
}
