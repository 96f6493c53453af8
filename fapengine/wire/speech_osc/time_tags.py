"""Time tags of bundles: when a sender means it, in engine time. Nothing ever waits for one.

Theory of operation
-------------------
A tag is of the sender's wall clock. The first tag of a sender ties that clock to the engine's, by the receiver's own
wall clock of that moment and never again: when that one is set afterwards, nothing moves. A packet can be late but not
early: a tag more than :data:`MAX_SKEW_S` ahead shows at once that the clocks differ, one that is far behind shows it
when :data:`LATE_IN_A_ROW` of them in a row are. The tie then moves so that the latest tag means now.
"""

from dataclasses import dataclass, field

from fapengine.wire.osc import IMMEDIATELY

MAX_SKEW_S = 10.0
LATE_S = 0.5
"""A tag farther behind is clamped."""
LATE_IN_A_ROW = 3
UNIX_S = 2_208_988_800
"""1970 in seconds since 1900."""


def unix_s(tag: int) -> float:
    """Seconds since 1970 of a time tag; its 32 bits of seconds begin anew in 2036 (RFC 4330, section 3).

    Examples
    --------
    >>> unix_s((2_208_988_800 + 1_700_000_000) << 32 | 1 << 31)
    1700000000.5
    """
    seconds = tag >> 32
    if seconds < 1 << 31:
        seconds += 1 << 32
    return seconds - UNIX_S + (tag & 0xFFFFFFFF) / 2**32


def time_tag(wall_s: float) -> int:
    """Time tag of seconds since 1970."""
    return int((wall_s + UNIX_S) * 2**32) & (2**64 - 1)


@dataclass(slots=True)
class TagClock:
    """The wall clock of one sender.

    Stateful.

    Examples
    --------
    >>> clock = TagClock()
    >>> clock.engine_s(time_tag(1_700_000_000.25), now_s=5.0, wall_s=1_700_000_000.0)
    5.25
    >>> clock.engine_s(IMMEDIATELY, now_s=5.5, wall_s=0.0)
    5.5
    """

    clamped: int = 0
    """Tags that could not be meant."""
    _engine_from_wall_s: float | None = None
    _behind_s: list[float] = field(default_factory=list)

    def engine_s(self, tag: int, now_s: float, wall_s: float) -> float:
        """Engine time that a tag means.

        Parameters
        ----------
        tag : int
            Of the bundle; 1 is now.
        now_s, wall_s : float
            Engine's clock and receiver's wall clock at arrival.
        """
        if tag == IMMEDIATELY:
            return now_s
        there_s = unix_s(tag)
        if self._engine_from_wall_s is None:
            self._engine_from_wall_s = now_s - wall_s
        at_s = there_s + self._engine_from_wall_s
        if at_s - now_s > MAX_SKEW_S:
            return self._clamp(now_s, now_s - there_s)
        if now_s - at_s > LATE_S:
            self._behind_s.append(now_s - there_s)
            settled = len(self._behind_s) == LATE_IN_A_ROW
            return self._clamp(now_s, min(self._behind_s) if settled else None)
        self._behind_s = []
        return at_s

    def _clamp(self, now_s: float, tie_s: float | None) -> float:
        self.clamped += 1
        if tie_s is not None:
            self._engine_from_wall_s, self._behind_s = tie_s, []
        return now_s
