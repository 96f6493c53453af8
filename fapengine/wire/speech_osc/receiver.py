"""OSC in: packets of both modes become commands, and senders get answers. Sockets and clocks are the caller's.

Theory of operation
-------------------
:meth:`OscReceiver.receive` takes one packet and the time of its arrival, applies it in the engine at once, and returns
the answers. :meth:`OscReceiver.tick`, called about once per frame, returns what has become due since: selective
acknowledgements of what came within 20 ms, requests for missing phones, events. Nothing waits, and no input of a sender
raises an error: bad input is counted.

A session has a name and is not bound to an address, so one can be driven over TCP and UDP at once. Its first message
opens it, or ``hello``. Only senders that said hello receive events; others get answers to their own messages only. A
sender that said hello is remembered when the session is closed by others or for being idle. The simple mode has no
session names; it drives :data:`SIMPLE_SESSION`.
"""

import heapq
import hmac
from collections import OrderedDict
from collections.abc import Callable, Hashable
from itertools import chain, count

from fapengine.engine.command_table import shifted
from fapengine.engine.commands import VOICE_UTTERANCES, Cancel, Pause, Resume, without_neutral
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event, Limits
from fapengine.errors import DataError, UsageError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, one_shot, phone_labels, schema
from fapengine.wire.speech_osc.clock import SenderClock
from fapengine.wire.speech_osc.peers import (
    AMPLIFICATION,
    Arrival,
    Peer,
    Proof,
    Replies,
    SoundRequest,
    TextRequest,
    WireCounts,
    WireLimits,
    WordsRequest,
)
from fapengine.wire.speech_osc.session import WireSession

SIMPLE_SESSION = "face"
MAX_PEERS = 8
"""Peers of one session that receive its events; one more replaces a silent one, or is refused."""
LOOKAHEAD_US = 500_000
"""Phones known this long before they sound look best (:class:`fapengine.trajectory.stream.StreamingPlanner`)."""
ALIVE_S, SILENT_S = 3.0, 10.0
"""Time since its last packet for which another sender cannot silence a sender; and for which it keeps its place."""
REPEATED_EVENTS = ("started", "finished", "cancelled", "error")
REPEATS_S = (0.06, 0.4)
"""Events that are sent three times over UDP, and when: the second survives a loss, the third a burst of losses."""


class OscReceiver:
    """The receiving end of all sessions; see the theory of operation.

    Stateful.

    Parameters
    ----------
    engine : Engine
    token : str, optional
        A ``hello`` must contain it.
    limits : WireLimits, optional
    engine_limits : Limits, optional
        For the answer to a ``hello``.
    instance : int
        An int32, different for each run of the server: senders then know that they must begin again.
    proof : Proof, optional
        How peers prove their addresses; by default all are believed.
    elsewhere : callable, optional
        Session to the port of this host that serves it, or None if it is served here.

    Attributes
    ----------
    counts : WireCounts
    """

    def __init__(
        self,
        engine: Engine,
        *,
        token: str | None = None,
        limits: WireLimits | None = None,
        engine_limits: Limits | None = None,
        instance: int = 0,
        proof: Proof | None = None,
        elsewhere: Callable[[str], int | None] = lambda session: None,
    ) -> None:
        self.counts = WireCounts()
        self._proof, self._elsewhere = proof or Proof(), elsewhere
        self._engine, self._token, self._instance = engine, token, instance
        self._limits, self._engine_limits = limits or WireLimits(), engine_limits or Limits()
        self._numbers = count()
        self._simple = one_shot.SimpleMode(SIMPLE_SESSION, engine, self._numbers, self._engine_limits.queued_s)
        self._joined: OrderedDict[Hashable, Peer] = OrderedDict()
        self._strangers: OrderedDict[Hashable, Peer] = OrderedDict()
        self._sessions: dict[str, WireSession] = {}
        self._asleep: OrderedDict[str, WireSession] = OrderedDict()
        """Closed sessions, for the peers that joined them."""
        self._texts: list[TextRequest] = []
        self._words: list[WordsRequest] = []
        self._subscribers: OrderedDict[Hashable, None] = OrderedDict()
        """Simple senders that receive events."""
        self._again: list[tuple[float, int, Hashable, bytes]] = []
        """Packets to send later, as a heap: time, order, peer, packet."""
        self._order = count()

    def receive(self, packet: bytes, peer: Hashable, now_s: float, wall_s: float) -> Replies:
        """Process one datagram or TCP frame.

        Parameters
        ----------
        packet : bytes
        peer : hashable
            Its sender.
        now_s : float
            Engine time of its arrival.
        wall_s : float
            Wall clock at that time, seconds since 1970; only for time tags of bundles.

        Returns
        -------
        list of (peer, bytes)
            Packets to send, each with its receiver.
        """
        sender, counts = self._peer(peer), self.counts
        sender.heard_s = now_s
        sender.received += len(packet)
        counts.packets += 1
        counts.bytes += len(packet)
        try:
            messages = osc.parse_packet(packet) if len(packet) <= self._limits.packet else None
        except DataError:
            messages = None
        if messages is None:
            counts.malformed += 1
            return []
        replies: Replies = []
        counts.refused += max(len(messages) - self._limits.messages, 0)
        for message in messages[: self._limits.messages]:
            counts.messages += 1
            at_s = now_s
            if message.time_tag != osc.IMMEDIATELY:
                before = sender.tags.clamped
                at_s = sender.tags.engine_s(message.time_tag, now_s, wall_s)
                counts.clamped += sender.tags.clamped - before
            try:
                self._handle(message, Arrival(sender, now_s, at_s, replies, counts))
            except DataError:
                counts.malformed += 1
        return self._allowed(replies)

    def tick(self, now_s: float, is_behind: Callable[[Hashable], bool] = lambda peer: False) -> Replies:
        """Return what is due; to be called about once per frame.

        Parameters
        ----------
        now_s : float
        is_behind : callable, optional
            Whether packets of a peer wait that :meth:`receive` has not processed.
        """
        replies: Replies = []
        for event in self._engine.events():
            self._tell_event(event, replies)
        self._simple.tick(now_s)
        while self._again and self._again[0][0] <= now_s:
            replies.append(heapq.heappop(self._again)[2:])
        for name, session in list(self._sessions.items()):
            if name not in self._engine:
                self._put_to_sleep(name)
            elif session.pending:
                replies += session.tick(self._known, now_s, is_behind)
        return self._allowed(replies)

    def texts(self) -> list[TextRequest]:
        """Return the texts for the server's voice."""
        taken, self._texts = self._texts, []
        return taken

    def words(self) -> list[WordsRequest]:
        """Return the words that the server's voice must pronounce; those of one utterance are in order."""
        taken, self._words = self._words, []
        return taken

    def sounds(self, now_s: float) -> list[SoundRequest]:
        """Return the audio for the recognizer; call it about once per frame."""
        sounding = sorted(name for name, session in self._sessions.items() if session.sounding)
        return [request for name in sounding for request in self._sessions[name].sounds(now_s)]

    def refuse_sound(self, request: SoundRequest, reason: str, now_s: float) -> None:
        """Notify a session's senders, with the next :meth:`tick`, why the audio of an utterance is not recognized."""
        session = self._sessions.get(request.session)
        number = session.sender_numbers.get(request.utterance) if session is not None else None
        if session is None or number is None:
            return
        self.counts.refused += 1
        notice = schema.Notice(request.session, number, "error", engine_us=round(now_s * 1e6), reason=reason)
        for peer in session.peers:
            heapq.heappush(self._again, (now_s, next(self._order), peer, codec.encode(notice)))

    def forget(self, peer: Hashable) -> None:
        """Remove a peer whose connection is closed. Its phones are still spoken."""
        if self._joined.pop(peer, None) is not None:
            for session in chain(self._sessions.values(), self._asleep.values()):
                session.peers.pop(peer, None)
        self._strangers.pop(peer, None)
        self._subscribers.pop(peer, None)

    def _peer(self, name: Hashable) -> Peer:
        """Return a peer as the latest one heard; a new one takes the place of the longest silent stranger."""
        peers = self._joined if name in self._joined else self._strangers
        if name not in peers:
            peers[name] = Peer(name, self._token is None, self._proof.is_sure_of(name))
            if len(peers) > self._limits.peers:
                peers.popitem(last=False)
        peers.move_to_end(name)
        return peers[name]

    def _known(self, name: Hashable) -> Peer | None:
        return self._joined.get(name) or self._strangers.get(name)

    def _allowed(self, replies: Replies) -> Replies:
        """Drop what exceeds the limit of an address that is not proved."""
        allowed: Replies = []
        for name, packet in replies:
            peer = self._known(name)
            if peer is not None and not peer.is_proved:
                if peer.sent + len(packet) > AMPLIFICATION * peer.received:
                    self.counts.unproved += 1
                    continue
                peer.sent += len(packet)
            allowed.append((name, packet))
        return allowed

    def _handle(self, message: osc.Message, arrival: Arrival) -> None:
        kind = schema.from_sender().get(message.address)
        if kind is None and (kind := one_shot.nameless().get(message.address)) is not None:
            arguments = (self._simple.session, *message.arguments)
            message = osc.Message(message.address, "s" + message.tags, arguments)
        elif kind is None and message.address not in one_shot.ADDRESSES:
            self.counts.unknown += 1
            return
        if not arrival.peer.is_trusted and kind not in (schema.Hello, schema.Ping):
            self.counts.refused += 1
        elif message.address == one_shot.EVENTS:
            self._subscribers.pop(arrival.peer.name, None)
            if not message.arguments or message.arguments[0]:
                self._subscribers[arrival.peer.name] = None
                if len(self._subscribers) > MAX_PEERS:
                    self._subscribers.popitem(last=False)
        elif kind is None:
            session = self._session(self._simple.session, arrival)
            if session is not None and self._simple.obey(message, arrival):
                session.tell(Cancel(first=VOICE_UTTERANCES), arrival.now_s)
                self._forget_texts(session.name)
        else:
            self.counts.surplus += codec.surplus(kind, message)
            self._obey(codec.parse(kind, message), arrival)

    # Robust mode ----------------------------------------------------------------------------------------------------

    def _obey(self, wire: schema.Wire, arrival: Arrival) -> None:
        match wire:
            case schema.Hello():
                return self._hello(wire, arrival)
            case schema.Ping():
                return self._ping(wire, arrival)
            case schema.Bye():
                return self._bye(wire, arrival)
            case schema.AudioPosition():
                return self._audio(wire, arrival)
            case schema.SpeakText(session=name, text=text):
                if len(text.encode()) > schema.TEXT_BYTES or len(self._texts) >= self._limits.texts:
                    return arrival.refuse(name, "text")
                if text.strip() and self._session(name, arrival) is not None:
                    self._texts.append(TextRequest(name, text, wire.voice, arrival.peer.name))
                return None
        assert isinstance(wire, schema.OfSession)
        session, request = self._session(wire.session, arrival), None
        if session is None:
            return None
        match wire:
            case schema.Phones():
                session.phones(wire, arrival)
            case schema.BeginUtterance():
                session.begin(wire, arrival)
            case schema.EndUtterance():
                request = session.end(wire, arrival)
            case schema.WordTimes():
                if len(self._words) >= self._limits.texts:
                    return arrival.refuse(wire.session, "words", wire.utterance)
                request = session.words(wire, arrival)
            case schema.Sound():
                session.sound(wire, arrival)
            case schema.CancelUtterance():
                if wire.utterance == schema.NOW and wire.at_us < 0:
                    self._forget_texts(wire.session)
                session.cancel(wire, arrival)
            case schema.SeekUtterance():
                session.seek(wire, arrival.now_s)
            case schema.SessionCommand():
                command = shifted(wire.command, arrival.now_s)
                if isinstance(command, Pause | Resume):
                    session.move(command, arrival.now_s)
                else:
                    for each in without_neutral(command):
                        session.tell(each, arrival.now_s)
        if request is not None:
            self._words.append(request)
        return None

    def _hello(self, wire: schema.Hello, arrival: Arrival) -> None:
        peer, now_s, name = arrival.peer, arrival.now_s, wire.session
        if self._token is not None and not hmac.compare_digest(wire.token.encode(), self._token.encode()):
            return arrival.refuse(name, "token")
        if wire.protocol != schema.PROTOCOL:
            return arrival.refuse(name, f"protocol {schema.PROTOCOL}")
        if wire.phone_set and phone_labels.phone_set_named(wire.phone_set) is None:
            return arrival.refuse(name, "phone set")
        if (port := self._elsewhere(name)) is not None:
            self.counts.moved += 1
            return arrival.answer(schema.Moved(name, "", port, wire.instance))
        session = self._session(name, arrival)
        if session is None:
            return None
        peer.is_proved |= wire.cookie != 0 and wire.cookie == self._proof.cookie_of(peer.name)
        is_new_sender = wire.instance != session.instance and bool(wire.instance and session.instance)
        if is_new_sender and not self._may_take_over(session, peer, now_s):
            return arrival.refuse(name, "another sender speaks")
        if peer.name not in session.peers and len(session.peers) >= MAX_PEERS:
            silent = next((other for other in session.peers if not self._was_heard(other, now_s, SILENT_S)), None)
            if silent is None:
                return arrival.refuse(name, "listeners")
            del session.peers[silent]
        peer.is_trusted = True
        if self._strangers.pop(peer.name, None) is not None:
            self._joined[peer.name] = peer
            if len(self._joined) > self._limits.peers:
                self.forget(next(iter(self._joined)))
        session.join(peer.name, wire, is_new_sender=is_new_sender, now_s=now_s)
        if is_new_sender:
            self.counts.resets += 1
            peer.clock = SenderClock()
        if name == self._simple.session:
            peer.phone_set = wire.phone_set
        cookie = 0 if peer.is_proved else self._proof.cookie_of(peer.name)
        return arrival.answer(
            schema.Welcome(
                name, round(now_s * 1e6), LOOKAHEAD_US, schema.MAX_DATAGRAM, self._engine_limits.utterances,
                self._instance, cookie,
            )
        )  # fmt: skip

    def _may_take_over(self, session: WireSession, peer: Peer, now_s: float) -> bool:
        """Whether a new sender may cancel what a session's senders have begun.

        It may if it knows the token, if none of them was heard recently, or if it is on the host of one that was.
        """
        alive = [name for name in session.peers if name != peer.name and self._was_heard(name, now_s, ALIVE_S)]
        hosts = map(self._proof.host_of, alive)
        return self._token is not None or not alive or (peer.is_proved and self._proof.host_of(peer.name) in hosts)

    def _was_heard(self, name: Hashable, now_s: float, within_s: float) -> bool:
        peer = self._joined.get(name)
        return peer is not None and now_s - peer.heard_s < within_s

    def _bye(self, wire: schema.Bye, arrival: Arrival) -> None:
        session, leaver = self._sessions.get(wire.session), arrival.peer.name
        if session is None or wire.session not in self._engine:
            self.counts.repeated += 1
            return
        listeners = list(session.peers)
        had_joined = session.peers.pop(leaver, None) is not None
        self.counts.repeated += not had_joined and not session.windows
        session.tell(Cancel(), arrival.now_s)
        self._forget_texts(wire.session)
        for event in self._engine.events():
            self._tell_event(event, arrival.replies)
        session.forget()
        now_us = round(arrival.now_s * 1e6)
        notice = codec.encode(schema.Notice(wire.session, -1, "cancelled", engine_us=now_us, reason="bye"))
        arrival.replies.extend((peer, notice) for peer in listeners)

    def _ping(self, wire: schema.Ping, arrival: Arrival) -> None:
        clock, now_us = arrival.peer.clock, round(arrival.now_s * 1e6)
        before = clock.steps
        if wire.rtt_us >= 0:
            clock.report(wire.sent_us / 1e6, wire.offset_us / 1e6, wire.skew_ppm)
        else:
            clock.ping(wire.sent_us / 1e6, arrival.now_s)
        self.counts.clock_steps += clock.steps - before
        arrival.answer(schema.Pong(wire.number, wire.sent_us, now_us, now_us, self._instance))

    def _audio(self, wire: schema.AudioPosition, arrival: Arrival) -> None:
        session, clock = self._sessions.get(wire.session), arrival.peer.clock
        if session is None or wire.utterance not in session.windows:
            arrival.notify_unknown(wire.session, wire.utterance)
            return
        before = clock.steps
        at_s = clock.audio(wire.sender_us / 1e6, arrival.now_s)
        self.counts.clock_steps += clock.steps - before
        if at_s is None:
            self.counts.odd_times += 1
        else:
            session.audio(wire, at_s, arrival.now_s)

    def _forget_texts(self, session: str) -> None:
        """Drop the texts of a session that the voice has not taken yet."""
        self._texts = [request for request in self._texts if request.session != session]

    def _session(self, name: str, arrival: Arrival) -> WireSession | None:
        """Find or open a session; None if it is served elsewhere, or there are too many."""
        if self._elsewhere(name) is not None:
            arrival.notify_unknown(name, schema.NOW)
            return None
        try:
            if name not in self._engine:
                self._engine.open(name, arrival.now_s)
        except UsageError:
            arrival.refuse(name, "sessions")
            return None
        if name not in self._sessions:
            most, phones = self._limits.utterances, self._engine_limits.phones
            fresh = WireSession(name, self._engine, most, phones, self._numbers, self.counts)
            self._sessions[name] = self._asleep.pop(name, fresh)
        return self._sessions[name]

    def _put_to_sleep(self, name: str) -> None:
        """Remember who joined a session that was closed."""
        session = self._sessions.pop(name)
        if not session.peers:
            return
        session.forget()
        self._asleep[name] = session
        if len(self._asleep) > self._limits.peers:
            self._asleep.popitem(last=False)

    def _tell_event(self, event: Event, replies: Replies) -> None:
        if self._subscribers and event.session == self._simple.session:
            packet = one_shot.event_packet(event)
            replies.extend((peer, packet) for peer in self._subscribers)
        session = self._sessions.get(event.session)
        if session is None:
            return
        if event.kind in ("finished", "cancelled", "error"):
            number = session.close_window(event.utterance, event.kind == "cancelled", event.time_s)
        else:
            number = session.sender_numbers.get(event.utterance)
        if number is None:  # of the simple mode, or of the server's voice
            return
        position_us = min(max(round(event.position_s * 1e6), -(2**31)), 2**31 - 1)
        time_us = round(event.time_s * 1e6)
        packet = codec.encode(
            schema.Notice(event.session, number, event.kind, position_us, event.count, time_us, event.reason)
        )
        for peer, flags in session.peers.items():
            replies.append((peer, packet))
            if event.kind in REPEATED_EVENTS and not flags & schema.TCP:
                for later_s in REPEATS_S:
                    heapq.heappush(self._again, (event.time_s + later_s, next(self._order), peer, packet))
