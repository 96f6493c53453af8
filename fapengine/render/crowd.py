"""Several faces in one picture: one context, one target, one reading back."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from types import TracebackType

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.canvas import Backdrop, Background, Canvas, Picture, check_size
from fapengine.render.context import create_context
from fapengine.render.model import Model, Programs, Shading
from fapengine.render.packing import FrameUniforms, frame_uniforms, pack


class CrowdRenderer:
    """Stateful: faces side by side in tiles, row by row. Use it as a context manager; it holds GPU memory.

    ``cameras``, ``shading`` and ``wire`` may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        One a tile; a mesh that comes again is uploaded once.
    tile : (int, int)
        Width and height of a tile in pixels.
    columns : int, optional
        By default as many as make the picture about as wide as high.
    cameras : Camera or sequence of Camera, optional
        One for all, or one a tile; by default from the front.
    background, samples, shading, wire, context
        As of :class:`fapengine.render.renderer.FaceRenderer`; each tile has the background to itself.

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
        *,
        tile: tuple[int, int] = (256, 256),
        columns: int | None = None,
        cameras: Camera | Sequence[Camera] | None = None,
        background: Background = "studio",
        samples: int = 0,
        shading: Shading = "auto",
        wire: bool = False,
        context: moderngl.Context | None = None,
    ) -> None:
        if not meshes:
            raise UsageError("crowd: got no mesh, expected one or more")
        given = cameras or PRESETS["front"]
        self.cameras = [given] * len(meshes) if isinstance(given, Camera) else list(given)
        if len(self.cameras) != len(meshes):
            raise UsageError(f"crowd: got {len(self.cameras)} cameras, expected one or {len(meshes)}")
        columns = columns or square_columns(len(meshes), tile)
        if not 1 <= columns <= len(meshes):
            raise UsageError(f"crowd: got {columns} columns, expected 1 to {len(meshes)}")
        self.tile, self.columns = tile, columns
        self.size = (columns * tile[0], -(-len(meshes) // columns) * tile[1])
        check_size(self.size)
        self.meshes, self.shading, self.wire = tuple(meshes), shading, wire
        packed = {id(mesh): pack(mesh) for mesh in self.meshes}
        self._owns_context = context is None
        self._context = context or create_context()
        with self._context:
            self._programs = Programs(self._context)
            self._models = {name: Model(self._programs, each) for name, each in packed.items()}
            self._backdrop = Backdrop(self._programs, background, tile[0] / tile[1])
            components = 4 if background is None else 3
            self._canvas = Canvas(self._programs, self.size, components=components, samples=samples)

    def __enter__(self) -> "CrowdRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give all GPU memory back."""
        with self._context:
            for model in self._models.values():
                model.release()
            for resource in (self._canvas, self._backdrop, self._programs):
                resource.release()
        if self._owns_context:
            self._context.release()

    def corner(self, number: int) -> tuple[int, int]:
        """Column and row of pixels at the top left of a tile, counted from 0."""
        return number % self.columns * self.tile[0], number // self.columns * self.tile[1]

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame of every face.

        Parameters
        ----------
        faps : (faces, 68) array_like, FAPU

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

    def frames(self, faps: Iterable[ArrayLike]) -> Iterator[Picture]:
        """Draw frames in turn; see :meth:`draw`. The picture before is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def _draw(self, faps: ArrayLike) -> None:
        values = np.asarray(faps, dtype=np.float64)
        if values.shape[:1] != (len(self.meshes),):
            raise UsageError(f"faps: got shape {values.shape}, expected ({len(self.meshes)}, 68)")
        uniforms = self._uniforms(values)
        for number, mesh in enumerate(self.meshes):
            self._context.viewport = (*self.corner(number), *self.tile)
            model = self._models[id(mesh)]
            model.draw(uniforms[number], self.cameras[number], self.tile, shading=self.shading, wire=self.wire)
            self._backdrop.draw()

    def _uniforms(self, values: np.ndarray) -> list[FrameUniforms]:
        """Of every face; those of one mesh are worked out at once."""
        found: dict[int, FrameUniforms] = {}
        for mesh in {id(mesh): mesh for mesh in self.meshes}.values():
            mine = [number for number, other in enumerate(self.meshes) if other is mesh]
            together = frame_uniforms(mesh, values[mine])
            for row, number in enumerate(mine):
                found[number] = FrameUniforms(
                    channels=together.channels[row], bones=together.bones[row], iris=together.iris[row]
                )
        return [found[number] for number in range(len(self.meshes))]


def square_columns(count: int, tile: tuple[int, int]) -> int:
    """Columns that make ``count`` tiles about as wide as high, 1 at least.

    Examples
    --------
    >>> square_columns(9, (256, 256)), square_columns(2, (256, 256)), square_columns(4, (100, 400))
    (3, 2, 4)
    """
    return min(count, max(1, int(np.ceil(np.sqrt(count * tile[1] / tile[0])))))
