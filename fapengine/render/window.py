"""Edge: a window with a face and its controls, on GLFW.

GLFW was chosen by ``design/window_toolkits.py``: all candidates show a frame in 0.2 to 0.3 ms, and its wheel is the
smallest (0.25 MB, the library inside, X11 and Wayland). The face is drawn by :class:`FaceRenderer` into a texture of
the window's own context, shown without being read back, and the panel beside it as a second texture.

Pointer: pull the face to turn the camera, wheel to come nearer. Keys: 1 to 4 cameras, R the first one again, Tab hides
the panel, Enter types, Escape or Q closes; the caller adds its own.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._late import Late
from fapengine._signals import signals_kept
from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.budget import Quality
from fapengine.render.camera import PRESETS, Camera, preset
from fapengine.render.context import REQUIRED
from fapengine.render.desktop import create_window, current, start_glfw
from fapengine.render.drawing import MAX_SIDE_PX, MIN_SIDE_PX, Drawing
from fapengine.render.live import LevelOfDetail, LiveRenderer
from fapengine.render.panel import WIDTH, Event, Panel, Pressed
from fapengine.render.programs import stage_source
from fapengine.render.renderer import FaceRenderer

if TYPE_CHECKING:
    import moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


CAMERAS = ("front", "three-quarter", "profile", "mouth")
"""Cameras that have buttons and the keys 1 to 4."""
OVERLAY = (("backdrop.vert",), ("overlay.frag",))
"""Stages of the program that shows a texture."""
OVERLAY_UNIFORMS = ("u_picture",)
TURN_DEG = 0.4
"""Turn of the camera, degrees for each point that the pointer moves."""
ZOOM = 1.1
MIN_SIZE_PT = (200, 160)
"""Width and height of the smallest window, in points."""
RESIZING_S = 0.15
"""Time after a change of the window's size in which it counts as being resized: the face is drawn in the old size."""
WINDOW_DRAWING = Drawing(size=(820, 560))
BORDER = (0.12, 0.13, 0.15)
RATE_FRAMES = 90
"""Number of frames over which the rate is measured."""


class FaceWindow:
    """A window with a face. Use it as a context manager, or close it.

    Stateful.

    Parameters
    ----------
    mesh : FaceMesh
        Head whose face it is.
    drawing : Drawing
        Way in which the face is drawn; the size is the window's at first, in points, panel included.
    coarser : sequence of FaceMesh
        The same with fewer vertices, for a rate that could not be held otherwise; or functions that load them then.
    title : str
    panel : Panel, optional
        The controls; cameras are added to its buttons.
    keys : mapping of str to str, optional
        A character, in lower case, to the button that it stands for.
    vsync : bool
        Wait for the display when a frame is shown.
    hold_hz : float, optional
        Give quality up where this rate could not be held otherwise; :attr:`quality` tells what.

    Raises
    ------
    ResourceError
        If there is no display, GLFW or OpenGL 3.3; the message says how to mend it.
    UsageError
        If the size is too small.
    """

    def __init__(
        self,
        mesh: FaceMesh,
        drawing: Drawing = WINDOW_DRAWING,
        *,
        coarser: Sequence[LevelOfDetail] = (),
        title: str = "fapengine",
        panel: Panel | None = None,
        keys: Mapping[str, str] | None = None,
        vsync: bool = True,
        hold_hz: float | None = None,
    ) -> None:
        size = drawing.size
        if size[0] < MIN_SIZE_PT[0] or size[1] < MIN_SIZE_PT[1]:
            raise UsageError(f"size: got {size[0]}x{size[1]}, expected at least {MIN_SIZE_PT[0]}x{MIN_SIZE_PT[1]}")
        self._mesh, self._coarser = mesh, tuple(coarser)
        self._drawing, self._keys = drawing, dict(keys or {})
        self.camera = drawing.camera
        self.panel = panel or Panel()
        self.panel.buttons = (*map(_label, CAMERAS), *self.panel.buttons)
        self.panel.lit |= {_label(name) for name in CAMERAS if PRESETS[name] == drawing.camera}
        self._shows_panel = True
        self._events: list[Event] = []
        self._dragged_from: tuple[float, float] | None = None
        self._shown_at: deque[float] = deque(maxlen=RATE_FRAMES)
        self._busy_s: deque[float] = deque(maxlen=RATE_FRAMES)
        self._hold_hz = hold_hz
        self._renderer: FaceRenderer | LiveRenderer | None = None
        self._wanted = ((0, 0), 0.0)
        """Size of the face in pixels, and since when."""
        self._panel_texture: moderngl.Texture | None = None
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # What the caller uses ------------------------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        """False as soon as somebody has closed it."""
        return self._window is not None and not self._glfw.window_should_close(self._window)

    @property
    def rate_hz(self) -> float:
        """Frames a second, of late."""
        shown = self._shown_at
        return (len(shown) - 1) / (shown[-1] - shown[0]) if len(shown) > 1 else 0.0

    @property
    def busy_s(self) -> float:
        """Time that a frame takes to draw, in the middle of late ones; waiting for the display does not count."""
        return float(np.median(self._busy_s)) if self._busy_s else 0.0

    @property
    def quality(self) -> Quality:
        """How the next frame will be drawn."""
        return self._renderer.quality if isinstance(self._renderer, LiveRenderer) else Quality()

    def show(self, faps: ArrayLike) -> list[Event]:
        """Draw a frame and show it.

        Parameters
        ----------
        faps : (68,) array_like, FAPU

        Returns
        -------
        list of Event
            What was done to the controls since the last frame.

        Raises
        ------
        UsageError
            If the window was closed by :meth:`close`.
        """
        if self._window is None:
            raise UsageError("window: got a frame, but it is closed")
        begun = time.perf_counter()
        with current(self._window):
            self._draw(faps)
            self._context.finish()
            self._busy_s.append(time.perf_counter() - begun)
            self._glfw.swap_buffers(self._window)
        self._shown_at.append(time.perf_counter())
        self._glfw.poll_events()
        events, self._events = self._events, []
        return events

    def picture(self) -> NDArray[np.uint8]:
        """(height, width, 3) uint8, sRGB, top row first: what the window has shown last."""
        width, height = self._pixels()
        with current(self._window):
            data = self._context.screen.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1].copy()

    def look(self, camera: str) -> None:
        """Go to one of the cameras.

        Raises
        ------
        UsageError
            If there is none.
        """
        self._turn(preset(camera))
        self.panel.lit |= {_label(camera)}

    @property
    def has_room_for_panel(self) -> bool:
        """Whether it is wide enough to show its controls."""
        return self._points()[0] >= WIDTH + MIN_SIZE_PT[1]

    def title(self, text: str) -> None:
        """Name the window."""
        self._glfw.set_window_title(self._window, text)

    def hide_panel(self) -> None:
        """Show the face alone; Tab brings the panel back."""
        self._shows_panel = False

    def close(self) -> None:
        """Close it and give the GPU's memory back; once more does nothing."""
        if self._window is None:
            return
        with current(self._window):
            if self._renderer is not None:
                self._renderer.release()
            self._context.release()
        self._glfw.destroy_window(self._window)
        self._window = None

    # Opening -------------------------------------------------------------------------------------------------------

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

    # Drawing -------------------------------------------------------------------------------------------------------

    def _pixels(self) -> tuple[int, int]:
        width, height = self._glfw.get_framebuffer_size(self._window)
        return max(int(width), 1), max(int(height), 1)

    def _points(self) -> tuple[int, int]:
        width, height = self._glfw.get_window_size(self._window)
        return max(int(width), 1), max(int(height), 1)

    def _panel_width(self) -> int:
        """Points; a narrow window has none."""
        return WIDTH if self._shows_panel and self.has_room_for_panel else 0

    def _draw(self, faps: ArrayLike) -> None:
        width, height = self._pixels()
        scale = width / self._points()[0]
        panel = round(self._panel_width() * scale)
        size = tuple(min(max(side, MIN_SIDE_PX), MAX_SIDE_PX) for side in (width - panel, height))
        renderer = self._renderer_of((size[0], size[1]))
        renderer.drawing = replace(renderer.drawing, camera=self.camera)
        face = renderer.paint(faps)
        self._context.screen.use()
        self._context.disable(moderngl.DEPTH_TEST | moderngl.BLEND | moderngl.CULL_FACE)
        room = _fitted(renderer.drawing.size, (width - panel, height))
        if room[2:] != (width - panel, height):
            self._context.clear(*BORDER)
        self._show(face, room)
        if panel:
            self._show(self._panel_of(scale), (width - panel, 0, panel, height))

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
                self._renderer = LiveRenderer(
                    (self._mesh, *self._coarser), drawing, rate_hz=self._hold_hz, context=context
                )
        return self._renderer

    def _panel_of(self, scale: float) -> moderngl.Texture:
        self.panel.height = self._points()[1]
        picture, is_new = self.panel.picture(scale)
        size = (picture.shape[1], picture.shape[0])
        if self._panel_texture is None or self._panel_texture.size != size:
            if self._panel_texture is not None:
                self._panel_texture.release()
            self._panel_texture = self._context.texture(size, 4, picture.tobytes())
        elif is_new:
            self._panel_texture.write(picture.tobytes())
        return self._panel_texture

    def _show(self, texture: moderngl.Texture, viewport: tuple[int, int, int, int]) -> None:
        self._context.viewport = viewport
        texture.use(0)
        self._program["u_picture"] = 0
        self._quad.render(moderngl.TRIANGLES, vertices=3)

    # What comes in -------------------------------------------------------------------------------------------------

    def _turn(self, camera: Camera) -> None:
        self.camera = camera
        self.panel.lit -= set(map(_label, CAMERAS))

    def _do(self, events: list[Event]) -> None:
        names = {_label(name): name for name in CAMERAS}
        for event in events:
            if isinstance(event, Pressed) and event.key in names:
                self.look(names[event.key])
            else:
                self._events.append(event)

    def _on_character(self, window: Any, code: int) -> None:
        """Take a letter, as the keyboard's layout has it: Q is elsewhere on a French one."""
        cameras = dict(zip("123456789", CAMERAS, strict=False))
        if self.panel.is_typing:
            self.panel.type(chr(code))
            return
        character = chr(code).lower()
        if character in self._keys:
            self._events.append(Pressed(self._keys[character]))
        elif character in cameras:
            self.look(cameras[character])
        elif character == "r":
            self.look(CAMERAS[0])
        elif character == "q":
            self._glfw.set_window_should_close(window, True)

    def _on_key(self, window: Any, key: int, _: int, action: int, __: int) -> None:
        glfw = self._glfw
        if action == glfw.RELEASE:
            return
        if self.panel.is_typing:
            if key in (glfw.KEY_ENTER, glfw.KEY_KP_ENTER):
                self._do(self.panel.enter())
            elif key == glfw.KEY_BACKSPACE:
                self.panel.erase()
            elif key == glfw.KEY_ESCAPE:
                self.panel.is_typing = False
        elif key == glfw.KEY_ESCAPE:
            glfw.set_window_should_close(window, True)
        elif key == glfw.KEY_TAB:
            self._shows_panel = not self._shows_panel
        elif key in (glfw.KEY_ENTER, glfw.KEY_KP_ENTER):
            self.panel.is_typing = self.panel.has_text and self._panel_width() > 0
        elif key in (glfw.KEY_LEFT, glfw.KEY_RIGHT, glfw.KEY_UP, glfw.KEY_DOWN):
            yaw = {glfw.KEY_LEFT: -1, glfw.KEY_RIGHT: 1}.get(key, 0)
            pitch = {glfw.KEY_UP: 1, glfw.KEY_DOWN: -1}.get(key, 0)
            self._turn(_turned(self.camera, 5.0 * yaw, 5.0 * pitch))

    def _on_button(self, window: Any, button: int, action: int, _: int) -> None:
        if button != self._glfw.MOUSE_BUTTON_LEFT:
            return
        x, y = self._glfw.get_cursor_pos(window)
        self._dragged_from = None
        if action == self._glfw.RELEASE:
            self.panel.release()
        elif x >= self._points()[0] - self._panel_width():
            self._do(self.panel.press(self._in_panel(x), y))
        else:
            self.panel.is_typing = False
            self._dragged_from = (x, y)

    def _on_pointer(self, _: Any, x: float, y: float) -> None:
        self._do(self.panel.drag(self._in_panel(x)))
        if self._dragged_from is not None:
            across, down = x - self._dragged_from[0], y - self._dragged_from[1]
            self._dragged_from = (x, y)
            self._turn(_turned(self.camera, -TURN_DEG * across, TURN_DEG * down))

    def _on_wheel(self, _: Any, __: float, down: float) -> None:
        field = self.camera.field_deg * ZOOM ** (-down)
        self._turn(replace(self.camera, field_deg=min(max(field, 4.0), 45.0)))

    def _in_panel(self, x: float) -> float:
        return x - (self._points()[0] - self._panel_width())


def _fitted(size: tuple[int, int], room: tuple[int, int]) -> tuple[int, int, int, int]:
    """Rectangle of a picture in its room, centred, with its proportions kept: x, y, width, height."""
    share = min(room[0] / size[0], room[1] / size[1])
    width, height = round(size[0] * share), round(size[1] * share)
    return (room[0] - width) // 2, (room[1] - height) // 2, width, height


def _turned(camera: Camera, yaw_deg: float, pitch_deg: float) -> Camera:
    yaw = (camera.yaw_deg + yaw_deg + 180.0) % 360.0 - 180.0
    return replace(camera, yaw_deg=yaw, pitch_deg=min(max(camera.pitch_deg + pitch_deg, -75.0), 75.0))


def _label(camera: str) -> str:
    return camera.capitalize()
