"""The server's load, which limits the number of new faces; and garbage collection.

There is little garbage: each closed connection leaves one cycle of dead objects. Python's own collection runs every few
seconds; with 500 sessions it takes 30 ms, in which no frame is shown.
"""

import asyncio
import gc
import time
from dataclasses import dataclass

WINDOW_S = 1.0
"""Time over which the load is averaged."""
FULL, FREE = 0.65, 0.55
"""Load above which no new face is accepted, and below which faces are accepted again."""
A_FACE = 0.004
"""Load that a new face is assumed to cause until it is measured: that of a face that speaks phone by phone at 60 Hz
(``python -m bench.sessions``). A face that waits needs a third of it."""
COLLECT_SHARE = 1e-4
"""Fraction of the time that is spent on garbage collection."""
COLLECT_S = (30.0, 600.0)
"""Minimum and maximum time between two collections."""


@dataclass(slots=True)
class Load:
    """Processor time of the loop's thread divided by the time of the shown frames. Stateful.

    Other programs on the machine do not count: while they run, the thread only waits. The cost of new faces is known
    after one window, so each window accepts only as many as are assumed to fit.

    Parameters
    ----------
    rate_hz : float
        Frame rate.

    Examples
    --------
    >>> load = Load(rate_hz=50.0)
    >>> for frame in range(101):  # 18 of 20 ms
    ...     is_new = load.add(0.018 * frame, 0.02 * frame)
    >>> round(load.share, 2), load.is_full
    (0.9, True)
    """

    rate_hz: float
    share: float = 0.0
    """Load of the last window."""
    is_full: bool = False
    room: int = int(FULL / A_FACE)
    """Faces that may be accepted before the window ends."""
    _frames: int = 0
    _begun_s: float | None = None
    _begun_cpu_s: float = 0.0

    def add(self, cpu_s: float, now_s: float) -> bool:
        """Count a frame; return True if a window ended with it, and the load is new.

        Parameters
        ----------
        cpu_s : float
            Processor time of the thread up to now.
        now_s : float
        """
        if self._begun_s is None:
            self._begun_s, self._begun_cpu_s = now_s, cpu_s
            return False
        self._frames += 1
        if now_s - self._begun_s < WINDOW_S:
            return False
        self.share = (cpu_s - self._begun_cpu_s) * self.rate_hz / self._frames
        self.is_full = self.share > (FREE if self.is_full else FULL)
        self.room = 0 if self.is_full else int((FULL - self.share) / A_FACE)
        self._frames, self._begun_s, self._begun_cpu_s = 0, now_s, cpu_s
        return True


async def collect_now_and_then() -> None:
    """Collect garbage in place of Python, until cancelled; objects that exist now are never collected."""
    gc.disable()
    gc.collect()
    gc.freeze()
    took_s = 0.0
    try:
        while True:
            await asyncio.sleep(min(max(took_s / COLLECT_SHARE, COLLECT_S[0]), COLLECT_S[1]))
            begun_s = time.perf_counter()
            gc.collect()
            took_s = time.perf_counter() - begun_s
    finally:
        gc.unfreeze()
        gc.enable()
