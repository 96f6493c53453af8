"""Streaming voices: messages of the shapes that the services document, replayed by a server here, cut anywhere.

No service was reached: what is tested is that these messages are read right.
"""

import asyncio
import base64
import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.voices.choice import SERVICE_NAMES, VoiceChoice
from fapengine.voices.service_client import ServiceVoice, stream
from fapengine.voices.services import SERVICES, AzureEvents, ElevenLabs, Gathered, Service

SOUND = (9000 * np.sin(np.arange(24_000) / 9)).astype(np.int16)
HALVES = SOUND[:12_000].tobytes(), SOUND[12_000:].tobytes()
WORDS = [("hello", 0.1, 0.45), ("mama", 0.55, 0.95)]
PHONES = [("h", 0.1, 0.15), ("ə", 0.15, 0.2), ("l", 0.2, 0.3), ("oʊ", 0.3, 0.45), ("m", 0.55, 0.65), ("ɑ", 0.65, 0.75),
          ("m", 0.75, 0.85), ("ə", 0.85, 0.95)]  # fmt: skip
Message = str | bytes


def b64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def elevenlabs() -> list[Message]:
    def message(sound: bytes, word: str, start_s: float, end_s: float, tail: str) -> str:
        step = (end_s - start_s) / len(word)
        starts = [round(1000 * (start_s + n * step)) for n in range(len(word))] + [round(1000 * end_s)] * len(tail)
        lengths = [round(1000 * step)] * len(word) + [20] * len(tail)
        aligned = {"chars": [*word, *tail], "charStartTimesMs": starts, "charDurationsMs": lengths}
        return json.dumps({"audio": b64(sound), "isFinal": None, "normalizedAlignment": aligned, "alignment": None})

    first = message(HALVES[0], "hello", 0.1, 0.45, " ")
    return [first, message(HALVES[1], "mama", 0.05, 0.45, ""), json.dumps({"audio": None, "isFinal": True})]


def cartesia() -> list[Message]:
    def stamps(rows: Sequence[tuple[str, float, float]], name: str) -> dict[str, object]:
        return {name: [row[0] for row in rows], "start": [row[1] for row in rows], "end": [row[2] for row in rows]}

    context = {"context_id": "fapengine", "status_code": 206, "done": False}
    return [json.dumps(context | message) for message in (
        {"type": "chunk", "data": b64(HALVES[0]), "step_time": 12.0},
        {"type": "timestamps", "word_timestamps": stamps(WORDS, "words")},
        {"type": "phoneme_timestamps", "phoneme_timestamps": stamps(PHONES, "phonemes")},
        {"type": "chunk", "data": b64(HALVES[1]), "step_time": 9.0}, {"type": "flush_done", "flush_id": 1},
        {"type": "done", "done": True},
    )]  # fmt: skip


def inworld() -> list[Message]:
    head = b"RIFF" + bytes(40)
    details = [{"wordIndex": n, "phones": [
        {"phoneSymbol": label, "startTimeSeconds": start, "durationSeconds": end - start, "visemeSymbol": "aei"}
        for label, start, end in part]} for n, part in enumerate((PHONES[:4], PHONES[4:]))]  # fmt: skip
    aligned = {"words": [word for word, _, _ in WORDS], "wordStartTimeSeconds": [word[1] for word in WORDS],
               "wordEndTimeSeconds": [word[2] for word in WORDS], "phoneticDetails": details}  # fmt: skip
    results = [{"audioContent": b64(head + half)} for half in HALVES]
    results[0]["timestampInfo"] = {"wordAlignment": aligned}  # type: ignore[assignment]
    return [json.dumps({"result": result}) for result in results]


def fish() -> list[Message]:
    def audio(sound: bytes, offset_s: float, word: str, start_s: float, end_s: float) -> dict[str, object]:
        segments = [{"text": word, "start": start_s, "end": end_s}, {"text": ".", "start": end_s, "end": end_s}]
        return {"event": "audio", "audio": sound, "content": word, "chunk_seq": 0, "chunk_audio_offset_sec": offset_s,
                "alignment": {"audio_duration": 0.5, "segments": segments}}  # fmt: skip

    events = [audio(HALVES[0], 0.0, "hello", 0.1, 0.45), audio(HALVES[1], 0.5, " mama", 0.05, 0.45),
              {"event": "finish", "reason": "stop"}]  # fmt: skip
    return [msgspec.msgpack.encode(event) for event in events]


ANSWERS = {"elevenlabs": elevenlabs, "cartesia": cartesia, "inworld": inworld, "fish": fish}


def opened(name: str) -> Service:
    return SERVICES[name]("anna", "secret")


def gathered(service: Service, messages: Sequence[Message]) -> Gathered:
    whole = Gathered()
    for message in messages:
        whole.add(service.feed(message))
    return whole


@pytest.mark.parametrize("name", ANSWERS)
def test_sound_words_and_phones_come_out_as_they_went_in(name: str) -> None:
    service = opened(name)
    whole = gathered(service, ANSWERS[name]())
    assert service.over or name == "inworld"  # there the connection's end is the end
    np.testing.assert_array_equal(np.concatenate(whole.sound), SOUND)
    assert [(word.label, word.start_s, word.end_s) for word in whole.words] == [
        (label, pytest.approx(start), pytest.approx(end)) for label, start, end in WORDS
    ]
    if name in ("cartesia", "inworld"):
        assert [(phone.label, phone.start_s) for phone in whole.phones] == [
            (label, pytest.approx(start)) for label, start, _ in PHONES
        ]


@pytest.mark.parametrize("name", ANSWERS)
def test_a_whole_utterance_can_be_shown(name: str, replaying: "Replay") -> None:
    replaying.answers = ANSWERS[name]()
    voice = ServiceVoice(name, "anna", "secret", base=replaying.base(name))
    speech = voice.speak("Hello Mama.")
    assert speech.duration_s == 1.0
    assert speech.phones.duration_s == pytest.approx(1.0)
    labels = [phone.label for phone in speech.phones.phones]
    assert labels.count("m") == 2
    closed = next(phone for phone in speech.phones.phones if phone.label == "m")
    assert 0.5 < closed.start_s < 0.6
    assert "secret" in str(replaying.headers)
    asked = " ".join(str(message) for message in replaying.asked)
    assert "Hello Mama." in asked


@given(cuts=st.lists(st.integers(0, 48_000), max_size=12))
def test_sound_may_be_cut_at_every_byte(cuts: list[int]) -> None:
    data = SOUND.tobytes()
    edges = [0, *sorted(cuts), len(data)]
    service = opened("cartesia")
    messages = [json.dumps({"type": "chunk", "data": b64(data[start:end])}) for start, end in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(gathered(service, messages).sound), SOUND)


@given(cut=st.integers(1, 8))
def test_a_word_may_be_cut_between_messages(cut: int) -> None:
    text = "ho hello"
    starts = [100 * n for n in range(len(text))]
    messages = []
    for part in (slice(0, cut), slice(cut, len(text))):
        aligned = {
            "chars": list(text[part]),
            "charStartTimesMs": starts[part],
            "charDurationsMs": [100] * len(text[part]),
        }
        messages.append(json.dumps({"audio": "", "alignment": aligned}))
    words = gathered(ElevenLabs("v", "k"), [*messages, json.dumps({"isFinal": True})]).words
    assert [(word.label, word.start_s) for word in words] == [("ho", 0.0), ("hello", pytest.approx(0.3))]


@pytest.mark.parametrize("name", ANSWERS)
@given(data=st.data())
def test_damaged_messages_are_named(name: str, data: st.DataObject) -> None:
    messages = ANSWERS[name]()
    message = messages[data.draw(st.integers(0, len(messages) - 1))]
    raw = bytearray(message.encode() if isinstance(message, str) else message)
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with suppress(DataError, ResourceError):
        opened(name).feed(bytes(raw[: data.draw(st.integers(0, len(raw)))]))


@pytest.mark.parametrize(
    ("name", "message", "said"),
    [
        ("elevenlabs", {"error": "quota_exceeded", "message": "no more today"}, "no more today"),
        ("cartesia", {"type": "error", "error": "bad voice"}, "bad voice"),
        ("inworld", {"error": {"code": 3, "message": "unknown voice"}}, "unknown voice"),
    ],
)
def test_what_a_service_refuses_is_told(name: str, message: dict[str, object], said: str) -> None:
    with pytest.raises(ResourceError, match=said):
        opened(name).feed(json.dumps(message))


def test_azure_events_become_phones() -> None:
    events = AzureEvents(16_000)
    for offset, viseme in ((500_000, 0), (1_000_000, 21), (2_000_000, 2)):
        events.viseme(offset, viseme)
    events.sound(HALVES[0][:3])
    first = events.piece()
    events.sound(HALVES[0][3:])
    last = events.piece(end=True)
    phones = [*first.phones, *last.phones]
    assert [(phone.start_s, phone.end_s) for phone in phones] == [(0.05, 0.1), (0.1, 0.2), (0.2, pytest.approx(0.3))]
    np.testing.assert_array_equal(np.concatenate([first.samples, last.samples]), SOUND[:12_000])
    with pytest.raises(DataError, match="expected 0 to 21"):
        events.viseme(0, 22)


def test_services_are_chosen_by_the_names_that_they_have() -> None:
    assert tuple(SERVICES) == SERVICE_NAMES


def test_a_voice_wants_a_service_and_a_key() -> None:
    with pytest.raises(UsageError, match="CARTESIA_API_KEY"):
        ServiceVoice.named("cartesia:anna", {})
    with pytest.raises(UsageError, match="expected SERVICE:VOICE"):
        ServiceVoice.named("cartesia:", {"CARTESIA_API_KEY": "k"})
    with pytest.raises(UsageError, match="CARTESIA_API_KEY"):
        VoiceChoice("cartesia:anna").load()
    with pytest.raises(UsageError, match="nothing to speak"):
        opened("fish").requests(" ... ")


def test_a_service_that_breaks_off_or_refuses_is_told(replaying: "Replay") -> None:
    replaying.answers = cartesia()[:2]
    with pytest.raises(ResourceError, match="closed the connection"):
        ServiceVoice("cartesia", "anna", "k", base=replaying.base("cartesia")).speak("Hello.")
    replaying.answers = cartesia()
    with pytest.raises(DataError, match=r"more than 0\.6 s"):
        ServiceVoice("cartesia", "anna", "k", base=replaying.base("cartesia"), most_s=0.6).speak("Hello.")
    replaying.status = 401
    with pytest.raises(ResourceError, match="401"):
        ServiceVoice("inworld", "anna", "k", base=replaying.base("inworld")).speak("Hello.")
    with pytest.raises(ResourceError, match=r"127\.0\.0\.1:9"):
        ServiceVoice("fish", "anna", "k", base="ws://127.0.0.1:9").speak("Hello.")


def test_pieces_come_as_they_are_made(replaying: "Replay") -> None:
    """The second half of the sound is sent only when the first has arrived."""
    replaying.answers, replaying.waits_after = cartesia(), 1

    async def listen() -> int:
        service = SERVICES["cartesia"]("anna", "k", base=replaying.base("cartesia"))
        count = 0
        async for piece in stream(service, "Hello."):
            count += len(piece.samples)
            replaying.go_on.set()
        return count

    assert asyncio.run(asyncio.wait_for(listen(), 300)) == len(SOUND)


class Replay:
    """A server that sends messages to whoever asks.

    Stateful.
    """

    def __init__(self) -> None:
        self.answers: list[Message] = []
        self.asked: list[object] = []
        self.headers: dict[str, str] = {}
        self.status = 200
        self.waits_after = 0
        self.go_on = threading.Event()
        self.port = 0

    def base(self, name: str) -> str:
        return f"{'http' if name == 'inworld' else 'ws'}://127.0.0.1:{self.port}"

    async def socket(self, request: web.Request) -> web.WebSocketResponse:
        self.headers = dict(request.headers)
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        self.asked.append((await socket.receive()).data)
        if "text-to-speech" in request.path or "live" in request.path:
            self.asked.append((await socket.receive()).data)
        for number, answer in enumerate(self.answers):
            if self.waits_after and number == self.waits_after:
                await asyncio.to_thread(self.go_on.wait, 10)
            await (socket.send_str(answer) if isinstance(answer, str) else socket.send_bytes(answer))
        await socket.close()
        return socket

    async def post(self, request: web.Request) -> web.StreamResponse:
        self.headers = dict(request.headers)
        self.asked.append(await request.text())
        answer = web.StreamResponse(status=self.status)
        await answer.prepare(request)
        lines = "\n".join(str(message) for message in self.answers).encode()
        for at in range(0, len(lines), 777):
            await answer.write(lines[at : at + 777])
        return answer


@pytest.fixture
def replaying() -> Iterator[Replay]:
    replay, ready, loop = Replay(), threading.Event(), asyncio.new_event_loop()

    async def serve() -> web.AppRunner:
        app = web.Application()
        app.router.add_get("/{path:.*}", replay.socket)
        app.router.add_post("/{path:.*}", replay.post)
        runner = web.AppRunner(app)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        replay.port = runner.addresses[0][1]
        return runner

    def run() -> None:
        runner = loop.run_until_complete(serve())
        ready.set()
        loop.run_forever()
        loop.run_until_complete(runner.cleanup())
        loop.close()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(300)
    yield replay
    loop.call_soon_threadsafe(loop.stop)
    thread.join(300)
