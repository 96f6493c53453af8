"""A session as images and audio, made while it has watchers: rendered by a process of its own, in engine time.

Theory of operation
-------------------
Every image and every block of audio carries its engine time; a watcher shows what has the same time together (for
example :data:`SHOW_AFTER_S` later), so lips and audio are in sync. Images are rendered one after another: frames that
come meanwhile are skipped, so a slow machine shows fewer images, and none late. A face that does not move is rendered
less often. All watchers of one session in one size share the rendering.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ResourceError
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.host.listeners import HeardSound, HubFrame, Spoken, Unsubscribe
from fapengine.server.film.painter import FilmCounts, Painter
from fapengine.server.film.soundtrack import BLOCK_S, Samples, Soundtrack
from fapengine.server.intake.tasks import Tasks

SHOW_AFTER_S = 0.1
"""Delay after the engine time at which an image is shown with its audio; machines that keep up have rendered it."""
STILL_S = 0.25
"""Time between two images of a face that does not move."""
LOST_S = 1.0
"""A longer stall of the server is omitted from the audio."""

log = logging.getLogger("fapengine.server")


@dataclass(frozen=True, slots=True)
class FilmForm:
    """Head, size and rate of the images of a film."""

    head: str = "default"
    size: tuple[int, int] = (512, 512)
    """Width and height in pixels, even numbers."""
    rate_hz: float = 30.0
    """Images per second, at most the frame rate of the hub."""


class Watcher(Protocol):
    """Receives a film; called on the hub's thread."""

    def picture(self, time_s: float, pixels: bytes) -> None:
        """Receive an image: engine time, and the bytes of an I420 image (:class:`Painter`)."""

    def sound(self, time_s: float, samples: Samples) -> None:
        """Receive a block of audio, (960,) int16 at 48 kHz, that begins at an engine time."""

    def over(self, reason: str) -> None:
        """Receive the reason why no more images come."""


class Film:
    """One session in one form; open while it has watchers (:class:`Studio`). Stateful.

    Raises UsageError if the server has no room for another session; ResourceError if no process can be started.
    """

    def __init__(self, hub: Hub, session: str, form: FilmForm, hearing: Hearing | None, counts: FilmCounts) -> None:
        self._hub, self.session, self.form, self._counts = hub, session, form, counts
        self.watchers: set[Watcher] = set()
        release = hub.hold(session)
        try:
            self._painter = Painter(form.head, form.size, counts=counts, pixels="i420")
        except ResourceError:
            release()
            raise
        self._track = Soundtrack()
        self._leave: list[Unsubscribe] = [
            release,
            hub.listeners.on_frame(session, self._frame),
            hub.listeners.on_speech(session, self._spoken, plays=False),
        ]
        if hearing is not None:
            self._leave.append(hearing.on_sound(session, self._heard))
        self._due_s = self._shown_s = -inf
        self._sound_s: float | None = None
        self._shown: NDArray[np.int32] | None = None
        self._drawing: asyncio.Task[None] | None = None

    def stop(self) -> None:
        """Stop rendering, without waiting; :meth:`close` must follow."""
        if self._drawing is not None:
            self._drawing.cancel()
        self._painter.kill()
        for leave in self._leave:
            leave()

    async def close(self) -> None:
        """Wait until rendering has ended."""
        if self._drawing is not None:
            await asyncio.gather(self._drawing, return_exceptions=True)
        await asyncio.to_thread(self._painter.close)

    def _frame(self, frame: HubFrame) -> None:
        self._play(frame.time_s)
        half_s = 0.5 / self._hub.pacer.rate_hz
        if frame.time_s < self._due_s - half_s:
            return
        late = frame.time_s - self._due_s
        self._due_s = (self._due_s if late < 1.0 else frame.time_s) + 1.0 / self.form.rate_hz
        if self._drawing is not None:
            self._counts.left_out += 1
            return
        is_still = self._shown is not None and np.array_equal(frame.faps, self._shown)
        if not is_still or frame.time_s - self._shown_s > STILL_S:
            self._shown, self._shown_s = frame.faps.copy(), frame.time_s
            self._drawing = asyncio.create_task(self._draw(frame.time_s, self._shown))

    async def _draw(self, time_s: float, faps: NDArray[np.int32]) -> None:
        try:
            pixels = await self._painter.picture(faps)
        except ResourceError as error:
            self._counts.faults += 1
            log.error("%s: no more images: %s", self.session, error, extra={"session": self.session})
            for watcher in tuple(self.watchers):
                watcher.over(str(error))
            return  # _drawing stays set, so nothing more is rendered
        self._drawing = None
        self._counts.drawn += 1
        for watcher in tuple(self.watchers):
            watcher.picture(time_s, pixels)

    def _play(self, now_s: float) -> None:
        if self._sound_s is None or now_s - self._sound_s > LOST_S:
            self._sound_s = now_s
        while self._sound_s + BLOCK_S <= now_s:
            block = self._track.block(self._sound_s)
            for watcher in tuple(self.watchers):
                watcher.sound(self._sound_s, block)
            self._sound_s += BLOCK_S

    def _spoken(self, spoken: Spoken) -> None:
        def position(now_s: float) -> float | None:
            engine = self._hub.engine
            utterance = engine.utterance(self.session, spoken.utterance) if self.session in engine else None
            return None if utterance is None else utterance.position_s(now_s)

        self._track.clip(spoken.utterance, spoken.speech.sample_rate_hz, position).push(spoken.speech.samples)

    def _heard(self, sound: HeardSound) -> None:
        clip = self._track.clip(
            sound.key, sound.rate_hz, sound.place, is_endless=sound.is_endless, first_s=sound.first_s
        )
        clip.push(sound.samples)


@dataclass(slots=True, eq=False)
class Studio:
    """All films of a hub. Stateful."""

    hub: Hub
    hearing: Hearing | None = None
    counts: FilmCounts = field(default_factory=FilmCounts)
    _films: dict[tuple[str, FilmForm], Film] = field(default_factory=dict)
    _closing: Tasks = field(default_factory=Tasks)

    def __len__(self) -> int:
        return len(self._films)

    def __contains__(self, film: tuple[str, FilmForm]) -> bool:
        return film in self._films

    def watch(self, session: str, form: FilmForm, watcher: Watcher) -> Callable[[], None]:
        """Show a session to a watcher until the returned function is called.

        Raises UsageError if the server has no room for one more session; ResourceError if no process can be started.
        """
        film = self._films.get((session, form))
        if film is None:
            film = self._films[session, form] = Film(self.hub, session, form, self.hearing, self.counts)
        film.watchers.add(watcher)

        def leave() -> None:
            film.watchers.discard(watcher)
            if not film.watchers and self._films.get((session, form)) is film:
                del self._films[session, form]
                film.stop()
                self._closing.start(film.close())

        return leave

    async def close(self) -> None:
        """Wait until the rendering of films without watchers has ended."""
        await asyncio.gather(*self._closing, return_exceptions=True)
