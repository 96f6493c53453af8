"""Who hears of a session, and who may silence it: datagrams' addresses are proved, listeners keep their places."""

import numpy as np
import pytest

from fapengine.engine.engine import Engine
from fapengine.errors import UsageError
from fapengine.server.intake.rates import A_FACE, FULL, Load
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.handshake import Handshake
from fapengine.wire.speech_osc.peers import AMPLIFICATION, Proof
from fapengine.wire.speech_osc.receiver import ALIVE_S, MAX_PEERS, SILENT_S, OscReceiver
from fapengine.wire.speech_osc.routing import hello_of
from tests.english import english

LABELS = tuple(schema.WirePhone(label, n * 100_000, 100_000) for n, label in enumerate("mamama"))
PHONES = schema.Phones("anna", 0, 0, 0, LABELS)


def engine() -> Engine:
    return Engine(english(), rng=np.random.default_rng(1))


def receiver(token: str | None = None) -> OscReceiver:
    """One whose peers are told ``host:port``."""
    proof = Proof(b"secret", lambda peer: False, lambda peer: str(peer).partition(":")[0])
    return OscReceiver(engine(), token=token, proof=proof)


def tell(to: OscReceiver, peer: str, *wires: schema.Wire, now_s: float = 0.0) -> list[schema.Wire]:
    """What the peer itself is answered."""
    found = []
    for wire in wires:
        for name, packet in to.receive(codec.encode(wire), peer, now_s, now_s):
            if name == peer:
                found += [codec.parse(schema.FROM_ENGINE[one.address], one) for one in osc.parse_packet(packet)]
    return found


def prove(to: OscReceiver, peer: str, *, instance: int = 0, now_s: float = 0.0) -> schema.Wire:
    """Say hello, and again with the cookie; the last answer."""
    (welcome,) = tell(to, peer, schema.Hello("anna", instance=instance), now_s=now_s)
    assert isinstance(welcome, schema.Welcome)
    return tell(to, peer, schema.Hello("anna", instance=instance, cookie=welcome.cookie), now_s=now_s)[-1]


def test_an_address_that_nobody_proved_gets_little_more_than_came_from_it() -> None:
    """A hello and an utterance in a victim's name: it was 24 datagrams to eight of them, 26 times the bytes."""
    server = receiver()
    prove(server, "attacker:1")
    came = 0
    for n in range(8):
        hello = codec.encode(schema.Hello("anna"))
        came += len(hello)
        server.receive(hello, f"victim:{n}", 0.0, 0.0)
    sent: dict[str, int] = {}
    tell(server, "attacker:1", schema.BeginUtterance("anna", 0), PHONES, schema.EndUtterance("anna", 0, 6))
    for frame in range(600):
        server._engine.frame(frame / 60)
        for peer, packet in server.tick(frame / 60):
            sent[str(peer)] = sent.get(str(peer), 0) + len(packet)
    reflected = sum(size for peer, size in sent.items() if peer.startswith("victim"))
    assert sent["attacker:1"] > reflected / 8  # it is told everything, and each of them less
    assert reflected <= AMPLIFICATION * came
    assert server.counts.unproved > 8


def test_a_cookie_that_comes_back_proves_an_address_and_a_wrong_one_does_not() -> None:
    server = receiver()
    (welcome,) = tell(server, "a:1", schema.Hello("anna"))
    assert isinstance(welcome, schema.Welcome)
    assert welcome.cookie
    for wrong in (0, welcome.cookie ^ 1, Proof(b"another run").cookie_of("a:1")):
        (again,) = tell(server, "a:1", schema.Hello("anna", cookie=wrong))
        assert again.cookie == welcome.cookie  # still asked
    assert tell(server, "a:1", schema.Hello("anna", cookie=welcome.cookie))[0].cookie == 0
    assert tell(server, "b:1", schema.Hello("anna", cookie=welcome.cookie))[0].cookie not in (0, welcome.cookie)


def test_a_sender_brings_the_cookie_back_at_once() -> None:
    handshake = Handshake(schema.Hello("anna"))
    handshake.due(0.0)
    handshake.answered(schema.Welcome("anna", 0, cookie=77), 0.01)
    said = [wire for parts in handshake.due(0.01) for wire in parts if isinstance(wire, schema.Hello)]
    assert [hello.cookie for hello in said] == [77]
    handshake.answered(schema.Welcome("anna", 0), 0.02)
    handshake.heard_s = 0.02
    assert not [wire for parts in handshake.due(0.5) for wire in parts if isinstance(wire, schema.Hello)]


@pytest.mark.parametrize(
    ("newcomer", "at_s", "token", "silenced"),
    [
        ("evil:1", 1.0, None, False),
        ("evil:1", 1.0 + ALIVE_S, None, True),  # nobody is there any more
        ("anna:2", 1.0, None, True),  # restarted, from another port
        ("evil:1", 1.0, "word", True),  # it knows the token
    ],
)
def test_only_who_may_silences_a_live_session(newcomer: str, at_s: float, token: str | None, silenced: bool) -> None:
    server = receiver(token)
    word = token or ""
    (welcome,) = tell(server, "anna:1", schema.Hello("anna", instance=5, token=word))
    tell(server, "anna:1", schema.Hello("anna", instance=5, token=word, cookie=welcome.cookie))
    tell(server, "anna:1", schema.BeginUtterance("anna", 0), PHONES, now_s=1.0)
    server._engine.frame(1.0)
    hello = schema.Hello("anna", instance=6, token=word, cookie=server._proof.cookie_of(newcomer))
    (answer,) = tell(server, newcomer, hello, now_s=at_s)
    assert isinstance(answer, schema.Welcome) is silenced
    if not silenced:
        assert answer.reason == "another sender speaks"
        assert server.counts.refused == 1
    server._engine.frame(at_s + 0.3)
    assert (server._engine.state("anna") == "idle") is silenced


def test_a_forged_address_of_the_same_host_does_not_silence() -> None:
    server = receiver()
    prove(server, "anna:1", instance=5)
    (answer,) = tell(server, "anna:9", schema.Hello("anna", instance=6))  # no cookie: it may be forged
    assert answer.reason == "another sender speaks"


def test_a_ninth_listener_takes_only_the_place_of_a_silent_one() -> None:
    server = receiver()
    for n in range(MAX_PEERS):
        assert isinstance(prove(server, f"host{n}:1"), schema.Welcome)
    (answer,) = tell(server, "ninth:1", schema.Hello("anna"))
    assert answer.reason == "listeners"
    for n in range(1, MAX_PEERS):  # host0 is not heard any more
        tell(server, f"host{n}:1", schema.Ping(1, 0), now_s=SILENT_S + 1)
    assert isinstance(prove(server, "ninth:1", now_s=SILENT_S + 1), schema.Welcome)
    assert "host0:1" not in server._sessions["anna"].peers


def test_no_face_is_added_where_there_is_no_time_for_it_and_those_there_go_on() -> None:
    server = receiver()
    prove(server, "a:1")
    server._engine.room = 0
    (answer,) = tell(server, "b:1", schema.Hello("berta"))
    assert answer.reason == "sessions"
    assert isinstance(prove(server, "a:1"), schema.Welcome)  # it is there already
    with pytest.raises(UsageError, match="in time; ask again later"):
        server._engine.open("carl", 0.0)
    assert server._engine.refused == 2
    server._engine.room = 1
    assert isinstance(tell(server, "b:1", schema.Hello("berta"))[0], schema.Welcome)
    assert tell(server, "c:1", schema.Hello("carl"))[0].reason == "sessions"  # berta has taken the room


def test_a_window_lets_in_no_more_than_would_fill_the_time() -> None:
    load = Load(rate_hz=60.0)
    assert load.room * A_FACE == pytest.approx(FULL, abs=A_FACE)
    assert not load.add(0.0, 0.0)
    for frame in range(1, 61):
        is_new = load.add(frame * 0.2 / 60, frame / 60 + 1e-9)
    assert is_new
    assert load.room * A_FACE == pytest.approx(FULL - 0.2, abs=A_FACE)


def test_load_is_the_work_of_a_frame_and_lets_go_later_than_it_takes_hold() -> None:
    load, cpu_s, now_s = Load(rate_hz=60.0), 0.0, 0.0

    def work(seconds: float, *, waits_s: float = 0.0) -> bool:
        nonlocal cpu_s, now_s
        for _ in range(61 if not waits_s else 400):
            cpu_s += seconds
            now_s += max(1 / 60, seconds) + waits_s
            load.add(cpu_s, now_s)
        return load.is_full

    assert not work(0.55 / 60)
    assert work(0.9 / 60)
    assert work(0.55 / 60)  # not at once
    assert not work(0.4 / 60)
    assert not work(0.4 / 60, waits_s=0.1)  # other programs have the processor
    assert work(3.0 / 60)  # frames are late by our own work


def test_a_sender_is_sent_elsewhere_with_no_more_bytes_than_it_sent():
    for length in range(1, schema.SESSION_BYTES + 1):
        name = "a" * length
        smallest = osc.message("/fap/1/hello", "sTssi", name, True, "", "", schema.FOLLOWS)
        hello = hello_of(smallest)
        assert hello is not None
        assert hello.flags & schema.FOLLOWS
        assert len(codec.encode(schema.Moved(name, "", 65_535, hello.instance))) <= len(smallest)
