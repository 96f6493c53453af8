"""A voice agent in one process, on Pipecat: recognizer, language model, voice and face for each visitor of its page.

``fapengine agent`` runs it. Recognizer and voice work in child processes. Pipecat adds RTVI, the protocol by which the
page and Pipecat's own clients get texts, states and errors.
"""

import asyncio
import inspect
from collections.abc import AsyncIterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from aiortc.sdp import candidate_from_sdp
from pipecat.audio.vad.silero import SileroVADAnalyzer
from pipecat.frames import frames
from pipecat.pipeline.pipeline import Pipeline
from pipecat.pipeline.worker import PipelineParams, PipelineWorker
from pipecat.processors.aggregators.llm_context import LLMContext
from pipecat.processors.aggregators.llm_response_universal import LLMContextAggregatorPair, LLMUserAggregatorParams
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
from pipecat.processors.frameworks.rtvi import BotOutputTransformResult, RTVIObserverParams
from pipecat.services.openai.llm import OpenAILLMService
from pipecat.services.openai.stt import OpenAISTTService
from pipecat.services.settings import STTSettings, TTSSettings
from pipecat.services.stt_service import SegmentedSTTService
from pipecat.services.tts_service import TTSService
from pipecat.transports.base_transport import TransportParams
from pipecat.transports.smallwebrtc.connection import SmallWebRTCConnection
from pipecat.transports.smallwebrtc.transport import SmallWebRTCTransport
from pipecat.turns.user_stop import SpeechTimeoutUserTurnStopStrategy
from pipecat.turns.user_turn_strategies import UserTurnStrategies
from pipecat.utils.time import time_now_iso8601
from pipecat.workers.runner import WorkerRunner

from fapengine.agents.endpoints import Endpoint
from fapengine.agents.face import AgentOptions
from fapengine.agents.pipecat import FapengineVideoService
from fapengine.errors import FapEngineError, NothingToSpeakError, UsageError
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.words import WordRecognizer
from fapengine.server.intake.tasks import Tasks
from fapengine.speech.marks import read_marks, words_of
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.process import VoiceProcess

SYSTEM = (
    "You talk with somebody in a video call: your answer is spoken. Answer in one to three short sentences of plain"
    " text. You may begin a sentence with [smiles], [laughs], [sighs] or [surprised], which your face shows."
)
"""Instructions of the language model, if the user gives none."""
MAX_VISITORS = 4
MAX_SPEECH_S = 60.0
"""Longest audio of one sentence."""
CONNECTS_S = 60.0
"""Time from an offer to the connection; then its place is free again."""
PIECE_S = 0.04
WORDS_COME_S, WORDS_LATEST_S = 2.0, 15.0
"""Time after speech within which its words are usually there; and time after which a turn ends without them."""
SENTENCE_COMES_S = 30.0
"""Longest time between two sentences of an answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BotOptions:
    """Parts of an agent."""

    face: AgentOptions
    voice: VoiceChoice
    llm: Endpoint | None = None
    """None: the agent says what it hears."""
    system: str = SYSTEM
    stt: Endpoint | str | None = None
    """``module:name`` of what returns a recognizer of Pipecat when it is called; None: PocketSphinx."""


class SpokenTTS(TTSService):  # type: ignore[misc, unused-ignore]
    """A voice of fapengine as Pipecat's TTS, with the times of its words.

    Parameters
    ----------
    choice : VoiceChoice
    voices : VoiceProcess
        Speaks; the caller closes it.
    **service
        Arguments of ``TTSService``, such as ``text_transforms``.
    """

    def __init__(self, choice: VoiceChoice, voices: VoiceProcess, **service: Any) -> None:
        super().__init__(
            settings=TTSSettings(model=None, voice=choice.name, language=None), push_start_frame=True,
            push_stop_frames=True, push_text_frames=False, stop_frame_timeout_s=SENTENCE_COMES_S, **service,
        )  # fmt: skip
        self._choice, self._voices = choice, voices

    async def run_tts(self, text: str, context_id: str) -> AsyncIterator[frames.Frame]:
        """Yield the audio of a text in pieces of 40 ms."""
        try:
            speech = await self._voices.speak(text, self._choice, MAX_SPEECH_S)
        except NothingToSpeakError:  # an emoji, a dash
            yield frames.TTSAudioRawFrame(bytes(960), 24_000, 1, context_id=context_id)
            return
        except FapEngineError as error:
            yield frames.ErrorFrame(error=str(error))
            return
        await self.start_word_timestamps()
        words = [(word, start_s) for word, start_s, _ in words_of(speech.phones.phones)]
        await self.add_word_timestamps(words, context_id)
        step = round(speech.sample_rate_hz * PIECE_S)
        for start in range(0, len(speech.samples), step):
            piece = speech.samples[start : start + step].astype("<i2").tobytes()
            yield frames.TTSAudioRawFrame(piece, speech.sample_rate_hz, 1, context_id=context_id)


class WordSTT(SegmentedSTTService):  # type: ignore[misc, unused-ignore]
    """PocketSphinx as Pipecat's STT: US English, on this machine.

    Parameters
    ----------
    recognizer : WordRecognizer
        The caller closes it.
    """

    def __init__(self, recognizer: WordRecognizer) -> None:
        settings = STTSettings(model="pocketsphinx", language=None)
        super().__init__(sample_rate=RATE_HZ, settings=settings, ttfs_p99_latency=WORDS_COME_S)
        self._recognizer = recognizer

    @property
    def wants_wav_segments(self) -> bool:
        """Whether utterances come as WAV files."""
        return False

    async def run_stt(self, audio: bytes) -> AsyncIterator[frames.Frame]:
        """Yield the words of an utterance, int16 at 16 kHz, if there are any."""
        try:
            text = await self._recognizer.words(np.frombuffer(audio, "<i2"))
        except FapEngineError as error:
            yield frames.ErrorFrame(error=str(error))
            return
        if text:
            yield frames.TranscriptionFrame(text, "", time_now_iso8601())


class Echo(FrameProcessor):  # type: ignore[misc, unused-ignore]
    """Stands in the place of the language model: says what the user said."""

    async def process_frame(self, frame: frames.Frame, direction: FrameDirection) -> None:
        """Answer the context, and pass on all else."""
        await super().process_frame(frame, direction)
        if not isinstance(frame, frames.LLMContextFrame):
            await self.push_frame(frame, direction)
            return
        said = [message["content"] for message in frame.context.get_messages() if message.get("role") == "user"]
        answer = [frames.LLMTextFrame(str(said[-1]))] if said else []
        for each in (frames.LLMFullResponseStartFrame(), *answer, frames.LLMFullResponseEndFrame()):
            await self.push_frame(each)


class Bot:
    """The agent, with a pipeline for each visitor. Stateful; close it.

    Parameters
    ----------
    options : BotOptions
    """

    def __init__(self, options: BotOptions) -> None:
        self.options = options
        self._voices, self._words = VoiceProcess(), WordRecognizer()
        self._connections: dict[str, SmallWebRTCConnection] = {}
        self._talks = Tasks()
        self._offers = 0
        """Offers of new visitors that are being answered."""

    async def start(self) -> None:
        """Start the processes, so that the first answer takes no longer than others; raises the voice's errors."""
        hears = [self._words.words(np.zeros(RATE_HZ, np.int16))] if self.options.stt is None else []
        await asyncio.gather(self._voices.speak("Hello.", self.options.voice, MAX_SPEECH_S), *hears)

    def may_talk(self, connection: str | None) -> bool:
        """Whether there is room for a visitor; there is for one who has a connection."""
        return connection in self._connections or len(self._talks) + self._offers < MAX_VISITORS

    async def offer(self, sdp: str, connection: str | None, *, restarts: bool) -> dict[str, str]:
        """Answer an offer of a new visitor, or of one whose connection is changed.

        Raises ValueError if it cannot be read.
        """
        known = self._connections.get(connection or "")
        is_new = known is None
        known = known or SmallWebRTCConnection()
        self._offers += is_new
        try:
            if is_new:
                await known.initialize(sdp=sdp, type="offer")
            else:
                await known.renegotiate(sdp=sdp, type="offer", restart_pc=restarts)
        except Exception as error:  # aiortc has many for bad offers
            if is_new or restarts:
                await known.disconnect()
            raise ValueError(f"offer: {error}") from error
        finally:
            self._offers -= is_new
        if is_new:
            talk = self._talks.start(self._talk(known))
            late = asyncio.get_running_loop().call_later(
                CONNECTS_S, lambda: known.pc.connectionState == "connected" or talk.cancel()
            )
            talk.add_done_callback(lambda _: late.cancel())
        answer: dict[str, str] = known.get_answer()
        self._connections[answer["pc_id"]] = known
        return answer

    async def candidate(self, connection: str, line: str, mid: str | None, index: int | None) -> None:
        """Add a candidate of a visitor; an empty one is the last.

        Raises KeyError if there is no such connection; ValueError if it cannot be read.
        """
        known = self._connections[connection]
        try:
            candidate = candidate_from_sdp(line.removeprefix("candidate:")) if line else None
            if candidate is not None:
                candidate.sdpMid, candidate.sdpMLineIndex = mid, index
            await known.add_ice_candidate(candidate)
        except Exception as error:  # aiortc has many for bad candidates
            raise ValueError(f"candidate: {error}") from error

    async def close(self) -> None:
        """Hang up, and end the processes."""
        await self._talks.close()
        self._words.close()
        self._voices.close()
        await self._voices.wait_closed()

    async def _talk(self, connection: SmallWebRTCConnection) -> None:
        """Talk to a visitor until it leaves."""
        try:
            runner = WorkerRunner(handle_sigint=False)
            await runner.add_workers(self._worker(connection))
            await runner.run()
        finally:
            self._connections = {key: one for key, one in self._connections.items() if one is not connection}
            await connection.disconnect()

    def _worker(self, connection: SmallWebRTCConnection) -> PipelineWorker:
        """Make the pipeline of a visitor."""
        width, height = self.options.face.size
        params = TransportParams(
            audio_in_enabled=True, audio_out_enabled=True, audio_out_10ms_chunks=1, video_out_enabled=True,
            video_out_width=width, video_out_height=height, video_out_framerate=30,
        )  # fmt: skip
        transport = SmallWebRTCTransport(connection, params)
        *before, last = self.processors()
        worker = PipelineWorker(
            Pipeline([transport.input(), *before, transport.output(), last]),
            params=PipelineParams(audio_in_sample_rate=RATE_HZ), cancel_on_idle_timeout=False,
            rtvi_observer_params=RTVIObserverParams(bot_output_transforms=[("*", _without_marks)]),
        )  # fmt: skip

        @transport.event_handler("on_client_disconnected")  # type: ignore[untyped-decorator, unused-ignore]
        async def gone(*_: object) -> None:
            await worker.cancel()

        return worker

    def processors(self) -> list[FrameProcessor]:
        """Make what stands between the transport's input and output, and the last one after it."""
        context = LLMContext()
        face = FapengineVideoService(options=self.options.face)
        user, assistant = LLMContextAggregatorPair(
            context,
            user_params=LLMUserAggregatorParams(
                vad_analyzer=SileroVADAnalyzer(),
                user_turn_strategies=UserTurnStrategies(stop=[SpeechTimeoutUserTurnStopStrategy()]),
                user_turn_stop_timeout=WORDS_LATEST_S,
                **({} if self.options.llm else {"empty_user_turn": None}),
            ),
        )
        voice = SpokenTTS(self.options.voice, self._voices, text_transforms=[("*", face.marks)])
        return [self._recognizer(), user, self._model(), voice, face, assistant]

    def _model(self) -> FrameProcessor:
        llm = self.options.llm
        if llm is None:
            return Echo()
        settings = OpenAILLMService.Settings(model=llm.model, system_instruction=self.options.system)
        return OpenAILLMService(api_key=llm.key or "none", base_url=llm.url, settings=settings)

    def _recognizer(self) -> FrameProcessor:
        stt = self.options.stt
        if stt is None:
            return WordSTT(self._words)
        if isinstance(stt, str):
            return recognizer_named(stt)()
        settings = OpenAISTTService.Settings(model=stt.model)
        return OpenAISTTService(api_key=stt.key or "none", base_url=stt.url, settings=settings)


async def _without_marks(text: str, _: str, accumulated: str | None, remaining: str | None) -> BotOutputTransformResult:
    """Remove inline cues from what clients show."""
    said, left = (part if part is None else read_marks(part).text for part in (accumulated, remaining))
    return BotOutputTransformResult(text=read_marks(text).text, accumulated_text=said, remaining_text=left)


def recognizer_named(name: str) -> Any:
    """Import ``module:name``, a class or function that returns a recognizer of Pipecat.

    Raises UsageError if it cannot be imported or called.
    """
    module, _, attribute = name.partition(":")
    try:
        made = getattr(import_module(module), attribute)
        inspect.signature(made).bind()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise UsageError(f"stt: {name} cannot be used: {error}") from error
    return made
