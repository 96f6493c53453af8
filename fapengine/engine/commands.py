"""The list of all commands to a live face (:mod:`.command_table` explains how it is read).

*Engine time* is the clock that drives the engine. A field without a specification is not sent outside Python, or is
sent by a message that belongs to one sender.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, ClassVar, Literal

from fapengine._strict_toml import checked
from fapengine.engine.command_table import Angle, Choice, CommandSpec, Duration, EndlessDuration, FieldSpec, Time
from fapengine.engine.command_table import Command as Command
from fapengine.errors import DataError, UsageError
from fapengine.expressions import EXPRESSION_NAMES, EXPRESSIONS, Expression
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.expression import MAX_WEIGHT

Anchor = Literal["now", "at", "audio"]
PARAMETERS = (
    "articulation", "jaw", "lips", "loudness_db", "liveliness", "blinks", "head_motion", "gaze", "idle", "emphasis",
)  # fmt: skip
"""Parameters of :class:`SetParameter`: fields of :class:`fapengine.trajectory.style.Style`."""
MAX_TURN_RAD = 1.5
MIN_DURATION_S, MAX_DURATION_S = 0.01, 60.0
"""Bounds of ramps and fades."""
MIN_FADE_S, MAX_FADE_S = 0.01, 10.0
MAX_TIME_S = 1e12
"""Largest absolute engine time: beyond it a double cannot distinguish one frame from the next."""
MIN_POSITION_S, MAX_POSITION_S = -3600.0, 86_400.0
"""Bounds of positions in an utterance."""
_TO_THE_LEFT = Angle(osc="yaw_deg", json="yaw", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="to the subject's left")
_DOWN = Angle(osc="pitch_deg", json="pitch", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="down")
_RIGHT_EAR_DOWN = Angle(osc="roll_deg", json="roll", low=-MAX_TURN_RAD, high=MAX_TURN_RAD, doc="right ear down")
_EXPRESSION = Choice(
    what="expression",
    osc="name",
    json="name",
    values={expression.label: expression for expression in EXPRESSIONS},
    synonyms={name: expression for expression in (*EXPRESSIONS, Expression.NEUTRAL) for name in expression.synonyms},
    doc=f"{', '.join(EXPRESSION_NAMES)} or neutral",
)
_PARAMETER = Choice(what="parameter", osc="key", json="setting", values={name: name for name in PARAMETERS})
_AT = FieldSpec(low=-MAX_TIME_S, high=MAX_TIME_S)
_FADE = FieldSpec(low=MIN_FADE_S, high=MAX_FADE_S)
_POSITION = FieldSpec(low=MIN_POSITION_S, high=MAX_POSITION_S)
_COUNT = FieldSpec(low=0, high=2**31 - 1)
_OVER = Duration(osc="over_us", json="over", low=MIN_DURATION_S, high=MAX_DURATION_S)


@dataclass(frozen=True, slots=True)
class Begin(Command):
    """Open an utterance. Utterances play in the order of their ``Begin``; ``"at"`` and ``"audio"`` do not wait."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="open an utterance", osc="/fap/1/utt/begin")
    utterance: int
    anchor: Anchor = "now"
    """Its start: the end of the one before, ``at_s``, or the start of its audio."""
    at_s: Annotated[float, _AT] = 0.0
    """Engine time, for ``"at"``."""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Append(Command):
    """Phones of an utterance, by index. Repeating them changes nothing."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="phones of an utterance", osc="/fap/1/phones")
    utterance: int
    first_index: int
    phones: tuple[Phone, ...]
    """Phones in the utterance's time. Silences count as phones."""
    revision: int = 0
    """Version: a higher one replaces all phones still to come, a lower one is ignored."""
    keeps_earlier: bool = False
    """Whether a higher revision replaces only the phones from ``first_index`` on, also one that is being said."""


@dataclass(frozen=True, slots=True)
class End(Command):
    """Announce that no phone with a higher index will come."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="no phone follows", osc="/fap/1/utt/end")
    utterance: int
    phone_count: Annotated[int, _COUNT]
    duration_s: Annotated[float, FieldSpec(low=0.0, high=MAX_POSITION_S)]
    """Duration of the utterance, with its last silence."""
    revision: int = 0


VOICE_UTTERANCES = 1 << 30
"""First utterance number of the server's own voice; senders use lower ones."""


@dataclass(frozen=True, slots=True)
class Cancel(Command):
    """Stop speaking (barge-in). Repeating it changes nothing."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="stop speaking", osc="/fap/1/utt/cancel", json="cancel")
    utterance: int | None = None
    """Number of the utterance; None cancels all from ``first`` on."""
    at_s: Annotated[float | None, Time(low=-MAX_TIME_S, high=MAX_TIME_S)] = None
    """Engine time; None: now."""
    fade_s: Annotated[float, _FADE] = 0.2
    """Duration of the return to neutral."""
    first: int = 0
    """Lowest utterance number that is cancelled, if ``utterance`` is None."""

    def means(self, utterance: int) -> bool:
        """Whether the command stops an utterance."""
        return utterance >= self.first if self.utterance is None else utterance == self.utterance


@dataclass(frozen=True, slots=True)
class Pause(Command):
    """Pause at the current position and return to neutral; the queue waits."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="stop where it is", osc="/fap/1/utt/pause", json="pause", is_direct=True
    )
    fade_s: Annotated[float, Duration(osc="fade_ms", per_s=1000, low=MIN_FADE_S, high=MAX_FADE_S)] = 0.2


@dataclass(frozen=True, slots=True)
class Resume(Command):
    """Continue from the paused position."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="continue", osc="/fap/1/utt/resume", json="resume", is_direct=True)


@dataclass(frozen=True, slots=True)
class Seek(Command):
    """Continue from another position of the current utterance."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(doc="continue from another position", osc="/fap/1/utt/seek")
    utterance: int
    position_s: Annotated[float, _POSITION]


@dataclass(frozen=True, slots=True)
class Audio(Command):
    """Report the position of an utterance's audio; the face follows it."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="`position_s` of the sound is heard at engine time `at_s`", osc="/fap/1/audio", json="audio"
    )
    utterance: Annotated[int, FieldSpec(json="utterance", low=0, high=2**32 - 1, is_whole=True)]
    at_s: Annotated[float, FieldSpec(json="at_s", low=-MAX_TIME_S, high=MAX_TIME_S)]
    """Engine time of the measurement."""
    position_s: Annotated[float, FieldSpec(json="position_s", low=MIN_POSITION_S, high=MAX_POSITION_S)]
    """Position in the utterance."""
    rate: Annotated[float, FieldSpec(json="rate", low=0.0, high=4.0)] = 1.0
    """Playback speed; 0: paused."""


@dataclass(frozen=True, slots=True)
class Express(Command):
    """Show an expression. A new one of the same name continues from the current level."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="show an expression", osc="/fap/1/expr", one_shot="/expr", json="express",
        is_direct=True, is_repeatable=True, is_shown=True,
    )  # fmt: skip
    expression: Annotated[Expression, _EXPRESSION]
    level: Annotated[float, FieldSpec(osc="level", json="level", low=0.0, high=MAX_WEIGHT)] = 1.0
    """Fraction of the profile's full expression."""
    at_s: Annotated[float | None, Time(osc="at_us", doc="from its arrival; -1: at once")] = None
    """Engine time; None: now."""
    attack_s: Annotated[float, Duration(osc="attack_us", low=MIN_DURATION_S, high=MAX_DURATION_S)] = 0.35
    hold_s: Annotated[float, EndlessDuration(osc="hold_us", low=0.0, doc="-1: until the next command")] = inf
    release_s: Annotated[float, Duration(osc="release_us", low=MIN_DURATION_S, high=MAX_DURATION_S)] = 0.5


@dataclass(frozen=True, slots=True)
class Look(Command):
    """Turn both eyes relative to the head; signs as FAP 23 to 26."""

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
    """Turn the head; signs as FAP 48 to 50. Automatic head motion is added."""

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
        doc="articulation, jaw, lips (0 to 3), loudness_db, liveliness (0 to 1); "
        "blinks, head_motion, gaze, idle, emphasis (0 or 1)",
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
    """Expand "neutral" into one command per expression, with level 0."""
    if not isinstance(command, Express) or command.expression != Expression.NEUTRAL:
        return (command,)
    return tuple(replace(command, expression=expression, level=0.0) for expression in EXPRESSIONS)


def expression_named(name: str) -> Expression:
    """Find an expression by one of its names. Raises DataError if there is no such expression."""
    expression: Expression = _EXPRESSION.from_osc(name)
    return expression


class GestureMethods(ABC):
    """Methods that make gestures, one command each. Angles are in radians, times in seconds."""

    @abstractmethod
    def send_command(self, command: Command) -> None:
        """Send a command of :mod:`fapengine.engine.commands` to the face."""

    @checked
    def express(
        self,
        name: str | Expression,
        level: float = 1.0,
        *,
        attack_s: float = 0.35,
        hold_s: float | None = None,
        release_s: float = 0.5,
    ) -> None:
        """Show an expression; ``"neutral"`` ends all of them.

        Parameters
        ----------
        name : str or Expression
            ``"joy"``, or another of :class:`fapengine.Expression`.
        level : float
            0 to 2.
        attack_s, release_s : float
            Durations of its rise and fall.
        hold_s : float, optional
            Duration at full level; None holds it until another level is set.

        Raises
        ------
        UsageError
            If there is no such expression, or the level is out of range.
        """
        if isinstance(name, str):
            try:
                name = expression_named(name)
            except DataError as error:
                raise UsageError(str(error)) from error
        self.send_command(Express(name, level, None, attack_s, inf if hold_s is None else hold_s, release_s))

    @checked
    def look(self, yaw_rad: float, pitch_rad: float, *, over_s: float = 0.1) -> None:
        """Turn the eyes, to the subject's left and down."""
        self.send_command(Look(yaw_rad, pitch_rad, over_s))

    @checked
    def turn_head(
        self, *, pitch_rad: float = 0.0, yaw_rad: float = 0.0, roll_rad: float = 0.0, over_s: float = 0.4
    ) -> None:
        """Turn the head: down, to the subject's left, right ear down."""
        self.send_command(TurnHead(roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad, over_s=over_s))

    def blink(self) -> None:
        """Close both eyes once."""
        self.send_command(Blink())

    @checked
    def set_parameter(self, parameter: str, value: float) -> None:
        """Change a value of :class:`fapengine.Style`; 0 and 1 switch its automatic movements.

        Raises
        ------
        UsageError
            If there is no such parameter, or the value is out of range.
        """
        self.send_command(SetParameter(parameter, value))
