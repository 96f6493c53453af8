"""Limits on how often something may be done, and on the processor time that all who ask may have together.

The server's load, which limits the number of new faces; and garbage collection. A closed connection leaves a cycle of
dead objects, a call some hundreds of them. If Python looked at all objects of the program every few seconds, that would
take 30 ms with 500 sessions; if it looked every ten minutes, the remains of many calls would take longer. In either
case no frame is shown meanwhile.
"""

import asyncio
import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count

SHARE, AT_ONCE_S = 0.25, 0.002
"""Share of the loop's time that messages of pages may take, and the time that they may take without a rest."""


@dataclass(slots=True)
class TokenBucket:
    """A token bucket: a rate of messages per second, and a burst. Stateful."""

    rate_hz: float
    burst: float
    _left: float = field(init=False)
    _since_s: float | None = None

    def __post_init__(self) -> None:
        self._left = self.burst

    def take(self, now_s: float) -> bool:
        """Return whether one more message is allowed now.

        Examples
        --------
        >>> allowance = TokenBucket(rate_hz=1.0, burst=2)
        >>> [allowance.take(0.0) for _ in range(3)], allowance.take(1.5)
        ([True, True, False], True)
        """
        if self._since_s is not None:
            self._left = min(self.burst, self._left + (now_s - self._since_s) * self.rate_hz)
        self._since_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Turns:
    """The turns of all who send work to one loop: whose work would end first is next (fair queuing). Stateful.

    A piece of work is taken to last as long as the one before, of the same sender.
    After :data:`AT_ONCE_S` of work all rest until it was :data:`SHARE` of the time; frames are shown meanwhile.

    Parameters
    ----------
    cpu_s : callable
        Processor time of the loop's thread: other programs do not count.
    """

    def __init__(self, cpu_s: Callable[[], float] = time.thread_time) -> None:
        self._cpu_s = cpu_s
        self._order = count()
        self._waiting: list[tuple[float, int, asyncio.Future[None]]] = []
        self._used_s: dict[object, tuple[float, float]] = {}
        """Who is here, each with the time used, and that of the last piece. A newcomer begins at the level."""
        self._level_s = 0.0
        """Time used of who was in turn last."""
        self._debt_s, self._since_s = 0.0, 0.0
        """Time used without a rest, and when that was so."""
        self._is_taken = False

    async def take(self, who: object, work: Callable[[], None]) -> None:
        """Do a piece of work when its turn has come."""
        used_s, last_s = self._used_s.get(who, (0.0, 0.0))
        used_s = max(used_s, self._level_s)
        if self._is_taken:
            turn = asyncio.get_running_loop().create_future()
            heappush(self._waiting, (used_s + last_s, next(self._order), turn))
            try:
                await turn
            except asyncio.CancelledError:
                if turn.done() and not turn.cancelled():
                    self._next()
                raise
        self._is_taken = True
        begun_s = self._cpu_s()
        try:
            work()
        finally:
            took_s = self._cpu_s() - begun_s
            self._level_s, self._used_s[who] = used_s, (used_s + took_s, took_s)
            self._spend(took_s)

    def leave(self, who: object) -> None:
        """Forget one who is gone."""
        self._used_s.pop(who, None)

    def _spend(self, took_s: float) -> None:
        """Pass the turn on, after a rest if much time was used."""
        loop = asyncio.get_running_loop()
        rested_s = SHARE * (loop.time() - self._since_s)
        self._debt_s, self._since_s = max(self._debt_s - rested_s, 0.0) + took_s, loop.time()
        if self._debt_s > AT_ONCE_S:
            loop.call_later(self._debt_s / SHARE, self._next)
        else:
            self._next()

    def _next(self) -> None:
        while self._waiting:
            turn = heappop(self._waiting)[2]
            if not turn.done():
                turn.set_result(None)
                return
        self._is_taken = False


WINDOW_S = 1.0
"""Time over which the load is averaged."""
FULL, FREE = 0.65, 0.55
"""Load above which no new face is accepted, and below which faces are accepted again."""
A_FACE = 0.004
"""Load that a new face is assumed to cause until it is measured: that of a face that speaks phone by phone at 60 Hz
(``python -m bench.sessions``). A face that waits needs a third of it."""
PIECES = 20_000, 1, 50
"""Thresholds of Python's garbage collector: a collection of so many new objects takes 4 ms."""


@dataclass(slots=True)
class Load:
    """Processor time of the loop's thread divided by the time of the shown frames. Stateful.

    Other programs on the machine do not count: while they run, the thread only waits. The cost of new faces is known
    after one window, so each window accepts only as many as are assumed to fit.

    Parameters
    ----------
    rate_hz : float
        Frame rate.

    Examples
    --------
    >>> load = Load(rate_hz=50.0)
    >>> for frame in range(101):  # 18 of 20 ms
    ...     is_new = load.add(0.018 * frame, 0.02 * frame)
    >>> round(load.share, 2), load.is_full
    (0.9, True)
    """

    rate_hz: float
    share: float = 0.0
    """Load of the last window."""
    is_full: bool = False
    room: int = int(FULL / A_FACE)
    """Faces that may be accepted before the window ends."""
    _frames: int = 0
    _begun_s: float | None = None
    _begun_cpu_s: float = 0.0

    def add(self, cpu_s: float, now_s: float) -> bool:
        """Count a frame; return True if a window ended with it, and the load is new.

        Parameters
        ----------
        cpu_s : float
            Processor time of the thread up to now.
        now_s : float
        """
        if self._begun_s is None:
            self._begun_s, self._begun_cpu_s = now_s, cpu_s
            return False
        self._frames += 1
        if now_s - self._begun_s < WINDOW_S:
            return False
        self.share = (cpu_s - self._begun_cpu_s) * self.rate_hz / self._frames
        self.is_full = self.share > (FREE if self.is_full else FULL)
        self.room = 0 if self.is_full else int((FULL - self.share) / A_FACE)
        self._frames, self._begun_s, self._begun_cpu_s = 0, now_s, cpu_s
        return True


@contextmanager
def collecting_in_pieces() -> Iterator[None]:
    """Make Python collect garbage often, in small steps; objects that exist at the start are excluded."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*PIECES)
    try:
        yield
    finally:
        gc.unfreeze()
        gc.set_threshold(*before)
