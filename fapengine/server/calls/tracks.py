"""The two tracks of a call, and what becomes of a film's pictures and blocks on their way into them."""

import asyncio
from collections import deque
from collections.abc import Callable
from fractions import Fraction

import av
import numpy as np
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack

from fapengine.server.film.film import SHOW_AFTER_S
from fapengine.server.film.latest import MAX_LATE_S, Latest
from fapengine.server.film.soundtrack import RATE_HZ, Samples

VIDEO_HZ = 90_000
MAX_BLOCKS = 10
"""Blocks of sound that may wait, 0.2 s; the oldest is dropped: sound is 0.1 s late at most where the encoder is behind,
and when a call has just connected."""


class FilmTrack(MediaStreamTrack):
    """One track: what has an engine time is handed on :data:`SHOW_AFTER_S` later.

    Both tracks of a call have one zero, and hand on at one time what belongs together: a receiver that plays by the
    sender's reports (RFC 3550, 6.4.1), as browsers do, and one that plays what comes have lips and sound together.

    Stateful.

    Parameters
    ----------
    kind : str
        ``"audio"`` or ``"video"``.
    clock : callable
        The engine's.
    """

    def __init__(self, kind: str, clock: Callable[[], float]) -> None:
        self.kind = kind  # before the track is made: it looks
        super().__init__()
        self._clock = clock
        self._came = asyncio.Event()
        self.sent = 0

    async def _wait(self, is_there: Callable[[], bool]) -> None:
        """Wait until something is there to be handed on."""
        while not is_there():
            if self.readyState != "live":
                raise MediaStreamError
            self._came.clear()
            await self._came.wait()

    def stop(self) -> None:
        """Hand nothing on any more."""
        super().stop()
        self._came.set()


class SoundTrack(FilmTrack):
    """Blocks of sound, each in its turn. Stateful."""

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__("audio", clock)
        self._queued: deque[tuple[float, av.AudioFrame]] = deque(maxlen=MAX_BLOCKS)
        self.dropped = 0

    def put(self, time_s: float, frame: av.AudioFrame) -> None:
        """Add a block that begins at an engine time."""
        self.dropped += len(self._queued) == self._queued.maxlen
        self._queued.append((time_s, frame))
        self._came.set()

    async def recv(self) -> av.AudioFrame:
        """Hand the next one on when its time has come; the library asks."""
        await self._wait(lambda: bool(self._queued))
        time_s, frame = self._queued.popleft()
        await asyncio.sleep(max(0.0, time_s + SHOW_AFTER_S - self._clock()))
        self.sent += 1
        return frame


class PictureTrack(FilmTrack):
    """Pictures, of which those that come too late are left out: :mod:`fapengine.server.film.latest`. Stateful.

    One that is shown although it is late has the time at which it is shown: a browser that went by its own time would
    have the sound wait for it.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__("video", clock)
        self._stamp = -1
        self._pictures = Latest[av.VideoFrame]()

    @property
    def dropped(self) -> int:
        """Number of pictures that were left out."""
        return self._pictures.dropped

    def put(self, time_s: float, frame: av.VideoFrame) -> None:
        """Add a picture of an engine time."""
        self._pictures.put(time_s + SHOW_AFTER_S, frame)
        self._came.set()

    async def recv(self) -> av.VideoFrame:
        """Hand on the newest one whose time has come; the library asks when it has sent the one before."""
        while (taken := self._pictures.take(self._clock())) is None:
            await self._wait(lambda: self._pictures.wait_s(0.0) is not None)
            await asyncio.sleep(self._pictures.wait_s(self._clock()) or 0.0)
        due_s, frame = taken
        late_s = self._clock() - due_s
        shift = round(late_s * VIDEO_HZ) if late_s > MAX_LATE_S else 0
        frame.pts = self._stamp = max((frame.pts or 0) + shift, self._stamp + 1)
        self.sent += 1
        return frame


class FilmTracks:
    """A watcher of a film (:class:`fapengine.server.film.film.Watcher`) with two tracks. Stateful."""

    def __init__(self, size: tuple[int, int], clock: Callable[[], float], over: Callable[[str], None]) -> None:
        self._size, self._zero_s, self.over = size, clock(), over
        self.video = PictureTrack(clock)
        self.audio = SoundTrack(clock)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Take a picture."""
        width, height = self._size
        frame = av.VideoFrame.from_ndarray(np.frombuffer(pixels, np.uint8).reshape(height, width, 3), format="rgb24")
        if self._stamp(frame, time_s, VIDEO_HZ):
            self.video.put(time_s, frame)

    def sound(self, time_s: float, samples: Samples) -> None:
        """Take a block of sound."""
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate = RATE_HZ
        if self._stamp(frame, time_s, RATE_HZ):
            self.audio.put(time_s, frame)

    def _stamp(self, frame: av.VideoFrame | av.AudioFrame, time_s: float, rate_hz: int) -> bool:
        """Give a frame its time in the call; False for one from before."""
        frame.pts, frame.time_base = round((time_s - self._zero_s) * rate_hz), Fraction(1, rate_hz)
        return time_s >= self._zero_s


async def listen(track: MediaStreamTrack, take: Callable[[Samples], None]) -> None:
    """Give a caller's sound on, mono at :data:`fapengine.server.film.soundtrack.RATE_HZ`, until it ends."""
    resampler = av.AudioResampler(format="s16", layout="mono", rate=RATE_HZ)
    while True:
        try:
            frame = await track.recv()
        except MediaStreamError:
            return
        if isinstance(frame, av.AudioFrame):
            for piece in resampler.resample(frame):
                take(np.ascontiguousarray(piece.to_ndarray().reshape(-1), np.int16))
