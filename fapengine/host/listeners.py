"""Who wants frames, events, commands or sound of the hub, and what they get; a listener that raises is dropped."""

import logging
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._counters import Counts, metric
from fapengine.engine.commands import Anchor, Command
from fapengine.engine.session import Event
from fapengine.voices.protocol import Speech

Unsubscribe = Callable[[], None]
Place = Callable[[float], float | None]
"""Engine time to the time in a sound that belongs there; minus infinity: it does not sound yet, None: it is over."""

log = logging.getLogger("fapengine.server")


@dataclass(frozen=True, slots=True, eq=False)
class HubFrames:
    """One frame of every session."""

    number: int
    """Counts ticks of the hub; what is missing was skipped for lateness."""
    time_s: float
    """Engine time."""
    sessions: tuple[str, ...]
    faps: NDArray[np.int32]
    """(S, 68) int32, FAPU; row r is session ``sessions[r]``."""


@dataclass(frozen=True, slots=True, eq=False)
class HubFrame:
    """One frame of one session."""

    session: str
    number: int
    time_s: float
    """Engine time."""
    faps: NDArray[np.int32]
    """(68,) int32, FAPU."""


@dataclass(frozen=True, slots=True, eq=False)
class Spoken:
    """Something a voice of the server said."""

    session: str
    utterance: int
    text: str
    speech: Speech
    anchor: Anchor
    """``"audio"``: the player of the sound must report its position, for the face to begin
    (:class:`~fapengine.engine.commands.Audio`)."""


@dataclass(frozen=True, slots=True, eq=False)
class HeardSound:
    """A piece of the sound that a recognizer was given, for those who play it."""

    key: Hashable
    """Name of the sound that it continues."""
    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    rate_hz: int
    first_s: float
    """Time in the sound of its first sample."""
    place: Place
    """Place of the sound, as the face follows it."""
    is_endless: bool
    """True for a microphone's."""


@dataclass(slots=True)
class HubCounts(Counts):
    """Counts since the start.

    Stateful.
    """

    frames: int = metric("frames", "Ticks of the hub: one frame of every session each.")
    skipped: int = metric("skipped", "Frames that were due and never shown.")
    listeners_dropped: int = metric("listeners_dropped", "Listeners that failed.")
    idle_closed: int = metric("idle_closed", "Sessions closed because nobody talked to them.")
    faulted: int = metric("faulted", "Sessions ended for a fault of their own; the log has each.")
    """Each is a bug."""
    unheard: int = metric("unheard", "Utterances whose player never said where the sound is.")


class Listeners:
    """Listeners by what they want.

    Stateful. Each method that adds one returns a function that removes it; a session of None stands for all sessions.

    Parameters
    ----------
    counts : HubCounts
        Counts those that are dropped.
    """

    def __init__(self, counts: HubCounts) -> None:
        self._counts = counts
        self._keys = count()
        self._frames: dict[int, Callable[[HubFrames], None]] = {}
        self._frame: dict[str, dict[int, Callable[[HubFrame], None]]] = {}
        self._event: dict[int, tuple[str | None, Callable[[Event], None]]] = {}
        self._command: dict[int, tuple[str | None, Callable[[str, Command, float], None]]] = {}
        self._speech: dict[int, tuple[str | None, bool, Callable[[Spoken], None]]] = {}

    def on_frame(self, session: str, listener: Callable[[HubFrame], None]) -> Unsubscribe:
        """Have every frame of one session, as long as it is open."""
        listeners = self._frame.setdefault(session, {})
        remove = self._add(listeners, listener)

        def stop() -> None:
            remove()
            if not listeners and self._frame.get(session) is listeners:
                del self._frame[session]

        return stop

    def on_frames(self, listener: Callable[[HubFrames], None]) -> Unsubscribe:
        """Have every frame of all sessions, in one call a tick."""
        return self._add(self._frames, listener)

    def on_event(self, session: str | None, listener: Callable[[Event], None]) -> Unsubscribe:
        """Hear what becomes of utterances: ``fapengine.engine`` Events."""
        return self._add(self._event, (session, listener))

    def on_command(self, session: str | None, listener: Callable[[str, Command, float], None]) -> Unsubscribe:
        """Get the commands of a session: session, command, engine time. A phone ticker is made of it."""
        return self._add(self._command, (session, listener))

    def on_speech(self, session: str | None, listener: Callable[[Spoken], None], *, plays: bool) -> Unsubscribe:
        """Have the sound of what a voice says.

        Parameters
        ----------
        session : str or None
            None: of all sessions.
        listener : callable
            Takes a :class:`Spoken`.
        plays : bool
            Whether it plays the sound and tells where it is, with :class:`~fapengine.engine.commands.Audio`. The
            face then waits for that.
        """
        return self._add(self._speech, (session, plays, listener))

    def plays(self, session: str) -> bool:
        """Return whether a listener plays the sound of a session's voice."""
        return any(plays for wanted, plays, _ in self._speech.values() if wanted in (None, session))

    def tell_frames(self, frames: HubFrames) -> None:
        """Hand out the frames of one tick: whole, and row by row."""
        for key, listener in tuple(self._frames.items()):
            self._call(self._frames, key, listener, frames)
        if not self._frame:
            return
        rows = {session: row for row, session in enumerate(frames.sessions)}
        for session, listeners in tuple(self._frame.items()):
            row = rows.get(session)
            if row is not None:
                frame = HubFrame(session, frames.number, frames.time_s, frames.faps[row])
                for key, of_one in tuple(listeners.items()):
                    self._call(listeners, key, of_one, frame)

    def tell_event(self, event: Event) -> None:
        """Tell what became of an utterance."""
        for key, (session, listener) in tuple(self._event.items()):
            if session in (None, event.session):
                self._call(self._event, key, listener, event)

    def tell_command(self, session: str, command: Command, now_s: float) -> None:
        """Report a command of a session."""
        for key, (wanted, listener) in tuple(self._command.items()):
            if wanted in (None, session):
                self._call(self._command, key, listener, session, command, now_s)

    def tell_speech(self, spoken: Spoken) -> None:
        """Hand out the sound of what a voice said."""
        for key, (wanted, _, listener) in tuple(self._speech.items()):
            if wanted in (None, spoken.session):
                self._call(self._speech, key, listener, spoken)

    def _add(self, listeners: dict[int, Any], listener: Any) -> Unsubscribe:
        key = next(self._keys)
        listeners[key] = listener
        return lambda: listeners.pop(key, None)

    def _call(self, listeners: dict[int, Any], key: int, listener: Callable[..., None], *arguments: object) -> None:
        try:
            listener(*arguments)
        except Exception:  # one listener's fault must not stop the other faces
            log.exception("a listener failed and is dropped", extra={"listener": repr(listener)})
            listeners.pop(key, None)
            self._counts.listeners_dropped += 1
