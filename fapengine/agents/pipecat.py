"""A face for Pipecat: a processor behind the TTS that adds pictures (``pip install fapengine[pipecat,voice,ear]``).

It takes the sound, and words with times where the TTS tells them, and pushes each picture with ``sync_with_audio`` into
the sound that belongs to it, so that the transport shows it when that sound is sent; let the transport send pieces of
10 ms (``audio_out_10ms_chunks=1``). What follows the sound still follows it. While nothing is said the face looks about
and blinks.

Examples
--------
A pipeline, with the transport's video switched on::

    face = FapengineVideoService(size=(512, 512))
    pipeline = Pipeline([transport.input(), stt, user, llm, tts, face, transport.output(), assistant])

Marks of the language model, such as ``[laughs]`` and emoji, are taken off before the TTS reads them, and shown::

    tts = CartesiaTTSService(..., text_transforms=[("*", face.marks)])
"""

import asyncio
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from pipecat.frames.frames import (
    CancelFrame,
    EndFrame,
    Frame,
    InterruptionFrame,
    OutputImageRawFrame,
    StartFrame,
    StopFrame,
    SystemFrame,
    TTSAudioRawFrame,
    TTSStartedFrame,
    TTSStoppedFrame,
    TTSTextFrame,
)
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
from pipecat.utils.text.base_text_filter import BaseTextFilter

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.audio.sound_queue import Sound
from fapengine.errors import FapEngineError
from fapengine.host.words import MarkTimer

PICTURE_AFTER_S = 0.01
"""Time in its sound at which a picture is pushed.

A transport's turns of 1/30 s show it 17 ms later in the mean, and a packet of Opus holds sound back by 20 ms;
``tests/frameworks/check_pipecat.py`` measures what comes of it.
"""


def around_picture(sounds: Sequence[Sound]) -> tuple[list[TTSAudioRawFrame], list[TTSAudioRawFrame]]:
    """Cut a frame's sound where its picture belongs, :data:`PICTURE_AFTER_S` behind its beginning."""
    parts: tuple[list[TTSAudioRawFrame], list[TTSAudioRawFrame]] = ([], [])
    for sound in sounds:
        cut = round(PICTURE_AFTER_S * sound.rate_hz)
        for part, samples in zip(parts, (sound.samples[:cut], sound.samples[cut:]), strict=True):
            if len(samples):
                part.append(TTSAudioRawFrame(samples.astype("<i2").tobytes(), sound.rate_hz, 1))
    return parts


class MarkFilter(BaseTextFilter):  # type: ignore[misc, unused-ignore]
    """Takes marks off the text on its way to the TTS, and remembers them for the face."""

    def __init__(self, marks: MarkTimer) -> None:
        self._marks = marks

    async def filter(self, text: str) -> str:
        """Return the text for the voice."""
        return self._marks.expect(text)

    async def __call__(self, text: str, kind: object = None) -> str:
        """Return the text for the voice, as one of Pipecat's text transforms; its kind does not matter."""
        return await self.filter(text)


class FapengineVideoService(FrameProcessor):  # type: ignore[misc, unused-ignore]
    """Adds a face to the sound of the TTS before it.

    Parameters
    ----------
    head, size, edges, frame_rate_hz, profile, voice, style, seed, hears
        As of :class:`fapengine.agents.face.AgentOptions`.
    **processor
        For Pipecat's ``FrameProcessor``, such as its name.
    """

    def __init__(self, *, face: AgentFace | None = None, options: AgentOptions | None = None, **given: Any) -> None:
        names = AgentOptions.__dataclass_fields__
        processor = {name: given.pop(name) for name in tuple(given) if name not in names}
        super().__init__(**processor)
        self._options = options or AgentOptions(**given)
        self._face = face or AgentFace.open(self._options)
        self.marks = MarkFilter(self._face.marks)
        """Give it to the TTS: ``text_transforms=[("*", face.marks)]``."""
        self._loop: asyncio.Task[None] | None = None
        self._cuts = 0
        """Number of interruptions."""
        self._is_silent = False
        """True from ``TTSStartedFrame`` to the first sound."""
        self._early: list[TTSTextFrame] = []
        """Words that came before the first sound of their utterance: its time 0 is not known yet."""
        self._behind: deque[tuple[int, Frame]] = deque()
        """Frames that follow sound, each with the utterance that it follows."""
        self._over = 0
        """Number of the last utterance that is over."""
        self._first_ns: dict[int, int] = {}
        """Pipeline's time of the first sound of each utterance that is not over; its words count from there."""
        self._delay_ns: dict[int, int] = {}
        """Time by which each goes out after it came in, once it does."""
        self._words: list[tuple[int, TTSTextFrame]] = []
        """Words for the transport, each with its utterance, that wait until the delay is known."""

    async def process_frame(self, frame: Frame, direction: FrameDirection) -> None:
        """Take what comes from the TTS, and what is to follow it."""
        await super().process_frame(frame, direction)
        if direction is not FrameDirection.DOWNSTREAM:
            await self.push_frame(frame, direction)
        elif isinstance(frame, StartFrame):
            await self.push_frame(frame, direction)
            self._loop = self.create_task(self._show())
        elif isinstance(frame, TTSAudioRawFrame):
            self._hear(frame)
            early, self._early = self._early, []
            for word in early:
                await self._read(word)
        elif isinstance(frame, TTSTextFrame) and frame.pts and self._is_silent:
            self._early.append(frame)
        elif isinstance(frame, TTSTextFrame) and frame.pts:
            await self._read(frame)
        elif isinstance(frame, InterruptionFrame):
            await self._interrupt(frame)
        elif isinstance(frame, SystemFrame):
            if isinstance(frame, CancelFrame):
                await self._stop()
            await self.push_frame(frame, direction)
        else:
            if isinstance(frame, TTSStoppedFrame | EndFrame | StopFrame):
                self._face.end()
                self._is_silent = False
                early, self._early = self._early, []
                for word in early:  # nothing sounded
                    await self._follow(word)
            elif isinstance(frame, TTSStartedFrame):
                self._is_silent = True
            await self._follow(frame)

    async def cleanup(self) -> None:
        """End its task and its processes."""
        await super().cleanup()
        await self._stop()
        self._face.close()

    def _hear(self, frame: TTSAudioRawFrame) -> None:
        self._face.sound(frame.audio, frame.sample_rate, frame.num_channels)
        self._is_silent = False
        self._first_ns.setdefault(self._face.host.newest, self.get_clock().get_time())

    async def _read(self, frame: TTSTextFrame) -> None:
        number = self._face.host.newest
        first_ns = self._first_ns.get(number, frame.pts)
        self._face.word(frame.text, max(frame.pts - first_ns, 0) / 1e9)
        self._words.append((number, frame))
        await self._push_words()

    async def _push_words(self) -> None:
        """Hand words on, later by as much as their sound is."""
        words, self._words = self._words, []
        for number, word in words:
            if number in self._delay_ns:
                word.pts += self._delay_ns[number]
                await self.push_frame(word)
            elif number > self._over:
                self._words.append((number, word))

    async def _interrupt(self, frame: InterruptionFrame) -> None:
        self._cuts += 1
        self._face.interrupt(time.monotonic())
        self._words.clear()
        self._early.clear()
        self._is_silent = False
        kept = [waiting for _, waiting in self._behind if not getattr(waiting, "interruptible", True)]
        self._behind.clear()
        await self.push_frame(frame)
        for waiting in kept:
            await self.push_frame(waiting)

    async def _follow(self, frame: Frame) -> None:
        """Push a frame behind the sound that came before it."""
        if self._face.host.is_speaking or self._behind:
            self._behind.append((self._face.host.newest, frame))
        else:
            await self.push_frame(frame)

    async def _show(self) -> None:
        """Push pictures and sound at their pace."""
        face = self._face
        try:
            await face.ready()
            while True:
                await asyncio.sleep(face.wait_s(time.monotonic()))
                cuts = self._cuts
                frame, events = face.frame(time.monotonic())
                await self._tell(events)
                picture = OutputImageRawFrame(await face.picture(frame.faps), self._options.size, "RGB")
                if cuts != self._cuts:
                    continue  # interrupted while it was drawn: nobody is to hear this any more
                picture.sync_with_audio = bool(frame.sounds)
                before, behind = around_picture(frame.sounds)
                for each in (*before, picture, *behind):
                    await self.push_frame(each)
        except FapEngineError as error:
            await self.push_error(error_msg=str(error), exception=error, fatal=True)

    async def _tell(self, events: list[Any]) -> None:
        for event in events:
            number = event.utterance
            if event.kind == "started":
                now_ns = self.get_clock().get_time()
                self._delay_ns[number] = now_ns - self._first_ns.get(number, now_ns)
                await self._push_words()
            else:
                self._over = number
                self._first_ns = {key: at_ns for key, at_ns in self._first_ns.items() if key > number}
                self._delay_ns = {key: delay for key, delay in self._delay_ns.items() if key >= number}
        while self._behind and (self._behind[0][0] <= self._over or not self._face.host.is_speaking):
            await self.push_frame(self._behind.popleft()[1])

    async def _stop(self) -> None:
        loop, self._loop = self._loop, None
        if loop is not None:
            await self.cancel_task(loop)
