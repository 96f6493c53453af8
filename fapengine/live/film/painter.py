"""A face drawn by a process of its own: neither the sound nor the event loop waits for a picture.

Theory of operation
-------------------
To draw holds Python's lock for some 10 ms. So another process draws (``python -m fapengine.live.film.painter``):
FAPs go in through its standard input (68 int32), RGB pixels come out of its standard output. It ends with its input.
:meth:`Painter.draw` waits for the picture, without the lock; :meth:`Painter.picture` does so in a thread.
"""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.mpeg4.fap import FAP_COUNT

_PIPE_BYTES = 1 << 20
"""Size asked for the pipe of the pictures; 64 KiB is usual, and makes many small steps of a picture."""


class Painter:
    """The other end of a drawing process. Stateful; close it.

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
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "fapengine.live.film.painter", head, *map(str, size), edges],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, process_group=0,
            )  # fmt: skip
        except OSError as error:
            raise ResourceError(f"painter: its process cannot be started: {error.strerror or error}") from error

    async def ready(self) -> None:
        """Wait until it can draw.

        Raises
        ------
        ResourceError
            If it cannot: no such head, no OpenGL.
        """
        await self.picture(np.zeros(FAP_COUNT, np.int32))

    async def picture(self, faps: NDArray[np.int32]) -> bytes:
        """Draw in a thread: (68,) FAPU to width x height x 3 bytes, top row first. Raises as :meth:`draw`."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self.draw, faps)

    def draw(self, faps: NDArray[np.int32]) -> bytes:
        """Wait for a picture: (68,) FAPU to width x height x 3 bytes, top row first.

        Raises
        ------
        ResourceError
            If the process has ended.
        """
        picture = bytearray(self.size[0] * self.size[1] * 3)
        view, filled = memoryview(picture), 0
        pictures: Any = self._process.stdout
        with contextlib.suppress(OSError):
            _pipe(self._process.stdin).write(np.asarray(faps, np.int32).tobytes())
            while filled < len(picture) and (count := pictures.readinto(view[filled:])):
                filled += count
        if filled < len(picture):
            told = _pipe(self._process.stderr).read().decode(errors="replace").strip()
            raise ResourceError(told.splitlines()[-1] if told else "painter: its process has ended")
        return bytes(picture)

    def close(self) -> None:
        """End the process. To close again does nothing."""
        self._process.kill()
        self._process.wait()
        self._thread.shutdown(wait=True)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            _pipe(pipe).close()


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None
    return pipe


def main() -> None:
    """Be the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is told, and tells
    head, width, height, edges = sys.argv[1:]
    pictures = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints must not fall between
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(pictures.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    try:
        _paint(head, (int(width), int(height)), edges, pictures)
    except (FapEngineError, UsageError) as error:
        sys.exit(f"painter: {error}")
    except BrokenPipeError:
        pass


def _paint(head: str, size: tuple[int, int], edges: str, pictures: IO[bytes]) -> None:
    from fapengine.files.heads.load import load_head_for_calls
    from fapengine.render.drawing import Drawing, parse_edges
    from fapengine.render.renderer import FaceRenderer

    with FaceRenderer(load_head_for_calls(head, size), Drawing(size=size, samples=parse_edges(edges))) as renderer:
        while len(faps := sys.stdin.buffer.read(4 * FAP_COUNT)) == 4 * FAP_COUNT:
            view = memoryview(renderer.draw(np.frombuffer(faps, np.int32)).tobytes())
            while view:
                view = view[pictures.write(view) :]


if __name__ == "__main__":
    main()
