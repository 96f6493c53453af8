"""One method per gesture, shared by every face that accepts commands, local or remote."""

from abc import ABC, abstractmethod
from math import inf

from fapengine._strict_toml import checked
from fapengine.engine.command_table import Command
from fapengine.engine.commands import Blink, Express, Look, SetParameter, TurnHead, expression_named
from fapengine.errors import DataError, UsageError
from fapengine.expressions import Expression


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
