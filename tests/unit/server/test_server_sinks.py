"""Sinks over real loopback sockets, read by others: python-osc, our face decoder, a reader of Live Link by hand."""

import asyncio
import contextlib
import copy
import inspect
import io
import os
import re
import socket
import struct
import time
from collections.abc import Callable

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket

from fapengine._child import messages, packed, unpacked
from fapengine.codec.decoder import Decoder
from fapengine.engine.commands import Append, Begin, End, Express
from fapengine.engine.engine import Engine
from fapengine.errors import ResourceError, UsageError
from fapengine.expressions import Expression
from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.server import watchdog as guards
from fapengine.server.sinks import face_streams, opening
from fapengine.server.sinks.encoders import PERFORMER_PORT, FbaFrameEncoder, FrameEncoder, OscFrameEncoder, joined
from fapengine.server.sinks.face_streams import FaceStreams
from fapengine.server.sinks.kinds import (
    SINK_KINDS,
    SINK_NAMES,
    SinkAddress,
    SinkKind,
    kind_of,
    parse_sink,
)
from fapengine.server.sinks.opening import datagram_sink, encoder_of, open_sink, opener
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style
from fapengine.wire import livelink, vmc, vrchat, vts
from fapengine.wire.fap_osc import decode_frame
from tests.english import english
from tests.patient import until_delivered
from tests.unit.wire.rtp_receiver import RtpReceiver

JAW = fap.column(3)
PHONES = tuple(Phone(label, 0.1 * n, 0.1 * n + 0.1) for n, label in enumerate(["m", "ɑː", "b", "ɑː", "p", "ɑː", "m"]))
RATE_HZ = 60.0
HALF_STEP = 2
"""FAPU; quantiser 1 has steps of 1 to 4."""


def encoder_for(url: str) -> FrameEncoder:
    """The encoder of a sink that sends datagrams."""
    return encoder_of(parse_sink(url), RATE_HZ)


class Stage:
    """Stateful: a hub whose time the test turns."""

    def __init__(self, *sessions: str) -> None:
        self.now_s = 50.0
        engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
        self.hub = Hub(engine, rate_hz=RATE_HZ, clock=lambda: self.now_s)
        for session in sessions:
            self.hub.open(session)

    def talk(self, session: str) -> None:
        self.hub.apply(session, Begin(1))
        self.hub.apply(session, Append(1, 0, PHONES))
        self.hub.apply(session, End(1, len(PHONES), 0.8))

    def run(self, frames: int) -> list[HubFrames]:
        shown = []
        for _ in range(frames):
            self.now_s += 1 / RATE_HZ
            shown.append(self.hub.tick(self.now_s))
        return shown


class Ear:
    """A UDP socket that hears."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]

    def heard(self) -> list[bytes]:
        until_delivered()
        found = []
        while True:
            try:
                found.append(self.socket.recv(65536))
            except BlockingIOError:
                return found

    def messages(self) -> list[tuple[str, list[object]]]:
        timed = [one for data in self.heard() for one in OscPacket(data).messages]
        return [(one.message.address, one.message.params) for one in timed]


@pytest.fixture
def ear():
    one = Ear()
    yield one
    one.socket.close()


def test_osc_frames_of_every_session_and_a_last_one_at_rest(ear: Ear) -> None:
    stage = Stage("anna", "ben")
    sink = datagram_sink(stage.hub, parse_sink(f"osc://127.0.0.1:{ear.port}"))
    stage.talk("ben")
    shown = stage.run(20)
    found = ear.messages()
    assert len(found) == sink.counts.sent == 40
    for tick, frames in enumerate(shown):
        for row, name in enumerate(("anna", "ben")):
            address, (session, number, time_us, mask, *values) = found[2 * tick + row]
            assert (address, session, number) == ("/fap/1/frame", name, tick)
            assert time_us == round(1e6 * frames.time_s)
            assert mask == bytes.fromhex("3fffffffffffffff f0")
            assert values == frames.faps[row, 2:].tolist()
    assert shown[-1].faps[1, JAW] > 0
    stage.hub.close("ben")
    stage.run(1)
    stage.run(1)
    last = [(params[0], params[1], any(params[4:])) for _, params in ear.messages()]
    assert last == [("anna", 20, False), ("ben", 20, False), ("anna", 21, False)]
    asyncio.run(sink.close())
    stage.run(1)
    assert ear.heard() == []


def test_osc_frames_of_one_session(ear: Ear) -> None:
    stage = Stage("anna", "ben")
    sink = datagram_sink(stage.hub, parse_sink(f"osc://127.0.0.1:{ear.port}?session=ben"))
    stage.run(2)
    assert [params[0] for _, params in ear.messages()] == ["ben", "ben"]
    asyncio.run(sink.close())


def test_named_faps_follow_the_first_face_and_rest_when_it_goes(ear: Ear) -> None:
    stage = Stage("anna", "ben")
    sink = datagram_sink(stage.hub, parse_sink(f"named://127.0.0.1:{ear.port}"))
    stage.talk("anna")
    frames = stage.run(20)
    found = ear.messages()
    assert {address for address, _ in found} == {f"/fap/{number}" for number in range(3, 69)}
    assert [params[0] for address, params in found if address == "/fap/3"] == [one.faps[0, JAW] for one in frames]
    stage.hub.close("anna")
    stage.run(1)
    assert not any(params[0] for _, params in ear.messages())
    stage.hub.apply("ben", Express(Expression.SURPRISE, attack_s=0.05))
    stage.run(20)
    assert [params[0] for address, params in ear.messages() if address == "/fap/31"][-1] > 20  # ben's turn
    asyncio.run(sink.close())


def shapes_of(messages: list[tuple[str, list[object]]]) -> dict[str, float]:
    return {str(params[0]): float(params[1]) for address, params in messages if address == "/VMC/Ext/Blend/Val"}


def test_vmc_shows_the_face_and_applies_last(ear: Ear) -> None:
    stage = Stage("anna")
    sink = datagram_sink(stage.hub, parse_sink(f"vmc://127.0.0.1:{ear.port}"))
    stage.talk("anna")
    jaw, shown = [], {}
    for tick in range(60):
        stage.run(1)
        datagrams = ear.heard()
        messages = [(m.message.address, m.message.params) for data in datagrams for m in OscPacket(data).messages]
        assert messages[0] == ("/VMC/Ext/OK", [1])
        assert messages[1][0] == "/VMC/Ext/T"
        assert messages[1][1][0] == pytest.approx(tick / RATE_HZ, abs=1e-3)
        assert [params[0] for address, params in messages if "Bone" in address] == ["Head", "LeftEye", "RightEye"]
        assert messages[-1] == ("/VMC/Ext/Blend/Apply", [])
        shown |= shapes_of(messages)
        jaw.append(shown["jawOpen"])
        assert tick or set(shown) == set(ARKIT_NAMES)  # the first frame has all
    assert max(jaw) > 0.1
    assert jaw[-1] == 0.0
    asyncio.run(sink.close())


def test_vmc_spellings() -> None:
    stage = Stage("anna")
    with pytest.raises(UsageError, match="names: got 'klingon', expected one of arkit, pascal"):
        datagram_sink(stage.hub, parse_sink("vmc://127.0.0.1:9?names=klingon"))
    encoder = encoder_for("vmc://127.0.0.1:39540?names=pascal")
    (data, *_) = encoder.encode(stage.hub.tick(51.0))
    first = OscPacket(data).messages[0].message
    assert (first.address, first.params[0]) == ("/VMC/Ext/Blend/Val", "EyeBlinkLeft")  # a performer gets no bones


def test_vrchat_gets_what_changed_and_all_once_a_second(ear: Ear) -> None:
    stage = Stage("anna")
    sink = datagram_sink(stage.hub, parse_sink(f"vrchat://127.0.0.1:{ear.port}?prefix=FT/"))
    counts, jaw = [], []
    stage.run(1)
    counts.append(len(ear.messages()))
    stage.talk("anna")
    for _ in range(60):
        stage.run(1)
        found = dict(ear.messages())
        counts.append(len(found))
        jaw += found.get("/avatar/parameters/FT/v2/JawOpen", [])
    assert counts[0] == counts[60]
    assert max(counts[1:60]) < counts[0]
    assert max(jaw) > 0.1
    asyncio.run(sink.close())


def test_live_link_by_a_reader_of_its_own(ear: Ear) -> None:
    stage = Stage("anna")
    device = "01234567-89AB-CDEF-0123-456789ABCDEF"
    sink = datagram_sink(stage.hub, parse_sink(f"livelink://127.0.0.1:{ear.port}?name=Anna+B&device={device}"))
    stage.talk("anna")
    stage.run(25)
    jaw = []
    for tick, data in enumerate(ear.heard()):
        assert struct.unpack_from("<i", data) == (6,)
        assert data[4:41] == b"$" + device.encode()
        assert struct.unpack_from(">i", data, 41) == (6,)
        assert data[45:51] == b"Anna B"
        number, fraction, numerator, denominator, count = struct.unpack_from(">ifiiB", data, 51)
        assert (number, fraction, numerator, denominator, count) == (tick, 0.0, 60_000, 1000, 61)
        values = struct.unpack_from(">61f", data, 68)
        assert len(data) == 68 + 4 * 61
        jaw.append(values[17])
    assert len(jaw) == 25
    assert max(jaw) > 0.1
    asyncio.run(sink.close())


def test_a_live_link_device_is_the_same_at_every_start() -> None:
    stage = Stage("anna")
    frames = stage.hub.tick(51.0)
    one, two = (encoder_for("livelink://127.0.0.1").encode(frames) for _ in range(2))
    assert one == two
    assert b"fapengine" in one[0]


def test_a_face_stream_over_datagrams_can_be_joined_at_an_intra_plane(ear: Ear) -> None:
    stage = Stage("anna")
    sink = datagram_sink(stage.hub, parse_sink(f"fba://127.0.0.1:{ear.port}?intra=0.5"))
    stage.talk("anna")
    shown = stage.run(100)
    planes = ear.heard()
    assert len(planes) == 100
    begins = [place for place, plane in enumerate(planes) if joined(plane) is not None]
    assert begins == [0, 30, 60, 90]
    for begin in begins:
        decoder = Decoder()
        found = decoder.feed(joined(planes[begin]) + b"".join(planes[begin + 1 :]))
        assert decoder.rate_hz == RATE_HZ
        assert len(found) >= 100 - begin - 1
        for frame, sent in zip(found, shown[begin:], strict=False):
            np.testing.assert_allclose(frame.values[2:], sent.faps[0, 2:], atol=HALF_STEP)
    asyncio.run(sink.close())


def test_a_face_goes_out_over_rtp(ear: Ear) -> None:
    stage = Stage("anna")
    sink = datagram_sink(stage.hub, parse_sink(f"rtp://127.0.0.1:{ear.port}?intra=0.5"))
    stage.talk("anna")
    shown = stage.run(100)
    receiver = RtpReceiver()
    frames = [frame for packet in ear.heard() for _, frame in receiver.packet(packet)]
    assert len(frames) == 100
    for frame, sent in zip(frames, shown, strict=True):
        np.testing.assert_allclose(frame.values[2:], sent.faps[0, 2:], atol=HALF_STEP)
    asyncio.run(sink.close())


def test_skipped_frames_are_made_up_for_in_a_face_stream() -> None:
    face = FbaFrameEncoder(parse_sink("fba://127.0.0.1:9"), RATE_HZ)
    faps = np.full((1, 68), 7, np.int32)
    numbers = [0, 1, 5, 6]
    planes = [len(face.encode(HubFrames(number, number / 60, ("a",), faps))) for number in numbers]
    assert planes == [1, 1, 4, 1]
    assert len(face.encode(HubFrames(10**6, 10.0, ("a",), faps))) == 121


class Guest:
    """A TCP connection that reads when told."""

    def __init__(self, port: int, address: str = "127.0.0.1") -> None:
        self.socket = socket.socket()
        self.socket.bind((address, 0))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)

    async def read(self) -> bytes:
        return await asyncio.get_running_loop().sock_recv(self.socket, 1 << 16)

    async def read_all(self) -> bytes:
        found = b""
        while data := await self.read():
            found += data
        self.socket.close()
        return found


async def until(true: Callable[[], bool]) -> None:
    """Let the loop work until something is so."""
    for _ in range(200_000):
        if true():
            return
        await asyncio.sleep(0.001)
    raise AssertionError("it never became so")


async def settled() -> None:
    """Let what was closed be gone."""
    for _ in range(5):
        await asyncio.sleep(0)


def test_face_streams_begin_at_an_intra_plane_for_everybody() -> None:
    async def main() -> None:
        stage = Stage("anna")
        sink = await FaceStreams.open(stage.hub, SinkAddress("fba+tcp", "127.0.0.1", 0))
        stage.talk("anna")
        early = Guest(sink.port)
        await until(lambda: len(sink.listeners) == 1)
        first = stage.run(10)
        late = Guest(sink.port)
        await until(lambda: len(sink.listeners) == 2)
        second = stage.run(10)
        await sink.close()
        for guest, shown in ((early, first + second), (late, second)):
            decoder = Decoder()
            found = decoder.feed(await guest.read_all())
            assert decoder.ended
            assert decoder.rate_hz == RATE_HZ
            assert len(found) == len(shown)
            for frame, sent in zip(found, shown, strict=True):
                np.testing.assert_allclose(frame.values[2:], sent.faps[0, 2:], atol=HALF_STEP)
        await settled()

    asyncio.run(main())


def test_a_slow_reader_of_a_face_stream_loses_frames_and_never_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(face_streams, "UNREAD_BYTES", 2000)

    async def main() -> None:
        stage = Stage("anna")
        sink = await FaceStreams.open(stage.hub, parse_sink("fba+tcp://127.0.0.1:0?intra=0.2"))
        slow = Guest(sink.port)
        await until(lambda: len(sink.listeners) == 1)
        (listener,) = sink.listeners
        listener._link.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        stage.talk("anna")
        frames = stage.run(700)
        assert sink.counts.dropped > 200
        decoder, found = Decoder(), []
        while len(found) <= 100:  # it wakes up, and reads on
            frames += stage.run(10)
            await asyncio.sleep(0.001)
            with contextlib.suppress(BlockingIOError):
                found += decoder.feed(slow.socket.recv(1 << 16))
        sent = np.array([frame.faps[0, 2:] for frame in frames])
        seen = np.array([frame.values[2:] for frame in found])
        nearest = [np.abs(sent - one).max(axis=1).min() for one in seen]
        assert max(nearest) <= HALF_STEP
        await sink.close()
        slow.socket.close()
        await settled()

    asyncio.run(main())


def test_too_many_readers_are_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the places are for one address; another gets in."""
    monkeypatch.setattr(face_streams, "STREAMS", 4)

    async def main() -> None:
        stage = Stage("anna")
        sink = await open_sink(stage.hub, SinkAddress("fba+tcp", "127.0.0.1", 0))
        assert isinstance(sink, FaceStreams)
        first = Guest(sink.port)
        await until(lambda: len(sink.listeners) == 1)
        second = Guest(sink.port)
        assert await second.read() == b""
        assert len(sink.listeners) == 1
        third = Guest(sink.port, "127.0.0.2")
        await until(lambda: len(sink.listeners) == 2)
        for guest in (first, second, third):
            guest.socket.close()
        await until(lambda: not sink.listeners)
        stage.run(3)
        await sink.close()
        await settled()

    asyncio.run(main())


def test_a_sink_without_a_listener_costs_nothing_but_frames() -> None:
    stage = Stage("anna")
    closed = Ear()
    port = closed.port
    closed.socket.close()
    sink = datagram_sink(stage.hub, parse_sink(f"osc://127.0.0.1:{port}"))
    stage.run(5)
    assert sink.counts.sent + sink.counts.dropped == 5
    assert stage.hub.counts.listeners_dropped == 0
    asyncio.run(sink.close())


def test_what_the_system_does_not_take_is_counted() -> None:
    stage = Stage("anna")
    sink = datagram_sink(stage.hub, parse_sink("osc://255.255.255.255:9"))  # broadcast, which was not asked for
    stage.run(3)
    assert (sink.counts.sent, sink.counts.dropped) == (0, 3)
    asyncio.run(sink.close())


@pytest.mark.parametrize("kind", ["named", "vmc", "vrchat", "livelink", "fba"])
def test_a_face_at_rest_is_shown_once_before_there_is_one(ear: Ear, kind: str) -> None:
    """The server before may have been killed with the mouth open."""
    stage = Stage()
    sink = datagram_sink(stage.hub, parse_sink(f"{kind}://127.0.0.1:{ear.port}?session=anna"))
    stage.run(1)
    first = ear.heard()
    assert first
    if kind == "vmc":
        shown = [m.message for data in first for m in OscPacket(data).messages]
        assert not any(m.params[1] for m in shown if m.address == "/VMC/Ext/Blend/Val")
    stage.run(2)
    stage.hub.open("ben")  # another one's
    stage.run(2)
    assert ear.heard() == []
    stage.hub.open("anna")
    stage.hub.apply("anna", Express(Expression.JOY, attack_s=0.1))
    stage.run(10)
    assert len(ear.heard()) >= 9
    asyncio.run(sink.close())


def test_many_datagrams_go_at_once_and_none_is_joined_or_lost(ear: Ear) -> None:
    datagrams = [bytes([n % 256]) * (388 if n % 100 else 400) for n in range(150)] + [b"x" * 20_000] * 2 + [b"end"]
    for cuts in (True, False):
        post = opening.Post("127.0.0.1", ear.port)
        post._cuts &= cuts
        assert post.send(datagrams) == len(datagrams)
        assert ear.heard() == datagrams
        post.close()


def test_where_datagrams_cannot_go_at_once_they_go_one_by_one(ear: Ear, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "UDP_SEGMENT", 9999)  # which no system knows
    post = opening.Post("127.0.0.1", ear.port)
    assert post.send([b"a", b"b", b"c"]) == 3
    assert ear.heard() == [b"a", b"b", b"c"]
    assert not post._cuts
    assert post.send([b"x" * 70_000, b"d"]) == 1  # too large for a datagram
    post.close()


def test_nothing_is_sent_of_sessions_that_are_not_there(ear: Ear) -> None:
    stage = Stage()
    sink = datagram_sink(stage.hub, parse_sink(f"osc://127.0.0.1:{ear.port}"))
    stage.run(3)
    assert ear.heard() == []
    asyncio.run(sink.close())


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("smtp://127.0.0.1:1", f"one of {'://, '.join(SINK_NAMES)}://"),
        ("127.0.0.1:39539", "expected KIND://HOST:PORT"),
        ("osc://127.0.0.1", "without a port, expected osc://127.0.0.1:PORT"),
        ("osc://127.0.0.1:99999", "Port out of range"),
        ("osc://:9000", "expected osc://HOST:PORT"),
        ("osc://me@127.0.0.1:1", "expected osc://HOST:PORT"),
        ("osc://127.0.0.1:1/x", "expected osc://HOST:PORT"),
        ("osc://127.0.0.1:1?x=1", "got 'x', expected one of session"),
        ("vmc://127.0.0.1?prefix=1", "expected one of session, names"),
        ("osc://127.0.0.1:1?x", "bad query field"),
        ("vmc://127.0.0.1:0", "with port 0, expected 1 to 65535"),
        ("osc://127.0.0.1:1?session=", "a session of 0 bytes, expected 1 to 32"),
        ("osc://127.0.0.1:1?session=" + "x" * 33, "a session of 33 bytes, expected 1 to 32"),
    ],
)
def test_urls_that_are_no_sinks(url: str, what: str) -> None:
    with pytest.raises(UsageError, match=re.escape(what)):
        parse_sink(url)


def test_urls_are_spelled_back() -> None:
    for url in ("osc://127.0.0.1:9100", "vmc://[::1]:39539?session=anna"):
        assert str(parse_sink(url)) == url
    assert parse_sink("vrchat://localhost").port == 9000
    assert parse_sink("livelink://localhost").port == 11111


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("livelink://127.0.0.1?device=x", "sink livelink: device: got 'x'"),
        ("livelink://127.0.0.1?name=%00", "sink livelink: name: got"),
        ("vrchat://127.0.0.1?prefix=%00", "sink vrchat: OSC address: got"),
        ("vmc://127.0.0.1?names=klingon", "sink vmc: "),
        ("fba://127.0.0.1:1?intra=nan", "sink fba: intra: got"),
    ],
)
def test_options_are_checked_before_the_first_frame(url: str, what: str) -> None:
    with pytest.raises(UsageError, match=f"^{re.escape(what)}"):
        encoder_for(url)


def test_intra_must_be_seconds() -> None:
    for spelled in ("soon", "0", "61"):
        with pytest.raises(UsageError, match="intra: got"):
            encoder_for(f"fba://127.0.0.1:1?intra={spelled}")


def test_hosts_and_ports_that_cannot_be_had() -> None:
    stage = Stage("anna")
    with pytest.raises(ResourceError, match="expected a host that can be found"):
        datagram_sink(stage.hub, SinkAddress("osc", "no.such.host.invalid", 1))

    async def twice() -> None:
        sink = await FaceStreams.open(stage.hub, SinkAddress("fba+tcp", "127.0.0.1", 0))
        try:
            with pytest.raises(ResourceError, match=f"TCP port {sink.port} on 127.0.0.1"):
                await open_sink(stage.hub, SinkAddress("fba+tcp", "127.0.0.1", sink.port))
        finally:
            await sink.close()

    asyncio.run(twice())


def test_a_guard_puts_every_face_to_rest_that_was_open(ear: Ear) -> None:
    written = packed({"sessions": ["anna"]}) + packed({"sessions": ["anna", "ben"]}) + packed({"sessions": []})
    told: list[dict[str, float]] = []
    guards.watch(messages(io.BytesIO(written[:-1])), told.append)  # killed while it wrote
    assert [list(one) for one in told] == [["anna", "ben"]]
    kinds = ("osc", "vmc", "livelink", "fba", "fba+tcp")
    addresses = [parse_sink(f"{kind}://127.0.0.1:{ear.port}") for kind in kinds]
    addresses += [parse_sink("osc://no.such.host.invalid:1")]
    since_s = time.monotonic() - 10.0
    guards.send_neutral(addresses, {"anna": since_s, "ben": since_s}, RATE_HZ)
    found = ear.heard()
    frames = [decode_frame(data) for data in found if data.startswith(b"/fap")]
    assert [frame.session for frame in frames] == ["anna", "ben"] * guards.RESTS
    # The guard learns of a session a moment after its first frame, so its numbers must run ahead: by a second or more.
    assert all(frame.number >= 11 * RATE_HZ and not frame.values.any() for frame in frames)
    assert sum(data.startswith(b"#bundle") for data in found) >= guards.RESTS
    assert sum(data[4:5] == b"$" for data in found) == guards.RESTS
    assert sum(data.startswith(b"\0\0\1") for data in found) == guards.RESTS


def test_a_guard_shuts_the_mouth_of_a_face_stream_in_datagrams(ear: Ear) -> None:
    stage, address = Stage("anna"), parse_sink(f"fba://127.0.0.1:{ear.port}")
    sink = datagram_sink(stage.hub, address)
    stage.talk("anna")
    stage.run(20)
    decoder = Decoder()
    before = decoder.feed(b"".join(ear.heard()))
    assert before[-1].values[fap.column(3)] > 10
    guards.send_neutral([address], {"anna": time.monotonic()}, RATE_HZ)
    datagrams = ear.heard()
    assert len(datagrams) == guards.RESTS
    for datagram in datagrams:  # whichever of them are lost
        one = copy.deepcopy(decoder)
        assert not one.feed(datagram)[-1].values.any()
    asyncio.run(sink.close())


def test_a_guard_shuts_the_mouth_of_an_rtp_stream(ear: Ear) -> None:
    stage, address = Stage("anna"), parse_sink(f"rtp://127.0.0.1:{ear.port}")
    sink = datagram_sink(stage.hub, address)
    stage.talk("anna")
    stage.run(20)
    receiver = RtpReceiver()
    before = [frame for packet in ear.heard() for _, frame in receiver.packet(packet)]
    assert before[-1].values[fap.column(3)] > 10
    guards.send_neutral([address], {"anna": time.monotonic()}, RATE_HZ)
    datagrams = ear.heard()
    assert len(datagrams) == guards.RESTS
    after = [frame for packet in datagrams for _, frame in receiver.packet(packet)]
    assert [frame.values.any() for frame in after] == [False]  # sent again they are the same packet
    asyncio.run(sink.close())


def test_a_guard_that_is_told_goodbye_does_nothing() -> None:
    reading, writing = os.pipe()
    guard = guards.Watchdog(0, writing)
    os.set_blocking(writing, False)
    guard.tell(("anna",))
    guard.tell(("anna",))
    many = tuple(f"session number {number}" for number in range(4000))
    guard.tell(many)  # more than the pipe holds
    guard.tell((*many, "ben"))
    received = bytearray(os.read(reading, 1 << 20))
    while guard._begun:
        guard.tell((*many, "ben"))
        received += os.read(reading, 1 << 20)
    told = list(unpacked(received))
    assert [head["sessions"] for head, _ in told] == [["anna"], [*many], [*many, "ben"]]
    os.close(reading)
    os.close(writing)
    guards.watch([*told, ({"bye": True}, b"")], lambda sessions: pytest.fail("it was told goodbye"))


@pytest.mark.parametrize("fault", [None, RuntimeError("a bug")])
def test_only_a_good_end_says_goodbye(fault: Exception | None) -> None:
    reading, writing = os.pipe()
    process = os.fork()
    if not process:
        os._exit(0)
    with contextlib.suppress(RuntimeError), guards.Watchdog(process, writing) as guard:
        guard.tell(("anna",))
        if fault is not None:
            raise fault
    told: list[object] = []
    with os.fdopen(reading, "rb") as stream:
        guards.watch(messages(stream), told.append)
    assert len(told) == (fault is not None)


def test_a_face_that_comes_back_is_followed_again() -> None:
    faces = OscFrameEncoder(parse_sink("osc://127.0.0.1:9"), RATE_HZ)
    faps = np.ones((1, 68), np.int32)
    sent = [len(faces.encode(HubFrames(n, float(n), names, faps[: len(names)]))) for n, names in
            enumerate([("a",), (), (), ("a",)])]  # fmt: skip
    assert sent == [1, 1, 0, 1]


def test_every_kind_is_opened_by_its_row_alone() -> None:
    assert len({kind.name for kind in SINK_KINDS}) == len(SINK_KINDS) >= 13
    for kind in SINK_KINDS:
        url = kind.spelled.replace("[HOST]", "").replace("HOST", "127.0.0.1").replace("PORT", "1").replace("[:1]", "")
        address = parse_sink(re.sub(r"\[:(\d+)\]", r":\1", url))
        assert kind_of(address) is kind
        assert address.port == (kind.port or (1 if kind.has_host else 0))


@pytest.mark.parametrize("kind", SINK_KINDS, ids=lambda kind: kind.name)
def test_a_kind_names_what_opens_it(kind: SinkKind) -> None:
    takes = {
        "datagrams": ["address", "rate_hz", "epochs"],
        "connections": ["hub", "address"],
        "video": ["studio", "address", "head"],
    }
    assert list(inspect.signature(opener(kind)).parameters) == takes[kind.medium]


def test_every_kind_of_datagrams_writes_its_own() -> None:
    """A kind without an encoder of its own would send what another one sends."""
    frames = HubFrames(0, 1.0, ("anna",), np.full((1, 68), 3, np.int32))
    kinds = [kind for kind in SINK_KINDS if kind.medium == "datagrams"]
    sent = {}
    for kind in kinds:
        encoder = encoder_for(f"{kind.name}://127.0.0.1:{kind.port or 1}")
        sent[kind.name] = b"".join(encoder.encode(frames))
        encoder.resume({"anna": 100})
    assert all(sent.values())
    assert len(set(sent.values())) == len(kinds) >= 7


def test_ports_of_programs_are_those_of_their_protocols() -> None:
    ports = {kind.name: kind.port for kind in SINK_KINDS}
    assert ports["vmc"] == vmc.MARIONETTE_PORT
    assert ports["vrchat"] == vrchat.PORT
    assert ports["livelink"] == livelink.PORT
    assert ports["vts"] == vts.PORT
    assert vmc.PERFORMER_PORT == PERFORMER_PORT
