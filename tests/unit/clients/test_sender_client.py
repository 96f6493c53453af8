"""The client over real sockets of this machine, against the real receiver and engine."""

import errno
import fcntl
import resource
import select
import socket
import threading
import time

import numpy as np
import pytest

from fapengine.clients import connection
from fapengine.clients.sender import Client
from fapengine.engine.engine import Engine
from fapengine.errors import ResourceError, UsageError
from fapengine.server.intake.listeners import bound_pair
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.style import Style
from fapengine.wire import osc
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.receiver import OscReceiver
from fapengine.wire.speech_osc.routing import hello_of
from fapengine.wire.speech_osc.schema import WirePhone
from tests.english import english

MAMA = [Phone("m", 0.0, 0.08), Phone("ɑ", 0.08, 0.2), Phone("m", 0.2, 0.28), Phone("ɑ", 0.28, 0.4)]
SOON_S = 300.0
"""Far more than anything here takes."""


class Place:
    """An engine behind a UDP and a TCP socket, in a thread."""

    def __init__(self, framing: str = "slip", token: str | None = None, port: int = 0, instance: int = 3):
        self.engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
        self.receiver = OscReceiver(self.engine, token=token, instance=instance)
        self.tcp, self.udp = bound_pair("127.0.0.1", port)  # a free UDP port may be taken for TCP
        self.tcp.listen()
        self.port = self.udp.getsockname()[1]
        self.framing = framing
        self.told = []
        self.texts = []
        self.stops = False
        self.thread = threading.Thread(target=self._work)
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stops = True
        self.thread.join()
        self.udp.close()
        self.tcp.close()

    def _work(self) -> None:
        streams = {}
        ready = []
        while not self.stops or self.udp in ready:  # what was sent before is still read
            ready, _, _ = select.select([self.udp, self.tcp, *streams], [], [], 0.01)
            for one in ready:
                if one is self.udp:
                    packet, peer = self.udp.recvfrom(65_536)
                    self._take(packet, peer, streams)
                elif one is self.tcp:
                    stream, _ = self.tcp.accept()
                    streams[stream] = SlipDecoder() if self.framing == "slip" else LengthDecoder()
                else:
                    data = one.recv(65_536)
                    for packet in streams[one].feed(data):
                        self._take(packet, one, streams)
                    if not data:
                        del streams[one]
                        one.close()
            self.texts += self.receiver.texts()
            now_s = time.monotonic()
            self.engine.frame(now_s)
            self._answer(self.receiver.tick(now_s), streams)
        for stream in streams:
            stream.close()

    def _take(self, packet, peer, streams) -> None:
        self.told.append(packet)
        self._answer(self.receiver.receive(packet, peer, time.monotonic(), time.time()), streams)

    def _answer(self, replies, streams) -> None:
        for peer, packet in replies:
            if peer in streams:
                peer.sendall(encode_slip(packet) if self.framing == "slip" else encode_length(packet))
            elif isinstance(peer, tuple):
                self.udp.sendto(packet, peer)


def wait_for(face: Client, utterance: int) -> None:
    """Until something was heard of an utterance."""
    stop_s = time.monotonic() + SOON_S
    while not any(event.utterance == utterance for event in face.events()):
        assert time.monotonic() < stop_s
        time.sleep(0.01)


@pytest.mark.parametrize("tcp", [False, True, "slip", "length"])
def test_a_face_says_phones_and_tells_when_it_is_over(tcp):
    with (
        Place("length" if tcp == "length" else "slip") as place,
        Client(port=place.port, session="anna", tcp=tcp) as face,
    ):
        face.wait(SOON_S)
        assert face.is_connected
        assert face.welcome.lookahead_us == 500_000
        number = face.send_phones(MAMA, duration_s=0.5)
        assert face.wait_until_finished(number, SOON_S) == "finished"
        kinds = [event.kind for event in face.events()]
        assert kinds == ["started", "finished"]
        assert face.events() == []
    counters = place.engine.counters("anna")
    assert (counters.utterances, counters.finished, counters.unknown, counters.dropped) == (1, 1, 0, 0)
    assert place.receiver.counts.malformed == place.receiver.counts.unknown == 0


def test_what_was_said_has_come_when_the_client_is_closed():
    phones = [Phone("mɑ"[n % 2], 0.1 * n, 0.1 * n + 0.1) for n in range(200)]
    with Place() as place:
        with Client(port=place.port, session="anna") as face:
            face.wait(SOON_S).send_phones(PhoneTrack.from_phones(phones))
        one = place.engine.utterance("anna", 0)
        assert one.phone_count == 200
        assert one.size == 200


def test_phones_that_become_known_one_by_one():
    with Place() as place, Client(port=place.port) as face:
        number = face.begin(at_s=face.now_s + 0.3)
        for phone in MAMA:
            face.append(number, [phone])
        face.end(number)
        assert face.wait_until_finished(number, SOON_S) == "finished"
        with pytest.raises(UsageError, match="expected one that was begun"):
            face.append(99, MAMA)
        face.append(number, MAMA)  # it is over: as if it had been in time
        face.end(number)
        face.revise(number, MAMA)


def test_everything_else_reaches_the_engine():
    with Place() as place, Client(port=place.port, session="anna") as face:
        face.wait(SOON_S)
        face.express("joy", 0.7, hold_s=1.0)
        face.look(0.2, -0.1)
        face.turn_head(yaw_rad=0.3)
        face.blink()
        face.set_parameter("jaw", 0.8)
        face.send_text("hello", voice="en-us")
        long = face.send_phones([WirePhone("m", 0, 200_000), WirePhone("ɑ", 200_000, 30_000_000)])
        wait_for(face, long)
        face.audio_position(long, 0.1)
        face.pause()
        face.resume()
        face.seek(long, 1.0)
        face.revise(long, MAMA)
        face.cancel(long)
        waiting = face.send_phones(MAMA, audio=True)
        face.cancel()
        assert face.wait_until_finished(waiting, SOON_S) == "cancelled"
        face.cancel(waiting)
    addresses = {packet.split(b"\0")[0].decode() for packet in place.told if packet[:1] == b"/"}
    for part in ("expr", "gaze", "head", "blink", "param", "text", "audio", "utt/pause", "utt/resume", "utt/seek"):
        assert f"/fap/1/{part}" in addresses
    assert [request.text for request in place.texts] == ["hello"]
    assert place.engine.style("anna").jaw == pytest.approx(0.8)
    assert place.engine.counters("anna").cancelled in (1, 2)  # the second may never have been sent
    assert place.engine.state("anna") == "idle"


def test_an_error_inside_the_block_cancels():
    def fail(face: Client) -> None:
        with face:
            face.wait(SOON_S)
            number = face.send_phones([Phone("ɑ", 0.0, 20.0)])
            wait_for(face, number)
            raise KeyError(number)

    with Place() as place:
        with pytest.raises(KeyError):
            fail(Client(port=place.port, session="anna"))
        assert place.engine.counters("anna").cancelled == 1


def test_events_are_told_as_they_come():
    told = []
    with Place() as place, Client(port=place.port, on_event=told.append) as face:
        face.wait_until_finished(face.send_phones(MAMA), SOON_S)
    assert [event.kind for event in told] == ["started", "finished"]


def test_a_token_is_needed_where_it_is_wanted():
    with Place(token="secret") as place:
        with Client(port=place.port, token="wrong") as face, pytest.raises(ResourceError, match="no answer within"):
            face.wait(0.3)
        with Client(port=place.port, token="secret") as face:
            assert face.wait_until_finished(face.wait(SOON_S).send_phones(MAMA), SOON_S) == "finished"
        assert place.receiver.counts.refused > 0


def test_an_engine_that_starts_later_is_found_and_a_restarted_one_too():
    with Place() as first:
        port = first.port
    with Client(port=port, session="anna") as face:
        with pytest.raises(ResourceError, match=rf"udp://127.0.0.1:{port}: no answer within 0.05 s; does it run there"):
            face.wait(0.05)
        with Place(port=port):
            face.wait(SOON_S)
            number = face.begin()
            face.append(number, [Phone("ɑ", 0.0, 0.5)])
        with Place(port=port, instance=4) as again:
            face.append(number, [Phone("m", 0.5, 0.6)])
            face.end(number, duration_s=60.0)
            while "anna" not in again.engine or not again.engine.utterance("anna", 0):
                time.sleep(0.01)
            face.cancel()
            face.wait_until_finished(number, SOON_S)


@pytest.mark.skipif(resource.getrlimit(resource.RLIMIT_NOFILE)[1] < 2000, reason="fewer than 2000 files may be open")
def test_more_than_1024_open_files_do_not_matter():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2000), hard))
    pipe = connection.Datagrams("127.0.0.1", 9)
    wake, other = socket.socketpair()
    try:
        low, pipe._socket = pipe._socket, socket.socket(fileno=fcntl.fcntl(pipe._socket, fcntl.F_DUPFD, 1500))
        low.close()
        assert pipe._socket.fileno() >= 1500
        assert pipe._wait(0.0, wake) is False
        other.send(b"x")
        assert pipe.receive(1.0, wake) == []
        assert select.select([wake], [], [], 0.0)[0] == []  # it has been read
    finally:
        pipe.close()
        wake.close()
        other.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_nobody_listens():
    with Place() as place:
        port = place.port
    with pytest.raises(ResourceError, match=rf"tcp://127.0.0.1:{port}"):
        Client(port=port, tcp=True)
    with pytest.raises(ResourceError, match=r"udp://no\.such\.host\.invalid"):
        Client("no.such.host.invalid")
    with pytest.raises(UsageError, match="tcp: got 'osc'"):
        Client(port=port, tcp="osc")
    with Client(port=port) as face:
        assert not face.is_connected
        number = face.send_phones(MAMA)
        assert face.wait_until_finished(number, 0.05) == "lost"
    with pytest.raises(UsageError, match="client: is closed"):
        face.blink()
    face.close()


def test_a_connection_that_ends_is_said_at_the_next_call():
    with Place() as place:
        face = Client(port=place.port, tcp=True).wait(SOON_S)
        number = face.begin()
    assert face.wait_until_finished(number, SOON_S) == "lost"
    with pytest.raises(ResourceError, match="the connection is lost"):
        face.blink()
    with pytest.raises(ResourceError, match="the connection is lost"):
        face.wait(SOON_S)
    face.close()


class Cable:
    """A UDP socket whose network can go away."""

    def __init__(self, plugged: socket.socket):
        self.plugged = plugged
        self.is_cut = False
        self.errors = [errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.ENOBUFS]
        self.fileno, self.close = plugged.fileno, plugged.close

    def fail(self) -> None:
        if self.is_cut:
            self.errors.append(self.errors.pop(0))
            raise OSError(self.errors[0], "away")

    def send(self, packet: bytes) -> int:
        self.fail()
        return self.plugged.send(packet)

    def recv(self, size: int) -> bytes:
        self.fail()
        return self.plugged.recv(size)


def test_a_network_that_goes_away_for_a_while_ends_nothing():
    with Place() as place, Client(port=place.port, session="anna") as face:
        face.wait(SOON_S)
        cable = face._pipe._socket = Cable(face._pipe._socket)
        cable.is_cut = True
        number = face.begin()
        face.append(number, MAMA)
        face.end(number)
        assert face.wait_until_finished(number, 0.1) == "lost"
        cable.is_cut = False
        assert face.wait_until_finished(number, SOON_S) == "finished"


def test_what_a_callback_raises_is_said_at_the_next_call(monkeypatch):
    shown = []
    monkeypatch.setattr(threading, "excepthook", shown.append)

    def fail(notice):
        raise OSError("the user's own")

    with Place() as place:
        face = Client(port=place.port, on_event=fail)
        number = face.send_phones([Phone("ɑ", 0.0, 20.0)])
        begun_s = time.monotonic()
        assert face.wait_until_finished(number, SOON_S) == "lost"
        assert time.monotonic() < begun_s + SOON_S
        with pytest.raises(UsageError, match=r"on_event: raised OSError\(\"the user's own\"\)"):
            face.blink()
        face.close()
    assert isinstance(shown[0].exc_value.__cause__, OSError)  # with its place, on stderr


def test_a_callback_may_tell_more_than_the_thread_has_read():
    said = threading.Event()

    def chatter(notice):
        for _ in range(500):
            face.blink()
        said.set()

    with Place() as place:
        face = Client(port=place.port, on_event=chatter)
        face.send_phones(MAMA)
        assert said.wait(SOON_S)
        face.close()


def test_a_callback_may_tell_something_while_the_client_closes():
    begun, goes_on = threading.Event(), threading.Event()

    def late(notice):
        begun.set()
        assert goes_on.wait(SOON_S)
        face.blink()

    with Place() as place:
        face = Client(port=place.port, on_event=late)
        face.send_phones(MAMA)
        assert begun.wait(SOON_S)
        closing = threading.Thread(target=face.close)
        closing.start()
        while not face._stops:
            time.sleep(0.01)
        goes_on.set()
        closing.join()
    with pytest.raises(UsageError, match="client: is closed"):
        face.blink()


def test_an_error_inside_the_block_goes_before_a_connection_that_was_lost():
    def fail() -> None:
        with face:
            place.__exit__()
            while face._fault is None:
                time.sleep(0.01)
            raise KeyError("the user's own")

    with Place() as place:
        face = Client(port=place.port, tcp=True).wait(SOON_S)
        with pytest.raises(KeyError):
            fail()
    with pytest.raises(UsageError, match="client: is closed"):
        face.blink()


def test_only_the_last_utterances_are_remembered(monkeypatch):
    monkeypatch.setattr(connection, "KEPT_ENDED", 3)
    with Place() as place, Client(port=place.port) as face:
        numbers = [face.begin() for _ in range(5)]
        for number in numbers:
            face.cancel(number)
        assert [face.wait_until_finished(number) for number in numbers] == ["lost"] * 2 + ["cancelled"] * 3


def test_wrong_calls_are_said_at_once():
    with Place() as place, Client(port=place.port) as face:
        with pytest.raises(UsageError, match="expression: got 'hungry', expected one of joy, sadness"):
            face.express("hungry")
        with pytest.raises(UsageError, match="at_s: got audio, too"):
            face.send_phones(MAMA, at_s=1.0, audio=True)
        with pytest.raises(UsageError, match=r"expected 1 to 32 bytes"):
            Client(session="")


def hello_at(door: socket.socket) -> tuple[schema.Hello, tuple[str, int]]:
    """The next hello that comes there, and from where."""
    while True:
        packet, address = door.recvfrom(4096)
        for message in osc.parse_packet(packet):
            if message.address == schema.Hello.ADDRESS:
                return codec.parse(schema.Hello, message), address


def door() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.settimeout(SOON_S)
    return opened


@pytest.mark.parametrize("is_closed", [True, False])
def test_a_port_that_nobody_answers_at_is_left_for_the_known_one(is_closed, monkeypatch):
    monkeypatch.setattr(connection, "LOST_S", 0.2)
    known, other = door(), door()
    port = other.getsockname()[1]
    if is_closed:
        other.close()
    with Client("127.0.0.1", known.getsockname()[1], session="anna") as client:
        hello, address = hello_at(known)
        assert hello.flags & schema.FOLLOWS
        known.sendto(codec.encode(schema.Moved("anna", "", port, hello.instance)), address)
        if not is_closed:
            assert hello_at(other)[0].instance == hello.instance
        again, address = hello_at(known)
        while again.flags & schema.FOLLOWS:  # greeted before it was sent away
            again, address = hello_at(known)
        assert again.instance == hello.instance
        known.sendto(codec.encode(schema.Welcome("anna", 5)), address)
        client.wait(SOON_S)
    known.close()
    other.close()


def test_a_server_that_moved_is_followed_and_everything_told_there():
    known = door()
    with Place() as place, Client("127.0.0.1", known.getsockname()[1], session="anna") as client:
        number = client.send_phones(MAMA)
        hello, address = hello_at(known)
        known.sendto(codec.encode(schema.Moved("anna", "127.0.0.1", place.port, hello.instance)), address)
        assert client.wait_until_finished(number, SOON_S) == "finished"
    known.close()


def test_a_connection_that_is_sent_to_nobody_says_so():
    known, other = socket.create_server(("127.0.0.1", 0)), socket.create_server(("127.0.0.1", 0))
    port = other.getsockname()[1]
    other.close()
    with known, Client("127.0.0.1", known.getsockname()[1], session="anna", tcp="length") as client:
        accepted, _ = known.accept()
        with accepted:
            accepted.settimeout(SOON_S)
            packet, decoder = b"", LengthDecoder()
            while not packet:
                packet = b"".join(decoder.feed(accepted.recv(4096))[:1])
            hello = hello_of(packet)
            accepted.sendall(encode_length(codec.encode(schema.Moved("anna", "", port, hello.instance))))
            with pytest.raises(ResourceError, match=str(port)):
                client.wait(SOON_S)
