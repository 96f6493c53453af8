"""A face rendered by a child process (:mod:`fapengine._child`), so that audio and event loop do not wait for images.

Rendering holds Python's lock for some 10 ms. FAPs go to the child (68 int32), RGB pixels come back.
:meth:`Painter.draw` waits for the image, without the lock; :meth:`Painter.picture` does so in a thread.
"""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from fapengine._child import NICENESS, Child, Parent, command
from fapengine.errors import FapEngineError, ResourceError
from fapengine.mpeg4.fap import FAP_COUNT


class Painter:
    """A rendering process. Stateful; close it.

    Parameters
    ----------
    head : str
        Name or folder of a head: see :func:`fapengine.files.heads.load.load_head_for_calls`.
    size : (int, int)
        Width and height in pixels.
    edges : str
        ``soft``, ``fine`` or ``none``: see :func:`fapengine.render.drawing.parse_edges`.

    Raises
    ------
    ResourceError
        If no process can be started.
    """

    def __init__(self, head: str = "default", size: tuple[int, int] = (512, 512), edges: str = "soft") -> None:
        self.size = size
        self._thread = ThreadPoolExecutor(1, "painter")
        self._child = Child(
            "painter", command(__name__, head, *map(str, size), edges, niceness=NICENESS), is_quiet=True
        )

    async def ready(self) -> None:
        """Wait until it can render.

        Raises
        ------
        ResourceError
            If it cannot: unknown head, no OpenGL.
        """
        await self.picture(np.zeros(FAP_COUNT, np.int32))

    async def picture(self, faps: NDArray[np.int32]) -> bytes:
        """Render in a thread: (68,) FAPU to width x height x 3 bytes, top row first. Raises as :meth:`draw`."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self.draw, faps)

    def draw(self, faps: NDArray[np.int32]) -> bytes:
        """Render and wait: (68,) FAPU to width x height x 3 bytes, top row first.

        Raises
        ------
        ResourceError
            If the process has ended.
        """
        try:
            return self._child.ask({}, np.asarray(faps, np.int32).tobytes())[1]
        except EOFError as error:
            raise ResourceError("painter: its process has ended") from error
        except FapEngineError as error:
            raise ResourceError(f"painter: {error}") from error

    def kill(self) -> None:
        """End the process at once, without waiting; :meth:`close` must follow."""
        self._child.kill()

    def close(self) -> None:
        """End the process. Further calls do nothing."""
        self._child.kill()
        self._thread.shutdown(wait=True)
        self._child.close()


def main(parent: Parent, head: str, width: str, height: str, edges: str) -> None:
    """Render the FAPs that come; the child's program."""
    from fapengine.files.heads.load import load_head_for_calls
    from fapengine.render.drawing import Drawing, parse_edges
    from fapengine.render.renderer import FaceRenderer

    size = (int(width), int(height))
    with FaceRenderer(load_head_for_calls(head, size), Drawing(size=size, samples=parse_edges(edges))) as renderer:
        for _, faps in parent.messages():
            parent.tell({}, renderer.draw(np.frombuffer(faps, np.int32)).tobytes())
