"""What a session can be told. Times that say *engine time* are of the clock that the engine is driven by."""

from dataclasses import dataclass
from math import inf
from typing import Literal

from fapengine.mpeg4.visemes import Expression
from fapengine.speech.phone_track import Phone

Anchor = Literal["now", "at", "audio"]
MANNERS = ("articulation", "jaw", "lips", "loudness_db", "blinks", "head_motion", "gaze", "idle", "emphasis")
"""Settings of :class:`Manner`: fields of :class:`fapengine.trajectory.style.Style`."""


@dataclass(frozen=True, slots=True)
class Begin:
    """Open an utterance. Utterances are said in the order in which they begin; ``"at"`` and ``"audio"`` do not wait."""

    utterance: int
    anchor: Anchor = "now"
    """When its time 0 is: as soon as the one before it is over, at a time, or when its sound is heard to play."""
    at_s: float = 0.0
    """Engine time, for ``"at"``."""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Append:
    """Phones of an utterance, by index: the same again changes nothing, so senders may repeat themselves."""

    utterance: int
    first_index: int
    phones: tuple[Phone, ...]
    """In the utterance's time. Silences count as phones."""
    revision: int = 0
    """A higher one than before replaces all phones that are still to come; a lower one is ignored."""


@dataclass(frozen=True, slots=True)
class End:
    """Say that no phone with a higher index will come."""

    utterance: int
    phone_count: int
    duration_s: float
    """Of the utterance, its last silence included."""
    revision: int = 0


VOICE_UTTERANCES = 1 << 30
"""What the server's own voice says is numbered from here, so that it never meets a sender's."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Stop speaking (barge-in). The same again changes nothing."""

    utterance: int | None = None
    """None: all there are, or see ``first``."""
    at_s: float | None = None
    """Engine time; None: at once."""
    fade_s: float = 0.2
    """The face is at rest this much later."""
    first: int = 0
    """With None for the utterance: only those that are numbered so, or higher."""

    def means(self, utterance: int) -> bool:
        """Whether an utterance is to stop."""
        return utterance >= self.first if self.utterance is None else utterance == self.utterance


@dataclass(frozen=True, slots=True)
class Pause:
    """Stop where it is and come to rest; the queue waits."""

    fade_s: float = 0.2


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on from where it was paused."""


@dataclass(frozen=True, slots=True)
class Seek:
    """Go on from another place of the utterance that is being said."""

    utterance: int
    position_s: float


@dataclass(frozen=True, slots=True)
class Audio:
    """Where the sound of an utterance really is; the face follows it."""

    utterance: int
    at_s: float
    """Engine time at which this was so."""
    position_s: float
    """In the utterance."""
    rate: float = 1.0
    """0: it stands still."""


@dataclass(frozen=True, slots=True)
class Express:
    """Show an expression; a new one of the same name takes over from where the old one is."""

    expression: Expression
    level: float = 1.0
    """0..2; 1 is the profile's full expression."""
    at_s: float | None = None
    """Engine time; None: at once."""
    attack_s: float = 0.35
    hold_s: float = inf
    release_s: float = 0.5


@dataclass(frozen=True, slots=True)
class Look:
    """Turn both eyes, against the head; as FAP 23 to 26 count: to the subject's left, and down."""

    yaw_rad: float
    pitch_rad: float
    over_s: float = 0.1


@dataclass(frozen=True, slots=True)
class Blink:
    """Close both eyes once, now."""


@dataclass(frozen=True, slots=True)
class TurnHead:
    """Turn the head, as FAP 48 to 50 count; what it does of itself is added."""

    pitch_rad: float
    yaw_rad: float
    roll_rad: float
    over_s: float = 0.4


@dataclass(frozen=True, slots=True)
class Manner:
    """Change how a session speaks or moves from now on."""

    setting: str
    """One of :data:`MANNERS`."""
    value: float
    """As in :class:`fapengine.trajectory.style.Style`; 0 and 1 switch generators."""


Command = (
    Begin | Append | End | Cancel | Pause | Resume | Seek | Audio | Express | Look | Blink | TurnHead | Manner
)  # fmt: skip
