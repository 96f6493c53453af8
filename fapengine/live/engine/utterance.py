"""One utterance: phones by index as they come, and where its time lies in that of its session."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf

from fapengine.live.engine.commands import Anchor, Append, End
from fapengine.speech.phone_track import Phone


@dataclass(slots=True)
class StreamClock:
    """A session's time, which only its utterances' sound can bend.

    Stateful.
    """

    begins_s: float
    """Engine time at which it is 0."""

    def stream_s(self, now_s: float) -> float:
        """Session's time."""
        return now_s - self.begins_s


@dataclass(slots=True)
class Utterance:
    """An utterance, as far as it has come. Its time 0 is where its sound begins.

    Stateful.
    """

    number: int
    clock: StreamClock
    anchor: Anchor | None = None
    """Way in which its beginning is set; None when its phones came before its ``Begin``."""
    at_s: float = 0.0
    """Session's time of its beginning, for ``"at"``."""
    revision: int = 0
    phones: dict[int, Phone] = field(default_factory=dict)
    phone_count: int | None = None
    """Number of its phones; None until its end is known."""
    duration_s: float | None = None
    zero_s: float | None = None
    """Session's time of its beginning, once it is settled."""
    next_index: int = 0
    """Index below which all phones are there."""
    latest_s: float = -inf
    """Engine time of its last news."""
    is_over: bool = False
    has_started: bool = False
    is_dry: bool = False
    """True when its time has passed the last phone that has come, and more should come."""
    resume_s: float | None = None
    """Position in its own time, while it is paused."""
    concealed: set[int] = field(default_factory=set)
    """Indices of phones for which another stood in."""
    last_s: float = 0.0
    """End of what is known, gaps or not."""
    _newest_s: float = inf
    """Beginning of the phones that came last."""

    @property
    def anchored(self) -> bool:
        """Whether its beginning is settled."""
        return self.zero_s is not None

    @property
    def end_s(self) -> float:
        """Where it is over, if no more phones come."""
        return max(self.duration_s or 0.0, self.last_s)

    def position_s(self, now_s: float) -> float:
        """Find its own time; minus infinity before it is settled."""
        return -inf if self.zero_s is None else self.clock.stream_s(now_s) - self.zero_s

    def slack_s(self, now_s: float) -> float:
        """How long before their time the phones that came last have come; negative: too late."""
        return self._newest_s - self.position_s(now_s)

    def missing(self) -> list[tuple[int, int]]:
        """Gaps as (first index, index behind the last), the tail too once the end is known."""
        return gaps(self.phones, self.next_index, self.phone_count)

    def add(self, command: Append) -> list[Phone]:
        """Take phones in; returns those that are new."""
        new = []
        for index, phone in enumerate(command.phones, command.first_index):
            if index not in self.phones and (self.phone_count is None or index < self.phone_count):
                self.phones[index] = phone
                self.last_s = max(self.last_s, phone.end_s)
                new.append(phone)
        while self.next_index in self.phones:
            self.next_index += 1
        if new:
            self._newest_s = min(phone.start_s for phone in new)
        return new

    def revise(self, revision: int, from_s: float) -> None:
        """Forget the phones that begin at or behind ``from_s``, and its end: new ones come."""
        self.revision = revision
        self.phones = {index: phone for index, phone in self.phones.items() if phone.start_s < from_s}
        self.last_s = max((phone.end_s for phone in self.phones.values()), default=0.0)
        self.phone_count = self.duration_s = None
        self.is_dry = False
        self.next_index = 0
        while self.next_index in self.phones:
            self.next_index += 1
        self.concealed = {index for index in self.concealed if index < self.next_index}

    def limit(self, command: End) -> None:
        """Learn how much there is."""
        self.phone_count, self.duration_s = command.phone_count, command.duration_s

    def gap(self) -> tuple[Phone, Phone, range] | None:
        """First gap that no other phone stands in for yet: the phones on both sides, and the indices between them."""
        indices = sorted(self.phones)
        for before, after in pairwise(indices):
            if after > before + 1 and not self.concealed.issuperset(range(before + 1, after)):
                return self.phones[before], self.phones[after], range(before + 1, after)
        return None

    def in_stream(self, phones: Iterable[Phone], from_s: float) -> list[Phone]:
        """Shift phones into the session's time, without what lies before ``from_s`` there."""
        if self.zero_s is None:
            return []
        shifted = []
        for phone in phones:
            start_s, end_s = max(phone.start_s + self.zero_s, from_s, 0.0), phone.end_s + self.zero_s
            if end_s > start_s:
                shifted.append(replace(phone, start_s=start_s, end_s=end_s))
        return shifted


def gaps(known: Iterable[int], first: int, stop: int | None) -> list[tuple[int, int]]:
    """Find what is missing from ``first`` on, as (first index, index behind the last).

    Parameters
    ----------
    known : iterable of int
        Indices that are there.
    first, stop : int
        Between them; no stop: to the highest that is known.
    """
    stops = sorted(index for index in known if index >= first and (stop is None or index < stop))
    if stop is not None:
        stops.append(stop)
    starts = [first, *(index + 1 for index in stops)]
    return [(start, end) for start, end in zip(starts, stops, strict=False) if start < end]
