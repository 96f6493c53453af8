"""The interface of the engine: whoever sits above it asks for this and not for one class."""

from typing import Protocol

from fapengine.live.engine.commands import Command
from fapengine.live.engine.engine import EngineFrame, Fault
from fapengine.live.engine.session import Counters, Event, State
from fapengine.live.engine.utterance import Utterance
from fapengine.trajectory.style import Style


class EnginePort(Protocol):
    """The methods of :class:`.engine.Engine` that the wire, the hub and the server call."""

    @property
    def sessions(self) -> tuple[str, ...]:
        """Names of the open sessions."""
        ...

    def __contains__(self, session: object) -> bool: ...

    def open(self, session: str, now_s: float) -> None:
        """Begin a session; ``UsageError`` when there are as many as there may be."""
        ...

    def close(self, session: str, now_s: float) -> None:
        """End a session."""
        ...

    def apply(self, session: str, command: Command, now_s: float) -> None:
        """Tell a session something."""
        ...

    def rest(self, session: str, at_s: float, now_s: float) -> None:
        """Let a session's gestures come to rest by a time."""
        ...

    def frame(self, now_s: float) -> EngineFrame:
        """One frame of every session."""
        ...

    def events(self) -> list[Event]:
        """Take what happened since the last call."""
        ...

    def faults(self) -> list[Fault]:
        """Take the sessions that were ended for a fault since the last call."""
        ...

    def state(self, session: str) -> State:
        """``idle``, ``waiting``, ``speaking`` or ``paused``."""
        ...

    def style(self, session: str) -> Style:
        """Tell how a session speaks and moves now."""
        ...

    def counters(self, session: str) -> Counters:
        """Tell what a session has met with."""
        ...

    def utterance(self, session: str, number: int) -> Utterance | None:
        """Find an utterance that is not over."""
        ...
