"""A voice agent with a face, in Pipecat, in one file: no key, no GPU, nothing from outside.

::

    pip install "fapengine[pipecat,voice,recognizer]" "pipecat-ai[webrtc]"
    python pipecat_agent.py                     # then open http://127.0.0.1:7860/

Type a sentence: the agent answers, and its face speaks. To make it yours, put your STT, LLM and TTS in place of
:class:`Brain` and :class:`EspeakTTS`; the face stays where it is, behind the TTS.
"""

import argparse
import asyncio
import uuid

from aiohttp import web
from pipecat.frames.frames import (
    Frame,
    InterruptionFrame,
    TTSAudioRawFrame,
    TTSSpeakFrame,
)
from pipecat.pipeline.pipeline import Pipeline
from pipecat.pipeline.worker import PipelineParams, PipelineWorker
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
from pipecat.processors.frameworks.rtvi import RTVIClientMessageFrame
from pipecat.services.settings import TTSSettings
from pipecat.services.tts_service import TTSService
from pipecat.transports.base_transport import TransportParams
from pipecat.transports.smallwebrtc.connection import SmallWebRTCConnection
from pipecat.transports.smallwebrtc.transport import SmallWebRTCTransport
from pipecat.workers.runner import WorkerRunner

from fapengine.agents import prewarm
from fapengine.agents.pipecat import FapengineVideoService
from fapengine.speech.marks import words_of
from fapengine.voices.espeak import EspeakVoice

SIZE = (512, 512)
PAGE = """<!doctype html><meta charset="utf-8"><title>An agent</title>
<video id="face" autoplay playsinline width="512" height="512"></video>
<form id="ask"><input id="text" size="50" placeholder="Say something" autofocus><button>Send</button></form>
<script type="module">
const peer = new RTCPeerConnection(), stream = new MediaStream();
const channel = peer.createDataChannel("chat");
peer.ontrack = ({ track }) => { stream.addTrack(track); face.srcObject = stream; };
for (const kind of ["audio", "video"]) peer.addTransceiver(kind, { direction: "recvonly" });
await peer.setLocalDescription(await peer.createOffer());
if (peer.iceGatheringState !== "complete")
  await new Promise((done) => peer.addEventListener("icegatheringstatechange",
    () => peer.iceGatheringState === "complete" && done()));
const answer = await fetch("/offer", { method: "POST", body: JSON.stringify(peer.localDescription) });
await peer.setRemoteDescription(await answer.json());
ask.onsubmit = (event) => {
  event.preventDefault();
  const data = { t: "say", d: { text: text.value } };
  channel.send(JSON.stringify({ label: "rtvi-ai", type: "client-message", id: String(Date.now()), data }));
  text.value = "";
};
</script>"""


class Brain(FrameProcessor):
    """Answers what is typed; your LLM goes here. What comes while the agent speaks interrupts it."""

    async def process_frame(self, frame: Frame, direction: FrameDirection) -> None:
        """Answer a message; pass all else on."""
        await super().process_frame(frame, direction)
        if isinstance(frame, RTVIClientMessageFrame) and frame.type == "say":
            await self.push_frame(InterruptionFrame())
            await self.push_frame(TTSSpeakFrame(self.answer(str(frame.data["text"]))))
        else:
            await self.push_frame(frame, direction)

    def answer(self, text: str) -> str:
        """Say it again."""
        return f"[smiles] You said: {text}"


class EspeakTTS(TTSService):
    """espeak-ng as Pipecat's TTS, with the time of each word; your TTS goes here."""

    def __init__(self, voice: str = "en-us", **given: object) -> None:
        settings = TTSSettings(model=None, voice=voice, language=None)
        super().__init__(
            settings=settings, push_start_frame=True, push_stop_frames=True, push_text_frames=False, **given
        )
        self._spoken_by = EspeakVoice(voice)

    async def run_tts(self, text: str, context_id: str):
        """Give a sentence's sound in pieces of 40 ms, and the times of its words."""
        speech = await asyncio.to_thread(self._spoken_by.speak, text)
        await self.start_word_timestamps()
        words = [(word, start_s) for word, start_s, _ in words_of(speech.phones.phones)]
        await self.add_word_timestamps(words, context_id)
        rate_hz = speech.sample_rate_hz
        for start in range(0, len(speech.samples), rate_hz // 25):
            piece = speech.samples[start : start + rate_hz // 25].tobytes()
            yield TTSAudioRawFrame(audio=piece, sample_rate=rate_hz, num_channels=1, context_id=context_id)


def processors(size: tuple[int, int] = SIZE) -> list[FrameProcessor]:
    """Make what stands between the transport's input and its output."""
    face = FapengineVideoService(head="woman", size=size)
    return [Brain(), EspeakTTS(text_transforms=[("*", face.marks)]), face]


async def talk(connection: SmallWebRTCConnection, size: tuple[int, int]) -> None:
    """Be the agent of one visitor, until it leaves."""
    params = TransportParams(
        audio_out_enabled=True, audio_out_10ms_chunks=1,
        video_out_enabled=True, video_out_width=size[0], video_out_height=size[1], video_out_framerate=30,
    )  # fmt: skip
    transport = SmallWebRTCTransport(connection, params)
    pipeline = Pipeline([transport.input(), *processors(size), transport.output()])
    worker = PipelineWorker(pipeline, params=PipelineParams(), cancel_on_idle_timeout=False)

    @transport.event_handler("on_client_disconnected")
    async def gone(*_: object) -> None:
        await worker.cancel()

    runner = WorkerRunner(handle_sigint=False)
    await runner.add_workers(worker)
    await runner.run()


def application(size: tuple[int, int] = SIZE) -> web.Application:
    """Make the page, and the door by which it calls."""
    visits: set[asyncio.Task[None]] = set()

    async def page(_: web.Request) -> web.Response:
        return web.Response(text=PAGE, content_type="text/html")

    async def offer(request: web.Request) -> web.Response:
        said = await request.json()
        connection = SmallWebRTCConnection()
        await connection.initialize(said["sdp"], said["type"])
        visit = asyncio.create_task(talk(connection, size), name=f"visitor {uuid.uuid4()}")
        visits.add(visit)
        visit.add_done_callback(visits.discard)
        answer = connection.get_answer()
        return web.json_response({"sdp": answer["sdp"], "type": answer["type"]})

    async def close(_: web.Application) -> None:
        for visit in visits:
            visit.cancel()
        await asyncio.gather(*visits, return_exceptions=True)

    app = web.Application()
    app.on_cleanup.append(close)
    app.add_routes([web.get("/", page), web.post("/offer", offer)])
    return app


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--port", type=int, default=7860)
    given = parser.parse_args()
    prewarm(1, head="woman", size=SIZE)  # a caller sees the face at once
    web.run_app(application(), host="127.0.0.1", port=given.port)
