"""Messages of the simple mode: arguments of any tool, as calls of the speaker."""

import math
from collections.abc import Callable
from functools import lru_cache, partial

from fapengine.engine import commands
from fapengine.engine.command_table import Command
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event
from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc import phone_labels, schema
from fapengine.wire.speech_osc.one_shot import SimpleSpeaker
from fapengine.wire.speech_osc.peers import Arrival

PHONEME, VISEME, START, STOP = "/phoneme", "/viseme", "/tts/start", "/tts/stop"
EVENTS, EVENT = "/tts/events", "/tts/event"
"""Asks to be told of events, and tells of one."""
ADDRESSES = (PHONEME, VISEME, START, STOP, EVENTS)
TEXT = "/tts/text"
MAX_NAME_LENGTH = 64
MIN_DURATION_S, MAX_DURATION_S = 0.001, 60.0
"""Durations are held between these."""


def nameless() -> dict[str, schema.Kind]:
    """Give the messages of the robust mode that are taken without their first argument, the session."""
    return _nameless(commands.COMMANDS)


@lru_cache(maxsize=4)
def _nameless(listed: tuple[type[Command], ...]) -> dict[str, schema.Kind]:
    return {TEXT: schema.SpeakText, **{kind.SPEC.one_shot: kind for kind in listed if kind.SPEC.one_shot}}


def event_packet(event: Event) -> bytes:
    """Tell a simple sender: ``/tts/event``, what happened, the position in the utterance in s, its number.

    Examples
    --------
    >>> (message,) = osc.parse_packet(event_packet(Event("face", 1, "finished", 2.0, position_s=0.5)))
    >>> message.address, message.arguments
    ('/tts/event', ('finished', 0.5, 1))
    """
    return osc.message(EVENT, "sfi", event.kind, event.position_s, event.utterance)


class SimpleMode:
    """The session that has no name on the wire.

    Stateful.

    Parameters
    ----------
    session : str
        Its name in the engine.
    engine : Engine
    latest_s : float
        No phone of an utterance may end later.
    """

    def __init__(self, session: str, engine: Engine, latest_s: float) -> None:
        self.session = session
        self._engine, self._latest_s = engine, latest_s
        self._speaker: SimpleSpeaker | None = None

    def knows(self, address: str) -> bool:
        """Whether an address is of this mode."""
        return address in ADDRESSES or address in nameless()

    def named(self, message: osc.Message) -> tuple[osc.Message, schema.Kind | None]:
        """Put the session's name into a message of the robust mode that lacks it, and give its kind."""
        kind = nameless().get(message.address)
        if kind is None:
            return message, None
        return osc.Message(message.address, "s" + message.tags, (self.session, *message.arguments)), kind

    def obey(self, message: osc.Message, arrival: Arrival, new_number: Callable[[], int]) -> bool:
        """Do what a message says; the session is open. True: the server's voice is meant, too.

        Raises
        ------
        DataError
            If its arguments are wrong.
        """
        if self._speaker is None:
            self._speaker = SimpleSpeaker(
                partial(self._engine.apply, self.session), new_number, partial(self._engine.utterance, self.session)
            )
        self._speaker.new_number = new_number
        if message.address == PHONEME:
            self._phoneme(message.arguments, arrival, self._speaker)
        elif message.address == VISEME:
            self._viseme(message.arguments, arrival, self._speaker)
        elif message.address == START:
            self._speaker.start(arrival.at_s, arrival.now_s)
        else:
            return not self._speaker.stop(arrival.at_s, arrival.now_s)
        return False

    def tick(self, now_s: float) -> None:
        """Hold on what is held; end what is quiet."""
        if self._speaker is not None and self._speaker.is_open:
            if self.session in self._engine:
                self._speaker.tick(now_s)
            else:  # closed by others
                self._speaker = None

    def _phoneme(self, arguments: tuple[osc.Argument, ...], arrival: Arrival, speaker: SimpleSpeaker) -> None:
        label, times = _label_and_numbers(PHONEME, arguments, arrival)
        if not isinstance(label, str):
            raise DataError(f"{PHONEME}: got {label!r}, expected a string")
        prefix, _, rest = label.partition(":")
        phone_set = phone_labels.phone_set_named(prefix) if prefix and rest else None
        if phone_set is None:
            arrival.peer.labels.append(label.strip())
            named_set = phone_labels.phone_set_named(arrival.peer.phone_set) if arrival.peer.phone_set else None
            phone_set, rest = named_set or phone_labels.guess_set(arrival.peer.labels), label
        ipa, stress = phone_labels.to_phone(rest, phone_set)
        if len(times) < 2:
            duration_s = _held(times[0]) if times and times[0] > 0 else None
            speaker.begin_phone(ipa, stress, arrival.at_s, arrival.now_s, duration_s)
        elif 0 <= times[0] <= self._latest_s - _held(times[1]):
            speaker.place_phone(ipa, stress, times[0], _held(times[1]), arrival.now_s)
        else:
            raise DataError(f"{PHONEME}: got {times[0]} to {times[0] + times[1]} s, expected 0..{self._latest_s}")

    def _viseme(self, arguments: tuple[osc.Argument, ...], arrival: Arrival, speaker: SimpleSpeaker) -> None:
        name, values = _label_and_numbers(VISEME, arguments, arrival)
        label = phone_labels.to_viseme(name)
        if not values:
            speaker.begin_phone(label, 0, arrival.at_s, arrival.now_s)
        elif len(values) == 1:
            speaker.weigh(label, values[0], arrival.at_s, arrival.now_s)
        elif values[0] >= phone_labels.MIN_WEIGHT:
            speaker.begin_phone(label, 0, arrival.at_s, arrival.now_s, _held(values[1]))


def _label_and_numbers(
    what: str, arguments: tuple[osc.Argument, ...], arrival: Arrival
) -> tuple[str | int, list[float]]:
    """Name or number of what is to be shown, and up to two numbers behind it; the rest is counted as surplus."""
    label, *rest = arguments or (None,)
    if isinstance(label, float) and label.is_integer():
        label = int(label)
    numbers = [float(value) for value in rest[:2] if isinstance(value, int | float) and math.isfinite(value)]
    if not isinstance(label, str | int) or isinstance(label, bool) or len(numbers) < len(rest[:2]):
        raise DataError(f"{what}: got {arguments!r:.60}, expected a name and up to two numbers")
    if isinstance(label, str) and len(label) > MAX_NAME_LENGTH:  # it would be remembered
        raise DataError(f"{what}: got a name of {len(label)} letters, expected at most {MAX_NAME_LENGTH}")
    arrival.peer.tally.add("surplus", len(rest) - len(numbers))
    return label, numbers


def _held(duration_s: float) -> float:
    return min(max(duration_s, MIN_DURATION_S), MAX_DURATION_S)
