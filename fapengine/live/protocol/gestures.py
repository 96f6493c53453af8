"""What faces do beside speaking: messages to commands."""

import math

from fapengine.errors import DataError
from fapengine.live.engine.commands import MANNERS, Blink, Command, Express, Look, Manner, TurnHead
from fapengine.live.protocol import labels
from fapengine.live.protocol.schema import BlinkOnce, Gaze, HeadTurn, SetExpression, SetParameter
from fapengine.mpeg4.visemes import Expression

Gesture = SetExpression | Gaze | BlinkOnce | HeadTurn | SetParameter
GESTURES = (SetExpression, Gaze, BlinkOnce, HeadTurn, SetParameter)


def to_commands(gesture: Gesture, now_s: float) -> list[Command]:
    """Give the engine's commands.

    Raises
    ------
    DataError
        If there is no such expression or parameter.
    """
    match gesture:
        case SetExpression():
            return _express(gesture, now_s)
        case Gaze():
            yaw_rad, pitch_rad = math.radians(gesture.yaw_deg), math.radians(gesture.pitch_deg)
            return [Look(yaw_rad, pitch_rad, gesture.over_us / 1e6)]
        case BlinkOnce():
            return [Blink()]
        case HeadTurn():
            pitch_rad, yaw_rad, roll_rad = map(math.radians, (gesture.pitch_deg, gesture.yaw_deg, gesture.roll_deg))
            return [TurnHead(pitch_rad, yaw_rad, roll_rad, gesture.over_us / 1e6)]
        case SetParameter():
            if gesture.key not in MANNERS:
                raise DataError(f"parameter: got {gesture.key!r:.40}, expected one of {', '.join(MANNERS)}")
            return [Manner(gesture.key, gesture.value)]


def _express(gesture: SetExpression, now_s: float) -> list[Command]:
    expression = labels.EXPRESSIONS.get(gesture.name.strip().lower())
    if expression is None:
        raise DataError(f"expression: got {gesture.name!r:.40}, expected one of {', '.join(labels.EXPRESSIONS)}")
    at_s = now_s + gesture.at_us / 1e6 if gesture.at_us > 0 else None
    attack_s, release_s = gesture.attack_us / 1e6, gesture.release_us / 1e6
    hold_s = math.inf if gesture.hold_us < 0 else gesture.hold_us / 1e6
    if expression == Expression.NEUTRAL:  # all others go
        return [Express(other, 0.0, at_s, attack_s) for other in Expression if other]
    return [Express(expression, gesture.level, at_s, attack_s, hold_s, release_s)]
