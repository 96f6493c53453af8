"""How much of the time between frames the server's own work takes, which decides about new faces; garbage collection.

There is little garbage: each closed connection leaves one cycle of dead objects. Python by itself looks for cycles
every few seconds; with 500 sessions that takes 30 ms, in which nothing is shown.
"""

import asyncio
import gc
import time
from dataclasses import dataclass

WINDOW_S = 1.0
"""Time over which work is summed up."""
FULL, FREE = 0.65, 0.55
"""Share of the time that the faces need, from which on no new one is let in; and below which one is, again."""
A_FACE = 0.004
"""Share that a new face is taken to need until it was measured: what one needs that speaks, phone by phone, at 60
frames a second (``python -m bench.sessions``). One that only waits needs a third of it."""
COLLECT_SHARE = 1e-4
"""Share of its time that the server spends on collecting garbage."""
COLLECT_S = (30.0, 600.0)
"""Least and most time from one collection to the next."""


@dataclass(slots=True)
class Load:
    """Work of the loop's thread, in seconds of the processor, against the time of the frames that were shown.

    A machine that is busy with other programs does not count: there the thread waits, and works no more than before.
    What newcomers cost is known only after a window, so each window lets in no more than would fill the time.

    Stateful.

    Parameters
    ----------
    rate_hz : float
        Frames a second.

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
    """Share of the last window."""
    is_full: bool = False
    room: int = int(FULL / A_FACE)
    """Faces that may be let in before the window ends."""
    _frames: int = 0
    _begun_s: float | None = None
    _begun_cpu_s: float = 0.0

    def add(self, cpu_s: float, now_s: float) -> bool:
        """Count a frame, and tell whether a window ended with it: then all figures are new.

        Parameters
        ----------
        cpu_s : float
            Processor time of the thread up to now.
        now_s : float

        Returns
        -------
        bool
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
    """Collect garbage instead of Python, until cancelled; objects that exist now live as long as the server does."""
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
