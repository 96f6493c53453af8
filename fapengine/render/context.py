"""OpenGL contexts without a window, on a GPU or on Mesa's software renderer; their programs; the base of renderers."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self

from fapengine._late import Late
from fapengine._signals import signals_kept
from fapengine.errors import ResourceError
from fapengine.render.programs import STAGES, stage_source

if TYPE_CHECKING:
    import moderngl as moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


REQUIRED = 330
"""OpenGL 3.3 core."""
BACKENDS = {"linux": "egl"}
"""Backend by system where moderngl's own choice (WGL, CGL) would need a window or a display."""
FIXES = {
    "linux": "on Debian or Ubuntu: sudo apt-get install -y libegl1 libgl1",
    "win32": "install the graphics card's driver, or Mesa's opengl32.dll next to python.exe",
    "darwin": "it needs a session with a screen",
}


def create_context() -> moderngl.Context:
    """Create a context: through EGL on Linux, with the system's own interface (WGL, CGL) elsewhere.

    Raises
    ------
    ResourceError
        If OpenGL 3.3 is not available; the message says what to install.
    """
    settings: dict[str, Any] = {"backend": BACKENDS[sys.platform]} if sys.platform in BACKENDS else {}
    try:
        with signals_kept():
            return moderngl.create_context(standalone=True, require=REQUIRED, **settings)
    except ResourceError:
        raise
    except Exception as error:
        fix = FIXES.get(sys.platform, "expected OpenGL 3.3")
        raise ResourceError(f"OpenGL: no context ({error}); {fix}") from error


class Programs:
    """Programs of a context, each compiled when it is first used.

    Stateful.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.context = context
        self._compiled: dict[tuple[str, tuple[str, ...]], moderngl.Program] = {}

    def get(self, name: str, defined: tuple[str, ...] = ()) -> moderngl.Program:
        """Return a program of :data:`fapengine.render.programs.STAGES`."""
        key = name, defined
        if key not in self._compiled:
            vertex, fragment = (stage_source(files, defined=defined) for files in STAGES[name])
            with signals_kept():
                self._compiled[key] = self.context.program(vertex_shader=vertex, fragment_shader=fragment)
        return self._compiled[key]

    def release(self) -> None:
        """Free them all."""
        while self._compiled:
            self._compiled.popitem()[1].release()


class Renderer(ABC):
    """Base of the renderers: their context, and releasing everything at the end.

    Stateful. A context passed by the caller stays open.
    """

    def __init__(self, context: moderngl.Context | None) -> None:
        self._owns_context = context is None
        self._context = context or create_context()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free all GPU memory."""
        with self._context:
            for resource in self._resources():
                resource.release()
        if self._owns_context:
            self._context.release()

    @abstractmethod
    def _resources(self) -> Iterable[Any]:
        """Everything to release, in this order."""
