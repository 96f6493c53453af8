"""Listeners to frames, events, commands and audio of the hub. A listener that raises is dropped."""

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
"""Engine time to the position in a piece of audio; minus infinity before it begins, None after its end."""

log = logging.getLogger("fapengine.server")


@dataclass(frozen=True, slots=True, eq=False)
class HubFrames:
    """One frame of every session."""

    number: int
    """Number of the hub's tick; missing numbers were skipped because the hub was late."""
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
    """``"audio"``: the face begins when the player of the audio reports its position
    (:class:`~fapengine.engine.commands.Audio`)."""


@dataclass(frozen=True, slots=True, eq=False)
class HeardSound:
    """A piece of the audio that a recognizer received, for listeners that play it."""

    key: Hashable
    """Name of the stream that it continues."""
    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    rate_hz: int
    first_s: float
    """Time of its first sample in the stream."""
    place: Place
    """Place of the stream, as the face follows it."""
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
    """Listeners by what they listen to.

    Stateful. Each method that adds one returns a function that removes it; a session of None stands for all sessions.

    Parameters
    ----------
    counts : HubCounts
        Counts the listeners that are dropped.
    """

    def __init__(self, counts: HubCounts) -> None:
        self._counts = counts
        self._keys = count()
        self._of: dict[str, dict[int, Any]] = {kind: {} for kind in ("frames", "frame", "event", "command", "speech")}

    def on_frame(self, session: str, listener: Callable[[HubFrame], None]) -> Unsubscribe:
        """Receive every frame of one session, as long as it is open."""
        return self._add("frame", session, listener)

    def on_frames(self, listener: Callable[[HubFrames], None]) -> Unsubscribe:
        """Receive every frame of all sessions, in one call per tick."""
        return self._add("frames", None, listener)

    def on_event(self, session: str | None, listener: Callable[[Event], None]) -> Unsubscribe:
        """Receive the events of utterances."""
        return self._add("event", session, listener)

    def on_command(self, session: str | None, listener: Callable[[str, Command, float], None]) -> Unsubscribe:
        """Receive the commands of a session: session, command, engine time."""
        return self._add("command", session, listener)

    def on_speech(self, session: str | None, listener: Callable[[Spoken], None], *, plays: bool) -> Unsubscribe:
        """Receive the audio of what a voice says.

        Parameters
        ----------
        session : str or None
        listener : callable
        plays : bool
            Whether it plays the audio and reports its position, with :class:`~fapengine.engine.commands.Audio`. The
            face then waits for that.
        """
        return self._add("speech", session, listener, plays=plays)

    def plays(self, session: str) -> bool:
        """Whether a listener plays the audio of a session's voice."""
        return any(plays for wanted, _, plays in self._of["speech"].values() if wanted in (None, session))

    def tell_frames(self, frames: HubFrames) -> None:
        """Hand out the frames of one tick: whole, and row by row."""
        self.tell("frames", None, frames)
        rows = {session: row for row, session in enumerate(frames.sessions)} if self._of["frame"] else {}
        for key, (session, listener, _) in tuple(self._of["frame"].items()):
            if session in rows:
                frame = HubFrame(session, frames.number, frames.time_s, frames.faps[rows[session]])
                self._call("frame", key, listener, frame)

    def _add(
        self, kind: str, session: str | None, listener: Callable[..., None], *, plays: bool = False
    ) -> Unsubscribe:
        key, listeners = next(self._keys), self._of[kind]
        listeners[key] = session, listener, plays
        return lambda: listeners.pop(key, None)

    def tell(self, kind: str, session: str | None, *arguments: object) -> None:
        """Pass an event, a command, audio or frames of a session to all listeners of that kind."""
        for key, (wanted, listener, _) in tuple(self._of[kind].items()):
            if wanted in (None, session):
                self._call(kind, key, listener, *arguments)

    def _call(self, kind: str, key: int, listener: Callable[..., None], *arguments: object) -> None:
        try:
            listener(*arguments)
        except Exception:  # one listener's fault must not stop the other faces
            log.exception("a listener failed and is dropped", extra={"listener": repr(listener)})
            self._of[kind].pop(key, None)
            self._counts.listeners_dropped += 1
