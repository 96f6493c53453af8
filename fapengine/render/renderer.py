"""FAP frames to pictures on the GPU.

Theory of operation
-------------------
The mesh is uploaded once (:mod:`fapengine.render.packing`, :mod:`fapengine.render.model`). A frame sends its channel
weights and five bone matrices; the vertex shader does the rest. :mod:`fapengine.render.canvas` holds what is drawn
into, softens edges and reads pictures back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from fapengine._late import Late
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.canvas import Backdrop, Canvas
from fapengine.render.context import Renderer, Resource
from fapengine.render.drawing import DEFAULT_DRAWING, Drawing, Picture
from fapengine.render.model import Model, Programs
from fapengine.render.packing import FrameUniforms, frame_uniforms, pack
from fapengine.render.reach import Reach, Rectangle

if TYPE_CHECKING:
    import moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


class FaceRenderer(Renderer):
    """One face in one picture. Use it as a context manager; it holds GPU memory.

    Stateful.

    Parameters
    ----------
    mesh : FaceMesh
        Head whose face it is.
    drawing : Drawing
        Size, camera, background, edges and light.
    context : moderngl.Context, optional
        By default a new one.

    Raises
    ------
    UsageError
        If the mesh has too many channels.
    ResourceError
        If there is no OpenGL.
    """

    def __init__(
        self, mesh: FaceMesh, drawing: Drawing = DEFAULT_DRAWING, *, context: moderngl.Context | None = None
    ) -> None:
        packed = pack(mesh)
        super().__init__(context)
        self.mesh, self._drawing, self._reach = mesh, drawing, Reach(mesh)
        with self._context:
            self._programs = Programs(self._context)
            self._model = Model(self._programs, packed)
            self._backdrop = Backdrop(self._programs, drawing)
            self._canvas = Canvas(self._programs, drawing)

    def _resources(self) -> Iterable[Resource]:
        return self._canvas, self._backdrop, self._model, self._programs

    @property
    def drawing(self) -> Drawing:
        """Way in which the next frame is drawn; it may be set between frames."""
        return self._drawing

    @drawing.setter
    def drawing(self, drawing: Drawing) -> None:
        before, self._drawing = self._drawing, drawing
        has_other_backdrop = drawing.background is not before.background or drawing.aspect != before.aspect
        if has_other_backdrop:
            with self._context:
                self._backdrop.release()
                self._backdrop = Backdrop(self._programs, drawing)
        if has_other_backdrop or not self._canvas.suits(drawing):
            with self._context:
                self._canvas.release()
                self._canvas = Canvas(self._programs, drawing)

    @property
    def is_lit_at_vertices(self) -> bool:
        """Whether :attr:`Drawing.shading` comes to light at vertices."""
        return self._model.is_lit_at_vertices(self._drawing.camera, self._drawing.drawn_size, self._drawing.shading)

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame.

        Parameters
        ----------
        faps : (68,) array_like, FAPU

        Returns
        -------
        (height, width, 3) uint8
            sRGB, top row first; 4 components without a background, colours multiplied with alpha.
        """
        return next(self.frames([faps]))

    def frames(self, faps: Iterable[ArrayLike]) -> Iterator[Picture]:
        """Draw frames in turn; see :meth:`draw`. The picture before is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw FAPs, (68,) FAPU, and leave the picture on the GPU: a texture, top row first, until the next frame."""
        return self._canvas.paint(partial(self._draw, faps))

    def _draw(self, faps: ArrayLike) -> Sequence[Rectangle] | None:
        drawing = self._drawing
        uniforms = frame_uniforms(self.mesh, faps)
        ground = drawing.camera, drawing.shading, drawing.wire
        is_there = self._canvas.begin(ground, partial(self._draw_ground, uniforms))
        self._model.draw(
            uniforms,
            drawing.camera,
            drawing.drawn_size,
            draw_behind=None if is_there else self._backdrop.draw,
            shading=drawing.shading,
            wire=drawing.wire,
            still=not is_there,
        )
        if not self._backdrop.is_smooth:
            return None
        return self._reach.rectangles(uniforms, drawing.camera, drawing.drawn_size)

    def _draw_ground(self, uniforms: FrameUniforms) -> None:
        """Draw what no FAP moves: shoulders and backdrop."""
        drawing = self._drawing
        self._model.draw(
            uniforms,
            drawing.camera,
            drawing.drawn_size,
            draw_behind=self._backdrop.draw,
            shading=drawing.shading,
            wire=drawing.wire,
            moving=False,
        )
