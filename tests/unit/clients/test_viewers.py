"""A live face from elsewhere: from a real server over its WebSocket, and from datagrams."""

import asyncio
import contextlib
import io
import signal
import socket
import subprocess
import sys
import threading
import time
import wave
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st

from fapengine.app.view import PAUSE, STOP, ServerSource
from fapengine.audio.output import SilentOutput
from fapengine.clients import websocket_viewer
from fapengine.clients.osc_viewer import OscViewer
from fapengine.clients.websocket_viewer import AnnouncedSound, ViewerSound, WebSocketViewer, parse_wav, web_socket_of
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.mpeg4 import fap
from fapengine.server.web.messages import pack_frame, text_of
from fapengine.wire.fap_osc import FapFrame, SessionFrames, encode_frame
from tests.patient import until_delivered
from tests.processes import free_port, start


def until(done: Callable[[], bool], seconds: float = 300.0) -> bool:
    stop = time.monotonic() + seconds
    while time.monotonic() < stop:
        if done():
            return True
        time.sleep(0.02)
    return False


def serve(port: int, head: Path, *more: str) -> subprocess.Popen[bytes]:
    ports = ("--port", "0", "--web-port", str(port))
    command = [sys.executable, "-m", "fapengine", "serve", *ports, "--without", "all", "--head", str(head), *more]
    return start(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wav(frames: bytes, *, channels: int = 1, width: int = 2, rate_hz: int = 8000) -> bytes:
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as out:
        out.setparams((channels, width, rate_hz, 0, "NONE", ""))
        out.writeframes(frames)
    return buffer.getvalue()


def opening(faps: np.ndarray) -> float:
    return -float(faps[fap.column(51)] + faps[fap.column(52)])


def test_a_viseme_of_a_live_stream_opens_the_mouth() -> None:
    values, mask, viseme = np.zeros(68, np.int32), np.arange(68) == 0, np.array([10, 0, 63, 0])
    viewer = OscViewer("127.0.0.1", 0)
    try:
        frame = FapFrame(
            session="a",
            number=0,
            time_us=0,
            values=values,
            mask=mask,
            visemes=viseme,
            expressions=np.zeros(6, np.int32),
        )
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(encode_frame(frame), ("127.0.0.1", viewer.port))
        while not viewer.counts.frames:
            shown = viewer.faps()
        assert shown[fap.column(3)] > 300
    finally:
        viewer.close()


def test_a_server_is_watched_told_lost_and_found_again(coarse_head: Path) -> None:
    port = free_port()
    server = serve(port, coarse_head)
    link = WebSocketViewer(f"http://127.0.0.1:{port}/", session="anna")
    try:
        assert not link.faps().any()
        link.send("blink")  # nobody is there yet: nothing happens
        assert until(lambda: link.counts.frames > 5)
        assert link.state == "open"
        assert link.hello["type"] == "hello"
        assert until(lambda: link.age_s is not None)
        assert -0.01 < link.age_s < 60
        assert 0 < link.round_trip_s < 60
        link.send("say", text="Mama, papa.", voice="en-us")
        assert until(lambda: opening(link.faps()) > 80)
        server.send_signal(signal.SIGKILL)
        server.wait()
        assert until(lambda: link.state == "lost")
        assert not link.faps().any()  # the mouth does not stay open
        assert link.trouble
        assert link.age_s is None
        server = serve(port, coarse_head)
        before = link.counts.frames
        assert until(lambda: link.counts.frames > before)
        assert link.counts.refused == 0
        play_here(port)
    finally:
        link.close()
        server.terminate()
        server.wait()
    assert not link._thread.is_alive()


def play_here(port: int) -> None:
    """The server's sound is played here, and its face follows; a sound that is cancelled ends."""
    link = WebSocketViewer(f"http://127.0.0.1:{port}/", session="bob", plays=True)
    opened: list[SilentOutput] = []

    def opens(rate_hz: int) -> SilentOutput:
        opened.append(SilentOutput(rate_hz, "a test"))
        return opened[-1]

    sound = ViewerSound(link, opens=opens)
    try:
        assert until(lambda: link.age_s is not None)
        link.send("say", text="Mama, papa.", voice="en-us")
        seen: list[tuple[float, float]] = []

        def step() -> bool:
            now_s = time.monotonic()
            sound.play(now_s)
            if opened:
                seen.append((opened[0].position_s(1, now_s) or 0.0, opening(link.faps())))
            return bool(seen) and not sound.playing

        assert until(step)
        assert opened[0].is_over(1, time.monotonic())
        assert max(wide for _, wide in seen) > 80
        assert max(place for place, _ in seen) > 0.8
        assert until(lambda: not link.is_speaking)
        source = ServerSource(link, sound=sound)
        source.press(PAUSE)  # nothing is said
        link.send("say", text="This one is held, goes on, and is stopped in its midst.", voice="en-us")

        def shown(wide: bool) -> bool:
            time.sleep(0.02)
            return (opening(source.frame(0.0)) > 80) == wide

        assert until(lambda: shown(wide=True))
        source.press(PAUSE)
        assert until(lambda: all(shown(wide=False) for _ in range(20)))
        assert source.is_paused
        assert sound.playing
        place_s = opened[0].position_s(2, time.monotonic())
        source.press(PAUSE)
        assert until(lambda: shown(wide=True))
        assert opened[0].position_s(2, time.monotonic()) > place_s
        source.press(STOP)
        assert not sound.playing
        assert until(lambda: shown(wide=False) and not link.is_speaking)
        assert link.counts.refused == 0
    finally:
        sound.close()
        link.close()


class SoundServer:
    """Stateful: a server that tells those who come of sounds, and hands them out; one of them not before it is let."""

    def __init__(self, *texts: str, sounds: Mapping[str, bytes], held: str = "") -> None:
        self._texts, self._sounds, self._held = texts, sounds, held
        self._is_let = asyncio.Event()
        self.port = free_port()
        self.loop = asyncio.new_event_loop()
        self.socket: web.WebSocketResponse
        self._is_up = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._is_up.wait(300)

    def tell(self, text: str) -> None:
        asyncio.run_coroutine_threadsafe(self.socket.send_str(text), self.loop).result(300)

    def let(self) -> None:
        self.loop.call_soon_threadsafe(self._is_let.set)

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join(300)

    def _run(self) -> None:
        app = web.Application()
        app.router.add_get("/ws", self._talk)
        app.router.add_get("/sound.wav", self._sound)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        self.loop.run_until_complete(runner.setup())
        self.loop.run_until_complete(web.TCPSite(runner, "127.0.0.1", self.port).start())
        self._is_up.set()
        self.loop.run_forever()
        self.loop.run_until_complete(runner.cleanup())
        self.loop.close()

    async def _talk(self, request: web.Request) -> web.WebSocketResponse:
        self.socket = web.WebSocketResponse()
        await self.socket.prepare(request)
        for text in self._texts:
            await self.socket.send_str(text)
        async for _ in self.socket:
            pass
        return self.socket

    async def _sound(self, request: web.Request) -> web.Response:
        if request.query["utterance"] == self._held:
            await self._is_let.wait()
        return web.Response(body=self._sounds[request.query["utterance"]])


def sound_text(utterance: int) -> str:
    return text_of("sound", utterance=utterance, url=f"/sound.wav?utterance={utterance}", text="")


def test_a_server_that_is_full_says_so(coarse_head: Path, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text("[limits]\nsessions = 1\n")
    port = free_port()
    server = serve(port, coarse_head, "--config", str(tmp_path / "small.toml"))
    first = WebSocketViewer(f"http://127.0.0.1:{port}/", session="anna")
    try:
        assert until(lambda: first.state == "open")
        second = WebSocketViewer(f"http://127.0.0.1:{port}/", session="berta")
        try:
            assert until(lambda: "sessions" in second.trouble)
            assert second.state == "lost"
        finally:
            second.close()
    finally:
        first.close()
        server.kill()
        server.wait()


def test_a_long_sound_is_had_whole_and_one_without_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = np.arange(220_500).astype(np.int16)  # 10 s
    sounds = {"1": wav(samples.astype("<i2").tobytes(), rate_hz=22_050), "2": wav(bytes(500_000))}
    monkeypatch.setattr(websocket_viewer, "MAX_SOUND", 450_000)
    server = SoundServer(sound_text(1), sound_text(2), sounds=sounds)
    link = WebSocketViewer(f"http://127.0.0.1:{server.port}/", plays=True)
    try:
        heard: list[AnnouncedSound] = []
        assert until(lambda: bool(heard.extend(link.sounds()) or (heard and link.counts.refused)))
        assert [one.utterance for one in heard] == [1]
        np.testing.assert_array_equal(heard[0].samples, samples)
    finally:
        link.close()
        server.close()


def test_sounds_come_in_the_order_in_which_they_were_said_and_none_that_was_cancelled_meanwhile() -> None:
    sounds = {str(number): wav(bytes(2 * number)) for number in (1, 2, 3, 4)}
    server = SoundServer(*map(sound_text, (1, 2, 3)), sounds=sounds, held="1")
    link = WebSocketViewer(f"http://127.0.0.1:{server.port}/", plays=True)
    try:
        assert until(lambda: 3 in link._fetching)
        time.sleep(0.1)  # 3 would be here, if it did not wait for 1
        server.tell(text_of("event", kind="cancelled", utterance=2, time_s=0.0, count=1))
        assert until(lambda: link.ended() == [2])
        server.let()
        heard: list[int] = []
        assert until(lambda: bool(heard.extend(one.utterance for one in link.sounds()) or len(heard) == 2))
        assert heard == [1, 3]
        server.tell(sound_text(4))
        assert until(lambda: bool(link._sounds))
        assert not link._fetching
        assert link.counts.refused == 0
    finally:
        link.close()
        server.close()


class StubLink:
    state, age_s = "open", 0.02

    def __init__(self) -> None:
        self.queue = [AnnouncedSound(7, np.ones(8000, np.int16), 8000)]
        self.over: list[int] = []
        self.sent: list[dict[str, float]] = []

    def sounds(self) -> list[AnnouncedSound]:
        taken, self.queue = self.queue, []
        return taken

    def ended(self) -> list[int]:
        taken, self.over = self.over, []
        return taken

    def server_s(self, now_s: float) -> float | None:
        return now_s + 1000.0

    def send(self, kind: str, **fields: float) -> None:
        assert kind == "audio"
        self.sent.append(fields)


def test_the_server_is_told_where_the_sound_is_and_when_it_stands() -> None:
    now = [5.0]
    link, made = StubLink(), []

    def opens(rate_hz: int) -> SilentOutput:
        made.append(SilentOutput(rate_hz, "", now=lambda: now[0]))
        return made[-1]

    sound = ViewerSound(link, opens=opens)

    def run(seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            now[0] += 0.01
            sound.play(now[0])

    run(0.5)
    assert 15 <= len(link.sent) <= 26  # every 20 ms, at frames
    last = link.sent[-1]
    assert last["utterance"] == 7
    assert last["position_s"] == pytest.approx(last["at_s"] - 1005.0 + 0.02, abs=0.015)  # ahead by a frame's way
    sound.pause(True)
    told = len(link.sent)
    run(0.3)
    assert [one["rate"] for one in link.sent[told:]] == [0.0]  # the face stands already
    told = len(link.sent)
    run(0.3)
    assert len(link.sent) == told
    sound.pause(False)
    run(0.1)
    assert link.sent[-1]["rate"] == 1.0
    link.queue.append(AnnouncedSound(8, np.ones(8000, np.int16), 8000))
    link.over.append(7)
    run(0.2)
    assert link.sent[-1]["utterance"] == 8  # what waited behind goes on
    link.over.append(8)
    run(0.02)
    assert not sound.playing
    link.queue.append(AnnouncedSound(8, np.ones(800, np.int16), 8000))
    run(0.03)
    assert sound.playing
    run(0.2)
    assert not sound.playing
    sound.pause(True)
    link.queue.append(AnnouncedSound(9, np.ones(4000, np.int16), 4000))
    run(0.3)
    assert made[-1].position_s(1, now[0]) == pytest.approx(0.01)  # of another rate: it stands still, too
    link.state = "lost"
    run(0.02)
    assert not sound.playing
    sound.close()


@pytest.mark.parametrize("data", [b"", b"RIFF", b"RIFF\x24\0\0\0WAVEfmt \x10\0\0\0"])
def test_a_sound_that_is_none_is_refused(data: bytes) -> None:
    with pytest.raises(DataError, match="sound: is not a WAV file"):
        parse_wav(data)


def test_sounds_of_one_and_two_channels_are_read() -> None:
    mono, rate_hz = parse_wav(wav(bytes(range(8))))
    assert (mono.tolist(), rate_hz) == ([0x0100, 0x0302, 0x0504, 0x0706], 8000)
    assert parse_wav(wav(bytes(range(16)), channels=2))[0].tolist() == [0x0100, 0x0504, 0x0908, 0x0D0C]
    with pytest.raises(DataError, match="got 8 bits at 8000 Hz, expected 16"):
        parse_wav(wav(bytes(range(4)), width=1))


@given(st.binary(max_size=200))
def test_any_bytes_are_a_sound_or_a_data_error(data: bytes) -> None:
    with contextlib.suppress(DataError):
        parse_wav(b"RIFF\x64\0\0\0WAVEfmt \x10\0\0\0\x01\0" + data)


def test_what_is_no_message_is_counted() -> None:
    link = WebSocketViewer("http://127.0.0.1:9/")
    link.close()
    link.close()
    for data in (b"", pack_frame(1, 0.0, np.zeros(68, np.int32))[:-1], b"\0" * websocket_viewer.FRAME.size):
        link._take_frame(data)
    endless, deep = '{"type": "pong", "number": 1e999, "time_s": 0}', "[" * 100_000
    for text in ("{", "[]", "{}", endless, deep, text_of("pong", number="x", time_s=1), text_of("pong", number=1)):
        link._take_text(text)
    assert link.counts.refused == 10
    link._take_text(text_of("pong", number=77, time_s=1.0))  # to a question that was not asked
    link._take_text(text_of("utterance", number=1))  # for pages alone
    assert link.round_trip_s is None
    for number in (4, 5, 8):
        link._take_frame(pack_frame(number, 0.0, np.arange(68, dtype=np.int32)))
    assert (link.counts.frames, link.counts.missed, link.counts.refused) == (3, 2, 10)
    np.testing.assert_array_equal(link.faps(), np.arange(68))


@pytest.mark.parametrize("url", ["127.0.0.1:8110", "ftp://host/", "http:///x", "http://[::1", ""])
def test_refuses_an_address(url: str) -> None:
    with pytest.raises(UsageError, match=r"source: got .*, expected an address such as http"):
        web_socket_of(url)


def test_aiohttp_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with pytest.raises(ResourceError, match=r"pip install \"fapengine\[live\]\""):
        WebSocketViewer("http://127.0.0.1:9/")


# Datagrams


def frame(number: int, values: dict[int, int], *, time_us: int | None = None, session: str = "anna") -> bytes:
    row, mask = np.zeros(68, np.int32), np.zeros(68, bool)
    for fap_number, value in values.items():
        row[fap.column(fap_number)], mask[fap.column(fap_number)] = value, True
    nothing = {"visemes": np.zeros(4, np.int32), "expressions": np.zeros(6, np.int32)}
    time_us = number * 10_000 if time_us is None else time_us
    return encode_frame(FapFrame(session=session, number=number, time_us=time_us, values=row, mask=mask, **nothing))


class Sender:
    def __init__(self, port: int) -> None:
        self._to = ("127.0.0.1", port)

    def __call__(self, *datagrams: bytes) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for data in datagrams:
                out.sendto(data, self._to)
        until_delivered()


def test_frames_come_by_datagram() -> None:
    now = [5.0]
    frames = OscViewer("127.0.0.1", 0, clock=lambda: now[0])
    send = Sender(frames.port)
    assert frames.is_silent
    assert not frames.faps().any()
    send(frame(1, {3: 100, 5: 7}), frame(2, {3: 150}))
    faps = frames.faps()
    assert (faps[fap.column(3)], faps[fap.column(5)]) == (150, 7)  # FAP 5 keeps its value
    assert not frames.is_silent
    assert frames.session == "anna"
    send(frame(1, {3: 999}), frame(3, {3: 888}, session="bob"))
    assert frames.faps()[fap.column(3)] == 150  # too late; somebody else's
    send(frame(6, {3: 160}), b"junk", b"/other\0\0,\0\0\0")
    assert frames.faps()[fap.column(3)] == 160
    assert (frames.counts.frames, frames.counts.missed, frames.counts.refused) == (3, 3, 2)
    send(frame(1, {3: 5}, time_us=99_000_000))  # the sender began anew
    assert frames.faps()[fap.column(3)] == 5
    now[0] += 3.0
    assert frames.is_silent
    frames.close()


def test_a_servers_stream_is_understood() -> None:
    frames = OscViewer("127.0.0.1", 0, session="b")
    stream = SessionFrames()
    rows = np.zeros((2, 68), np.int32)
    rows[1, fap.column(3)] = 70
    Sender(frames.port)(*stream.encode(("a", "b"), rows, 1000))
    assert frames.faps()[fap.column(3)] == 70
    frames.close()


def test_a_port_that_is_taken_is_said() -> None:
    first = OscViewer("127.0.0.1", 0)
    with pytest.raises(ResourceError, match=rf"osc://127\.0\.0\.1:{first.port}: got .*, expected a port that is free"):
        OscViewer("127.0.0.1", first.port)
    first.close()
