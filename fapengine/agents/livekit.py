"""A face for LiveKit Agents, in the agent or as a worker (``pip install fapengine[livekit,voice,recognizer]``).

Examples
--------
In the agent's entry point, before ``session.start``::

    avatar = AvatarSession(head="woman", size=(512, 512))
    await avatar.start(session, room=ctx.room)

It shows at once if its process was started before the job came::

    server.setup_fnc = partial(prewarm_fnc, head="woman", size=(512, 512))  # of an older WorkerOptions: prewarm_fnc

Words with times make better lip motion than audio alone, and inline cues such as ``[laughs]`` move the face::

    class Assistant(Agent):
        async def tts_node(self, text, settings):
            async for frame in Agent.default.tts_node(self, avatar.without_marks(text), settings):
                yield frame

        async def transcription_node(self, text, settings):  # with use_tts_aligned_transcript=True
            async for piece in avatar.read(text):
                yield piece

A separate worker, which joins a room and answers the agent's ``DataStreamAudioOutput``::

    python -m fapengine.agents.livekit wss://host TOKEN --head woman
"""

import argparse
import asyncio
import re
import time
from collections import deque
from collections.abc import AsyncIterable, AsyncIterator
from typing import Any

from livekit import rtc
from livekit.agents import voice
from livekit.agents.voice import avatar

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.warm import open_face, prewarm
from fapengine.render.drawing import EDGES

SAMPLE_RATE_HZ = 24_000
LIVEKIT_AHEAD_S = 0.05
"""Time by which frames are early: with a frame of 0.04 s it nearly fills the queue of LiveKit's runner, 0.1 s. A
generator that is held up there would begin to play again after an interruption."""
_SENTENCE = re.compile(r"[.!?…]+[\"')\]]*\s+|\n+")


class FaceGenerator(avatar.VideoGenerator):  # type: ignore[misc, unused-ignore]
    """Turns the agent's audio into images; an image follows its audio, which does not wait for it.

    Parameters
    ----------
    face : AgentFace
    size : (int, int)
        Width and height of its images.
    """

    def __init__(self, face: AgentFace, size: tuple[int, int]) -> None:
        self.face, self._size = face, size
        self._ends_s: deque[float] = deque()
        """Times at which the audio of finished utterances has been played."""

    async def push_audio(self, frame: rtc.AudioFrame | avatar.AudioSegmentEnd) -> None:
        """Add audio, or end an utterance."""
        if isinstance(frame, avatar.AudioSegmentEnd):
            self.face.end()
        else:
            self.face.sound(bytes(frame.data), frame.sample_rate, frame.num_channels)

    def clear_buffer(self) -> None:
        """Stop speaking."""
        self.face.interrupt(time.monotonic())
        self._ends_s.clear()

    async def __aiter__(self) -> AsyncIterator[rtc.VideoFrame | rtc.AudioFrame | avatar.AudioSegmentEnd]:
        """Yield audio and images in real time, and the end of each utterance when it has been played."""
        await self.face.hears()
        while True:
            await asyncio.sleep(self.face.wait_s(time.monotonic(), LIVEKIT_AHEAD_S))
            now_s = time.monotonic()
            frame, events = self.face.frame(now_s)
            self._ends_s.extend(now_s + self.face.unplayed_s(now_s) for event in events if event.kind == "finished")
            self.face.show(frame)
            for sound in frame.sounds:
                data = sound.samples.astype("<i2").tobytes()
                yield rtc.AudioFrame(data, sound.rate_hz, 1, len(sound.samples))
            picture = await self.face.drawn(self.face.wait_s(time.monotonic(), LIVEKIT_AHEAD_S))
            if picture is not None:
                yield rtc.VideoFrame(*self._size, rtc.VideoBufferType.RGB24, picture.pixels)
            while self._ends_s and self._ends_s[0] <= time.monotonic():
                self._ends_s.popleft()
                yield avatar.AudioSegmentEnd()


class AvatarSession(avatar.AvatarSession):  # type: ignore[misc, unused-ignore]
    """A face in the agent's process; its audio and video are published by the agent's own participant.

    Parameters
    ----------
    **options
        Fields of :class:`fapengine.agents.face.AgentOptions`: ``head``, ``size``, ``frame_rate_hz``, ...
    """

    def __init__(self, **options: Any) -> None:
        super().__init__()
        self._room: rtc.Room | None = None
        self._options = AgentOptions(**options)
        self._face = open_face(self._options)
        self._runner: avatar.AvatarRunner | None = None

    @property
    def avatar_identity(self) -> str:
        """Identity of the agent's own participant."""
        return str(self._room.local_participant.identity) if self._room is not None else ""

    @property
    def provider(self) -> str:
        """Name for metrics."""
        return "fapengine"

    async def start(self, agent_session: voice.AgentSession, room: rtc.Room) -> None:
        """Begin to show the face in a room, and to receive the session's audio.

        Raises
        ------
        ResourceError
            If the face cannot be rendered.
        """
        await super().start(agent_session, room)
        await self._face.ready()
        output = avatar.QueueAudioOutput(sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True)
        self._runner = runner_of(room, output, self._face, self._options)
        await self._runner.start()
        agent_session.output.replace_audio_tail(output)

    async def aclose(self) -> None:
        """End it. The participant stays, because it is the agent's."""
        if self._room is not None:
            self._room.off("connection_state_changed", self._on_connection_state_changed)
            self._room = None
        await super().aclose()
        runner, self._runner = self._runner, None
        if runner is not None:
            await runner.aclose()
        self._face.close()

    async def read(self, text: AsyncIterable[Any]) -> AsyncIterator[Any]:
        """Pass on a transcription, and read its words with times; for ``Agent.transcription_node``.

        A TTS that does not stream has times of sentences only; then the recognizer is more precise.
        """
        async for piece in text:
            start_s, end_s = getattr(piece, "start_time", None), getattr(piece, "end_time", None)
            is_word = len(str(piece).split()) == 1 or self._face.recognizer is None
            if isinstance(start_s, int | float) and is_word:
                self._face.word(str(piece), float(start_s), float(end_s) if isinstance(end_s, int | float) else None)
            yield piece

    async def without_marks(self, text: AsyncIterable[str]) -> AsyncIterator[str]:
        """Remove inline cues from a text, sentence by sentence, and keep them for the face; for ``Agent.tts_node``."""
        waiting = ""
        async for piece in text:
            waiting += piece
            ends = [match.end() for match in _SENTENCE.finditer(waiting)]
            if ends:
                ready, waiting = waiting[: ends[-1]], waiting[ends[-1] :]
                yield self._face.marks.expect(ready).rstrip() + " "
        if waiting.strip():
            yield self._face.marks.expect(waiting)


def prewarm_fnc(_: object, **options: Any) -> None:
    """Start a face for the next job of a LiveKit process; the options are those of :class:`AvatarSession`."""
    prewarm(1, **options)


def runner_of(
    room: rtc.Room, sound: avatar.AudioReceiver, face: AgentFace, options: AgentOptions
) -> avatar.AvatarRunner:
    """Make LiveKit's runner, which publishes both tracks in sync."""
    width, height = options.size
    return avatar.AvatarRunner(
        room,
        audio_recv=sound,
        video_gen=FaceGenerator(face, options.size),
        options=avatar.AvatarOptions(
            video_width=width, video_height=height, video_fps=options.frame_rate_hz,
            audio_sample_rate=SAMPLE_RATE_HZ, audio_channels=1,
        ),
    )  # fmt: skip


async def work(url: str, token: str, options: AgentOptions) -> None:
    """Run an avatar in a room until it is disconnected: read ``lk.audio_stream`` and answer its RPCs.

    Parameters
    ----------
    url, token : str
        Address of the LiveKit server, and access token of the room.
    options : AgentOptions
    """
    face, room = open_face(options), rtc.Room()
    left = asyncio.Event()
    room.on("disconnected", lambda _: left.set())
    runner = None
    try:
        await face.ready()
        await room.connect(url, token)
        runner = runner_of(room, avatar.DataStreamAudioReceiver(room), face, options)
        await runner.start()
        await left.wait()
    finally:
        if runner is not None:
            await runner.aclose()
        await room.disconnect()
        face.close()


def main() -> None:
    """Run the worker's command line."""
    parser = argparse.ArgumentParser(prog="python -m fapengine.agents.livekit", description="An avatar worker.")
    parser.add_argument("url", help="LiveKit server, as wss://host")
    parser.add_argument("token", help="access token of the avatar's participant")
    parser.add_argument("--head", default="default", help="name or folder of a head")
    parser.add_argument("--size", type=int, nargs=2, default=(512, 512), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--antialias", choices=EDGES, default="soft", help="antialiasing")
    parser.add_argument("--rate", type=float, default=25.0, help="frames per second")
    given = parser.parse_args()
    options = AgentOptions(head=given.head, size=tuple(given.size), edges=given.antialias, frame_rate_hz=given.rate)
    asyncio.run(work(given.url, given.token, options))


if __name__ == "__main__":
    main()
