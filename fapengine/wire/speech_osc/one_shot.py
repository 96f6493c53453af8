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

from fapengine.engine.commands import Append, Begin, Cancel, Command, End
from fapengine.engine.utterance import Utterance
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.wire.speech_osc.phone_labels import MIN_WEIGHT

DELAY_S = 0.04
"""Sound that leads the face by so little is not noticed: ITU-R BT.1359 allows 125 ms."""
FIRST_S = 0.17
"""Length of a phone at first, somewhat long: the next one cuts it."""
GRACE_S = 0.05
"""The next phone is told when this one ends, and until it is there the mouth must not come to rest."""
EARLY_S = 0.05
"""Time before its end at which a held phone is held on."""
QUIET_S = 1.0
"""Time without a message after which an utterance is over."""
TURN_S = 20.0
"""Length from which an utterance of phones that come as they begin goes on in a new one, so that none grows on."""
OVERTAKEN_S = 0.15
"""Phones that came so shortly before their ``/tts/start`` have overtaken it."""
FRAME_S = 0.04
"""Time for which a weight of a viseme counts, if no new one comes."""
REMEMBERED = 64
LATEST_S = 600.0
"""Latest end of a phone in an utterance."""
CANCEL_FADE_S = 0.15


@dataclass(slots=True)
class _Open:
    """The utterance to which phones are added.

    Stateful.
    """

    number: int
    zero_s: float | None
    """Engine time of its beginning; None: the engine's choice."""
    begun_s: float
    told_s: float
    """Time of the last message of it, or of the start that it gave."""
    started: bool = False
    """True where ``/tts/start`` opened it."""
    next_index: int = 0
    end_s: float = 0.0
    """End of its last phone, in its time."""
    starts_s: list[float] = field(default_factory=list)
    """Starts of its phones, rising, in its time; that a phone is held on does not count."""
    held: Phone | None = None


@dataclass(slots=True)
class SimpleSpeaker:
    """Utterances made of single messages; see the theory of operation.

    Stateful.

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
    """Number of the utterance before; what came of it may still be said."""
    _zero_s: float | None = None
    """Start of that utterance."""
    _end_s: float = 0.0
    _weights: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Weight of each viseme, and the time at which it came."""

    @property
    def is_open(self) -> bool:
        """Whether an utterance is being told: :meth:`tick` has work."""
        return self._open is not None

    def begin_phone(self, label: str, stress: int, at_s: float, now_s: float, duration_s: float | None = None) -> None:
        """Show a phone from ``at_s`` on, in engine time: for a duration, or until the next."""
        utterance = self._live(at_s, now_s)
        start_s = max(at_s + DELAY_S - (utterance.zero_s or 0.0), 0.0)
        after = bisect_right(utterance.starts_s, start_s + 1e-3)
        until_s = utterance.starts_s[after] if after < len(utterance.starts_s) else inf
        lasts_s = FIRST_S if duration_s is None else duration_s + GRACE_S
        phone = Phone(label, start_s, min(start_s + lasts_s, until_s), stress)
        self._append(utterance, phone, now_s)
        insort(utterance.starts_s, start_s)
        del utterance.starts_s[:-REMEMBERED]
        utterance.told_s = max(now_s, at_s)
        if start_s >= utterance.starts_s[-1]:
            utterance.held = phone if duration_s is None and label != SILENCE else None

    def place_phone(self, label: str, stress: int, start_s: float, duration_s: float, now_s: float) -> None:
        """Show a phone at a time of the utterance."""
        utterance = self._known()
        phone_by_phone = utterance is not None and utterance.zero_s is not None and not utterance.started
        if utterance is not None and phone_by_phone:
            self._end(utterance, now_s)
            utterance = None
        if utterance is None:
            goes_on = self._zero_s is not None and start_s >= self._end_s > 0.0
            in_time = goes_on and -0.5 < (self._zero_s or 0.0) + start_s - now_s < LATEST_S
            utterance = self._begin(self._zero_s if in_time else None, now_s)
            utterance.started = in_time
        self._append(utterance, Phone(label, start_s, start_s + duration_s, stress), now_s)
        insort(utterance.starts_s, start_s)
        del utterance.starts_s[:-REMEMBERED]
        utterance.told_s = now_s

    def weigh(self, label: str, weight: float, at_s: float, now_s: float) -> None:
        """Take a weight of a viseme; show the strongest, when it changes."""
        held = self._open.held if self._open else None
        self._weights[label] = (weight, at_s)
        self._weights = {name: entry for name, entry in self._weights.items() if at_s - entry[1] <= FRAME_S}
        weights = {name: entry[0] for name, entry in self._weights.items()}
        best = max(reversed(weights), key=lambda name: weights[name])
        if weights[best] < MIN_WEIGHT:
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
        utterance = self._open
        overtaken = utterance is not None and utterance.zero_s is None and now_s - utterance.begun_s < OVERTAKEN_S
        if utterance is not None and overtaken:
            self._open = None
        self.stop(at_s, now_s)
        if utterance is not None and overtaken:
            self._open = utterance
        else:
            utterance = self._begin(at_s + DELAY_S, now_s)
        utterance.started = True

    def stop(self, at_s: float, now_s: float) -> bool:
        """Close the utterance: its sound ends at ``at_s``, what lies behind is not said; whether there was one."""
        if self._open is not None:
            self._end(self._open, now_s)
        number, self._last, self._zero_s = self._last, None, None
        in_engine = self.find(number) if number is not None else None
        if number is None or in_engine is None:
            return False
        over_s = now_s + in_engine.end_s - in_engine.position_s(now_s) if in_engine.state.is_placed else inf
        if over_s > at_s + DELAY_S:
            self.tell(Cancel(number, at_s + DELAY_S, CANCEL_FADE_S), now_s)
        return True

    def tick(self, now_s: float) -> None:
        """Hold on what is held; end what is quiet."""
        utterance = self._open
        if utterance is None:
            return
        if utterance.held is not None and utterance.zero_s is not None:
            here_s = now_s - utterance.zero_s
            if utterance.held.end_s - here_s < EARLY_S:
                utterance.held = Phone(utterance.held.label, utterance.held.end_s, utterance.held.end_s + FIRST_S)
                self._append(utterance, utterance.held, now_s)
        if now_s - utterance.told_s > QUIET_S:
            self._end(utterance, now_s)

    def _known(self) -> _Open | None:
        """Return the utterance that is being told, unless the engine is through with it: others may cancel, too."""
        if self._open is not None and self.find(self._open.number) is None:
            self._open = None
        return self._open

    def _live(self, at_s: float, now_s: float) -> _Open:
        """Return the utterance in which phones are told as they begin."""
        utterance = self._known()
        if utterance is not None and utterance.zero_s is not None and at_s - utterance.zero_s < TURN_S:
            return utterance
        if utterance is not None:
            self._end(utterance, now_s)
        return self._begin(min(at_s, now_s) + DELAY_S, now_s)  # a tag of less may come behind one of more

    def _begin(self, zero_s: float | None, now_s: float) -> _Open:
        utterance = self._open = _Open(self.new_number(), zero_s, now_s, now_s)
        self.tell(Begin(utterance.number) if zero_s is None else Begin(utterance.number, "at", zero_s), now_s)
        return utterance

    def _append(self, utterance: _Open, phone: Phone, now_s: float) -> None:
        self.tell(Append(utterance.number, utterance.next_index, (phone,)), now_s)
        utterance.next_index += 1
        utterance.end_s = max(utterance.end_s, phone.end_s)

    def _end(self, utterance: _Open, now_s: float) -> None:
        zero_s = utterance.zero_s
        if zero_s is None:
            in_engine = self.find(utterance.number)
            if in_engine is not None and in_engine.state.is_placed:
                zero_s = now_s - in_engine.position_s(now_s)
        self._open, self._last, self._zero_s, self._end_s = None, utterance.number, zero_s, utterance.end_s
        self.tell(End(utterance.number, utterance.next_index, utterance.end_s), now_s)
