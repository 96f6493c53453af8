"""Estimates of another machine's clock: the engine's, a sender's, and that of a sender's time tags.

Theory of operation
-------------------
*Sender* (:class:`EngineClock`). A ping leaves at t0, arrives at t1, is answered at t2 and back at t3. The engine's
clock is ahead by ``((t1 - t0) + (t2 - t3)) / 2``, at worst wrong by half the round trip (RFC 5905, section 8). Of the
last 16 the one with the shortest round trip counts, older ones less. Two clocks differ in rate by up to some hundred
ppm, which a line fitted to the last 64 finds. The sender reports its estimate with each ping.

*Engine* (:class:`SenderClock`). It uses the sender's estimate. Without one it knows only when pings left by that
clock and arrived by its own: the smallest difference is the offset, too large by the shortest transit time.

A clock that is set (NTP, a user) shifts all later stamps by the same amount; a delayed packet is a single outlier.
So an outlier is not used, and three outliers in a row that agree with each other move the offset.

*Time tags* (:class:`TagClock`) of bundles are of the sender's wall clock. The first tag of a sender fixes the distance
of that clock from the engine's, by the receiver's wall clock at that moment: when that one is set later, nothing moves.
A packet can be late but not early: one tag more than :data:`MAX_SKEW_S` ahead shows that the clocks differ;
tags that are too late show it when they are :data:`LATE_IN_A_ROW`. The latest tag then means now. Nothing ever waits.
"""

from collections import deque
from dataclasses import dataclass, field
from statistics import median

from fapengine.wire.osc import IMMEDIATELY

WINDOW = 16
SLOPE_WINDOW = 64
EXPECTED_PPM = 150.0
"""Typical difference of two crystals; a larger slope needs better evidence."""
MAX_PPM = 1000.0
"""Limit of the slope: a crystal is off by 100."""
AGE_PPM = 300.0
"""Drift that an old sample may have while the slope is uncertain."""
ODD_S = 0.1
"""A stamp this far from the others is an outlier."""
AGREE_S = 0.05
ODD_IN_A_ROW = 3
REPORT_S = 30.0
"""Time for which a sender's estimate is valid."""

MAX_SKEW_S = 10.0
LATE_S = 0.5
"""A tag later than this is clamped."""
LATE_IN_A_ROW = 3
UNIX_S = 2_208_988_800
"""1970 in seconds since 1900."""


@dataclass(frozen=True, slots=True)
class _Sample:
    at_s: float
    """Sender's clock."""
    offset_s: float
    rtt_s: float


@dataclass(slots=True)
class EngineClock:
    """The engine's clock, as a sender estimates it.

    Stateful.

    Examples
    --------
    >>> clock = EngineClock()
    >>> clock.add(10.0, 110.001, 110.001, 10.002)
    >>> round(clock.engine_s(12.0), 6), clock.is_known
    (112.0, True)
    """

    steps: int = 0
    """Times that a clock was set."""
    _samples: deque[_Sample] = field(default_factory=lambda: deque(maxlen=SLOPE_WINDOW))
    _odd: list[_Sample] = field(default_factory=list)
    _slope: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether there was an answer."""
        return bool(self._samples)

    @property
    def rtt_s(self) -> float:
        """Shortest recent round trip; 0 if there was none."""
        return min((sample.rtt_s for sample in self._samples), default=0.0)

    @property
    def skew_ppm(self) -> float:
        """Rate of the engine's clock minus that of the sender's."""
        return self._slope * 1e6

    def add(self, sent_s: float, received_s: float, answered_s: float, back_s: float) -> None:
        """Add the stamps of one ping: t0 and t3 of the sender's clock, t1 and t2 of the engine's."""
        rtt_s = max((back_s - sent_s) - (answered_s - received_s), 0.0)
        sample = _Sample(back_s, ((received_s - sent_s) + (answered_s - back_s)) / 2, rtt_s)
        if self._samples and abs(sample.offset_s - self.offset_s(back_s)) > rtt_s / 2 + ODD_S:
            self._odd.append(sample)
            if not _agree([reading.offset_s for reading in self._odd]):
                self._odd = [sample]
            if len(self._odd) < ODD_IN_A_ROW:
                return
            self.steps += 1
            self._samples = deque(self._odd, maxlen=SLOPE_WINDOW)
        else:
            self._samples.append(sample)
        self._odd = []
        self._slope = self._fitted_slope()

    def offset_s(self, sender_s: float) -> float:
        """Engine's clock minus sender's; 0 while nothing is known."""
        if not self._samples:
            return 0.0
        latest = list(self._samples)[-WINDOW:]
        best = min(latest, key=lambda sample: sample.rtt_s / 2 + AGE_PPM * 1e-6 * abs(sender_s - sample.at_s))
        return best.offset_s + self._slope * (sender_s - best.at_s)

    def engine_s(self, sender_s: float) -> float:
        """Engine's time at a time of the sender."""
        return sender_s + self.offset_s(sender_s)

    def sender_s(self, engine_s: float) -> float:
        """Sender's time at a time of the engine."""
        guess_s = engine_s - self.offset_s(engine_s)
        return engine_s - self.offset_s(guess_s)

    def _fitted_slope(self) -> float:
        """Slope of a line, fitted with weights from the round trips and a prior for small slopes."""
        shortest_s = self.rtt_s
        weights = [4.0 / (reading.rtt_s - shortest_s + 1e-3) ** 2 for reading in self._samples]
        pairs = list(zip(weights, self._samples, strict=True))
        total = sum(weights)
        mean_t = sum(w * reading.at_s for w, reading in pairs) / total
        mean_o = sum(w * reading.offset_s for w, reading in pairs) / total
        spread = sum(w * (reading.at_s - mean_t) ** 2 for w, reading in pairs)
        together = sum(w * (reading.at_s - mean_t) * (reading.offset_s - mean_o) for w, reading in pairs)
        limit = MAX_PPM * 1e-6
        return min(max(together / (spread + (EXPECTED_PPM * 1e-6) ** -2), -limit), limit)


@dataclass(slots=True)
class Lateness:
    """Filter of stamps that tells a clock that was set from a delayed packet.

    Stateful.
    """

    _usual: deque[float] = field(default_factory=lambda: deque(maxlen=8))
    _odd: list[float] = field(default_factory=list)

    def take(self, lateness_s: float) -> tuple[bool, float]:
        """Add one; return whether it is usable, and by how much the clock was set, or 0."""
        if not self._usual or abs(lateness_s - median(self._usual)) <= ODD_S:
            self._usual.append(lateness_s)
            self._odd = []
            return True, 0.0
        self._odd.append(lateness_s)
        if not _agree(self._odd):
            self._odd = [lateness_s]
        if len(self._odd) < ODD_IN_A_ROW:
            return False, 0.0
        jump_s = median(self._odd) - median(self._usual)
        self._odd = []
        return True, jump_s


@dataclass(slots=True)
class SenderClock:
    """A sender's clock, as the engine estimates it.

    Stateful.

    Examples
    --------
    >>> clock = SenderClock()
    >>> clock.ping(5.0, 105.004)
    >>> round(clock.engine_s(6.0), 3)
    106.004
    >>> clock.report(7.0, 100.0, 0.0)
    >>> clock.engine_s(8.0)
    108.0
    """

    steps: int = 0
    _offset_s: float | None = None
    _skew: float = 0.0
    _reported_s: float | None = None
    """Sender's time of its last report of the offset."""
    _ways: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _of_pings: Lateness = field(default_factory=Lateness)
    _of_audio: Lateness = field(default_factory=Lateness)

    @property
    def is_known(self) -> bool:
        """Whether the offset is known."""
        return self._offset_s is not None

    def engine_s(self, sender_s: float) -> float:
        """Engine's time at a time of the sender; the same while nothing is known."""
        if self._offset_s is None:
            return sender_s
        since_s = 0.0 if self._reported_s is None else sender_s - self._reported_s
        return sender_s + self._offset_s + self._skew * min(max(since_s, -REPORT_S), REPORT_S)

    def sender_s(self, engine_s: float) -> float:
        """Sender's time at a time of the engine."""
        there_s = engine_s - (self._offset_s or 0.0)
        return there_s - (self.engine_s(there_s) - engine_s)

    def report(self, sent_s: float, offset_s: float, skew_ppm: float) -> None:
        """Use the sender's estimate of the offset: engine's clock minus its own."""
        if self._offset_s is not None and abs(sent_s + offset_s - self.engine_s(sent_s)) > ODD_S:
            self.steps += 1
            self._ways.clear()
        self._offset_s, self._reported_s = offset_s, sent_s
        self._skew = min(max(skew_ppm, -MAX_PPM), MAX_PPM) * 1e-6

    def ping(self, sent_s: float, now_s: float) -> None:
        """Use the time stamp of a ping without an estimate."""
        if self._reported_s is not None and abs(sent_s - self._reported_s) <= REPORT_S:
            return
        self._reported_s, self._skew = None, 0.0
        if self._offset_s is not None and not self._is_usable(self._of_pings, now_s - self.engine_s(sent_s)):
            return
        self._ways.append((sent_s, now_s - sent_s))
        self._offset_s = min(way_s + AGE_PPM * 1e-6 * abs(sent_s - at_s) for at_s, way_s in self._ways)

    def audio(self, sender_s: float, now_s: float) -> float | None:
        """Engine's time of an audio position that arrives now; None if its stamp is an outlier."""
        if self._offset_s is None:
            return now_s
        return self.engine_s(sender_s) if self._is_usable(self._of_audio, now_s - self.engine_s(sender_s)) else None

    def _is_usable(self, filtered: Lateness, lateness_s: float) -> bool:
        usable, jump_s = filtered.take(lateness_s)
        if jump_s and self._offset_s is not None:
            self.steps += 1
            self._offset_s += jump_s
            self._ways.clear()
        return usable


def _agree(values_s: list[float]) -> bool:
    return max(values_s) - min(values_s) <= AGREE_S


def unix_s(tag: int) -> float:
    """Seconds since 1970 of a time tag; its 32 bits of seconds wrap around in 2036 (RFC 4330, section 3).

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
    """Number of tags that were too far from now."""
    _engine_from_wall_s: float | None = None
    _behind_s: list[float] = field(default_factory=list)

    def engine_s(self, tag: int, now_s: float, wall_s: float) -> float:
        """Engine time of a tag.

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
