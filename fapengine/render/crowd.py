"""Several faces in one picture: one context, one target, one reading back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fapengine._late import Late
from fapengine.errors import UsageError
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import Camera
from fapengine.render.canvas import Backdrop, Canvas
from fapengine.render.context import Renderer, Resource
from fapengine.render.drawing import DEFAULT_DRAWING, Drawing, Picture
from fapengine.render.model import Model, Programs
from fapengine.render.packing import FrameUniforms, frame_uniforms, pack, pose_uniforms

if TYPE_CHECKING:
    import moderngl
else:
    moderngl = Late("moderngl", "moderngl", "OpenGL")


class CrowdRenderer(Renderer):
    """Faces side by side in tiles, row by row. Use it as a context manager; it holds GPU memory.

    Stateful: ``cameras`` may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        Head of each tile; a mesh that comes again is uploaded once.
    drawing : Drawing
        Way in which each tile is drawn; its size is that of a tile, and it is drawn at scale 1.
    columns : int, optional
        By default as many as make the picture about as wide as high.
    cameras : sequence of Camera, optional
        Camera of each tile; by default that of the drawing.
    context : moderngl.Context, optional
        By default a new one.

    Raises
    ------
    UsageError
        If there is no mesh, not one camera a tile, or the picture's sides are not in 16..4096 pixels.
    ResourceError
        If there is no OpenGL.
    """

    def __init__(
        self,
        meshes: Sequence[FaceMesh],
        drawing: Drawing = DEFAULT_DRAWING,
        *,
        columns: int | None = None,
        cameras: Sequence[Camera] | None = None,
        context: moderngl.Context | None = None,
    ) -> None:
        if not meshes:
            raise UsageError("crowd: got no mesh, expected one or more")
        self.cameras = [drawing.camera] * len(meshes) if cameras is None else list(cameras)
        if len(self.cameras) != len(meshes):
            raise UsageError(f"crowd: got {len(self.cameras)} cameras, expected {len(meshes)}")
        columns = columns or square_columns(len(meshes), drawing.size)
        if not 1 <= columns <= len(meshes):
            raise UsageError(f"crowd: got {columns} columns, expected 1 to {len(meshes)}")
        rows = -(-len(meshes) // columns)
        self.drawing, self.columns, self.meshes = drawing, columns, tuple(meshes)
        whole = replace(drawing, size=(columns * drawing.size[0], rows * drawing.size[1]), scale=1.0)
        self.size = whole.size
        packed = {id(mesh): pack(mesh) for mesh in self.meshes}
        super().__init__(context)
        with self._context:
            self._programs = Programs(self._context)
            self._models = {name: Model(self._programs, each) for name, each in packed.items()}
            self._backdrop = Backdrop(self._programs, drawing)
            self._canvas = Canvas(self._programs, whole)

    def _resources(self) -> Iterable[Resource]:
        return *self._models.values(), self._canvas, self._backdrop, self._programs

    def corner(self, number: int) -> tuple[int, int]:
        """Column and row of pixels at the top left of a tile, counted from 0."""
        width, height = self.drawing.size
        return number % self.columns * width, number // self.columns * height

    def draw(self, faps: ArrayLike | Sequence[Pose]) -> Picture:
        """Draw one frame of every face.

        Parameters
        ----------
        faps : (faces, 68) array_like, FAPU, or a Pose a face

        Returns
        -------
        (height, width, 3) uint8
            sRGB, top row first; 4 components without a background. Tiles without a face are black or clear.

        Raises
        ------
        UsageError
            If there is not one row a face.
        """
        return next(self.frames([faps]))

    def frames(self, faps: Iterable[ArrayLike | Sequence[Pose]]) -> Iterator[Picture]:
        """Draw frames in turn; see :meth:`draw`. The picture before is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def _draw(self, faps: ArrayLike | Sequence[Pose]) -> None:
        uniforms, drawing = self._uniforms(faps), self.drawing
        self._canvas.begin()
        for number, mesh in enumerate(self.meshes):
            self._context.viewport = (*self.corner(number), *drawing.size)
            model, camera = self._models[id(mesh)], self.cameras[number]
            model.draw(
                uniforms[number],
                camera,
                drawing.size,
                draw_behind=self._backdrop.draw,
                shading=drawing.shading,
                wire=drawing.wire,
            )

    def _uniforms(self, faps: ArrayLike | Sequence[Pose]) -> list[FrameUniforms]:
        """Return what each face sets; the faces of one mesh are worked out at once."""
        poses = [pose for pose in faps if isinstance(pose, Pose)] if isinstance(faps, Sequence) else []
        if poses:
            if len(poses) != len(self.meshes):
                raise UsageError(f"poses: got {len(poses)}, expected {len(self.meshes)}, one a face")
            return [pose_uniforms(mesh, pose) for mesh, pose in zip(self.meshes, poses, strict=True)]
        values = np.asarray(faps, dtype=np.float64)
        if values.shape[:1] != (len(self.meshes),):
            raise UsageError(f"faps: got shape {values.shape}, expected ({len(self.meshes)}, 68)")
        uniforms: dict[int, FrameUniforms] = {}
        for mesh in {id(mesh): mesh for mesh in self.meshes}.values():
            numbers = [number for number, other in enumerate(self.meshes) if other is mesh]
            together = frame_uniforms(mesh, values[numbers])
            for row, number in enumerate(numbers):
                each = {field.name: getattr(together, field.name)[row] for field in fields(FrameUniforms)}
                uniforms[number] = FrameUniforms(**each)
        return [uniforms[number] for number in range(len(self.meshes))]


def square_columns(count: int, tile: tuple[int, int]) -> int:
    """Columns that make ``count`` tiles about as wide as high, 1 at least.

    Examples
    --------
    >>> square_columns(9, (256, 256)), square_columns(2, (256, 256)), square_columns(4, (100, 400))
    (3, 2, 4)
    """
    return min(count, max(1, int(np.ceil(np.sqrt(count * tile[1] / tile[0])))))
