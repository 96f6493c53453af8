"""A face for Pipecat: a processor after the TTS that adds images (``pip install fapengine[pipecat,voice,recognizer]``).

It reads the audio, and the words with times if the TTS reports them. It pushes each image with ``sync_with_audio`` into
its audio, so that the transport shows it when that audio is sent; set the transport to chunks of 10 ms
(``audio_out_10ms_chunks=1``). Audio is pushed in real time, however long an image takes; an image that is not ready by
then follows alone, when its audio is due. The order of frames after the audio is kept. In silence the face looks around
and blinks; while the user speaks it looks at them and nods, until its answer begins it looks aside.

Examples
--------
A pipeline, with the transport's video switched on::

    face = FapengineVideoService(size=(512, 512))
    pipeline = Pipeline([transport.input(), stt, user, llm, tts, face, transport.output(), assistant])

Inline cues of the language model, such as ``[laughs]`` and emoji, are removed before the TTS, and shown::

    tts = CartesiaTTSService(..., text_transforms=[("*", face.marks)])
"""

import asyncio
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from pipecat.frames import frames
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
from pipecat.utils.text.base_text_filter import BaseTextFilter

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.pictures import Picture
from fapengine.agents.warm import open_face
from fapengine.audio.sound_queue import Sound
from fapengine.host.words import MarkTimer

PICTURE_AFTER_S = 0.01
"""Position in its audio at which an image is pushed.

The transport's period of 1/30 s delays images by 17 ms on average, a packet of Opus delays audio by 20 ms;
``tests/frameworks/check_pipecat.py`` measures the result.
"""


def around_picture(sounds: Sequence[Sound]) -> tuple[list[frames.TTSAudioRawFrame], list[frames.TTSAudioRawFrame]]:
    """Split a frame's audio at the position of its image, :data:`PICTURE_AFTER_S` after its beginning."""
    parts: tuple[list[frames.TTSAudioRawFrame], list[frames.TTSAudioRawFrame]] = ([], [])
    for sound in sounds:
        cut = round(PICTURE_AFTER_S * sound.rate_hz)
        for part, samples in zip(parts, (sound.samples[:cut], sound.samples[cut:]), strict=True):
            if len(samples):
                part.append(frames.TTSAudioRawFrame(samples.astype("<i2").tobytes(), sound.rate_hz, 1))
    return parts


class MarkFilter(BaseTextFilter):  # type: ignore[misc, unused-ignore]
    """Removes inline cues from the text before the TTS, and keeps them for the face."""

    def __init__(self, marks: MarkTimer) -> None:
        self._marks = marks

    async def filter(self, text: str) -> str:
        """Return the text for the voice."""
        return self._marks.expect(text)

    async def __call__(self, text: str, kind: object = None) -> str:
        """Return the text for the voice; Pipecat calls this as a text transform."""
        return await self.filter(text)


class FapengineVideoService(FrameProcessor):  # type: ignore[misc, unused-ignore]
    """Adds a face to the audio of the TTS before it.

    Parameters
    ----------
    head, size, edges, frame_rate_hz, profile, voice, style, seed, hears
        Fields of :class:`fapengine.agents.face.AgentOptions`.
    **processor
        Arguments of Pipecat's ``FrameProcessor``, such as its name.
    """

    def __init__(self, *, face: AgentFace | None = None, options: AgentOptions | None = None, **given: Any) -> None:
        names = AgentOptions.__dataclass_fields__
        processor = {name: given.pop(name) for name in tuple(given) if name not in names}
        super().__init__(**processor)
        self._options = options or AgentOptions(**given)
        self._face = face or open_face(self._options)
        self.marks = MarkFilter(self._face.marks)
        """Text transform for the TTS: ``text_transforms=[("*", face.marks)]``."""
        self._loop: asyncio.Task[None] | None = None
        self._cuts = 0
        """Number of interruptions."""
        self._late: deque[Picture] = deque()
        """Images that were not ready when their audio was pushed, up to 0.2 s before it is heard."""
        self._is_blind = False
        """True once it was reported that there are no more images."""
        self._is_silent = False
        """True from ``TTSStartedFrame`` to the first audio."""
        self._early: list[frames.TTSTextFrame] = []
        """Words that came before the first audio of their utterance, when its time 0 is not known yet."""
        self._behind: deque[tuple[int, frames.Frame]] = deque()
        """Frames that must follow audio, each with the number of its utterance."""
        self._over = 0
        """Number of the last finished utterance."""
        self._first_ns: dict[int, int] = {}
        """Pipeline time of the first audio of each unfinished utterance, from which its words count."""
        self._delay_ns: dict[int, int] = {}
        """Delay of the audio of each utterance in this processor, once it is known."""
        self._words: list[tuple[int, frames.TTSTextFrame]] = []
        """Words for the transport, each with its utterance, until the delay is known."""

    async def process_frame(self, frame: frames.Frame, direction: FrameDirection) -> None:
        """Handle the frames of the TTS, and those that must follow them."""
        await super().process_frame(frame, direction)
        if direction is not FrameDirection.DOWNSTREAM:
            await self.push_frame(frame, direction)
        elif isinstance(frame, frames.StartFrame):
            await self.push_frame(frame, direction)
            self._loop = self.create_task(self._show())
        elif isinstance(frame, frames.TTSAudioRawFrame):
            self._hear(frame)
            early, self._early = self._early, []
            for word in early:
                await self._read(word)
        elif isinstance(frame, frames.TTSTextFrame) and frame.pts and self._is_silent:
            self._early.append(frame)
        elif isinstance(frame, frames.TTSTextFrame) and frame.pts:
            await self._read(frame)
        elif isinstance(frame, frames.InterruptionFrame):
            await self._interrupt(frame)
        elif isinstance(frame, frames.SystemFrame):
            if isinstance(frame, frames.CancelFrame):
                await self._stop()
            elif isinstance(frame, frames.UserStartedSpeakingFrame | frames.UserStoppedSpeakingFrame):
                is_heard = isinstance(frame, frames.UserStartedSpeakingFrame)
                self._face.attend("listening" if is_heard else "thinking")
            await self.push_frame(frame, direction)
        else:
            if isinstance(frame, frames.LLMFullResponseStartFrame):
                self._face.attend("thinking")
            elif isinstance(frame, frames.TTSStoppedFrame | frames.EndFrame | frames.StopFrame):
                self._face.end()
                self._is_silent = False
                early, self._early = self._early, []
                for word in early:  # there was no audio
                    await self._follow(word)
            elif isinstance(frame, frames.TTSStartedFrame):
                self._is_silent = True
            await self._follow(frame)

    async def cleanup(self) -> None:
        """End the task and the processes."""
        await super().cleanup()
        await self._stop()
        self._face.close()

    def _hear(self, frame: frames.TTSAudioRawFrame) -> None:
        self._face.sound(frame.audio, frame.sample_rate, frame.num_channels)
        self._is_silent = False
        self._first_ns.setdefault(self._face.host.newest, self.get_clock().get_time())

    async def _read(self, frame: frames.TTSTextFrame) -> None:
        number = self._face.host.newest
        first_ns = self._first_ns.get(number, frame.pts)
        self._face.word(frame.text, max(frame.pts - first_ns, 0) / 1e9)
        self._words.append((number, frame))
        await self._push_words()

    async def _push_words(self) -> None:
        """Push words with the delay of their audio."""
        words, self._words = self._words, []
        for number, word in words:
            if number in self._delay_ns:
                word.pts += self._delay_ns[number]
                await self.push_frame(word)
            elif number > self._over:
                self._words.append((number, word))

    async def _interrupt(self, frame: frames.InterruptionFrame) -> None:
        self._cuts += 1
        self._late.clear()
        self._face.interrupt(time.monotonic())
        self._words.clear()
        self._early.clear()
        self._is_silent = False
        kept = [waiting for _, waiting in self._behind if not getattr(waiting, "interruptible", True)]
        self._behind.clear()
        await self.push_frame(frame)
        for waiting in kept:
            await self.push_frame(waiting)

    async def _follow(self, frame: frames.Frame) -> None:
        """Push a frame after the audio that came before it."""
        if self._face.host.is_speaking or self._behind:
            self._behind.append((self._face.host.newest, frame))
        else:
            await self.push_frame(frame)

    async def _show(self) -> None:
        """Push images and audio in real time."""
        face = self._face
        await face.hears()
        while True:
            await asyncio.sleep(face.wait_s(time.monotonic()))
            cuts = self._cuts
            frame, events = face.frame(time.monotonic())
            await self._tell(events)
            face.show(frame)
            picture = await face.drawn(face.image_wait_s(time.monotonic()))
            if cuts != self._cuts:
                continue  # interrupted while it was rendered
            is_own = picture is not None and picture.due_s == face.plays_s
            if picture is not None and picture.due_s < face.plays_s:  # later ones are of audio that was interrupted
                self._late.append(picture)
            await self._push_late(time.monotonic() + face.dt_s / 2)
            before, behind = around_picture(frame.sounds)
            for each in before:
                await self.push_frame(each)
            if picture is not None and is_own:
                await self._push_picture(picture, sync_with_audio=bool(frame.sounds))
            for each in behind:
                await self.push_frame(each)
            if face.pictures.failure is not None and not self._is_blind:
                self._is_blind = True
                error = face.pictures.failure
                await self.push_error(error_msg=str(error), exception=error)

    async def _push_late(self, until_s: float) -> None:
        """Push the newest image that was not ready for its own audio and is due."""
        newest = None
        while self._late and self._late[0].due_s <= until_s:
            newest = self._late.popleft()
        if newest is not None:
            await self._push_picture(newest, sync_with_audio=False)

    async def _push_picture(self, picture: Picture, *, sync_with_audio: bool) -> None:
        image = frames.OutputImageRawFrame(picture.pixels, self._options.size, "RGB")
        image.sync_with_audio = sync_with_audio
        await self.push_frame(image)

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
