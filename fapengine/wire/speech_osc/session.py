"""One session of the reliable protocol: a receive window for each utterance, and the answers to its senders.

Theory of operation
-------------------
Utterances have two numbers. Each sender counts its own; the engine's only rise, across all sessions. A sender that was
restarted, or said bye, counts from the beginning again, and its old utterances must not be taken for its new ones. So
the map from the sender's numbers is cleared when a sender is restarted (:class:`~.schema.Hello`); and a begin of an
utterance that was over :data:`AGAIN_S` ago begins a new one.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import get_args

import numpy as np

from fapengine.engine.commands import VOICE_UTTERANCES, Anchor, Append, Audio, Begin, Cancel, Command, End, Seek
from fapengine.engine.engine import Engine
from fapengine.engine.session import JUMP_S
from fapengine.wire.speech_osc import codec, phone_labels, receive_window, schema
from fapengine.wire.speech_osc.clock import SenderClock
from fapengine.wire.speech_osc.peers import Arrival, Peer, Replies, SoundRequest, WireCounts, WordsRequest
from fapengine.wire.speech_osc.receive_window import ReceiveWindow, SoundWindow

AGAIN_S = 2.0
"""Time after the end of an utterance from which a begin of it is not a repeat."""
CANCEL_REPEAT_S = 0.25
FOLLOW_S = 1.0
"""Time between comparisons of an utterance with the sender's clock."""
FOLLOW_ERROR_S = 0.003
HEARD_S = 2.0
"""Time for which a sender's report of its audio position overrides its clock."""
REMEMBERED_S = 20.0
"""Time for which an utterance that is over is remembered, for its repeats: senders repeat for 15 s."""
FADES_MS = (10, 10_000)


@dataclass(slots=True, eq=False)
class WireSession:
    """Receive windows of one session, and pending answers to its senders.

    Stateful.
    """

    name: str
    engine: Engine
    max_utterances: int
    max_phones: int
    """Number of phones of an utterance that the engine takes."""
    numbers: Iterator[int]
    """Engine numbers for new utterances."""
    counts: WireCounts
    phone_set: str = "ipa"
    instance: int = 0
    peers: dict[Hashable, int] = field(default_factory=dict)
    """Flags of the hello of each peer that joined."""
    windows: dict[int, ReceiveWindow] = field(default_factory=dict)
    """Window of each of the sender's numbers, the latest last."""
    sounding: set[int] = field(default_factory=set)
    """Sender's numbers of utterances whose audio is still to be released."""
    pending: dict[int, Hashable] = field(default_factory=dict)
    """Peer to answer, by sender's number, for windows with a timer."""
    sender_numbers: dict[int, int] = field(default_factory=dict)
    """Sender's number of each engine number."""
    _cancelled_below: int = -schema.INT32
    """Sender's number below which all utterances were cancelled, even those that have not arrived."""
    _cancels: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Time of arrival of each cancel."""

    def join(self, peer: Hashable, hello: schema.Hello, *, is_new_sender: bool, now_s: float) -> None:
        """Add a peer; cancel everything if it is a new sender, or the same one restarted."""
        self.peers[peer] = hello.flags
        if hello.phone_set:
            self.phone_set = phone_labels.phone_set_named(hello.phone_set) or self.phone_set
        self.instance = hello.instance or self.instance
        if is_new_sender:
            self.peers = {peer: hello.flags}
            for window in self.windows.values():
                if not window.is_stopped:
                    self.tell(Cancel(window.engine_number), now_s)
        if is_new_sender or all(window.is_over for window in self.windows.values()):
            self.forget()

    def forget(self) -> None:
        """Forget all utterances: the sender may count from the beginning again."""
        self.windows.clear()
        self.sounding.clear()
        self.sender_numbers.clear()
        self.pending.clear()
        self._cancelled_below = -schema.INT32
        self._cancels.clear()

    def tell(self, command: Command, now_s: float) -> str:
        """Apply a command in the engine; return why it was refused, or nothing."""
        return self.engine.apply(self.name, command, now_s)

    def move(self, command: Command, now_s: float) -> None:
        """Apply a command that moves an utterance in time; its sender's clock is not followed any more."""
        for window in self.windows.values():
            window.follow_s = inf
        self.tell(command, now_s)

    def seek(self, message: schema.SeekUtterance, now_s: float) -> None:
        """Continue an utterance from another position."""
        window = self.windows.get(message.utterance)
        if window is None or message.position_us < 0:
            self.counts.refused += 1
        else:
            self.move(Seek(window.engine_number, message.position_us / 1e6), now_s)

    def begin(self, message: schema.BeginUtterance, arrival: Arrival) -> bool:
        """Begin an utterance; False if the engine has no room for it."""
        number, now_s = message.utterance, arrival.now_s
        if message.anchor not in get_args(schema.WireAnchor):
            self.counts.malformed += 1
            return True
        window = self.windows.get(number)
        if window is not None and window.is_over and now_s - window.over_s > AGAIN_S:
            del self.windows[number]
        elif window is None and number < self._cancelled_below:
            self.counts.repeated += 1
            return True
        for old, window in list(self.windows.items()):
            if now_s - window.over_s <= REMEMBERED_S:
                break
            self._forget_one(old)
        window = self._open_window(number)
        if window.is_over or (window.begun is not None and message.revision <= window.revision):
            self.counts.repeated += 1
            if window.sound is not None:  # its sender repeats the begin with all audio until it is acknowledged
                self._schedule_ack(number, window, arrival)
            return True
        phone_set = phone_labels.phone_set_named(message.phone_set) if message.phone_set else self.phone_set
        self.counts.refused += phone_set is None
        window.begin(message, phone_set or self.phone_set)
        if message.anchor == "sound":
            window.is_placed = False
            return True
        clock, at_s = arrival.peer.clock, 0.0
        anchor: Anchor = "audio" if message.anchor == "audio" else "now"
        if message.anchor == "at" and clock.is_known:  # without a common clock "at" can only mean now
            anchor, at_s = "at", clock.engine_s(message.anchor_us / 1e6)
            window.follow_s, window.clock_steps = max(at_s, now_s) + FOLLOW_S, clock.steps
        self.tell(Begin(window.engine_number, anchor, at_s, message.revision), now_s)
        if self.engine.utterance(self.name, window.engine_number) is None:
            window.close(now_s)
            arrival.refuse(self.name, "utterances", number)
            return False
        self.pending.setdefault(number, arrival.peer.name)
        for first, stop in schema.runs(sorted(window.phones)):  # phones that arrived before the begin
            self._tell_phones(window, first, [window.phones[index] for index in range(first, stop)], now_s)
        self._tell_end(window, now_s)
        return True

    def phones(self, message: schema.Phones, arrival: Arrival) -> None:
        """Add phones to an utterance."""
        now_s = arrival.now_s
        if message.first_index + len(message.phones) > self.max_phones:
            self.counts.refused += 1
            return
        window = self._find(message.utterance)
        if window is None or window.is_cancelled:
            self.counts.repeated += 1
            return
        if window.sound is not None or window.words is not None:
            self.counts.refused += 1
            return
        self.counts.lost += window.count_lost(message.sequence)
        if not window.is_over:
            if not window.take(message):
                self.counts.repeated += 1
            elif window.begun is None:  # the phone set is not known before the begin
                window.unbegun_s = min(window.unbegun_s, now_s + receive_window.UNBEGUN_S)
            else:
                refusal = self._tell_phones(window, message.first_index, message.phones, now_s)
                if refusal:
                    arrival.refuse(self.name, refusal, message.utterance)
            self.counts.checksums += window.check(now_s)
        self._schedule_ack(message.utterance, window, arrival)

    def words(self, message: schema.WordTimes, arrival: Arrival) -> WordsRequest | None:
        """Add words to an utterance, instead of phones; begin it if its begin has not arrived.

        Repeats and words before the last ones are left out.
        """
        window = self._find(message.utterance)
        if window is None or window.is_stopped or window.end is not None or message.first_index < (window.words or 0):
            self.counts.repeated += 1
            if window is not None and window.words is not None:  # its acknowledgement was lost
                self._schedule_ack(message.utterance, window, arrival)
            return None
        if window.sound is not None or window.phones:
            self.counts.refused += 1
            return None
        if window.begun is None and not self.begin(schema.BeginUtterance(self.name, message.utterance), arrival):
            return None
        window.words, window.voice = message.first_index + len(message.words), message.voice or window.voice
        words = tuple(
            (text, start_us / 1e6, (start_us + length_us) / 1e6) for text, start_us, length_us in message.words
        )
        self._schedule_ack(message.utterance, window, arrival)
        return WordsRequest(self.name, window.engine_number, words, window.voice, arrival.peer.name)

    def sound(self, message: schema.Sound, arrival: Arrival) -> None:
        """Add audio to an utterance, instead of phones; begin it if its begin has not arrived."""
        window = self._find(message.utterance)
        if window is None or window.is_stopped:
            self.counts.repeated += 1
            return
        is_late = window.sound is None and (window.phones or window.end is not None)
        if is_late or (window.sound is not None and message.rate_hz != window.sound.rate_hz):
            self.counts.refused += 1
            return
        if window.sound is None:
            window.sound = SoundWindow(message.rate_hz)
            if window.begun is None:
                window.is_placed = False
                window.begin(schema.BeginUtterance(self.name, message.utterance), self.phone_set)
        samples = np.frombuffer(message.samples, "<i2").astype(np.int16)
        is_new = window.sound.take(message.first_sample, samples, arrival.now_s)
        self.counts.refused += is_new is None
        self.counts.repeated += is_new is False
        self.sounding.add(message.utterance)

    def end(self, message: schema.EndUtterance, arrival: Arrival) -> WordsRequest | None:
        """Complete an utterance; return the last request of one that has words."""
        number, now_s = message.utterance, arrival.now_s
        window = self.windows.get(number)
        if window is not None and window.words is not None and not window.is_stopped and window.finish(message):
            self._schedule_ack(number, window, arrival)
            return WordsRequest(
                self.name, window.engine_number, (), window.voice, arrival.peer.name, is_last=True,
                duration_s=max(message.duration_us, 0) / 1e6,
            )  # fmt: skip
        if not 0 <= message.phone_count <= self.max_phones:
            self.counts.refused += 1
            return None
        window = self._find(number)
        if window is None or window.is_cancelled:
            self.counts.repeated += 1
            return None
        if window.sound is not None:
            count = round(message.duration_us * 1e-6 * window.sound.rate_hz)
            window.sound.finish(count if message.duration_us >= 0 else None, now_s)
        if not window.is_over and window.finish(message):
            self._tell_end(window, now_s)
            self.counts.checksums += window.check(now_s)
        else:
            self.counts.repeated += 1
        self._schedule_ack(number, window, arrival)
        return None

    def cancel(self, message: schema.CancelUtterance, arrival: Arrival) -> None:
        """Stop speaking. The answer is immediate, except for an utterance that is still fading."""
        fade_s, now_s = min(max(message.fade_ms, FADES_MS[0]), FADES_MS[1]) / 1e3, arrival.now_s
        is_answered = True
        if message.utterance != schema.NOW:
            window = self._find(message.utterance)
            is_repeat = window is None or window.is_stopped
            if window is not None and not is_repeat:
                self._cancel(window, message.at_us, fade_s, now_s)
                is_answered = window.is_over
        else:
            is_repeat = self._is_repeat(message, now_s)
            if not is_repeat:
                self._cancel_all(message, fade_s, now_s)
        self.counts.repeated += is_repeat
        if is_answered:
            arrival.notify(self.name, message.utterance, "cancelled", count=message.number)

    def audio(self, message: schema.AudioPosition, at_s: float, now_s: float) -> None:
        """Follow the sender's audio; ``at_s`` is the engine time of the position."""
        window = self._find(message.utterance)
        if window is None or window.is_over:
            self.counts.repeated += 1
            return
        window.heard_s = now_s
        rate = min(max(message.rate, 0.0), 4.0)
        self.tell(Audio(window.engine_number, at_s, message.position_us / 1e6, rate), now_s)

    def close_window(self, engine_number: int, is_cancelled: bool, now_s: float) -> int | None:
        """Note that the engine has closed an utterance; return the sender's number."""
        sender_number = self.sender_numbers.pop(engine_number, None)
        window = self.windows.get(sender_number) if sender_number is not None else None
        if window is None or window.engine_number != engine_number:
            return None
        window.is_cancelled |= is_cancelled
        window.close(now_s)
        return sender_number

    def tick(
        self, peer_of: Callable[[Hashable], Peer | None], now_s: float, is_behind: Callable[[Hashable], bool]
    ) -> Replies:
        """Acknowledge, request phones and follow clocks where due. A peer whose packets wait unread gets no request."""
        wires: list[tuple[Hashable, schema.FromEngine]] = []
        now_us = round(now_s * 1e6)
        for number, peer in list(self.pending.items()):
            window = self.windows.get(number)
            due_s = min(window.ack_s, window.nack_s, window.unbegun_s, window.follow_s) if window is not None else inf
            if window is None or due_s == inf:
                del self.pending[number]
                continue
            if due_s > now_s:
                continue
            if window.follow_s <= now_s:
                known = peer_of(peer)
                self._follow(window, known.clock if known is not None else None, now_s)
            if window.unbegun_s <= now_s:
                window.unbegun_s = now_s + receive_window.UNBEGUN_S
                window.unbegun += 1
                if (
                    window.unbegun > receive_window.MAX_UNBEGUN or peer not in self.peers
                ):  # its sender is gone, or gets no answers
                    self._forget_one(number)
                    continue
                wires.append((peer, schema.Notice(self.name, number, "unknown", engine_us=now_us, reason="no begin")))
            if window.ack_s <= now_s:
                window.ack_s = inf
                wires.append((peer, self._ack(number, window, now_s)))
                if window.is_corrupt:
                    wires.append((peer, schema.Notice(self.name, number, "error", engine_us=now_us, reason="checksum")))
            if window.nack_s <= now_s:
                window.nack_s = now_s + receive_window.NACK_AGAIN_S
                if not is_behind(peer):
                    window.nacks += 1
                    wires += [(peer, schema.Nack(self.name, number, *gap)) for gap in window.missing()[:8]]
                    if window.nacks >= receive_window.MAX_NACKS:
                        window.nack_s = inf
        return [(peer, codec.encode(wire)) for peer, wire in wires]

    def sounds(self, now_s: float) -> list[SoundRequest]:
        """Release audio that has arrived, in order."""
        requests = []
        for number in sorted(self.sounding):
            window = self.windows.get(number)
            sound = window.sound if window is not None else None
            if window is None or sound is None or window.is_stopped:
                self.sounding.discard(number)
                continue
            before = sound.lost
            pieces = sound.release(now_s)
            self.counts.sound_lost += sound.lost - before
            if sound.is_released:
                self.sounding.discard(number)
            if pieces or sound.is_released:
                samples = np.concatenate(pieces) if pieces else np.zeros(0, np.int16)
                requests.append(
                    SoundRequest(
                        self.name, window.engine_number, sound.first / sound.rate_hz, sound.rate_hz, samples,
                        window.is_placed, sound.is_released,
                    )
                )  # fmt: skip
        return requests

    def _cancel_all(self, message: schema.CancelUtterance, fade_s: float, now_s: float) -> None:
        self._cancelled_below = max(self._cancelled_below, message.below)
        everyone = message.below < 0
        for sender_number, window in self.windows.items():
            if not window.is_stopped and (everyone or sender_number < message.below):
                self._cancel(window, message.at_us, fade_s, now_s)
        if message.at_us < 0:  # the server's voice, too, and for everyone the simple mode
            self.tell(Cancel(None, None, fade_s, 0 if everyone else VOICE_UTTERANCES), now_s)

    def _is_repeat(self, message: schema.CancelUtterance, now_s: float) -> bool:
        key = (message.at_us, message.fade_ms, message.below, message.number)
        if now_s - self._cancels.get(key, -inf) < (AGAIN_S if message.number else CANCEL_REPEAT_S):
            return True
        self._cancels[key] = now_s
        while len(self._cancels) > self.max_utterances:
            del self._cancels[next(iter(self._cancels))]
        return False

    def _find(self, sender_number: int) -> ReceiveWindow | None:
        """Find or open a window: phones may arrive before their begin. None if it was cancelled before it arrived."""
        if sender_number < self._cancelled_below and sender_number not in self.windows:
            return None
        return self._open_window(sender_number)

    def _open_window(self, sender_number: int) -> ReceiveWindow:
        window = self.windows.get(sender_number)
        if window is None:
            window = self.windows[sender_number] = ReceiveWindow(next(self.numbers), self.phone_set)
            self.sender_numbers[window.engine_number] = sender_number
            while len(self.windows) > self.max_utterances:
                self._forget_one(next(iter(self.windows)))
        return window

    def _forget_one(self, sender_number: int) -> None:
        self.sender_numbers.pop(self.windows.pop(sender_number).engine_number, None)
        self.pending.pop(sender_number, None)

    def _tell_phones(self, window: ReceiveWindow, first: int, phones: Sequence[schema.WirePhone], now_s: float) -> str:
        converted = tuple(phone_labels.to_engine_phone(phone, window.phone_set) for phone in phones)
        return self.tell(Append(window.engine_number, first, converted, window.revision), now_s)

    def _tell_end(self, window: ReceiveWindow, now_s: float) -> None:
        if window.end is None or window.begun is None or window.sound is not None or window.words is not None:
            return
        latest_s = max((phone.start_us + phone.duration_us for phone in window.phones.values()), default=0) / 1e6
        duration_s = max(window.end.duration_us / 1e6, latest_s) if window.end.duration_us >= 0 else latest_s
        self.tell(End(window.engine_number, window.end.phone_count, duration_s, window.revision), now_s)

    def _schedule_ack(self, sender_number: int, window: ReceiveWindow, arrival: Arrival) -> None:
        if self.peers.get(arrival.peer.name, 0) & schema.WANT_ACK:
            window.ack_s = min(window.ack_s, arrival.now_s + receive_window.ACK_S)
        else:
            window.nack_s = inf  # a peer that does not listen gets no requests
        self.pending[sender_number] = arrival.peer.name

    def _ack(self, sender_number: int, window: ReceiveWindow, now_s: float) -> schema.Ack:
        utterance = self.engine.utterance(self.name, window.engine_number) if not window.is_over else None
        slack_s = utterance.slack_s(now_s) if utterance is not None and utterance.phones else 0.0
        slack_us = int(min(max(slack_s * 1e6, -schema.INT32), schema.INT32))
        next_index = window.next_index if window.words is None else window.words
        is_ended = int(window.end is not None)
        return schema.Ack(self.name, sender_number, next_index, window.bitmap64, slack_us, is_ended, window.revision)

    def _cancel(self, window: ReceiveWindow, at_us: int, fade_s: float, now_s: float) -> None:
        at_s = None
        if at_us >= 0:
            utterance = self.engine.utterance(self.name, window.engine_number)
            if utterance is not None and utterance.state.is_placed:
                at_s = now_s + at_us / 1e6 - utterance.position_s(now_s)
        window.is_cancelled |= window.begun is None or at_s is None
        if window.begun is None:  # its begin is still to arrive, too late
            window.close(now_s)
        else:
            self.tell(Cancel(window.engine_number, at_s, fade_s), now_s)

    def _follow(self, window: ReceiveWindow, clock: SenderClock | None, now_s: float) -> None:
        """Correct the drift of an utterance that was begun at a time of the sender's clock."""
        window.follow_s = now_s + FOLLOW_S
        utterance = self.engine.utterance(self.name, window.engine_number)
        if utterance is None or window.begun is None or clock is None or clock.steps != window.clock_steps:
            window.follow_s = inf
            return
        if now_s - window.heard_s < HEARD_S or utterance.position_s(now_s) < 0:
            return
        heard_s = clock.sender_s(now_s) - window.begun.anchor_us / 1e6
        if FOLLOW_ERROR_S < abs(heard_s - utterance.position_s(now_s)) < JUMP_S:
            self.tell(Audio(window.engine_number, now_s, heard_s), now_s)
