"""When frames are due: absolute times, so that lateness never adds up."""

import math
from dataclasses import dataclass

from fapengine.errors import UsageError

MAX_RATE_HZ = 1000.0


@dataclass(slots=True)
class FramePacer:
    """A counter of frames at a steady rate. A frame that is past its successor's time is skipped, not caught up.

    Stateful.

    Raises
    ------
    UsageError
        If the rate is not in 1..1000.

    Examples
    --------
    >>> pacer = FramePacer(rate_hz=10.0, start_s=0.0)
    >>> pacer.due(0.05), pacer.due(0.101), pacer.due(0.47)
    ((0, 0), (1, 0), (4, 2))
    >>> pacer.due(0.48) is None, round(pacer.next_s, 6)
    (True, 0.5)
    """

    rate_hz: float
    start_s: float
    """Time of frame 0."""
    skipped: int = 0
    """Frames that were never shown, because the caller came too late for them."""
    _next: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.rate_hz <= MAX_RATE_HZ:
            raise UsageError(f"rate_hz: got {self.rate_hz}, expected 1..{MAX_RATE_HZ:g}")

    @property
    def next_s(self) -> float:
        """When the next frame is due."""
        return self.start_s + self._next / self.rate_hz

    def due(self, now_s: float) -> tuple[int, int] | None:
        """Take the frame that is due: its number, and how many before it were skipped; None if none is due."""
        number = math.floor((now_s - self.start_s) * self.rate_hz + 1e-6)  # a clock that says 0.0999999 means 0.1
        if number < self._next:
            return None
        skipped = number - self._next
        self.skipped += skipped
        self._next = number + 1
        return number, skipped
