"""The suites for OSC servers and senders: the messages of docs/osc.md over UDP.

The suite for servers sends as a sender does; the one for senders listens while a sender says something of any length.
"""

import itertools
import secrets
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self, TypeVar

from fapengine.conformance.cases import Case, NotTriedError, demand
from fapengine.errors import DataError, ResourceError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.codec import surplus

SIMPLE, ROBUST, GOOD, WRONG = (
    f"docs/osc.md: {section}"
    for section in ("One message a phone", "Every phone, in time", "What a good sender does", "When things go wrong")
)
ANSWER_S = 3.0
"""Longest wait for an answer; long, because the machine may be busy."""
QUIET_S = 0.3
STEP_US = 100_000
Answer = TypeVar("Answer", schema.Welcome, schema.Pong, schema.Ack, schema.Nack, schema.Notice)


@dataclass(slots=True)
class OscServer:
    """A server under test.

    Stateful; a context manager that closes the sockets of all callers.
    """

    host: str
    port: int
    token: str = ""
    _sockets: list[socket.socket] = field(default_factory=list)
    _numbers: "itertools.count[int]" = field(default_factory=itertools.count)
    _run: str = field(default_factory=lambda: secrets.token_hex(3))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for own in self._sockets:
            own.close()

    def caller(self) -> "Caller":
        """Make a caller with a new socket and a new session."""
        try:
            family, kind, _, _, address = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_DGRAM)[0]
            own = socket.socket(family, kind)
            self._sockets.append(own)
            own.connect(address)
        except OSError as error:
            raise ResourceError(f"UDP {self.host}:{self.port}: {error}") from error
        own.settimeout(0.05)
        return Caller(own, f"case-{self._run}-{next(self._numbers)}", self.token)


@dataclass(slots=True)
class Caller:
    """A sender with its own session.

    Stateful.
    """

    socket: socket.socket
    session: str
    token: str

    def send(self, *wires: schema.Wire) -> None:
        """Send messages, one per datagram."""
        for wire in wires:
            self.socket.send(codec.encode(wire))

    def hear(
        self, until: Callable[[list[schema.Wire]], bool] = lambda heard: False, for_s: float = ANSWER_S
    ) -> list[schema.Wire]:
        """Collect answers until ``until`` is true of them, for at most ``for_s``."""
        heard: list[schema.Wire] = []
        stop_s = time.monotonic() + for_s
        while not until(heard) and time.monotonic() < stop_s:
            try:
                messages = osc.parse_packet(self.socket.recv(65_536))
            except (TimeoutError, ConnectionRefusedError):
                continue
            except DataError as error:
                demand(False, f"an answer is not OSC: {error}")
                raise
            for message in messages:
                kind = schema.FROM_ENGINE.get(message.address)
                demand(kind is not None, f"got {message.address}, which is not an address of the protocol")
                assert kind is not None
                heard.append(codec.parse(kind, message))
        return heard

    def ask(
        self, kind: type[Answer], *wires: schema.Wire, such: Callable[[Answer], bool] = lambda answer: True
    ) -> Answer:
        """Send messages, and wait for an answer of one kind that satisfies ``such``."""

        def found(heard: list[schema.Wire]) -> list[Answer]:
            return [wire for wire in heard if isinstance(wire, kind) and such(wire)]

        self.send(*wires)
        heard = self.hear(lambda heard: bool(found(heard)))
        answers = found(heard)
        others = ", ".join(sorted({str(getattr(wire, "ADDRESS", "")) for wire in heard})) or "nothing"
        demand(answers, f"no {kind.ADDRESS} came, but {others}")
        return answers[0]

    def join(self) -> schema.Welcome:
        """Send hello, and again with the cookie if the server asks for one."""
        welcome = self.ask(schema.Welcome, self._hello())
        return self.ask(schema.Welcome, self._hello(welcome.cookie)) if welcome.cookie else welcome

    def _hello(self, cookie: int = 0) -> schema.Hello:
        return schema.Hello(self.session, phone_set="ipa", flags=1, token=self.token, instance=7, cookie=cookie)

    def utterance(self, number: int, labels: str) -> tuple[schema.BeginUtterance, schema.Phones, schema.EndUtterance]:
        """Messages of an utterance; each character is a phone."""
        phones = tuple(schema.WirePhone(label, n * STEP_US, STEP_US) for n, label in enumerate(labels))
        return (
            schema.BeginUtterance(self.session, number),
            schema.Phones(self.session, number, 0, 0, phones),
            schema.EndUtterance(self.session, number, len(phones), len(phones) * STEP_US),
        )


def _joined(check: Callable[[Caller], None]) -> Callable[[OscServer], None]:
    """Make the check of a server from that of a caller that has said hello."""

    def check_server(server: OscServer) -> None:
        caller = server.caller()
        caller.join()
        check(caller)

    return check_server


def _welcome(server: OscServer) -> None:
    caller = server.caller()
    welcome = caller.join()
    demand(welcome.session == caller.session, f"got a welcome for {welcome.session!r}")
    demand(welcome.lookahead_us >= 0, f"got a lookahead of {welcome.lookahead_us} us")
    demand(0 < welcome.max_datagram <= 65_507, f"got datagrams of {welcome.max_datagram} bytes")


def _hello_again(server: OscServer) -> None:
    caller = server.caller()
    first, second = caller.join(), caller.join()
    demand(second.instance == first.instance, "two welcomes of one run have different instances")
    demand(second.engine_us >= first.engine_us, "the engine's clock goes backwards")


def _protocol(server: OscServer) -> None:
    caller = server.caller()
    notice = caller.ask(schema.Notice, schema.Hello(caller.session, protocol=99, token=server.token))
    demand(notice.kind == "error", f"got {notice.kind} for protocol 99, expected error")


def _pong(caller: Caller) -> None:
    pong = caller.ask(schema.Pong, schema.Ping(41, 123_456_789), such=lambda pong: pong.number == 41)
    demand(pong.sent_us == 123_456_789, f"got sent_us {pong.sent_us}, expected it unchanged")
    demand(pong.received_us <= pong.answered_us, "it was answered before it was received")


def _ack(caller: Caller) -> None:
    ack = caller.ask(schema.Ack, *caller.utterance(0, "mamama"), such=lambda ack: ack.is_ended == 1)
    demand(ack.next_index == 6, f"got next_index {ack.next_index} after phones 0 to 5, expected 6")


def _started_and_finished(caller: Caller) -> None:
    caller.send(*caller.utterance(0, "mama"))

    def kinds(heard: list[schema.Wire]) -> list[str]:
        return list(dict.fromkeys(wire.kind for wire in heard if isinstance(wire, schema.Notice)))

    heard = kinds(caller.hear(lambda heard: "finished" in kinds(heard), 2 * ANSWER_S))
    is_right = heard[:1] == ["started"] and heard[-1:] == ["finished"]
    demand(is_right, f"got events {heard}, expected started, then finished")


def _nack(caller: Caller) -> None:
    begin, phones, _ = caller.utterance(0, "mamamama")
    late = schema.Phones(caller.session, 0, 1, 6, phones.phones[6:])
    first = schema.Phones(caller.session, 0, 0, 0, phones.phones[:4])
    nack = caller.ask(schema.Nack, begin, first, late)
    demand((nack.first, nack.stop) == (4, 6), f"got {nack.first} to {nack.stop}, expected 4 to 6, which were not sent")


def _repeats(caller: Caller) -> None:
    begin, phones, end = caller.utterance(0, "ma")
    caller.send(begin, phones, phones, begin, end, phones, end)
    heard = caller.hear(for_s=1.5)
    starts = {wire.engine_us for wire in heard if isinstance(wire, schema.Notice) and wire.kind == "started"}
    demand(len(starts) == 1, f"got {len(starts)} starts of one utterance that was sent twice")


def _order(caller: Caller) -> None:
    ack = caller.ask(schema.Ack, *reversed(caller.utterance(0, "mama")), such=lambda ack: ack.is_ended == 1)
    demand(ack.next_index == 4, f"got next_index {ack.next_index} for 4 phones that were sent before their begin")


def _cancel(caller: Caller) -> None:
    caller.send(*caller.utterance(0, "m" + "a" * 20))
    caller.hear(lambda heard: any(isinstance(wire, schema.Notice) and wire.kind == "started" for wire in heard))
    cancel = schema.CancelUtterance(caller.session)
    notice = caller.ask(schema.Notice, cancel, such=lambda notice: notice.kind in ("cancelled", "finished"))
    demand(notice.kind == "cancelled", "the utterance was not cut off")


def _bye(caller: Caller) -> None:
    notice = caller.ask(schema.Notice, schema.Bye(caller.session), such=lambda notice: notice.kind == "cancelled")
    demand(notice.session == caller.session, f"got a notice for {notice.session!r}")


def _unknown(caller: Caller) -> None:
    notice = caller.ask(schema.Notice, schema.AudioPosition(caller.session, 99, 1_000_000, 0))
    demand(notice.kind == "unknown", f"got {notice.kind} for an utterance that was never begun, expected unknown")


def _newer(caller: Caller) -> None:
    caller.socket.send(osc.message("/fap/1/ping", "ihhfisT", 5, 1, 0, 0.0, -1, "of a later version", True))
    pongs = [wire for wire in caller.hear(lambda heard: bool(heard)) if isinstance(wire, schema.Pong)]
    demand(pongs, "a message with arguments of a later version is not answered")


def _hostile(server: OscServer) -> None:
    caller = server.caller()
    good = codec.encode(schema.Hello(caller.session, token=server.token))
    cut = (b"", b"\0", b"/", good[:-3], good[:9], b"/fap/1/phones\0\0\0,siiii\0\0")
    for bad in (*cut, b"#bundle\0" + b"\xff" * 16, b"\xff" * 1200):
        caller.socket.send(bad)
    least, most = -(2**31), 2**31 - 1
    caller.socket.send(osc.message("/fap/1/utt/begin", "siishss", caller.session, least, most, "x", -(2**63), "?", "?"))
    caller.socket.send(osc.message("/fap/1/expr", "ssf", caller.session, "joy", float("nan")))
    caller.hear(for_s=QUIET_S)
    caller.join()


def _simple(server: OscServer) -> None:
    caller = server.caller()
    for number, label in enumerate("ma"):
        caller.socket.send(osc.message("/phoneme", "sff", label, 0.1 * number, 0.1))
    caller.socket.send(osc.message("/tts/stop", ""))
    caller.join()


SERVER_CASES: tuple[Case[OscServer], ...] = (
    Case("1.1", ROBUST, "hello is answered by welcome, for its session", _welcome),
    Case("1.2", ROBUST, "hello may be repeated; the run keeps its instance", _hello_again),
    Case("1.3", ROBUST, "a hello of another protocol is answered by an error", _protocol),
    Case("1.4", ROBUST, "ping is answered by pong with its number and time", _joined(_pong)),
    Case("1.5", ROBUST, "bye is answered", _joined(_bye)),
    Case("2.1", ROBUST, "phones and end are acknowledged", _joined(_ack)),
    Case("2.2", ROBUST, "an utterance is reported as started, then as finished", _joined(_started_and_finished)),
    Case("2.3", ROBUST, "missing phones are requested", _joined(_nack)),
    Case("2.4", GOOD, "repeated messages change nothing", _joined(_repeats)),
    Case("2.5", ROBUST, "the order of messages does not matter", _joined(_order)),
    Case("2.6", ROBUST, "cancel ends the current utterance, and is reported", _joined(_cancel)),
    Case("3.1", WRONG, "an unknown utterance is reported", _joined(_unknown)),
    Case("3.2", ROBUST, "arguments after those that it knows are ignored", _joined(_newer)),
    Case("3.3", WRONG, "bytes that are not OSC, and impossible values, do no harm", _hostile),
    Case("4.1", SIMPLE, "simple messages are accepted without a hello", _simple),
)


# Senders ------------------------------------------------------------------------------------------------------------

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


def listen(
    own: socket.socket,
    for_s: float,
    tell: Callable[[str], None] = lambda line: None,
    until: Callable[["Heard"], bool] = lambda heard: False,
) -> Heard:
    """Receive from a sender, and answer as an engine does, except to the first hello and the first phones.

    Parameters
    ----------
    own : socket
        UDP, bound.
    for_s : float
        Time from the first packet.
    tell : callable
        Called with a line that names the sender of the first packet.
    until : callable
        Called after each packet; ends the listening where it is true.
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
        if until(heard):
            break
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


def _sends_again(heard: Heard) -> None:
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


SENDER_CASES: tuple[Case[Heard], ...] = (
    Case("1.1", ROBUST, "every message is readable", _readable),
    Case("1.2", ROBUST, "its first message is hello", _greets_first),
    Case("1.3", GOOD, "it repeats hello until it is answered", _greets),
    Case("1.4", GOOD, "a hello returns the welcome's cookie", _cookie),
    Case("1.5", GOOD, "pings compare the clocks", _pings),
    Case("1.6", ROBUST, "a datagram has at most 1200 bytes", _datagrams),
    Case("2.1", ROBUST, "an utterance has a begin", _begins),
    Case("2.2", ROBUST, "its phones' indices have no gap", _indices),
    Case("2.3", ROBUST, "its phones follow one another in time", _times),
    Case("2.4", GOOD, "it repeats phones that are not acknowledged", _sends_again),
    Case("2.5", GOOD, "its end is sent, with the number of its phones", _ends),
)
