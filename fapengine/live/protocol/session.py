"""One session of the robust mode: utterances by the sender's numbers, told to the engine under numbers of its own.

A sender that was restarted, or said bye, counts from the beginning again; its old utterances must not be taken for its
new ones. So the engine's numbers only rise, whatever session they are for, and the map from the sender's is begun anew
when a sender is (:class:`~.schema.Hello`), or when it begins an utterance again that was over :data:`AGAIN_S` ago.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf

from fapengine.errors import UsageError
from fapengine.live.engine.commands import VOICE_UTTERANCES, Anchor, Append, Audio, Begin, Cancel, Command, End
from fapengine.live.engine.session import JUMP_S
from fapengine.live.protocol import labels, schema
from fapengine.live.protocol.clock import SenderClock
from fapengine.live.protocol.counts import Tally
from fapengine.live.protocol.faces import Faces
from fapengine.live.protocol.incoming import ACK_S, MOST_NACKS, MOST_UNBEGUN, NACK_AGAIN_S, UNBEGUN_S, Incoming
from fapengine.speech.phone_track import Phone

AGAIN_S = 2.0
"""A begin of an utterance that was over for so long is no repeat."""
CANCEL_REPEAT_S = 0.25
FOLLOW_S = 1.0
"""How often an utterance at a time of the sender's clock is compared with it."""
FOLLOW_ERROR_S = 0.003
HEARD_S = 2.0
"""So long the sender's word about its sound counts more than its clock."""
REMEMBERED_S = 20.0
"""An utterance that is over is remembered for so long, in which repeats of it may still come: senders repeat for 15."""
FADES_MS = (10, 10_000)
MOST_PEERS = 8
"""Of one session, that hear of it; the first ones are forgotten."""
INT32 = 2**31 - 1

Send = Callable[[Hashable, schema.FromEngine], None]
"""Answers a peer."""


@dataclass(slots=True, eq=False)
class WireSession:
    """Stateful: what senders told a session, and what they are still to be answered."""

    name: str
    faces: Faces
    most_utterances: int
    most_phones: int
    """Of an utterance: as many as the engine takes."""
    numbers: Iterator[int]
    """Engine's numbers of new utterances."""
    phone_set: str = "ipa"
    instance: int = 0
    peers: dict[Hashable, int] = field(default_factory=dict)
    """Who joined, with the flags of its hello."""
    utterances: dict[int, Incoming] = field(default_factory=dict)
    """By the sender's number, the latest last."""
    busy: dict[int, Hashable] = field(default_factory=dict)
    """Utterances for which something is due, and whom to tell."""
    _wire: dict[int, int] = field(default_factory=dict)
    """Engine's number to the sender's."""
    _cancelled_below: int = -INT32
    """Lower ones were cancelled, known or not."""
    _cancels: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Cancels to when they came."""

    def new_number(self) -> int:
        """Give the engine's number of a new utterance."""
        return next(self.numbers)

    def join(self, peer: Hashable, hello: schema.Hello, now_s: float) -> bool:
        """Take a sender in; whether it is another one than before, so that what was begun is cancelled."""
        self.peers[peer] = hello.flags
        while len(self.peers) > MOST_PEERS:
            del self.peers[next(iter(self.peers))]
        known = labels.phone_set_named(hello.phone_set)
        if known and hello.phone_set:
            self.phone_set = known
        is_other = hello.instance != self.instance and bool(hello.instance and self.instance)
        self.instance = hello.instance or self.instance
        if is_other:
            self.peers = {peer: hello.flags}
            for one in self.utterances.values():
                if not one.is_stopped:
                    self.tell(Cancel(one.number), now_s)
        if is_other or all(one.is_over for one in self.utterances.values()):
            self.forget()
        return is_other

    def forget(self) -> None:
        """Know of no utterance: the sender's numbers may begin again."""
        self.utterances.clear()
        self._wire.clear()
        self.busy.clear()
        self._cancelled_below = -INT32
        self._cancels.clear()

    def tell(self, command: Command, now_s: float) -> None:
        """Tell the engine."""
        self.faces.apply(self.name, command, now_s)

    def begin(
        self, message: schema.BeginUtterance, clock: SenderClock, peer: Hashable, now_s: float, tally: Tally
    ) -> bool:
        """Open an utterance; False if the engine has no place for it."""
        if message.anchor not in ("now", "at", "audio"):
            tally.add("malformed")
            return True
        one = self.utterances.get(message.utterance)
        if one is not None and one.is_over and now_s - one.over_s > AGAIN_S:
            del self.utterances[message.utterance]
        elif message.utterance < self._cancelled_below and one is None:
            tally.add("repeated")
            return True
        self._forget_old(now_s)
        one = self._incoming(message.utterance)
        if one.is_over or (one.begun is not None and message.revision <= one.revision):
            tally.add("repeated")
            return True
        phone_set = labels.phone_set_named(message.phone_set) if message.phone_set else self.phone_set
        if phone_set is None:
            tally.add("refused")
            phone_set = self.phone_set
        one.begin(message, phone_set)
        self._tell_begin(one, message, clock, now_s)
        if self.faces.utterance(self.name, one.number) is None:
            one.over_s = now_s
            return False
        self.busy.setdefault(message.utterance, peer)
        for run in _runs(one.phones):  # they overtook it, and may have been read in another phone set
            self._tell_phones(one, run[0], [one.phones[index] for index in run], now_s)
        self._tell_end(one, now_s)
        return True

    def _tell_begin(self, one: Incoming, message: schema.BeginUtterance, clock: SenderClock, now_s: float) -> None:
        if message.anchor == "at" and clock.is_known:
            at_s = clock.engine_s(message.anchor_us / 1e6)
            self.tell(Begin(one.number, "at", at_s, message.revision), now_s)
            one.follow_s, one.clock_steps = max(at_s, now_s) + FOLLOW_S, clock.steps
        else:  # without a common clock "at" can only mean now
            anchor: Anchor = "audio" if message.anchor == "audio" else "now"
            self.tell(Begin(one.number, anchor, 0.0, message.revision), now_s)

    def phones(self, message: schema.Phones, peer: Hashable, now_s: float, tally: Tally) -> None:
        """Take phones in."""
        if message.first_index + len(message.phones) > self.most_phones:
            tally.add("refused")
            return
        one = self._find(message.utterance)
        if one is None or one.is_cancelled:
            tally.add("repeated")
            return
        tally.add("lost", one.lost(message.sequence))
        if not one.is_over:
            if not one.take(message):
                tally.add("repeated")
            elif one.begun is None:  # before the begin the phone set is not known; they are told then
                one.unbegun_s = min(one.unbegun_s, now_s + UNBEGUN_S)
            else:
                self._tell_phones(one, message.first_index, message.phones, now_s)
            self._check(one, message.utterance, now_s, tally)
        self._due_ack(message.utterance, one, peer, now_s)

    def end(self, message: schema.EndUtterance, peer: Hashable, now_s: float, tally: Tally) -> None:
        """Learn that an utterance is whole."""
        if not 0 <= message.phone_count <= self.most_phones:
            tally.add("refused")
            return
        one = self._find(message.utterance)
        if one is None or one.is_cancelled:
            tally.add("repeated")
            return
        if not one.is_over and one.finish(message):
            self._tell_end(one, now_s)
            self._check(one, message.utterance, now_s, tally)
        else:
            tally.add("repeated")
        self._due_ack(message.utterance, one, peer, now_s)

    def cancel(self, message: schema.CancelUtterance, now_s: float, tally: Tally) -> list[int]:
        """Stop speaking; returns what can be answered at once: -1 for all, or one that is over or never began."""
        fade_s = min(max(message.fade_ms, FADES_MS[0]), FADES_MS[1]) / 1e3
        if message.utterance != schema.NOW:
            one = self._find(message.utterance)
            if one is None or one.is_stopped:
                tally.add("repeated")
                return [message.utterance]
            self._cancel(one, message.at_us, fade_s, now_s)
            return [message.utterance] if one.is_over else []
        if self._is_repeat(message, now_s):
            tally.add("repeated")
            return [schema.NOW]
        self._cancelled_below = max(self._cancelled_below, message.below)
        everyone = message.below < 0
        for wire, one in self.utterances.items():
            if not one.is_stopped and (everyone or wire < message.below):
                self._cancel(one, message.at_us, fade_s, now_s)
        if message.at_us < 0:  # what the server's voice says, too, and with everyone what the simple mode does
            self.tell(Cancel(None, None, fade_s, 0 if everyone else VOICE_UTTERANCES), now_s)
        return [schema.NOW]

    def _is_repeat(self, message: schema.CancelUtterance, now_s: float) -> bool:
        key = (message.at_us, message.fade_ms, message.below, message.number)
        came_s = self._cancels.get(key, -inf)
        if now_s - came_s < (AGAIN_S if message.number else CANCEL_REPEAT_S):
            return True
        self._cancels[key] = now_s
        while len(self._cancels) > self.most_utterances:
            del self._cancels[next(iter(self._cancels))]
        return False

    def audio(self, message: schema.AudioPosition, at_s: float, now_s: float, tally: Tally) -> None:
        """Follow the sound; ``at_s`` is the engine's time that the message means."""
        one = self._find(message.utterance)
        if one is None or one.is_over:
            tally.add("repeated")
            return
        one.heard_s = now_s
        rate = min(max(message.rate, 0.0), 4.0)
        self.tell(Audio(one.number, at_s, message.position_us / 1e6, rate), now_s)

    def let_go(self) -> None:
        """Follow no clock any more: the sender has moved what is said by hand."""
        for one in self.utterances.values():
            one.follow_s = inf

    def over(self, number: int, is_cancelled: bool, now_s: float) -> int | None:
        """Learn that the engine is through with an utterance; returns the sender's number."""
        wire = self._wire.pop(number, None)
        one = self.utterances.get(wire) if wire is not None else None
        if one is None or wire is None or one.number != number:
            return None
        one.over_s, one.is_cancelled = now_s, one.is_cancelled or is_cancelled
        one.forget_phones()
        one.nack_s = one.follow_s = inf
        return wire

    def wire_number(self, number: int) -> int | None:
        """Sender's number of an utterance of the engine."""
        return self._wire.get(number)

    def tick(
        self,
        clock_of: Callable[[Hashable], SenderClock | None],
        send: Send,
        now_s: float,
        is_behind: Callable[[Hashable], bool],
    ) -> None:
        """Acknowledge, ask, and compare, as far as it is due; what may wait unread is not asked for."""
        for wire, peer in list(self.busy.items()):
            one = self.utterances.get(wire)
            if one is None:
                del self.busy[wire]
                continue
            if one.due_s > now_s:
                if one.due_s == inf:
                    del self.busy[wire]
                continue
            if one.follow_s <= now_s:
                self._follow(one, clock_of(peer), now_s)
            if one.unbegun_s <= now_s:
                one.unbegun_s = now_s + UNBEGUN_S
                one.unbegun += 1
                if one.unbegun > MOST_UNBEGUN or peer not in self.peers:  # nobody there, or who is not to be answered
                    self._forget_one(wire)
                    continue
                send(peer, self._notice(wire, "unknown", now_s, "no begin"))
            if one.ack_s <= now_s:
                one.ack_s = inf
                send(peer, self._ack(wire, one, now_s))
                if one.has_error:
                    send(peer, self._notice(wire, "error", now_s, "checksum"))
            if one.nack_s <= now_s and is_behind(peer):
                one.nack_s = now_s + NACK_AGAIN_S
            if one.nack_s <= now_s:
                one.nacks += 1
                one.nack_s = now_s + NACK_AGAIN_S
                for first, stop in one.missing()[:8]:
                    send(peer, schema.Nack(self.name, wire, first, stop))
                if one.nacks >= MOST_NACKS:
                    one.nack_s = inf

    def _incoming(self, wire: int) -> Incoming:
        one = self.utterances.get(wire)
        if one is None:
            one = self.utterances[wire] = Incoming(self.new_number(), self.phone_set)
            self._wire[one.number] = wire
            while len(self.utterances) > self.most_utterances:
                self._forget_one(next(iter(self.utterances)))
        return one

    def _forget_old(self, now_s: float) -> None:
        """Forget those that were over long ago, the oldest first."""
        for wire, one in list(self.utterances.items()):
            if now_s - one.over_s <= REMEMBERED_S:
                break
            self._forget_one(wire)

    def _forget_one(self, wire: int) -> None:
        self._wire.pop(self.utterances.pop(wire).number, None)
        self.busy.pop(wire, None)

    def _find(self, wire: int) -> Incoming | None:
        """Find an utterance, or make it known: phones may overtake its begin. None: it was cancelled unseen."""
        if wire < self._cancelled_below and wire not in self.utterances:
            return None
        return self._incoming(wire)

    def _tell_phones(self, one: Incoming, first: int, phones: Sequence[schema.WirePhone], now_s: float) -> None:
        told: tuple[Phone, ...] = tuple(labels.to_engine_phone(phone, one.phone_set) for phone in phones)
        self.tell(Append(one.number, first, told, one.revision), now_s)

    def _tell_end(self, one: Incoming, now_s: float) -> None:
        if one.end is None or one.begun is None:
            return
        known_s = max((phone.start_us + phone.duration_us for phone in one.phones.values()), default=0) / 1e6
        duration_s = max(one.end.duration_us / 1e6, known_s) if one.end.duration_us >= 0 else known_s
        self.tell(End(one.number, one.end.phone_count, duration_s, one.revision), now_s)

    def _check(self, one: Incoming, wire: int, now_s: float, tally: Tally) -> None:
        one.watch(now_s)
        if one.is_whole and not one.has_error and not one.is_sound():
            one.has_error = True
            tally.add("checksums")

    def _due_ack(self, wire: int, one: Incoming, peer: Hashable, now_s: float) -> None:
        if self.peers.get(peer, 0) & schema.WANT_ACK:
            one.ack_s = min(one.ack_s, now_s + ACK_S)
        else:
            one.nack_s = inf  # who does not listen is not asked
        self.busy[wire] = peer

    def _ack(self, wire: int, one: Incoming, now_s: float) -> schema.Ack:
        known = self.faces.utterance(self.name, one.number) if not one.is_over else None
        slack_s = known.slack_s(now_s) if known is not None and known.phones else 0.0
        slack_us = int(min(max(slack_s * 1e6, -INT32), INT32))
        ended = int(one.end is not None)
        return schema.Ack(self.name, wire, one.next_index, one.bitmap64, slack_us, ended, one.revision)

    def _notice(self, wire: int, kind: str, now_s: float, reason: str) -> schema.Notice:
        return schema.Notice(self.name, wire, kind, engine_us=microseconds(now_s), reason=reason)

    def _cancel(self, one: Incoming, at_us: int, fade_s: float, now_s: float) -> None:
        at_s = None
        if at_us >= 0:
            known = self.faces.utterance(self.name, one.number)
            if known is not None and known.anchored:
                at_s = now_s + at_us / 1e6 - known.position_s(now_s)
        if one.begun is None:
            one.over_s, one.is_cancelled = now_s, True  # its begin is still to come, and too late
            return
        one.is_cancelled = at_s is None
        self.tell(Cancel(one.number, at_s, fade_s), now_s)

    def _follow(self, one: Incoming, clock: SenderClock | None, now_s: float) -> None:
        """Keep an utterance that was begun at a time of the sender's clock at it, though the clocks drift."""
        one.follow_s = now_s + FOLLOW_S
        known = self.faces.utterance(self.name, one.number)
        if known is None or one.begun is None or clock is None or clock.steps != one.clock_steps:
            one.follow_s = inf
            return
        if now_s - one.heard_s < HEARD_S or known.position_s(now_s) < 0:
            return
        heard_s = clock.sender_s(now_s) - one.begun.anchor_us / 1e6
        if FOLLOW_ERROR_S < abs(heard_s - known.position_s(now_s)) < JUMP_S:
            self.tell(Audio(one.number, now_s, heard_s), now_s)


def microseconds(time_s: float) -> int:
    """Round to whole microseconds."""
    return round(time_s * 1e6)


def check_open(faces: Faces, session: str, now_s: float) -> bool:
    """Open a session if it is not; whether it is open now."""
    if session in faces:
        return True
    try:
        faces.open(session, now_s)
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
