"""The states of an utterance and all transitions between them.

Every change of state goes through :func:`next_state`; no other module decides what may follow what.
A transition that is not in the table is a bug of the engine: the session that meets it ends as a
:class:`.engine.Fault`.

::

    new ──begin──> waiting ──place──> placed ──start──> speaking
     └────────────place──────────────────┘ │ ^            │ ^
                                     pause v │ place pause v │ place
                                           held          paused

    any of them ──close──> over
"""

from enum import Enum
from types import MappingProxyType


class UtteranceState(Enum):
    """State of an utterance."""

    NEW = "new"
    """Phones or an end have come, but no ``Begin``."""
    WAITING = "waiting"
    """Begun; its place in the session's time is not known yet."""
    PLACED = "placed"
    """Its place is known; its time has not been reached."""
    SPEAKING = "speaking"
    """Its time has been reached. Stays so when phones are missing."""
    HELD = "held"
    """Paused before it started."""
    PAUSED = "paused"
    """Paused after it started."""
    OVER = "over"
    """Finished, cancelled or given up."""

    @property
    def is_placed(self) -> bool:
        """Whether it has a place in the session's time."""
        return self in (UtteranceState.PLACED, UtteranceState.SPEAKING)

    @property
    def has_started(self) -> bool:
        """Whether a part of it has been shown."""
        return self in (UtteranceState.SPEAKING, UtteranceState.PAUSED)

    @property
    def is_stopped(self) -> bool:
        """Whether it keeps a position from which it will resume."""
        return self in (UtteranceState.HELD, UtteranceState.PAUSED)


class Step(Enum):
    """A step that changes the state of an utterance."""

    BEGIN = "begin"
    PLACE = "place"
    """Give it a place in the session's time, or another one."""
    UNPLACE = "unplace"
    """Take its place away: what came before it has changed."""
    START = "start"
    PAUSE = "pause"
    CLOSE = "close"


_S = UtteranceState
TRANSITIONS = MappingProxyType(
    {
        _S.NEW: {Step.BEGIN: _S.WAITING, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.WAITING: {Step.BEGIN: _S.WAITING, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.PLACED: {
            Step.BEGIN: _S.PLACED,  # its sound came before its Begin
            Step.PLACE: _S.PLACED,
            Step.UNPLACE: _S.WAITING,
            Step.START: _S.SPEAKING,
            Step.PAUSE: _S.HELD,
            Step.CLOSE: _S.OVER,
        },
        _S.SPEAKING: {
            Step.BEGIN: _S.SPEAKING,
            Step.PLACE: _S.SPEAKING,
            Step.PAUSE: _S.PAUSED,
            Step.CLOSE: _S.OVER,
        },
        _S.HELD: {Step.BEGIN: _S.HELD, Step.PLACE: _S.PLACED, Step.CLOSE: _S.OVER},
        _S.PAUSED: {Step.BEGIN: _S.PAUSED, Step.PLACE: _S.SPEAKING, Step.CLOSE: _S.OVER},
        _S.OVER: {},
    }
)
"""The state after each step, by the state before it."""


def next_state(state: UtteranceState, step: Step) -> UtteranceState:
    """Return the state that follows.

    Raises
    ------
    RuntimeError
        If the step is impossible in this state.
    """
    following = TRANSITIONS[state].get(step)
    if following is None:
        raise RuntimeError(f"utterance: cannot {step.value} while {state.value}")
    return following
