"""A clock that waits: time passes as on the wall, but never past what somebody has yet to do.

On a busy machine a server's frames, a detector or a microphone come late. A test that would then see skipped frames or
late pictures gives them all this clock. Each of them says until when time may pass; the machine's own delays are then
not seen at all, and what the test asserts is the same on any machine.
"""

import threading
import time
from pathlib import Path

SHORTEST_S = 1e-3
"""Shortest sleep: time must pass."""


TRIES = 10
"""How often what a sound card plays is compared with what is seen, until they agree.

On a machine with too much to do the card stalls, and whoever hears it has a clock of its own: one quiet time is enough.
"""
SOFTNET = Path("/proc/net/softnet_stat")
"""Of each processor a line of hexadecimal numbers."""
BACKLOG = 11
"""Column of the packets that were sent on this machine and not yet received; absent before Linux 5.10."""


def packets_under_way() -> bool:
    """Whether the kernel holds packets that it has yet to deliver: on a busy machine it is late."""
    try:
        lines = SOFTNET.read_text().splitlines()
    except OSError:  # another system
        return False
    return any(int(number, 16) for line in lines for number in line.split()[BACKLOG : BACKLOG + 1])


def until_delivered() -> None:
    """Wait until what was sent on this machine has arrived: a socket that is read at once may be empty before."""
    while packets_under_way():
        time.sleep(SHORTEST_S)


class PatientClock:
    """Seconds that only rise; from any thread. Stateful."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now_s = self._seen_s = time.monotonic()
        self._limits_s: dict[object, float] = {}

    def __call__(self) -> float:
        with self._lock:
            seen_s = time.monotonic()
            for who in [who for who in self._limits_s if isinstance(who, threading.Thread) and not who.is_alive()]:
                del self._limits_s[who]
            wanted_s = min([self._now_s + seen_s - self._seen_s, *self._limits_s.values()])
            self._now_s, self._seen_s = max(self._now_s, wanted_s), seen_s
            return self._now_s

    def allow(self, who: object, more_s: float = 0.0) -> None:
        """Let no more time pass than this until ``who`` says so again; none: time stands still."""
        limit_s = self() + more_s * (1 + 1e-6)  # or a sum of steps, rounded, stands just below its product for ever
        with self._lock:
            self._limits_s[who] = limit_s

    def free(self, who: object) -> None:
        """Forget a limit."""
        self()
        with self._lock:
            self._limits_s.pop(who, None)

    def sleep(self, seconds: float) -> None:
        """Return when so much of this time has passed; it then stands still until this thread sleeps again, or ends."""
        thread = threading.current_thread()
        self.allow(thread, max(seconds, SHORTEST_S))
        until_s = self._limits_s[thread]
        while (left_s := until_s - self()) > 0:
            time.sleep(min(max(left_s, SHORTEST_S), 0.02))
