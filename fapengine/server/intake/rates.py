"""Limits on how often something may be done, and on the processor time that all who ask may have together."""

import asyncio
import time
from collections.abc import Callable
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
