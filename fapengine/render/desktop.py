"""GLFW: windows with OpenGL, one of them current at a time.

A thread has one current OpenGL, and GLX and EGL do not know each other: where EGL's is current, X ends the process that
makes a window's so, and where a window's is, EGL's calls go astray. So a window is current only within :func:`current`,
which lets EGL's go first.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from fapengine._late import Late
from fapengine.errors import ResourceError
from fapengine.render.context import REQUIRED

if TYPE_CHECKING:
    import moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


HOW_TO_INSTALL = 'pip install "fapengine[window]"'


def start_glfw() -> Any:
    """GLFW, ready; it stays so until the process ends.

    Raises
    ------
    ResourceError
        If it is not installed, or there is no display.
    """
    try:
        import glfw
    except ImportError as error:
        raise ResourceError(f"window: {error}; mend it with: {HOW_TO_INSTALL}") from error
    glfw.ERROR_REPORTING = "exception"
    try:
        glfw.init()
    except glfw.GLFWError as error:
        why = _plain(error)
        raise ResourceError(f"window: no display ({why}); `fapengine serve` shows the face in a browser") from error
    return glfw


def create_window(title: str, size: tuple[int, int], *, visible: bool = True) -> Any:
    """Open a window with OpenGL 3.3 core; size in points.

    Raises
    ------
    ResourceError
        If the display has no such OpenGL.
    """
    glfw = start_glfw()
    hints = {
        glfw.CONTEXT_VERSION_MAJOR: REQUIRED // 100, glfw.CONTEXT_VERSION_MINOR: REQUIRED // 10 % 10,
        glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE, glfw.OPENGL_FORWARD_COMPAT: True, glfw.DEPTH_BITS: 0,
        glfw.VISIBLE: visible,
    }  # fmt: skip
    _leave_egl()  # making a window makes its OpenGL current for a moment
    try:
        for hint, value in hints.items():
            glfw.window_hint(hint, value)
        return glfw.create_window(*size, title, None, None)
    except glfw.GLFWError as error:
        why = _plain(error)
        raise ResourceError(f"window: no OpenGL 3.3 on this display ({why}); try `fapengine doctor`") from error


@contextmanager
def current(window: Any) -> Iterator[None]:
    """Make a window's OpenGL current for a while."""
    glfw = start_glfw()
    _leave_egl()
    glfw.make_context_current(window)
    try:
        yield
    finally:
        glfw.make_context_current(None)


def try_window() -> str:
    """Open a hidden window and close it again; returns its OpenGL.

    Raises
    ------
    ResourceError
        If there is no display, GLFW or OpenGL 3.3.
    """
    window = create_window("fapengine", (64, 64), visible=False)
    with current(window):
        context = moderngl.create_context(require=REQUIRED)
        version = f"{context.info['GL_VERSION']} on {context.info['GL_RENDERER']}"
        context.release()
    start_glfw().destroy_window(window)
    return version


def _leave_egl() -> None:
    egl = _egl()
    if egl is not None:
        egl.eglReleaseThread()


@cache
def _egl() -> Any:
    name = ctypes.util.find_library("EGL")
    return ctypes.CDLL(name) if name else None


def _plain(error: BaseException) -> str:
    """Spell GLFW's error without its number and Python's quotes."""
    return re.sub(r"^\(\d+\) b?['\"]?(.*?)['\"]?$", r"\1", str(error))
