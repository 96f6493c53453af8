"""Parts of a server of many processes: who has which session, whose a packet is, what the two ends say."""

import os
import signal
import socket
from collections import Counter
from types import SimpleNamespace

import pytest

from fapengine._counters import Family
from fapengine.server.cluster import channel
from fapengine.server.cluster.channel import Channel
from fapengine.server.cluster.front import FrontCounts, _first_packet, _target_of
from fapengine.server.cluster.workers import _signal
from fapengine.server.metrics import page_of_workers
from fapengine.server.ownership import MAX_PLACED, UNUSED_S, OwnSessions, Placement, worker_of
from fapengine.wire import osc
from fapengine.wire.framing import encode_length, encode_slip
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.routing import hello_of, session_of

NAMES = [f"s{number}" for number in range(4000)]


def table_of(*workers: int) -> Placement:
    table = Placement()
    for worker in workers:
        table.join(worker)
    return table


def test_sessions_are_spread_evenly_and_only_those_of_a_lost_worker_move() -> None:
    before = {name: worker_of(name, range(8)) for name in NAMES}
    share = Counter(before.values())
    assert min(share.values()) > 400 < max(share.values()) < 600  # 500, with a deviation of 21
    after = {name: worker_of(name, [0, 1, 2, 4, 5, 6, 7]) for name in NAMES}
    assert {name for name in NAMES if before[name] != after[name]} == {name for name in NAMES if before[name] == 3}


def test_a_worker_that_comes_back_takes_nothing_that_is_placed() -> None:
    table = table_of(0, 1)
    homes = {name: table.owner(name, 0.0).worker for name in NAMES[:100]}
    table.lose(0)
    gone = [name for name, worker in homes.items() if worker == 0]
    assert not set(gone) & set(table.homes)
    epochs = {name: table.owner(name, 1.0).epoch for name in gone}
    table.join(0)
    assert {table.owner(name, 2.0).worker for name in NAMES[:100]} == {1}
    assert min(epochs.values()) > 100  # every epoch before was smaller
    assert {table.owner(name, 2.0).worker for name in NAMES[100:200]} == {0, 1}


def test_a_worker_that_is_passed_over_keeps_what_it_has() -> None:
    table = table_of(0, 1)
    homes = {name: table.owner(name, 0.0).worker for name in NAMES[:100]}
    table.pass_over(0)
    assert {table.owner(name, 1.0).worker for name in NAMES[100:200]} == {1}
    assert {name: table.owner(name, 1.0).worker for name in homes} == homes


def test_a_session_is_given_back_only_when_its_worker_has_left_it() -> None:
    table = table_of(0)
    home = table.owner("anna", 0.0)
    table.opened(0, ["anna"])
    assert table.to_leave(100.0) == []
    table.closed(0, ["anna"], 100.0)
    assert table.to_leave(100.0 + UNUSED_S) == []
    assert table.to_leave(100.1 + UNUSED_S) == [(0, "anna")]
    assert table.to_leave(200.0) == []  # asked once
    table.owner("anna", 200.0)  # something was sent there meanwhile: behind the question, on the same channel
    table.left(0, "anna")
    assert table.homes["anna"] is home
    assert table.to_leave(300.0) == [(0, "anna")]
    table.left(1, "anna")
    assert "anna" in table.homes
    table.left(0, "anna")
    assert "anna" not in table.homes
    assert table.owner("anna", 301.0).epoch > home.epoch


def test_what_another_worker_says_of_a_session_changes_nothing() -> None:
    table = table_of(0)
    table.owner("anna", 0.0)
    table.opened(1, ["anna", "nobody"])
    assert not table.homes["anna"].is_open
    table.opened(0, ["anna"])
    table.closed(1, ["anna"], 1.0)
    assert table.homes["anna"].is_open


def test_nobody_lives_or_the_table_is_full() -> None:
    assert table_of().owner("anna", 0.0) is None
    table = table_of(0)
    table.homes = dict.fromkeys(map(str, range(MAX_PLACED)), table.owner("x", 0.0))
    assert table.owner("anna", 0.0) is None


def test_a_worker_catches_up_before_it_says_that_a_session_is_elsewhere() -> None:
    own = OwnSessions(9110, lambda: own.epochs.setdefault("anna", 1))
    assert own.elsewhere("anna") is None
    assert own.elsewhere("ben") == 9110


BEGIN = osc.message("/fap/1/utt/begin", "si", "anna", 1)
PING = osc.message("/fap/1/ping", "ih", 0, 0)


@pytest.mark.parametrize(
    ("packet", "session"),
    [
        (BEGIN, "anna"),
        (osc.message("/fap/1/expr", "ssf", "ben", "joy", 0.5), "ben"),
        (osc.message("/expr", "sf", "joy", 0.5), "face"),
        (osc.message("/tts/text", "s", "Hello."), "face"),
        (osc.message("/tts/stop"), "face"),
        (PING, None),
        (osc.bundles([PING, BEGIN], limit=1 << 16)[0], "anna"),
        (osc.message("/fap/1/utt/begin", "ii", 1, 1), None),
        (osc.message("/fap/1/hello", "s", "x" * 33), None),
        (osc.message("/other", "s", "anna"), None),
        (b"", None),
        (b"\0\0\0\0", None),
        (b"#bundle\0" + bytes(8) + b"\x7f\xff\xff\xff", None),
        (b"/fap/1/hello\0\0\0\0,s", None),
    ],
)
def test_whose_a_packet_is(packet: bytes, session: str | None) -> None:
    assert session_of(packet) == session
    for cut in range(len(packet)):  # whatever comes of it, nothing raises
        session_of(packet[:cut])


def test_bundles_in_bundles_end() -> None:
    packet = BEGIN
    for _ in range(20):
        packet = b"#bundle\0" + bytes(8) + len(packet).to_bytes(4) + packet
    assert session_of(packet) is None


def test_a_hello_is_read_whole() -> None:
    hello = schema.Hello("anna", flags=schema.FOLLOWS, instance=7)
    packet = osc.bundles([codec.encode(hello), PING], limit=1 << 16)[0]
    assert hello_of(packet) == hello
    assert hello_of(BEGIN) is None
    assert hello_of(packet[:-1]) is None
    assert hello_of(osc.message("/fap/1/hello", "i", 7)) is None


def test_messages_and_sockets_come_in_order_and_whole() -> None:
    ours, theirs = Channel.pair()
    parent, worker = Channel(ours, is_worker=False), Channel(theirs, is_worker=True)
    here, there = socket.socketpair()
    parent.put(channel.Own("anna", 3))
    parent.put(channel.Connection(is_page=True), there)
    parent.put(channel.Packet(("::1", 9, 0, 0), b"/x\0\0"))
    (own, none), (_, handed), (packet, _) = worker.take()
    assert (own.session, own.epoch, none) == ("anna", 3, None)
    assert there.fileno() == -1  # closed here, open there
    handed.send(b"hello")
    assert here.recv(9) == b"hello"
    assert (packet.address, packet.data) == (("::1", 9, 0, 0), b"/x\0\0")
    worker.put(channel.Left("anna"))
    assert [message.session for message, _ in parent.take()] == ["anna"]
    worker.close()
    assert list(parent.take()) == []
    assert parent.is_broken
    assert not parent.put(channel.Own("ben", 4))
    for one in (here, handed):
        one.close()
    parent.close()


def test_a_full_channel_loses_datagrams_and_nothing_else() -> None:
    ours, theirs = Channel.pair()
    parent, worker = Channel(ours, is_worker=False), Channel(theirs, is_worker=True)
    packet = channel.Packet(("127.0.0.1", 9), bytes(60_000))
    sent = 0
    while parent.put(packet):
        sent += 1
    assert sent > 2
    for epoch in range(5000):
        assert parent.put(channel.Own("anna", epoch))
    assert not parent.put(channel.Packet(("127.0.0.1", 9), b""))  # it may not overtake
    came = []
    for _ in range(20):
        came += [message for message, _ in worker.take()]
        parent.flush()
    assert [message.epoch for message in came if isinstance(message, channel.Own)] == list(range(5000))
    assert len(came) == sent + 5000
    parent.close()
    worker.close()


def test_the_beginning_of_a_connection_tells_whose_it_is() -> None:
    assert _target_of(b"GET /ws?session=anna HTTP/1.1\r\nHost: x") == "/ws?session=anna"
    assert _target_of(b"GET /ws?session=an") is None
    assert _target_of(b"nonsense\r\n") == "/"
    for encode in (encode_slip, encode_length):
        stream = encode(BEGIN) + encode(PING)
        assert _first_packet(stream) == BEGIN
        assert _first_packet(stream[:7]) is None
    assert _first_packet(b"GET / HTTP/1.1") == b""
    assert _first_packet(b"\x00\xff\xff\xff\xff") == b""


def test_metrics_of_workers_are_one_page() -> None:
    texts = {
        number: f'# TYPE f_sent_total counter\nf_sent_total{{sink="a"}} {number}.0\n'.encode() for number in (0, 1)
    }
    own = [Family.of("workers", "Workers that live.", 2, is_gauge=True), *FrontCounts(forwarded=7).families()]
    text = page_of_workers(own, texts).decode()
    assert text.count("# TYPE f_sent_total counter") == 1
    assert 'f_sent_total{sink="a",worker="0"} 0.0\nf_sent_total{sink="a",worker="1"} 1.0' in text
    assert 'fapengine_front_total{kind="forwarded"} 7.0' in text
    assert "fapengine_workers 2.0" in text


def test_a_process_that_has_just_ended_is_not_told_to() -> None:
    """Its end may be known to the system before the loop hears of it: a worker killed by somebody else."""
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitpid(child, 0)
    _signal(SimpleNamespace(pid=child, returncode=None), signal.SIGKILL)  # type: ignore[arg-type]
