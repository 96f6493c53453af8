"""What faces do beside speaking, for all sessions at once: expressions, gaze, blinks, turns of the head, gestures.

Gestures are those of :mod:`fapengine.trajectory.gestures`, drawn as time goes by; here commands join them. Each session
has a row of :class:`~fapengine.trajectory.ramps.Ramps`.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fapengine.engine.commands import Blink, Express, Look, TurnHead
from fapengine.engine.marked import command_ramps
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS
from fapengine.profiles import Profile
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.compose import Overlay
from fapengine.trajectory.expression import expression_faps, has_expression
from fapengine.trajectory.gestures import Channel, GestureGenerator, gesture_faps, start_levels
from fapengine.trajectory.ramps import Ramp, Ramps
from fapengine.trajectory.style import Style

Array = NDArray[np.float64]

EASE_S = 0.3
"""Time over which a changed style takes hold."""


class BatchGestures:
    """Expressions and gestures of many sessions; the last row moves where one closes, as in ``BatchPlanner``.

    Stateful.

    Parameters
    ----------
    profile : Profile
        Where the expressions lie.
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
        """Take a row away."""
        self._ramps.close(row)
        self._generators[row] = self._generators[-1]
        self._generators.pop()
        for array in (self._due_s, self._begun_s, self._waves):
            array[..., row] = array[..., -1]
        self._due_s, self._begun_s, self._waves = self._due_s[:-1], self._begun_s[:-1], self._waves[..., :-1]

    def express(self, row: int, request: Express, now_s: float) -> None:
        """Let an expression come, hold and go.

        Raises
        ------
        UsageError
            If the profile does not have it.
        """
        if request.expression not in self._expressions:
            raise UsageError(f"expression: got {request.expression.label}, which the profile does not have")
        at_s = max(now_s if request.at_s is None else request.at_s, now_s)
        channel = EXPRESSIONS.index(request.expression)
        ramps = [Ramp(at_s, channel, request.level, request.attack_s, takes_over=True)]
        if np.isfinite(request.hold_s):
            ramps.append(Ramp(at_s + request.attack_s + request.hold_s, channel, 0.0, request.release_s))
        self._ramps.send(row, ramps)

    def look(self, row: int, request: Look, now_s: float) -> None:
        """Turn the eyes."""
        self._ramps.send(row, command_ramps(request, now_s))

    def turn_head(self, row: int, request: TurnHead, now_s: float) -> None:
        """Turn the head."""
        self._ramps.send(row, command_ramps(request, now_s))

    def blink(self, row: int, request: Blink, now_s: float) -> None:
        """Close the eyes once."""
        self._ramps.send(row, command_ramps(request, now_s))

    def behave(self, row: int, style: Style, now_s: float) -> None:
        """Take a new style over."""
        levels = start_levels(style)
        gains = [Ramp(now_s, channel, float(levels[channel]), EASE_S) for channel in (Channel.JAW, Channel.LIPS)]
        self._ramps.send(row, [*gains, *self._generators[row].restyle(style, now_s, EASE_S)])

    def hear(self, row: int, phones: Iterable[tuple[float, Phone]], now_s: float) -> None:
        """Take phones that have become known: engine time at which each begins, and the phone."""
        generator = self._generators[row]
        generator.hear(phones, now_s)
        self._due_s[row] = generator.due_s

    def hush(self, row: int, now_s: float) -> None:
        """Forget what was to be said."""
        self._ramps.send(row, self._generators[row].hush(now_s))
        self._due_s[row] = self._generators[row].due_s

    def end(self, row: int, at_s: float, now_s: float) -> None:
        """Let all gestures come to rest by a time; none follows."""
        generator = self._generators[row]
        self._ramps.send(row, generator.end(at_s, now_s))
        self._due_s[row] = generator.due_s

    def draw(self, row: int, now_s: float) -> None:
        """Let come what has become due."""
        generator = self._generators[row]
        self._ramps.send(row, generator.draw(now_s))
        self._due_s[row] = generator.due_s

    def overlay(self, now_s: float) -> Overlay:
        """Everything but speech, of all rows, at a time that never goes back."""
        for row in np.flatnonzero(self._due_s <= now_s):
            self.draw(int(row), now_s)
        levels = self._ramps.values(now_s)
        expression = self._expression_faps @ levels[: len(EXPRESSIONS)]
        gestures = gesture_faps(levels, self._waves, now_s - self._begun_s)
        return Overlay(expression, gestures, levels[Channel.JAW], levels[Channel.LIPS])
