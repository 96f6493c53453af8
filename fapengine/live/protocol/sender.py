"""The sender's side of the robust mode: utterances to datagrams, until they have come or their time is over.

Theory of operation
-------------------
Each datagram of phones repeats the two chunks before it, so single losses cost nothing; what is not acknowledged, or
asked for, goes again as long as it can be shown; an end and a cancel go until they are answered. Until the
engine has acknowledged an utterance each of its datagrams begins with its begin, so that none needs another.

Pings keep the clocks together (:mod:`.clock`). An engine that was restarted has another ``instance``, or says that it
knows nothing of an utterance; it is then told everything again, at the time that it had.

:meth:`OscSender.due` gives what is to be sent now, :meth:`OscSender.receive` takes what came. All times are of the
sender's own clock, any that only rises.
"""

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import inf

from fapengine.errors import DataError, UsageError
from fapengine.live import osc
from fapengine.live.engine.commands import Anchor
from fapengine.live.protocol import schema, wire
from fapengine.live.protocol.calls import Calls
from fapengine.live.protocol.clock import EngineClock
from fapengine.live.protocol.outgoing import END_REPEATS_S, Outgoing, OutgoingCancel, to_wire
from fapengine.speech.phone_track import Phone

CLOCK_WAIT_S = 0.25
"""So long an utterance at a time waits for the first pong."""
ANSWERS = 5
"""Of which the quickest tells how long the engine takes to answer: one to a phone that had been lost tells too much."""
FIRST_ANSWER_S = 0.2
"""What an engine that has never answered is given."""
INT32 = 2**31 - 1


class OscSender:
    """Stateful: see the theory of operation.

    Parameters
    ----------
    session : str
        1..32 bytes.
    phone_set, language : str
        Of the labels: ``"ipa"``, ``"arpabet"``, ``"x-sampa"`` and others
        (:data:`fapengine.speech.alphabets.ALPHABETS`).
    token : str
        If the engine wants one.
    instance : int
        An int32 that another run of the sender does not have; not 0.
    repeats : int
        Chunks that each datagram repeats.
    acknowledged : bool
        Whether what does not come is sent again.
    reliable : bool
        The transport loses nothing (TCP): everything is sent once.
    limit : int, bytes
        Largest datagram.

    Raises
    ------
    UsageError
        If the session's name is too long, or the instance is 0.
    """

    def __init__(
        self,
        session: str,
        *,
        phone_set: str = "ipa",
        language: str = "",
        token: str = "",
        instance: int = 1,
        repeats: int = 2,
        acknowledged: bool = True,
        reliable: bool = False,
        limit: int = schema.MAX_DATAGRAM,
    ) -> None:
        if not 0 < abs(instance) <= INT32:
            raise UsageError(f"instance: got {instance}, expected an int32 other than 0")
        self.session = schema.check_session(session)
        self._repeats = 0 if reliable else repeats
        self._asks = acknowledged
        self._reliable, self._limit = reliable, limit
        flags = (schema.WANT_ACK if acknowledged else 0) | (schema.TCP if reliable else 0)
        self._calls = Calls(schema.Hello(session, schema.PROTOCOL, phone_set, language, flags, token, instance))
        self._phone_set, self._language = phone_set, language
        self._utterances: dict[int, Outgoing] = {}
        self._next_number = 0
        self._cancels: dict[int, OutgoingCancel] = {}
        self._queue: list[tuple[float, int, bytes]] = []
        self._order = 0
        self._told: deque[tuple[int, str, int, int]] = deque(maxlen=64)
        self._answers_s: deque[float] = deque(maxlen=ANSWERS)

    # What is told ---------------------------------------------------------------------------------------------------

    @property
    def welcome(self) -> schema.Welcome | None:
        """What the engine takes, once it has answered."""
        return self._calls.welcome

    @property
    def clock(self) -> EngineClock:
        """The engine's clock, as far as it is known."""
        return self._calls.clock

    @property
    def heard_s(self) -> float:
        """When the engine was last heard of."""
        return self._calls.heard_s

    @property
    def live(self) -> tuple[int, ...]:
        """Utterances that are not known to be over."""
        return tuple(self._utterances)

    def is_settled(self) -> bool:
        """Whether everything that was told is known to have come."""
        whole = all(one.is_settled or (one.is_level and not one.is_ended) for one in self._utterances.values())
        return whole and not self._queue and not self._cancels

    def is_connected(self, now_s: float) -> bool:
        """Whether the engine was heard of late."""
        return self._calls.is_connected(now_s)

    def begin(self, now_s: float, *, anchor: Anchor = "now", at_s: float = 0.0) -> int:
        """Open an utterance, and give its number.

        Parameters
        ----------
        now_s : float
        anchor : Anchor
            ``"now"``: behind what is being said. ``"at"``: its time 0 is ``at_s`` of the sender's clock. ``"audio"``:
            when :meth:`audio` tells where its sound is.
        at_s : float
        """
        number = self._next_number
        self._next_number += 1
        one = self._utterances[number] = Outgoing(number, anchor, at_s, now_s)
        one.zero_s = at_s if anchor == "at" else None
        return number

    def append(self, utterance: int, phones: Iterable[Phone | schema.WirePhone]) -> None:
        """Add phones to an utterance, in its time.

        Raises
        ------
        UsageError
            If it was ended, or a phone lies beyond half an hour.
        """
        one = self._find(utterance)
        if one.is_ended:
            raise UsageError(f"utterance {utterance}: got phones after its end")
        one.phones += [to_wire(phone) for phone in phones]

    def end(self, utterance: int, *, duration_s: float | None = None) -> None:
        """Say that no phone will follow.

        Parameters
        ----------
        utterance : int
        duration_s : float, optional
            Of the utterance; by default to the end of its last phone.

        Raises
        ------
        UsageError
            If it is not open.
        """
        one = self._find(utterance)
        if not one.is_ended:
            one.is_ended, one.end_s = True, -inf
            one.duration_us = -1 if duration_s is None else round(min(max(duration_s, 0.0), 1800.0) * 1e6)

    def revise(self, utterance: int, phones: Iterable[Phone | schema.WirePhone], now_s: float) -> None:
        """Replace the phones that are still to come; all are given, the ones that were said too.

        Raises
        ------
        UsageError
            If it is not open.
        """
        one = self._find(utterance)
        one.phones = [to_wire(phone) for phone in phones]
        one.revision += 1
        one.restart(now_s)

    def cancel(self, now_s: float, *, utterance: int | None = None, fade_s: float = 0.2) -> None:
        """Stop speaking: one utterance, or all that were begun so far. To do it again changes nothing."""
        numbers = list(self._utterances) if utterance is None else [utterance]
        below = self._next_number if utterance is None else -1
        wanted = schema.NOW if utterance is None else utterance
        self._order += 1
        message = schema.CancelUtterance(
            self.session, wanted, fade_ms=round(fade_s * 1e3), below=below, number=self._order
        )
        for number in numbers:
            self._utterances.pop(number, None)
        self._cancels[self._order] = OutgoingCancel(message, now_s)

    def audio(
        self, utterance: int, position_s: float, now_s: float, *, at_s: float | None = None, rate: float = 1.0
    ) -> None:
        """Tell where the sound of an utterance is: to be called 4 to 10 times a second.

        Parameters
        ----------
        utterance : int
        position_s : float
            In the utterance.
        now_s : float
        at_s : float, optional
            Time of the sender's clock at which it is heard there; by default now.
        rate : float
            0: it stands still.
        """
        at_s = now_s if at_s is None else at_s
        one = self._utterances.get(utterance)
        if one is not None and rate > 0:
            one.zero_s = at_s - position_s / rate
        self.tell(
            schema.AudioPosition(self.session, utterance, round(at_s * 1e6), round(position_s * 1e6), rate), now_s
        )

    def tell(self, message: schema.FromSender, now_s: float, *, repeats: bool = False) -> None:
        """Send a message at once; again after 20 and 60 ms, if it may be repeated without harm."""
        packet = wire.encode(message)
        for later_s in END_REPEATS_S[: 3 if repeats and not self._reliable else 1]:
            self._order += 1
            heapq.heappush(self._queue, (now_s + later_s, self._order, packet))

    # Packets --------------------------------------------------------------------------------------------------------

    def due(self, now_s: float) -> list[bytes]:
        """Give the packets that are to be sent now."""
        packets = [self._bundle(parts) for parts in self._calls.due(now_s)]
        for cancel in list(self._cancels.values()):
            packets += map(wire.encode, cancel.due(now_s, self._asks, self._reliable))
        self._cancels = {key: cancel for key, cancel in self._cancels.items() if cancel.next_s < inf}
        for one in list(self._utterances.values()):
            if one.is_past(now_s):
                del self._utterances[one.number]
            elif not self._waits_for_clock(one, now_s):
                self._send(one, now_s, packets.append)
        while self._queue and self._queue[0][0] <= now_s:
            packets.append(heapq.heappop(self._queue)[2])
        return packets

    def next_s(self, now_s: float) -> float:
        """When :meth:`due` has something to send, if nothing else happens."""
        times_s = [self._calls.next_s, *(one.next_s for one in self._cancels.values())]
        times_s += [self._queue[0][0]] if self._queue else []
        for one in self._utterances.values():
            if self._waits_for_clock(one, now_s):
                times_s.append(one.created_s + CLOCK_WAIT_S)
                continue
            if one.chunked < len(one.phones):
                times_s.append(one.next_s)
            if self._asks and not self._reliable:
                times_s.append(one.overdue_s(now_s, self._answer_s))
            if one.chunked >= len(one.phones):
                times_s.append(one.end_s)
        return min(times_s)

    def receive(self, packet: bytes, now_s: float) -> list[schema.FromEngine]:
        """Take a packet of the engine.

        Returns
        -------
        list of FromEngine
            What was in it; what is no message of the schema is left out, and notices that came before.
        """
        try:
            messages = osc.parse_packet(packet)
        except DataError:
            return []
        heard: list[schema.FromEngine] = []
        for message in messages:
            kind = schema.FROM_ENGINE.get(message.address)
            try:
                told = wire.parse(kind, message) if kind else None
            except DataError:
                continue
            if not isinstance(told, schema.FromEngine) or getattr(told, "session", self.session) != self.session:
                continue
            self._calls.heard_s = now_s
            if isinstance(told, schema.Notice) and not self._is_new(told):
                continue
            heard.append(told)
            self._hear(told, now_s)
        return heard

    def _is_new(self, told: schema.Notice) -> bool:
        """Whether it is no repeat. An utterance is over once; the rest may happen to it again at another time."""
        once = told.utterance >= 0 and told.kind in ("finished", "cancelled")
        key = (told.utterance, told.kind, *((0, 0) if once else (told.engine_us, told.count)))
        if key in self._told:
            return False
        self._told.append(key)
        return True

    def _hear(self, told: schema.FromEngine, now_s: float) -> None:
        match told:
            case schema.Welcome() | schema.Pong():
                if isinstance(told, schema.Welcome):
                    self._limit = min(self._limit, max(told.max_datagram, 256))
                if self._calls.hear(told, now_s):
                    self._begin_again(now_s)
            case schema.Ack():
                one = self._utterances.get(told.utterance)
                took_s = one.take(told, now_s) if one is not None else None
                if took_s is not None:
                    self._answers_s.append(took_s)
            case schema.Nack():
                one = self._utterances.get(told.utterance)
                run = one.wanted(told.first, told.stop, now_s, self.clock.rtt_s) if one else None
                if one is not None and run is not None:
                    self._send_run(one, run, now_s, lambda packet: self._push(now_s, packet))
            case schema.Notice():
                self._notice(told, now_s)

    def _notice(self, told: schema.Notice, now_s: float) -> None:
        for key, cancel in list(self._cancels.items()):
            if told.kind in ("cancelled", "finished") and cancel.answered(told.utterance, told.count):
                del self._cancels[key]
        one = self._utterances.get(told.utterance)
        if told.kind == "unknown" and told.reason == "no begin" and one is not None:
            one.restart(now_s)
        elif told.kind == "unknown":
            self._begin_again(now_s)
        elif one is None:
            return
        elif told.kind in ("finished", "cancelled"):
            del self._utterances[told.utterance]
        elif told.kind == "started" and one.anchor == "now" and self.clock.is_known:
            one.zero_s = self.clock.sender_s(told.engine_us / 1e6) - told.position_us / 1e6
        elif told.kind == "error" and told.reason == "checksum" and not one.is_corrected:
            one.is_corrected = True
            self.revise(told.utterance, one.phones, now_s)
        elif told.kind == "error" and told.reason != "checksum":
            del self._utterances[told.utterance]

    def _begin_again(self, now_s: float) -> None:
        """Tell the engine everything, because it knows nothing; again only when that had time to come."""
        if not self._calls.call_again(now_s):
            return
        for one in self._utterances.values():
            one.restart(now_s)

    @property
    def _answer_s(self) -> float:
        """How long an answer takes of late, the queues of a busy engine included."""
        if self._answers_s:
            return min(self._answers_s)
        return self.clock.rtt_s if self.clock.is_known else FIRST_ANSWER_S

    def _find(self, utterance: int) -> Outgoing:
        if utterance not in self._utterances:
            raise UsageError(f"utterance: got {utterance}, expected one that was begun and is not over")
        return self._utterances[utterance]

    def _waits_for_clock(self, one: Outgoing, now_s: float) -> bool:
        return one.anchor == "at" and not self.clock.is_known and now_s < one.created_s + CLOCK_WAIT_S and self._asks

    def _send(self, one: Outgoing, now_s: float, put: Callable[[bytes], None]) -> None:
        """Send what an utterance has to send: new chunks, what is overdue, its end."""
        while (chunk := one.next_chunk(now_s)) is not None:
            begun = one.chunks[max(len(one.chunks) - 1 - self._repeats, 0)][0]
            self._send_run(one, (begun, chunk[1]), now_s, put, needed=chunk)
            if self._reliable:
                one.next_s = -inf
        if self._asks and not self._reliable:
            for run in one.overdue(now_s, self._answer_s):
                self._send_run(one, run, now_s, put)
        if not (one.phones or one.is_announced or one.is_begun):  # so that its place in the queue is known
            one.is_announced = True
            put(self._bundle(self._opening(one, now_s)))
        if one.is_ended and one.chunked >= len(one.phones) and now_s >= one.end_s:
            self._send_end(one, now_s, put)

    def _send_end(self, one: Outgoing, now_s: float, put: Callable[[bytes], None]) -> None:
        end = schema.EndUtterance(
            self.session, one.number, len(one.phones), one.duration_us, one.checksum, one.revision
        )
        parts: list[schema.Wire] = [*self._opening(one, now_s)]
        if one.end_sent and one.chunks and self._repeats and not self._asks:  # nothing else repeats the last chunks
            first = one.chunks[max(len(one.chunks) - self._repeats, 0)][0]
            if first >= one.next_index:
                parts.append(self._phones(one, first, one.chunked))
                one.sequence += 1
        packet = self._bundle([*parts, end])
        put(packet if len(packet) <= self._limit else wire.encode(end))
        waits = self._asks and not self._reliable
        one.end_sent_at(now_s, not (self._asks or self._reliable), self._answer_s if waits else inf)

    def _send_run(
        self,
        one: Outgoing,
        run: tuple[int, int],
        now_s: float,
        put: Callable[[bytes], None],
        needed: tuple[int, int] | None = None,
    ) -> None:
        """Send a run of phones in as few datagrams as hold it; repeats before ``needed`` give way for room."""
        first, stop = run
        last = needed[0] if needed else first
        while first < stop:
            upto = stop
            packet = self._packed(one, first, upto, now_s)
            while len(packet) > self._limit and (first < last or upto - first > 1):
                first, upto = (min(first + 4, last), upto) if first < last else (first, first + (upto - first + 1) // 2)
                packet = self._packed(one, first, upto, now_s)
            put(packet)
            one.sequence += 1
            one.sent(first, upto, now_s)
            first = upto

    def _packed(self, one: Outgoing, first: int, stop: int, now_s: float) -> bytes:
        phones = self._phones(one, first, stop)
        opening = self._opening(one, now_s)
        return self._bundle([*opening, phones]) if opening else wire.encode(phones)

    def _phones(self, one: Outgoing, first: int, stop: int) -> schema.Phones:
        phones = tuple(one.phones[first:stop])
        return schema.Phones(self.session, one.number, one.sequence, first, phones, one.revision)

    def _opening(self, one: Outgoing, now_s: float) -> list[schema.Wire]:
        """Begin, as long as the engine is not known to have it; with what it needs to know the time."""
        if one.is_begun:
            return []
        begin = schema.BeginUtterance(
            self.session, one.number, one.revision, one.anchor, round(one.anchor_s * 1e6), self._phone_set,
            self._language,
        )  # fmt: skip
        return [self._calls.new_ping(now_s), begin] if one.anchor == "at" else [begin]

    def _bundle(self, parts: Sequence[schema.Wire]) -> bytes:
        encoded = [wire.encode(part) for part in parts]
        return osc.bundles(encoded, limit=1 << 20)[0] if len(encoded) > 1 else encoded[0]

    def _push(self, now_s: float, packet: bytes) -> None:
        self._order += 1
        heapq.heappush(self._queue, (now_s, self._order, packet))
