"""How much of the time between frames the server's own work takes: what newcomers are admitted by."""

from dataclasses import dataclass

WINDOW_S = 1.0
"""Time over which work is summed up."""
FULL, FREE = 0.8, 0.65
"""Share of the time that the faces need, from which on no new one is let in; and below which one is, again."""


@dataclass(slots=True)
class Load:
    """Work of the loop's thread, in seconds of the processor, against the time of the frames that were shown.

    A machine that is busy with other programs does not count: there the thread waits, and works no more than before.

    Stateful.

    Parameters
    ----------
    rate_hz : float
        Frames a second.

    Examples
    --------
    >>> load = Load(rate_hz=50.0)
    >>> for frame in range(101):  # 18 of 20 ms
    ...     load.add(0.018 * frame, 0.02 * frame)
    >>> round(load.share, 2), load.is_full
    (0.9, True)
    """

    rate_hz: float
    share: float = 0.0
    """Share of the last window."""
    is_full: bool = False
    _frames: int = 0
    _begun_s: float | None = None
    _begun_cpu_s: float = 0.0

    def add(self, cpu_s: float, now_s: float) -> None:
        """Count a frame.

        Parameters
        ----------
        cpu_s : float
            Processor time of the thread up to now.
        now_s : float
        """
        if self._begun_s is None:
            self._begun_s, self._begun_cpu_s = now_s, cpu_s
            return
        self._frames += 1
        if now_s - self._begun_s < WINDOW_S:
            return
        self.share = (cpu_s - self._begun_cpu_s) * self.rate_hz / self._frames
        self.is_full = self.share > (FREE if self.is_full else FULL)
        self._frames, self._begun_s, self._begun_cpu_s = 0, now_s, cpu_s
