"""The handshake: hellos and pings that find out whether the engine answers, which one it is, and its clock."""

from dataclasses import dataclass, field, replace
from math import inf

from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.clock import EngineClock
from fapengine.wire.speech_osc.send_window import MAX_REPEAT_S

FIRST_PINGS, FIRST_PINGS_S, PING_S = 8, 0.04, 2.0
HELLOS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 1.0)
"""Times from one hello to the next, until there is an answer; the last one repeats."""
SILENT_S = 5.0
"""Time without a packet of the engine after which another hello is sent."""


@dataclass(slots=True)
class Handshake:
    """State of the handshake with one engine.

    Stateful.
    """

    hello: schema.Hello
    clock: EngineClock = field(default_factory=EngineClock)
    welcome: schema.Welcome | None = None
    ping_s: float = PING_S
    heard_s: float = -inf
    """Time of the engine's last packet."""
    _hello_s: float = -inf
    _hellos: int = 0
    _ping_s: float = -inf
    _pings: int = 0
    _instance: int = 0
    _asked_s: float = inf
    """Time of the first ping since the last packet."""

    @property
    def next_s(self) -> float:
        """Time of the next hello or ping."""
        return min(self._hello_s, self._ping_s)

    def is_connected(self, now_s: float) -> bool:
        """Whether the engine was heard recently."""
        return now_s - self.heard_s < SILENT_S

    def is_unanswered(self, now_s: float, silent_s: float) -> bool:
        """Whether a ping has had no answer for ``silent_s``."""
        return now_s - self._asked_s > silent_s

    def hear(self, now_s: float) -> None:
        """Note a packet of the engine."""
        self.heard_s, self._asked_s = now_s, inf

    def begin_elsewhere(self, now_s: float, *, follows: bool, ping_s: float) -> None:
        """Connect to another engine, or to the same one at another address.

        Parameters
        ----------
        now_s : float
        follows : bool
            Whether the caller handles a ``Moved``.
        ping_s : float
            Time from one ping to the next.
        """
        flags = self.hello.flags | schema.FOLLOWS if follows else self.hello.flags & ~schema.FOLLOWS
        self.hello, self.ping_s = replace(self.hello, flags=flags, cookie=0), ping_s
        self._hello_s = self._ping_s = now_s
        self._hellos = self._pings = 0
        self._asked_s = inf

    def due(self, now_s: float) -> list[list[schema.Wire]]:
        """Return the messages to send now, one list per datagram."""
        if self.welcome is not None and not self.is_connected(now_s) and self._hello_s == inf:
            self._hello_s, self._hellos = now_s, 0
        parts: list[list[schema.Wire]] = []
        if now_s >= self._hello_s:
            parts.append([self.hello, self._counted_ping(now_s)])
            self._hello_s = now_s + HELLOS_S[min(self._hellos + 1, len(HELLOS_S) - 1)]
            self._hellos += 1
        if now_s >= self._ping_s:
            parts.append([self._counted_ping(now_s)])
        return parts

    def answered(self, answer: schema.Welcome | schema.Pong, now_s: float) -> bool:
        """Process an answer; return whether it is from another engine than before. Instance 0 is not compared."""
        before, self._instance = self._instance, answer.instance or self._instance
        is_other = bool(before) and before != self._instance
        if is_other:
            self.clock = EngineClock()
            self._pings = 0
        if isinstance(answer, schema.Welcome):
            self.welcome, self._hello_s, self._hellos = answer, inf, 0
            if answer.cookie and answer.cookie != self.hello.cookie:
                self.hello, self._hello_s = replace(self.hello, cookie=answer.cookie), now_s
        else:
            self.clock.add(answer.sent_us / 1e6, answer.received_us / 1e6, answer.answered_us / 1e6, now_s)
        return is_other

    def greet_again(self, now_s: float) -> bool:
        """Send a hello now; False if that was done just before."""
        if self._hello_s <= now_s + MAX_REPEAT_S:
            return False
        self._hello_s, self._hellos = now_s, 0
        return True

    def new_ping(self, now_s: float) -> schema.Ping:
        """Return a ping with the current estimate of the engine's clock."""
        number, sent_us = self._pings % schema.INT32, round(now_s * 1e6)
        if not self.clock.is_known:
            return schema.Ping(number, sent_us)
        offset_us, rtt_us = round(self.clock.offset_s(now_s) * 1e6), round(self.clock.rtt_s * 1e6)
        return schema.Ping(number, sent_us, offset_us, self.clock.skew_ppm, rtt_us)

    def _counted_ping(self, now_s: float) -> schema.Ping:
        self._pings += 1
        self._ping_s = now_s + (FIRST_PINGS_S if self._pings < FIRST_PINGS else self.ping_s)
        self._asked_s = min(self._asked_s, now_s)
        return self.new_ping(now_s)
