"""A camera that drives a face live: on a screen, in other programs, in a session of a server.

Two threads connect the camera with the face. One takes images, of which only the newest waits, so none is late by more
than one image; the other runs the face detector. Frames are shown by the clock, independent of both.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from fapengine.app.capture import CAMERA, camera_number
from fapengine.app.face import SESSION, Face, Ticks
from fapengine.app.motion import save
from fapengine.app.say_live import Screen
from fapengine.errors import ResourceError, UsageError
from fapengine.files.landmarks import MAX_SIDE, Detector
from fapengine.files.video import FILMS, camera_pictures, stream_pictures
from fapengine.laboratory.watched import EASE_S, HOLD_S, WatchedFace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.trajectory.style import Style

if TYPE_CHECKING:
    from fapengine.clients.websocket_viewer import WebSocketViewer

Pictures = Iterable[tuple[float, NDArray[np.uint8]]]

LIVE_HZ = 30.0
"""Default frame rate."""
NUMBERS = range(3, fap.FAP_COUNT + 1)
"""FAPs that are sent: all but visemes and expressions, which a camera does not find."""
FOUND_S = 5.0
"""Longest time until a server answers."""
JOIN_S = 2.0


def at_their_times(
    pictures: Pictures, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Yield each image, (H, W, 3) sRGB, at its time in s after the first one."""
    begun_s: float | None = None
    for time_s, picture in pictures:
        if begun_s is not None:
            sleep(max(begun_s + time_s - clock(), 0.0))
        yield time_s, picture
        begun_s = clock() - time_s if begun_s is None else begun_s


@dataclass(slots=True)
class EyeCounts:
    """Counts of :class:`Eyes`. Stateful."""

    pictures: int = 0
    """Processed images."""
    late: int = 0
    """Images that were replaced by a newer one before they were processed."""
    faces: int = 0
    delays_s: list[float] = field(default_factory=list)
    """Time from image to face, for the last 300 images."""


class Eyes:
    """Finds faces in images, in threads of its own. Use it in ``with``.

    Stateful.

    Parameters
    ----------
    pictures : iterable
        Time in s, which is ignored, and (H, W, 3) sRGB; each as soon as it is available.
    open_detector : callable
        Creates the detector of 478 landmarks.
    clock : callable
        The monotonic clock.
    """

    def __init__(
        self, pictures: Pictures, open_detector: Callable[[], Detector], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.counts = EyeCounts()
        self.error: Exception | None = None
        self._pictures, self._open_detector, self._clock = pictures, open_detector, clock
        self._face = WatchedFace()
        self._lock = threading.Condition()
        self._newest: tuple[float, NDArray[np.uint8]] | None = None
        self._left = False
        self._is_over = self._is_looked_through = False
        self._threads = [
            threading.Thread(target=self._guarded, args=(work,), name=f"fapengine-{name}", daemon=True)
            for name, work in (("camera", self._take), ("eyes", self._look))
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._left = True
            self._lock.notify_all()
        self._threads[1].join(JOIN_S)  # a camera may keep the other one waiting

    @property
    def is_over(self) -> bool:
        """True when all images were processed."""
        return self._is_looked_through

    @property
    def is_known(self) -> bool:
        """True once the neutral face is known."""
        return self._face.is_known

    def faps(self, now_s: float) -> NDArray[np.int32]:
        """Return the FAPs to show now, (68,) int32 FAPU. Raises the error of the camera or the detector."""
        if self.error is not None:
            raise self.error
        with self._lock:
            return self._face.faps(now_s)

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001  faps() raises it
            self.error = error
        finally:
            with self._lock:
                self._is_over = True
                self._lock.notify_all()

    def _take(self) -> None:
        for _, picture in self._pictures:
            with self._lock:
                if self._left:
                    return
                self.counts.late += self._newest is not None
                self._newest = self._clock(), picture
                self._lock.notify_all()
                # the detector starts within a second
                self._lock.wait_for(lambda: self.counts.pictures > 0 or self._is_over or self._left)

    def _look(self) -> None:
        with self._open_detector() as detector:
            while (taken := self._next()) is not None:
                taken_s, picture = taken
                points = detector.find(picture)
                with self._lock:
                    self._face.see(taken_s, points)
                    self.counts.pictures += 1
                    self._lock.notify_all()
                self.counts.faces += bool(np.isfinite(points).all())
                self.counts.delays_s = [*self.counts.delays_s[-299:], self._clock() - taken_s]
        self._is_looked_through = True

    def _next(self) -> tuple[float, NDArray[np.uint8]] | None:
        with self._lock:
            self._lock.wait_for(lambda: self._newest is not None or self._is_over or self._left)
            taken, self._newest = self._newest, None
            return None if self._left else taken


def watch_live(
    source: str,
    open_screen: Callable[[], Screen],
    *,
    rate_hz: float = LIVE_HZ,
    seconds: float | None = None,
    sinks: Sequence[str] = (),
    server: str | None = None,
    output: Path | None = None,
    model: Path | None = None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, object]:
    """Drive a face from a camera until the viewer closes the screen or presses Ctrl-C, or the video ends.

    Raises UsageError if the source is not a camera or a video, or for an invalid sink or rate; DataError if the video
    is damaged; ResourceError if there is no camera, no detector or no server, or the screen cannot be opened.

    Parameters
    ----------
    source : str
        ``webcam``, ``webcam:1``, or a video, which is played in real time.
    open_screen : callable
        Creates the screen when camera and face are ready.
    rate_hz : float
        Frame rate of what is shown and sent.
    seconds : float, optional
        Duration; by default until the video ends or the viewer stops.
    sinks : sequence of str
        URLs: see :mod:`fapengine.server.sinks.kinds`.
    server : str, optional
        Page of ``fapengine serve``, with the session to drive: ``http://127.0.0.1:8110/?session=anna``.
    output : Path, optional
        File that records the shown frames (.fap, .fba, .csv).
    model : Path, optional
        MediaPipe's ``face_landmarker.task``, for wheels without a model.
    clock, sleep : callable
        The monotonic clock, and a function that waits by it.

    Returns
    -------
    dict
        Plain values: shown frames, processed images, latency.
    """
    pictures = _pictures(source, clock, sleep)
    rows: list[NDArray[np.int32]] | None = None if output is None else []
    with ExitStack() as stack:
        face = stack.enter_context(
            Face(style=Style.speech_only(), rate_hz=rate_hz, silent=True, sinks=sinks, clock=clock)
        )
        link = _linked(server, clock) if server is not None else None
        if link is not None:
            stack.callback(link.close)
        eyes = stack.enter_context(Eyes(pictures, lambda: Detector(model), clock))
        screen = stack.enter_context(open_screen())
        ticks = Ticks(rate_hz, clock=clock, sleep=sleep)
        begun_s = face.hub.clock()
        with suppress(KeyboardInterrupt):  # stops it
            _run(face, eyes, screen, ticks, link, rows, seconds)
        took_s = face.hub.clock() - begun_s
    if output is not None and rows:
        save(FapTrack.from_values(np.stack(rows), rate_hz=rate_hz), output)
    counts = eyes.counts
    delays_ms = 1e3 * np.array(counts.delays_s or [0.0])
    return {
        "source": source, "seconds": round(took_s, 2), "frames": ticks.frames, "skipped": ticks.skipped,
        "rate_hz": rate_hz, "pictures": counts.pictures, "late": counts.late,
        "seen": round(counts.faces / max(counts.pictures, 1), 4), "known": eyes.is_known,
        "delay_ms": {"p50": float(np.median(delays_ms)), "p95": float(np.percentile(delays_ms, 95))},
    }  # fmt: skip


def _pictures(source: str, clock: Callable[[], float], sleep: Callable[[float], None]) -> Pictures:
    if source.partition(":")[0] == CAMERA:
        return camera_pictures(camera_number(source), seconds=np.inf)
    path = Path(source)
    if path.suffix.lower() not in FILMS:
        raise UsageError(f"source: got {source!r}, expected {CAMERA} or a video")
    if not path.is_file():
        raise UsageError(f"{path}: cannot be read (no such file)")
    return at_their_times(stream_pictures(path, max_side=MAX_SIDE), clock, sleep)


def _run(
    face: Face, eyes: Eyes, screen: Screen, ticks: Ticks, link: "WebSocketViewer | None",
    rows: list[NDArray[np.int32]] | None, seconds: float | None,
) -> None:  # fmt: skip
    begun_s, over_s, is_shown = face.hub.clock(), None, True
    while is_shown:
        ticks.wait()
        now_s = face.hub.clock()
        faps = eyes.faps(now_s)
        values = {number: int(faps[fap.column(number)]) for number in NUMBERS}
        face.hub.host(SESSION).perform(values, now_s)
        if link is not None:
            link.send("perform", values={str(number): value for number, value in values.items()})
        if rows is not None:
            rows += [faps] * (ticks.frames + ticks.skipped - len(rows))
        is_shown = screen.show(face.frame(screen.display_latency_s), now_s - begun_s)
        over_s = now_s if eyes.is_over and over_s is None else over_s
        is_eased = over_s is not None and now_s > over_s + HOLD_S + EASE_S
        if is_eased or (seconds is not None and now_s >= begun_s + seconds):
            return


def _linked(url: str, clock: Callable[[], float]) -> "WebSocketViewer":
    """Connect to a session of a server, without its frames.

    Raises UsageError if the URL is invalid; ResourceError if the server does not answer, or aiohttp is missing.
    """
    from fapengine.clients.websocket_viewer import WebSocketViewer

    link = WebSocketViewer(url, clock=clock)
    until_s = time.monotonic() + FOUND_S
    while link.state != "open":
        if time.monotonic() > until_s:
            link.close()
            raise ResourceError(link.trouble or f"no server answers at {url}")
        time.sleep(0.02)
    link.send("watch", on=False)
    return link
