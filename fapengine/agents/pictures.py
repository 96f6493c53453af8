"""The images of an agent's face, drawn beside its audio, which never waits for them.

Theory of operation
-------------------
At most one image is in flight. FAPs that come meanwhile wait in one place, where newer ones replace them: so the next
image is of the newest FAPs, a slow painter shows fewer images, and none is of the past. A painter that ends starts its
process again by itself; until then the last image stays.
"""

import asyncio
import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ResourceError
from fapengine.mpeg4 import fap
from fapengine.server.film.painter import FilmCounts, Painter

SMALL_FAPU = np.full(fap.FAP_COUNT, 30)
"""(68,) FAPU: about one pixel of a 512 x 512 image, the motion of a listening face from one frame to the next."""
SMALL_FAPU[fap.columns(23, 24, 25, 26)] = 5000  # eyes, 1e-5 rad
SMALL_FAPU[fap.columns(48, 49, 50)] = 800  # the head, likewise
WARN_AFTER = 100
"""Number of images from which on a warning may say that more than half were skipped: 4 s at 25 per second."""

log = logging.getLogger("fapengine.agents")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A finished image."""

    due_s: float
    """Time at which the audio of its frame begins to be heard."""
    faps: NDArray[np.int32]
    """(68,) FAPU."""
    pixels: bytes
    """RGB, top row first."""


class Pictures:
    """Images in flight and finished. Stateful; used on one event loop.

    Parameters
    ----------
    counts : FilmCounts
        Counts images that are drawn and skipped.
    """

    def __init__(self, counts: FilmCounts) -> None:
        self.counts = counts
        self.failure: ResourceError | None = None
        """Why there are no more images."""
        self._drawing: asyncio.Task[None] | None = None
        self._next: tuple[float, NDArray[np.int32]] | None = None
        """Newest FAPs that wait for the image in flight, and when they are due."""
        self._finished: Picture | None = None
        self._before: Picture | None = None
        """The previous image; None if it was shown twice."""
        self._has_warned = False

    def show(self, faps: NDArray[np.int32], due_s: float, painter: Painter, *, is_still: bool) -> None:
        """Draw the (68,) FAPU of a frame, or skip those that wait.

        ``is_still`` is True in silence: then an image in which little would move is used twice.
        """
        before, self._before = self._before, None
        if self.failure is not None:
            return
        if self._drawing is not None:
            self._skip(self._next)
            self._next = due_s, faps.copy()
        elif is_still and before is not None and (np.abs(faps - before.faps) <= SMALL_FAPU).all():
            self._finished = Picture(due_s, faps, before.pixels)
        else:
            self._next = due_s, faps.copy()
            self._drawing = asyncio.get_running_loop().create_task(self._draw(painter))

    def take(self) -> Picture | None:
        """Return the newest finished image, once."""
        finished, self._finished = self._finished, None
        return finished

    async def wait(self, most_s: float) -> None:
        """Wait until no image is in flight, or the time is over."""
        if self._drawing is not None and most_s > 0.0:
            await asyncio.wait({self._drawing}, timeout=most_s)

    def close(self) -> None:
        """Draw no more."""
        if self._drawing is not None:
            self._drawing.cancel()

    async def _draw(self, painter: Painter) -> None:
        while self._next is not None:
            (due_s, faps), self._next = self._next, None
            try:
                pixels = await painter.picture(faps)
            except ResourceError as error:
                self.failure = error
                self.counts.faults += 1
                log.error("no more images, the audio continues: %s", error)
                break
            self.counts.drawn += 1
            self._finished = self._before = Picture(due_s, faps, pixels)
        self._drawing = None

    def _skip(self, waiting: object) -> None:
        """Count FAPs that are replaced, except before the first image, when the painter starts."""
        if waiting is None or not self.counts.drawn:
            return
        self.counts.left_out += 1
        drawn, skipped = self.counts.drawn, self.counts.left_out
        if not self._has_warned and drawn + skipped >= WARN_AFTER and skipped > drawn:
            self._has_warned = True
            log.warning("%d images were skipped and %d drawn: smaller ones take less time", skipped, drawn)
