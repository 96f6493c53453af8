"""The simple mode: one message per phone or viseme, from any tool, as utterances of the engine.

Theory of operation
-------------------
A sender reports a phone when it begins, so its duration is not known. The phone is *held*: for :data:`FIRST_S` at
first, longer while nothing else arrives, for :data:`QUIET_S` at most, so that a sender that crashes leaves no open
mouth. A later phone ends it. Everything is shown :data:`DELAY_S` late, which is not noticed and lets the mouth
anticipate: the opening of the lips then correlates with that of a plan that knows all phones by 0.93, 60 ms behind it;
without the delay by 0.5 (tests/simulation).

A sender that knows more gives start and duration in an utterance. Its time 0 is ``/tts/start``, or else the first
message after a second without any. An utterance ends after a second without messages; one whose first start is after
the end of the previous one continues in the time of that one.

A sender of weights, one per viseme and frame, is reduced to the strongest viseme.
"""

import math
from bisect import bisect_right, insort
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from math import inf

from fapengine.engine import commands
from fapengine.engine.commands import Append, Begin, Cancel, End
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event
from fapengine.errors import DataError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import phone_labels, schema
from fapengine.wire.speech_osc.peers import Arrival
from fapengine.wire.speech_osc.phone_labels import MIN_WEIGHT

PHONEME, VISEME, START, STOP = "/phoneme", "/viseme", "/tts/start", "/tts/stop"
EVENTS, EVENT = "/tts/events", "/tts/event"
"""Subscription to events, and one event."""
ADDRESSES = (PHONEME, VISEME, START, STOP, EVENTS)
TEXT = "/tts/text"
MAX_NAME_LENGTH = 64
MIN_DURATION_S, MAX_DURATION_S = 0.001, 60.0
"""Durations are clamped to these."""
DELAY_S = 0.04
"""A face this late is not noticed: ITU-R BT.1359 allows sound to lead by 125 ms."""
FIRST_S = 0.17
"""First length of a held phone, rather too long: the next phone cuts it."""
GRACE_S = 0.05
"""Extra length of a phone of known duration: the next one arrives when it ends, and the mouth must not rest before."""
EARLY_S = 0.05
"""Time before its end at which a held phone is extended."""
QUIET_S = 1.0
"""Time without a message after which an utterance ends."""
TURN_S = 20.0
"""Length at which an utterance of held phones continues in a new one, so that none grows without limit."""
OVERTAKEN_S = 0.15
"""Phones that arrive this short a time before ``/tts/start`` belong after it."""
FRAME_S = 0.04
"""Time for which the weight of a viseme is valid."""
REMEMBERED = 64
LATEST_S = 600.0
"""Latest end of a phone in an utterance."""
CANCEL_FADE_S = 0.15


@cache
def nameless() -> dict[str, schema.Kind]:
    """Return the messages of the robust mode that may come without their first argument, the session."""
    return {TEXT: schema.SpeakText, **{kind.SPEC.one_shot: kind for kind in commands.COMMANDS if kind.SPEC.one_shot}}


def event_packet(event: Event) -> bytes:
    """Encode an event for simple senders: ``/tts/event``, kind, position in the utterance in s, its number.

    Examples
    --------
    >>> (message,) = osc.parse_packet(event_packet(Event("face", 1, "finished", 2.0, position_s=0.5)))
    >>> message.address, message.arguments
    ('/tts/event', ('finished', 0.5, 1))
    """
    return osc.message(EVENT, "sfi", event.kind, event.position_s, event.utterance)


@dataclass(slots=True)
class _Open:
    """The utterance to which phones are added.

    Stateful.
    """

    number: int
    zero_s: float | None
    """Engine time of its beginning; None: the engine chooses."""
    begun_s: float
    told_s: float
    """Time of its last message, or of the start that it gave."""
    started: bool = False
    """True if ``/tts/start`` opened it."""
    next_index: int = 0
    end_s: float = 0.0
    """End of its last phone, in its time."""
    starts_s: list[float] = field(default_factory=list)
    """Starts of its phones, rising, in its time, without extensions of held phones."""
    held: Phone | None = None


@dataclass(slots=True)
class SimpleMode:
    """Speech in the session that has no name on the wire; see the theory of operation.

    Stateful.
    """

    session: str
    """Its name in the engine."""
    engine: Engine
    numbers: Iterator[int]
    """Engine numbers for new utterances."""
    latest_s: float
    """Latest end of a phone in an utterance, where start and duration are given."""
    _open: _Open | None = None
    _last: int | None = None
    """Number of the previous utterance, which may still be spoken."""
    _zero_s: float | None = None
    """Start of that utterance."""
    _end_s: float = 0.0
    _weights: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Weight of each viseme, and its time of arrival."""

    def obey(self, message: osc.Message, arrival: Arrival) -> bool:
        """Do what a message says; the session is open. True: the server's voice is to stop, too.

        Raises DataError if its arguments are wrong.
        """
        match message.address:
            case "/phoneme":
                self._phoneme(message.arguments, arrival)
            case "/viseme":
                self._viseme(message.arguments, arrival)
            case "/tts/start":
                self._start(arrival.at_s, arrival.now_s)
            case _:
                return not self._stop(arrival.at_s, arrival.now_s)
        return False

    def tick(self, now_s: float) -> None:
        """Extend the held phone; end an utterance without news."""
        utterance = self._open
        if utterance is None:
            return
        if self.session not in self.engine:  # others closed it
            self._open, self._last, self._zero_s, self._end_s = None, None, None, 0.0
            self._weights.clear()
            return
        if utterance.held is not None and utterance.zero_s is not None:
            here_s = now_s - utterance.zero_s
            if utterance.held.end_s - here_s < EARLY_S:
                utterance.held = Phone(utterance.held.label, utterance.held.end_s, utterance.held.end_s + FIRST_S)
                self._append(utterance, utterance.held, now_s)
        if now_s - utterance.told_s > QUIET_S:
            self._end(utterance, now_s)

    def _phoneme(self, arguments: tuple[osc.Argument, ...], arrival: Arrival) -> None:
        label, times = _label_and_numbers(PHONEME, arguments, arrival)
        if not isinstance(label, str):
            raise DataError(f"{PHONEME}: got {label!r}, expected a string")
        prefix, _, rest = label.partition(":")
        phone_set = phone_labels.phone_set_named(prefix) if prefix and rest else None
        if phone_set is None:
            arrival.peer.labels.append(label.strip())
            named_set = phone_labels.phone_set_named(arrival.peer.phone_set) if arrival.peer.phone_set else None
            phone_set, rest = named_set or guess(arrival.peer.labels).alphabet, label
        ipa, stress = phone_labels.to_phone(rest, phone_set)
        if len(times) < 2:
            duration_s = _clamped(times[0]) if times and times[0] > 0 else None
            self._begin_phone(ipa, stress, arrival, duration_s)
        elif 0 <= times[0] <= self.latest_s - _clamped(times[1]):
            self._place_phone(Phone(ipa, times[0], times[0] + _clamped(times[1]), stress), arrival.now_s)
        else:
            raise DataError(f"{PHONEME}: got {times[0]} to {times[0] + times[1]} s, expected 0 to {self.latest_s}")

    def _viseme(self, arguments: tuple[osc.Argument, ...], arrival: Arrival) -> None:
        name, values = _label_and_numbers(VISEME, arguments, arrival)
        label = phone_labels.to_viseme(name)
        if not values:
            self._begin_phone(label, 0, arrival)
        elif len(values) == 1:
            self._weigh(label, values[0], arrival)
        elif values[0] >= MIN_WEIGHT:
            self._begin_phone(label, 0, arrival, _clamped(values[1]))

    def _begin_phone(self, label: str, stress: int, arrival: Arrival, duration_s: float | None = None) -> None:
        """Show a phone from the time of its message on: for a duration, or until the next."""
        at_s, now_s = arrival.at_s, arrival.now_s
        utterance = self._live(at_s, now_s)
        start_s = max(at_s + DELAY_S - (utterance.zero_s or 0.0), 0.0)
        after = bisect_right(utterance.starts_s, start_s + 1e-3)
        until_s = utterance.starts_s[after] if after < len(utterance.starts_s) else inf
        lasts_s = FIRST_S if duration_s is None else duration_s + GRACE_S
        phone = Phone(label, start_s, min(start_s + lasts_s, until_s), stress)
        self._add(utterance, phone, now_s, max(now_s, at_s))
        if start_s >= utterance.starts_s[-1]:
            utterance.held = phone if duration_s is None and label != SILENCE else None

    def _place_phone(self, phone: Phone, now_s: float) -> None:
        """Show a phone at a time of the utterance."""
        utterance = self._known()
        if utterance is not None and utterance.zero_s is not None and not utterance.started:  # of held phones
            self._end(utterance, now_s)
            utterance = None
        if utterance is None:
            goes_on = self._zero_s is not None and phone.start_s >= self._end_s > 0.0
            in_time = goes_on and -0.5 < (self._zero_s or 0.0) + phone.start_s - now_s < LATEST_S
            utterance = self._begin(self._zero_s if in_time else None, now_s)
            utterance.started = in_time
        self._add(utterance, phone, now_s, now_s)

    def _weigh(self, label: str, weight: float, arrival: Arrival) -> None:
        """Store the weight of a viseme; show the strongest viseme when it changes."""
        at_s = arrival.at_s
        held = self._open.held if self._open else None
        self._weights[label] = (weight, at_s)
        self._weights = {name: entry for name, entry in self._weights.items() if at_s - entry[1] <= FRAME_S}
        weights = {name: entry[0] for name, entry in self._weights.items()}
        best = max(reversed(weights), key=lambda name: weights[name])
        if weights[best] < MIN_WEIGHT:
            best = SILENCE
        if held is None and best == SILENCE:
            return
        if held is None or best != held.label:
            self._begin_phone(best, 0, arrival)
        elif self._open is not None and best == label:
            self._open.told_s = max(arrival.now_s, at_s)

    def _start(self, at_s: float, now_s: float) -> None:
        """Open an utterance whose audio begins at ``at_s``, and end the previous one."""
        utterance = self._open
        if utterance is not None and utterance.zero_s is None and now_s - utterance.begun_s < OVERTAKEN_S:
            self._open = None
            self._stop(at_s, now_s)
            self._open = utterance
        else:
            self._stop(at_s, now_s)
            utterance = self._begin(at_s + DELAY_S, now_s)
        utterance.started = True

    def _stop(self, at_s: float, now_s: float) -> bool:
        """Close the utterance, whose audio ends at ``at_s``; later phones are not shown. False if there was none."""
        if self._open is not None:
            self._end(self._open, now_s)
        number, self._last, self._zero_s = self._last, None, None
        in_engine = self.engine.utterance(self.session, number) if number is not None else None
        if number is None or in_engine is None:
            return False
        over_s = now_s + in_engine.end_s - in_engine.position_s(now_s) if in_engine.state.is_placed else inf
        if over_s > at_s + DELAY_S:
            self.engine.apply(self.session, Cancel(number, at_s + DELAY_S, CANCEL_FADE_S), now_s)
        return True

    def _known(self) -> _Open | None:
        """Return the open utterance, unless the engine has closed it: others may cancel, too."""
        if self._open is not None and self.engine.utterance(self.session, self._open.number) is None:
            self._open = None
        return self._open

    def _live(self, at_s: float, now_s: float) -> _Open:
        """Return the utterance for phones that are reported as they begin."""
        utterance = self._known()
        if utterance is not None and utterance.zero_s is not None and at_s - utterance.zero_s < TURN_S:
            return utterance
        if utterance is not None:
            self._end(utterance, now_s)
        return self._begin(min(at_s, now_s) + DELAY_S, now_s)  # a smaller tag may arrive after a larger one

    def _begin(self, zero_s: float | None, now_s: float) -> _Open:
        utterance = self._open = _Open(next(self.numbers), zero_s, now_s, now_s)
        begin = Begin(utterance.number) if zero_s is None else Begin(utterance.number, "at", zero_s)
        self.engine.apply(self.session, begin, now_s)
        return utterance

    def _add(self, utterance: _Open, phone: Phone, now_s: float, told_s: float) -> None:
        self._append(utterance, phone, now_s)
        insort(utterance.starts_s, phone.start_s)
        del utterance.starts_s[:-REMEMBERED]
        utterance.told_s = told_s

    def _append(self, utterance: _Open, phone: Phone, now_s: float) -> None:
        self.engine.apply(self.session, Append(utterance.number, utterance.next_index, (phone,)), now_s)
        utterance.next_index += 1
        utterance.end_s = max(utterance.end_s, phone.end_s)

    def _end(self, utterance: _Open, now_s: float) -> None:
        zero_s = utterance.zero_s
        if zero_s is None:
            in_engine = self.engine.utterance(self.session, utterance.number)
            if in_engine is not None and in_engine.state.is_placed:
                zero_s = now_s - in_engine.position_s(now_s)
        self._open, self._last, self._zero_s, self._end_s = None, utterance.number, zero_s, utterance.end_s
        self.engine.apply(self.session, End(utterance.number, utterance.next_index, utterance.end_s), now_s)


def _label_and_numbers(
    what: str, arguments: tuple[osc.Argument, ...], arrival: Arrival
) -> tuple[str | int, list[float]]:
    """Return the name or number of a phone or viseme, and up to two numbers; the rest is counted as surplus."""
    label, *rest = arguments or (None,)
    if isinstance(label, float) and label.is_integer():
        label = int(label)
    numbers = [float(value) for value in rest[:2] if isinstance(value, int | float) and math.isfinite(value)]
    if not isinstance(label, str | int) or isinstance(label, bool) or len(numbers) < len(rest[:2]):
        raise DataError(f"{what}: got {arguments!r:.60}, expected a name and up to two numbers")
    if isinstance(label, str) and len(label) > MAX_NAME_LENGTH:  # it would be remembered
        raise DataError(f"{what}: got a name of {len(label)} characters, expected at most {MAX_NAME_LENGTH}")
    arrival.counts.surplus += len(rest) - len(numbers)
    return label, numbers


def _clamped(duration_s: float) -> float:
    return min(max(duration_s, MIN_DURATION_S), MAX_DURATION_S)
