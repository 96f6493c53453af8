"""What the protocol needs of the engine, so that it speaks to any that offers it."""

from typing import Protocol

from fapengine.live.engine.commands import Command
from fapengine.live.engine.session import Event
from fapengine.live.engine.utterance import Utterance


class Faces(Protocol):
    """The part of :class:`fapengine.live.engine.Engine` that senders reach."""

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

    def events(self) -> list[Event]:
        """Take what happened."""
        ...

    def utterance(self, session: str, number: int) -> Utterance | None:
        """Find an utterance that is not over."""
        ...
