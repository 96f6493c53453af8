"""Tracks and audio outputs of a face in a LiveKit room: the agent's audio in, synchronized audio and images out."""

import asyncio
import json
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from typing import Any

from livekit import rtc
from livekit.agents.utils import wait_for_track_publication
from livekit.agents.voice import avatar
from livekit.agents.voice.io import AudioOutputCapabilities

from fapengine.agents.face import AgentFace, AgentOptions

log = logging.getLogger("fapengine.agents")
SAMPLE_RATE_HZ = 24_000
LIVEKIT_AHEAD_S = 0.05
"""Time by which frames are early: with a frame of 0.04 s it nearly fills the queue of LiveKit's runner, 0.1 s. A
generator that is held up there would begin to play again after an interruption."""
IDENTITY = "fapengine-avatar"
"""Identity of a remote face in the room."""
FACE_RPC = "fapengine.face"
"""RPC by which an agent sends its remote face words, cues and pauses: JSON, a list of [name of an act, argument...]."""
MAX_ACTS = 50
"""Number of them in one call; LiveKit carries 15 kB."""


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
        self._resampler: rtc.AudioResampler | None = None
        self._resampled: tuple[int, int] | None = None
        """Sample rate and channels that the resampler takes."""

    async def push_audio(self, frame: rtc.AudioFrame | avatar.AudioSegmentEnd) -> None:
        """Add audio of any sample rate, or end an utterance."""
        if isinstance(frame, avatar.AudioSegmentEnd):
            self._finish_resampling()
            self.face.end()
            return
        form = frame.sample_rate, frame.num_channels
        if form != self._resampled:
            self._finish_resampling()
        if frame.sample_rate == SAMPLE_RATE_HZ:
            self._add([frame])
            return
        if self._resampler is None:
            self._resampler = rtc.AudioResampler(frame.sample_rate, SAMPLE_RATE_HZ, num_channels=frame.num_channels)
            self._resampled = form
        self._add(self._resampler.push(frame))

    def _add(self, frames: list[rtc.AudioFrame]) -> None:
        for frame in frames:
            self.face.sound(bytes(frame.data), frame.sample_rate, frame.num_channels)

    def _finish_resampling(self) -> None:
        if self._resampler is not None:
            self._add(self._resampler.flush())
        self._resampler = self._resampled = None

    def clear_buffer(self) -> None:
        """Stop speaking."""
        self._resampler = self._resampled = None
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


class FaceOutput(avatar.QueueAudioOutput):  # type: ignore[misc, unused-ignore]
    """The session's audio for a face in this process; it can be paused."""

    def __init__(self, face: AgentFace) -> None:
        super().__init__(sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True)
        self._capabilities = AudioOutputCapabilities(pause=True)  # the base class does not take them
        self._host = face.host

    def pause(self) -> None:
        """Hold the audio."""
        self._host.pause()

    def resume(self) -> None:
        """Continue."""
        self._host.resume()


class RemoteOutput(avatar.DataStreamAudioOutput):  # type: ignore[misc, unused-ignore]
    """The session's audio for a remote face, which also receives pauses, words and cues (:data:`FACE_RPC`)."""

    def __init__(self, room: rtc.Room) -> None:
        super().__init__(
            room, destination_identity=IDENTITY, sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True,
            wait_remote_track=rtc.TrackKind.KIND_VIDEO,
        )  # fmt: skip
        self._capabilities = AudioOutputCapabilities(pause=True)
        self._acts: list[tuple[Any, ...]] = []
        self._acting: asyncio.Task[None] | None = None

    def act(self, name: str, *given: Any) -> None:
        """Send an act of :func:`acts_of`, in order, as soon as the face shows itself."""
        self._acts.append((name, *given))
        if self._acting is None or self._acting.done():
            self._acting = asyncio.create_task(self._send())

    async def _send(self) -> None:
        while self._acts:
            try:
                await wait_for_track_publication(self._room, identity=IDENTITY, kind=rtc.TrackKind.KIND_VIDEO)
                acts, self._acts = self._acts[:MAX_ACTS], self._acts[MAX_ACTS:]
                await self._room.local_participant.perform_rpc(
                    destination_identity=IDENTITY, method=FACE_RPC, payload=json.dumps(acts)
                )
            except (RuntimeError, rtc.RpcError) as error:
                log.warning("the remote face did not receive words, cues or a pause: %s", error)
                if isinstance(error, RuntimeError):  # the face or the agent has left
                    self._acts.clear()

    def pause(self) -> None:
        """Hold the audio."""
        self.act("pause")

    def resume(self) -> None:
        """Continue."""
        self.act("resume")

    def clear_buffer(self) -> None:
        """Stop speaking; words and cues that were not sent yet are dropped."""
        self._acts = [act for act in self._acts if act[0] in ("pause", "resume")]
        super().clear_buffer()


def acts_of(face: AgentFace) -> dict[str, Callable[..., object]]:
    """Return what a session does to its face besides its audio, by name."""
    host = face.host
    return {"word": face.word, "expect": face.marks.expect, "pause": host.pause, "resume": host.resume}
