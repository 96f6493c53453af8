"""Commands to a live face: the one list of them (:mod:`.command_table` says how it is read).

Times that say *engine time* are of the clock that the engine is driven by. A field without a specification is not
written outside Python, or is written by a message that belongs to one sender.
"""

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, ClassVar, Literal

from fapengine.live.engine.command_table import (
    Angle,
    Choice,
    CommandSpec,
    Duration,
    EndlessDuration,
    FieldSpec,
    Time,
)
from fapengine.live.engine.command_table import Command as Command
from fapengine.mpeg4.visemes import Expression
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.expression import MAX_WEIGHT

Anchor = Literal["now", "at", "audio"]
PARAMETERS = ("articulation", "jaw", "lips", "loudness_db", "blinks", "head_motion", "gaze", "idle", "emphasis")
"""Parameters of :class:`SetParameter`: fields of :class:`fapengine.trajectory.style.Style`."""
MAX_TURN_RAD = 1.5
MIN_DURATION_S, MAX_DURATION_S = 0.01, 60.0
"""Bounds of ramps and fades."""
MIN_FADE_S, MAX_FADE_S = 0.01, 10.0
MAX_TIME_S = 1e12
"""Bound of engine times, before 0 and behind: beyond it a double no longer tells one frame from the next."""
MIN_POSITION_S, MAX_POSITION_S = -3600.0, 86_400.0
"""Bounds of positions in an utterance."""
EXPRESSIONS = {expression.name.lower(): expression for expression in Expression if expression}
EXPRESSION_SYNONYMS = {
    "happy": Expression.JOY, "happiness": Expression.JOY, "smile": Expression.JOY, "sad": Expression.SADNESS,
    "angry": Expression.ANGER, "afraid": Expression.FEAR, "scared": Expression.FEAR, "fearful": Expression.FEAR,
    "disgusted": Expression.DISGUST, "surprised": Expression.SURPRISE, "neutral": Expression.NEUTRAL,
    "none": Expression.NEUTRAL, "smirk": Expression.SMILE_LEFT,
}  # fmt: skip
"""Other names of expressions that senders use."""

_TO_THE_LEFT = Angle(osc="yaw_deg", json="yaw", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="to the subject's left")
_DOWN = Angle(osc="pitch_deg", json="pitch", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="down")
_RIGHT_EAR_DOWN = Angle(osc="roll_deg", json="roll", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="right ear down")
_EXPRESSION = Choice(
    what="expression",
    osc="name",
    json="name",
    values=EXPRESSIONS,
    synonyms=EXPRESSION_SYNONYMS,
    doc="joy, sadness, anger, fear, disgust, surprise, smile_left, smile_right, contempt or neutral",
)
_PARAMETER = Choice(what="parameter", osc="key", json="setting", values={name: name for name in PARAMETERS})
_AT = FieldSpec(low=-MAX_TIME_S, high=MAX_TIME_S)
_FADE = FieldSpec(low=MIN_FADE_S, high=MAX_FADE_S)
_POSITION = FieldSpec(low=MIN_POSITION_S, high=MAX_POSITION_S)
_COUNT = FieldSpec(low=0, high=2**31 - 1)
_OVER = Duration(osc="over_us", json="over", low=MIN_DURATION_S, high=MAX_DURATION_S)


@dataclass(frozen=True, slots=True)
class Begin(Command):
    """Open an utterance. Utterances are said in the order in which they begin; ``"at"`` and ``"audio"`` do not wait."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="open an utterance", osc="/fap/1/utt/begin")
    utterance: int
    anchor: Anchor = "now"
    """Start of its time: when the one before it is over, at ``at_s``, or when its sound is heard to play."""
    at_s: Annotated[float, _AT] = 0.0
    """Engine time, for ``"at"``."""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Append(Command):
    """Phones of an utterance, by index: the same again changes nothing, so senders may repeat themselves."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="phones of an utterance", osc="/fap/1/phones")
    utterance: int
    first_index: int
    phones: tuple[Phone, ...]
    """Phones in the utterance's time. Silences count as phones."""
    revision: int = 0
    """Number of this version: a higher one than before replaces all phones still to come, a lower one is ignored."""


@dataclass(frozen=True, slots=True)
class End(Command):
    """Say that no phone with a higher index will come."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="no phone follows", osc="/fap/1/utt/end")
    utterance: int
    phone_count: Annotated[int, _COUNT]
    duration_s: Annotated[float, FieldSpec(low=0.0, high=MAX_POSITION_S)]
    """Length of the utterance, its last silence included."""
    revision: int = 0


VOICE_UTTERANCES = 1 << 30
"""First number of what the server's own voice says, so that it never meets a sender's."""


@dataclass(frozen=True, slots=True)
class Cancel(Command):
    """Stop speaking (barge-in). The same again changes nothing."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="stop speaking", osc="/fap/1/utt/cancel", json="cancel")
    utterance: int | None = None
    """Number of the utterance; None: all there are, or see ``first``."""
    at_s: Annotated[float | None, Time(low=-MAX_TIME_S, high=MAX_TIME_S)] = None
    """Engine time; None: at once."""
    fade_s: Annotated[float, _FADE] = 0.2
    """Time from there until the face is at rest."""
    first: int = 0
    """Lowest number that is cancelled, with None for the utterance."""

    def means(self, utterance: int) -> bool:
        """Whether an utterance is to stop."""
        return utterance >= self.first if self.utterance is None else utterance == self.utterance


@dataclass(frozen=True, slots=True)
class Pause(Command):
    """Stop where it is and come to rest; the queue waits."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="stop where it is", osc="/fap/1/utt/pause", json="pause", is_direct=True
    )
    fade_s: Annotated[float, Duration(osc="fade_ms", per_s=1000, low=MIN_FADE_S, high=MAX_FADE_S)] = 0.2


@dataclass(frozen=True, slots=True)
class Resume(Command):
    """Go on from where it was paused."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="go on", osc="/fap/1/utt/resume", json="resume", is_direct=True)


@dataclass(frozen=True, slots=True)
class Seek(Command):
    """Go on from another position of the utterance that is being said."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="go on from elsewhere", osc="/fap/1/utt/seek")
    utterance: int
    position_s: Annotated[float, _POSITION]


@dataclass(frozen=True, slots=True)
class Audio(Command):
    """Report where the sound of an utterance really is; the face follows it."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="`position_s` of the sound is heard at engine time `at_s`", osc="/fap/1/audio", json="audio"
    )
    utterance: Annotated[int, FieldSpec(json="utterance", low=0, high=2**32 - 1, is_whole=True)]
    at_s: Annotated[float, FieldSpec(json="at_s", low=-MAX_TIME_S, high=MAX_TIME_S)]
    """Engine time at which this was so."""
    position_s: Annotated[float, FieldSpec(json="position_s", low=MIN_POSITION_S, high=MAX_POSITION_S)]
    """Position in the utterance."""
    rate: Annotated[float, FieldSpec(json="rate", low=0.0, high=4.0)] = 1.0
    """Speed of the sound; 0: it stands still."""


@dataclass(frozen=True, slots=True)
class Express(Command):
    """Show an expression; a new one of the same name takes over from where the old one is."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="show an expression", osc="/fap/1/expr", one_shot="/expr", json="express",
        is_direct=True, is_repeatable=True, is_shown=True,
    )  # fmt: skip
    expression: Annotated[Expression, _EXPRESSION]
    level: Annotated[float, FieldSpec(osc="level", json="level", low=0.0, high=MAX_WEIGHT)] = 1.0
    """Share of the profile's full expression."""
    at_s: Annotated[float | None, Time(osc="at_us", doc="from its arrival; -1: at once")] = None
    """Engine time; None: at once."""
    attack_s: Annotated[float, Duration(osc="attack_us", low=MIN_DURATION_S, high=MAX_DURATION_S)] = 0.35
    hold_s: Annotated[float, EndlessDuration(osc="hold_us", low=0.0, doc="-1: until told otherwise")] = inf
    release_s: Annotated[float, Duration(osc="release_us", low=MIN_DURATION_S, high=MAX_DURATION_S)] = 0.5


@dataclass(frozen=True, slots=True)
class Look(Command):
    """Turn both eyes, against the head; as FAP 23 to 26 count."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="turn the eyes", osc="/fap/1/gaze", one_shot="/gaze", json="look", is_direct=True, is_repeatable=True
    )
    yaw_rad: Annotated[float, _TO_THE_LEFT]
    pitch_rad: Annotated[float, _DOWN]
    over_s: Annotated[float, _OVER] = 0.1


@dataclass(frozen=True, slots=True)
class Blink(Command):
    """Close both eyes once, now."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="close both eyes once", osc="/fap/1/blink", one_shot="/blink", json="blink", is_direct=True
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnHead(Command):
    """Turn the head, as FAP 48 to 50 count; what it does of itself is added."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="turn the head", osc="/fap/1/head", one_shot="/head", json="head",
        is_direct=True, is_repeatable=True, is_shown=True,
    )  # fmt: skip
    roll_rad: Annotated[float, _RIGHT_EAR_DOWN]
    pitch_rad: Annotated[float, _DOWN]
    yaw_rad: Annotated[float, _TO_THE_LEFT]
    over_s: Annotated[float, _OVER] = 0.4


@dataclass(frozen=True, slots=True)
class SetParameter(Command):
    """Change how a session speaks or moves from now on."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="articulation, jaw, lips (0 to 3), loudness_db; blinks, head_motion, gaze, idle, emphasis (0 or 1)",
        osc="/fap/1/param", one_shot="/param", json="manner",
        is_direct=True, is_repeatable=True, is_shown=True,
    )  # fmt: skip
    parameter: Annotated[str, _PARAMETER]
    value: Annotated[float, FieldSpec(osc="value", json="value", low=-20.0, high=20.0)]
    """Value as in :class:`fapengine.trajectory.style.Style`; 0 and 1 switch generators."""


COMMANDS: tuple[type[Command], ...] = (
    Begin, Append, End, Cancel, Pause, Resume, Seek, Audio, Express, Look, Blink, TurnHead, SetParameter,
)  # fmt: skip
"""The list."""


def without_neutral(command: Command) -> tuple[Command, ...]:
    """Give the commands for the engine: "neutral" takes all expressions away."""
    if not isinstance(command, Express) or command.expression != Expression.NEUTRAL:
        return (command,)
    return tuple(replace(command, expression=expression, level=0.0) for expression in EXPRESSIONS.values())


def expression_named(name: str) -> Expression:
    """Find an expression by one of its names.

    Raises
    ------
    DataError
        If there is no such expression.
    """
    expression: Expression = _EXPRESSION.named(name)
    return expression
