"""Latency where it is seen and heard: the time from a text or from audio to sound and lips, and to a face at rest.

Run ``python -m bench.latency [--only OSC WebSocket ...] [--trials N]``; the rows Pipecat and LiveKit need an
environment with both frameworks (``make oracles`` makes ``out/oracles/frameworks``), Chromium and
Firefox a browser. All run on this machine: server, renderer, encoder, network (loopback) and client. Columns, in s, as
p50 and p95:

- *start*: from the first request to the first frame or image;
- *sound*, *lips*: from the request to speak a text (or, for agents, from the first sample of a TTS in real time) to the
  first loud sample and to the first open mouth;
- *rest*: from an interruption to the last frame or image with an open mouth.

Frames are FAPs (the jaw), images are pixels (the inside of the mouth). On a machine with other work,
``chrt -f 10 python -m bench.latency`` puts all of it before the other programs.
"""

import argparse
import asyncio
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import aiohttp
import numpy as np

from bench.calls import SIZE_PX, serving
from fapengine.clients.sender import Client
from fapengine.mpeg4 import fap
from fapengine.server.config import CallChoice
from fapengine.server.server import Server
from fapengine.server.web.messages import FRAME
from fapengine.trajectory.style import Style
from fapengine.voices.espeak import EspeakVoice
from tests.live.caller import watch
from tests.live.stage import Ear

TEXT = "All our apples are in the car, and Anna may eat most of them on the way."
JAW_FAPU, DARK_PX, LOUD = 60.0, 30.0, 500.0
"""What counts as an open mouth, as FAP 3 and as pixels of the mouth beyond those at rest, and as a loud sample."""
LIMIT_S, SPEAKS_S, RESTS_S = 30.0, 0.6, 1.5
"""Time after which something did not come; from open lips to the interruption; in which a face comes to rest."""
SPEECH = Style.speech_only()


@dataclass(eq=False)
class Watched:
    """What one client receives, with the times, and how it asks. Stateful."""

    opens: float
    """Openness beyond rest that counts."""
    say: Callable[[], Awaitable[float]]
    """Begins speech; the time from which it counts."""
    stop: Callable[[], Awaitable[object]]
    mouth: list[tuple[float, float]] = field(default_factory=list)
    """Time and openness of each frame or image."""
    sound: list[tuple[float, float]] = field(default_factory=list)
    """Time and loudest sample of each piece of audio."""
    hears: bool = True


async def _first(received: list[tuple[float, float]], after_s: float, above: float) -> float:
    async with asyncio.timeout(LIMIT_S):
        while True:
            for at_s, value in received:
                if at_s > after_s and value > above:
                    return at_s - after_s
            await asyncio.sleep(0.002)


async def _trial(client: Watched) -> dict[str, float]:
    await asyncio.sleep(RESTS_S)
    rest = float(np.median([value for _, value in client.mouth[-5:]]))
    client.mouth[:] = client.mouth[-1:]
    client.sound.clear()
    said_s = await client.say()
    delays_s = {"lips": await _first(client.mouth, said_s, rest + client.opens)}
    if client.hears:
        delays_s["sound"] = await _first(client.sound, said_s, LOUD)
    await asyncio.sleep(SPEAKS_S)
    stopped_s = time.monotonic()
    await client.stop()
    await asyncio.sleep(RESTS_S)
    open_s = [at_s for at_s, value in client.mouth if at_s > stopped_s and value > rest + client.opens]
    delays_s["rest"] = max(open_s, default=stopped_s) - stopped_s
    return delays_s


def darkness(picture: np.ndarray) -> float:
    """Dark pixels in the mouth of an image of the default head, (256, 256, 3)."""
    return float((picture[158:200, 116:140, 1] < 110).sum())


# A server's clients ---------------------------------------------------------------------------------------------------


def _served(*sinks: str) -> AbstractAsyncContextManager[tuple[Server, str]]:
    return serving(CallChoice(on=True, size=SIZE_PX), SPEECH, *sinks)


@asynccontextmanager
async def osc() -> AsyncIterator[tuple[Watched, float]]:
    """Text by OSC, frames by OSC, both UDP."""
    receiver = Ear.open()
    async with _served(f"osc://127.0.0.1:{receiver.port}") as (server, _):
        begun_s = time.monotonic()
        sender = await asyncio.to_thread(lambda: Client(*server.osc_address, session="anna").wait())

        async def say() -> float:
            said_s = time.monotonic()
            sender.send_text(TEXT)
            return said_s

        async def stop() -> None:
            sender.cancel()

        client = Watched(JAW_FAPU, say, stop, hears=False)

        def come() -> None:
            before = len(receiver.frames.get("anna", ()))
            jaws = receiver.jaw("anna")[before:]
            client.mouth += [(time.monotonic(), float(jaw)) for jaw in jaws]

        loop = asyncio.get_running_loop()
        loop.add_reader(receiver.socket, come)
        start_s = await _begun(client, begun_s)
        try:
            yield client, start_s
        finally:
            loop.remove_reader(receiver.socket)
            await asyncio.to_thread(sender.close)


async def _begun(client: Watched, begun_s: float) -> float:
    async with asyncio.timeout(LIMIT_S):
        while not client.mouth:
            await asyncio.sleep(0.002)
    return client.mouth[0][0] - begun_s


@asynccontextmanager
async def _page(url: str) -> AsyncIterator[tuple[Watched, aiohttp.ClientWebSocketResponse]]:
    """A page of the session: it says and cancels."""
    async with aiohttp.ClientSession() as http, http.ws_connect(f"{url}/ws?session=anna") as socket:

        async def say() -> float:
            said_s = time.monotonic()
            await socket.send_json({"type": "say", "text": TEXT})
            return said_s

        yield Watched(JAW_FAPU, say, lambda: socket.send_json({"type": "cancel"})), socket


@asynccontextmanager
async def web_socket() -> AsyncIterator[tuple[Watched, float]]:
    """Text and frames by the page's WebSocket; the page plays the speech itself."""
    begun_s = time.monotonic()
    async with _served() as (_, url):
        begun_s = time.monotonic()
        async with _page(url) as (client, socket):
            client.hears = False

            async def read() -> None:
                async for message in socket:
                    if message.type is aiohttp.WSMsgType.BINARY:
                        jaw = np.frombuffer(message.data, "<i4", offset=FRAME.size - 4 * fap.FAP_COUNT)[fap.column(3)]
                        client.mouth.append((time.monotonic(), float(jaw)))

            reading = asyncio.create_task(read())
            try:
                yield client, await _begun(client, begun_s)
            finally:
                reading.cancel()


@asynccontextmanager
async def whep() -> AsyncIterator[tuple[Watched, float]]:
    """Text by WebSocket; images and sound by WHEP to aiortc."""
    async with _served() as (_, url), aiohttp.ClientSession() as http, _page(url) as (client, _):
        begun_s = time.monotonic()
        caller = await watch(http, f"{url}/whep?session=anna", darkness)

        async def copy() -> None:
            while True:
                client.mouth += [(one.at_s, one.value) for one in caller.pictures]
                client.sound += [(one.at_s, float(np.abs(one.value).max())) for one in caller.sounds]
                caller.pictures.clear()
                caller.sounds.clear()
                await asyncio.sleep(0.002)

        copying, client.opens = asyncio.create_task(copy()), DARK_PX
        try:
            yield client, await _begun(client, begun_s)
        finally:
            copying.cancel()
            await caller.end()
            await caller.close()


WATCHES = """(() => {
    const face = document.getElementById("face");
    const canvas = new OffscreenCanvas(256, 256).getContext("2d", { willReadFrequently: true });
    const context = new AudioContext();
    const analyser = new AnalyserNode(context, { fftSize: 1024 });
    context.createMediaStreamSource(face.srcObject).connect(analyser);
    const samples = new Float32Array(1024);
    const now = () => (performance.timeOrigin + performance.now()) / 1000;
    window.mouth = [];
    window.sound = [];
    const look = () => {
        canvas.drawImage(face, 0, 0, 256, 256);
        const { data } = canvas.getImageData(116, 158, 24, 42);
        let dark = 0;
        for (let at = 1; at < data.length; at += 4) dark += data[at] < 110;
        mouth.push([now(), dark]);
        face.requestVideoFrameCallback(look);
    };
    face.requestVideoFrameCallback(look);
    setInterval(() => {
        analyser.getFloatTimeDomainData(samples);
        sound.push([now(), 32768 * Math.max(...samples.map(Math.abs))]);
    }, 5);
})()"""


def chromium() -> AbstractAsyncContextManager[tuple[Watched, float]]:
    """Text by WebSocket; the call page in Chromium, what it shows and plays."""
    from tests.browser.chromium import Browser

    return _call_page(Browser((900, 620)))


def firefox() -> AbstractAsyncContextManager[tuple[Watched, float]]:
    """Text by WebSocket; the call page in Firefox, what it shows and plays."""
    from tests.browser.firefox import Firefox

    return _call_page(Firefox())


@asynccontextmanager
async def _call_page(opened: Any) -> AsyncIterator[tuple[Watched, float]]:
    async with _served() as (_, url), _page(url) as (client, _), opened as browser:
        ahead_s = time.time() - time.monotonic()
        await browser.open(f"{url}/call.html?session=anna")
        await browser.until("document.body?.dataset.watching === 'false'")
        begun_s = time.monotonic()
        await browser.run("document.getElementById('call').click()")
        await browser.until("document.getElementById('face').videoWidth > 0")
        start_s = time.monotonic() - begun_s
        await browser.until("document.getElementById('state').textContent === 'You see the face.'")
        await browser.run(WATCHES)

        async def copy() -> None:
            while True:
                mouth, sound = await browser.run("[mouth.splice(0), sound.splice(0)]")
                client.mouth += [(at_s - ahead_s, dark) for at_s, dark in mouth]
                client.sound += [(at_s - ahead_s, loud) for at_s, loud in sound]
                await asyncio.sleep(0.05)

        copying, client.opens = asyncio.create_task(copy()), DARK_PX
        try:
            await _begun(client, begun_s)
            yield client, start_s
        finally:
            copying.cancel()
            await asyncio.gather(copying, return_exceptions=True)


# Agents ---------------------------------------------------------------------------------------------------------------


def _pieces(piece_s: float = 0.04) -> tuple[list[np.ndarray], int, float]:
    """Return a TTS's audio in pieces, its rate, and the time of its first loud sample."""
    speech = EspeakVoice("en-us").speak(TEXT)
    step = round(piece_s * speech.sample_rate_hz)
    loud_s = int(np.argmax(np.abs(speech.samples.astype(int)) > LOUD)) / speech.sample_rate_hz
    pieces = [speech.samples[at : at + step] for at in range(0, len(speech.samples), step)]
    return pieces, speech.sample_rate_hz, loud_s


def _in_real_time(push: Callable[[np.ndarray, int], Awaitable[object]], end: Callable[[], Awaitable[object]]) -> Any:
    """Return functions that begin and stop a TTS that sends its audio as it is spoken."""
    pieces, rate_hz, loud_s = _pieces()
    tasks: list[asyncio.Task[None]] = []

    async def speak(begun_s: float) -> None:
        for number, piece in enumerate(pieces):
            await asyncio.sleep(begun_s + number * 0.04 - time.monotonic())
            await push(piece, rate_hz)
        await end()

    async def say() -> float:
        begun_s = time.monotonic()
        tasks.append(asyncio.create_task(speak(begun_s)))
        return begun_s + loud_s

    async def silence() -> None:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        tasks.clear()

    return say, silence


@asynccontextmanager
async def bot(
    pictured: Callable[[np.ndarray], object],
    heard: Callable[[np.ndarray], object],
    size: tuple[int, int] = (SIZE_PX, SIZE_PX),
    **options: Any,
) -> AsyncIterator[tuple[Any, Callable[[np.ndarray, int], Awaitable[None]], Callable[..., Awaitable[None]]]]:
    """A face in a pipeline of Pipecat; yield it, what pushes a piece of a TTS, and what ends or interrupts it.

    The functions get each image, (height, width, 3) uint8, and each piece of audio, (N,) int16, that leave the face.
    """
    from pipecat.frames import frames
    from pipecat.pipeline.pipeline import Pipeline
    from pipecat.pipeline.worker import PipelineWorker
    from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
    from pipecat.workers.runner import WorkerRunner

    from fapengine.agents.pipecat import FapengineVideoService

    class Sink(FrameProcessor):  # type: ignore[misc, unused-ignore]
        async def process_frame(self, frame: frames.Frame, direction: FrameDirection) -> None:
            await super().process_frame(frame, direction)
            if isinstance(frame, frames.OutputImageRawFrame):
                width, height = frame.size
                pictured(np.frombuffer(frame.image, np.uint8).reshape(height, width, 3))
            elif isinstance(frame, frames.TTSAudioRawFrame):
                heard(np.frombuffer(frame.audio, "<i2"))
            await self.push_frame(frame, direction)

    face = FapengineVideoService(size=size, **options)
    worker = PipelineWorker(Pipeline([face, Sink()]), cancel_on_idle_timeout=False)
    is_speaking = False

    async def push(piece: np.ndarray, rate_hz: int) -> None:
        nonlocal is_speaking
        if not is_speaking:
            is_speaking = True
            await worker.queue_frame(frames.TTSStartedFrame())
        audio = piece.astype("<i2").tobytes()
        await worker.queue_frame(frames.TTSAudioRawFrame(audio=audio, sample_rate=rate_hz, num_channels=1))

    async def end(*, interrupts: bool = False) -> None:
        nonlocal is_speaking
        is_speaking = False
        await worker.queue_frame(frames.InterruptionFrame() if interrupts else frames.TTSStoppedFrame())

    runner = WorkerRunner(handle_sigint=False)
    await runner.add_workers(worker)
    running = asyncio.create_task(runner.run())
    try:
        yield face, push, end
    finally:
        await worker.cancel()
        await asyncio.gather(running, return_exceptions=True)


@asynccontextmanager
async def pipecat() -> AsyncIterator[tuple[Watched, float]]:
    """Audio of a TTS in real time; what leaves the face in the pipeline, before any transport."""
    mouth: list[tuple[float, float]] = []
    sound: list[tuple[float, float]] = []
    begun_s = time.monotonic()
    async with bot(
        lambda picture: mouth.append((time.monotonic(), darkness(picture))),
        lambda samples: sound.append((time.monotonic(), float(np.abs(samples.astype(int)).max(initial=0)))),
        style=SPEECH,
    ) as (_, push, end):
        say, silence = _in_real_time(push, end)

        async def stop() -> None:
            await silence()
            await end(interrupts=True)

        client = Watched(DARK_PX, say, stop, mouth, sound)
        yield client, await _begun(client, begun_s)


@asynccontextmanager
async def livekit() -> AsyncIterator[tuple[Watched, float]]:
    """Audio of a TTS in real time by LiveKit's byte streams; what a visitor's ``rtc.Room`` receives from a worker."""
    from livekit import rtc

    from fapengine.agents import livekit as plugin
    from fapengine.agents.face import AgentOptions
    from tests.frameworks.check_livekit_server import token
    from tests.frameworks.livekit_server import LiveKitDouble

    async with AsyncExitStack() as stack:
        url = await stack.enter_async_context(LiveKitDouble().open())
        visitor, agent, reading = rtc.Room(), rtc.Room(), []

        async def read(track: Any) -> None:
            if track.kind == rtc.TrackKind.KIND_VIDEO:
                async for event in rtc.VideoStream(track, format=rtc.VideoBufferType.RGB24):
                    frame = event.frame
                    picture = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3)
                    if frame.width == SIZE_PX:
                        client.mouth.append((time.monotonic(), darkness(picture)))
                return
            async for event in rtc.AudioStream(track):
                samples = np.frombuffer(event.frame.data, np.int16).astype(int)
                client.sound.append((time.monotonic(), float(np.abs(samples).max(initial=0))))

        visitor.on("track_subscribed", lambda track, *_: reading.append(asyncio.create_task(read(track))))
        await visitor.connect(url, token("visitor"))
        await agent.connect(url, token("agent"))
        begun_s = time.monotonic()
        options = AgentOptions(size=(SIZE_PX, SIZE_PX), style=SPEECH)
        working = asyncio.create_task(plugin.work(url, token(plugin.IDENTITY), options))
        output = plugin.RemoteOutput(agent)

        async def push(piece: np.ndarray, rate_hz: int) -> None:
            await output.capture_frame(rtc.AudioFrame(piece.tobytes(), rate_hz, 1, len(piece)))

        async def end() -> None:
            output.flush()

        say, silence = _in_real_time(push, end)

        async def stop() -> None:
            await silence()
            output.flush()
            output.clear_buffer()

        client = Watched(DARK_PX, say, stop)
        try:
            yield client, await _begun(client, begun_s)
        finally:
            for task in (working, *reading):
                task.cancel()
            await asyncio.gather(working, *reading, return_exceptions=True)
            await visitor.disconnect()
            await agent.disconnect()


ROWS = {
    "OSC": osc, "WebSocket": web_socket, "WHEP, aiortc": whep, "WHEP, Chromium": chromium, "WHEP, Firefox": firefox,
    "Pipecat": pipecat, "LiveKit, stand-in for the server": livekit,
}  # fmt: skip


async def measured(name: str, trials: int, starts: int) -> dict[str, tuple[float, float]]:
    """Return p50 and p95 of each column, s."""
    found: dict[str, list[float]] = {}
    for number in range(starts):
        async with ROWS[name]() as (client, start_s):
            found.setdefault("start", []).append(start_s)
            for _ in range(trials if number == 0 else 0):
                for column, value in (await _trial(client)).items():
                    found.setdefault(column, []).append(value)
    return {column: tuple(np.percentile(values, (50, 95)).round(3)) for column, values in found.items()}


def main() -> None:
    """Measure, and print a row each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--starts", type=int, default=3)
    given = parser.parse_args()
    print("|  | start | sound | lips | rest |\n|---|---|---|---|---|")
    for name in given.only:
        try:
            delays_s = asyncio.run(measured(name, given.trials, given.starts))
        except (ImportError, TimeoutError) as error:
            print(f"{name}: {error or 'something did not come'}")
            continue
        cells = ["{:.2f}, {:.2f}".format(*delays_s[column]) if column in delays_s else "" for column in COLUMNS]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print(f"load {os.getloadavg()[0]:.1f}")


COLUMNS = ("start", "sound", "lips", "rest")

if __name__ == "__main__":
    main()
