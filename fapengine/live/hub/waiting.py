"""What waits in a session for its time: utterances for their sound, commands for their place in an utterance."""

from collections.abc import Iterable
from dataclasses import dataclass

from fapengine.live.engine.commands import Audio, Cancel, Command
from fapengine.live.hub.messages import HubCounts
from fapengine.live.hub.observed_engine import ObservedEngine

SOUND_WAIT_S = 1.5
"""An utterance whose sound should lead it, but is not heard of for so long, goes on by the clock."""


@dataclass(slots=True)
class _Unheard:
    """An utterance that waits for its sound."""

    session: str
    utterance: int
    since_s: float


@dataclass(slots=True)
class _Cue:
    """A command that waits for its time in an utterance."""

    session: str
    utterance: int
    at_s: float
    command: Command


class Waiting:
    """Utterances that wait for their sound, and commands for their time.

    Stateful.

    Parameters
    ----------
    engine : ObservedEngine
        Gets the commands whose time has come.
    counts : HubCounts
        Counts utterances whose sound was never heard of.
    """

    def __init__(self, engine: ObservedEngine, counts: HubCounts) -> None:
        self._engine = engine
        self._counts = counts
        self._unheard: list[_Unheard] = []
        self._cues: list[_Cue] = []

    def for_sound(self, session: str, utterance: int, now_s: float) -> None:
        """Let an utterance wait for its sound, as long as may be."""
        self._unheard.append(_Unheard(session, utterance, now_s))

    def for_times(self, session: str, utterance: int, commands: Iterable[tuple[float, Command]]) -> None:
        """Let commands wait for their times, in s from the utterance's beginning."""
        self._cues += [_Cue(session, utterance, at_s, command) for at_s, command in commands]

    def tick(self, now_s: float) -> None:
        """Give what is due; of an utterance that is over, commands are dropped."""
        self._hurry(now_s)
        if self._cues:
            self._give_cues(now_s)

    def hear(self, session: str, command: Audio | Cancel, now_s: float) -> None:
        """Strike off what is heard or cancelled; while a session's sound plays, what is queued behind it may wait."""
        stops = command if isinstance(command, Cancel) else Cancel(command.utterance)
        self._unheard = [
            entry for entry in self._unheard if entry.session != session or not stops.means(entry.utterance)
        ]
        for entry in self._unheard:
            if entry.session == session:
                entry.since_s = now_s

    def _hurry(self, now_s: float) -> None:
        """Let what waits for a sound that is not heard of go on by the clock, one behind the other."""
        for entry in tuple(self._unheard):
            if entry.session not in self._engine:
                self._unheard.remove(entry)
            elif self._engine.state(entry.session) in ("speaking", "paused"):
                entry.since_s = now_s
            elif now_s - entry.since_s > SOUND_WAIT_S:
                self._unheard.remove(entry)
                self._counts.unheard += 1
                self._engine.apply(entry.session, Audio(entry.utterance, now_s, 0.0), now_s)

    def _give_cues(self, now_s: float) -> None:
        waiting = []
        for cue in self._cues:
            utterance = self._engine.utterance(cue.session, cue.utterance) if cue.session in self._engine else None
            if utterance is not None and utterance.position_s(now_s) < cue.at_s:
                waiting.append(cue)
            elif utterance is not None:
                self._engine.apply(cue.session, cue.command, now_s)
        self._cues = waiting
