"""One method for each gesture, for all that can be told commands: a face of this process, and a face behind a wire."""

from abc import ABC, abstractmethod
from math import inf

from fapengine.errors import DataError, UsageError
from fapengine.live.engine.command_table import Command
from fapengine.live.engine.commands import Blink, Express, Look, SetParameter, TurnHead, expression_named
from fapengine.mpeg4.visemes import Expression


class GestureMethods(ABC):
    """Methods that make gestures, each by one command; angles are in radians, times in seconds."""

    @abstractmethod
    def tell(self, command: Command) -> None:
        """Tell the face a command of :mod:`fapengine.live.engine.commands`."""

    def express(
        self,
        name: str | Expression,
        level: float = 1.0,
        *,
        attack_s: float = 0.35,
        hold_s: float | None = None,
        release_s: float = 0.5,
    ) -> None:
        """Show joy, sadness, anger, fear, disgust, surprise or neutral, up to level 2.

        Parameters
        ----------
        name : str or Expression
        level : float
            0 to 2.
        attack_s, release_s : float
            Times in which it comes and goes.
        hold_s : float, optional
            Time for which it is held; None: until another level is set.

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
        self.tell(Express(name, level, None, attack_s, inf if hold_s is None else hold_s, release_s))

    def look(self, yaw_rad: float, pitch_rad: float, *, over_s: float = 0.1) -> None:
        """Turn the eyes, to the subject's left and down."""
        self.tell(Look(yaw_rad, pitch_rad, over_s))

    def turn_head(
        self, *, pitch_rad: float = 0.0, yaw_rad: float = 0.0, roll_rad: float = 0.0, over_s: float = 0.4
    ) -> None:
        """Turn the head: down, to the subject's left, right ear down."""
        self.tell(TurnHead(roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad, over_s=over_s))

    def blink(self) -> None:
        """Close both eyes once."""
        self.tell(Blink())

    def set_parameter(self, parameter: str, value: float) -> None:
        """Change a number of :class:`fapengine.Style`, or switch one of its generators with 0 and 1.

        Raises
        ------
        UsageError
            If there is no such parameter, or the value is out of range.
        """
        self.tell(SetParameter(parameter, value))
