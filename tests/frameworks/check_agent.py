"""``fapengine agent`` in Chromium, whose microphone is a file: somebody asks, and voice and face answer.

The language model is a stub that repeats what it was asked; recognizer, voice, face, browser and calls are real.
"""

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from aiohttp import web
from aiortc import RTCPeerConnection

from fapengine.agents import bot
from fapengine.agents.face import AgentOptions
from fapengine.files.sound import save_wav
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import EspeakVoice
from tests.browser.chromium import Browser, find_chromium
from tests.processes import free_port, start

ROOT = Path(__file__).resolve().parents[2]
QUESTION = "What is the weather like in London?"
LIMIT_S = 300.0
MEASURE = """(() => {
  const face = document.getElementById("face"), context = new AudioContext(), analyser = context.createAnalyser();
  context.createMediaStreamSource(face.srcObject).connect(analyser);
  const samples = new Float32Array(analyser.fftSize);
  const canvas = new OffscreenCanvas(256, 256), paper = canvas.getContext("2d", { willReadFrequently: true });
  window.loudest = 0;
  window.dark = [];
  setInterval(() => {
    analyser.getFloatTimeDomainData(samples);
    window.loudest = Math.max(window.loudest, ...samples);
    paper.drawImage(face, 0, 0, 256, 256);
    const pixels = paper.getImageData(104, 165, 48, 50).data;
    let dark = 0;
    for (let at = 1; at < pixels.length; at += 4) dark += pixels[at] < 60;
    window.dark.push(dark);
  }, 40);
})()"""
"""Measures how loud the agent is, and how many pixels of its mouth are dark."""

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="there is no Chromium")


class StubModel:
    """A language model in OpenAI's protocol that repeats what it is asked; it refuses a secret. Stateful."""

    def __init__(self) -> None:
        self.asked: list[list[dict[str, str]]] = []

    async def models(self, _: web.Request) -> web.Response:
        return web.json_response({"data": [{"id": "stub"}]})

    async def chat(self, request: web.Request) -> web.StreamResponse:
        said = await request.json()
        self.asked.append(said["messages"])
        question = said["messages"][-1]["content"]
        if "secret" in question:
            return web.json_response({"error": {"message": "No longer."}}, status=401)
        answer = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        await answer.prepare(request)
        for word in f"[smiles] You asked: {question}.".split(" "):
            part = {"index": 0, "delta": {"role": "assistant", "content": f"{word} "}, "finish_reason": None}
            about = {"id": "1", "object": "chat.completion.chunk", "created": 1, "model": "stub", "choices": [part]}
            await answer.write(f"data: {json.dumps(about)}\n\n".encode())
        await answer.write(b"data: [DONE]\n\n")
        return answer

    @asynccontextmanager
    async def open(self) -> AsyncIterator[str]:
        """Its base URL."""
        app = web.Application()
        app.add_routes([web.get("/v1/models", self.models), web.post("/v1/chat/completions", self.chat)])
        runner = web.AppRunner(app)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        try:
            yield f"http://127.0.0.1:{runner.addresses[0][1]}/v1"
        finally:
            await runner.cleanup()


@asynccontextmanager
async def agent(*arguments: str) -> AsyncIterator[str]:
    """The address of a running agent's page."""
    command = [sys.executable, "-m", "fapengine", "agent", "--port", str(free_port()), "--size", "256x256", *arguments]
    process = start(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert process.stdout is not None
        first = await asyncio.to_thread(process.stdout.readline)
        assert first.startswith("page "), first
        yield first.split()[1]
    finally:
        process.terminate()
        assert await asyncio.to_thread(process.wait, 60) == 0


@asynccontextmanager
async def visitor(url: str, microphone: Path) -> AsyncIterator[Browser]:
    """A browser that talks to the agent."""
    flags = "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"
    async with Browser((700, 900), *flags, f"--use-file-for-fake-audio-capture={microphone}") as browser:
        await browser.open(url)
        await browser.until("document.readyState === 'complete' && document.getElementById('call')")
        await browser.run("document.getElementById('call').click()")
        await browser.until("document.getElementById('state').textContent.startsWith('Connected')", LIMIT_S)
        await browser.until("document.getElementById('face').videoWidth === 256", LIMIT_S)
        await browser.run(MEASURE)
        yield browser


def said(words: str, who: str) -> str:
    return f"[...document.querySelectorAll('#said .{who}')].some((line) => line.textContent.includes('{words}'))"


def typed(words: str) -> str:
    return f"document.getElementById('text').value = '{words}', document.getElementById('send').click()"


@pytest.fixture
def microphone(tmp_path: Path) -> Path:
    """A WAV file with a question after 4 s, which Chromium repeats."""
    speech = EspeakVoice("en-us").speak(QUESTION)
    silence = np.zeros(speech.sample_rate_hz, np.int16)
    samples = np.concatenate([*[silence] * 4, speech.samples, *[silence] * 20])
    save_wav(tmp_path / "microphone.wav", samples, speech.sample_rate_hz)
    return tmp_path / "microphone.wav"


@pytest.mark.timeout(1200)
def test_somebody_asks_and_is_answered_with_voice_and_face(microphone: Path) -> None:
    async def talked() -> tuple[StubModel, float, list[int], list[str]]:
        model = StubModel()
        async with model.open() as llm, agent("--llm", llm) as url, visitor(url, microphone) as browser:
            await browser.until(said("weather", "user"), LIMIT_S)
            await browser.until(said("You asked: what is the weather", "bot"), LIMIT_S)
            await browser.until("window.loudest > 0.05", LIMIT_S)
            await browser.until("Math.max(...window.dark) > Math.min(...window.dark) + 40", LIMIT_S)
            await browser.run(typed("the secret"))
            await browser.until("document.getElementById('trouble').textContent.includes('No longer.')", LIMIT_S)
            return model, *[await browser.run(f"window.{name}") for name in ("loudest", "dark")], browser.complaints

    model, loudest, dark, complaints = asyncio.run(talked())
    roles = [message["role"] for message in model.asked[0]]
    assert roles == ["system", "user"]
    assert complaints == []
    print(f"heard: {model.asked[0][1]['content']!r}; loudest {loudest:.2f}; dark pixels {min(dark)} to {max(dark)}")


@pytest.mark.timeout(1200)
def test_without_a_model_it_repeats_what_is_said(microphone: Path) -> None:
    async def talked() -> None:
        async with agent() as url, visitor(url, microphone) as browser:
            await browser.run(typed("plum jam"))
            await browser.until(said("plum jam", "bot"), LIMIT_S)
            await browser.until("window.loudest > 0.05", LIMIT_S)
            await browser.until(said("weather", "user"), LIMIT_S)
            await browser.until(said("weather", "bot"), LIMIT_S)

    asyncio.run(talked())


@pytest.mark.timeout(300)
def test_a_visitor_that_never_connects_frees_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bot, "CONNECTS_S", 0.5)

    async def offered() -> None:
        agent = bot.Bot(bot.BotOptions(face=AgentOptions(size=(64, 64)), voice=VoiceChoice()))
        for _ in range(bot.MAX_VISITORS):
            await agent.offer("v=0", None, restarts=False)
        assert not agent.may_talk(None)
        with pytest.raises(ValueError, match="offer"):
            await agent.offer("v=0\r\nm=audio x y z\r\n", None, restarts=False)
        for restarts in (False, True):
            with pytest.raises(ValueError, match="offer"):
                await agent.offer("v=0\r\nm=audio x y z\r\n", next(iter(agent._connections)), restarts=restarts)
        async with asyncio.timeout(LIMIT_S):
            while not agent.may_talk(None):
                await asyncio.sleep(0.1)
        await agent.close()

    asyncio.run(offered())


@pytest.mark.timeout(300)
def test_visitors_who_come_at_once_are_counted() -> None:
    async def offered() -> int:
        agent = bot.Bot(bot.BotOptions(face=AgentOptions(size=(64, 64)), voice=VoiceChoice()))
        browser = RTCPeerConnection()
        browser.addTransceiver("audio")
        await browser.setLocalDescription(await browser.createOffer())

        async def come() -> bool:
            may = agent.may_talk(None)
            if may:
                await agent.offer(browser.localDescription.sdp, None, restarts=False)
            return may

        came = await asyncio.gather(*(come() for _ in range(bot.MAX_VISITORS + 2)))
        await agent.close()
        await browser.close()
        return sum(came)

    assert asyncio.run(offered()) == bot.MAX_VISITORS
