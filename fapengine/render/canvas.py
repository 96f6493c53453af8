"""Render targets, the background, smoothed edges, and reading back.

Theory of operation
-------------------
Images are drawn into a texture and their edges smoothed: one pass copies and marks edges in the depth buffer, the next
runs only where the depth test lets it, on edges; both only in the parts that can have edges. They are then copied into
one of two pixel buffers; :meth:`Canvas.frames` reads a buffer only after the next frame has been submitted to the GPU,
so neither waits for the other. An image may be rendered smaller than its final size; then a pass enlarges it. For
encoders, a last pass converts it to I420, half as many bytes to read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import prod
from typing import Any, TypeAlias

import numpy as np

from fapengine._signals import signals_kept
from fapengine.render.context import Programs, moderngl
from fapengine.render.drawing import Picture, Pixels, RenderOptions
from fapengine.render.programs import CHROMA, PICTURE

Rectangle: TypeAlias = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""
Draw: TypeAlias = Callable[[], Sequence[Rectangle] | None]
"""Begins and draws one image, and returns the parts that may have edges; None: anywhere."""
ALWAYS, IN_FRONT_OF, BEHIND = "1", ">", "<"
"""Depth functions: the existing depths at which a new pixel is drawn."""
WALL = (0.20, 0.245, 0.29)
"""Linear RGB of the studio wall."""


class Backdrop:
    """The background behind the head.

    Stateful.
    """

    def __init__(self, programs: Programs, drawing: RenderOptions) -> None:
        background = drawing.background
        self._texture: moderngl.Texture | None = None
        self._array: moderngl.VertexArray | None = None
        """None for a transparent background."""
        self.is_smooth = not isinstance(background, np.ndarray)
        """False: it may have edges of its own."""
        if drawing.components == 4:
            return
        if isinstance(background, np.ndarray):
            shown = cut_to_aspect(background, drawing.aspect)
            self._program = programs.get("backdrop", (PICTURE,))
            self._texture = programs.context.texture(shown.shape[1::-1], 3, np.ascontiguousarray(shown), alignment=1)
            self._texture.repeat_x = self._texture.repeat_y = False
        else:
            self._program = programs.get("backdrop")
            self._wall, self._falloff = WALL, 1.0
            if isinstance(background, tuple):
                red, green, blue = ((part / 255) ** 2 for part in background)
                self._wall, self._falloff = (red, green, blue), 0.0
        with signals_kept():
            self._array = programs.context.vertex_array(self._program, [])

    def draw(self) -> None:
        """Fill every pixel without content, by depth."""
        if self._array is None:
            return
        if self._texture is not None:
            self._texture.use(0)
            self._program["u_picture"] = 0
        else:
            self._program["u_wall"], self._program["u_falloff"] = self._wall, self._falloff
        self._array.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        if self._array is not None:
            self._array.release()
        if self._texture is not None:
            self._texture.release()


def cut_to_aspect(picture: Picture, aspect: float) -> Picture:
    """Crop the middle of an image, (H, W, 3), to an aspect ratio."""
    height, width = picture.shape[:2]
    new_width, new_height = min(width, max(1, round(height * aspect))), min(height, max(1, round(width / aspect)))
    top, left = (height - new_height) // 2, (width - new_width) // 2
    return picture[top : top + new_height, left : left + new_width]


def _empty(target: moderngl.Framebuffer) -> None:
    target.use()
    target.clear(0.0, 0.0, 0.0, 0.0)


class Canvas:
    """Render targets for one image size.

    Stateful.
    """

    def __init__(self, programs: Programs, drawing: RenderOptions) -> None:
        self.size, self.drawn, self._components = drawing.size, drawing.drawn_size, drawing.components
        self._programs, self._context, self._samples = programs, programs.context, drawing.samples
        self._resources: list[Any] = []
        self._canvas = self._framebuffer(self.drawn, self._samples if self._samples > 1 else 0)
        self._small = self._framebuffer(self.drawn, 0)
        self._output = self._small if self.drawn == self.size else self._framebuffer(self.size, 0)
        self._passes = [self._pass(programs.get(name)) for name in ("edges", "smooth", "enlarge")]
        self._buffers = [self._context.buffer(reserve=self.size[0] * self.size[1] * self._components) for _ in range(2)]
        self._resources += self._buffers
        self._planes: moderngl.Framebuffer | None = None
        self._ground: moderngl.Framebuffer | None = None
        self._ground_is: object = None

    def begin(self, ground: object = None, draw: Callable[[], None] | None = None) -> bool:
        """Begin an image, empty or with the content that does not change.

        Parameters
        ----------
        ground : object, optional
            Everything that the ground depends on: while it is equal to the previous one, ``draw`` is not called again.
        draw : callable, optional
            Draws the ground.

        Returns
        -------
        bool
            Whether the ground is drawn; multisampled images begin empty.
        """
        if draw is None or self._samples > 1:
            _empty(self._canvas)
            return False
        if self._ground is None:
            self._ground = self._framebuffer(self.drawn, 0)
        if ground != self._ground_is:
            _empty(self._ground)
            draw()
            self._ground_is = ground
        self._context.copy_framebuffer(self._canvas, self._ground)  # and its depth
        self._canvas.use()
        return True

    def suits(self, drawing: RenderOptions) -> bool:
        """Whether images of a drawing can be made on this canvas."""
        mine = self.size, self.drawn, self._samples, self._components
        return mine == (drawing.size, drawing.drawn_size, drawing.samples, drawing.components)

    def _framebuffer(self, size: tuple[int, int], samples: int) -> moderngl.Framebuffer:
        colour: Any
        if samples:
            colour = self._context.renderbuffer(size, 4, samples=samples)
        else:
            colour = self._context.texture(size, 4)
            colour.repeat_x = colour.repeat_y = False
        depth = self._context.depth_renderbuffer(size, samples=samples)
        made = self._context.framebuffer([colour], depth)
        self._resources += [colour, depth, made]
        return made

    def _pass(self, program: moderngl.Program) -> tuple[moderngl.Program, moderngl.VertexArray]:
        with signals_kept():
            array = self._context.vertex_array(program, [])
        self._resources.append(array)
        return program, array

    def release(self) -> None:
        """Free the GPU memory."""
        while self._resources:
            self._resources.pop().release()

    def frames(self, draws: Iterable[Draw], pixels: Pixels = "rgb") -> Iterator[Picture]:
        """Yield the images that ``draws`` draw, (H, W, C) or (H * 3 // 2, W); each is read while the next is drawn."""
        waiting: moderngl.Buffer | None = None
        for number, draw in enumerate(draws):
            target = self._buffers[number % 2]
            with self._context:  # others may have drawn since; to enter it twice would leave it
                self._finish(draw())
                if pixels == "i420":
                    self._converted().read_into(target, components=1, alignment=1)
                else:
                    self._output.read_into(target, components=self._components, alignment=1)
            if waiting is not None:
                yield self._picture(waiting, pixels)
            waiting = target
        if waiting is not None:
            yield self._picture(waiting, pixels)

    def paint(self, draw: Draw) -> moderngl.Texture:
        """Draw one image into a texture on the GPU, top row first, valid until the next one."""
        with self._context:
            self._finish(draw())
        painted = self._output.color_attachments[0]
        assert isinstance(painted, moderngl.Texture)
        return painted

    def _picture(self, buffer: moderngl.Buffer, pixels: Pixels) -> Picture:
        width, height = self.size
        shape = (height * 3 // 2, width) if pixels == "i420" else (height, width, self._components)
        with self._context:
            data = buffer.read(prod(shape))
        return np.frombuffer(data, dtype=np.uint8).reshape(shape)

    def _converted(self) -> moderngl.Framebuffer:
        """Return the image as I420 in one channel, (H * 3 // 2, W)."""
        if self._planes is None:
            width, height = self.size
            texture = self._context.texture((width, height * 3 // 2), 1)
            self._planes = self._context.framebuffer([texture])
            self._resources += [texture, self._planes]
            self._passes += [self._pass(self._programs.get("planes", defined)) for defined in ((), (CHROMA,))]
        width, height = self.size
        self._planes.use()
        for each, part in zip(self._passes[-2:], ((0, 0, width, height), (0, height, width, height // 2)), strict=True):
            self._planes.scissor = part
            self._over(*each, self._output.color_attachments[0])
        self._planes.scissor = None  # type: ignore[assignment]  # all of it; it would clip later copies, too
        return self._planes

    def _finish(self, parts: Sequence[Rectangle] | None) -> None:
        context = self._context
        picture = self._canvas.color_attachments[0]
        if self._samples == 0 and parts is not None:
            context.copy_framebuffer(self._small, self._canvas)
        context.enable_only(moderngl.DEPTH_TEST)
        if self._samples == 0:
            self._small.use()
            for part in [(0, 0, *self.drawn)] if parts is None else parts:
                self._small.scissor = part
                for (program, array), passes in zip(self._passes, (ALWAYS, IN_FRONT_OF), strict=False):
                    context.depth_func = passes
                    self._over(program, array, picture)
            self._small.scissor = None  # type: ignore[assignment]  # all of it
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
