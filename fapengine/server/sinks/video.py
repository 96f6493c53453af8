"""Sinks that are sent pictures: a virtual camera of this machine, and streams of video and sound to media servers.

Theory of operation
-------------------
Pictures come from :mod:`fapengine.server.film`. A camera is shown the newest one, again and again, by a thread. A
stream is encoded and sent by a thread, too, which begins anew when the receiver goes away: after 1 s, later after 10 s.
What comes meanwhile, or faster than it is taken, is dropped and counted.
"""

import asyncio
import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any
from urllib.parse import urlencode

import av
import numpy as np

from fapengine._late import needed
from fapengine.errors import ResourceError, UsageError
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.film.soundtrack import RATE_HZ, Samples
from fapengine.server.sinks.address import Sink, SinkAddress, SinkCounts

SESSION = "face"
SIZE_PX, FPS, KBIT_S = 512, 30, 1500
SIZES, RATES, BIT_RATES = (64, 2048), (1, 120), (50, 50_000)
MAX_WAITING = 100
"""Pictures and blocks of sound that wait for an encoder: about a second."""
TRIAL_S = 5.0
"""Longest wait of the server's start for a stream; a receiver that is not there yet is waited for later."""
RETRIES_S = (1.0, 2.0, 5.0, 10.0)
END_S = 5.0
"""Longest wait at the end for a receiver that takes nothing."""
CONTAINERS = {"rtmp": "flv", "srt": "mpegts"}

log = logging.getLogger("fapengine.server")


async def open_camera(studio: Studio, address: SinkAddress, head: str) -> Sink:
    """Begin to send images to a camera.

    Raises
    ------
    UsageError
        If an option's value is wrong.
    ResourceError
        If there is no such camera.
    """
    return CameraSink(studio, address, _form(address, head))


async def open_stream(studio: Studio, address: SinkAddress, head: str) -> Sink:
    """Begin to send video and sound to a media server.

    Raises
    ------
    UsageError
        If an option's value is wrong.
    ResourceError
        If FFmpeg does not speak the protocol.
    """
    form = _form(address, head)
    sink = StreamSink(studio, address, form, address.whole("kbit_s", KBIT_S, *BIT_RATES))
    try:
        await sink.tried()
    except ResourceError:
        await sink.close()
        raise
    return sink


def _form(address: SinkAddress, head: str) -> FilmForm:
    size = address.whole("size", SIZE_PX, *SIZES)
    if size % 2:
        raise UsageError(f"sink {address.kind}: size: got {size}, expected an even number")
    return FilmForm(head, (size, size), float(address.whole("fps", FPS, *RATES)))


class CameraSink:
    """The face as a camera that other programs of this machine find. Stateful.

    Raises
    ------
    ResourceError
        If the library, or the system's virtual camera, is not there.
    """

    def __init__(self, studio: Studio, address: SinkAddress, form: FilmForm) -> None:
        self.address, self.counts = address, SinkCounts()
        library = needed("pyvirtualcam", "pyvirtualcam", "sink camera")
        width, height = form.size
        device = address.options.get("device")
        try:
            self._camera = library.Camera(
                width=width, height=height, fps=form.rate_hz, fmt=library.PixelFormat.RGB, device=device
            )
        except (RuntimeError, OSError, ValueError) as error:
            raise ResourceError(
                f"sink camera: no virtual camera ({error}); on Linux: sudo modprobe v4l2loopback; elsewhere OBS has one"
            ) from error
        self._shape, self._step_s = (height, width, 3), 1.0 / form.rate_hz
        self._newest: bytes | None = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._send, name="camera", daemon=True)
        try:
            self._leave = studio.watch(address.session or SESSION, form, self)
        except BaseException:
            self._camera.close()
            raise
        self._thread.start()

    async def close(self) -> None:
        """Give the camera back."""
        self._leave()
        self._ends.set()
        await asyncio.to_thread(self._thread.join)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Take a picture."""
        self._newest = pixels

    def sound(self, time_s: float, samples: Samples) -> None:
        """Let it go: a camera has none."""

    def over(self, reason: str) -> None:
        """Show the last picture on."""

    def _send(self) -> None:
        next_s = time.monotonic()
        try:
            while not self._ends.wait(max(0.0, next_s - time.monotonic())):
                next_s = max(next_s + self._step_s, time.monotonic() - self._step_s)
                pixels = self._newest
                if pixels is not None:
                    self._camera.send(np.frombuffer(pixels, np.uint8).reshape(self._shape))
                    self.counts.sent += 1
        except (RuntimeError, OSError, ValueError) as error:
            log.error("the camera takes no more pictures: %s", error)
        finally:
            self._camera.close()


class StreamSink:
    """The face as video and sound, sent to a media server. Stateful."""

    def __init__(self, studio: Studio, address: SinkAddress, form: FilmForm, kbit_s: int) -> None:
        self.address, self.counts = address, SinkCounts()
        self._form, self._kbit_s = form, kbit_s
        self._waiting: queue.Queue[Callable[[_Encoder], None] | None] = queue.Queue(MAX_WAITING)
        self._loop = asyncio.get_running_loop()
        self._tried: asyncio.Future[None] = self._loop.create_future()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name=address.kind, daemon=True)
        self._leave = studio.watch(address.session or SESSION, form, self)
        self._thread.start()

    async def tried(self) -> None:
        """Wait for the first trial to connect.

        Raises
        ------
        ResourceError
            If FFmpeg does not speak the protocol; all else may mend itself.
        """
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(self._tried), TRIAL_S)

    async def close(self) -> None:
        """Send what waits no more, and end the stream."""
        self._leave()
        self._ends.set()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)
        await asyncio.to_thread(self._thread.join, END_S)  # one that still writes is left to end by itself
        if self._tried.done():
            self._tried.exception()

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Take a picture."""
        self._put(lambda encoder: encoder.picture(time_s, pixels))

    def sound(self, time_s: float, samples: Samples) -> None:
        """Take a block of sound."""
        self._put(lambda encoder: encoder.sound(time_s, samples))

    def over(self, reason: str) -> None:
        """Send sound alone."""

    def _put(self, work: "Callable[[_Encoder], None]") -> None:
        try:
            self._waiting.put_nowait(work)
        except queue.Full:
            self.counts.dropped += 1

    def _run(self) -> None:
        """Connect, send, and begin anew; in a thread."""
        trials = 0
        while not self._ends.is_set():
            try:
                with _Encoder(self._url, CONTAINERS[self.address.kind], self._form, self._kbit_s) as encoder:
                    self._tell_tried(None)
                    log.info("%s is connected", self.address)
                    trials = 0
                    while not self._ends.is_set() and (work := self._waiting.get()) is not None:
                        work(encoder)
                        self.counts.sent += 1
            except av.error.ProtocolNotFoundError:
                reason = (
                    f"sink {self.address}: the FFmpeg inside PyAV {av.__version__} does not speak {self.address.kind}"
                )
                self._tell_tried(ResourceError(f"{reason}; send rtmp:// instead, or let OBS or ffmpeg pass that on"))
                return
            except (av.FFmpegError, OSError, ValueError) as error:
                self._tell_tried(None)
                wait_s = RETRIES_S[min(trials, len(RETRIES_S) - 1)]
                log.warning("%s is not reached (%s); again in %g s", self.address, _reason(error), wait_s)
                trials += 1
                self._ends.wait(wait_s)
                self._drop()

    def _drop(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()
                self.counts.dropped += 1

    def _tell_tried(self, error: ResourceError | None) -> None:
        def tell() -> None:
            if not self._tried.done():
                if error is None:
                    self._tried.set_result(None)
                else:
                    self._tried.set_exception(error)

        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(tell)

    @property
    def _url(self) -> str:
        address = self.address
        host = f"[{address.host}]" if ":" in address.host else address.host
        own = {key: value for key, value in address.options.items() if key not in ("size", "fps", "kbit_s")}
        return f"{address.kind}://{host}:{address.port}{address.path}" + (f"?{urlencode(own)}" if own else "")


class _Encoder:
    """H.264 and AAC into one container; on the stream's thread. Stateful; a context manager."""

    def __init__(self, url: str, container: str, form: FilmForm, kbit_s: int) -> None:
        self._size = form.size
        self._zero_s: float | None = None
        self._last = {"picture": -1, "sound": -1}
        self._out: Any = av.open(url, "w", format=container)
        try:
            rate = Fraction(form.rate_hz).limit_denominator(1000)
            wish = {"preset": "veryfast", "tune": "zerolatency", "g": str(round(2 * form.rate_hz))}
            self._video: Any = self._out.add_stream("libx264", rate=rate, options=wish)
            self._video.width, self._video.height = form.size
            self._video.pix_fmt, self._video.bit_rate = "yuv420p", 1000 * kbit_s
            self._video.codec_context.time_base = Fraction(1, 1000)
            self._audio: Any = self._out.add_stream("aac", rate=RATE_HZ, layout="mono")
            self._out.start_encoding()
        except BaseException:
            self._out.close()
            raise
        frame_size = self._audio.codec_context.frame_size or 1024
        self._resampler = av.AudioResampler(format="fltp", layout="mono", rate=RATE_HZ, frame_size=frame_size)

    def __enter__(self) -> "_Encoder":
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(av.FFmpegError, OSError, ValueError):
            self._out.mux(self._video.encode(None))
            self._out.mux(self._audio.encode(None))
        with contextlib.suppress(av.FFmpegError, OSError, ValueError):
            self._out.close()

    def picture(self, time_s: float, pixels: bytes) -> None:
        width, height = self._size
        frame = av.VideoFrame.from_ndarray(np.frombuffer(pixels, np.uint8).reshape(height, width, 3), format="rgb24")
        if self._stamp(frame, "picture", time_s, 1000):
            self._out.mux(self._video.encode(frame))

    def sound(self, time_s: float, samples: Samples) -> None:
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate = RATE_HZ
        if self._stamp(frame, "sound", time_s, RATE_HZ):
            for piece in self._resampler.resample(frame):
                self._out.mux(self._audio.encode(piece))

    def _stamp(self, frame: Any, kind: str, time_s: float, rate_hz: int) -> bool:
        """Give a frame its time from the stream's beginning; False: it lies before that, or before the last one."""
        if self._zero_s is None:
            self._zero_s = time_s
        frame.pts, frame.time_base = round((time_s - self._zero_s) * rate_hz), Fraction(1, rate_hz)
        is_next: bool = frame.pts > self._last[kind]
        self._last[kind] = max(self._last[kind], frame.pts)
        return is_next


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)[:200]
