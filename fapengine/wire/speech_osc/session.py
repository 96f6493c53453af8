"""One session of the robust mode: a receive window for each utterance, and what its senders are answered.

Theory of operation
-------------------
Utterances have two numbers. A sender counts its own; the engine's only rise, whatever session they are for. A sender
that was restarted, or said bye, counts from the beginning again; its old utterances must not be taken for its new ones.
So the map from the sender's numbers is begun anew when a sender is (:class:`~.schema.Hello`), or when it begins an
utterance again that was over :data:`AGAIN_S` ago.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import get_args

import numpy as np

from fapengine.engine.commands import VOICE_UTTERANCES, Anchor, Append, Audio, Begin, Cancel, Command, End
from fapengine.engine.engine import Engine
from fapengine.engine.session import JUMP_S
from fapengine.errors import UsageError
from fapengine.speech.phone_track import Phone
from fapengine.wire.speech_osc import phone_labels, schema
from fapengine.wire.speech_osc.clock import SenderClock
from fapengine.wire.speech_osc.counts import SoundRequest, Tally, WordsRequest
from fapengine.wire.speech_osc.receive_window import (
    ACK_S,
    MAX_NACKS,
    MAX_UNBEGUN,
    NACK_AGAIN_S,
    UNBEGUN_S,
    ReceiveWindow,
    State,
)
from fapengine.wire.speech_osc.sound_window import SoundWindow

AGAIN_S = 2.0
"""Time after the end of an utterance from which a begin of it is no repeat."""
CANCEL_REPEAT_S = 0.25
FOLLOW_S = 1.0
"""Time between comparisons of an utterance with the sender's clock."""
FOLLOW_ERROR_S = 0.003
HEARD_S = 2.0
"""Time for which a sender's report of its sound counts more than its clock."""
REMEMBERED_S = 20.0
"""Time for which an utterance that is over is remembered, for its repeats: senders repeat for 15 s."""
FADES_MS = (10, 10_000)
MAX_PEERS = 8
"""Number of peers of one session that hear of it; one more takes the place of one that is silent, or is refused."""
INT32 = 2**31 - 1

Send = Callable[[Hashable, schema.FromEngine], None]
"""Function that answers a peer."""


@dataclass(slots=True, eq=False)
class WireSession:
    """Receive windows of one session, and what its senders are still to be answered.

    Stateful.
    """

    name: str
    engine: Engine
    max_utterances: int
    max_phones: int
    """Number of phones of an utterance that the engine takes."""
    numbers: Iterator[int]
    """Numbers of the engine for new utterances."""
    phone_set: str = "ipa"
    instance: int = 0
    peers: dict[Hashable, int] = field(default_factory=dict)
    """Flags of the hello of each peer that joined."""
    windows: dict[int, ReceiveWindow] = field(default_factory=dict)
    """Window of each of the sender's numbers, the latest last."""
    sounding: set[int] = field(default_factory=set)
    """Sender's numbers of utterances whose sound may be released."""
    pending: dict[int, Hashable] = field(default_factory=dict)
    """Peer to be answered, of each sender's number for which a timer runs."""
    _sender_numbers: dict[int, int] = field(default_factory=dict)
    """Sender's number of each of the engine's."""
    _cancelled_below: int = -INT32
    """Sender's number below which all were cancelled, whether they had come or not."""
    _cancels: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Time at which each cancel came."""

    def new_number(self) -> int:
        """Give the engine's number of a new utterance."""
        return next(self.numbers)

    def is_other(self, hello: schema.Hello) -> bool:
        """Whether a hello is that of another sender than before, or of one that was restarted."""
        return hello.instance != self.instance and bool(hello.instance and self.instance)

    def has_room_for(self, peer: Hashable, is_heard: Callable[[Hashable], bool]) -> bool:
        """Make room for a peer, at the cost of one that is not heard of any more; False if there is none."""
        if peer not in self.peers and len(self.peers) >= MAX_PEERS:
            silent = next((name for name in self.peers if not is_heard(name)), None)
            if silent is None:
                return False
            del self.peers[silent]
        return True

    def join(self, peer: Hashable, hello: schema.Hello, now_s: float) -> bool:
        """Take a sender in; whether it is another one than before, so that what was begun is cancelled."""
        self.peers[peer] = hello.flags
        phone_set = phone_labels.phone_set_named(hello.phone_set)
        if phone_set and hello.phone_set:
            self.phone_set = phone_set
        is_other = self.is_other(hello)
        self.instance = hello.instance or self.instance
        if is_other:
            self.peers = {peer: hello.flags}
            for window in self.windows.values():
                if not window.is_stopped:
                    self.tell(Cancel(window.engine_number), now_s)
        if is_other or all(window.is_over for window in self.windows.values()):
            self.forget()
        return is_other

    def forget(self) -> None:
        """Know of no utterance: the sender's numbers may begin again."""
        self.windows.clear()
        self.sounding.clear()
        self._sender_numbers.clear()
        self.pending.clear()
        self._cancelled_below = -INT32
        self._cancels.clear()

    def tell(self, command: Command, now_s: float) -> None:
        """Tell the engine."""
        self.engine.apply(self.name, command, now_s)

    def begin(
        self, message: schema.BeginUtterance, clock: SenderClock, peer: Hashable, now_s: float, tally: Tally
    ) -> bool:
        """Open an utterance; False if the engine has no place for it."""
        if message.anchor not in get_args(schema.WireAnchor):
            tally.add("malformed")
            return True
        window = self.windows.get(message.utterance)
        if window is not None and window.is_over and now_s - window.over_s > AGAIN_S:
            del self.windows[message.utterance]
        elif message.utterance < self._cancelled_below and window is None:
            tally.add("repeated")
            return True
        self._forget_old(now_s)
        window = self._open_window(message.utterance)
        if window.is_over or (window.begun is not None and message.revision <= window.revision):
            tally.add("repeated")
            if window.sound is not None:  # its sender puts it in front of the sound until it is acknowledged
                self._due_ack(message.utterance, window, peer, now_s)
            return True
        phone_set = phone_labels.phone_set_named(message.phone_set) if message.phone_set else self.phone_set
        if phone_set is None:
            tally.add("refused")
            phone_set = self.phone_set
        window.begin(message, phone_set)
        if message.anchor == "sound":
            window.is_placed = False
            return True
        self._tell_begin(window, message, clock, now_s)
        if self.engine.utterance(self.name, window.engine_number) is None:
            window.close(now_s)
            return False
        self.pending.setdefault(message.utterance, peer)
        for run in _runs(window.phones):  # they overtook it, and may have been read in another phone set
            self._tell_phones(window, run[0], [window.phones[index] for index in run], now_s)
        self._tell_end(window, now_s)
        return True

    def _tell_begin(
        self, window: ReceiveWindow, message: schema.BeginUtterance, clock: SenderClock, now_s: float
    ) -> None:
        if message.anchor == "at" and clock.is_known:
            at_s = clock.engine_s(message.anchor_us / 1e6)
            self.tell(Begin(window.engine_number, "at", at_s, message.revision), now_s)
            window.follow_s, window.clock_steps = max(at_s, now_s) + FOLLOW_S, clock.steps
        else:  # without a common clock "at" can only mean now
            anchor: Anchor = "audio" if message.anchor == "audio" else "now"
            self.tell(Begin(window.engine_number, anchor, 0.0, message.revision), now_s)

    def phones(self, message: schema.Phones, peer: Hashable, now_s: float, tally: Tally) -> None:
        """Take phones in."""
        if message.first_index + len(message.phones) > self.max_phones:
            tally.add("refused")
            return
        window = self._find(message.utterance)
        if window is None or window.state is State.CANCELLED:
            tally.add("repeated")
            return
        if window.sound is not None or window.words is not None:
            tally.add("refused")
            return
        tally.add("lost", window.lost(message.sequence))
        if not window.is_over:
            if not window.take(message):
                tally.add("repeated")
            elif window.begun is None:  # before the begin the phone set is not known; they are told then
                window.unbegun_s = min(window.unbegun_s, now_s + UNBEGUN_S)
            else:
                self._tell_phones(window, message.first_index, message.phones, now_s)
            self._check(window, message.utterance, now_s, tally)
        self._due_ack(message.utterance, window, peer, now_s)

    def words(
        self, message: schema.WordTimes, clock: SenderClock, peer: Hashable, now_s: float, tally: Tally
    ) -> WordsRequest | None:
        """Take words in, instead of phones; those that come again, or behind later ones, are left out.

        Raises
        ------
        UsageError
            If the engine has no place for the utterance, which this begins if nothing else did.
        """
        window = self._find(message.utterance)
        if window is None or window.is_stopped or window.end is not None or message.first_index < (window.words or 0):
            tally.add("repeated")
            if window is not None and window.words is not None:  # its acknowledgement was lost
                self._due_ack(message.utterance, window, peer, now_s)
            return None
        if window.sound is not None or window.phones:
            tally.add("refused")
            return None
        if window.begun is None and not self.begin(
            schema.BeginUtterance(self.name, message.utterance), clock, peer, now_s, tally
        ):
            raise UsageError("utterances")
        window.words, window.voice = message.first_index + len(message.words), message.voice or window.voice
        words = tuple(
            (word.text, word.start_us / 1e6, (word.start_us + word.duration_us) / 1e6) for word in message.words
        )
        self._due_ack(message.utterance, window, peer, now_s)
        return WordsRequest(self.name, window.engine_number, words, window.voice, peer)

    def end_words(self, message: schema.EndUtterance, peer: Hashable, now_s: float) -> WordsRequest | None:
        """Learn that no word follows; None for an utterance that has none, or was ended before."""
        window = self.windows.get(message.utterance)
        if window is None or window.words is None or window.is_stopped or not window.finish(message):
            return None  # end() acknowledges one that comes again
        self._due_ack(message.utterance, window, peer, now_s)
        length_s = max(message.duration_us, 0) / 1e6
        return WordsRequest(self.name, window.engine_number, (), window.voice, peer, is_last=True, duration_s=length_s)

    def end(self, message: schema.EndUtterance, peer: Hashable, now_s: float, tally: Tally) -> None:
        """Learn that an utterance is whole."""
        if not 0 <= message.phone_count <= self.max_phones:
            tally.add("refused")
            return
        window = self._find(message.utterance)
        if window is None or window.state is State.CANCELLED:
            tally.add("repeated")
            return
        if window.sound is not None:
            rate_hz = window.sound.rate_hz
            window.sound.finish(
                round(message.duration_us * 1e-6 * rate_hz) if message.duration_us >= 0 else None, now_s
            )
        if not window.is_over and window.finish(message):
            self._tell_end(window, now_s)
            self._check(window, message.utterance, now_s, tally)
        else:
            tally.add("repeated")
        self._due_ack(message.utterance, window, peer, now_s)

    def cancel(self, message: schema.CancelUtterance, now_s: float, tally: Tally) -> list[int]:
        """Stop speaking; returns what can be answered at once: -1 for all, or one that is over or never began."""
        fade_s = min(max(message.fade_ms, FADES_MS[0]), FADES_MS[1]) / 1e3
        if message.utterance != schema.NOW:
            window = self._find(message.utterance)
            if window is None or window.is_stopped:
                tally.add("repeated")
                return [message.utterance]
            self._cancel(window, message.at_us, fade_s, now_s)
            return [message.utterance] if window.is_over else []
        if self._is_repeat(message, now_s):
            tally.add("repeated")
            return [schema.NOW]
        self._cancelled_below = max(self._cancelled_below, message.below)
        everyone = message.below < 0
        for sender_number, window in self.windows.items():
            if not window.is_stopped and (everyone or sender_number < message.below):
                self._cancel(window, message.at_us, fade_s, now_s)
        if message.at_us < 0:  # what the server's voice says, too, and with everyone what the simple mode does
            self.tell(Cancel(None, None, fade_s, 0 if everyone else VOICE_UTTERANCES), now_s)
        return [schema.NOW]

    def _is_repeat(self, message: schema.CancelUtterance, now_s: float) -> bool:
        key = (message.at_us, message.fade_ms, message.below, message.number)
        came_s = self._cancels.get(key, -inf)
        if now_s - came_s < (AGAIN_S if message.number else CANCEL_REPEAT_S):
            return True
        self._cancels[key] = now_s
        while len(self._cancels) > self.max_utterances:
            del self._cancels[next(iter(self._cancels))]
        return False

    def audio(self, message: schema.AudioPosition, at_s: float, now_s: float, tally: Tally) -> None:
        """Follow the sound; ``at_s`` is the engine's time that the message means."""
        window = self._find(message.utterance)
        if window is None or window.is_over:
            tally.add("repeated")
            return
        window.heard_s = now_s
        rate = min(max(message.rate, 0.0), 4.0)
        self.tell(Audio(window.engine_number, at_s, message.position_us / 1e6, rate), now_s)

    def stop_following(self) -> None:
        """Stop the comparison with the clock: the sender has moved what is said by hand."""
        for window in self.windows.values():
            window.follow_s = inf

    def close_window(self, engine_number: int, is_cancelled: bool, now_s: float) -> int | None:
        """Learn that the engine is through with an utterance; returns the sender's number."""
        sender_number = self._sender_numbers.pop(engine_number, None)
        window = self.windows.get(sender_number) if sender_number is not None else None
        if window is None or sender_number is None or window.engine_number != engine_number:
            return None
        if is_cancelled:
            window.cancel()
        window.close(now_s)
        return sender_number

    def sender_number(self, engine_number: int) -> int | None:
        """Give the sender's number of an utterance of the engine."""
        return self._sender_numbers.get(engine_number)

    def tick(
        self,
        clock_of: Callable[[Hashable], SenderClock | None],
        send: Send,
        now_s: float,
        is_behind: Callable[[Hashable], bool],
    ) -> None:
        """Acknowledge, ask, and compare, as far as it is due; what may wait unread is not asked for."""
        for sender_number, peer in list(self.pending.items()):
            window = self.windows.get(sender_number)
            if window is None:
                del self.pending[sender_number]
                continue
            if window.due_s > now_s:
                if window.due_s == inf:
                    del self.pending[sender_number]
                continue
            if window.follow_s <= now_s:
                self._follow(window, clock_of(peer), now_s)
            if window.unbegun_s <= now_s:
                window.unbegun_s = now_s + UNBEGUN_S
                window.unbegun += 1
                if window.unbegun > MAX_UNBEGUN or peer not in self.peers:  # nobody there, or who is not to be answered
                    self._forget_one(sender_number)
                    continue
                send(peer, self._notice(sender_number, "unknown", now_s, "no begin"))
            if window.ack_s <= now_s:
                window.ack_s = inf
                send(peer, self._ack(sender_number, window, now_s))
                if window.is_corrupt:
                    send(peer, self._notice(sender_number, "error", now_s, "checksum"))
            if window.nack_s <= now_s and is_behind(peer):
                window.nack_s = now_s + NACK_AGAIN_S
            if window.nack_s <= now_s:
                window.nacks += 1
                window.nack_s = now_s + NACK_AGAIN_S
                for first, stop in window.missing()[:8]:
                    send(peer, schema.Nack(self.name, sender_number, first, stop))
                if window.nacks >= MAX_NACKS:
                    window.nack_s = inf

    def _open_window(self, sender_number: int) -> ReceiveWindow:
        window = self.windows.get(sender_number)
        if window is None:
            window = self.windows[sender_number] = ReceiveWindow(self.new_number(), self.phone_set)
            self._sender_numbers[window.engine_number] = sender_number
            while len(self.windows) > self.max_utterances:
                self._forget_one(next(iter(self.windows)))
        return window

    def sound(self, message: schema.Sound, now_s: float, tally: Tally) -> None:
        """Take sound in, instead of phones; its end is told as that of phones is."""
        window = self._find(message.utterance)
        if window is None or window.is_stopped:
            tally.add("repeated")
            return
        if window.sound is None:
            if window.phones or window.end is not None:
                tally.add("refused")
                return
            window.sound = SoundWindow(message.rate_hz)
            if window.begun is None:
                window.is_placed = False  # its begin is not waited for
                window.begin(schema.BeginUtterance(self.name, message.utterance), self.phone_set)
        if message.rate_hz != window.sound.rate_hz:
            tally.add("refused")
            return
        samples = np.frombuffer(message.samples, "<i2").astype(np.int16)
        is_new = window.sound.take(message.first_sample, samples, now_s)
        if not is_new:
            tally.add("refused" if is_new is None else "repeated")
        self.sounding.add(message.utterance)

    def sounds(self, now_s: float, tally: Tally) -> list[SoundRequest]:
        """Take what has come of sounds, in order."""
        requests = []
        for number in sorted(self.sounding):
            window = self.windows.get(number)
            sound = window.sound if window is not None else None
            if window is None or sound is None or window.is_stopped:
                self.sounding.discard(number)
                continue
            before = sound.lost
            pieces = sound.release(now_s)
            tally.add("sound_lost", sound.lost - before)
            if sound.is_released:
                self.sounding.discard(number)
            if pieces or sound.is_released:
                samples = np.concatenate(pieces) if pieces else np.zeros(0, np.int16)
                first_s = sound.first / sound.rate_hz
                requests.append(
                    SoundRequest(
                        self.name, window.engine_number, first_s, sound.rate_hz, samples, window.is_placed,
                        sound.is_released,
                    )
                )  # fmt: skip
        return requests

    def _forget_old(self, now_s: float) -> None:
        """Forget those that were over long ago, the oldest first."""
        for sender_number, window in list(self.windows.items()):
            if now_s - window.over_s <= REMEMBERED_S:
                break
            self._forget_one(sender_number)

    def _forget_one(self, sender_number: int) -> None:
        self._sender_numbers.pop(self.windows.pop(sender_number).engine_number, None)
        self.pending.pop(sender_number, None)

    def _find(self, sender_number: int) -> ReceiveWindow | None:
        """Find an utterance, or make it known: phones may overtake its begin. None: it was cancelled unseen."""
        if sender_number < self._cancelled_below and sender_number not in self.windows:
            return None
        return self._open_window(sender_number)

    def _tell_phones(self, window: ReceiveWindow, first: int, phones: Sequence[schema.WirePhone], now_s: float) -> None:
        engine_phones: tuple[Phone, ...] = tuple(
            phone_labels.to_engine_phone(phone, window.phone_set) for phone in phones
        )
        self.tell(Append(window.engine_number, first, engine_phones, window.revision), now_s)

    def _tell_end(self, window: ReceiveWindow, now_s: float) -> None:
        if window.end is None or window.begun is None or window.sound is not None or window.words is not None:
            return
        latest_s = max((phone.start_us + phone.duration_us for phone in window.phones.values()), default=0) / 1e6
        duration_s = max(window.end.duration_us / 1e6, latest_s) if window.end.duration_us >= 0 else latest_s
        self.tell(End(window.engine_number, window.end.phone_count, duration_s, window.revision), now_s)

    def _check(self, window: ReceiveWindow, sender_number: int, now_s: float, tally: Tally) -> None:
        window.watch(now_s)
        if window.is_whole and not window.is_corrupt and not window.is_sound():
            window.is_corrupt = True
            tally.add("checksums")

    def _due_ack(self, sender_number: int, window: ReceiveWindow, peer: Hashable, now_s: float) -> None:
        if self.peers.get(peer, 0) & schema.WANT_ACK:
            window.ack_s = min(window.ack_s, now_s + ACK_S)
        else:
            window.nack_s = inf  # who does not listen is not asked
        self.pending[sender_number] = peer

    def _ack(self, sender_number: int, window: ReceiveWindow, now_s: float) -> schema.Ack:
        utterance = self.engine.utterance(self.name, window.engine_number) if not window.is_over else None
        slack_s = utterance.slack_s(now_s) if utterance is not None and utterance.phones else 0.0
        slack_us = int(min(max(slack_s * 1e6, -INT32), INT32))
        ended = int(window.end is not None)
        next_index = window.next_index if window.words is None else window.words
        return schema.Ack(self.name, sender_number, next_index, window.bitmap64, slack_us, ended, window.revision)

    def _notice(self, sender_number: int, kind: str, now_s: float, reason: str) -> schema.Notice:
        return schema.Notice(self.name, sender_number, kind, engine_us=microseconds(now_s), reason=reason)

    def _cancel(self, window: ReceiveWindow, at_us: int, fade_s: float, now_s: float) -> None:
        at_s = None
        if at_us >= 0:
            utterance = self.engine.utterance(self.name, window.engine_number)
            if utterance is not None and utterance.state.is_placed:
                at_s = now_s + at_us / 1e6 - utterance.position_s(now_s)
        if window.begun is None:
            window.cancel()  # its begin is still to come, and too late
            window.close(now_s)
            return
        if at_s is None:
            window.cancel()
        self.tell(Cancel(window.engine_number, at_s, fade_s), now_s)

    def _follow(self, window: ReceiveWindow, clock: SenderClock | None, now_s: float) -> None:
        """Keep an utterance that was begun at a time of the sender's clock at it, though the clocks drift."""
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


def microseconds(time_s: float) -> int:
    """Round to whole microseconds."""
    return round(time_s * 1e6)


def check_open(engine: Engine, session: str, now_s: float) -> bool:
    """Open a session if it is not; whether it is open now."""
    if session in engine:
        return True
    try:
        engine.open(session, now_s)
    except UsageError:  # as many as there may be
        return False
    return True


def _runs(phones: dict[int, schema.WirePhone]) -> list[list[int]]:
    runs: list[list[int]] = []
    for index in sorted(phones):
        if runs and runs[-1][-1] == index - 1:
            runs[-1].append(index)
        else:
            runs.append([index])
    return runs
