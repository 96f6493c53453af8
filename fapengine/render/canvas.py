"""What is drawn into: targets, what stands behind, softened edges, and reading back.

Theory of operation
-------------------
Pictures are drawn into a texture and their edges softened: one pass copies and marks edges in the depth buffer, the
next runs where the depth test lets it, on edges alone. They are then copied into one of two pixel buffers;
:meth:`Canvas.frames` reads a buffer only after the next frame has been given to the GPU, so neither waits for the
other. A picture may be drawn smaller than it is handed over; a last pass enlarges it.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal

import moderngl
import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.render.model import Programs
from fapengine.render.programs import PICTURE

Picture = NDArray[np.uint8]
Background = Literal["studio"] | tuple[int, int, int] | Picture | None
"""A lit wall; one colour, sRGB 0..255; a (H, W, 3) uint8 picture, cut to the shape needed; or nothing, for alpha."""

SIZES = (16, 4096)
SAMPLES = (0, 1, 2, 4, 8)
ALWAYS, IN_FRONT_OF, BEHIND = "1", ">", "<"
"""Depth functions: which depths that are there already let a new pixel pass."""
WALL = (0.30, 0.36, 0.42)
"""Linear RGB of the studio's wall."""


def check_size(size: tuple[int, int]) -> None:
    """Refuse a size that is out of range.

    Raises
    ------
    UsageError
        If a side is not in 16..4096 pixels.
    """
    if not all(SIZES[0] <= side <= SIZES[1] for side in size):
        raise UsageError(f"size: got {size[0]}x{size[1]}, expected sides of {SIZES[0]}..{SIZES[1]} pixels")


class Backdrop:
    """Stateful: what stands behind the head."""

    def __init__(self, programs: Programs, background: Background, aspect: float) -> None:
        self._texture: moderngl.Texture | None = None
        self.is_there = background is not None
        if background is None:
            return
        if isinstance(background, np.ndarray):
            shown = cut_to_aspect(checked_picture(background), aspect)
            self._program = programs.get("backdrop", (PICTURE,))
            self._texture = programs.context.texture(shown.shape[1::-1], 3, np.ascontiguousarray(shown), alignment=1)
            self._texture.repeat_x = self._texture.repeat_y = False
        else:
            self._program = programs.get("backdrop")
            self._wall, self._falloff = (WALL, 1.0) if background == "studio" else (flat_wall(background), 0.0)
        self._array = programs.context.vertex_array(self._program, [])

    def draw(self) -> None:
        """Fill what nothing has been drawn on, by depth."""
        if not self.is_there:
            return
        if self._texture is not None:
            self._texture.use(0)
            self._program["u_picture"] = 0
        else:
            self._program["u_wall"], self._program["u_falloff"] = self._wall, self._falloff
        self._array.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Give the GPU memory back."""
        if self.is_there:
            self._array.release()
        if self._texture is not None:
            self._texture.release()


def flat_wall(colour: Any) -> tuple[float, ...]:
    """Linear RGB of three sRGB numbers, 0..255.

    Raises
    ------
    UsageError
        If it is not three such numbers.
    """
    if isinstance(colour, str) or len(colour) != 3 or not all(0 <= part <= 255 for part in colour):
        raise UsageError(f"background: got {colour!r}, expected 'studio' or three numbers of 0..255")
    return tuple((float(part) / 255) ** 2 for part in colour)


def checked_picture(picture: NDArray[Any]) -> Picture:
    """Return a background picture as (H, W, 3) uint8.

    Raises
    ------
    UsageError
        If it is none.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or not picture.size:
        raise UsageError(f"background: got {picture.dtype} of shape {picture.shape}, expected (H, W, 3) uint8")
    return picture


def cut_to_aspect(picture: Picture, aspect: float) -> Picture:
    """Cut the middle of a picture out, so that width to height is ``aspect``."""
    height, width = picture.shape[:2]
    new_width, new_height = min(width, max(1, round(height * aspect))), min(height, max(1, round(width / aspect)))
    top, left = (height - new_height) // 2, (width - new_width) // 2
    return picture[top : top + new_height, left : left + new_width]


class Canvas:
    """Stateful: the targets of one picture size.

    Parameters
    ----------
    programs : Programs
    size : (int, int)
        Width and height that are handed over, in pixels, 16..4096.
    components : int
        3, or 4 with alpha.
    samples : int
        0 softens edges after drawing, 1 leaves them, 2, 4 or 8 multisamples.
    drawn : (int, int), optional
        Width and height that are drawn; by default ``size``.

    Raises
    ------
    UsageError
        If a size or ``samples`` is out of range.
    """

    def __init__(
        self,
        programs: Programs,
        size: tuple[int, int],
        *,
        components: int = 3,
        samples: int = 0,
        drawn: tuple[int, int] | None = None,
    ) -> None:
        check_size(size)
        if samples not in SAMPLES:
            raise UsageError(f"samples: got {samples}, expected one of {', '.join(map(str, SAMPLES))}")
        self.size, self.drawn, self._components = size, drawn or size, components
        self._context, self._softens = programs.context, samples == 0
        self._resources: list[Any] = []
        self._canvas = self._framebuffer(self.drawn, samples if samples > 1 else 0)
        self._small = self._framebuffer(self.drawn, 0)
        self._output = self._small if self.drawn == size else self._framebuffer(size, 0)
        self._passes = [self._pass(programs.get(name)) for name in ("edges", "smooth", "enlarge")]
        self._buffers = [self._context.buffer(reserve=size[0] * size[1] * components) for _ in range(2)]
        self._resources += self._buffers

    def _framebuffer(self, size: tuple[int, int], samples: int) -> moderngl.Framebuffer:
        context = self._context
        colour: moderngl.Renderbuffer | moderngl.Texture
        if samples:
            colour = context.renderbuffer(size, 4, samples=samples)
        else:
            colour = context.texture(size, 4)
            colour.repeat_x = colour.repeat_y = False
        depth = context.depth_renderbuffer(size, samples=samples)
        made = context.framebuffer([colour], depth)
        self._resources += [colour, depth, made]
        return made

    def _pass(self, program: moderngl.Program) -> tuple[moderngl.Program, moderngl.VertexArray]:
        array = self._context.vertex_array(program, [])
        self._resources.append(array)
        return program, array

    def release(self) -> None:
        """Give the GPU memory back."""
        while self._resources:
            self._resources.pop().release()

    def frames(self, draws: Iterable[Callable[[], None]]) -> Iterator[Picture]:
        """Pictures of what each of ``draws`` draws; the one before is read while the next is drawn."""
        waiting: moderngl.Buffer | None = None
        for number, draw in enumerate(draws):
            target = self._buffers[number % 2]
            with self._context:  # others may have drawn since
                self._paint(draw)
                self._output.read_into(target, components=self._components, alignment=1)
            if waiting is not None:
                yield self._picture(waiting)
            waiting = target
        if waiting is not None:
            yield self._picture(waiting)

    def paint(self, draw: Callable[[], None]) -> moderngl.Texture:
        """Draw one picture and leave it on the GPU: the texture, top row first, is good until the next one."""
        with self._context:
            self._paint(draw)
        painted = self._output.color_attachments[0]
        assert isinstance(painted, moderngl.Texture)
        return painted

    def _paint(self, draw: Callable[[], None]) -> None:
        """Draw one picture; the context is current and stays so (entering it twice would leave it)."""
        self._canvas.use()
        self._canvas.clear(0.0, 0.0, 0.0, 0.0)
        draw()
        self._finish()

    def _picture(self, buffer: moderngl.Buffer) -> Picture:
        width, height = self.size
        with self._context:
            data = buffer.read()
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width, self._components)

    def _finish(self) -> None:
        context = self._context
        picture = self._canvas.color_attachments[0]
        context.enable_only(moderngl.DEPTH_TEST)
        if self._softens:
            self._small.use()
            for (program, array), passes in zip(self._passes, (ALWAYS, IN_FRONT_OF), strict=False):
                context.depth_func = passes
                self._over(program, array, picture)
            context.depth_func = BEHIND
        else:
            context.copy_framebuffer(self._small, self._canvas)
        if self._output is not self._small:
            self._output.use()
            context.depth_func = ALWAYS
            self._over(*self._passes[2], self._small.color_attachments[0])
            context.depth_func = BEHIND

    def _over(self, program: moderngl.Program, array: moderngl.VertexArray, picture: Any) -> None:
        picture.use(0)
        program["u_picture"] = 0
        array.render(moderngl.TRIANGLES, vertices=3)
