"""Video sinks: a virtual camera of this machine, and streams of video and audio to media servers.

Theory of operation
-------------------
Images come from :mod:`fapengine.server.film`. A thread sends the newest one to the camera at a steady rate. Another
thread encodes and sends a stream; when the receiver goes away it reconnects after 1 s, later after 10 s. Images and
audio that come meanwhile, or faster than they are encoded, are dropped and counted.
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
from fapengine.files.provenance import mark
from fapengine.files.video import reason
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.film.soundtrack import RATE_HZ, Samples
from fapengine.server.sinks.kinds import SinkAddress, SinkCounts

SESSION = "face"
SIZE_PX, FPS, KBIT_S = 512, 30, 1500
SIZES, RATES, BIT_RATES = (64, 2048), (1, 120), (50, 50_000)
MAX_WAITING = 100
"""Images and audio blocks that wait for an encoder: about one second."""
TRIAL_S = 5.0
"""Longest time that the server's start waits for a stream; a receiver may come later."""
RETRIES_S = (1.0, 2.0, 5.0, 10.0)
END_S = 5.0
"""Longest wait at the end for a receiver that does not read."""
CONTAINERS = {"rtmp": "flv", "srt": "mpegts"}

log = logging.getLogger("fapengine.server")


def _form(address: SinkAddress, head: str) -> FilmForm:
    size = address.whole("size", SIZE_PX, *SIZES)
    if size % 2:
        raise UsageError(f"sink {address.kind}: size: got {size}, expected an even number")
    return FilmForm(head, (size, size), float(address.whole("fps", FPS, *RATES)))


class CameraSink:
    """The face as a camera that other programs of this machine can select. Stateful.

    Raises UsageError if an option's value is wrong; ResourceError if the library, or the system's virtual camera, is
    missing.
    """

    def __init__(self, studio: Studio, address: SinkAddress, head: str) -> None:
        form = _form(address, head)
        self.address, self.counts = address, SinkCounts()
        library = needed("pyvirtualcam", "pyvirtualcam", "sink camera")
        width, height = form.size
        device = address.options.get("device")
        try:
            self._camera = library.Camera(
                width=width, height=height, fps=form.rate_hz, fmt=library.PixelFormat.I420, device=device
            )
        except (RuntimeError, OSError, ValueError) as error:
            raise ResourceError(
                f"sink camera: no virtual camera ({error}); on Linux: sudo modprobe v4l2loopback; elsewhere OBS has one"
            ) from error
        self._shape, self._step_s = (height * 3 // 2, width), 1.0 / form.rate_hz
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
        """Release the camera."""
        self._leave()
        self._ends.set()
        await asyncio.to_thread(self._thread.join)

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Keep the newest image."""
        self._newest = pixels

    def sound(self, time_s: float, samples: Samples) -> None:
        """Ignore it: a camera has no audio."""

    def over(self, reason: str) -> None:
        """Continue to show the last image."""

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
            log.error("the camera accepts no more images: %s", error)
        finally:
            self._camera.close()


class StreamSink:
    """The face as video and audio, sent to a media server; made by :meth:`open`. Stateful."""

    def __init__(self, studio: Studio, address: SinkAddress, head: str) -> None:
        self.address, self.counts = address, SinkCounts()
        self._form, self._kbit_s = _form(address, head), address.whole("kbit_s", KBIT_S, *BIT_RATES)
        self._waiting: queue.Queue[Callable[[_Encoder], None] | None] = queue.Queue(MAX_WAITING)
        self._tried = threading.Event()
        self._error: ResourceError | None = None
        """Why it cannot send at all."""
        self._ends = threading.Event()
        self._marks = mark()
        self._thread = threading.Thread(target=self._run, name=address.kind, daemon=True)
        self._leave = studio.watch(address.session or SESSION, self._form, self)
        self._thread.start()

    @classmethod
    async def open(cls, studio: Studio, address: SinkAddress, head: str) -> "StreamSink":
        """Begin to send, and wait for the first attempt to connect.

        Raises UsageError if an option's value is wrong; ResourceError if FFmpeg does not support the protocol; after
        other failures it tries again.
        """
        sink = cls(studio, address, head)
        await asyncio.to_thread(sink._tried.wait, TRIAL_S)
        if sink._error is not None:
            await sink.close()
            raise sink._error
        return sink

    async def close(self) -> None:
        """Drop what waits, and end the stream."""
        self._leave()
        self._ends.set()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)
        await asyncio.to_thread(self._thread.join, END_S)  # if it still writes, it ends by itself

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Queue an image."""
        self._put(lambda encoder: encoder.picture(time_s, pixels))

    def sound(self, time_s: float, samples: Samples) -> None:
        """Queue a block of audio."""
        self._put(lambda encoder: encoder.sound(time_s, samples))

    def over(self, reason: str) -> None:
        """Continue with audio only."""

    def _put(self, work: "Callable[[_Encoder], None]") -> None:
        try:
            self._waiting.put_nowait(work)
        except queue.Full:
            self.counts.dropped += 1

    def _run(self) -> None:
        """Connect, send and reconnect; runs in a thread."""
        trials = 0
        while not self._ends.is_set():
            try:
                with _Encoder(
                    self._url, CONTAINERS[self.address.kind], self._form, self._kbit_s, self._marks
                ) as encoder:
                    self._tried.set()
                    log.info("%s is connected", self.address)
                    trials = 0
                    while not self._ends.is_set() and (work := self._waiting.get()) is not None:
                        work(encoder)
                        self.counts.sent += 1
            except av.error.ProtocolNotFoundError:
                self._error = ResourceError(
                    f"sink {self.address}: the FFmpeg inside PyAV {av.__version__} does not support"
                    f" {self.address.kind}; send rtmp:// instead, and let OBS or ffmpeg forward it"
                )
                self._tried.set()
                return
            except (av.FFmpegError, OSError, ValueError) as error:
                self._tried.set()
                wait_s = RETRIES_S[min(trials, len(RETRIES_S) - 1)]
                log.warning("%s cannot be reached (%s); retrying in %g s", self.address, reason(error)[:200], wait_s)
                trials += 1
                self._ends.wait(wait_s)
                self._drop()

    def _drop(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()
                self.counts.dropped += 1

    @property
    def _url(self) -> str:
        address = self.address
        own = {key: value for key, value in address.options.items() if key not in ("size", "fps", "kbit_s")}
        return f"{address.kind}://{address.url_host}:{address.port}{address.path}" + (
            f"?{urlencode(own)}" if own else ""
        )


class _Encoder:
    """H.264 and AAC into one container; on the stream's thread. Stateful; a context manager."""

    def __init__(self, url: str, container: str, form: FilmForm, kbit_s: int, marks: dict[str, str]) -> None:
        self._size = form.size
        self._zero_s: float | None = None
        self._last = {"picture": -1, "sound": -1}
        self._out: Any = av.open(url, "w", format=container)
        try:
            rate = Fraction(form.rate_hz).limit_denominator(1000)
            options = {"preset": "veryfast", "tune": "zerolatency", "g": str(round(2 * form.rate_hz))}
            self._video: Any = self._out.add_stream("libx264", rate=rate, options=options)
            self._video.width, self._video.height = form.size
            self._video.pix_fmt, self._video.bit_rate = "yuv420p", 1000 * kbit_s
            self._video.codec_context.time_base = Fraction(1, 1000)
            self._audio: Any = self._out.add_stream("aac", rate=RATE_HZ, layout="mono")
            self._out.metadata.update(marks)
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
        image = np.frombuffer(pixels, np.uint8).reshape(height * 3 // 2, width)
        frame = av.VideoFrame.from_ndarray(image, format="yuv420p")
        if self._stamp(frame, "picture", time_s, 1000):
            self._out.mux(self._video.encode(frame))

    def sound(self, time_s: float, samples: Samples) -> None:
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate = RATE_HZ
        if self._stamp(frame, "sound", time_s, RATE_HZ):
            for piece in self._resampler.resample(frame):
                self._out.mux(self._audio.encode(piece))

    def _stamp(self, frame: Any, kind: str, time_s: float, rate_hz: int) -> bool:
        """Set a frame's time from the stream's beginning; False if it is before that, or before the last frame."""
        if self._zero_s is None:
            self._zero_s = time_s
        frame.pts, frame.time_base = round((time_s - self._zero_s) * rate_hz), Fraction(1, rate_hz)
        is_next: bool = frame.pts > self._last[kind]
        self._last[kind] = max(self._last[kind], frame.pts)
        return is_next
