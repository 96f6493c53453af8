"""Does a sender speak the OSC of docs/osc.md? Listened to while it says something, of any length."""

import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fapengine.conformance.cases import Case, NotTriedError, demand
from fapengine.conformance.osc_server import GOOD, ROBUST
from fapengine.errors import DataError
from fapengine.server.intake.listeners import bound
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.codec import surplus

INSTANCE, COOKIE = 41, 90_210


@dataclass(slots=True)
class Heard:
    """What a sender sent.

    Stateful.
    """

    packets: list[tuple[float, bytes]] = field(default_factory=list)
    wires: list[tuple[float, schema.Wire]] = field(default_factory=list)
    breaches: list[str] = field(default_factory=list)
    """Messages that cannot be read."""
    welcomed_s: float | None = None

    def of(self, *kinds: type) -> list[tuple[float, schema.Wire]]:
        """Give the messages of some kinds, each with its time."""
        return [(at_s, wire) for at_s, wire in self.wires if isinstance(wire, kinds)]


def listen(own: socket.socket, for_s: float, tell: Callable[[str], None] = lambda line: None) -> Heard:
    """Answer a sender as an engine does, for so long; the first hello is left unanswered, and the first phones.

    Parameters
    ----------
    own : socket
        UDP, bound.
    for_s : float
        Time from its first packet.
    tell : callable
        Told the first packet's sender.
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
        heard.packets.append((now_s, packet))
        for answer in _answers(heard, packet, now_s, held):
            own.sendto(codec.encode(answer), peer)
    return heard


def open_port(host: str, port: int) -> socket.socket:
    """Bind. Raises ResourceError if the port is taken."""
    return bound(host, port, socket.SOCK_DGRAM)


def _answers(heard: Heard, packet: bytes, now_s: float, held: dict[int, int]) -> list[schema.FromEngine]:
    now_us = round(now_s * 1e6)
    answers: list[schema.FromEngine] = []
    try:
        messages = osc.parse_packet(packet)
    except DataError as error:
        heard.breaches.append(f"no OSC: {error}")
        return answers
    for message in messages:
        kind = schema.from_sender().get(message.address)
        if kind is None:
            heard.breaches.append(f"got {message.address}, which is no address of the protocol")
            continue
        try:
            wire = codec.parse(kind, message)
        except DataError as error:
            heard.breaches.append(str(error))
            continue
        if count := surplus(kind, message):
            heard.breaches.append(f"{message.address}: {count} arguments too many")
        heard.wires.append((now_s, wire))
        match wire:
            case schema.Hello() if len(heard.of(schema.Hello)) > 1:
                cookie = 0 if wire.cookie == COOKIE else COOKIE
                heard.welcomed_s = heard.welcomed_s or now_s
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
    demand(heard.packets, "nothing came")
    demand(not heard.breaches, "; ".join(dict.fromkeys(heard.breaches)))


def _greets(heard: Heard) -> None:
    demand(heard.of(schema.Hello), "no hello came")
    demand(len(heard.of(schema.Hello)) > 1, "the first hello was not answered, and no second one came")


def _greets_first(heard: Heard) -> None:
    demand(heard.wires and isinstance(heard.wires[0][1], schema.Hello), "its first message is no hello")


def _cookie(heard: Heard) -> None:
    _greets(heard)
    hellos = [wire for _, wire in heard.of(schema.Hello) if isinstance(wire, schema.Hello)]
    demand(any(hello.cookie == COOKIE for hello in hellos), f"the welcome's cookie {COOKIE} came back in no hello")


def _pings(heard: Heard) -> None:
    pings = [wire for _, wire in heard.of(schema.Ping) if isinstance(wire, schema.Ping)]
    demand(len(pings) >= 4, f"got {len(pings)} pings, expected 8 at once: clocks cannot be compared")
    demand(len({ping.number for ping in pings}) == len(pings), "pings have the same number")


def _datagrams(heard: Heard) -> None:
    size = max((len(packet) for _, packet in heard.packets), default=0)
    demand(size <= schema.MAX_DATAGRAM, f"got a datagram of {size} bytes, expected at most {schema.MAX_DATAGRAM}")


def _utterances(heard: Heard) -> dict[tuple[str, int], list[tuple[float, schema.Wire]]]:
    found: dict[tuple[str, int], list[tuple[float, schema.Wire]]] = {}
    for at_s, wire in heard.of(schema.BeginUtterance, schema.Phones, schema.EndUtterance):
        assert isinstance(wire, schema.BeginUtterance | schema.Phones | schema.EndUtterance)
        found.setdefault((wire.session, wire.utterance), []).append((at_s, wire))
    if not any(isinstance(wire, schema.Phones) for wires in found.values() for _, wire in wires):
        raise NotTriedError("it sent no phones")
    return found


def _begins(heard: Heard) -> None:
    for (session, number), wires in _utterances(heard).items():
        demand(any(isinstance(wire, schema.BeginUtterance) for _, wire in wires), f"{session} {number}: has no begin")


def _phones_of(wires: Sequence[tuple[float, schema.Wire]]) -> dict[int, schema.WirePhone]:
    return {
        wire.first_index + n: phone
        for _, wire in wires
        if isinstance(wire, schema.Phones)
        for n, phone in enumerate(wire.phones)
    }


def _indices(heard: Heard) -> None:
    for (session, number), wires in _utterances(heard).items():
        phones = _phones_of(wires)
        lacking = sorted(set(range(max(phones, default=-1) + 1)) - set(phones))
        demand(not lacking, f"{session} {number}: phones {lacking[:8]} were never sent")


def _times(heard: Heard) -> None:
    for (session, number), wires in _utterances(heard).items():
        phones = _phones_of(wires)
        starts = [phones[index].start_us for index in sorted(phones)]
        demand(starts == sorted(starts), f"{session} {number}: phones are not in the order of their times")
        short = [index for index, phone in phones.items() if phone.duration_us < 0]
        demand(not short, f"{session} {number}: phone {short[:1]} lasts less than nothing")


def _repeats(heard: Heard) -> None:
    """See to the first phones, which were not acknowledged."""
    _utterances(heard)
    sent = [wire for _, wire in heard.of(schema.Phones) if isinstance(wire, schema.Phones)]
    again = {(sent[0].utterance, sent[0].first_index + n) for n in range(len(sent[0].phones))}
    for wire in sent[1:]:
        again -= {(wire.utterance, wire.first_index + n) for n in range(len(wire.phones))}
    demand(not again, f"{len(again)} phones that were not acknowledged did not come again")


def _ends(heard: Heard) -> None:
    for (session, number), wires in _utterances(heard).items():
        ends = [wire for _, wire in wires if isinstance(wire, schema.EndUtterance)]
        if not ends and not heard.of(schema.CancelUtterance):
            demand(False, f"{session} {number}: has no end")
        phones = _phones_of(wires)
        wrong = [end.phone_count for end in ends if end.phone_count != len(phones)]
        demand(not wrong, f"{session} {number}: the end tells {wrong[:1]} phones, {len(phones)} came")


CASES: tuple[Case[Heard], ...] = (
    Case("1.1", ROBUST, "every message can be read", _readable),
    Case("1.2", ROBUST, "its first message is hello", _greets_first),
    Case("1.3", GOOD, "hello comes again until it is answered", _greets),
    Case("1.4", GOOD, "the welcome's cookie comes back in a hello", _cookie),
    Case("1.5", GOOD, "pings compare the clocks", _pings),
    Case("1.6", ROBUST, "a datagram has at most 1200 bytes", _datagrams),
    Case("2.1", ROBUST, "an utterance has a begin", _begins),
    Case("2.2", ROBUST, "its phones' indices have no gap", _indices),
    Case("2.3", ROBUST, "its phones follow one another in time", _times),
    Case("2.4", GOOD, "phones that are not acknowledged come again", _repeats),
    Case("2.5", GOOD, "its end comes, and tells how many phones there were", _ends),
)
