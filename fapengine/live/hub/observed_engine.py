"""The engine as everybody on the server sees it: the same calls, and listeners hear what passes."""

from collections import deque
from collections.abc import Callable

from fapengine.errors import UsageError
from fapengine.live.engine.commands import Cancel, Command
from fapengine.live.engine.counts import summed
from fapengine.live.engine.engine import EngineFrame, Fault
from fapengine.live.engine.port import EnginePort
from fapengine.live.engine.session import Counters, Event, State
from fapengine.live.engine.utterance import Utterance
from fapengine.live.wire.fap_osc import MAX_SESSION_BYTES
from fapengine.trajectory.style import Style

MAX_EVENTS = 4096
"""Kept for a reader that does not come."""

OnCommand = Callable[[str, Command, float], None]
OnEvent = Callable[[Event], None]


class ObservedEngine:
    """An engine that passes every call on to another and tells observers of it.

    Stateful.

    Parameters
    ----------
    engine : Engine
        Nobody else may call it from now on.
    """

    def __init__(self, engine: EnginePort) -> None:
        self.inner = engine
        self.command_listeners: list[OnCommand] = []
        self.event_listeners: list[OnEvent] = []
        self.open_listeners: list[Callable[[], None]] = []
        """Told when a session begins."""
        self.room: int | None = None
        """Sessions that may still be opened; whoever knows the load sets it anew. None: any number."""
        self.refused = 0
        """Sessions that were not opened for that."""
        self.touched_s: dict[str, float] = {}
        """Time of the last command, or of the opening, of each session."""
        self._closed = Counters()
        self._undrained: deque[Event] = deque(maxlen=MAX_EVENTS)

    def __contains__(self, session: object) -> bool:
        return session in self.inner

    @property
    def sessions(self) -> tuple[str, ...]:
        """Names of the open sessions."""
        return self.inner.sessions

    def open(self, session: str, now_s: float) -> None:
        """Begin a session; see :meth:`EnginePort.open`.

        Raises
        ------
        UsageError
            If its name cannot be sent on every wire: 1 to 32 bytes of UTF-8 without NUL; or if there is no time for it.
        """
        is_new = session not in self
        if is_new and self.room is not None and self.room <= 0 and self.sessions:
            self.refused += 1
            raise UsageError("sessions: got one more than this machine can show in time; ask again later")
        size = len(session.encode(errors="replace"))
        if not 1 <= size <= MAX_SESSION_BYTES or not session.isprintable():
            raise UsageError(
                f"session: got {session!r:.60}, expected 1..{MAX_SESSION_BYTES} bytes of printable letters"
            )
        self.inner.open(session, now_s)
        self.touched_s[session] = now_s
        for listener in tuple(self.open_listeners):
            listener()
        if is_new and self.room is not None:
            self.room -= 1

    def close(self, session: str, now_s: float) -> None:
        """End a session; see :meth:`EnginePort.close`."""
        if session in self.inner:  # cancelled first, so that this is counted
            self.inner.apply(session, Cancel(), now_s)
            self._closed = summed(self._closed, self.inner.counters(session))
        self.inner.close(session, now_s)
        self.touched_s.pop(session, None)

    def apply(self, session: str, command: Command, now_s: float) -> None:
        """Tell a session something; see :meth:`EnginePort.apply`."""
        self.inner.apply(session, command, now_s)
        self.touched_s[session] = now_s
        for listener in tuple(self.command_listeners):
            listener(session, command, now_s)

    def rest(self, session: str, at_s: float, now_s: float) -> None:
        """Let a session's gestures come to rest by a time; see :meth:`EnginePort.rest`."""
        self.inner.rest(session, at_s, now_s)

    def frame(self, now_s: float) -> EngineFrame:
        """One frame of every session; see :meth:`EnginePort.frame`."""
        return self.inner.frame(now_s)

    def faults(self) -> list[Fault]:
        """Take the sessions that were ended for a fault; see :meth:`EnginePort.faults`."""
        faults = self.inner.faults()
        for fault in faults:
            self._closed = summed(self._closed, fault.counters)
            self.touched_s.pop(fault.session, None)
        return faults

    def state(self, session: str) -> State:
        """Tell what a session is doing; see :meth:`EnginePort.state`."""
        return self.inner.state(session)

    def style(self, session: str) -> Style:
        """Tell how a session speaks and moves now; see :meth:`EnginePort.style`."""
        return self.inner.style(session)

    def counters(self, session: str) -> Counters:
        """Tell what a session has met with; see :meth:`EnginePort.counters`."""
        return self.inner.counters(session)

    def utterance(self, session: str, number: int) -> Utterance | None:
        """Find an utterance that is not over; see :meth:`EnginePort.utterance`."""
        return self.inner.utterance(session, number)

    def totals(self) -> Counters:
        """Sum up what all sessions have met with, those that are closed included."""
        return summed(self._closed, *(self.inner.counters(session) for session in self.inner.sessions))

    def events(self) -> list[Event]:
        """Take what happened since the last call: once for whoever asks, and once for each listener."""
        self.collect()
        events = list(self._undrained)
        self._undrained.clear()
        return events

    def collect(self) -> None:
        """Tell listeners what happened."""
        for event in self.inner.events():
            self._undrained.append(event)
            for listener in tuple(self.event_listeners):
                listener(event)
