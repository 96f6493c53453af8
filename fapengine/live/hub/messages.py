"""What the hub hands out: frames, what its voice said, and counts."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.live.engine.commands import Anchor
from fapengine.voices.protocol import Speech

Place = Callable[[float], float | None]
"""Engine time to the time in a sound that belongs there; minus infinity: it does not sound yet, None: it is over."""


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
    """``"audio"``: whoever plays the sound must tell its position, for the face to begin
    (:class:`~fapengine.live.engine.commands.Audio`)."""


@dataclass(frozen=True, slots=True, eq=False)
class HeardSound:
    """A piece of the sound that an ear was given, for those who play it."""

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
class HubCounts:
    """Counts since the start.

    Stateful.
    """

    frames: int = 0
    skipped: int = 0
    """Frames that were due and never shown."""
    listeners_dropped: int = 0
    idle_closed: int = 0
    faulted: int = 0
    """Sessions ended because their frame could not be made: each is a bug, told of in the log."""
    unheard: int = 0
    """Utterances whose player never said where it is."""
