"""What a face does between its own words: it looks at who speaks, nods while it listens, looks aside while it thinks.

Listeners look at the speaker most of the time, and speakers look away while they plan (Kendon, "Some functions of
gaze-direction in social interaction", Acta Psychologica 26, 1967).
"""

from typing import Literal, get_args

import numpy as np

from fapengine.engine.commands import Command, Look, SetParameter, TurnHead
from fapengine.engine.gestures import commands_of
from fapengine.errors import UsageError
from fapengine.speech.marks import Gesture, TimedMark

State = Literal["idle", "listening", "thinking", "speaking"]
FIRST_NOD_S, NODS_S = 1.5, (2.5, 5.0)
"""Time from the beginning of listening to the first nod, and range of the times between two nods."""
THINKS_S = 10.0
"""Longest time of thinking: after it nothing is said, and the face looks at the user again."""
ASIDE_RAD, UP_RAD, TURN_RAD = 0.25, 0.12, 0.06
"""Gaze to the side and up, and turn of the head, while it thinks; chosen by eye."""
TURNS_S = 0.5


class Attention:
    """The state of a conversation as commands to a face. Stateful.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the side of a look and the times of nods.
    gaze : bool
        Whether glances are on while nobody listens or thinks.

    Examples
    --------
    >>> attention = Attention(np.random.default_rng(1))
    >>> attention.attend("listening")
    >>> [type(command).__name__ for command in attention.due(0.0)]
    ['SetParameter', 'Look', 'TurnHead']
    >>> attention.due(1.0), len(attention.due(1.6))
    ([], 1)
    """

    def __init__(self, rng: np.random.Generator, *, gaze: bool = True) -> None:
        self.state: State = "idle"
        self._rng, self._gaze = rng, gaze
        self._is_new = False
        self._since_s = self._nod_s = 0.0
        self._later: list[tuple[float, Command]] = []

    def attend(self, state: State) -> None:
        """Change the state. Raises UsageError if there is no such state."""
        if state not in get_args(State):
            raise UsageError(f"state: got {state!r}, expected one of {', '.join(get_args(State))}")
        self._is_new = self._is_new or state != self.state
        self.state = state

    def end(self, state: State) -> None:
        """Change to ``"idle"`` if this is the state."""
        if state == self.state:
            self.attend("idle")

    def due(self, now_s: float) -> list[Command]:
        """Return the commands that are due."""
        if self.state == "thinking" and not self._is_new and now_s - self._since_s > THINKS_S:
            self.attend("idle")
        if self._is_new:
            self._is_new, self._since_s, self._nod_s = False, now_s, now_s + FIRST_NOD_S
            self._later.clear()
            return self._turn()
        if self.state == "listening" and now_s >= self._nod_s:
            self._later += commands_of([TimedMark(now_s, Gesture("nod"), now_s)])
            self._nod_s = now_s + self._rng.uniform(*NODS_S)
        due = [command for at_s, command in self._later if at_s <= now_s]
        self._later = [entry for entry in self._later if entry[0] > now_s]
        return due

    def _turn(self) -> list[Command]:
        """Return the commands with which the state begins."""
        side = float(self._rng.choice((-1.0, 1.0))) if self.state == "thinking" else 0.0
        glances = self._gaze and self.state in ("idle", "speaking")
        return [
            SetParameter("gaze", float(glances)),
            Look(side * ASIDE_RAD, -abs(side) * UP_RAD, TURNS_S / 2),
            TurnHead(roll_rad=0.0, pitch_rad=0.0, yaw_rad=side * TURN_RAD, over_s=TURNS_S),
        ]
