"""The simple mode: one message a phone or viseme, from any tool, as utterances of the engine.

Theory of operation
-------------------
Senders tell a phone when it begins, so it is not known how long it lasts: it is *held*, :data:`FIRST_S` at first and
longer as long as nothing else comes, :data:`QUIET_S` at most, so that a sender that dies leaves no open mouth.
What begins later in time ends it. All is shown :data:`DELAY_S` late, which is not seen and lets the mouth anticipate:
the opening of the lips then correlates with that of a plan that knows all phones by 0.93, 60 ms behind it; without the
delay by 0.5 (tests/simulation).

Senders that know more tell start and duration in an utterance; its time 0 is ``/tts/start``, or else its first message
after a second without any. Without further messages an utterance is ended after that second; one whose first start lies
behind the end of the one before goes on in that one's time.

Senders of weights, for each viseme in each frame, are reduced to the one that is strongest.
"""

from bisect import bisect_right, insort
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from fapengine.live.engine.commands import Append, Begin, Cancel, Command, End
from fapengine.live.engine.utterance import Utterance
from fapengine.live.protocol.labels import LOWEST_WEIGHT
from fapengine.speech.phone_track import SILENCE, Phone

DELAY_S = 0.04
"""Sound that leads the face by so little is not noticed: ITU-R BT.1359 allows 125 ms."""
FIRST_S = 0.17
"""A phone, somewhat long: the next one cuts it."""
GRACE_S = 0.05
"""The next phone is told when this one ends, and until it is there the mouth must not come to rest."""
EARLY_S = 0.05
"""So long before its end a held phone is held on."""
QUIET_S = 1.0
"""Without a message for so long, an utterance is over."""
TURN_S = 20.0
"""Longer utterances of phones that are told as they begin are continued in a new one, so that none grows for ever."""
OVERTAKEN_S = 0.15
"""Phones that came so shortly before their ``/tts/start`` have overtaken it."""
FRAME_S = 0.04
"""A weight of a viseme counts until it is told anew, or for so long."""
REMEMBERED = 64
LATEST_S = 600.0
"""In an utterance."""
CANCEL_FADE_S = 0.15


@dataclass(slots=True)
class _Open:
    """Stateful: the utterance that is being told."""

    number: int
    zero_s: float | None
    """Engine time of its beginning; None: the engine's choice."""
    begun_s: float
    told_s: float
    """When something was last told, or is to begin."""
    started: bool = False
    """By ``/tts/start``."""
    next_index: int = 0
    end_s: float = 0.0
    """Of what is known, in its time."""
    starts_s: list[float] = field(default_factory=list)
    """Of phones that were told, rising, in its time; that one is held on does not count."""
    held: Phone | None = None


@dataclass(slots=True)
class SimpleSpeaker:
    """Stateful: see the theory of operation.

    Parameters
    ----------
    tell : callable
        Takes a command and the time.
    new_number : callable
        Gives numbers of utterances.
    find : callable
        Finds the engine's utterance.
    """

    tell: Callable[[Command, float], None]
    new_number: Callable[[], int]
    find: Callable[[int], Utterance | None]
    _open: _Open | None = None
    _last: int | None = None
    """The utterance before; what was told of it may still be said."""
    _zero_s: float | None = None
    """Of that one."""
    _end_s: float = 0.0
    _weights: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Viseme to weight and when it was told."""

    @property
    def is_open(self) -> bool:
        """Whether an utterance is being told: :meth:`tick` has work."""
        return self._open is not None

    def begin_phone(self, label: str, stress: int, at_s: float, now_s: float, duration_s: float | None = None) -> None:
        """Show a phone from ``at_s`` on, in engine time: for a duration, or until the next."""
        one = self._live(at_s, now_s)
        start_s = max(at_s + DELAY_S - (one.zero_s or 0.0), 0.0)
        after = bisect_right(one.starts_s, start_s + 1e-3)
        until_s = one.starts_s[after] if after < len(one.starts_s) else inf
        lasts_s = FIRST_S if duration_s is None else duration_s + GRACE_S
        phone = Phone(label, start_s, min(start_s + lasts_s, until_s), stress)
        self._append(one, phone, now_s)
        insort(one.starts_s, start_s)
        del one.starts_s[:-REMEMBERED]
        one.told_s = max(now_s, at_s)
        if start_s >= one.starts_s[-1]:
            one.held = phone if duration_s is None and label != SILENCE else None

    def place_phone(self, label: str, stress: int, start_s: float, duration_s: float, now_s: float) -> None:
        """Show a phone at a time of the utterance."""
        one = self._known()
        if one is not None and one.zero_s is not None and not one.started:  # it was told phone by phone
            self._end(one, now_s)
            one = None
        if one is None:
            goes_on = self._zero_s is not None and start_s >= self._end_s > 0.0
            in_time = goes_on and -0.5 < (self._zero_s or 0.0) + start_s - now_s < LATEST_S
            one = self._begin(self._zero_s if in_time else None, now_s)
            one.started = in_time
        self._append(one, Phone(label, start_s, start_s + duration_s, stress), now_s)
        insort(one.starts_s, start_s)
        del one.starts_s[:-REMEMBERED]
        one.told_s = now_s

    def weigh(self, label: str, weight: float, at_s: float, now_s: float) -> None:
        """Take a weight of a viseme; show the strongest, when it changes."""
        held = self._open.held if self._open else None
        self._weights[label] = (weight, at_s)
        self._weights = {name: told for name, told in self._weights.items() if at_s - told[1] <= FRAME_S}
        weights = {name: told[0] for name, told in self._weights.items()}
        best = max(reversed(weights), key=lambda name: weights[name])
        if weights[best] < LOWEST_WEIGHT:
            best = SILENCE
        if held is None and best == SILENCE:
            return
        if held is not None and best == held.label:
            if self._open is not None and best == label:
                self._open.told_s = max(now_s, at_s)
            return
        self.begin_phone(best, 0, at_s, now_s)

    def start(self, at_s: float, now_s: float) -> None:
        """Open an utterance: its sound begins at ``at_s``, and what was said before is over."""
        one = self._open
        overtaken = one is not None and one.zero_s is None and now_s - one.begun_s < OVERTAKEN_S
        if one is not None and overtaken:
            self._open = None
        self.stop(at_s, now_s)
        if one is not None and overtaken:
            self._open = one
        else:
            one = self._begin(at_s + DELAY_S, now_s)
        one.started = True

    def stop(self, at_s: float, now_s: float) -> bool:
        """Close the utterance: its sound ends at ``at_s``, what lies behind is not said; whether there was one."""
        if self._open is not None:
            self._end(self._open, now_s)
        number, self._last, self._zero_s = self._last, None, None
        known = self.find(number) if number is not None else None
        if number is None or known is None:
            return False
        over_s = now_s + known.end_s - known.position_s(now_s) if known.anchored else inf
        if over_s > at_s + DELAY_S:
            self.tell(Cancel(number, at_s + DELAY_S, CANCEL_FADE_S), now_s)
        return True

    def tick(self, now_s: float) -> None:
        """Hold on what is held; end what is quiet."""
        one = self._open
        if one is None:
            return
        if one.held is not None and one.zero_s is not None:
            here_s = now_s - one.zero_s
            if one.held.end_s - here_s < EARLY_S:
                one.held = Phone(one.held.label, one.held.end_s, one.held.end_s + FIRST_S)
                self._append(one, one.held, now_s)
        if now_s - one.told_s > QUIET_S:
            self._end(one, now_s)

    def _known(self) -> _Open | None:
        """Return the utterance that is being told, unless the engine is through with it: others may cancel, too."""
        if self._open is not None and self.find(self._open.number) is None:
            self._open = None
        return self._open

    def _live(self, at_s: float, now_s: float) -> _Open:
        """Return the utterance in which phones are told as they begin."""
        one = self._known()
        if one is not None and one.zero_s is not None and at_s - one.zero_s < TURN_S:
            return one
        if one is not None:
            self._end(one, now_s)
        return self._begin(min(at_s, now_s) + DELAY_S, now_s)  # a tag of less may come behind one of more

    def _begin(self, zero_s: float | None, now_s: float) -> _Open:
        one = self._open = _Open(self.new_number(), zero_s, now_s, now_s)
        self.tell(Begin(one.number) if zero_s is None else Begin(one.number, "at", zero_s), now_s)
        return one

    def _append(self, one: _Open, phone: Phone, now_s: float) -> None:
        self.tell(Append(one.number, one.next_index, (phone,)), now_s)
        one.next_index += 1
        one.end_s = max(one.end_s, phone.end_s)

    def _end(self, one: _Open, now_s: float) -> None:
        zero_s = one.zero_s
        if zero_s is None:
            known = self.find(one.number)
            zero_s = now_s - known.position_s(now_s) if known is not None and known.anchored else None
        self._open, self._last, self._zero_s, self._end_s = None, one.number, zero_s, one.end_s
        self.tell(End(one.number, one.next_index, one.end_s), now_s)
