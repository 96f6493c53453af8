"""Sound of one utterance as it comes: in order, without holes, once.

Theory of operation
-------------------
Each datagram says which sample of the utterance its first one is, so what comes twice or in another order does no
harm. What is behind a gap is held for :data:`HOLD_S`; a gap that lasts longer is filled. A short one, of
:data:`MIRROR_S`, is filled with the sound before it, backwards, so that it goes on as it was; the rest is silence.
"""

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

HOLD_S = 0.06
"""Time that sound waits for what it overtook."""
MIRROR_S = 0.06
MAX_GAP_S = 10.0
"""Longest gap that is filled; what lies farther ahead is refused."""
JOIN_S = 2.0
"""Length up to which the beginning is waited for; an utterance whose first sound is later is joined there."""
RATES_HZ = (8_000, 48_000)
"""Rates that are taken."""


@dataclass(slots=True)
class SoundWindow:
    """Sound of one utterance on its way in. Stateful."""

    rate_hz: int
    first: int = -1
    """Sample at which it was joined; -1 before any came."""
    next: int = 0
    """Sample below which all was released."""
    stop: int | None = None
    """Sample at which it is over, once that is known."""
    lost: int = 0
    """Samples that were filled in."""
    is_released: bool = False
    """True when its end was released."""
    _held: dict[int, NDArray[np.int16]] = field(default_factory=dict)
    _since_s: float = inf
    """Time at which something was first held, or the end became known."""
    _last: NDArray[np.int16] = field(default_factory=lambda: np.zeros(0, np.int16))

    def take(self, first: int, samples: NDArray[np.int16], now_s: float) -> bool | None:
        """Take sound in, (N,) int16; False if there was nothing new in it, None if it lies too far ahead."""
        if self.first < 0:
            self.first = self.next = first if first > JOIN_S * self.rate_hz else 0
        behind = first + len(samples)
        if first - self.next > MAX_GAP_S * self.rate_hz:
            return None
        if behind <= self.next or first in self._held or (self.stop is not None and first >= self.stop):
            return False
        self._held[first] = samples
        self._since_s = min(self._since_s, now_s)
        return True

    def finish(self, stop: int | None, now_s: float) -> None:
        """Learn where it is over; None: where it has come to."""
        if self.stop is None:
            came = max([self.next, *(first + len(held) for first, held in self._held.items())])
            self.stop = came if stop is None else min(max(stop, came), came + round(MAX_GAP_S * self.rate_hz))
            self._since_s = min(self._since_s, now_s)

    def release(self, now_s: float) -> list[NDArray[np.int16]]:
        """Give what follows, (N,) int16 each; gaps are filled when they have lasted."""
        pieces = self._in_order()
        while self._since_s <= now_s - HOLD_S and self._held:
            pieces += [self._fill(min(self._held) - self.next), *self._in_order()]
        if self.stop is not None and not self._held and not self.is_released:
            if self.next < self.stop and self._since_s <= now_s - HOLD_S:
                pieces.append(self._fill(self.stop - self.next))
            self.is_released = self.next >= self.stop
        if pieces or not self._held:
            self._since_s = now_s if self._held or (self.stop is not None and not self.is_released) else inf
        return pieces

    def _in_order(self) -> list[NDArray[np.int16]]:
        pieces = []
        while self._held:
            first = min(self._held)
            if first > self.next:
                break
            piece = self._held.pop(first)[self.next - first :]
            if self.stop is not None:
                piece = piece[: max(self.stop - self.next, 0)]
            if len(piece):
                pieces.append(piece)
                self._last = piece
                self.next += len(piece)
        return pieces

    def _fill(self, count: int) -> NDArray[np.int16]:
        filled = np.zeros(count, np.int16)
        back = self._last[::-1][: min(count, round(MIRROR_S * self.rate_hz))]
        filled[: len(back)] = back
        self.next += count
        self.lost += count
        return filled
