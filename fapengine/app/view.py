"""A window that shows a face of this program, a file, or a live face from a server or a port."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from fapengine.app.face import Face, Ticks
from fapengine.audio.device import open_output
from fapengine.audio.output import Output
from fapengine.clients.osc_viewer import OscViewer
from fapengine.clients.websocket_viewer import ViewerSound, WebSocketViewer
from fapengine.engine.commands import Blink
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.motion import load_motion
from fapengine.files.pictures import save_png
from fapengine.files.sound import load_sound
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import RenderOptions
from fapengine.render.live import LevelOfDetail
from fapengine.render.window import FaceWindow

Faps = NDArray[np.int32]

STATUS_S = 0.5
"""Interval at which the title is updated."""
PAUSE, STOP, BLINK = " ", "s", "b"
"""Keys."""


class Source(ABC):
    """Something that moves a face. Stateful."""

    title = "fapengine"
    """Title of the window."""
    failure = ""
    """Why nothing was ever shown; empty if something was."""

    @abstractmethod
    def frame(self, display_latency_s: float) -> Faps:
        """Return the FAPs, (68,) int32 FAPU, that are seen ``display_latency_s`` from now."""

    @abstractmethod
    def status(self) -> str:
        """Describe the state, for the title."""

    def press(self, key: str) -> None:  # noqa: B027  most sources have nothing to press
        """Act on :data:`PAUSE`, :data:`STOP` or :data:`BLINK`; by default do nothing."""

    @abstractmethod
    def close(self) -> None:
        """Close sound, sockets and threads."""


def run_window(
    head: FaceMesh,
    coarser: Sequence[LevelOfDetail],
    open_source: Callable[[], Source],
    drawing: RenderOptions,
    *,
    rate_hz: float = 60.0,
    seconds: float | None = None,
    shot: Path | None = None,
) -> dict[str, object]:
    """Show a source until the window is closed.

    Raises ResourceError if there is no display, or nothing was ever shown; UsageError if the window is too small.

    Parameters
    ----------
    head : FaceMesh
    coarser : sequence of FaceMesh
        Coarser levels of detail, or functions that load them when they are needed.
    open_source : callable
        Makes the source, when the window is open; it is closed with the window.
    drawing : RenderOptions
        Camera, and the size of the window in points.
    rate_hz : float
    seconds : float, optional
        Time until the window closes by itself.
    shot : Path, optional
        Image (.png) of the window when it closes.

    Returns
    -------
    dict
        Plain values: frames, frames that came too late, seconds, rate, median time to draw a frame at the end.
    """
    with FaceWindow(head, drawing, coarser=coarser, hold_hz=rate_hz) as window:
        source = open_source()
        try:
            window.title(source.title)
            window.show(source.frame(0.0))  # the first frame takes longest: the mesh goes to the GPU
            begun_s = time.monotonic()
            ticks = _run(window, source, Ticks(rate_hz), inf if seconds is None else begun_s + seconds)
            if shot is not None:
                save_png(shot, window.picture())
            if source.failure:
                raise ResourceError(source.failure)
        finally:
            source.close()
        took_s = time.monotonic() - begun_s
    return {
        "frames": ticks.frames, "skipped": ticks.skipped, "seconds": took_s, "rate_hz": ticks.frames / took_s,
        "frame_ms": 1e3 * window.busy_s, "quality": str(window.quality),
    }  # fmt: skip


def _run(window: FaceWindow, source: Source, ticks: Ticks, until_s: float) -> Ticks:
    status_s = 0.0
    while window.is_open and time.monotonic() < until_s:
        ticks.wait()
        for key in window.show(source.frame(window.busy_s)):
            source.press(key)
        if time.monotonic() >= status_s:
            status_s = time.monotonic() + STATUS_S
            window.title(" – ".join(part for part in (source.title, source.status(), _pace(window)) if part))
    return ticks


def _pace(window: FaceWindow) -> str:
    """Describe the rate, and the resolution and head if those were reduced for it."""
    quality = window.quality
    reduced = "" if quality.scale == 1 else f" at {100 * quality.scale:.0f} %"
    reduced += ", coarser head" if quality.level else ""
    return f"{window.rate_hz:.0f} fps, {1e3 * window.busy_s:.1f} ms a frame{reduced}"


class FaceSource(Source):
    """A face of this program, which is closed with it."""

    def __init__(self, face: Face) -> None:
        self._face = face

    def frame(self, display_latency_s: float) -> Faps:
        """See :class:`Source`."""
        return self._face.frame(display_latency_s)

    def status(self) -> str:
        """See :class:`Source`."""
        if self._face.sync_error_s is not None:
            return f"{1e3 * self._face.sync_error_s:+.1f} ms from its sound"
        return self._face.speaker.description if self._face.speaker.is_silent else ""

    def press(self, key: str) -> None:
        """See :class:`Source`."""
        if key == BLINK:
            self._face.send_command(Blink())
        elif key == STOP:
            self._face.stop()
        elif key == PAUSE:
            (self._face.resume if self._face.speaker.is_paused else self._face.pause)()

    def close(self) -> None:
        """See :class:`Source`."""
        self._face.close()


class TrackSource(Source):
    """A track that is repeated, with its sound if there is one.

    Parameters
    ----------
    track : FapTrack
        At least one frame.
    clock : callable
        The monotonic clock, s.
    title : str
    samples : (N,) int16, optional
        Mono sound, from the track's first frame on.
    sample_rate_hz : int
    output : Output, optional
        Where the sound is played; closed with this.
    """

    def __init__(
        self,
        track: FapTrack,
        clock: Callable[[], float],
        *,
        title: str = "fapengine",
        samples: NDArray[np.int16] | None = None,
        sample_rate_hz: int = 0,
        output: Output | None = None,
    ) -> None:
        self.title = title
        self._track, self._clock = track, clock
        self._times_s = track.times_s - track.times_s[0]
        self._samples, self._sample_rate_hz, self._output = samples, sample_rate_hz, output
        sound_s = len(samples) / sample_rate_hz if samples is not None and sample_rate_hz else 0.0
        self.duration_s = max(float(self._times_s[-1]) + 1 / track.rate_hz, sound_s)
        self.is_paused = False
        self._zero_s = clock()
        self._sound: int | None = None
        self._sound_from_s = 0.0
        self._position_s = 0.0
        self.seek(0.0)

    @property
    def position_s(self) -> float:
        """Time from the first frame to the frame that is shown."""
        return self._position_s

    def frame(self, display_latency_s: float) -> Faps:
        """See :class:`Source`."""
        if not self.is_paused:
            now_s = self._clock()
            self._follow(now_s)
            self._position_s = now_s - self._zero_s
            if self._position_s >= self.duration_s:
                self.seek(0.0)
        seen_s = min(max(self._position_s + (0.0 if self.is_paused else display_latency_s), 0.0), self.duration_s)
        row = int(np.searchsorted(self._times_s, seen_s + 1e-9, side="right")) - 1
        faps: NDArray[np.int32] = self._track.values[max(row, 0)]
        return faps

    def status(self) -> str:
        """See :class:`Source`."""
        paused = ", paused" if self.is_paused else ""
        return f"{self._position_s:.2f} of {self.duration_s:.2f} s, {self._track.rate_hz:g} Hz{paused}"

    def press(self, key: str) -> None:
        """See :class:`Source`."""
        if key == PAUSE:
            self.is_paused = not self.is_paused
            self.seek(self._position_s)

    def close(self) -> None:
        """See :class:`Source`."""
        if self._output is not None:
            self._output.close()

    def seek(self, position_s: float) -> None:
        """Play from a position on, unless it is paused."""
        self._position_s, self._zero_s, self._sound = position_s, self._clock() - position_s, None
        if self._output is None or self._samples is None:
            return
        self._output.stop()
        rest = self._samples[round(position_s * self._sample_rate_hz) :]
        if not self.is_paused and len(rest):
            self._sound, self._sound_from_s = self._output.play(rest), position_s

    def _follow(self, now_s: float) -> None:
        """Follow the position of the sound; wait until it is heard."""
        if self._output is None or self._sound is None or self._output.is_over(self._sound, now_s):
            return
        heard_s = self._output.position_s(self._sound, now_s)
        self._zero_s = now_s - self._sound_from_s - max(heard_s or 0.0, 0.0)


class OscSource(Source):
    """Frames that arrive at a port."""

    def __init__(self, frames: OscViewer) -> None:
        self._frames = frames
        self.title = f"fapengine, port {frames.port}"

    def frame(self, display_latency_s: float) -> Faps:
        """See :class:`Source`."""
        return self._frames.faps()

    def status(self) -> str:
        """See :class:`Source`."""
        counts = self._frames.counts
        if self._frames.is_silent:
            return f"nothing comes to port {self._frames.port}"
        return f"session {self._frames.session}, {counts.frames} frames, {counts.missed} missed"

    def close(self) -> None:
        """See :class:`Source`."""
        self._frames.close()


class ServerSource(Source):
    """A session of a server.

    Parameters
    ----------
    link : WebSocketViewer
        Closed with this.
    sound : ViewerSound, optional
        Plays the server's sound; closed with this.
    texts : sequence of str
        Spoken there as soon as the server answers.
    voice : str
    clock : callable
        The monotonic clock, s.
    """

    title = "fapengine, server"

    def __init__(
        self,
        link: WebSocketViewer,
        *,
        sound: ViewerSound | None = None,
        texts: Sequence[str] = (),
        voice: str = "en-us",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._link, self._sound, self._clock = link, sound, clock
        self._texts, self._voice = list(texts), voice
        self.is_paused = False

    def frame(self, display_latency_s: float) -> Faps:
        """See :class:`Source`."""
        if self._link.state == "open":
            while self._texts:
                self._link.send("say", text=self._texts.pop(0), voice=self._voice)
            if not self._link.is_speaking:
                self._pause(False)  # as the face's, it ends with what was being said
        if self._sound is not None:
            self._sound.play(self._clock())
        return self._link.faps()

    def status(self) -> str:
        """See :class:`Source`."""
        link = self._link
        if link.state != "open":
            return f"no server: {link.trouble}" if link.trouble else "looking for the server"
        age_s, trip_s = link.age_s, link.round_trip_s
        if age_s is None or trip_s is None:
            return "open"
        return f"frames {1e3 * age_s:.0f} ms old, {link.counts.missed} missed, {1e3 * trip_s:.1f} ms there and back"

    @property
    def failure(self) -> str:  # type: ignore[override]
        """See :class:`Source`."""
        return "" if self._link.hello else f"server: {self._link.trouble or 'it did not answer in time'}"

    def press(self, key: str) -> None:
        """See :class:`Source`."""
        """See :class:`Source`."""
        if key == PAUSE:
            self._pause(not self.is_paused and self._link.is_speaking)
        elif key == STOP:
            self._link.send("cancel")
            if self._sound is not None:
                self._sound.stop()
            self._pause(False)
        elif key == BLINK:
            self._link.send("blink")

    def close(self) -> None:
        """See :class:`Source`."""
        if self._sound is not None:
            self._sound.close()
        self._link.close()

    def _pause(self, on: bool) -> None:
        """Pause the face and its sound, or resume them."""
        if on == self.is_paused:
            return
        self.is_paused = on
        if self._sound is not None:
            self._sound.pause(on)
        if on or self._sound is None or not self._sound.playing:  # a sound that resumes reports where: that is exact
            self._link.send("pause" if on else "resume")


def open_file(path: Path, audio: Path | None = None, *, device: str | None = None, silent: bool = False) -> TrackSource:
    """Open a file of face motion, and its sound.

    Raises UsageError if a file cannot be read; DataError if a file's content is wrong, or there is no frame;
    ResourceError if a sound device that was named is not there.
    """
    track = load_motion(path)
    if not len(track):
        raise DataError("contains no frames", where=str(path))
    title = f"fapengine, {path.name}"
    if audio is None:
        return TrackSource(track, time.monotonic, title=title)
    samples, rate_hz = load_sound(audio, spoken_s=track.times_s[-1])
    output = open_output(rate_hz, device=device, silent=silent)
    return TrackSource(track, time.monotonic, title=title, samples=samples, sample_rate_hz=rate_hz, output=output)


def open_url(
    url: str,
    *,
    session: str | None = None,
    texts: Sequence[str] = (),
    voice: str = "en-us",
    device: str | None = None,
    silent: bool = False,
) -> Source:
    """Connect to a server (``http://HOST:PORT/``), or listen for frames (``osc://HOST:PORT``).

    Raises UsageError if the URL cannot be read; ResourceError if the port is taken.

    Parameters
    ----------
    url : str
    session : str, optional
        By default the first.
    texts : sequence of str
        Texts that the server's face says first.
    voice : str
        Language of these texts.
    device : str, optional
        Where a server's sound is played.
    silent : bool
        Play no sound.
    """
    if not url.startswith("osc://"):
        link = WebSocketViewer(url, session=session, plays=not silent)
        sound = None if silent else ViewerSound(link, opens=partial(open_output, device=device))
        return ServerSource(link, sound=sound, texts=texts, voice=voice)
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise UsageError(f"source: got {url!r}, expected osc://HOST:PORT ({error})") from error
    if not host or port is None:
        raise UsageError(f"source: got {url!r}, expected osc://HOST:PORT")
    return OscSource(OscViewer(host, port, session=session))
