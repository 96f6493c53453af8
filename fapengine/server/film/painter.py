"""A face rendered by a child process (:mod:`fapengine._child`), so that audio and event loop do not wait for images.

Rendering holds Python's lock for some 10 ms. FAPs go to the child (68 int32), RGB or I420 comes back.
:meth:`Painter.draw` waits for the image, without the lock; :meth:`Painter.picture` does so in a thread. A child that
ends is started again (:class:`fapengine._child.Restarts`), and then draws the image that was asked for: callers see an
image that takes long.
"""

import asyncio
import contextlib
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._child import NICENESS, Child, Parent, Restarts, command
from fapengine._counters import Counts
from fapengine.errors import FapEngineError, ResourceError
from fapengine.mpeg4.fap import FAP_COUNT

if TYPE_CHECKING:
    from fapengine.render.drawing import Pixels

log = logging.getLogger("fapengine.server")


@dataclass(slots=True)
class FilmCounts(Counts):
    """Counts of all images that are drawn for calls, cameras, streams or agents. Stateful."""

    METRIC = "pictures", "Pictures for calls, cameras and streams, by kind."

    drawn: int = 0
    left_out: int = 0
    """Images for which there was no time."""
    faults: int = 0
    """Films that ended because nothing could be rendered."""
    restarts: int = 0
    """Rendering processes that ended by themselves and were started again."""


class Painter:
    """A rendering process. Stateful; close it.

    Raises ResourceError if no process can be started.

    Parameters
    ----------
    head : str
        Name or folder of a head: see :func:`fapengine.files.heads.load.load_head_for_calls`.
    size : (int, int)
        Width and height in pixels.
    edges : str
        ``soft``, ``fine`` or ``none``: see :func:`fapengine.render.drawing.parse_edges`.
    counts : FilmCounts, optional
        Counts restarts.
    pixels : Pixels
        How images are stored: see :data:`fapengine.render.drawing.Pixels`.
    """

    def __init__(
        self,
        head: str = "default",
        size: tuple[int, int] = (512, 512),
        edges: str = "soft",
        counts: FilmCounts | None = None,
        pixels: "Pixels" = "rgb",
    ) -> None:
        self.size, self.counts = size, counts or FilmCounts()
        self._thread = ThreadPoolExecutor(1, "painter")
        self._command = command(__name__, head, *map(str, size), edges, pixels, niceness=NICENESS)
        self._child = self._started()
        self._restarts, self._is_over = Restarts(), threading.Event()

    def _started(self) -> Child:
        return Child("painter", self._command, is_quiet=True)

    async def ready(self) -> None:
        """Wait until it can render. Raises ResourceError if it cannot: unknown head, no OpenGL."""
        await self.picture(np.zeros(FAP_COUNT, np.int32))

    async def picture(self, faps: NDArray[np.int32]) -> bytes:
        """Render in a thread; returns and raises as :meth:`draw`."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self.draw, faps)

    def draw(self, faps: NDArray[np.int32]) -> bytes:
        """Render and wait: (68,) FAPU to the bytes of an image.

        Raises ResourceError if it cannot render: unknown head, no OpenGL; or its process has ended three times with few
        images.
        """
        data = np.asarray(faps, np.int32).tobytes()
        while True:
            try:
                pixels = self._child.ask({}, data)[1]
            except EOFError as error:
                wait_s = None if self._is_over.is_set() else self._restarts.failed()
                if wait_s is None or self._is_over.wait(wait_s):
                    raise ResourceError("painter: its process has ended") from error
                self._start_again()
            except FapEngineError as error:
                raise ResourceError(f"painter: {error}") from error
            else:
                self._restarts.worked()
                return pixels

    def _start_again(self) -> None:
        log.warning("painter: its process has ended; a new one is started")
        self.counts.restarts += 1
        self._child.close()
        with contextlib.suppress(ResourceError):  # none can be started now: the closed one counts as another failure
            self._child = self._started()
        if self._is_over.is_set():  # meanwhile
            self._child.kill()

    def kill(self) -> None:
        """End the process at once, without waiting; :meth:`close` must follow."""
        self._is_over.set()
        self._child.kill()

    def close(self) -> None:
        """End the process. Further calls do nothing."""
        self.kill()
        self._thread.shutdown(wait=True)
        self._child.close()


def main(parent: Parent, head: str, width: str, height: str, edges: str, pixels: "Pixels") -> None:
    """Render the FAPs that come; the child's program."""
    from fapengine.files.heads.load import load_head_for_calls
    from fapengine.render.drawing import RenderOptions, parse_edges
    from fapengine.render.native import open_renderer

    size = (int(width), int(height))
    drawing = RenderOptions(size=size, samples=parse_edges(edges))
    with open_renderer(load_head_for_calls(head, size), drawing) as renderer:
        for _, faps in parent.messages():
            parent.tell({}, renderer.draw(np.frombuffer(faps, np.int32), pixels).tobytes())
