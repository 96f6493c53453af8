"""The engine: many sessions, driven by an explicit clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nextafter
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.live.engine.commands import (
    MANNERS,
    Append,
    Audio,
    Begin,
    Blink,
    Cancel,
    Command,
    End,
    Express,
    Look,
    Manner,
    Pause,
    Resume,
    Seek,
    TurnHead,
)
from fapengine.live.engine.life import Life
from fapengine.live.engine.session import Counters, Event, Limits, Session, State
from fapengine.live.engine.utterance import StreamClock, Utterance
from fapengine.profiles import Profile
from fapengine.trajectory.bank import SessionBank
from fapengine.trajectory.expression import MAX_WEIGHT
from fapengine.trajectory.style import GENERATORS, Style

SHORTEST_S, LONGEST_S = 0.01, 60.0
"""Ramps and fades are held between these."""
MAX_TURN_RAD = 1.5
PLANS_A_FRAME, URGENT_PLANS = 6, 12
"""Beyond the first, a frame plans only for sessions that cannot wait; beyond the second those wait too, and what comes
for them meanwhile is planned with the rest. A frame of 500 sessions takes 6 ms, and each plan 0.5."""


@dataclass(frozen=True, slots=True, eq=False)
class EngineFrame:
    """One frame of every session."""

    sessions: tuple[str, ...]
    faps: NDArray[np.int32]
    """(S, 68) FAPU; row s is ``sessions[s]``."""
    time_s: float
    """Engine time."""


class Engine:
    """Stateful: faces that speak, look and feel as they are told.

    Parameters
    ----------
    profile : Profile
        Of all sessions.
    rng : numpy.random.Generator
        Chance of what livens them; each session draws from a stream of its own.
    limits : Limits
    style : Style
        Of every session until it is told otherwise.

    Examples
    --------
    One face says "ma", and its FAPs are read at 50 frames a second::

        engine = Engine(profile, rng=np.random.default_rng(1))
        engine.open("anna", now_s=0.0)
        engine.apply("anna", Begin(1), now_s=0.0)
        engine.apply("anna", Append(1, 0, (Phone("m", 0.1, 0.2), Phone("a", 0.2, 0.4))), now_s=0.0)
        engine.apply("anna", End(1, phone_count=2, duration_s=0.5), now_s=0.0)
        frames = [engine.frame(n / 50).faps[0] for n in range(25)]
    """

    def __init__(
        self,
        profile: Profile,
        *,
        rng: np.random.Generator,
        limits: Limits | None = None,
        style: Style | None = None,
    ) -> None:
        self._rng, self._limits, self._style = rng, limits or Limits(), style or Style()
        self._bank = SessionBank(profile, Style.still(method=self._style.method))
        self._life = Life(profile, self._style)
        self._by_name: dict[str, Session] = {}
        self._rows: list[Session] = []
        self._names: tuple[str, ...] = ()
        self._events: list[Event] = []
        self._awake: set[str] = set()
        self._shown_s = -np.inf
        self._wake_s = np.zeros(0)

    def __contains__(self, session: object) -> bool:
        """Whether a session is open."""
        return session in self._by_name

    def __len__(self) -> int:
        """Count the open sessions."""
        return len(self._rows)

    @property
    def sessions(self) -> tuple[str, ...]:
        """Names, in the order of a frame's rows."""
        return self._names

    def open(self, session: str, now_s: float) -> None:
        """Begin a session: a face at rest.

        Raises
        ------
        UsageError
            If there are as many as there may be, or it is open already.
        """
        if session in self._by_name:
            raise UsageError(f"session: got {session!r}, which is open already")
        if len(self._rows) >= self._limits.sessions:
            raise UsageError(f"sessions: got one more than the limit of {self._limits.sessions}")
        number = self._bank.open(now_s)
        (own,) = self._rng.spawn(1)
        self._life.open(now_s, own)
        made = Session(
            session, number, self._bank, self._life, self._limits, self._style, StreamClock(now_s), self._events.append
        )
        self._by_name[session] = made
        self._rows.append(made)
        self._wake_s = np.append(self._wake_s, np.inf)
        self._names = tuple(one.name for one in self._rows)

    def close(self, session: str, now_s: float) -> None:
        """End a session, and cancel what it was saying.

        Raises
        ------
        UsageError
            If it is not open.
        """
        closed = self._session(session)
        closed.cancel(Cancel(), now_s)
        row = self._bank.row(closed.number)
        self._bank.close(closed.number)
        self._life.close(row)
        self._rows[row] = self._rows[-1]
        self._rows.pop()
        self._wake_s[row] = self._wake_s[-1]
        self._wake_s = self._wake_s[:-1]
        self._names = tuple(one.name for one in self._rows)
        self._awake.discard(session)
        del self._by_name[session]

    def apply(self, session: str, command: Command, now_s: float) -> None:
        """Tell a session something. What it cannot use is counted (:meth:`counters`), not raised.

        Raises
        ------
        UsageError
            If the session is not open.
        """
        _APPLY[type(command)](self, self._session(session), command, max(now_s, self._shown_s))
        self._awake.add(session)

    def frame(self, now_s: float) -> EngineFrame:
        """One frame of every session.

        Parameters
        ----------
        now_s : float
            Engine time, not before that of the last frame.

        Raises
        ------
        UsageError
            If time goes back.
        """
        for row in np.flatnonzero(self._wake_s <= now_s):
            self._awake.add(self._rows[row].name)
        awake = [self._by_name[name] for name in sorted(self._awake)]
        for one in awake:
            one.advance(now_s)
        self._plan([one for one in awake if one.fresh], now_s)
        for one in awake:
            self._wake_s[self._bank.row(one.number)] = one.wake_s
        elapsed_s = now_s - self._shown_s
        self._awake.clear()
        if np.isfinite(elapsed_s):
            for one in self._rows:
                if one.slew_left_s:
                    one.slew(elapsed_s)
        frames = self._bank.frames(now_s, self._life.shown(now_s))
        self._shown_s = now_s
        return EngineFrame(self._names, frames.faps, now_s)

    def _plan(self, sessions: Sequence[Session], now_s: float) -> None:
        """Plan for sessions with fresh phones, the most urgent first; the others are woken again."""
        planned = 0
        for (urgent_s, due_s), one in sorted(((one.plan_by_s(), one) for one in sessions), key=itemgetter(0)):
            if due_s <= now_s and planned < (URGENT_PLANS if urgent_s <= now_s else PLANS_A_FRAME):
                one.flush(now_s)
                planned += 1
            else:
                one.wake_s = min(one.wake_s, max(due_s, nextafter(now_s, inf)))

    def events(self) -> list[Event]:
        """Tell what has happened since it was last asked."""
        drained = list(self._events)
        self._events.clear()
        return drained

    def counters(self, session: str) -> Counters:
        """Tell what a session has met with.

        Raises
        ------
        UsageError
            If it is not open.
        """
        return self._session(session).report()

    def state(self, session: str) -> State:
        """Tell what a session is doing.

        Raises
        ------
        UsageError
            If it is not open.
        """
        return self._session(session).state

    def utterance(self, session: str, number: int) -> Utterance | None:
        """Find an utterance that is not over.

        Raises
        ------
        UsageError
            If the session is not open.
        """
        return self._session(session).find(number)

    def style(self, session: str) -> Style:
        """How a session speaks.

        Raises
        ------
        UsageError
            If it is not open.
        """
        return self._session(session).style

    def _session(self, session: str) -> Session:
        if session not in self._by_name:
            raise UsageError(f"session: got {session!r}, which is not open")
        return self._by_name[session]

    def _express(self, one: Session, wish: Express, now_s: float) -> None:
        times_ok = all(isfinite(value) for value in (wish.level, wish.attack_s, wish.release_s, wish.at_s or 0.0))
        if not times_ok or not 0 <= wish.level <= MAX_WEIGHT or not wish.hold_s >= 0:
            one.counters.refused += 1
            return
        wish = replace(wish, attack_s=_held(wish.attack_s), release_s=_held(wish.release_s))
        if not self._life.express(self._bank.row(one.number), wish, now_s):
            one.counters.refused += 1

    def _look(self, one: Session, wish: Look, now_s: float) -> None:
        if not all(abs(angle) <= MAX_TURN_RAD for angle in (wish.yaw_rad, wish.pitch_rad)):
            one.counters.refused += 1
            return
        self._life.look(self._bank.row(one.number), replace(wish, over_s=_held(wish.over_s)), now_s)

    def _turn(self, one: Session, wish: TurnHead, now_s: float) -> None:
        if not all(abs(angle) <= MAX_TURN_RAD for angle in (wish.yaw_rad, wish.pitch_rad, wish.roll_rad)):
            one.counters.refused += 1
            return
        self._life.turn(self._bank.row(one.number), replace(wish, over_s=_held(wish.over_s)), now_s)

    def _blink(self, one: Session, _: Blink, now_s: float) -> None:
        self._life.blink(self._bank.row(one.number), now_s)

    def _behave(self, one: Session, wish: Manner, now_s: float) -> None:
        try:
            value = bool(wish.value) if wish.setting in GENERATORS else wish.value
            if wish.setting not in MANNERS:
                raise UsageError(f"setting: got {wish.setting!r}, expected one of {', '.join(MANNERS)}")
            changes: dict[str, Any] = {wish.setting: value}
            one.style = replace(one.style, **changes)
        except UsageError:
            one.counters.refused += 1
            return
        self._life.behave(self._bank.row(one.number), one.style, now_s)


def _held(over_s: float) -> float:
    return min(max(over_s, SHORTEST_S), LONGEST_S) if isfinite(over_s) else SHORTEST_S


_APPLY: dict[type, Callable[[Engine, Session, Any, float], None]] = {
    Begin: lambda engine, one, command, now_s: one.begin(command, now_s),
    Append: lambda engine, one, command, now_s: one.append(command, now_s),
    End: lambda engine, one, command, now_s: one.end(command, now_s),
    Cancel: lambda engine, one, command, now_s: one.cancel(command, now_s),
    Pause: lambda engine, one, command, now_s: one.pause(command, now_s),
    Resume: lambda engine, one, command, now_s: one.resume(command, now_s),
    Seek: lambda engine, one, command, now_s: one.seek(command, now_s),
    Audio: lambda engine, one, command, now_s: one.audio(command, now_s),
    Express: Engine._express,
    Look: Engine._look,
    TurnHead: Engine._turn,
    Blink: Engine._blink,
    Manner: Engine._behave,
}
