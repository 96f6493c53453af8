"""Pictures that wait for their time: a viewer who is slower than they come sees fewer, and none late for long.

Theory of operation
-------------------
Pictures and sound of one engine time are to be shown together, and sound does not wait. A machine that has too much
to do draws and encodes pictures late. To show them all would leave lips behind what is heard, by ever more; so of
several that are due the newest is shown, and none that is later than :data:`MAX_LATE_S`. Where all are later, one each
:data:`SEEN_S` is shown nevertheless: the viewer sees that the face is there.
"""

from collections import deque
from math import inf
from typing import Generic, TypeVar

MAX_LATE_S = 0.06
"""Lateness of a picture beyond which it is not shown. Sound ahead of a picture by 0.09 s is what viewers accept at most
(Recommendation ITU-R BT.1359-1); the rest is left for encoding."""
SEEN_S = 0.5
"""Time without a picture after which a late one is shown."""
MAX_WAITING = 8

Shown = TypeVar("Shown")


class Latest(Generic[Shown]):
    """Pictures by the time at which they are due. Stateful.

    Examples
    --------
    >>> pictures = Latest[str]()
    >>> pictures.put(1.00, "a"), pictures.put(1.04, "b"), pictures.put(1.08, "c")
    (None, None, None)
    >>> pictures.take(1.05), pictures.take(1.05), round(pictures.wait_s(1.05), 3), pictures.dropped
    ((1.04, 'b'), None, 0.03, 1)
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Shown]] = deque()
        self._taken_s = -inf
        self.dropped = 0
        """Number of pictures that were not shown."""

    def put(self, due_s: float, picture: Shown) -> None:
        """Add one, due no earlier than those before."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append((due_s, picture))

    def take(self, now_s: float) -> tuple[float, Shown] | None:
        """Take what is to be shown now, if anything is, and the time at which it was due."""
        due = []
        while self._waiting and self._waiting[0][0] <= now_s:
            due.append(self._waiting.popleft())
        if not due:
            return None
        due_s, picture = due[-1]
        is_shown = now_s - due_s <= MAX_LATE_S or now_s - self._taken_s >= SEEN_S
        self.dropped += len(due) - int(is_shown)
        if not is_shown:
            return None
        self._taken_s = now_s
        return due_s, picture

    def wait_s(self, now_s: float) -> float | None:
        """Tell how long until the next one is due, s; None: none waits."""
        return max(self._waiting[0][0] - now_s, 0.0) if self._waiting else None
