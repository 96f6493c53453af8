"""An engine that only writes down what it is told."""

from fapengine.engine.commands import Begin
from fapengine.engine.session import Event
from fapengine.engine.utterance import StreamClock, Utterance
from fapengine.errors import UsageError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.receiver import OscReceiver

WALL_S = 1_790_000_000.0


class Recorder:
    """Takes the commands of :class:`fapengine.engine.engine.Engine`."""

    def __init__(self, most: int = 4):
        self.most = most
        self.open_sessions = []
        self.told = []
        self.happened = []
        self.utterances = {}
        self.is_full = False
        self.told_too = lambda session, command, now_s: None

    def __contains__(self, session):
        return session in self.open_sessions

    def open(self, session, now_s):
        if len(self.open_sessions) == self.most:
            raise UsageError("sessions: as many as there may be")
        self.open_sessions.append(session)

    def close(self, session, now_s):
        self.open_sessions.remove(session)

    def apply(self, session, command, now_s):
        assert session in self.open_sessions
        self.told.append((session, command, now_s))
        self.told_too(session, command, now_s)
        if isinstance(command, Begin) and not self.is_full:
            known = Utterance(command.utterance, StreamClock(0.0), anchor=command.anchor)
            self.utterances.setdefault((session, command.utterance), known)

    def events(self):
        drained, self.happened = self.happened, []
        return drained

    def utterance(self, session, number):
        return self.utterances.get((session, number))

    def settle(self, session, number, zero_s):
        """Give an utterance its place, in engine time."""
        utterance = self.utterances[session, number] = Utterance(number, StreamClock(0.0))
        utterance.begin(Begin(number))
        utterance.place(zero_s)

    def happen(self, session, number, kind, time_s, count=1):
        known = self.utterances.get((session, number))
        position_s = known.position_s(time_s) if known is not None and known.state.is_placed else 0.0
        if kind in ("finished", "cancelled", "error"):
            self.utterances.pop((session, number), None)
        self.happened.append(Event(session, number, kind, time_s, count, position_s))

    def commands(self, kind=None, session=None):
        return [
            command
            for name, command, _ in self.told
            if (kind is None or isinstance(command, kind)) and session in (None, name)
        ]


class Wire:
    """A receiver, and what it answers, read back."""

    def __init__(self, most: int = 4, **options):
        self.faces = Recorder(most)
        self.receiver = OscReceiver(self.faces, **options)
        self.now_s = 50.0

    def send(self, *told, peer="a", at_s=None, tag=None):
        """Messages of the schema, or packets as they are; returns the answers."""
        self.now_s = self.now_s if at_s is None else at_s
        answers = []
        for one in told:
            packet = one if isinstance(one, bytes) else codec.encode(one)
            if tag is not None:
                packet = b"#bundle\0" + tag.to_bytes(8, "big") + len(packet).to_bytes(4, "big") + packet
            answers += self.receiver.receive(packet, peer, self.now_s, WALL_S + self.now_s)
        return self.read(answers)

    @property
    def peers(self):
        """Names of the peers that the receiver remembers."""
        return {*self.receiver._joined, *self.receiver._strangers}

    def say(self, address, tags="", *values, **where):
        return self.send(osc.message(address, tags, *values), **where)

    def tick(self, at_s):
        self.now_s = at_s
        return self.read(self.receiver.tick(at_s))

    def read(self, answers):
        read = []
        for peer, packet in answers:
            (message,) = osc.parse_packet(packet)
            read.append((peer, codec.parse(schema.FROM_ENGINE[message.address], message)))
        return read

    @property
    def counts(self):
        return self.receiver.counts


def phones(labels="mɑmɑ", first_us=0, each_us=100_000):
    return tuple(schema.WirePhone(label, first_us + n * each_us, each_us) for n, label in enumerate(labels))
