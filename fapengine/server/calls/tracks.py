"""The video and audio tracks of calls."""

import asyncio
import logging
import multiprocessing
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import Any, Generic, TypeVar

import av
import numpy as np
from aiortc import RTCRtpCodecParameters
from aiortc.codecs import get_encoder
from aiortc.codecs.opus import OpusEncoder
from aiortc.codecs.vpx import Vp8Encoder, number_of_threads
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
MAX_ENCODED = 30
"""Encoded images that may wait for one viewer."""
KEY_EVERY_S = 1.0
"""Time between two keyframes that viewers ask for. A keyframe takes as many bits as ten other images."""
SAME_RATE = 0.1
"""Relative change of the bit rate for which the library does not begin a new encoder."""
VP8 = RTCRtpCodecParameters(mimeType="video/VP8", clockRate=VIDEO_HZ)
VP8_OPTIONS = {
    "deadline": "realtime", "cpu-used": "-10", "noise-sensitivity": "0", "static-thresh": "500", "lag-in-frames": "0",
    "undershoot-pct": "100", "overshoot-pct": "15",
}  # fmt: skip
"""Options of libvpx. Where they differ from aiortc's (cpu-used -6, noise-sensitivity 4, static-thresh 1), drawn images
differ from a camera's: they have no noise, and most of the background does not change. (For a static-thresh above
131,072 libvpx 1.16 reads beyond its memory.)"""
OPUS_COMPLEXITY = "5"
"""From 0 to 10, the default. libwebrtc uses 5 on phones."""

log = logging.getLogger("fapengine.web")
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

    def send_by(self, sender: Any, codec: RTCRtpCodecParameters) -> None:
        """Have a sender of the library send it in a codec that was agreed on."""
        if codec.mimeType.lower() == "audio/opus":
            sender._RTCRtpSender__encoder = opus_encoder()
        sender.replaceTrack(self)

    async def recv(self) -> av.AudioFrame:
        """Return the next block when its time has come; called by the library."""
        await self._wait(lambda: bool(self._queued))
        time_s, frame = self._queued.popleft()
        await asyncio.sleep(max(0.0, time_s + SHOW_AFTER_S - self._clock()))
        self.sent += 1
        return frame


def opus_encoder() -> OpusEncoder:
    """Return the library's encoder with less work for the same bit rate."""
    encoder = OpusEncoder()
    encoder.codec.options = {**encoder.codec.options, "compression_level": OPUS_COMPLEXITY}
    return encoder


class DrawnEncoder(Vp8Encoder):
    """The library's encoder of VP8 with :data:`VP8_OPTIONS`. Stateful."""

    def encode(self, frame: Any, force_keyframe: bool = False) -> tuple[list[bytes], int]:
        """Encode an image as the library does; a new bit rate or size needs a new codec."""
        rate, before = self.target_bitrate, self.codec and self.codec.bit_rate
        is_resized = self.codec and (self.codec.width, self.codec.height) != (frame.width, frame.height)
        if not before or is_resized or abs(rate - before) > SAME_RATE * before:
            self.codec = av.CodecContext.create("libvpx", "w")
            self.codec.width, self.codec.height, self.codec.pix_fmt = frame.width, frame.height, "yuv420p"
            self.codec.bit_rate, self.codec.gop_size, self.codec.qmin, self.codec.qmax = rate, 3000, 2, 56
            limits = dict.fromkeys(("minrate", "maxrate", "bufsize"), str(rate))  # a constant rate, 1 s of buffer
            self.codec.options = VP8_OPTIONS | limits
            self.codec.thread_count = number_of_threads(frame.width * frame.height, multiprocessing.cpu_count())
        return super().encode(frame, force_keyframe)


@dataclass(frozen=True, slots=True)
class Encoded:
    """An encoded image."""

    payloads: list[bytes]
    """Payloads of its RTP packets."""
    stamp: int
    """Time of the image, in 1/:data:`VIDEO_HZ` s."""
    is_key: bool


class PictureTrack(FilmTrack):
    """Encoded images for one viewer, from the first keyframe on. Stateful.

    For its sender it is also the encoder, because nothing is left to encode.
    """

    def __init__(self, encoder: "PictureEncoder") -> None:
        super().__init__("video", encoder.clock)
        self._encoder = encoder
        self._queued: deque[Encoded] = deque()
        self._needs_key = True
        self.target_bitrate: int | None = None
        """Bits per second that the viewer can receive; set by the sender."""

    def put(self, image: Encoded) -> None:
        """Add an image. If too many wait, all are dropped up to the next keyframe."""
        if len(self._queued) >= MAX_ENCODED:
            self._queued.clear()
            self._needs_key = True
        if self._needs_key and not image.is_key:
            return
        self._needs_key = False
        self._queued.append(image)
        self._came.set()

    async def recv(self) -> Any:
        """Return the next image; called by the library."""
        if self._needs_key:
            self._encoder.ask_key()
        await self._wait(lambda: bool(self._queued))
        self.sent += 1
        return self._queued.popleft()

    @staticmethod
    def pack(image: Encoded) -> tuple[list[bytes], int]:
        """Return payloads and timestamp of an image; called by the library."""
        return image.payloads, image.stamp

    def send_by(self, sender: Any) -> None:
        """Have a sender of the library send these images as they are, and pass on what its viewer asks for."""
        sender._RTCRtpSender__encoder, sender._send_keyframe = self, self._encoder.ask_key
        sender.replaceTrack(self)


class PictureEncoder:
    """Encodes the images of one session once for all its viewers, without those that come too late (:class:`Latest`).

    An image that is shown late is stamped with the time at which it is shown; otherwise browsers would delay the audio.
    A keyframe comes when a viewer joins or has lost something, and where the bit rate changes, but at most one each
    :data:`KEY_EVERY_S`, so that no viewer spoils the images of the others. The viewer that can receive least decides
    the bit rate, within the limits of the library. Stateful.

    Parameters
    ----------
    size : (int, int)
    clock : callable
        Clock of the engine.
    codec : RTCRtpCodecParameters, optional
        By default VP8.
    """

    def __init__(self, size: tuple[int, int], clock: Callable[[], float], codec: RTCRtpCodecParameters = VP8) -> None:
        self._size, self.clock, self.zero_s = size, clock, clock()
        self._codec = codec
        self._encoder: Any = None
        self._viewers: set[PictureTrack] = set()
        self._pictures = Latest[bytes]()
        self._came = asyncio.Event()
        self._newest_s, self._key_s, self._stamp = -inf, -inf, -1
        self._wants_key = True
        self._encoding: asyncio.Task[None] | None = None

    @property
    def dropped(self) -> int:
        """Number of images that were not encoded."""
        return self._pictures.dropped

    def ask_key(self) -> None:
        """Make one of the next images a keyframe."""
        self._wants_key = True

    def join(self) -> PictureTrack:
        """Return a track for one more viewer."""
        track = PictureTrack(self)
        self._viewers.add(track)
        if self._encoding is None or self._encoding.done():
            self._encoding = asyncio.get_running_loop().create_task(self._run())
        return track

    def leave(self, track: PictureTrack) -> bool:
        """Remove a viewer; return whether it was the last one, so that nothing more is encoded."""
        track.stop()
        self._viewers.discard(track)
        if self._viewers or self._encoding is None:
            return False
        self._encoding.cancel()
        return True

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Add an image of an engine time; each viewer's film brings it, and the first counts."""
        if time_s > self._newest_s:
            self._newest_s = time_s
            self._pictures.put(time_s + SHOW_AFTER_S, pixels)
            self._came.set()

    async def _run(self) -> None:
        is_vp8 = self._codec.mimeType.lower() == "video/vp8"
        self._encoder, self._key_s = DrawnEncoder() if is_vp8 else get_encoder(self._codec), -inf
        try:
            while True:
                image = await self._encoded(*await self._next())
                for viewer in self._viewers:
                    viewer.put(image)
        except Exception:  # the library fails in many ways
            log.exception("video cannot be encoded")
        finally:
            for viewer in self._viewers:
                viewer.stop()

    async def _next(self) -> tuple[float, bytes]:
        """Wait until an image is due."""
        while (taken := self._pictures.take(self.clock())) is None:
            wait_s = self._pictures.wait_s(self.clock())
            if wait_s is None:
                self._came.clear()
                await self._came.wait()
            else:
                await asyncio.sleep(wait_s)
        return taken

    async def _encoded(self, due_s: float, pixels: bytes) -> Encoded:
        now_s = self.clock()
        shown_s = now_s if now_s - due_s > MAX_LATE_S else due_s
        self._stamp = max(round((shown_s - SHOW_AFTER_S - self.zero_s) * VIDEO_HZ), self._stamp + 1)
        is_key = now_s - self._key_s >= KEY_EVERY_S and (self._changes_rate() or self._wants_key)
        if is_key:
            self._key_s, self._wants_key = now_s, False
        return Encoded(await self._encode(pixels, self._stamp, is_key), self._stamp, is_key)

    def _changes_rate(self) -> bool:
        """Set the bit rate of the viewers; return whether it differs so much that the encoder begins again."""
        wanted = min((one.target_bitrate for one in self._viewers if one.target_bitrate is not None), default=None)
        before = self._encoder.target_bitrate
        if wanted is None or abs(wanted - before) <= SAME_RATE * before:
            return False
        self._encoder.target_bitrate = wanted
        return bool(self._encoder.target_bitrate != before)

    async def _encode(self, pixels: bytes, stamp: int, is_key: bool) -> list[bytes]:
        width, height = self._size

        def encode() -> list[bytes]:
            image = np.frombuffer(pixels, np.uint8).reshape(height * 3 // 2, width)
            frame = av.VideoFrame.from_ndarray(image, format="yuv420p")
            frame.pts, frame.time_base = stamp, Fraction(1, VIDEO_HZ)
            payloads: list[bytes] = self._encoder.encode(frame, is_key)[0]
            return payloads

        return await asyncio.get_running_loop().run_in_executor(None, encode)


class FilmTracks:
    """A watcher of a film (:class:`fapengine.server.film.film.Watcher`) that fills the tracks of one call. Stateful.

    Parameters
    ----------
    encoder : PictureEncoder, optional
        Encodes the images; None for a call without video.
    clock : callable
        Clock of the engine.
    over : callable
        Called with the reason when no more images come.
    """

    def __init__(self, encoder: PictureEncoder | None, clock: Callable[[], float], over: Callable[[str], None]) -> None:
        self._encoder, self._clock, self.over = encoder, clock, over
        self._begun_s = clock()
        self._zero_s = self._begun_s if encoder is None else encoder.zero_s
        self.audio = SoundTrack(clock)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Pass an image to the encoder."""
        if self._encoder is not None:
            self._encoder.picture(time_s, pixels)

    def sound(self, time_s: float, samples: Samples) -> None:
        """Add a block to the audio track, unless it is from before the call."""
        if time_s < self._begun_s:
            return
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate, frame.time_base = RATE_HZ, Fraction(1, RATE_HZ)
        frame.pts = round((time_s - self._zero_s) * RATE_HZ)
        self.audio.put(time_s, frame)


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
