"""One face on an engine: its speech, commands that wait for their time, and FAPs from outside.

Theory of operation
-------------------
Many hosts share one engine, with one session each. A host has no clock: time is an argument. Speech comes as a whole
(:meth:`Host.say`), as phones (:meth:`Host.begin`, :meth:`Host.phones`), or as audio (:class:`.stream.StreamHost`).
Commands may wait for their place in an utterance (:meth:`.stream.StreamHost.cue`). An utterance that follows a player's
audio begins without it after :data:`SOUND_WAIT_S`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import numpy as np
from numpy.typing import NDArray

from fapengine.engine.commands import Anchor, Append, Audio, Begin, Cancel, Command, End, without_neutral
from fapengine.engine.engine import Engine
from fapengine.engine.gestures import commands_of
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone
from fapengine.voices.pronounce import WORDS_OVERLAP_S
from fapengine.voices.protocol import Speech

PHONES_A_COMMAND = 64
SOUND_WAIT_S = 1.5
"""An utterance that should follow its audio, but whose player reports nothing for this long, follows the clock."""
PERFORMED_S, LET_GO_S = 0.3, 0.3
"""Time for which the last frame of :meth:`Host.perform` is held, and in which it then fades."""


@dataclass(frozen=True, slots=True, eq=False)
class _Performed:
    """A frame from outside."""

    columns: list[int]
    values: NDArray[np.int32]
    at_s: float


class Host:
    """One face; see the theory of operation. Stateful.

    Parameters
    ----------
    engine : Engine
    session : str
        An open session.
    """

    def __init__(self, engine: Engine, session: str) -> None:
        self.engine, self.session = engine, session
        self._soundless: dict[int, float] = {}
        """Utterances that wait for their audio, and since when."""
        self._order = count()
        self._cues: dict[int, list[tuple[float, int, Command]]] = {}
        """Commands of each utterance by their time in it, earliest first."""
        self._pins: dict[int, int] = {}
        """Column to the value at which it is held."""
        self._performed: _Performed | None = None

    # Speech ----------------------------------------------------------------------------------------------------------

    def apply(self, command: Command, now_s: float) -> None:
        """Apply a command now. Raises UsageError if the session is not open."""
        for each in without_neutral(command):
            self.engine.apply(self.session, each, now_s)

    def begin(self, number: int, now_s: float, *, anchor: Anchor = "now", at_s: float = 0.0) -> None:
        """Begin an utterance, for an ``anchor`` of ``"at"`` at an engine time.

        Raises UsageError if the session is not open, or has too many utterances.
        """
        self.engine.apply(self.session, Begin(number, anchor, at_s), now_s)
        if self.engine.utterance(self.session, number) is None:
            raise UsageError(f"session: {self.session!r} has as many utterances queued as there may be")

    def phones(
        self, number: int, phones: Sequence[Phone], now_s: float, *, is_last: bool = True, duration_s: float = 0.0
    ) -> None:
        """Add phones to an utterance; nothing happens if it has finished.

        Raises UsageError if the session is not open, the utterance was ended, the phones are before those that came, or
        more of them would wait than may.

        Parameters
        ----------
        number : int
        phones : sequence of Phone
            In the utterance's time, after those that came before; none only to end it.
        now_s : float
        is_last : bool
            Whether no phone follows.
        duration_s : float
            With the last phones: the utterance's length, if longer than its phones.
        """
        utterance = self.engine.utterance(self.session, number)
        if utterance is None:
            return
        if utterance.phone_count is not None:
            raise UsageError(f"utterance {number}: has ended, accepts no more phones")
        if phones and phones[0].start_s < utterance.last_s - WORDS_OVERLAP_S:
            raise UsageError(
                f"utterance {number}: got {phones[0].label!r} at {phones[0].start_s:g} s, expected it after"
                f" {utterance.last_s:g} s"
            )
        first = utterance.size
        for part in range(0, len(phones), PHONES_A_COMMAND):
            command = Append(number, first + part, tuple(phones[part : part + PHONES_A_COMMAND]))
            if refusal := self.engine.apply(self.session, command, now_s):
                raise UsageError(f"utterance {number}: {refusal}")
        if is_last:
            length_s = max(duration_s, utterance.last_s, phones[-1].end_s if phones else 0.0)
            self.engine.apply(self.session, End(number, first + len(phones), length_s), now_s)

    def say(self, number: int, speech: Speech, anchor: Anchor, now_s: float) -> None:
        """Say what a voice spoke, with its inline cues.

        Raises UsageError if the session is not open, or has too many utterances.
        """
        self.begin(number, now_s, anchor=anchor)
        self.phones(number, speech.phones.phones, now_s, duration_s=speech.duration_s)
        for at_s, command in commands_of(speech.marks):
            self.add_cue(number, at_s, command)
        if anchor == "audio":
            self._soundless[number] = now_s

    # Commands that wait ----------------------------------------------------------------------------------------------

    def add_cue(self, number: int, at_s: float, command: Command) -> None:
        """Apply a command at a time of an utterance."""
        heappush(self._cues.setdefault(number, []), (at_s, next(self._order), command))

    def give_cues(self, number: int, until_s: float, now_s: float) -> None:
        """Apply the commands of an utterance up to a time in it, in order."""
        cues = self._cues.get(number, [])
        while cues and cues[0][0] <= until_s:
            self.apply(heappop(cues)[2], now_s)
        if not cues:
            self._cues.pop(number, None)

    def note(self, command: Audio | Cancel, now_s: float) -> None:
        """Note that audio plays or is cancelled; while it plays, later utterances may wait for theirs."""
        stops = command if isinstance(command, Cancel) else Cancel(command.utterance)
        self._soundless = {number: now_s for number in self._soundless if not stops.means(number)}

    def tick(self, now_s: float) -> int:
        """Apply what is due, before a frame; commands of finished utterances are dropped.

        Returns
        -------
        int
            Number of utterances that begin without their audio because no position was reported.
        """
        unheard = 0
        for number in tuple(self._soundless):
            if number not in self._soundless:
                continue
            if self.engine.state(self.session) in ("speaking", "paused"):
                self._soundless[number] = now_s
            elif now_s - self._soundless[number] > SOUND_WAIT_S:
                del self._soundless[number]
                unheard += 1
                self.engine.apply(self.session, Audio(number, now_s, 0.0), now_s)
        for number in tuple(self._cues):
            utterance = self.engine.utterance(self.session, number)
            if utterance is None:
                del self._cues[number]
            else:
                self.give_cues(number, utterance.position_s(now_s), now_s)
        return unheard

    # FAPs from outside -----------------------------------------------------------------------------------------------

    @property
    def pins(self) -> dict[int, int]:
        """FAP number to the value in FAPU at which it is held."""
        return {column + 1: value for column, value in self._pins.items()}

    def pin(self, number: int, value: int | None) -> None:
        """Hold FAP ``number`` at a value in FAPU, whatever the engine shows; None releases it.

        Raises UsageError if the session is not open, or there is no such FAP.
        """
        self._check_open()
        column = fap.column(number)
        if value is None:
            self._pins.pop(column, None)
        else:
            self._pins[column] = value

    def perform(self, values: Mapping[int, int], now_s: float) -> None:
        """Move the face by FAPs from outside, such as a camera's: FAP number to FAPU, in place of the engine's.

        They last until the next call; when none comes for :data:`PERFORMED_S`, they fade within :data:`LET_GO_S`.
        Raises UsageError if the session is not open, or there is no such FAP.
        """
        self._check_open()
        columns = fap.columns(*values)
        self._performed = _Performed(columns, np.array([*values.values()], np.int32), now_s)

    @property
    def is_overlaid(self) -> bool:
        """Whether :meth:`overlay` would change a frame."""
        return bool(self._pins) or self._performed is not None

    def overlay(self, faps: NDArray[np.int32], now_s: float) -> None:
        """Write FAPs from outside into a frame, (68,) int32 FAPU, in place."""
        if self._performed is not None:
            performed = self._performed
            share = float(np.clip(1 - (now_s - performed.at_s - PERFORMED_S) / LET_GO_S, 0.0, 1.0))
            if share:
                own = faps[performed.columns]
                faps[performed.columns] = np.rint(own + share * (performed.values - own))
            else:
                self._performed = None
        if self._pins:
            faps[list(self._pins)] = list(self._pins.values())

    def _check_open(self) -> None:
        if self.session not in self.engine:
            open_ones = ", ".join(self.engine.sessions) or "none"
            raise UsageError(f"session: got {self.session!r}, expected one of {open_ones}")
