"""Several faces in one image: one context, one render target, one readback."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.canvas import Backdrop, Canvas
from fapengine.render.context import Renderer
from fapengine.render.drawing import DEFAULT_DRAWING, Drawing, Picture
from fapengine.render.model import Model, Programs
from fapengine.render.packing import FrameUniforms, frame_uniforms, pack, pose_uniforms


class CrowdRenderer(Renderer):
    """Faces side by side in tiles, row by row. Use it as a context manager; it holds GPU memory.

    Stateful: ``cameras``, one per tile, at first that of the drawing, may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        Head of each tile; a repeated mesh is uploaded once.
    drawing : Drawing
        Options for each tile; its size is that of a tile, and its scale is ignored.
    columns : int
        Number of tiles in a row.

    Raises
    ------
    UsageError
        If there is no mesh, or a side of the image is not 16 to 4096 pixels.
    ResourceError
        If OpenGL is not available.
    """

    def __init__(
        self,
        meshes: Sequence[FaceMesh],
        drawing: Drawing = DEFAULT_DRAWING,
        *,
        columns: int = 1,
    ) -> None:
        if not meshes:
            raise UsageError("crowd: requires a mesh")
        self.cameras = [drawing.camera] * len(meshes)
        if not 1 <= columns <= len(meshes):
            raise UsageError(f"crowd: got {columns} columns, expected 1 to {len(meshes)}")
        rows = -(-len(meshes) // columns)
        self.drawing, self.columns, self.meshes = drawing, columns, tuple(meshes)
        whole = replace(drawing, size=(columns * drawing.size[0], rows * drawing.size[1]), scale=1.0)
        self.size = whole.size
        packed = {id(mesh): pack(mesh) for mesh in self.meshes}
        super().__init__(None)
        with self._context:
            self._programs = Programs(self._context)
            self._models = {name: Model(self._programs, each) for name, each in packed.items()}
            self._backdrop = Backdrop(self._programs, drawing)
            self._canvas = Canvas(self._programs, whole)

    def _resources(self) -> Iterable[Any]:
        return *self._models.values(), self._canvas, self._backdrop, self._programs

    def corner(self, number: int) -> tuple[int, int]:
        """Column and row of the pixel at the top left of a tile, counted from 0."""
        width, height = self.drawing.size
        return number % self.columns * width, number // self.columns * height

    def draw(self, faps: ArrayLike | Sequence[Pose]) -> Picture:
        """Draw one frame of every face.

        Parameters
        ----------
        faps : (faces, 68) array_like, FAPU, or one Pose per face

        Returns
        -------
        (height, width, 3) uint8
            sRGB, top row first; 4 components without a background. Tiles without a face are black or transparent.

        Raises
        ------
        UsageError
            If there is not one row per face.
        """
        return next(self.frames([faps]))

    def frames(self, faps: Iterable[ArrayLike | Sequence[Pose]]) -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`. Each image is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def _draw(self, faps: ArrayLike | Sequence[Pose]) -> None:
        self._canvas.begin()
        tiles = zip(self.meshes, self.cameras, self._uniforms(faps), strict=True)
        for number, (mesh, camera, uniforms) in enumerate(tiles):
            tile = replace(self.drawing, camera=camera, scale=1.0)
            self._context.viewport = (*self.corner(number), *tile.size)
            self._models[id(mesh)].draw(uniforms, tile, draw_behind=self._backdrop.draw)

    def _uniforms(self, faps: ArrayLike | Sequence[Pose]) -> list[FrameUniforms]:
        """Return the uniforms of each face; those of all faces of one mesh are computed at once."""
        poses = [pose for pose in faps if isinstance(pose, Pose)] if isinstance(faps, Sequence) else []
        if poses:
            if len(poses) != len(self.meshes):
                raise UsageError(f"poses: got {len(poses)}, expected {len(self.meshes)}, one per face")
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
