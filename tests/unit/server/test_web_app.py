"""The web server over real sockets: who is let in, what is served, what a page may do to it."""

import asyncio
import gzip
import json
import socket
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from aiohttp import ClientError, ClientWebSocketResponse, WSMsgType, WSServerHandshakeError, web
from aiohttp.test_utils import TestClient, TestServer
from yarl import URL

from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits
from fapengine.errors import ElsewhereError
from fapengine.files.provenance import SYNTHETIC
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.host.speaker import ThreadVoice
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.server.intake import rates
from fapengine.server.intake.doors import Door
from fapengine.server.web import app as web_app
from fapengine.server.web import connection as connections
from fapengine.server.web.access import Access
from fapengine.server.web.app import COUNTS, DEFAULT_CHOICE, make_app
from fapengine.server.web.messages import FRAME, SOUND_HEAD, SOUND_KIND
from fapengine.server.web.page_files import Heads
from fapengine.server.web.site import Site, open_site
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.protocol import Speech
from tests.direct_recognizer import DirectRecognizer
from tests.english import english
from tests.patient import PatientClock
from tests.unit.recognition.speech import spoken_by_espeak

LIMIT_S = 300.0
Use = Callable[[TestClient, Hub], Awaitable[None]]


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def serve(
    head: FaceMesh,
    use: Use,
    *,
    token: str | None = None,
    sessions: int = 4,
    voice: VoiceChoice = DEFAULT_CHOICE,
    origins: tuple[str, ...] = (),
) -> None:
    """Run a server, and a client against it."""

    async def run() -> None:
        engine = Engine(
            english(), rng=np.random.default_rng(1), style=Style.speech_only(), limits=Limits(sessions=sessions)
        )
        hub = Hub(engine, rate_hz=100.0)
        app = make_app(hub, head, access=Access(token, origins), profile="grid_s1_en", voice=voice)
        async with asyncio.timeout(LIMIT_S), TestClient(TestServer(app)) as client:
            ticking = asyncio.create_task(hub.run())
            try:
                await use(client, hub)
            finally:
                hub.stop()
                await ticking
        assert app[COUNTS].pages == 0

    asyncio.run(run())


async def text_from(socket: ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    """The next JSON message of a kind."""
    while True:
        message = await socket.receive()
        assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), message
        if message.type is WSMsgType.TEXT and (said := json.loads(message.data))["type"] == kind:
            return said


async def frame_from(socket: ClientWebSocketResponse) -> tuple[int, float, np.ndarray]:
    while True:
        message = await socket.receive()
        if message.type is WSMsgType.BINARY:
            kind, number, time_s, *faps = FRAME.unpack(message.data)
            assert kind == 1
            return number, time_s, np.array(faps)


def test_the_page_and_all_that_it_asks_for_is_served(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        kinds = {
            "/": "text/html",
            "/main.js": "text/javascript",
            "/face/session.js": "text/javascript",
            "/style.css": "text/css",
            "/icon.svg": "image/svg+xml",
            "/setup.json": "application/json",
            "/head.bin": "application/octet-stream",
        }
        for path, kind in kinds.items():
            async with client.get(path) as answer:
                assert (answer.status, answer.content_type) == (200, kind), path
                assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
                packed = await answer.read()  # the client asks for gzip and unpacks it
            async with client.get(path, headers={"Accept-Encoding": "identity"}) as answer:
                assert "Content-Encoding" not in answer.headers
                assert await answer.read() == packed
        for path in ("/index.html", "/../app.py", "/app.py", "/sound.wav", "/sound.wav?utterance=x"):
            async with client.get(path) as answer:
                assert answer.status == 404, path

    serve(head, use)


def test_pages_of_sites_that_are_named_may_ask_and_of_no_others(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        for origin, status in (("https://shop.example", 200), ("https://example", 403), ("null", 403)):
            async with client.get("/head.bin", headers={"Origin": origin}) as answer:
                assert answer.status == status
                allowed = answer.headers.get("Access-Control-Allow-Origin")
                assert (allowed, answer.headers["Vary"]) == (origin if status == 200 else None, "Origin")
        async with client.ws_connect("/ws", headers={"Origin": "https://shop.example"}) as socket:
            assert (await text_from(socket, "hello"))["session"] == "face"
        with pytest.raises(WSServerHandshakeError):
            await client.ws_connect("/ws", headers={"Origin": "https://example"})

    serve(head, use, origins=("https://shop.example",))


def test_another_face_is_built_when_it_is_asked_for(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    async def packed(_: Heads, name: str) -> bytes:
        asked.append(name)
        return gzip.compress(b"FAPHEAD1")

    monkeypatch.setattr(Heads, "packed", packed)

    async def use(client: TestClient, hub: Hub) -> None:
        async with client.get("/setup.json") as answer:
            assert list((await answer.json())["heads"]) == ["", "default", "woman", "man", "child", "older"]
        for accepted in ("gzip", "identity"):
            async with client.get("/head.bin?name=woman", headers={"Accept-Encoding": accepted}) as answer:
                assert answer.status == 200
                assert await answer.read() == b"FAPHEAD1"
        for name in ("nobody", "../folder", "random:7"):
            async with client.get("/head.bin", params={"name": name}) as answer:
                assert answer.status == 404
        assert asked == ["woman", "woman"]

    serve(head, use)


def test_a_page_that_nobody_sees_is_sent_no_frames(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            assert (await text_from(socket, "hello"))["manner"]["idle"] == 0.0
            await frame_from(socket)
            await socket.send_json({"type": "watch", "on": False})
            await socket.send_json({"type": "manner", "setting": "jaw", "value": 0.5})
            assert (await text_from(socket, "manner")) == {"type": "manner", "setting": "jaw", "value": 0.5}
            await asyncio.sleep(0.1)  # ten frames of its server
            await socket.send_json({"type": "ping", "number": 1})
            came = [(await socket.receive()).type]
            while came[-1] is not WSMsgType.TEXT:
                came.append((await socket.receive()).type)
            assert len(came) <= 2  # one frame may have been on its way
            await socket.send_json({"type": "watch", "on": True})
            await frame_from(socket)
        async with client.ws_connect("/ws?session=anna") as socket:
            assert (await text_from(socket, "hello"))["manner"]["jaw"] == 0.5

    serve(head, use)


def test_words_and_phones_go_on_with_an_utterance(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:

            async def tell(kind: str, **fields: object) -> dict[str, Any]:
                await socket.send_json({"type": kind, **fields})
                return await text_from(socket, "words")

            late_s = hub.clock() + 30.0
            number = (await tell("words", words=[["Mama", 0.3, 0.9]], at_s=late_s, last=False))["utterance"]
            for words in ([["may", 1.0, 1.3]], [["go", 1.3, 1.6]]):
                assert (await tell("words", words=words, utterance=number, last=False))["utterance"] == number
            utterance = hub.engine.utterance("anna", number)
            assert utterance is not None
            assert utterance.phone_count is None
            said = [utterance.phones[index].word for index in sorted(utterance.phones)]
            assert [word for word in dict.fromkeys(said) if word] == ["Mama", "may", "go"]
            await socket.send_json({"type": "words", "words": [["late", 0.2, 0.3]], "utterance": number})
            assert "expected it after 1.6 s" in (await text_from(socket, "error"))["message"]
            await tell("words", words=[], utterance=number)
            assert utterance.phone_count == len(said)
            await socket.send_json({"type": "words", "words": [["more", 3.0, 3.3]], "utterance": number})
            assert "ended" in (await text_from(socket, "error"))["message"]
            assert (await tell("words", words=[], utterance=number + 5))["utterance"] is None

            labels = [["M", 0.0, 0.1], ["AA1", 0.1, 0.3]]
            number = (await tell("phones", phones=labels, set="arpabet", last=False))["utterance"]
            await tell("phones", phones=[["m", 0.4, 0.5]], utterance=number)
            utterance = hub.engine.utterance("anna", number)
            assert utterance is not None
            assert [(phone.label, phone.stress) for phone in utterance.phones.values()] == [
                ("m", 0),
                ("ɑ", 1),
                ("m", 0),
            ]
            await socket.send_json({"type": "phones", "phones": labels, "set": "klingon"})
            assert "arpabet" in (await text_from(socket, "error"))["message"]

    serve(head, use)


def test_hello_comes_first_then_frames_at_the_rate(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            hello = await socket.receive_json()
            assert hello.items() >= {
                "type": "hello", "protocol": "fapengine-web/1", "session": "anna", "rate_hz": 100.0,
                "profile": "grid_s1_en", "sound": "page", "paused": False, "digitalSourceType": SYNTHETIC,
            }.items()  # fmt: skip
            frames = [await frame_from(socket) for _ in range(20)]
            numbers, times = [frame[0] for frame in frames], np.array([frame[1] for frame in frames])
            assert numbers == sorted(set(numbers))
            assert (np.diff(times) > 0).all()
            await socket.send_json({"type": "ping", "number": 7})
            pong = await text_from(socket, "pong")
            assert pong["number"] == 7
            assert times[-1] <= pong["time_s"] <= hub.clock()

    serve(head, use)


def test_a_slider_holds_a_fap_and_lets_it_go(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await socket.send_json({"type": "pin", "values": {"3": 512}})
            assert (await text_from(socket, "pins"))["values"] == {}
            assert (await text_from(socket, "pins"))["values"] == {"3": 512}
            while (await frame_from(socket))[2][fap.column(3)] != 512:
                pass
            await socket.send_json({"type": "release"})
            while (await frame_from(socket))[2][fap.column(3)] == 512:
                pass

    serve(head, use)


def test_a_camera_moves_a_face_while_it_sends(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await socket.send_json({"type": "perform", "values": {"3": 512}})
            while (await frame_from(socket))[2][fap.column(3)] != 512:
                pass
            while (await frame_from(socket))[2][fap.column(3)] != 0:  # nothing more comes, so it is let go
                pass
            assert hub.host("face").pins == {}

    serve(head, use)


def test_words_with_times_move_the_lips_and_a_cancel_empties_them(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            words = [["Mama", 0.3, 0.9], ["may", 1.0, 1.3]]
            await socket.send_json({"type": "words", "words": words, "voice": "en-gb", "at_s": hub.clock() + 0.1})
            phones = (await text_from(socket, "phones"))["phones"]
            assert [phone[0] for phone in phones if phone[0] != "_"][:2] == ["m", "a"]  # en-gb; en-us says ɑː
            number = (await text_from(socket, "words"))["utterance"]
            while (await frame_from(socket))[2][fap.column(3)] < 50:
                pass
            assert hub.engine.state("anna") == "speaking"
            await socket.send_json({"type": "cancel"})
            event = await text_from(socket, "event")
            while event["kind"] != "cancelled":
                event = await text_from(socket, "event")
            assert event["utterance"] == number
            while (await frame_from(socket))[2][fap.column(3)] != 0:
                pass
            await socket.send_json({"type": "words", "words": [["b", 1.0, 2.0], ["a", 0.1, 0.5]]})
            assert "starts at" in (await text_from(socket, "error"))["message"]
            await socket.send_json({"type": "words", "words": [["b", 1.0]]})
            assert "words" in (await text_from(socket, "error"))["message"]

    serve(head, use)


def test_a_text_becomes_phones_frames_and_sound(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            await socket.send_json({"type": "say", "text": "Mama."})
            phones = (await text_from(socket, "phones"))["phones"]
            assert [phone[0] for phone in phones if phone[3]] == ["m", "ɑː", "m", "ɐ"]
            sound = await text_from(socket, "sound")
            async with client.get(sound["url"]) as answer:
                assert answer.content_type == "audio/wav"
                assert (await answer.read())[:4] == b"RIFF"
            event = await text_from(socket, "event")
            assert (event["kind"], event["utterance"]) == ("started", sound["utterance"])
            jaw = [(await frame_from(socket))[2][fap.column(3)] for _ in range(60)]
            assert max(jaw) > 100

    serve(head, use)


def test_a_page_that_comes_in_a_pause_is_told_so(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            await socket.send_json({"type": "say", "text": "Mama."})
            await text_from(socket, "sound")
            await socket.send_json({"type": "pause"})
            await socket.send_json({"type": "ping", "number": 1})
            await text_from(socket, "pong")
        async with client.ws_connect("/ws?session=anna") as socket:
            assert (await socket.receive_json())["paused"] is True

    serve(head, use)


def test_the_face_waits_for_the_sound_of_a_page_that_plays(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            await socket.send_json({"type": "plays", "on": True})
            await socket.send_json({"type": "say", "text": "Papa."})
            number = (await text_from(socket, "sound"))["utterance"]
            assert hub.engine.state("anna") == "waiting"
            at_s = hub.clock()
            await socket.send_json({"type": "audio", "utterance": number, "at_s": at_s, "position_s": 0.1})
            place = await text_from(socket, "position")
            assert place["position_s"] == pytest.approx(0.1 + place["time_s"] - at_s, abs=0.02)

    serve(head, use)


@pytest.mark.parametrize(
    ("sent", "complaint"),
    [
        ({"type": "say", "text": "..."}, "contains nothing to speak"),
        ({"type": "say", "text": "Hello", "voice": "klingonish"}, "voice: got 'klingonish'"),
        ({"type": "say", "text": "Hello", "voice": "piper:/x.onnx"}, "voice: got 'piper:/x.onnx', expected a language"),
        ({"type": "shout"}, "expected an object of type"),
    ],
)
def test_what_cannot_be_done_is_answered(head: FaceMesh, sent: dict, complaint: str) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await socket.send_json(sent)
            assert complaint in (await text_from(socket, "error"))["message"]
            await socket.send_json({"type": "ping", "number": 1})
            await text_from(socket, "pong")

    serve(head, use)


def test_one_page_is_not_spoken_for_without_end(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            for _ in range(connections.MAX_VOICES + 1):
                await socket.send_json({"type": "say", "text": "One sentence after the other. " * 20})
            assert "earlier texts" in (await text_from(socket, "error"))["message"]

    serve(head, use)


def test_bytes_and_nonsense_are_counted_and_too_much_of_it_ends_the_connection(
    head: FaceMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MAX_REFUSED", 300)

    async def use(client: TestClient, hub: Hub) -> None:
        counts = client.app[COUNTS]
        async with client.ws_connect("/ws") as healthy, client.ws_connect("/ws") as socket:
            await socket.send_bytes(b"\0\1")
            assert "sound: got" in (await text_from(socket, "error"))["message"]
            for _ in range(400):
                await socket.send_str("{")
            while not socket.closed:
                await socket.receive()
            assert socket.close_code == 1008
            assert counts.bad_messages >= 2
            assert counts.too_fast > 50
            assert counts.bad_messages + counts.too_fast >= 300
            assert counts.lost == 1
            await healthy.send_json({"type": "ping", "number": 1})
            await text_from(healthy, "pong")

    serve(head, use)


def test_a_message_that_is_too_long_ends_the_connection(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await socket.send_str("x" * 100_000)
            while not socket.closed:
                await socket.receive()
            assert socket.close_code == 1009

    serve(head, use)


def test_a_page_that_does_not_read_is_closed(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await socket.receive_json()
            (connection,) = client.app[web_app.HANDLERS].connections
            for _ in range(2000):
                connection.outbox.put_text('{"type":"chatter"}')
            while not socket.closed:
                await socket.receive()
            assert socket.close_code == 1013
            assert client.app[COUNTS].lost == 1

    serve(head, use)


def test_a_token_keeps_strangers_out(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        for path in ("/ws", "/ws?token=wrong", "/ws?token=s%C3%A9cret%20"):
            with pytest.raises(WSServerHandshakeError) as caught:
                await client.ws_connect(path)
            assert caught.value.status == 403
        for path in ("/sound.wav?utterance=1", "/head.bin", "/setup.json"):
            async with client.get(path) as answer:
                assert answer.status == 403, path
        async with client.get("/head.bin?token=s%C3%A9cret") as answer:
            assert answer.status == 200
        async with client.ws_connect("/ws?token=s%C3%A9cret") as socket:
            assert (await socket.receive_json())["type"] == "hello"
        async with client.get("/sound.wav?utterance=1", headers={"Authorization": "Bearer sécret"}) as answer:
            assert answer.status == 404
        async with client.get("/") as answer:
            assert answer.status == 200
        assert client.app[COUNTS].refused == 6

    serve(head, use, token="sécret")


def test_pages_of_others_are_refused(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        own = f"http://127.0.0.1:{client.port}"
        for headers in (
            {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://["},
            {"Host": f"evil.example:{client.port}"}, {"Host": "["}, {"Host": ""},
        ):  # fmt: skip
            with pytest.raises(WSServerHandshakeError) as caught:
                await client.ws_connect("/ws", headers=headers)
            assert caught.value.status == 403
        for headers in (
            {"Origin": own},
            {"Host": f"localhost:{client.port}", "Origin": f"http://localhost:{client.port}"},
            {"Host": f"[::1]:{client.port}"},
        ):
            async with client.ws_connect("/ws", headers=headers) as socket:
                assert (await socket.receive_json())["type"] == "hello"

    serve(head, use)


def test_names_are_enough_with_a_token(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?token=a", headers={"Host": "studio.example"}) as socket:
            assert (await socket.receive_json())["type"] == "hello"

    serve(head, use, token="a")


def test_the_server_speaks_with_its_own_voice_unless_the_page_chooses(
    head: FaceMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    async def speak(_: object, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        asked.append((text, choice))
        return replace(EspeakVoice().speak("Mama."), remarks=("text: so it is",))

    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws") as socket:
            await text_from(socket, "hello")
            for choice in ({}, {"voice": "fr", "rate": 90}):
                await socket.send_json({"type": "say", "text": "Mama.", **choice})
                assert (await text_from(socket, "error"))["message"] == "text: so it is"

    monkeypatch.setattr(ThreadVoice, "speak", speak)
    serve(head, use, voice=VoiceChoice("de", 200, ssml=True))
    assert asked == [("Mama.", VoiceChoice("de", 200, ssml=True)), ("Mama.", VoiceChoice("fr", 90, ssml=True))]


def test_a_full_server_says_so(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_app, "MAX_PAGES", 3)

    async def use(client: TestClient, hub: Hub) -> None:
        async def refused(path: str) -> None:
            with pytest.raises(WSServerHandshakeError) as caught:
                await client.ws_connect(path)
            assert caught.value.status == 400

        await refused("/ws?session=%0A")
        async with client.get("/ws?session=a") as answer:  # a page that was refused asks why in plain HTTP
            assert answer.status == 426
        async with client.get("/ws?session=%0A") as answer:
            assert (answer.status, "session: got" in await answer.text()) == (400, True)
        one, other = await client.ws_connect("/ws?session=a"), await client.ws_connect("/ws?session=b")
        async with client.ws_connect("/ws?session=c") as socket:
            assert "limit of 2" in (await socket.receive_json())["message"]
            assert (await socket.receive()).type is WSMsgType.CLOSE
            assert socket.close_code == 1013
        third = await client.ws_connect("/ws?session=b")
        await third.receive_json()
        await refused("/ws?session=b")  # pages
        for socket in (one, other, third):
            await socket.close()

    serve(head, use, sessions=2)


def test_a_session_of_another_process_is_misdirected_and_one_that_is_not_clear_is_refused(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        hub.engine.may_open = lambda session: session == "anna"

        async def status(target: str) -> int:
            async with client.get(URL(target, encoded=True)) as answer:
                return answer.status

        assert await status("/ws?session=anna") == 426
        assert await status("/ws?session=ben") == 421
        assert await status("/sound.wav?session=ben&utterance=1") == 421
        assert await status("/sound.wav?session=anna&utterance=1") == 404
        for target in ("/ws?session=ben&session=anna", "/ws?session=anna&sessio%6e=ben", "/w%73?session=anna"):
            assert await status(target) == 400
        with pytest.raises(ElsewhereError, match="'ben', which another process shows"):
            hub.hold("ben")
        assert hub.engine.sessions == ()

    serve(head, use)


def test_a_connection_that_was_handed_over_for_another_session_is_misdirected(head: FaceMesh) -> None:
    """The parent of workers has read the request before: a worker that reads it otherwise shows nothing."""

    async def answered(site: Site, handed_for: str | None, target: str) -> bytes:
        with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as here:
            await site.adopt(server.accept()[0], handed_for)
            reader, writer = await asyncio.open_connection(sock=here)
            writer.write(f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            head = await reader.readuntil(b"\r\n\r\n")
            writer.close()
            assert b"\r\nConnection: close\r\n" in head  # the next request may be for another process
            return head.split()[1]

    async def main() -> None:
        engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
        app = make_app(Hub(engine, rate_hz=100.0), head)
        site = await open_site(app, "127.0.0.1", None, Door(9, 9))
        assert await answered(site, "anna", "/ws?session=anna") == b"426"
        assert await answered(site, None, "/setup.json") == b"200"
        for handed_for, target in (("ben", "/ws?session=anna"), (None, "/ws?session=anna"), ("anna", "/setup.json")):
            assert await answered(site, handed_for, target) == b"421"
        assert app[COUNTS].misdirected == 3
        assert engine.sessions == ()
        await site.close()

    asyncio.run(main())


def test_whoever_does_not_come_in_leaves_no_session_behind(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    async def gone(self: web.WebSocketResponse, request: web.BaseRequest) -> None:
        raise ConnectionResetError("gone before it was let in")

    async def use(client: TestClient, hub: Hub) -> None:
        async with client.get("/ws?session=a") as answer:
            assert answer.status == 426
        with monkeypatch.context() as patch:
            patch.setattr(web.WebSocketResponse, "prepare", gone)
            with pytest.raises(ClientError):
                await client.ws_connect("/ws?session=a")
        assert "a" not in hub.engine
        assert not client.app[web_app.HANDLERS].views

    serve(head, use)


def test_a_server_that_stops_says_goodbye(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        socket = await client.ws_connect("/ws")
        await socket.receive_json()
        stopping = asyncio.create_task(client.server.close())
        while not socket.closed:
            await socket.receive()
        assert socket.close_code == 1001
        await stopping

    serve(head, use)


def test_sound_of_a_microphone_goes_to_the_ear_of_one_page_at_a_time(head: FaceMesh) -> None:
    piece = SOUND_HEAD.pack(SOUND_KIND, 16_000) + bytes(1280)

    async def run() -> None:
        hub = Hub(Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only()), rate_hz=100.0)
        hearing = Hearing(hub, max_recognizers=1)
        app = make_app(hub, head, hearing=hearing)
        async with asyncio.timeout(LIMIT_S), TestClient(TestServer(app)) as client:
            ticking = asyncio.create_task(hub.run(lambda now_s, due_s: hearing.tick(now_s)))
            try:
                async with client.ws_connect("/ws?session=anna") as one, client.ws_connect("/ws?session=anna") as other:
                    assert (await one.receive_json())["recognizer"]
                    await one.send_bytes(piece)
                    while not hearing.counts.recognizers:
                        await asyncio.sleep(0.005)
                    await other.send_bytes(piece)
                    await other.send_bytes(piece)
                    assert "another one drives this face" in (await text_from(other, "error"))["message"]
                    while app[COUNTS].unheard < 2:  # told once, counted twice
                        await asyncio.sleep(0.005)
                    async with client.ws_connect("/ws?session=bert") as third:
                        await third.send_bytes(piece)
                        assert "got audio of another session" in (await text_from(third, "error"))["message"]
                    kinds = [(1, 16_000, 4), (SOUND_KIND, 96_000, 4), (SOUND_KIND, 8000, 19_202)]
                    wrong = [SOUND_HEAD.pack(kind, rate_hz) + bytes(length) for kind, rate_hz, length in kinds]
                    for bad in (b"", piece[:7], piece[:-1], *wrong):
                        await one.send_bytes(bad)
                        assert "sound: got" in (await text_from(one, "error"))["message"]
            finally:
                hub.stop()
                await ticking
                hearing.close()

    asyncio.run(run())


def test_sound_that_is_sent_becomes_an_utterance_with_its_events(
    head: FaceMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        rates, "AT_ONCE_S", 3600.0
    )  # here the recognizer works in the loop; a page is not to rest for it
    samples = np.pad(spoken_by_espeak("en-us", "My mama.").samples, (0, 32_000))
    told: list[str] = []

    async def run() -> None:
        clock = PatientClock()
        hub = Hub(
            Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only()), rate_hz=100.0, clock=clock
        )
        hub.listeners.on_frames(lambda frames: clock.allow(hub, 0.01))
        hearing = Hearing(hub, opens=lambda _: DirectRecognizer(SphinxRecognizer()))
        app = make_app(hub, head, hearing=hearing)
        async with asyncio.timeout(LIMIT_S), TestClient(TestServer(app)) as client:
            ticking = asyncio.create_task(hub.run(lambda now_s, due_s: hearing.tick(now_s)))
            try:
                async with client.ws_connect("/ws?session=anna") as socket:

                    async def speak() -> None:
                        due_s = clock()
                        for piece in np.array_split(samples, len(samples) // 640):
                            while clock() < due_s:
                                await asyncio.sleep(0.002)
                            await socket.send_bytes(SOUND_HEAD.pack(SOUND_KIND, 16_000) + piece.astype("<i2").tobytes())
                            due_s += len(piece) / 16_000
                            clock.allow(socket, due_s - clock())
                        clock.free(socket)

                    speaking = asyncio.create_task(speak())
                    while not told or told[-1] != "finished":
                        message = await socket.receive()
                        if message.type is not WSMsgType.TEXT:
                            continue
                        said = json.loads(message.data)
                        if said["type"] == "event":
                            told.append(said["kind"])
                        elif said["type"] == "phones":
                            told.extend(label for label, *_ in said["phones"])
                    speaking.cancel()
            finally:
                hub.stop()
                await ticking
                hearing.close()

    asyncio.run(run())
    assert "started" in told
    assert told[-1] == "finished"
    assert len([label for label in told if label not in ("started", "finished", "_", "late")]) >= 3


def test_a_server_without_an_ear_says_so(head: FaceMesh) -> None:
    async def use(client: TestClient, hub: Hub) -> None:
        async with client.ws_connect("/ws?session=anna") as socket:
            assert (await socket.receive_json())["recognizer"] is False
            await socket.send_bytes(SOUND_HEAD.pack(SOUND_KIND, 16_000) + bytes(4))
            assert (await text_from(socket, "error"))["message"] == "recognizer: this server has none"

    serve(head, use)
