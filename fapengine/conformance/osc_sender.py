"""The suite for senders: the OSC of docs/osc.md, received while a sender says something of any length."""

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from fapengine.conformance.cases import Case, NotTriedError, demand
from fapengine.conformance.osc_server import GOOD, ROBUST
from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.codec import surplus

INSTANCE, COOKIE = 41, 90_210
Kind = TypeVar("Kind", bound=schema.Wire)


@dataclass(slots=True)
class Heard:
    """Packets and messages of a sender.

    Stateful.
    """

    packets: list[bytes] = field(default_factory=list)
    wires: list[schema.Wire] = field(default_factory=list)
    breaches: list[str] = field(default_factory=list)
    """What was wrong with messages that cannot be read."""

    def of(self, kind: type[Kind]) -> list[Kind]:
        """Messages of one kind."""
        return [wire for wire in self.wires if isinstance(wire, kind)]


def listen(own: socket.socket, for_s: float, tell: Callable[[str], None] = lambda line: None) -> Heard:
    """Receive from a sender, and answer as an engine does, except to the first hello and the first phones.

    Parameters
    ----------
    own : socket
        UDP, bound.
    for_s : float
        Time from the first packet.
    tell : callable
        Called with a line that names the sender of the first packet.
    """
    heard, stop_s = Heard(), None
    held: dict[int, int] = {}
    own.settimeout(0.05)
    while stop_s is None or time.monotonic() < stop_s:
        try:
            packet, peer = own.recvfrom(65_536)
        except TimeoutError:
            continue
        now_s = time.monotonic()
        if stop_s is None:
            stop_s = now_s + for_s
            tell(f"{peer[0]}:{peer[1]} speaks")
        heard.packets.append(packet)
        for answer in _answers(heard, packet, round(now_s * 1e6), held):
            own.sendto(codec.encode(answer), peer)
    return heard


def _answers(heard: Heard, packet: bytes, now_us: int, held: dict[int, int]) -> list[schema.FromEngine]:
    """Parse a packet into ``heard`` and return what an engine answers; ``held`` counts phones by utterance."""
    answers: list[schema.FromEngine] = []
    try:
        messages = osc.parse_packet(packet)
    except DataError as error:
        heard.breaches.append(f"not OSC: {error}")
        return answers
    for message in messages:
        kind = schema.from_sender().get(message.address)
        if kind is None:
            heard.breaches.append(f"got {message.address}, which is not an address of the protocol")
            continue
        try:
            wire = codec.parse(kind, message)
        except DataError as error:
            heard.breaches.append(str(error))
            continue
        if count := surplus(kind, message):
            heard.breaches.append(f"{message.address}: {count} arguments too many")
        heard.wires.append(wire)
        match wire:
            case schema.Hello() if len(heard.of(schema.Hello)) > 1:
                cookie = 0 if wire.cookie == COOKIE else COOKIE
                answers.append(schema.Welcome(wire.session, now_us, 500_000, instance=INSTANCE, cookie=cookie))
            case schema.Ping():
                answers.append(schema.Pong(wire.number, wire.sent_us, now_us, now_us, INSTANCE))
            case schema.Phones() if len(heard.of(schema.Phones)) > 1:
                stop = wire.first_index + len(wire.phones)
                held[wire.utterance] = max(held.get(wire.utterance, 0), stop)
                answers.append(schema.Ack(wire.session, wire.utterance, held[wire.utterance], 0, 0))
            case schema.EndUtterance():
                answers.append(schema.Ack(wire.session, wire.utterance, held.get(wire.utterance, 0), 0, 0, 1))
            case _:
                pass
    return answers


def _readable(heard: Heard) -> None:
    demand(heard.packets, "no packet was received")
    demand(not heard.breaches, "; ".join(dict.fromkeys(heard.breaches)))


def _greets(heard: Heard) -> None:
    demand(heard.of(schema.Hello), "no hello was received")
    demand(len(heard.of(schema.Hello)) > 1, "the first hello was not answered, and no second one was received")


def _greets_first(heard: Heard) -> None:
    demand(heard.wires and isinstance(heard.wires[0], schema.Hello), "its first message is not a hello")


def _cookie(heard: Heard) -> None:
    _greets(heard)
    cookies = [hello.cookie for hello in heard.of(schema.Hello)]
    demand(COOKIE in cookies, f"no hello returned the welcome's cookie {COOKIE}")


def _pings(heard: Heard) -> None:
    pings = heard.of(schema.Ping)
    demand(len(pings) >= 4, f"got {len(pings)} pings, expected 8 at once: clocks cannot be compared")
    demand(len({ping.number for ping in pings}) == len(pings), "pings have the same number")


def _datagrams(heard: Heard) -> None:
    size = max(map(len, heard.packets), default=0)
    demand(size <= schema.MAX_DATAGRAM, f"got a datagram of {size} bytes, expected at most {schema.MAX_DATAGRAM}")


Phones = dict[int, schema.WirePhone]


def _utterances(heard: Heard) -> dict[tuple[str, int], Phones]:
    """Phones by index, for each utterance that had any message."""
    found: dict[tuple[str, int], Phones] = {}
    for wire in heard.wires:
        if isinstance(wire, schema.BeginUtterance | schema.Phones | schema.EndUtterance):
            phones = found.setdefault((wire.session, wire.utterance), {})
            if isinstance(wire, schema.Phones):
                phones.update(enumerate(wire.phones, start=wire.first_index))
    if not heard.of(schema.Phones):
        raise NotTriedError("it sent no phones")
    return found


def _begins(heard: Heard) -> None:
    begun = {(wire.session, wire.utterance) for wire in heard.of(schema.BeginUtterance)}
    for session, number in _utterances(heard):
        demand((session, number) in begun, f"{session} {number}: has no begin")


def _indices(heard: Heard) -> None:
    for (session, number), phones in _utterances(heard).items():
        missing = sorted(set(range(max(phones, default=-1) + 1)) - set(phones))
        demand(not missing, f"{session} {number}: phones {missing[:8]} were never sent")


def _times(heard: Heard) -> None:
    for (session, number), phones in _utterances(heard).items():
        starts = [phones[index].start_us for index in sorted(phones)]
        demand(starts == sorted(starts), f"{session} {number}: phones are not in the order of their times")
        short = [index for index, phone in phones.items() if phone.duration_us < 0]
        demand(not short, f"{session} {number}: phone {short[:1]} has a negative duration")


def _repeats(heard: Heard) -> None:
    """Check the first phones, which were not acknowledged."""
    _utterances(heard)
    sent = heard.of(schema.Phones)
    again = {(sent[0].utterance, sent[0].first_index + n) for n in range(len(sent[0].phones))}
    for wire in sent[1:]:
        again -= {(wire.utterance, wire.first_index + n) for n in range(len(wire.phones))}
    demand(not again, f"{len(again)} phones that were not acknowledged were not sent again")


def _ends(heard: Heard) -> None:
    counts: dict[tuple[str, int], list[int]] = {}
    for end in heard.of(schema.EndUtterance):
        counts.setdefault((end.session, end.utterance), []).append(end.phone_count)
    for (session, number), phones in _utterances(heard).items():
        ends = counts.get((session, number), [])
        demand(ends or heard.of(schema.CancelUtterance), f"{session} {number}: has no end")
        wrong = [count for count in ends if count != len(phones)]
        demand(not wrong, f"{session} {number}: the end says {wrong[:1]} phones, {len(phones)} were received")


CASES: tuple[Case[Heard], ...] = (
    Case("1.1", ROBUST, "every message is readable", _readable),
    Case("1.2", ROBUST, "its first message is hello", _greets_first),
    Case("1.3", GOOD, "it repeats hello until it is answered", _greets),
    Case("1.4", GOOD, "a hello returns the welcome's cookie", _cookie),
    Case("1.5", GOOD, "pings compare the clocks", _pings),
    Case("1.6", ROBUST, "a datagram has at most 1200 bytes", _datagrams),
    Case("2.1", ROBUST, "an utterance has a begin", _begins),
    Case("2.2", ROBUST, "its phones' indices have no gap", _indices),
    Case("2.3", ROBUST, "its phones follow one another in time", _times),
    Case("2.4", GOOD, "it repeats phones that are not acknowledged", _repeats),
    Case("2.5", GOOD, "its end is sent, with the number of its phones", _ends),
)
