"""OSC in: packets of both modes to commands, and what senders are answered. Sockets and clocks are the caller's.

Theory of operation
-------------------
:meth:`OscReceiver.receive` takes one packet and the time of its arrival, tells the engine at once, and returns what is
to be sent back; :meth:`OscReceiver.tick`, called about once a frame, returns what has become due meanwhile: selective
acknowledgements of what came within 20 ms, requests for what is missing, events. Nothing waits and nothing raises for
what others send: it is counted, for each peer and in all.

Sessions are known by name, not by where they are told from, so that one may be driven over TCP and UDP at once. A
session is opened by its first message, or by ``hello``, which alone lets its sender be told what becomes of it; others
are answered only what they ask, or what is refused. Whoever said hello is answered still when the session was closed by
others, or for being idle, and is opened again. The simple mode has no names; it drives :data:`SIMPLE_SESSION`.
"""

import heapq
import hmac
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from itertools import chain, count
from typing import Any, cast

from fapengine.engine.command_table import Command, shifted
from fapengine.engine.commands import VOICE_UTTERANCES, Cancel, Pause, Resume, Seek, without_neutral
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event, Limits
from fapengine.errors import DataError, UsageError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec as wire_format
from fapengine.wire.speech_osc import phone_labels, schema
from fapengine.wire.speech_osc.clock import SenderClock
from fapengine.wire.speech_osc.counts import (
    PeerCounts,
    SoundRequest,
    Tally,
    TextRequest,
    WireLimits,
    WordsRequest,
)
from fapengine.wire.speech_osc.one_shot_messages import EVENTS, SimpleMode, event_packet
from fapengine.wire.speech_osc.peers import Arrival, Peer, Replies
from fapengine.wire.speech_osc.proof import AMPLIFICATION, Proof
from fapengine.wire.speech_osc.session import MAX_PEERS, WireSession, check_open, microseconds

SIMPLE_SESSION = "face"
LOOKAHEAD_S = 0.5
"""Phones that are known so early are as good as all (:class:`fapengine.trajectory.stream.StreamingPlanner`)."""


ALIVE_S, SILENT_S = 3.0, 10.0
"""Time since a sender's last packet for which nobody else silences it; and for which it keeps its place."""
TOLD_AGAIN = ("started", "finished", "cancelled", "error")
TOLD_AGAIN_S = (0.06, 0.4)
"""Notices that are sent three times over UDP, and when: the second survives a loss, the third a burst."""


class OscReceiver:
    """The receiver's end of all sessions; see the theory of operation.

    Stateful.

    Parameters
    ----------
    engine : Engine
    token : str, optional
        What a ``hello`` must hold for its sender to be heard.
    limits : WireLimits, optional
    engine_limits : Limits, optional
        For the answer to a ``hello``.
    instance : int
        An int32 that another run of the server does not have: senders see by it that they must begin again.
    simple_session : str
        The session that the simple mode drives.
    proof : Proof, optional
        How peers show that they are where their packets say; by default all are believed.
    elsewhere : callable, optional
        Port of this host at which to ask for a session that may not be opened here; None: it may.

    Attributes
    ----------
    counts : PeerCounts
        Of all peers.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        token: str | None = None,
        limits: WireLimits | None = None,
        engine_limits: Limits | None = None,
        instance: int = 0,
        simple_session: str = SIMPLE_SESSION,
        proof: Proof | None = None,
        elsewhere: Callable[[str], int | None] = lambda session: None,
    ) -> None:
        self.counts = PeerCounts()
        self._proof, self._elsewhere = proof or Proof(), elsewhere
        self._engine, self._token, self._instance = engine, token, instance
        self._limits, self._engine_limits = limits or WireLimits(), engine_limits or Limits()
        self._simple = SimpleMode(schema.check_session(simple_session), engine, self._engine_limits.queued_s)
        self._joined: OrderedDict[Hashable, Peer] = OrderedDict()
        self._strangers: OrderedDict[Hashable, Peer] = OrderedDict()
        self._sessions: dict[str, WireSession] = {}
        self._asleep: OrderedDict[str, WireSession] = OrderedDict()
        self._numbers = count()
        self._texts: deque[TextRequest] = deque()
        self._words: deque[WordsRequest] = deque()
        self._asking: OrderedDict[Hashable, None] = OrderedDict()
        """Simple senders that are told of events."""
        self._sounding: set[str] = set()
        """Names of sessions whose sound may be released."""
        self._again: list[tuple[float, int, Hashable, bytes]] = []
        self._order = 0

    @property
    def peers(self) -> dict[Hashable, PeerCounts]:
        """Counts of each peer that is remembered."""
        return {name: peer.tally.peer for peers in (self._strangers, self._joined) for name, peer in peers.items()}

    def receive(self, packet: bytes, peer: Hashable, now_s: float, wall_s: float) -> Replies:
        """Take one datagram or TCP frame.

        Parameters
        ----------
        packet : bytes
        peer : hashable
            Whom to answer.
        now_s : float
            Engine time of its arrival.
        wall_s : float
            Wall clock then, seconds since 1970; only for time tags of bundles.

        Returns
        -------
        list of (peer, bytes)
            Packets to be sent, each with whom to.
        """
        sender = self._peer(peer)
        sender.heard_s = now_s
        tally = sender.tally
        tally.add("packets")
        tally.add("bytes", len(packet))
        if len(packet) > self._limits.packet:
            tally.add("malformed")
            return []
        try:
            messages = osc.parse_packet(packet)
        except DataError:
            tally.add("malformed")
            return []
        replies: Replies = []
        tally.add("refused", max(len(messages) - self._limits.messages, 0))
        for message in messages[: self._limits.messages]:
            tally.add("messages")
            at_s = now_s
            if message.time_tag != osc.IMMEDIATELY:
                before = sender.tags.clamped
                at_s = sender.tags.engine_s(message.time_tag, now_s, wall_s)
                tally.add("clamped", sender.tags.clamped - before)
            self._handle(message, Arrival(sender, now_s, at_s, replies))
        return self._allowed(replies)

    def tick(self, now_s: float, is_behind: Callable[[Hashable], bool] = lambda peer: False) -> Replies:
        """Do what is due; to be called about once a frame.

        Parameters
        ----------
        now_s : float
        is_behind : callable, optional
            Whether packets of a peer have come that were not yet given to :meth:`receive`.
        """
        replies: Replies = []
        for event in self._engine.events():
            self._tell_event(event, replies)
        self._simple.tick(now_s)
        while self._again and self._again[0][0] <= now_s:
            replies.append(heapq.heappop(self._again)[2:])

        def send(peer: Hashable, wire: schema.FromEngine) -> None:
            replies.append((peer, wire_format.encode(wire)))

        for name, session in list(self._sessions.items()):
            if name not in self._engine:
                self._put_to_sleep(name)
            elif session.pending:
                session.tick(self._clock_of, send, now_s, is_behind)
        return self._allowed(replies)

    def texts(self) -> list[TextRequest]:
        """Take the texts that senders want spoken."""
        taken = list(self._texts)
        self._texts.clear()
        return taken

    def words(self) -> list[WordsRequest]:
        """Take the words whose phones senders want found; those of one utterance are to be told in their order."""
        taken = list(self._words)
        self._words.clear()
        return taken

    def sounds(self, now_s: float) -> list[SoundRequest]:
        """Take the sound that senders want heard; to be called about once a frame."""
        tally = Tally(PeerCounts(), self.counts)
        requests: list[SoundRequest] = []
        for name in sorted(self._sounding):
            session = self._sessions.get(name)
            if session is not None:
                requests += session.sounds(now_s, tally)
            if session is None or not session.sounding:
                self._sounding.discard(name)
        return requests

    def refuse_sound(self, request: SoundRequest, reason: str, now_s: float) -> None:
        """Tell a session's senders, with the next :meth:`tick`, why an utterance's sound is not heard."""
        session = self._sessions.get(request.session)
        number = session.sender_number(request.utterance) if session is not None else None
        if session is None or number is None:
            return
        self.counts.refused += 1
        notice = schema.Notice(request.session, number, "error", engine_us=microseconds(now_s), reason=reason)
        for peer in session.peers:
            self._order += 1
            heapq.heappush(self._again, (now_s, self._order, peer, wire_format.encode(notice)))

    def forget(self, peer: Hashable) -> None:
        """Drop a peer whose connection is closed. What it had begun is said as far as it came."""
        if self._joined.pop(peer, None) is not None:
            for session in chain(self._sessions.values(), self._asleep.values()):
                session.peers.pop(peer, None)
        self._strangers.pop(peer, None)
        self._asking.pop(peer, None)

    def _peer(self, name: Hashable) -> Peer:
        peer = self._joined.get(name)
        if peer is not None:
            self._joined.move_to_end(name)
            return peer
        peer = self._strangers.get(name)
        if peer is None:
            peer = self._strangers[name] = Peer(
                name, Tally(PeerCounts(), self.counts), self._token is None, is_proved=self._proof.is_sure_of(name)
            )
            if len(self._strangers) > self._limits.peers:
                self._strangers.popitem(last=False)
        else:
            self._strangers.move_to_end(name)
        return peer

    def _allowed(self, replies: Replies) -> Replies:
        """Leave out what is more than an address may get that nobody has proved to be the sender's."""
        allowed: Replies = []
        for name, packet in replies:
            peer = self._joined.get(name) or self._strangers.get(name)
            if peer is not None and not peer.is_proved:
                if peer.sent + len(packet) > AMPLIFICATION * peer.tally.peer.bytes:
                    peer.tally.add("unproved")
                    continue
                peer.sent += len(packet)
            allowed.append((name, packet))
        return allowed

    def _may_take_over(self, session: WireSession, peer: Peer, now_s: float) -> bool:
        """Whether a sender may silence a session by saying that it is another one, or the same begun anew.

        It may if it knows the token, if nobody was heard for a while, or if it speaks from the host of one who was.
        """
        if self._token is not None:
            return True
        others = [self._joined[name] for name in session.peers if name in self._joined and name != peer.name]
        alive = [other for other in others if now_s - other.heard_s < ALIVE_S]
        hosts = [self._proof.host_of(other.name) for other in alive]
        return not alive or (peer.is_proved and self._proof.host_of(peer.name) in hosts)

    def _clock_of(self, peer: Hashable) -> SenderClock | None:
        remembered = self._joined.get(peer) or self._strangers.get(peer)
        return remembered.clock if remembered else None

    def _handle(self, message: osc.Message, arrival: Arrival) -> None:
        tally = arrival.peer.tally
        kind = schema.from_sender().get(message.address)
        if kind is None and not self._simple.knows(message.address):
            tally.add("unknown")
            return
        if not arrival.peer.is_trusted and kind not in (schema.Hello, schema.Ping):
            tally.add("refused")
            return
        try:
            if kind is None:
                message, kind = self._simple.named(message)
            if message.address == EVENTS:
                self._ask(message, arrival)
                return
            if kind is None:
                session = self._session(self._simple.session, arrival)
                if session is not None and self._simple.obey(message, arrival, session.new_number):
                    session.tell(Cancel(first=VOICE_UTTERANCES), arrival.now_s)
                    self._forget_texts(session.name)
                return
            tally.add("surplus", wire_format.surplus(kind, message))
            self._obey(wire_format.parse(kind, message), arrival)
        except DataError:
            tally.add("malformed")

    def _ask(self, message: osc.Message, arrival: Arrival) -> None:
        """``/tts/events``: a simple sender wants to be told what becomes of its speech, or not any more."""
        self._asking.pop(arrival.peer.name, None)
        if not message.arguments or message.arguments[0]:
            self._asking[arrival.peer.name] = None
            if len(self._asking) > MAX_PEERS:
                self._asking.popitem(last=False)

    # Robust mode ----------------------------------------------------------------------------------------------------

    def _obey(self, wire: schema.Wire, arrival: Arrival) -> None:
        _OBEY[type(wire)](self, wire, arrival)

    def _hello(self, wire: schema.Hello, arrival: Arrival) -> None:
        peer, now_s = arrival.peer, arrival.now_s
        if self._token is not None and not hmac.compare_digest(wire.token.encode(), self._token.encode()):
            self._refuse(wire.session, "token", arrival)
            return
        if wire.protocol != schema.PROTOCOL:
            self._refuse(wire.session, f"protocol {schema.PROTOCOL}", arrival)
            return
        if wire.phone_set and phone_labels.phone_set_named(wire.phone_set) is None:
            self._refuse(wire.session, "phone set", arrival)
            return
        if (port := self._elsewhere(wire.session)) is not None:
            peer.tally.add("moved")
            moved = schema.Moved(wire.session, "", port, wire.instance)
            arrival.replies.append((peer.name, wire_format.encode(moved)))
            return
        session = self._session(wire.session, arrival)
        if session is None:
            return
        peer.is_proved |= wire.cookie != 0 and wire.cookie == self._proof.cookie_of(peer.name)
        if session.is_other(wire) and not self._may_take_over(session, peer, now_s):
            self._refuse(wire.session, "another sender speaks", arrival)
            return
        if not session.has_room_for(peer.name, lambda name: self._heard_of(name, now_s)):
            self._refuse(wire.session, "listeners", arrival)
            return
        peer.is_trusted = True
        if self._strangers.pop(peer.name, None) is not None:
            self._joined[peer.name] = peer
            if len(self._joined) > self._limits.peers:
                self.forget(next(iter(self._joined)))
        if session.join(peer.name, wire, now_s):
            peer.tally.add("resets")
            peer.clock = SenderClock()
        if wire.session == self._simple.session:
            peer.phone_set = wire.phone_set
        welcome = schema.Welcome(
            wire.session,
            microseconds(now_s),
            microseconds(LOOKAHEAD_S),
            schema.MAX_DATAGRAM,
            self._engine_limits.utterances,
            self._instance,
            0 if peer.is_proved else self._proof.cookie_of(peer.name),
        )
        arrival.replies.append((peer.name, wire_format.encode(welcome)))

    def _heard_of(self, name: Hashable, now_s: float) -> bool:
        """Whether a peer was heard of late; our own senders ping every 2 s."""
        peer = self._joined.get(name)
        return peer is not None and now_s - peer.heard_s < SILENT_S

    def _bye(self, wire: schema.Bye, arrival: Arrival) -> None:
        session, leaver = self._sessions.get(wire.session), arrival.peer.name
        if session is None or wire.session not in self._engine:
            arrival.peer.tally.add("repeated")
            return
        listeners = list(session.peers)
        had_joined = session.peers.pop(leaver, None) is not None
        if not had_joined and not session.windows:
            arrival.peer.tally.add("repeated")
        session.tell(Cancel(), arrival.now_s)
        self._forget_texts(wire.session)
        for event in self._engine.events():
            self._tell_event(event, arrival.replies)
        session.forget()
        notice = schema.Notice(wire.session, -1, "cancelled", engine_us=microseconds(arrival.now_s), reason="bye")
        arrival.replies.extend((peer, wire_format.encode(notice)) for peer in listeners)

    def _ping(self, wire: schema.Ping, arrival: Arrival) -> None:
        peer, now_s = arrival.peer, arrival.now_s
        before = peer.clock.steps
        if wire.rtt_us >= 0:
            peer.clock.report(wire.sent_us / 1e6, wire.offset_us / 1e6, wire.skew_ppm)
        else:
            peer.clock.ping(wire.sent_us / 1e6, now_s)
        peer.tally.add("clock_steps", peer.clock.steps - before)
        now_us = microseconds(now_s)
        pong = schema.Pong(wire.number, wire.sent_us, now_us, now_us, self._instance)
        arrival.replies.append((peer.name, wire_format.encode(pong)))

    def _begin(self, wire: schema.BeginUtterance, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is None:
            return
        peer = arrival.peer
        if not session.begin(wire, peer.clock, peer.name, arrival.now_s, peer.tally):
            self._refuse(wire.session, "utterances", arrival, wire.utterance)

    def _phones(self, wire: schema.Phones, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is not None:
            session.phones(wire, arrival.peer.name, arrival.now_s, arrival.peer.tally)

    def _sound(self, wire: schema.Sound, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is not None:
            session.sound(wire, arrival.now_s, arrival.peer.tally)
            self._sounding.add(wire.session)

    def _words_of(self, wire: schema.WordTimes, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is None:
            return
        peer = arrival.peer
        if len(self._words) >= self._limits.texts:
            self._refuse(wire.session, "words", arrival, wire.utterance)
            return
        try:
            request = session.words(wire, peer.clock, peer.name, arrival.now_s, peer.tally)
        except UsageError as error:
            self._refuse(wire.session, str(error), arrival, wire.utterance)
        else:
            self._words.extend([request] if request is not None else [])

    def _end(self, wire: schema.EndUtterance, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is None:
            return
        request = session.end_words(wire, arrival.peer.name, arrival.now_s)
        if request is not None:
            self._words.append(request)
        else:
            session.end(wire, arrival.peer.name, arrival.now_s, arrival.peer.tally)

    def _cancel(self, wire: schema.CancelUtterance, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        if session is None:
            return
        if wire.utterance == schema.NOW and wire.at_us < 0:
            self._forget_texts(wire.session)
        for number in session.cancel(wire, arrival.now_s, arrival.peer.tally):
            now_us = microseconds(arrival.now_s)
            notice = schema.Notice(wire.session, number, "cancelled", count=wire.number, engine_us=now_us)
            arrival.replies.append((arrival.peer.name, wire_format.encode(notice)))

    def _seek(self, wire: schema.SeekUtterance, arrival: Arrival) -> None:
        session = self._session(wire.session, arrival)
        window = session.windows.get(wire.utterance) if session else None
        if window is None or wire.position_us < 0:
            arrival.peer.tally.add("refused")
            return
        self._move(wire.session, Seek(window.engine_number, wire.position_us / 1e6), arrival)

    def _move(self, name: str, command: Command, arrival: Arrival) -> None:
        session = self._session(name, arrival)
        if session is not None:
            session.stop_following()
            session.tell(command, arrival.now_s)

    def _audio(self, wire: schema.AudioPosition, arrival: Arrival) -> None:
        peer, now_s = arrival.peer, arrival.now_s
        if wire.session not in self._sessions or wire.utterance not in self._sessions[wire.session].windows:
            self._tell_unknown(wire.session, wire.utterance, arrival)
            return
        before = peer.clock.steps
        at_s = peer.clock.audio(wire.sender_us / 1e6, now_s)
        peer.tally.add("clock_steps", peer.clock.steps - before)
        if at_s is None:
            peer.tally.add("odd_times")
        else:
            self._sessions[wire.session].audio(wire, at_s, now_s, peer.tally)

    def _command(self, wire: schema.SessionCommand, arrival: Arrival) -> None:
        command = shifted(wire.command, arrival.now_s)
        if isinstance(command, Pause | Resume):
            self._move(wire.session, command, arrival)
            return
        session = self._session(wire.session, arrival)
        if session is not None:
            for each in without_neutral(command):
                session.tell(each, arrival.now_s)

    def _text(self, wire: schema.SpeakText, arrival: Arrival) -> None:
        if len(wire.text.encode()) > schema.TEXT_BYTES or len(self._texts) >= self._limits.texts:
            self._refuse(wire.session, "text", arrival)
        elif wire.text.strip() and self._session(wire.session, arrival) is not None:
            self._texts.append(TextRequest(wire.session, wire.text, wire.voice, arrival.peer.name))

    def _forget_texts(self, session: str) -> None:
        """Of texts that the voice was not handed yet: it is not to say them any more."""
        self._texts = deque(request for request in self._texts if request.session != session)

    def _session(self, name: str, arrival: Arrival) -> WireSession | None:
        """Find a session, or open it; None if there are as many as there may be, or if it is elsewhere."""
        if self._elsewhere(name) is not None:
            self._tell_unknown(name, schema.NOW, arrival)
            return None
        if not check_open(self._engine, name, arrival.now_s):
            self._refuse(name, "sessions", arrival)
            return None
        if name not in self._sessions:
            before = self._asleep.pop(name, None)
            most, phones = self._limits.utterances, self._engine_limits.phones
            self._sessions[name] = before or WireSession(name, self._engine, most, phones, self._numbers)
        return self._sessions[name]

    def _put_to_sleep(self, name: str) -> None:
        """Remember who joined a session that others closed, or that was closed for being idle."""
        session = self._sessions.pop(name)
        if not session.peers:
            return
        session.forget()
        self._asleep[name] = session
        if len(self._asleep) > self._limits.peers:
            self._asleep.popitem(last=False)

    def _refuse(self, session: str, reason: str, arrival: Arrival, utterance: int = -1) -> None:
        arrival.peer.tally.add("refused")
        notice = schema.Notice(session, utterance, "error", engine_us=microseconds(arrival.now_s), reason=reason)
        arrival.replies.append((arrival.peer.name, wire_format.encode(notice)))

    def _tell_unknown(self, session: str, utterance: int, arrival: Arrival) -> None:
        """Let a sender know, now and then, that the engine has never heard of what it speaks of."""
        arrival.peer.tally.add("refused")
        if arrival.now_s - arrival.peer.told_unknown_s > LOOKAHEAD_S:
            arrival.peer.told_unknown_s = arrival.now_s
            notice = schema.Notice(session, utterance, "unknown", engine_us=microseconds(arrival.now_s))
            arrival.replies.append((arrival.peer.name, wire_format.encode(notice)))

    def _tell_event(self, event: Event, replies: Replies) -> None:
        if self._asking and event.session == self._simple.session:
            packet = event_packet(event)
            replies.extend((peer, packet) for peer in self._asking)
        session = self._sessions.get(event.session)
        if session is None:
            return
        if event.kind in ("finished", "cancelled", "error"):
            number = session.close_window(event.utterance, event.kind == "cancelled", event.time_s)
        else:
            number = session.sender_number(event.utterance)
        if number is None:  # of the simple mode, or of the server's voice
            return
        position_us = min(max(microseconds(event.position_s), -(2**31)), 2**31 - 1)
        notice = schema.Notice(event.session, number, event.kind, position_us, event.count, microseconds(event.time_s))
        packet = wire_format.encode(notice)
        for peer, flags in session.peers.items():
            replies.append((peer, packet))
            if event.kind in TOLD_AGAIN and not flags & schema.TCP:
                for later_s in TOLD_AGAIN_S:
                    self._order += 1
                    heapq.heappush(self._again, (event.time_s + later_s, self._order, peer, packet))


_OBEY = cast(
    "dict[type[schema.Wire], Callable[[OscReceiver, Any, Arrival], None]]",
    {
        schema.Hello: OscReceiver._hello,
        schema.Bye: OscReceiver._bye,
        schema.Ping: OscReceiver._ping,
        schema.BeginUtterance: OscReceiver._begin,
        schema.Phones: OscReceiver._phones,
        schema.Sound: OscReceiver._sound,
        schema.EndUtterance: OscReceiver._end,
        schema.CancelUtterance: OscReceiver._cancel,
        schema.SeekUtterance: OscReceiver._seek,
        schema.AudioPosition: OscReceiver._audio,
        schema.SpeakText: OscReceiver._text,
        schema.WordTimes: OscReceiver._words_of,
        schema.SessionCommand: OscReceiver._command,
    },
)
