"""The video and audio track of a call."""

import asyncio
from collections import deque
from collections.abc import Callable
from fractions import Fraction
from math import inf
from typing import Generic, TypeVar

import av
import numpy as np
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack

from fapengine.server.film.film import SHOW_AFTER_S
from fapengine.server.film.soundtrack import RATE_HZ, Samples

VIDEO_HZ = 90_000
MAX_BLOCKS = 10
"""Audio blocks that may wait, 0.2 s; then the oldest is dropped. So audio is at most 0.1 s late if the encoder is slow,
or a call has just connected."""
MAX_LATE_S = 0.06
"""Lateness of an image beyond which it is not shown. Viewers accept audio ahead of the image by at most 0.09 s
(Recommendation ITU-R BT.1359-1); the rest is left for encoding."""
SEEN_S = 0.5
"""Time without an image after which a late one is shown."""
MAX_WAITING = 8

Shown = TypeVar("Shown")


class Latest(Generic[Shown]):
    """Images, each with the time at which it is due. Stateful.

    Images and audio of the same engine time belong together, and audio does not wait. On a busy machine images come
    late; if all were shown, the lips would fall behind the audio more and more. So of several images that are due only
    the newest is shown, and none that is later than :data:`MAX_LATE_S`, except one each :data:`SEEN_S` to show that the
    face is still there.

    Examples
    --------
    >>> pictures = Latest[str]()
    >>> pictures.put(1.00, "a"), pictures.put(1.04, "b"), pictures.put(1.08, "c")
    (None, None, None)
    >>> pictures.take(1.05), pictures.take(1.05), round(pictures.wait_s(1.05), 3), pictures.dropped
    ((1.04, 'b'), None, 0.03, 1)
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Shown]] = deque()
        self._taken_s = -inf
        self.dropped = 0
        """Number of images that were not shown."""

    def put(self, due_s: float, picture: Shown) -> None:
        """Add an image, due no earlier than those before."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append((due_s, picture))

    def take(self, now_s: float) -> tuple[float, Shown] | None:
        """Remove the image to show now; return the time at which it was due, and the image, or None."""
        due = []
        while self._waiting and self._waiting[0][0] <= now_s:
            due.append(self._waiting.popleft())
        if not due:
            return None
        due_s, picture = due[-1]
        is_shown = now_s - due_s <= MAX_LATE_S or now_s - self._taken_s >= SEEN_S
        self.dropped += len(due) - int(is_shown)
        if not is_shown:
            return None
        self._taken_s = now_s
        return due_s, picture

    def wait_s(self, now_s: float) -> float | None:
        """Return the time until the next image is due, s; None if there is none."""
        return max(self._waiting[0][0] - now_s, 0.0) if self._waiting else None


class FilmTrack(MediaStreamTrack):
    """One track: it releases each item :data:`SHOW_AFTER_S` after its engine time. Stateful.

    Both tracks of a call have the same zero and release what belongs together at the same time. So lips and audio are
    in sync for a receiver that plays by the sender's reports (RFC 3550, 6.4.1), as browsers do, and for one that plays
    at once.

    Parameters
    ----------
    kind : str
        ``"audio"`` or ``"video"``.
    clock : callable
        Clock of the engine.
    """

    def __init__(self, kind: str, clock: Callable[[], float]) -> None:
        self.kind = kind  # the base class reads it
        super().__init__()
        self._clock = clock
        self._came = asyncio.Event()
        self.sent = 0

    async def _wait(self, is_there: Callable[[], bool]) -> None:
        """Wait until an item is available."""
        while not is_there():
            if self.readyState != "live":
                raise MediaStreamError
            self._came.clear()
            await self._came.wait()

    def stop(self) -> None:
        """End the track."""
        super().stop()
        self._came.set()


class SoundTrack(FilmTrack):
    """Audio blocks in order. Stateful."""

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
        """Return the next block when its time has come; called by the library."""
        await self._wait(lambda: bool(self._queued))
        time_s, frame = self._queued.popleft()
        await asyncio.sleep(max(0.0, time_s + SHOW_AFTER_S - self._clock()))
        self.sent += 1
        return frame


class PictureTrack(FilmTrack):
    """Images without those that come too late (:class:`Latest`). Stateful.

    An image that is shown late is stamped with the time at which it is shown; otherwise browsers would delay the audio.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__("video", clock)
        self._stamp = -1
        self._pictures = Latest[av.VideoFrame]()

    @property
    def dropped(self) -> int:
        """Number of images that were not shown."""
        return self._pictures.dropped

    def put(self, time_s: float, frame: av.VideoFrame) -> None:
        """Add an image of an engine time."""
        self._pictures.put(time_s + SHOW_AFTER_S, frame)
        self._came.set()

    async def recv(self) -> av.VideoFrame:
        """Return the newest image whose time has come; the library calls this after it has sent the one before."""
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
    """A watcher of a film (:class:`fapengine.server.film.film.Watcher`) that fills two tracks. Stateful."""

    def __init__(self, size: tuple[int, int], clock: Callable[[], float], over: Callable[[str], None]) -> None:
        self._size, self._zero_s, self.over = size, clock(), over
        self.video = PictureTrack(clock)
        self.audio = SoundTrack(clock)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Add an image to the video track."""
        width, height = self._size
        frame = av.VideoFrame.from_ndarray(np.frombuffer(pixels, np.uint8).reshape(height, width, 3), format="rgb24")
        if self._stamp(frame, time_s, VIDEO_HZ):
            self.video.put(time_s, frame)

    def sound(self, time_s: float, samples: Samples) -> None:
        """Add a block to the audio track."""
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate = RATE_HZ
        if self._stamp(frame, time_s, RATE_HZ):
            self.audio.put(time_s, frame)

    def _stamp(self, frame: av.VideoFrame | av.AudioFrame, time_s: float, rate_hz: int) -> bool:
        """Set a frame's time in the call; False if it is from before the call."""
        frame.pts, frame.time_base = round((time_s - self._zero_s) * rate_hz), Fraction(1, rate_hz)
        return time_s >= self._zero_s


async def listen(track: MediaStreamTrack, take: Callable[[Samples], None]) -> None:
    """Pass on a caller's audio, mono at :data:`fapengine.server.film.soundtrack.RATE_HZ`, until it ends."""
    resampler = av.AudioResampler(format="s16", layout="mono", rate=RATE_HZ)
    while True:
        try:
            frame = await track.recv()
        except MediaStreamError:
            return
        if isinstance(frame, av.AudioFrame):
            for piece in resampler.resample(frame):
                take(np.ascontiguousarray(piece.to_ndarray().reshape(-1), np.int16))
