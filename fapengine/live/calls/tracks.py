"""The two tracks of a call, and what becomes of a film's pictures and blocks on their way into them."""

import asyncio
from collections import deque
from collections.abc import Callable
from fractions import Fraction

import av
import numpy as np
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack

from fapengine.live.film.film import SHOW_AFTER_S
from fapengine.live.film.soundtrack import RATE_HZ, Samples

VIDEO_HZ = 90_000
MAX_PICTURES, MAX_BLOCKS = 2, 50
"""Pictures and blocks that may wait for a caller whose encoder is behind; the oldest is dropped."""


class FilmTrack(MediaStreamTrack):
    """One track: what has an engine time is handed on :data:`SHOW_AFTER_S` behind it.

    Both tracks of a call have one zero, and hand on at one time what belongs together: a receiver that plays by the
    sender's reports (RFC 3550, 6.4.1), as browsers do, and one that plays what comes have lips and sound together.

    Stateful.

    Parameters
    ----------
    kind : str
        ``"audio"`` or ``"video"``.
    most : int
        What may wait.
    clock : callable
        The engine's.
    """

    def __init__(self, kind: str, most: int, clock: Callable[[], float]) -> None:
        self.kind = kind  # before the track is made: it looks
        super().__init__()
        self._clock = clock
        self._queued: deque[tuple[float, av.VideoFrame | av.AudioFrame]] = deque(maxlen=most)
        self._came = asyncio.Event()
        self.dropped = 0
        self.sent = 0

    def put(self, time_s: float, frame: av.VideoFrame | av.AudioFrame) -> None:
        """Add what is to be handed on."""
        self.dropped += len(self._queued) == self._queued.maxlen
        self._queued.append((time_s, frame))
        self._came.set()

    async def recv(self) -> av.VideoFrame | av.AudioFrame:
        """Hand the next one on when its time has come; the library asks."""
        while not self._queued:
            if self.readyState != "live":
                raise MediaStreamError
            self._came.clear()
            await self._came.wait()
        time_s, frame = self._queued.popleft()
        await asyncio.sleep(max(0.0, time_s + SHOW_AFTER_S - self._clock()))
        self.sent += 1
        return frame

    def stop(self) -> None:
        """Hand nothing on any more."""
        super().stop()
        self._came.set()


class FilmTracks:
    """A watcher of a film (:class:`fapengine.live.film.film.Watcher`) with two tracks. Stateful."""

    def __init__(self, size: tuple[int, int], clock: Callable[[], float], over: Callable[[str], None]) -> None:
        self._size, self._zero_s, self.over = size, clock(), over
        self.video = FilmTrack("video", MAX_PICTURES, clock)
        self.audio = FilmTrack("audio", MAX_BLOCKS, clock)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Take a picture."""
        width, height = self._size
        frame = av.VideoFrame.from_ndarray(np.frombuffer(pixels, np.uint8).reshape(height, width, 3), format="rgb24")
        self._put(self.video, time_s, frame, VIDEO_HZ)

    def sound(self, time_s: float, samples: Samples) -> None:
        """Take a block of sound."""
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate = RATE_HZ
        self._put(self.audio, time_s, frame, RATE_HZ)

    def _put(self, track: FilmTrack, time_s: float, frame: av.VideoFrame | av.AudioFrame, rate_hz: int) -> None:
        if time_s >= self._zero_s:  # a sound that began before the call did
            frame.pts, frame.time_base = round((time_s - self._zero_s) * rate_hz), Fraction(1, rate_hz)
            track.put(time_s, frame)


async def listen(track: MediaStreamTrack, take: Callable[[Samples], None]) -> None:
    """Give a caller's sound on, mono at :data:`fapengine.live.film.soundtrack.RATE_HZ`, until it ends."""
    resampler = av.AudioResampler(format="s16", layout="mono", rate=RATE_HZ)
    while True:
        try:
            frame = await track.recv()
        except MediaStreamError:
            return
        if isinstance(frame, av.AudioFrame):
            for piece in resampler.resample(frame):
                take(np.ascontiguousarray(piece.to_ndarray().reshape(-1), np.int16))
