"""A network that loses, holds up, doubles and reorders, on a virtual clock; every run of a seed is the same."""

import heapq
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, slots=True)
class Channel:
    """What one direction does to packets."""

    delay_s: float = 0.005
    jitter_s: float = 0.003
    """Exponential, on top."""
    loss: float = 0.0
    burst_s: float = 0.0
    """While it lasts nothing passes."""
    burst_share: float = 0.0
    """Of time that lies in bursts."""
    twice: float = 0.0
    """Share of packets that come twice, the second up to 50 ms later."""
    late: float = 0.0
    """Share of packets that are overtaken: up to 80 ms late."""


@dataclass(slots=True)
class Link:
    """Stateful: one direction."""

    channel: Channel
    rng: np.random.Generator
    carried: int = 0
    sent_bytes: int = 0
    lost: int = 0
    _order: int = 0
    _flying: list[tuple[float, int, bytes]] = field(default_factory=list)
    _burst: tuple[float, float] = (0.0, 0.0)

    def send(self, packet: bytes, now_s: float) -> None:
        self.carried += 1
        self.sent_bytes += len(packet)
        channel = self.channel
        if self._in_burst(now_s) or self.rng.random() < channel.loss:
            self.lost += 1
            return
        copies = 1 + (self.rng.random() < channel.twice)
        for copy in range(copies):
            delay_s = channel.delay_s + self.rng.exponential(channel.jitter_s) if channel.jitter_s else channel.delay_s
            if self.rng.random() < channel.late:
                delay_s += self.rng.uniform(0.0, 0.08)
            if copy:
                delay_s += self.rng.uniform(0.0, 0.05)
            self._order += 1
            heapq.heappush(self._flying, (now_s + delay_s, self._order, packet))

    def arrived(self, now_s: float) -> list[bytes]:
        packets = []
        while self._flying and self._flying[0][0] <= now_s:
            packets.append(heapq.heappop(self._flying)[2])
        return packets

    def _in_burst(self, now_s: float) -> bool:
        channel = self.channel
        if not channel.burst_s:
            return False
        if now_s >= self._burst[1]:
            gap_s = channel.burst_s * (1 - channel.burst_share) / channel.burst_share
            start_s = max(self._burst[1], now_s) + self.rng.exponential(gap_s)
            self._burst = (start_s, start_s + channel.burst_s)
        return now_s >= self._burst[0]


@dataclass(slots=True)
class Clock:
    """A machine's clock: read from the true time."""

    offset_s: float = 0.0
    skew: float = 0.0
    steps: list[tuple[float, float]] = field(default_factory=list)
    """(true time, by how much it is set then)."""

    def __call__(self, true_s: float) -> float:
        return self.steady(true_s) + sum(by_s for at_s, by_s in self.steps if true_s >= at_s)

    def steady(self, true_s: float) -> float:
        """As a clock that nobody sets: a sound card's, or the monotonic one."""
        return true_s * (1 + self.skew) + self.offset_s
