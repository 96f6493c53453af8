"""A voice agent with a face, in LiveKit Agents, in one file: no GPU, and no key but those of the LiveKit server.

::

    pip install "fapengine[livekit,voice,recognizer]"
    livekit-server --dev                        # or LIVEKIT_URL, LIVEKIT_API_KEY and LIVEKIT_API_SECRET of another
    python livekit_agent.py dev

Join the room with any client (https://agents-playground.livekit.io) and type into its chat: the agent answers, and its
face speaks. To make it yours, give :class:`AgentSession` your STT and LLM, and your TTS in place of :class:`EspeakTTS`.
"""

import asyncio
import os
from collections.abc import AsyncIterable
from functools import partial

from livekit.agents import Agent, AgentServer, AgentSession, JobContext, ModelSettings, cli, room_io, tts, utils
from livekit.agents.types import DEFAULT_API_CONNECT_OPTIONS, APIConnectOptions, TimedString

from fapengine.agents.livekit import AvatarSession, prewarm_fnc
from fapengine.speech.marks import words_of
from fapengine.voices.espeak import EspeakVoice, sample_rate_hz

for name, value in {"URL": "ws://127.0.0.1:7880", "API_KEY": "devkey", "API_SECRET": "secret"}.items():
    os.environ.setdefault(f"LIVEKIT_{name}", value)  # those of livekit-server --dev


class EspeakTTS(tts.TTS):
    """espeak-ng as LiveKit's TTS, with the time of each word; your TTS goes here."""

    def __init__(self, voice: str = "en-us") -> None:
        capabilities = tts.TTSCapabilities(streaming=True, aligned_transcript=True)
        super().__init__(capabilities=capabilities, sample_rate=sample_rate_hz(), num_channels=1)
        self.spoken_by = EspeakVoice(voice)

    def synthesize(self, text: str, *, conn_options: APIConnectOptions = DEFAULT_API_CONNECT_OPTIONS):
        """Speak a text that is whole."""
        return self._synthesize_with_stream(text, conn_options=conn_options)

    def stream(self, *, conn_options: APIConnectOptions = DEFAULT_API_CONNECT_OPTIONS) -> tts.SynthesizeStream:
        """Speak a text that comes in pieces."""
        return _Speaking(tts=self, conn_options=conn_options)


class _Speaking(tts.SynthesizeStream):
    async def _run(self, output_emitter: tts.AudioEmitter) -> None:
        output_emitter.initialize(
            request_id=utils.shortuuid(), sample_rate=self._tts.sample_rate, num_channels=1, mime_type="audio/pcm",
            stream=True,
        )  # fmt: skip
        text = ""
        async for piece in self._input_ch:
            if isinstance(piece, str):
                text += piece
            elif text.strip():  # flush: what came so far is to be said
                await self._say(text, output_emitter)
                text = ""
        if text.strip():
            await self._say(text, output_emitter)

    async def _say(self, text: str, output_emitter: tts.AudioEmitter) -> None:
        self._mark_started()
        speech = await asyncio.to_thread(self._tts.spoken_by.speak, text)
        output_emitter.start_segment(segment_id=utils.shortuuid())
        for word, start_s, end_s in words_of(speech.phones.phones):
            output_emitter.push_timed_transcript(TimedString(f"{word} ", start_time=start_s, end_time=end_s))
        output_emitter.push(speech.samples.astype("<i2").tobytes())
        output_emitter.end_segment()


class Assistant(Agent):
    """An agent whose marks and words move its face."""

    def __init__(self, avatar: AvatarSession) -> None:
        super().__init__(instructions="You are friendly. Put [smiles] or [laughs] where you do.")
        self._avatar = avatar

    def tts_node(self, text: AsyncIterable[str], model_settings: ModelSettings):
        """Take the marks off the text."""
        return Agent.default.tts_node(self, self._avatar.without_marks(text), model_settings)

    async def transcription_node(self, text: AsyncIterable[str | TimedString], model_settings: ModelSettings):
        """Tell the face the words and their times."""
        async for piece in self._avatar.read(text):
            yield piece


def answer(text: str) -> str:
    """Say it again; your LLM goes here."""
    return f"[smiles] You said: {text}"


def session_of() -> AgentSession:
    """Make the session; add ``stt=`` and ``llm=``."""
    return AgentSession(tts=EspeakTTS(), use_tts_aligned_transcript=True)


server = AgentServer()
server.setup_fnc = partial(prewarm_fnc, head="woman", size=(512, 512))  # the face shows at once in a room


@server.rtc_session()
async def entrypoint(ctx: JobContext) -> None:
    """Be the agent of one room."""

    async def typed(session: AgentSession, event: room_io.TextInputEvent) -> None:
        await session.interrupt()
        session.say(answer(event.text))

    avatar, session = AvatarSession(head="woman", size=(512, 512)), session_of()
    await ctx.connect()
    await avatar.start(session, room=ctx.room)
    await session.start(
        Assistant(avatar), room=ctx.room,
        room_options=room_io.RoomOptions(text_input=room_io.TextInputOptions(text_input_cb=typed), audio_output=False),
    )  # fmt: skip
    session.say("[smiles] Hello. What may I say for you?")


if __name__ == "__main__":
    cli.run_app(server)
