"""The server's load, which limits the number of new faces; and garbage collection.

A closed connection leaves a cycle of dead objects, a call some hundreds of them. If Python looked at all objects of the
program every few seconds, that would take 30 ms with 500 sessions; if it looked every ten minutes, the remains of many
calls would take longer. In either case no frame is shown meanwhile.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

WINDOW_S = 1.0
"""Time over which the load is averaged."""
FULL, FREE = 0.65, 0.55
"""Load above which no new face is accepted, and below which faces are accepted again."""
A_FACE = 0.004
"""Load that a new face is assumed to cause until it is measured: that of a face that speaks phone by phone at 60 Hz
(``python -m bench.sessions``). A face that waits needs a third of it."""
PIECES = 20_000, 1, 50
"""Thresholds of Python's garbage collector: a collection of so many new objects takes 4 ms."""


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


@contextmanager
def collecting_in_pieces() -> Iterator[None]:
    """Make Python collect garbage often, in small steps; objects that exist at the start are excluded."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*PIECES)
    try:
        yield
    finally:
        gc.unfreeze()
        gc.set_threshold(*before)
