"""Inline cues of a text (:mod:`fapengine.speech.marks`) to commands, and commands to the ramps of an offline plan."""

from collections.abc import Iterable

from fapengine.engine.commands import Blink, Command, Express, Look, TurnHead
from fapengine.expressions import Expression
from fapengine.speech.marks import Feel, Gesture, TimedMark
from fapengine.trajectory.expression import ATTACK_S, RELEASE_S
from fapengine.trajectory.gestures import Channel, blink
from fapengine.trajectory.ramps import Ramp

NOD_RAD, SHAKE_RAD, GLANCE_RAD = 0.14, 0.13, 0.3
"""Angles that are visible without being exaggerated; chosen by eye."""
NOD_S, SHAKE_S, GLANCE_S = 0.2, 0.22, 0.8
"""Duration of the downward nod, of each turn of a shake, of a glance."""
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
    """Return the ramps of a gesture made at a time; none for a command that is not a gesture."""
    if isinstance(command, Look):
        angles = ((Channel.LOOK_YAW, command.yaw_rad), (Channel.LOOK_PITCH, command.pitch_rad))
        return [Ramp(at_s, channel, rad, command.over_s) for channel, rad in angles]
    if isinstance(command, TurnHead):
        turns = (
            (Channel.PITCH, command.pitch_rad), (Channel.YAW, command.yaw_rad), (Channel.ROLL, command.roll_rad)
        )  # fmt: skip
        return [Ramp(at_s, channel, rad, command.over_s) for channel, rad in turns]
    return list(blink(at_s)) if isinstance(command, Blink) else []
