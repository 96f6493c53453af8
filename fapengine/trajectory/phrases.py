"""Phrases and accents of a face's speech, as far as they are known; phones add to them as they come.

Theory of operation
-------------------
Phones that follow each other within :data:`PAUSE_S` are one phrase. They are added in any order; a stop's closure or a
lost phone ends no phrase. Few accents (stressed phones) are *outstanding*: an accent is skipped for :data:`REACH_S`
after an outstanding one, and while a stronger one of the same phrase follows within that time; but after twice that
time there is one in any case. So a phrase of two seconds has one, its strongest; a long one has one every 1.2 to 3 s.
Accents are judged in time order, and phones that are known :data:`REACH_S` ahead give the same ones as all phones.
"""

from bisect import bisect_left, bisect_right, insort
from math import log2

from fapengine.speech.phone_track import Phone

PAUSE_S = 0.15
"""Silence between two phrases. Closures of stops are shorter, and are phones anyway."""
REACH_S = 1.6
"""Time within which accents of a phrase compete: our choice."""
SECONDARY_DB = 3.0
"""Loudness that makes up for a secondary stress: our choice."""
DB_PER_DOUBLE_LENGTH = 3.0
"""Loudness that counts as much as twice the length, because stressed vowels are longer and louder: our choice."""
USUAL_S = 0.1
KEPT_S = 5.0
"""Time for which the past is kept."""


class Phrases:
    """Phrases and accents of one face.

    Stateful.
    """

    def __init__(self) -> None:
        self._spans: list[tuple[float, float]] = []
        self._accents: list[tuple[float, float]] = []

    def learn(self, start_s: float, phone: Phone) -> None:
        """Add a phone that begins at a time."""
        if phone.is_silence:
            return
        end_s = start_s + phone.duration_s
        first = bisect_left(self._spans, start_s - PAUSE_S, key=lambda span: span[1])
        last = bisect_right(self._spans, end_s + PAUSE_S, key=lambda span: span[0])
        joined = [*self._spans[first:last], (start_s, end_s)]
        self._spans[first:last] = [(min(begin_s for begin_s, _ in joined), max(stop_s for _, stop_s in joined))]
        if phone.stress:
            insort(self._accents, (start_s, strength_db(phone)))

    def forget_from(self, now_s: float) -> None:
        """Drop what is planned from now on."""
        self._accents = self._accents[: bisect_right(self._accents, (now_s, float("inf")))]
        self._spans = self._spans[: bisect_right(self._spans, now_s, key=lambda span: span[0])]
        if self._spans:
            self._spans[-1] = self._spans[-1][0], min(self._spans[-1][1], now_s)

    def forget_before(self, now_s: float) -> None:
        """Drop what ended more than :data:`KEPT_S` ago."""
        if self._spans and self._spans[0][1] < now_s - KEPT_S:
            del self._spans[: bisect_left(self._spans, now_s - KEPT_S, key=lambda span: span[1])]
        if self._accents and self._accents[0][0] < now_s - KEPT_S:
            del self._accents[: bisect_left(self._accents, (now_s - KEPT_S, 0.0))]

    def around(self, at_s: float) -> tuple[float, float] | None:
        """Beginning and end of the last phrase that has begun by a time; None before the first."""
        index = bisect_right(self._spans, at_s, key=lambda span: span[0]) - 1
        return None if index < 0 else self._spans[index]

    def following(self, at_s: float) -> tuple[float, float] | None:
        """Beginning and end of the first phrase that begins after a time."""
        index = bisect_right(self._spans, at_s, key=lambda span: span[0])
        return None if index == len(self._spans) else self._spans[index]

    def is_outstanding(self, start_s: float, phone: Phone, last_s: float) -> bool:
        """Whether an accent is the strongest of those near it; ``last_s``: beginning of the last one that was."""
        begins_s, ends_s = self.around(start_s) or (start_s, start_s)
        if begins_s <= last_s and start_s - last_s < REACH_S:
            return False
        if start_s - max(begins_s, last_s) >= 2 * REACH_S:
            return True
        first = bisect_right(self._accents, (start_s, 1e9))
        last = bisect_right(self._accents, (min(start_s + REACH_S, ends_s), 1e9))
        return all(other_db <= strength_db(phone) for _, other_db in self._accents[first:last])


def strength_db(phone: Phone) -> float:
    """Strength of an accent: its kind, loudness and length.

    Examples
    --------
    >>> strength_db(Phone("a", 0.0, 0.2, stress=1)) > strength_db(Phone("a", 0.0, 0.1, stress=1))
    True
    """
    length_db = DB_PER_DOUBLE_LENGTH * log2(phone.duration_s / USUAL_S)
    return round((0.0 if phone.stress == 1 else -SECONDARY_DB) + phone.loudness_db + length_db, 6)
