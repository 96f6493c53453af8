"""The handshake: hellos and pings that tell whether the engine is there, which one it is, and what time it has."""

from dataclasses import dataclass, field, replace
from math import inf

from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.clock import EngineClock
from fapengine.wire.speech_osc.send_window import MAX_REPEAT_S

FIRST_PINGS, FIRST_PINGS_S, PING_S = 8, 0.04, 2.0
HELLOS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 1.0)
"""Times from one hello to the next, until there is an answer; the last one again and again."""
SILENT_S = 5.0
"""Time without a packet of the engine after which it is greeted again."""
INT32 = 2**31 - 1


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
    """Time of the first ping that nothing was heard after."""

    @property
    def next_s(self) -> float:
        """When it is called next."""
        return min(self._hello_s, self._ping_s)

    def is_connected(self, now_s: float) -> bool:
        """Whether it was heard of late."""
        return now_s - self.heard_s < SILENT_S

    def is_unanswered(self, now_s: float, silent_s: float) -> bool:
        """Whether nothing was heard for so long after a question."""
        return now_s - self._asked_s > silent_s

    def hear(self, now_s: float) -> None:
        """Note a packet of the engine."""
        self.heard_s, self._asked_s = now_s, inf

    def begin_elsewhere(self, now_s: float, *, follows: bool, ping_s: float) -> None:
        """Greet another engine, or the same at another address.

        Parameters
        ----------
        now_s : float
        follows : bool
            Whether to go where it sends us.
        ping_s : float
            Time from one ping to the next.
        """
        flags = self.hello.flags | schema.FOLLOWS if follows else self.hello.flags & ~schema.FOLLOWS
        self.hello, self.ping_s = replace(self.hello, flags=flags, cookie=0), ping_s
        self._hello_s = self._ping_s = now_s
        self._hellos = self._pings = 0
        self._asked_s = inf

    def due(self, now_s: float) -> list[list[schema.Wire]]:
        """Give what is to be sent now, a datagram each."""
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
        """Take an answer; whether it is another engine than before. Instance 0 does not tell."""
        before, self._instance = self._instance, answer.instance or self._instance
        is_other = bool(before) and before != self._instance
        if is_other:
            self.clock.reset()
            self._pings = 0
        if isinstance(answer, schema.Welcome):
            self.welcome, self._hello_s, self._hellos = answer, inf, 0
            if answer.cookie and answer.cookie != self.hello.cookie:
                self.hello, self._hello_s = replace(self.hello, cookie=answer.cookie), now_s
        else:
            self.clock.add(answer.sent_us / 1e6, answer.received_us / 1e6, answer.answered_us / 1e6, now_s)
        return is_other

    def greet_again(self, now_s: float) -> bool:
        """Greet at once; False if that has just been done."""
        if self._hello_s <= now_s + MAX_REPEAT_S:
            return False
        self._hello_s, self._hellos = now_s, 0
        return True

    def new_ping(self, now_s: float) -> schema.Ping:
        """Tell the time, and what is known of the engine's."""
        number, sent_us = self._pings % INT32, round(now_s * 1e6)
        if not self.clock.is_known:
            return schema.Ping(number, sent_us)
        offset_us, rtt_us = round(self.clock.offset_s(now_s) * 1e6), round(self.clock.rtt_s * 1e6)
        return schema.Ping(number, sent_us, offset_us, self.clock.skew_ppm, rtt_us)

    def _counted_ping(self, now_s: float) -> schema.Ping:
        self._pings += 1
        self._ping_s = now_s + (FIRST_PINGS_S if self._pings < FIRST_PINGS else self.ping_s)
        self._asked_s = min(self._asked_s, now_s)
        return self.new_ping(now_s)
