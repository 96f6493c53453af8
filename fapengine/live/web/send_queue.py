"""What waits to be sent to one page, and how much it may say; neither knows a socket or a clock."""

from collections import deque
from dataclasses import dataclass, field

MAX_TEXTS = 512
MAX_FRAMES = 3
"""Frames that wait; older ones are of no use to anybody."""


@dataclass(slots=True)
class SendQueue:
    """A send queue: all texts in order; frames only as long as they are fresh.

    Stateful.
    """

    dropped: int = 0
    """Frames that were never sent."""
    overflowed: bool = False
    """More texts came than a page can be behind: it is lost, and must begin anew."""
    _texts: deque[str] = field(default_factory=deque)
    _frames: deque[bytes] = field(default_factory=deque)

    def put_text(self, text: str) -> None:
        """Add a text."""
        if len(self._texts) < MAX_TEXTS:
            self._texts.append(text)
        else:
            self.overflowed = True

    def put_frame(self, frame: bytes) -> None:
        """Add a frame; the oldest goes where too many wait."""
        if len(self._frames) == MAX_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(frame)

    def take(self) -> str | bytes | None:
        """Take what is to be sent next: texts first, for they explain the frames."""
        if self._texts:
            return self._texts.popleft()
        return self._frames.popleft() if self._frames else None


@dataclass(slots=True)
class TokenBucket:
    """A token bucket: a rate of messages a second, and a burst.

    Stateful.
    """

    rate_hz: float
    burst: float
    _left: float = field(init=False)
    _since_s: float | None = None

    def __post_init__(self) -> None:
        self._left = self.burst

    def take(self, now_s: float) -> bool:
        """Whether one more is allowed now.

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
