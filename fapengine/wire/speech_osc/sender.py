"""The sending end of the robust mode: utterances to datagrams, repeated until they arrive or are too late.

Theory of operation
-------------------
Each datagram of phones repeats the two chunks before it, so single losses cost nothing. Phones that are not
acknowledged, or that the engine requests, are sent again as long as they can be shown; an end and a cancel are repeated
until they are answered. Until the engine has acknowledged an utterance, each of its datagrams starts with its begin, so
that none depends on another.

Pings keep the clocks together (:mod:`.clock`). An engine that was restarted has another ``instance``, or reports that
an utterance is unknown; the sender then sends everything again, with the original times.

:meth:`OscSender.due` returns the packets to send now, :meth:`OscSender.receive` processes the engine's. All times are
of the sender's own monotonic clock.
"""

import heapq
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import count
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.speech.phone_track import Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.handshake import PING_S, Handshake
from fapengine.wire.speech_osc.send_window import END_REPEATS_S, SOUND_AGAIN_S, PendingCancel, SendWindow, to_wire

CLOCK_WAIT_S = 0.25
"""Longest wait of an utterance with a start time for the first pong."""
ANSWERS = 5
"""Number of answers whose quickest is the answer time: an answer to a phone that had been lost takes too long."""
FIRST_ANSWER_S = 0.2
"""Answer time of an engine that has never answered."""


class OscSender:
    """The sending end of one session; see the theory of operation.

    Stateful.

    Parameters
    ----------
    session : str
        1..32 bytes.
    phone_set, language : str
        Of the labels: ``"ipa"``, ``"arpabet"``, ``"x-sampa"`` and others
        (:data:`fapengine.speech.alphabets.convert.ALPHABETS`).
    token : str
        If the engine requires one.
    instance : int
        An int32 other than 0, different for each run of the sender.
    repeats : int
        Chunks that each datagram repeats.
    acknowledged : bool
        Whether the engine acknowledges, so that what was lost is sent again.
    reliable : bool
        Whether the transport loses nothing (TCP): everything is sent once.
    limit : int, bytes
        Largest datagram.
    follows : bool
        Whether the caller handles ``Moved``, and calls :meth:`move` then.

    Attributes
    ----------
    handshake : Handshake
        State of the connection; the engine's clock.

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
        if not 0 < abs(instance) <= schema.INT32:
            raise UsageError(f"instance: got {instance}, expected an int32 other than 0")
        self.session = schema.check_session(session)
        self._repeats = 0 if reliable else repeats
        self._asks = acknowledged
        self._reliable, self._limit = reliable, limit
        flags = (schema.WANT_ACK if acknowledged else 0) | (schema.TCP if reliable else 0)
        flags |= schema.FOLLOWS if follows else 0
        self.handshake = Handshake(schema.Hello(session, schema.PROTOCOL, phone_set, language, flags, token, instance))
        self._phone_set, self._language = phone_set, language
        self._windows: dict[int, SendWindow] = {}
        self._next_number = 0
        self._cancels: dict[int, PendingCancel] = {}
        self._queue: list[tuple[float, int, bytes]] = []
        """Packets to send, as a heap: time, order, packet."""
        self._order = count(1)
        self._notices: deque[tuple[int, str, int, int]] = deque(maxlen=64)
        self._answers_s: deque[float] = deque(maxlen=ANSWERS)

    @property
    def live(self) -> tuple[int, ...]:
        """Utterances that may not be over."""
        return tuple(self._windows)

    def is_settled(self) -> bool:
        """Whether everything is known to have arrived."""
        windows = self._windows.values()
        is_whole = all(window.is_acknowledged and (window.is_end_known or not window.is_ended) for window in windows)
        return is_whole and not self._queue and not self._cancels

    def move(self, now_s: float, *, follows: bool = True, ping_s: float = PING_S) -> None:
        """Connect to another engine, or to the same one at another address, and send it everything again."""
        self.handshake.begin_elsewhere(now_s, follows=follows, ping_s=ping_s)
        for window in self._windows.values():
            window.restart(now_s)

    def begin(self, now_s: float, *, anchor: schema.WireAnchor = "now", at_s: float = 0.0) -> int:
        """Begin an utterance and return its number.

        Parameters
        ----------
        now_s : float
        anchor : WireAnchor
            ``"now"``: after the utterances before. ``"at"``: its time 0 is ``at_s`` of the sender's clock.
            ``"audio"``: when :meth:`audio` reports the position of its audio. ``"sound"``: as soon as the recognizer
            can keep up with the audio that arrives.
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
            If it was ended, or a phone is later than half an hour.
        """
        window = self._find(utterance)
        if window.is_ended or window.rate_hz:
            raise UsageError(f"utterance {utterance}: got phones {'after its end' if window.is_ended else 'and sound'}")
        window.phones += [to_wire(phone) for phone in phones]

    def sound(self, utterance: int, samples: NDArray[np.int16], rate_hz: int, now_s: float) -> None:
        """Add audio to an utterance; the engine's recognizer finds its phones.

        Parameters
        ----------
        utterance : int
        samples : (N,) int16
            Mono; they follow those of the last call.
        rate_hz : int
            8000..48000, the same for a whole utterance.
        now_s : float

        Raises
        ------
        UsageError
            If it was ended, has phones or begins ``"now"``, or the rate changed or is out of range.
        """
        window = self._find(utterance)
        if window.anchor == "now":
            raise UsageError(f"utterance {utterance}: got sound, expected a beginning at a time, by its sound, or none")
        if window.is_ended or window.phones:
            raise UsageError(f"utterance {utterance}: got sound {'after its end' if window.is_ended else 'and phones'}")
        if not schema.RATES_HZ[0] <= rate_hz <= schema.RATES_HZ[1] or rate_hz != (window.rate_hz or rate_hz):
            expected = window.rate_hz or f"{schema.RATES_HZ[0]} to {schema.RATES_HZ[1]}"
            raise UsageError(f"rate_hz: got {rate_hz}, expected {expected}")
        window.add_sound(self.session, samples, rate_hz, now_s, inf if self._reliable else SOUND_AGAIN_S)

    def end(self, utterance: int, *, duration_s: float | None = None) -> None:
        """End an utterance: no phone follows.

        Parameters
        ----------
        utterance : int
        duration_s : float, optional
            Of the utterance; by default until the end of its last phone.

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
        """Replace all phones of an utterance, including those that were shown already.

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
        """Stop speaking: one utterance, or all that were begun. A repeat changes nothing."""
        below = self._next_number if utterance is None else -1
        wanted = schema.NOW if utterance is None else utterance
        number = next(self._order)
        message = schema.CancelUtterance(self.session, wanted, fade_ms=round(fade_s * 1e3), below=below, number=number)
        for cancelled in [utterance] if utterance is not None else list(self._windows):
            self._windows.pop(cancelled, None)
        self._cancels[number] = PendingCancel(message, now_s)

    def audio(
        self, utterance: int, position_s: float, now_s: float, *, at_s: float | None = None, rate: float = 1.0
    ) -> None:
        """Report the audio position of an utterance; to be called 4 to 10 times a second.

        Parameters
        ----------
        utterance : int
        position_s : float
            In the utterance.
        now_s : float
        at_s : float, optional
            Time at which this position is heard, on the sender's clock; by default now.
        rate : float
            0: the audio is paused.
        """
        at_s = now_s if at_s is None else at_s
        window = self._windows.get(utterance)
        if window is not None and rate > 0:
            window.zero_s = at_s - position_s / rate
        self.tell(
            schema.AudioPosition(self.session, utterance, round(at_s * 1e6), round(position_s * 1e6), rate), now_s
        )

    def tell(self, message: schema.FromSender, now_s: float, *, repeats: bool = False) -> None:
        """Send a message now; if repeats do no harm, again after 20 and 60 ms."""
        packet = codec.encode(message)
        for later_s in END_REPEATS_S[: 3 if repeats and not self._reliable else 1]:
            heapq.heappush(self._queue, (now_s + later_s, next(self._order), packet))

    # Packets --------------------------------------------------------------------------------------------------------

    def due(self, now_s: float) -> list[bytes]:
        """Return the packets to send now."""
        packets = [_bundle(parts) for parts in self.handshake.due(now_s)]
        for cancel in self._cancels.values():
            if now_s >= cancel.next_s:
                packets.append(codec.encode(cancel.message))
                cancel.note_sent(now_s, asks=self._asks, reliable=self._reliable)
        self._cancels = {key: cancel for key, cancel in self._cancels.items() if cancel.next_s < inf}
        for window in list(self._windows.values()):
            if window.is_past(now_s):
                del self._windows[window.number]
            elif not self._waits_for_clock(window, now_s):
                packets += self._packets(window, now_s)
        while self._queue and self._queue[0][0] <= now_s:
            packets.append(heapq.heappop(self._queue)[2])
        return packets

    def next_s(self, now_s: float) -> float:
        """Time at which :meth:`due` has packets, if nothing arrives before."""
        times_s = [self.handshake.next_s, *(cancel.next_s for cancel in self._cancels.values())]
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
        """Process a packet of the engine.

        Returns
        -------
        list of FromEngine
            Its messages, without repeated notices and what is not of the schema.
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
            if isinstance(answer, schema.Moved) and answer.instance != self.handshake.hello.instance:
                continue
            self.handshake.hear(now_s)
            if isinstance(answer, schema.Notice) and not self._is_new(answer):
                continue
            heard.append(answer)
            self._hear(answer, now_s)
        return heard

    def _is_new(self, notice: schema.Notice) -> bool:
        """Whether a notice is not a repeat. An utterance ends once; other events may happen again at another time."""
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
                if self.handshake.answered(answer, now_s):
                    self._begin_again(now_s)
            case schema.Ack(utterance=number) if number in self._windows:
                took_s = self._windows[number].acknowledge(answer, now_s)
                if took_s is not None:
                    self._answers_s.append(took_s)
            case schema.Nack(utterance=number) if number in self._windows:
                window = self._windows[number]
                run = window.requested(answer.first, answer.stop, now_s, self.handshake.clock.rtt_s)
                for packet in self._run_packets(window, run, now_s) if run is not None else ():
                    heapq.heappush(self._queue, (now_s, next(self._order), packet))
            case schema.Notice():
                self._notice(answer, now_s)

    def _notice(self, notice: schema.Notice, now_s: float) -> None:
        for key, cancel in list(self._cancels.items()):
            if notice.kind in ("cancelled", "finished") and cancel.is_answered_by(notice):
                del self._cancels[key]
        window, clock = self._windows.get(notice.utterance), self.handshake.clock
        if notice.kind == "unknown" and notice.reason == "no begin" and window is not None:
            window.restart(now_s)
        elif notice.kind == "unknown":
            self._begin_again(now_s)
        elif window is None:
            return
        elif notice.kind == "started" and window.anchor == "now" and clock.is_known:
            window.zero_s = clock.sender_s(notice.engine_us / 1e6) - notice.position_us / 1e6
        elif notice.kind == "error" and notice.reason == "checksum":
            if not window.is_corrected:
                window.is_corrected = True
                self.revise(notice.utterance, window.phones, now_s)
        elif notice.kind in ("finished", "cancelled", "error"):
            del self._windows[notice.utterance]

    def _begin_again(self, now_s: float) -> None:
        """Send everything again to an engine without our state, but not before the last time could arrive."""
        if self.handshake.greet_again(now_s):
            for window in self._windows.values():
                window.restart(now_s)

    @property
    def _answer_s(self) -> float:
        """Recent answer time, including the queues of a busy engine."""
        clock = self.handshake.clock
        return min(self._answers_s, default=clock.rtt_s if clock.is_known else FIRST_ANSWER_S)

    def _find(self, utterance: int) -> SendWindow:
        if utterance not in self._windows:
            raise UsageError(f"utterance: got {utterance}, expected one that was begun and is not over")
        return self._windows[utterance]

    def _waits_for_clock(self, window: SendWindow, now_s: float) -> bool:
        is_early = self._asks and now_s < window.created_s + CLOCK_WAIT_S
        return is_early and window.anchor == "at" and not self.handshake.clock.is_known

    def _packets(self, window: SendWindow, now_s: float) -> list[bytes]:
        """Encode what an utterance has to send: new chunks, overdue phones, audio, its end."""
        packets: list[bytes] = []
        while (chunk := window.next_chunk(now_s)) is not None:
            repeated = window.chunks[max(len(window.chunks) - 1 - self._repeats, 0)][0]
            packets += self._run_packets(window, (repeated, chunk[1]), now_s, needed=chunk[0])
            if self._reliable:
                window.next_s = -inf
        if self._asks and not self._reliable:
            for run in window.overdue(now_s, self._answer_s):
                packets += self._run_packets(window, run, now_s)
        if not (window.phones or window.is_announced or window.is_begun):  # the begin takes its place in the queue
            window.is_announced = True
            packets.append(_bundle(self._opening(window, now_s)))
        while window.sounds and window.sounds[0][0] <= now_s:
            packets.append(_bundle([*self._opening(window, now_s), heapq.heappop(window.sounds)[2]]))
        if window.is_ended and not window.sounds and window.stop_sent >= len(window.phones) and now_s >= window.end_s:
            packets.append(self._end_packet(window, now_s))
        return packets

    def _end_packet(self, window: SendWindow, now_s: float) -> bytes:
        end = schema.EndUtterance(
            self.session, window.number, len(window.phones), window.duration_us, schema.checksum(window.phones),
            window.revision,
        )  # fmt: skip
        parts = self._opening(window, now_s)
        if window.end_sent and window.chunks and self._repeats and not self._asks:  # nobody else repeats them
            first = window.chunks[max(len(window.chunks) - self._repeats, 0)][0]
            if first >= window.next_index:
                parts.append(self._phones(window, first, window.stop_sent))
                window.sequence += 1
        packet = _bundle([*parts, end])
        waits = self._asks and not self._reliable
        window.note_end_sent(now_s, not (self._asks or self._reliable), self._answer_s if waits else inf)
        return packet if len(packet) <= self._limit else codec.encode(end)

    def _run_packets(
        self, window: SendWindow, run: tuple[int, int], now_s: float, needed: int | None = None
    ) -> list[bytes]:
        """Encode a run of phones in as few datagrams as possible; repeats before ``needed`` give way for room."""
        first, stop = run
        needed, packets = first if needed is None else needed, []
        while first < stop:
            until = stop
            packet = self._run_packet(window, first, until, now_s)
            while len(packet) > self._limit and (first < needed or until - first > 1):
                if first < needed:
                    first = min(first + 4, needed)
                else:
                    until = first + (until - first + 1) // 2
                packet = self._run_packet(window, first, until, now_s)
            packets.append(packet)
            window.sequence += 1
            window.note_sent(first, until, now_s)
            first = until
        return packets

    def _run_packet(self, window: SendWindow, first: int, stop: int, now_s: float) -> bytes:
        return _bundle([*self._opening(window, now_s), self._phones(window, first, stop)])

    def _phones(self, window: SendWindow, first: int, stop: int) -> schema.Phones:
        phones = tuple(window.phones[first:stop])
        return schema.Phones(self.session, window.number, window.sequence, first, phones, window.revision)

    def _opening(self, window: SendWindow, now_s: float) -> list[schema.Wire]:
        """Return the begin, until the engine has acknowledged it, with a ping if the start is a time."""
        if window.is_begun:
            return []
        begin = schema.BeginUtterance(
            self.session, window.number, window.revision, window.anchor, round(window.anchor_s * 1e6), self._phone_set,
            self._language,
        )  # fmt: skip
        return [self.handshake.new_ping(now_s), begin] if window.anchor == "at" else [begin]


def _bundle(parts: Sequence[schema.Wire]) -> bytes:
    encoded = [codec.encode(part) for part in parts]
    return osc.bundles(encoded, limit=1 << 20)[0] if len(encoded) > 1 else encoded[0]
