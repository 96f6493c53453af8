"""An OpenGL context without a window, on a GPU or on Mesa's software renderer, and what is common to all renderers."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Protocol, Self

import moderngl

from fapengine._signals import signals_kept
from fapengine.errors import ResourceError

REQUIRED = 330
"""OpenGL 3.3 core."""


def create_context() -> moderngl.Context:
    """Make a context through EGL.

    Raises
    ------
    ResourceError
        If there is no OpenGL 3.3; the message says what to install.
    """
    settings: dict[str, Any] = {"backend": "egl"}
    try:
        with signals_kept():
            return moderngl.create_context(standalone=True, require=REQUIRED, **settings)
    except Exception as error:
        raise ResourceError(
            f"OpenGL: no context ({error}); on Debian or Ubuntu: sudo apt-get install -y libegl1 libgl1"
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
