"""A window that shows a face, on GLFW.

GLFW was chosen by ``design/window_toolkits.py``: all candidates show a frame in 0.2 to 0.3 ms, and its wheel is the
smallest (0.25 MB, the library inside, X11 and Wayland). The face is drawn by :class:`FaceRenderer` into a texture of
the window's own context and shown without being read back.

Drag the face to turn the camera, use the wheel to zoom. Keys: 1 to 4 choose a camera, R resets it, Escape or Q closes
the window. Other characters go to the caller. All other controls are on the page of ``fapengine serve``.

A thread has one current OpenGL context, and GLX and EGL do not know of each other. Where EGL's is current, X ends the
process that makes a window's context current; where a window's is current, EGL calls fail. So a window's context is
current only within :func:`current`, which releases EGL's first.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import re
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._signals import signals_kept
from fapengine.errors import ResourceError, UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import Camera, preset
from fapengine.render.context import REQUIRED, moderngl
from fapengine.render.drawing import MAX_SIDE_PX, MIN_SIDE_PX, RenderOptions
from fapengine.render.live import LevelOfDetail, LiveRenderer, Quality
from fapengine.render.programs import stage_source
from fapengine.render.renderer import FaceRenderer

CAMERAS = ("front", "three-quarter", "profile", "mouth")
"""Cameras on the keys 1 to 4."""
OVERLAY = (("backdrop.vert",), ("overlay.frag",))
"""Stages of the program that shows a texture."""
TURN_DEG = 0.4
"""Turn of the camera, degrees for each point that the pointer moves."""
ZOOM = 1.1
MIN_SIZE_PT = (200, 160)
"""Width and height of the smallest window, in points."""
RESIZING_S = 0.15
"""Time after a change of the window's size during which the face is still drawn in the old size."""
WINDOW_DRAWING = RenderOptions(size=(820, 560))
BORDER = (0.12, 0.13, 0.15)
RATE_FRAMES = 90
"""Number of frames over which the rate is measured."""


class FaceWindow:
    """A window with a face. Use it as a context manager, or close it.

    Stateful.

    Parameters
    ----------
    mesh : FaceMesh
    drawing : RenderOptions
        The size is the window's at first, in points.
    coarser : sequence of FaceMesh
        The same with fewer vertices, for a rate that could not be kept otherwise; or functions that load them then.
    title : str
    vsync : bool
        Wait for the display when a frame is shown.
    hold_hz : float, optional
        Reduce quality where this rate could not be kept otherwise; see :attr:`quality`.

    Raises
    ------
    ResourceError
        If there is no display, GLFW or OpenGL 3.3; the message says how to fix it.
    UsageError
        If the size is too small.
    """

    def __init__(
        self,
        mesh: FaceMesh,
        drawing: RenderOptions = WINDOW_DRAWING,
        *,
        coarser: Sequence[LevelOfDetail] = (),
        title: str = "fapengine",
        vsync: bool = True,
        hold_hz: float | None = None,
    ) -> None:
        size = drawing.size
        if size[0] < MIN_SIZE_PT[0] or size[1] < MIN_SIZE_PT[1]:
            raise UsageError(f"size: got {size[0]}x{size[1]}, expected at least {MIN_SIZE_PT[0]}x{MIN_SIZE_PT[1]}")
        self._mesh, self._meshes = mesh, (mesh, *coarser)
        self._drawing = drawing
        self.camera = drawing.camera
        self._pressed: list[str] = []
        self._dragged_from: tuple[float, float] | None = None
        self._shown_at: deque[float] = deque(maxlen=RATE_FRAMES)
        self._busy_s: deque[float] = deque(maxlen=RATE_FRAMES)
        self._hold_hz = hold_hz
        self._renderer: FaceRenderer | LiveRenderer | None = None
        self._wanted = ((0, 0), 0.0)
        """Size of the face in pixels, and since when."""
        self._glfw = start_glfw()
        self._window = self._open(title, size)
        with current(self._window):
            self._glfw.swap_interval(int(vsync))
            self._context = moderngl.create_context(require=REQUIRED)
            vertex, fragment = (stage_source(files) for files in OVERLAY)
            with signals_kept():
                self._program = self._context.program(vertex_shader=vertex, fragment_shader=fragment)
                self._quad = self._context.vertex_array(self._program, [])

    def __enter__(self) -> FaceWindow:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """False as soon as it is closed."""
        return self._window is not None and not self._glfw.window_should_close(self._window)

    @property
    def rate_hz(self) -> float:
        """Frames per second, over the last :data:`RATE_FRAMES`."""
        shown = self._shown_at
        return (len(shown) - 1) / (shown[-1] - shown[0]) if len(shown) > 1 else 0.0

    @property
    def busy_s(self) -> float:
        """Median time to draw a frame, over the last :data:`RATE_FRAMES`; waiting for the display does not count."""
        return float(np.median(self._busy_s)) if self._busy_s else 0.0

    @property
    def quality(self) -> Quality:
        """How the next frame will be drawn."""
        return self._renderer.quality if isinstance(self._renderer, LiveRenderer) else Quality()

    def show(self, faps: ArrayLike) -> list[str]:
        """Draw a frame, (68,) FAPU, and show it; returns the characters typed since the last one, in lower case.

        Raises
        ------
        UsageError
            If the window was closed by :meth:`close`.
        """
        if self._window is None:
            raise UsageError("window: is closed")
        begun = time.perf_counter()
        with current(self._window):
            self._draw(faps)
            self._context.finish()
            self._busy_s.append(time.perf_counter() - begun)
            self._glfw.swap_buffers(self._window)
        self._shown_at.append(time.perf_counter())
        self._glfw.poll_events()
        pressed, self._pressed = self._pressed, []
        return pressed

    def picture(self) -> NDArray[np.uint8]:
        """Return the last frame that was shown: (height, width, 3) uint8, sRGB, top row first."""
        width, height = self._pixels()
        with current(self._window):
            data = self._context.screen.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1].copy()

    def title(self, text: str) -> None:
        """Set the window's title."""
        self._glfw.set_window_title(self._window, text)

    def close(self) -> None:
        """Close it and free the GPU's memory; to close it again does nothing."""
        if self._window is None:
            return
        with current(self._window):
            if self._renderer is not None:
                self._renderer.release()
            self._context.release()
        self._glfw.destroy_window(self._window)
        self._window = None

    def _open(self, title: str, size: tuple[int, int]) -> Any:
        glfw = self._glfw
        window = create_window(title, size)
        glfw.set_window_size_limits(window, *MIN_SIZE_PT, glfw.DONT_CARE, glfw.DONT_CARE)
        glfw.set_key_callback(window, self._on_key)
        glfw.set_char_callback(window, self._on_character)
        glfw.set_mouse_button_callback(window, self._on_button)
        glfw.set_cursor_pos_callback(window, self._on_pointer)
        glfw.set_scroll_callback(window, self._on_wheel)
        return window

    def _pixels(self) -> tuple[int, int]:
        width, height = self._glfw.get_framebuffer_size(self._window)
        return max(int(width), 1), max(int(height), 1)

    def _draw(self, faps: ArrayLike) -> None:
        width, height = self._pixels()
        limits = MIN_SIDE_PX, MAX_SIDE_PX
        renderer = self._renderer_of((int(np.clip(width, *limits)), int(np.clip(height, *limits))))
        renderer.drawing = replace(renderer.drawing, camera=self.camera)
        face = renderer.paint(faps)
        self._context.screen.use()
        self._context.disable(moderngl.DEPTH_TEST | moderngl.BLEND | moderngl.CULL_FACE)
        self._context.viewport = _fitted(renderer.drawing.size, (width, height))
        if self._context.viewport[2:] != (width, height):
            self._context.clear(*BORDER)
        face.use(0)
        self._program["u_picture"] = 0
        self._quad.render(moderngl.TRIANGLES, vertices=3)

    def _renderer_of(self, size: tuple[int, int]) -> FaceRenderer | LiveRenderer:
        if size != self._wanted[0]:
            self._wanted = (size, time.perf_counter())
        is_resizing = time.perf_counter() - self._wanted[1] < RESIZING_S
        if self._renderer is None or (self._renderer.drawing.size != size and not is_resizing):
            if self._renderer is not None:
                self._renderer.release()
            drawing, context = replace(self._drawing, size=size, camera=self.camera), self._context
            if self._hold_hz is None:
                self._renderer = FaceRenderer(self._mesh, drawing, context=context)
            else:
                self._renderer = LiveRenderer(self._meshes, drawing, rate_hz=self._hold_hz, context=context)
        return self._renderer

    def _on_character(self, window: Any, code: int) -> None:
        """Handle a character by the keyboard's layout: keys differ between layouts."""
        character = chr(code).lower()
        cameras = dict(zip("123456789", CAMERAS, strict=False)) | {"r": CAMERAS[0]}
        if character in cameras:
            self.camera = preset(cameras[character])
        elif character == "q":
            self._glfw.set_window_should_close(window, True)
        else:
            self._pressed.append(character)

    def _on_key(self, window: Any, key: int, _: int, action: int, __: int) -> None:
        glfw = self._glfw
        if action == glfw.RELEASE:
            return
        if key == glfw.KEY_ESCAPE:
            glfw.set_window_should_close(window, True)
        turns = {glfw.KEY_LEFT: (-5, 0), glfw.KEY_RIGHT: (5, 0), glfw.KEY_UP: (0, 5), glfw.KEY_DOWN: (0, -5)}
        if key in turns:
            self.camera = _turned(self.camera, *turns[key])

    def _on_button(self, window: Any, button: int, action: int, _: int) -> None:
        if button == self._glfw.MOUSE_BUTTON_LEFT:
            is_pressed = action != self._glfw.RELEASE
            self._dragged_from = self._glfw.get_cursor_pos(window) if is_pressed else None

    def _on_pointer(self, _: Any, x: float, y: float) -> None:
        if self._dragged_from is not None:
            across, down = x - self._dragged_from[0], y - self._dragged_from[1]
            self._dragged_from = (x, y)
            self.camera = _turned(self.camera, -TURN_DEG * across, TURN_DEG * down)

    def _on_wheel(self, _: Any, __: float, down: float) -> None:
        field = self.camera.field_deg * ZOOM ** (-down)
        self.camera = replace(self.camera, field_deg=min(max(field, 4.0), 45.0))


def _fitted(size: tuple[int, int], room: tuple[int, int]) -> tuple[int, int, int, int]:
    """Centre an image in the window and keep its proportions: x, y, width, height."""
    share = min(room[0] / size[0], room[1] / size[1])
    width, height = round(size[0] * share), round(size[1] * share)
    return (room[0] - width) // 2, (room[1] - height) // 2, width, height


def _turned(camera: Camera, yaw_deg: float, pitch_deg: float) -> Camera:
    yaw = (camera.yaw_deg + yaw_deg + 180.0) % 360.0 - 180.0
    return replace(camera, yaw_deg=yaw, pitch_deg=min(max(camera.pitch_deg + pitch_deg, -75.0), 75.0))


def start_glfw() -> Any:
    """Initialize GLFW for the rest of the process.

    Raises
    ------
    ResourceError
        If it is not installed, or there is no display.
    """
    try:
        import glfw
    except ImportError as error:
        raise ResourceError(f'window: {error}; install it with: pip install "fapengine[window]"') from error
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
    """Make a window's OpenGL context current."""
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


@cache
def _egl() -> Any:
    name = ctypes.util.find_library("EGL")
    return ctypes.CDLL(name) if name else None


def _leave_egl() -> None:
    if _egl() is not None:
        _egl().eglReleaseThread()


def _plain(error: BaseException) -> str:
    """Format GLFW's error without its number and Python's quotes."""
    return re.sub(r"^\(\d+\) b?['\"]?(.*?)['\"]?$", r"\1", str(error))
