"""Clocks of two machines: what time it is there.

Theory of operation
-------------------
*Sender* (:class:`EngineClock`). A ping leaves at t0, arrives at t1, is answered at t2 and back at t3. The engine's
clock is ahead by ``((t1 - t0) + (t2 - t3)) / 2``, at worst wrong by half the round trip (RFC 5905, section 8). Of the
last 16 the one with the shortest round trip counts, older ones less; two clocks differ in rate by up to some hundred
ppm, which a line through the last 64 finds. The sender tells its finding with each ping.

*Engine* (:class:`SenderClock`). It takes the sender's word. Of a sender that tells nothing it knows only when its pings
left by their clock and came by its own: the least difference is the offset, too large by the shortest way here.

A clock that is set (NTP, a user) makes all later stamps odd by the same amount; a packet that was held up is odd alone.
So an odd stamp is not used, and three odd ones in a row that agree with each other move the offset.
"""

from collections import deque
from dataclasses import dataclass, field
from statistics import median

WINDOW = 16
SLOPE_WINDOW = 64
EXPECTED_PPM = 150.0
"""Two crystals differ by about so much; what a line says beyond it must be well founded."""
MAX_PPM = 1000.0
"""A crystal is off by 100; more than this is no clock."""
AGE_PPM = 300.0
"""Drift that an old sample may have, as far as the slope is unknown."""
ODD_S = 0.1
"""A stamp so far from the others is odd."""
AGREE_S = 0.05
ODD_IN_A_ROW = 3
REPORT_S = 30.0
"""Time for which the sender's word counts."""


@dataclass(frozen=True, slots=True)
class _Sample:
    at_s: float
    """Sender's clock."""
    offset_s: float
    rtt_s: float


@dataclass(slots=True)
class EngineClock:
    """The engine's clock as its sender knows it.

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
        """Shortest round trip of late; 0 if there was none."""
        return min((sample.rtt_s for sample in self._samples), default=0.0)

    @property
    def skew_ppm(self) -> float:
        """By how much the engine's clock gains on the sender's."""
        return self._slope * 1e6

    def add(self, sent_s: float, received_s: float, answered_s: float, back_s: float) -> None:
        """Take the stamps of one ping: t0 and t3 of the sender's clock, t1 and t2 of the engine's."""
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

    def reset(self) -> None:
        """Forget everything: it is another engine now."""
        self._samples.clear()
        self._odd = []
        self._slope = 0.0

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
        """Fit a line: each sample weighs as much as its round trip allows, and clocks are expected to be good ones."""
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
    """A judge of stamps, which tells a clock that was set from a packet that was held up.

    Stateful.
    """

    _usual: deque[float] = field(default_factory=lambda: deque(maxlen=8))
    _odd: list[float] = field(default_factory=list)

    def take(self, lateness_s: float) -> tuple[bool, float]:
        """Judge one: whether it can be used, and by how much the clock was set (0: it was not)."""
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
    """A sender's clock as the engine knows it.

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
    """Sender's time at which it told the offset."""
    _ways: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _of_pings: Lateness = field(default_factory=Lateness)
    _of_audio: Lateness = field(default_factory=Lateness)

    @property
    def is_known(self) -> bool:
        """Whether times of the sender can be told."""
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
        """Take the sender's word for the offset, engine's clock minus its own."""
        if self._offset_s is not None and abs(sent_s + offset_s - self.engine_s(sent_s)) > ODD_S:
            self.steps += 1
            self._ways.clear()
        self._offset_s, self._reported_s = offset_s, sent_s
        self._skew = min(max(skew_ppm, -MAX_PPM), MAX_PPM) * 1e-6

    def ping(self, sent_s: float, now_s: float) -> None:
        """Take a stamp of a ping that tells no offset."""
        if self._reported_s is not None and abs(sent_s - self._reported_s) <= REPORT_S:
            return
        self._reported_s, self._skew = None, 0.0
        if self._offset_s is not None:
            usable, jump_s = self._of_pings.take(now_s - self.engine_s(sent_s))
            self._step(jump_s)
            if not usable:
                return
        self._ways.append((sent_s, now_s - sent_s))
        self._offset_s = min(way_s + AGE_PPM * 1e-6 * abs(sent_s - at_s) for at_s, way_s in self._ways)

    def audio(self, sender_s: float, now_s: float) -> float | None:
        """Engine's time of a position of the sound that comes now; None if its stamp is odd."""
        if self._offset_s is None:
            return now_s
        usable, jump_s = self._of_audio.take(now_s - self.engine_s(sender_s))
        self._step(jump_s)
        return self.engine_s(sender_s) if usable else None

    def _step(self, jump_s: float) -> None:
        if jump_s and self._offset_s is not None:
            self.steps += 1
            self._offset_s += jump_s
            self._ways.clear()


def _agree(values_s: list[float]) -> bool:
    return max(values_s) - min(values_s) <= AGREE_S
