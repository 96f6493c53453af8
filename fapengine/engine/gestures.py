"""Motion besides speech, for all sessions at once: expressions, gaze, blinks, head turns, gestures.

Gestures are those of :mod:`fapengine.trajectory.gestures`, drawn as time goes by. Commands join them, each as ramps
(:func:`command_ramps`): those of a live sender, and those of the inline cues of a text
(:mod:`fapengine.speech.marks`). Each session has a row of :class:`~fapengine.trajectory.ramps.Ramps`.
"""

from collections.abc import Iterable
from math import isfinite

import numpy as np

from fapengine.engine.commands import Blink, Command, Express, Look, TurnHead
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.profiles import Profile
from fapengine.speech.marks import Feel, Gesture, TimedMark
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.expression import ATTACK_S, RELEASE_S, expression_faps, has_expression
from fapengine.trajectory.faps import Overlay
from fapengine.trajectory.gestures import Channel, GestureGenerator, blink, gesture_faps, start_levels, varied_faps
from fapengine.trajectory.ramps import Ramp, Ramps
from fapengine.trajectory.style import Style

EASE_S = 0.3
"""Time over which a changed style takes effect."""
NOD_RAD, SHAKE_RAD, GLANCE_RAD = 0.14, 0.13, 0.3
"""Angles of inline cues that are visible without being exaggerated; chosen by eye."""
NOD_S, SHAKE_S, GLANCE_S = 0.2, 0.22, 0.8
"""Duration of the downward nod, of each turn of a shake, of a glance."""
PAST_S = 60.0
"""Age beyond which gestures that were never shown are dropped."""
MIN_HOLD_S = 0.3
_GLANCES = {"left": (GLANCE_RAD, 0.0), "right": (-GLANCE_RAD, 0.0), "up": (0.0, -GLANCE_RAD), "down": (0.0, GLANCE_RAD)}


def commands_of(marks: Iterable[TimedMark]) -> list[tuple[float, Command]]:
    """Turn inline cues into commands.

    Returns
    -------
    list of (float, Command)
        Time in the speech, s, 0 or later, and the command; in order of time. An expression starts
        :data:`fapengine.trajectory.expression.ATTACK_S` before its word, so that it is complete when the word starts.

    Examples
    --------
    >>> [(at_s, type(command).__name__) for at_s, command in commands_of([TimedMark(1.0, Gesture("nod"), 2.0)])]
    [(1.0, 'TurnHead'), (1.2, 'TurnHead')]
    """
    told: list[tuple[float, Command]] = []
    for mark in marks:
        at_s, act = mark.at_s, mark.act
        if isinstance(act, Feel) and act.expression != Expression.NEUTRAL:
            begins_s = max(at_s - ATTACK_S, 0.0)
            hold_s = max(mark.until_s - begins_s - ATTACK_S - RELEASE_S, MIN_HOLD_S)
            told.append((begins_s, Express(act.expression, act.level, None, ATTACK_S, hold_s, RELEASE_S)))
        elif isinstance(act, Gesture):
            told += _gesture(act.name, at_s)
    return sorted(told, key=lambda entry: entry[0])


def _gesture(name: str, at_s: float) -> list[tuple[float, Command]]:
    if name == "nod":
        return [(at_s, _turned(pitch_rad=NOD_RAD, over_s=NOD_S)), (at_s + NOD_S, _turned(over_s=1.5 * NOD_S))]
    if name == "shake":
        ways = (SHAKE_RAD, -SHAKE_RAD, SHAKE_RAD / 2, 0.0)
        return [(at_s + n * SHAKE_S, _turned(yaw_rad=way, over_s=SHAKE_S)) for n, way in enumerate(ways)]
    if name == "blink":
        return [(at_s, Blink())]
    return [(at_s, Look(*_GLANCES[name])), (at_s + GLANCE_S, Look(0.0, 0.0))]


def _turned(*, pitch_rad: float = 0.0, yaw_rad: float = 0.0, over_s: float) -> TurnHead:
    return TurnHead(roll_rad=0.0, pitch_rad=pitch_rad, yaw_rad=yaw_rad, over_s=over_s)


def command_ramps(command: Command, at_s: float) -> list[Ramp]:
    """Return the ramps of a gesture or expression that begins at a time; none for another command."""
    match command:
        case Express():
            channel = EXPRESSIONS.index(command.expression)
            ramps = [Ramp(at_s, channel, command.level, command.attack_s, takes_over=True)]
            if isfinite(command.hold_s):
                ramps.append(Ramp(at_s + command.attack_s + command.hold_s, channel, 0.0, command.release_s))
            return ramps
        case Look():
            angles = ((Channel.LOOK_YAW, command.yaw_rad), (Channel.LOOK_PITCH, command.pitch_rad))
            return [Ramp(at_s, channel, rad, command.over_s) for channel, rad in angles]
        case TurnHead():
            turns = (
                (Channel.PITCH, command.pitch_rad), (Channel.YAW, command.yaw_rad), (Channel.ROLL, command.roll_rad)
            )  # fmt: skip
            return [Ramp(at_s, channel, rad, command.over_s) for channel, rad in turns]
        case Blink():
            return list(blink(at_s))
    return []


class BatchGestures:
    """Expressions and gestures of many sessions; the last row moves where one closes, as in ``BatchPlanner``.

    Stateful.

    Parameters
    ----------
    profile : Profile
        Of all sessions.
    style : Style
        Of every session at first.
    """

    def __init__(self, profile: Profile, style: Style) -> None:
        self._style = style
        self._ramps = Ramps(start_levels(style))
        self._expression_faps = expression_faps(profile)
        self._expressions = frozenset(one for one in EXPRESSIONS if has_expression(profile, one))
        self._generators: list[GestureGenerator] = []
        self._due_s = np.zeros(0)
        self._begun_s = np.zeros(0)
        self._waves = np.zeros((2, 0, 0))

    def open(self, now_s: float, rng: np.random.Generator) -> None:
        """Add a row."""
        generator = GestureGenerator(rng, self._style, begins_s=now_s)
        self._ramps.send(self._ramps.open(), generator.begin())
        waves = generator.waves[..., None]
        self._waves = np.concatenate([self._waves, waves], axis=-1) if self._generators else waves
        self._generators.append(generator)
        self._due_s = np.append(self._due_s, generator.due_s)
        self._begun_s = np.append(self._begun_s, now_s)

    def close(self, row: int) -> None:
        """Remove a row."""
        self._ramps.close(row)
        self._generators[row] = self._generators[-1]
        self._generators.pop()
        for array in (self._due_s, self._begun_s, self._waves):
            array[..., row] = array[..., -1]
        self._due_s, self._begun_s, self._waves = self._due_s[:-1], self._begun_s[:-1], self._waves[..., :-1]

    def make(self, row: int, command: Command, now_s: float) -> None:
        """Make a gesture, or show an expression. Raises UsageError if the profile does not have the expression."""
        at_s = now_s
        if isinstance(command, Express):
            if command.expression not in self._expressions:
                raise UsageError(f"expression: got {command.expression.label}, which the profile does not have")
            at_s = max(now_s if command.at_s is None else command.at_s, now_s)
        self._ramps.send(row, command_ramps(command, at_s))

    def behave(self, row: int, style: Style, now_s: float) -> None:
        """Change the style."""
        levels = start_levels(style)
        gains = [Ramp(now_s, channel, float(levels[channel]), EASE_S) for channel in (Channel.JAW, Channel.LIPS)]
        self._ramps.send(row, [*gains, *self._generators[row].restyle(style, now_s, EASE_S)])

    def hear(self, row: int, phones: Iterable[tuple[float, Phone]], now_s: float) -> None:
        """Add phones that have become known: engine time at which each begins, and the phone."""
        generator = self._generators[row]
        generator.hear(phones, now_s)
        self._due_s[row] = generator.due_s

    def forget(self, row: int, from_s: float) -> None:
        """Forget phones that begin at or after an engine time; others will come instead."""
        self._generators[row].forget(from_s)
        self._due_s[row] = self._generators[row].due_s

    def hush(self, row: int, now_s: float) -> None:
        """Forget what was to be said."""
        self._ramps.send(row, self._generators[row].hush(now_s))
        self._due_s[row] = self._generators[row].due_s

    def end(self, row: int, at_s: float, now_s: float) -> None:
        """End all gestures by a time; none follows."""
        generator = self._generators[row]
        self._ramps.send(row, generator.end(at_s, now_s))
        self._due_s[row] = generator.due_s

    def draw(self, row: int, now_s: float) -> None:
        """Draw the gestures that have become due; after a sleep of the machine, the last ones."""
        generator = self._generators[row]
        generator.skip_to(now_s - PAST_S)
        self._ramps.send(row, [ramp for ramp in generator.draw(now_s) if ramp.at_s > now_s - PAST_S])
        self._due_s[row] = generator.due_s

    def overlay(self, now_s: float) -> Overlay:
        """Everything but speech, of all rows, at a time that never goes back."""
        for row in (self._due_s <= now_s).nonzero()[0]:
            self.draw(int(row), now_s)
        levels = self._ramps.values(now_s)
        at = levels, self._waves, now_s - self._begun_s
        expression = self._expression_faps @ levels[: len(EXPRESSIONS)] + varied_faps(*at)
        return Overlay(expression, gesture_faps(*at), levels[Channel.JAW], levels[Channel.LIPS])
