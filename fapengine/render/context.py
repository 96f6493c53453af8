"""An OpenGL context without a window, on a GPU or on Mesa's software renderer, and what is common to all renderers."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from fapengine._late import Late
from fapengine._signals import signals_kept
from fapengine.errors import ResourceError

if TYPE_CHECKING:
    import moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


REQUIRED = 330
"""OpenGL 3.3 core."""
BACKENDS = {"linux": "egl"}
"""Ways to a context by system where moderngl's own choice (WGL, CGL) needs a window or a display."""
MENDS = {
    "linux": "on Debian or Ubuntu: sudo apt-get install -y libegl1 libgl1",
    "win32": "install the graphics card's driver, or Mesa's opengl32.dll beside python.exe",
    "darwin": "it needs a session with a screen",
}


def create_context() -> moderngl.Context:
    """Make a context: through EGL on Linux, by the system's own way (WGL, CGL) on others.

    Raises
    ------
    ResourceError
        If there is no OpenGL 3.3; the message says what to install.
    """
    backend = BACKENDS.get(sys.platform)
    settings: dict[str, Any] = {"backend": backend} if backend else {}
    try:
        with signals_kept():
            return moderngl.create_context(standalone=True, require=REQUIRED, **settings)
    except ResourceError:
        raise
    except Exception as error:
        raise ResourceError(
            f"OpenGL: no context ({error}); {MENDS.get(sys.platform, 'expected OpenGL 3.3')}"
        ) from error


class Resource(Protocol):
    """Something that holds GPU memory."""

    def release(self) -> None:
        """Give the memory back."""


class Renderer(ABC):
    """Base of the renderers: the context that they draw in, and giving everything back at the end.

    Stateful. A context that the caller brings stays open.
    """

    def __init__(self, context: moderngl.Context | None) -> None:
        self._owns_context = context is None
        self._context = context or create_context()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give all GPU memory back."""
        for resource in self._resources():
            with self._context:
                resource.release()
        if self._owns_context:
            self._context.release()

    @abstractmethod
    def _resources(self) -> Iterable[Resource]:
        """All that is to be released, in this order."""
