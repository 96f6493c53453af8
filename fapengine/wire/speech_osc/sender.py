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

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.speech.phone_track import Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.clock import EngineClock
from fapengine.wire.speech_osc.handshake import PING_S, Handshake
from fapengine.wire.speech_osc.send_window import END_REPEATS_S, SOUND_AGAIN_S, PendingCancel, SendWindow, to_wire

CLOCK_WAIT_S = 0.25
"""Time that an utterance with a start time waits for the first pong."""
ANSWERS = 5
"""Number of answers whose quickest tells what an answer takes: one to a phone that had been lost tells too much."""
FIRST_ANSWER_S = 0.2
"""Time that an engine is given that has never answered."""
INT32 = 2**31 - 1


class OscSender:
    """The sender's end of one session; see the theory of operation.

    Stateful.

    Parameters
    ----------
    session : str
        1..32 bytes.
    phone_set, language : str
        Of the labels: ``"ipa"``, ``"arpabet"``, ``"x-sampa"`` and others
        (:data:`fapengine.speech.alphabets.convert.ALPHABETS`).
    token : str
        If the engine wants window.
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
    follows : bool
        Whether the caller goes where a ``Moved`` sends it, and calls :meth:`move` then.

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
        follows: bool = False,
    ) -> None:
        if not 0 < abs(instance) <= INT32:
            raise UsageError(f"instance: got {instance}, expected an int32 other than 0")
        self.session = schema.check_session(session)
        self._repeats = 0 if reliable else repeats
        self._asks = acknowledged
        self._reliable, self._limit = reliable, limit
        flags = (schema.WANT_ACK if acknowledged else 0) | (schema.TCP if reliable else 0)
        flags |= schema.FOLLOWS if follows else 0
        self._handshake = Handshake(schema.Hello(session, schema.PROTOCOL, phone_set, language, flags, token, instance))
        self._phone_set, self._language = phone_set, language
        self._windows: dict[int, SendWindow] = {}
        self._next_number = 0
        self._cancels: dict[int, PendingCancel] = {}
        self._queue: list[tuple[float, int, bytes]] = []
        self._order = 0
        self._notices: deque[tuple[int, str, int, int]] = deque(maxlen=64)
        self._answers_s: deque[float] = deque(maxlen=ANSWERS)

    # What is told ---------------------------------------------------------------------------------------------------

    @property
    def welcome(self) -> schema.Welcome | None:
        """What the engine takes, once it has answered."""
        return self._handshake.welcome

    @property
    def clock(self) -> EngineClock:
        """The engine's clock, as far as it is known."""
        return self._handshake.clock

    @property
    def heard_s(self) -> float:
        """Time of the engine's last packet."""
        return self._handshake.heard_s

    @property
    def live(self) -> tuple[int, ...]:
        """Utterances that are not known to be over."""
        return tuple(self._windows)

    def is_settled(self) -> bool:
        """Whether everything that was told is known to have come."""
        whole = all(
            window.is_complete or (window.is_acknowledged and not window.is_ended) for window in self._windows.values()
        )
        return whole and not self._queue and not self._cancels

    def is_connected(self, now_s: float) -> bool:
        """Whether the engine was heard of late."""
        return self._handshake.is_connected(now_s)

    def is_unanswered(self, now_s: float, silent_s: float) -> bool:
        """Whether nothing was heard for so long after a question."""
        return self._handshake.is_unanswered(now_s, silent_s)

    def move(self, now_s: float, *, follows: bool = True, ping_s: float = PING_S) -> None:
        """Tell everything to another engine, to which packets go from now on.

        Parameters
        ----------
        now_s : float
        follows : bool
            Whether to go where that one sends us.
        ping_s : float
            Time from one ping to the next.
        """
        self._handshake.begin_elsewhere(now_s, follows=follows, ping_s=ping_s)
        for window in self._windows.values():
            window.restart(now_s)

    def begin(self, now_s: float, *, anchor: schema.WireAnchor = "now", at_s: float = 0.0) -> int:
        """Open an utterance, and give its number.

        Parameters
        ----------
        now_s : float
        anchor : WireAnchor
            ``"now"``: behind what is being said. ``"at"``: its time 0 is ``at_s`` of the sender's clock. ``"audio"``:
            when :meth:`audio` tells where its sound is. ``"sound"``: as soon as the engine's ear can keep up with the
            sound that comes.
        at_s : float
        """
        number = self._next_number
        self._next_number += 1
        window = self._windows[number] = SendWindow(number, anchor, at_s, now_s)
        window.zero_s = at_s if anchor == "at" else None
        return number

    def append(self, utterance: int, phones: Iterable[Phone | schema.WirePhone]) -> None:
        """Add phones to an utterance, in its time.

        Raises
        ------
        UsageError
            If it was ended, or a phone lies beyond half an hour.
        """
        window = self._find(utterance)
        if window.is_ended or window.rate_hz:
            raise UsageError(f"utterance {utterance}: got phones {'after its end' if window.is_ended else 'and sound'}")
        window.phones += [to_wire(phone) for phone in phones]

    def sound(self, utterance: int, samples: NDArray[np.int16], rate_hz: int, now_s: float) -> None:
        """Add sound to an utterance, whose phones the engine's ear finds.

        Parameters
        ----------
        utterance : int
        samples : (N,) int16
            Mono; they follow those given before.
        rate_hz : int
            8000..48000, the same in all of an utterance.
        now_s : float

        Raises
        ------
        UsageError
            If it was ended, has phones or begins ``"now"``, or the rate is another one or out of range.
        """
        window = self._find(utterance)
        if window.anchor == "now":
            raise UsageError(f"utterance {utterance}: got sound, expected a beginning at a time, by its sound, or none")
        if window.is_ended or window.phones:
            raise UsageError(f"utterance {utterance}: got sound {'after its end' if window.is_ended else 'and phones'}")
        if not schema.RATES_HZ[0] <= rate_hz <= schema.RATES_HZ[1] or rate_hz != (window.rate_hz or rate_hz):
            expected = window.rate_hz or f"{schema.RATES_HZ[0]}..{schema.RATES_HZ[1]}"
            raise UsageError(f"rate_hz: got {rate_hz}, expected {expected}")
        window.add_sound(self.session, samples, rate_hz, now_s, inf if self._reliable else SOUND_AGAIN_S)

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
        window = self._find(utterance)
        if not window.is_ended:
            window.is_ended, window.end_s = True, -inf
            if duration_s is None and window.rate_hz:
                duration_s = window.samples / window.rate_hz
            window.duration_us = -1 if duration_s is None else round(min(max(duration_s, 0.0), 1800.0) * 1e6)

    def revise(self, utterance: int, phones: Iterable[Phone | schema.WirePhone], now_s: float) -> None:
        """Replace the phones that are still to come; all are given, the ones that were said too.

        Raises
        ------
        UsageError
            If it is not open.
        """
        window = self._find(utterance)
        window.phones = [to_wire(phone) for phone in phones]
        window.revision += 1
        window.restart(now_s)

    def cancel(self, now_s: float, *, utterance: int | None = None, fade_s: float = 0.2) -> None:
        """Stop speaking: one utterance, or all that were begun so far. To do it again changes nothing."""
        numbers = list(self._windows) if utterance is None else [utterance]
        below = self._next_number if utterance is None else -1
        wanted = schema.NOW if utterance is None else utterance
        self._order += 1
        message = schema.CancelUtterance(
            self.session, wanted, fade_ms=round(fade_s * 1e3), below=below, number=self._order
        )
        for number in numbers:
            self._windows.pop(number, None)
        self._cancels[self._order] = PendingCancel(message, now_s)

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
        window = self._windows.get(utterance)
        if window is not None and rate > 0:
            window.zero_s = at_s - position_s / rate
        self.tell(
            schema.AudioPosition(self.session, utterance, round(at_s * 1e6), round(position_s * 1e6), rate), now_s
        )

    def tell(self, message: schema.FromSender, now_s: float, *, repeats: bool = False) -> None:
        """Send a message at once; again after 20 and 60 ms, if it may be repeated without harm."""
        packet = codec.encode(message)
        for later_s in END_REPEATS_S[: 3 if repeats and not self._reliable else 1]:
            self._order += 1
            heapq.heappush(self._queue, (now_s + later_s, self._order, packet))

    # Packets --------------------------------------------------------------------------------------------------------

    def due(self, now_s: float) -> list[bytes]:
        """Give the packets that are to be sent now."""
        packets = [self._bundle(parts) for parts in self._handshake.due(now_s)]
        for cancel in list(self._cancels.values()):
            packets += map(codec.encode, cancel.due(now_s, self._asks, self._reliable))
        self._cancels = {key: cancel for key, cancel in self._cancels.items() if cancel.next_s < inf}
        for window in list(self._windows.values()):
            if window.is_past(now_s):
                del self._windows[window.number]
            elif not self._waits_for_clock(window, now_s):
                self._send(window, now_s, packets.append)
        while self._queue and self._queue[0][0] <= now_s:
            packets.append(heapq.heappop(self._queue)[2])
        return packets

    def next_s(self, now_s: float) -> float:
        """When :meth:`due` has something to send, if nothing else happens."""
        times_s = [self._handshake.next_s, *(cancel.next_s for cancel in self._cancels.values())]
        times_s += [self._queue[0][0]] if self._queue else []
        for window in self._windows.values():
            if self._waits_for_clock(window, now_s):
                times_s.append(window.created_s + CLOCK_WAIT_S)
                continue
            if window.stop_sent < len(window.phones):
                times_s.append(window.next_s)
            if self._asks and not self._reliable:
                times_s.append(window.next_timeout_s(now_s, self._answer_s))
            if window.sounds:
                times_s.append(window.sounds[0][0])
            elif window.stop_sent >= len(window.phones):
                times_s.append(window.end_s)
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
                answer = codec.parse(kind, message) if kind else None
            except DataError:
                continue
            if not isinstance(answer, schema.FromEngine) or getattr(answer, "session", self.session) != self.session:
                continue
            if isinstance(answer, schema.Moved) and answer.instance != self._handshake.hello.instance:
                continue
            self._handshake.hear(now_s)
            if isinstance(answer, schema.Notice) and not self._is_new(answer):
                continue
            heard.append(answer)
            self._hear(answer, now_s)
        return heard

    def _is_new(self, notice: schema.Notice) -> bool:
        """Whether it is no repeat. An utterance is over once; the rest may happen to it again at another time."""
        once = notice.utterance >= 0 and notice.kind in ("finished", "cancelled")
        key = (notice.utterance, notice.kind, *((0, 0) if once else (notice.engine_us, notice.count)))
        if key in self._notices:
            return False
        self._notices.append(key)
        return True

    def _hear(self, answer: schema.FromEngine, now_s: float) -> None:
        match answer:
            case schema.Welcome() | schema.Pong():
                if isinstance(answer, schema.Welcome):
                    self._limit = min(self._limit, max(answer.max_datagram, 256))
                if self._handshake.answered(answer, now_s):
                    self._begin_again(now_s)
            case schema.Ack():
                window = self._windows.get(answer.utterance)
                took_s = window.acknowledge(answer, now_s) if window is not None else None
                if took_s is not None:
                    self._answers_s.append(took_s)
            case schema.Nack():
                window = self._windows.get(answer.utterance)
                run = window.requested(answer.first, answer.stop, now_s, self.clock.rtt_s) if window else None
                if window is not None and run is not None:
                    self._send_run(window, run, now_s, lambda packet: self._push(now_s, packet))
            case schema.Notice():
                self._notice(answer, now_s)

    def _notice(self, notice: schema.Notice, now_s: float) -> None:
        for key, cancel in list(self._cancels.items()):
            if notice.kind in ("cancelled", "finished") and cancel.answered(notice.utterance, notice.count):
                del self._cancels[key]
        window = self._windows.get(notice.utterance)
        if notice.kind == "unknown" and notice.reason == "no begin" and window is not None:
            window.restart(now_s)
        elif notice.kind == "unknown":
            self._begin_again(now_s)
        elif window is None:
            return
        elif notice.kind in ("finished", "cancelled"):
            del self._windows[notice.utterance]
        elif notice.kind == "started" and window.anchor == "now" and self.clock.is_known:
            window.zero_s = self.clock.sender_s(notice.engine_us / 1e6) - notice.position_us / 1e6
        elif notice.kind == "error" and notice.reason == "checksum" and not window.is_corrected:
            window.is_corrected = True
            self.revise(notice.utterance, window.phones, now_s)
        elif notice.kind == "error" and notice.reason != "checksum":
            del self._windows[notice.utterance]

    def _begin_again(self, now_s: float) -> None:
        """Tell the engine everything, because it knows nothing; again only when that had time to come."""
        if not self._handshake.greet_again(now_s):
            return
        for window in self._windows.values():
            window.restart(now_s)

    @property
    def _answer_s(self) -> float:
        """How long an answer takes of late, the queues of a busy engine included."""
        if self._answers_s:
            return min(self._answers_s)
        return self.clock.rtt_s if self.clock.is_known else FIRST_ANSWER_S

    def _find(self, utterance: int) -> SendWindow:
        if utterance not in self._windows:
            raise UsageError(f"utterance: got {utterance}, expected one that was begun and is not over")
        return self._windows[utterance]

    def _waits_for_clock(self, window: SendWindow, now_s: float) -> bool:
        return (
            window.anchor == "at" and not self.clock.is_known and now_s < window.created_s + CLOCK_WAIT_S and self._asks
        )

    def _send(self, window: SendWindow, now_s: float, put: Callable[[bytes], None]) -> None:
        """Send what an utterance has to send: new chunks, what is overdue, its end."""
        while (chunk := window.next_chunk(now_s)) is not None:
            begun = window.chunks[max(len(window.chunks) - 1 - self._repeats, 0)][0]
            self._send_run(window, (begun, chunk[1]), now_s, put, needed=chunk)
            if self._reliable:
                window.next_s = -inf
        if self._asks and not self._reliable:
            for run in window.overdue(now_s, self._answer_s):
                self._send_run(window, run, now_s, put)
        if not (window.phones or window.is_announced or window.is_begun):  # so that its place in the queue is known
            window.is_announced = True
            put(self._bundle(self._opening(window, now_s)))
        while window.sounds and window.sounds[0][0] <= now_s:
            put(self._bundle([*self._opening(window, now_s), heapq.heappop(window.sounds)[2]]))
        if window.is_ended and not window.sounds and window.stop_sent >= len(window.phones) and now_s >= window.end_s:
            self._send_end(window, now_s, put)

    def _send_end(self, window: SendWindow, now_s: float, put: Callable[[bytes], None]) -> None:
        end = schema.EndUtterance(
            self.session, window.number, len(window.phones), window.duration_us, window.checksum, window.revision
        )
        parts: list[schema.Wire] = [*self._opening(window, now_s)]
        if (
            window.end_sent and window.chunks and self._repeats and not self._asks
        ):  # nothing else repeats the last chunks
            first = window.chunks[max(len(window.chunks) - self._repeats, 0)][0]
            if first >= window.next_index:
                parts.append(self._phones(window, first, window.stop_sent))
                window.sequence += 1
        packet = self._bundle([*parts, end])
        put(packet if len(packet) <= self._limit else codec.encode(end))
        waits = self._asks and not self._reliable
        window.note_end_sent(now_s, not (self._asks or self._reliable), self._answer_s if waits else inf)

    def _send_run(
        self,
        window: SendWindow,
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
            packet = self._packed(window, first, upto, now_s)
            while len(packet) > self._limit and (first < last or upto - first > 1):
                first, upto = (min(first + 4, last), upto) if first < last else (first, first + (upto - first + 1) // 2)
                packet = self._packed(window, first, upto, now_s)
            put(packet)
            window.sequence += 1
            window.note_sent(first, upto, now_s)
            first = upto

    def _packed(self, window: SendWindow, first: int, stop: int, now_s: float) -> bytes:
        phones = self._phones(window, first, stop)
        opening = self._opening(window, now_s)
        return self._bundle([*opening, phones]) if opening else codec.encode(phones)

    def _phones(self, window: SendWindow, first: int, stop: int) -> schema.Phones:
        phones = tuple(window.phones[first:stop])
        return schema.Phones(self.session, window.number, window.sequence, first, phones, window.revision)

    def _opening(self, window: SendWindow, now_s: float) -> list[schema.Wire]:
        """Begin, as long as the engine is not known to have it; with what it needs to know the time."""
        if window.is_begun:
            return []
        begin = schema.BeginUtterance(
            self.session, window.number, window.revision, window.anchor, round(window.anchor_s * 1e6), self._phone_set,
            self._language,
        )  # fmt: skip
        return [self._handshake.new_ping(now_s), begin] if window.anchor == "at" else [begin]

    def _bundle(self, parts: Sequence[schema.Wire]) -> bytes:
        encoded = [codec.encode(part) for part in parts]
        return osc.bundles(encoded, limit=1 << 20)[0] if len(encoded) > 1 else encoded[0]

    def _push(self, now_s: float, packet: bytes) -> None:
        self._order += 1
        heapq.heappush(self._queue, (now_s, self._order, packet))
