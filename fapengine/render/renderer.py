"""FAP frames to images on the GPU: of one face, or of several in one image.

Theory of operation
-------------------
The mesh is uploaded once (:mod:`fapengine.render.packing`, :mod:`fapengine.render.model`). A frame sends its channel
weights and five bone matrices; the vertex shader does the rest. :mod:`fapengine.render.canvas` has the render targets,
smooths edges and reads images back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.geometry.surface import sphere_directions
from fapengine.mesh.deform import Pose, with_rest
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import Camera
from fapengine.render.canvas import Backdrop, Canvas, Rectangle
from fapengine.render.context import Programs, Renderer, moderngl
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, Picture, Pixels, RenderOptions
from fapengine.render.model import Model
from fapengine.render.packed import packed_mesh
from fapengine.render.packing import FrameUniforms, frame_uniforms, pose_uniforms

Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, right and bottom in pixels."""

DIRECTIONS = 160
HEAD_BONE = 4
SLACK_MM = 4.0
"""Distance by which other vertices may be outside the box around those."""
MARGIN_PX = 3
"""Reach of the edge smoothing."""


class Reach:
    """Vertices that bound a mesh."""

    def __init__(self, mesh: FaceMesh) -> None:
        used = np.unique(mesh.triangles)
        moves = mesh.head_weight[used] > 0
        moving, still = _outermost(mesh.vertices_mm, used[moves]), _outermost(mesh.vertices_mm, used[~moves])
        mine = np.unique(np.concatenate([moving, still, np.fromiter(mesh.feature_points.values(), int)]))
        self._stays = np.isin(mine, used[~moves])
        self._at = np.concatenate([mesh.vertices_mm[mine], np.ones((len(mine), 1))], axis=1)
        self._boned = np.flatnonzero(mesh.bone_weight[mine])
        self._bone, self._weight = mesh.bone[mine][self._boned], mesh.bone_weight[mine][self._boned, None]
        self._head_weight = mesh.head_weight[mine, None]
        pushes = np.zeros((mesh.basis.width, len(mine), 3), dtype=np.float32)
        for place, vertex in enumerate(mine):
            entries = slice(mesh.basis.offsets[vertex], mesh.basis.offsets[vertex + 1])
            np.add.at(pushes[:, place], mesh.basis.entry_channels[entries], mesh.basis.entry_mm[entries])
        self._pushes = pushes.reshape(len(pushes), 3 * len(mine))

    def _places(self, uniforms: FrameUniforms) -> Array:
        """(N, 4): homogeneous positions of the vertices in a frame."""
        at = self._at.copy()
        at[:, :3] += (uniforms.channels[: len(self._pushes)] @ self._pushes).reshape(-1, 3)
        boned = at[self._boned]
        at[self._boned] += self._weight * (np.einsum("ni,nij->nj", boned, uniforms.bones[self._bone]) - boned)
        at += self._head_weight * (at @ uniforms.bones[HEAD_BONE] - at)
        return at

    def rectangles(self, uniforms: FrameUniforms, camera: Camera, size: tuple[int, int]) -> Sequence[Rectangle]:
        """Return the parts of an image, of width and height in pixels, that a frame covers; they do not overlap."""
        clip = self._places(uniforms) @ camera.clip_from_world(size[0] / size[1]).T
        if not len(clip) or clip[:, 3].min() <= 0:  # behind the camera
            return [(0, 0, *size)]
        depth = np.linalg.norm(camera.position_mm - np.asarray(camera.target_mm))
        slack_px = SLACK_MM * camera.pixels_per_mm(size[1]) * depth / clip[:, 3:] + MARGIN_PX
        places = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
        low, high = np.floor(places - slack_px), np.ceil(places + slack_px)
        head = _box(low[~self._stays], high[~self._stays], size)
        rest = _box(low[self._stays], high[self._stays], size)
        return [(left, top, right - left, bottom - top) for left, top, right, bottom in _apart(head, rest)]


def _outermost(points_mm: NDArray[np.float32], chosen: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the chosen vertices that are outermost in directions evenly spread on a sphere."""
    if not len(chosen):
        return chosen
    return chosen[(points_mm[chosen] @ sphere_directions(DIRECTIONS).T).argmax(axis=0)]


def _box(low: Array, high: Array, size: tuple[int, int]) -> Box | None:
    """Bounding box of positions (N, 2) inside the image; None outside."""
    if not len(low):
        return None
    left, top = np.clip(low.min(axis=0), 0, size).astype(int).tolist()
    right, bottom = np.clip(high.max(axis=0), 0, size).astype(int).tolist()
    return (left, top, right, bottom) if left < right and top < bottom else None


def _apart(head: Box | None, rest: Box | None) -> list[Box]:
    """Head above shoulders that are at least as wide, or one box around both."""
    if head is None or rest is None:
        return [box for box in (head, rest) if box is not None]
    if rest[0] <= head[0] and head[2] <= rest[2] and head[1] < rest[1] and head[3] <= rest[3]:
        return [(*head[:3], min(head[3], rest[1])), rest]
    return [(min(head[0], rest[0]), min(head[1], rest[1]), max(head[2], rest[2]), max(head[3], rest[3]))]


class FaceRenderer(Renderer):
    """Draws one face per image. Use it as a context manager; it holds GPU memory.

    Stateful.

    Parameters
    ----------
    mesh : FaceMesh
        Head to draw.
    drawing : RenderOptions
        Size, camera, background, antialiasing and light.
    context : moderngl.Context, optional
        By default a new one.

    Raises
    ------
    UsageError
        If the mesh has too many channels.
    ResourceError
        If OpenGL is not available.
    """

    def __init__(
        self,
        mesh: FaceMesh,
        drawing: RenderOptions = DEFAULT_RENDER_OPTIONS,
        *,
        context: moderngl.Context | None = None,
    ) -> None:
        packed = packed_mesh(mesh)
        super().__init__(context)
        self.mesh, self._drawing, self._reach = mesh, drawing, Reach(mesh)
        with self._context:
            self._programs = Programs(self._context)
            self._model = Model(self._programs, packed)
            self._backdrop = Backdrop(self._programs, drawing)
            self._canvas = Canvas(self._programs, drawing)

    def _resources(self) -> Iterable[Any]:
        return self._canvas, self._backdrop, self._model, self._programs

    @property
    def drawing(self) -> RenderOptions:
        """Options for the next frame; may be set between frames."""
        return self._drawing

    @drawing.setter
    def drawing(self, drawing: RenderOptions) -> None:
        before, self._drawing = self._drawing, drawing
        has_other_backdrop = drawing.background is not before.background or drawing.aspect != before.aspect
        if not has_other_backdrop and self._canvas.suits(drawing):
            return
        with self._context:
            if has_other_backdrop:
                self._backdrop.release()
                self._backdrop = Backdrop(self._programs, drawing)
            self._canvas.release()
            self._canvas = Canvas(self._programs, drawing)

    @property
    def is_lit_at_vertices(self) -> bool:
        """Whether :attr:`RenderOptions.shading` results in light at vertices."""
        return self._model.packed.is_lit_at_vertices(self._drawing)

    def draw(self, faps: ArrayLike, pixels: Pixels = "rgb") -> Picture:
        """Draw one frame.

        Parameters
        ----------
        faps : (68,) array_like, FAPU
        pixels : Pixels
            How the image is stored: see :data:`fapengine.render.drawing.Pixels`.

        Returns
        -------
        (height, width, 3) or (height * 3 // 2, width) uint8

        Raises
        ------
        UsageError
            If images of this drawing cannot be stored so.
        """
        return next(self.frames([faps], pixels))

    def frames(self, faps: Iterable[ArrayLike], pixels: Pixels = "rgb") -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`. Each image is read while the next is drawn."""
        self._drawing.check_pixels(pixels)
        return self._canvas.frames((partial(self._draw, frame) for frame in faps), pixels)

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw FAPs, (68,) FAPU, into a texture on the GPU, top row first, valid until the next frame."""
        return self._canvas.paint(partial(self._draw, faps))

    def _draw(self, faps: ArrayLike) -> Sequence[Rectangle] | None:
        drawing = self._drawing
        uniforms = frame_uniforms(self.mesh, with_rest(faps, drawing.rest))
        ground = drawing.camera, drawing.shading, drawing.wire
        draw_still = partial(self._model.draw, uniforms, drawing, draw_behind=self._backdrop.draw, moving=False)
        is_there = self._canvas.begin(ground, draw_still)
        behind = None if is_there else self._backdrop.draw
        self._model.draw(uniforms, drawing, draw_behind=behind, still=not is_there)
        if not self._backdrop.is_smooth:
            return None
        return self._reach.rectangles(uniforms, drawing.camera, drawing.drawn_size)


class Crowd:
    """Faces side by side in tiles, row by row, whoever draws them.

    Stateful: ``cameras``, one per tile, at first that of the drawing, may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        Head of each tile; a repeated mesh is uploaded once.
    drawing : RenderOptions
        Options for each tile; its size is that of a tile, and its scale is ignored.
    columns : int
        Number of tiles in a row.

    Raises
    ------
    UsageError
        If there is no mesh, or a side of the image is not 16 to 4096 pixels.
    """

    def __init__(self, meshes: Sequence[FaceMesh], drawing: RenderOptions, columns: int) -> None:
        if not meshes:
            raise UsageError("crowd: requires a mesh")
        self.cameras = [drawing.camera] * len(meshes)
        if not 1 <= columns <= len(meshes):
            raise UsageError(f"crowd: got {columns} columns, expected 1 to {len(meshes)}")
        rows = -(-len(meshes) // columns)
        self.drawing, self.columns, self.meshes = drawing, columns, tuple(meshes)
        self.whole = replace(drawing, size=(columns * drawing.size[0], rows * drawing.size[1]), scale=1.0)
        self.size = self.whole.size

    def corner(self, number: int) -> tuple[int, int]:
        """Column and row of the pixel at the top left of a tile, counted from 0."""
        width, height = self.drawing.size
        return number % self.columns * width, number // self.columns * height

    def frames(self, faps: Iterable[ArrayLike | Sequence[Pose | Array]]) -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`."""
        raise NotImplementedError

    def draw(self, faps: ArrayLike | Sequence[Pose]) -> Picture:
        """Draw one frame of every face.

        Parameters
        ----------
        faps : (faces, 68) array_like, FAPU, or for each face a Pose or its (68,) FAPU

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

    def uniforms(self, faps: ArrayLike | Sequence[Pose | Array]) -> list[FrameUniforms]:
        """Return the uniforms of each face, as :meth:`draw`; those of all faces of one mesh are computed at once."""
        if isinstance(faps, Sequence) and any(isinstance(each, Pose) for each in faps):
            if len(faps) != len(self.meshes):
                raise UsageError(f"poses: got {len(faps)}, expected {len(self.meshes)}, one per face")
            return [
                pose_uniforms(mesh, each)
                if isinstance(each, Pose)
                else frame_uniforms(mesh, with_rest(each, self.drawing.rest))
                for mesh, each in zip(self.meshes, faps, strict=True)
            ]
        values = np.asarray(faps, dtype=np.float64)
        if values.shape[:1] != (len(self.meshes),):
            raise UsageError(f"faps: got shape {values.shape}, expected ({len(self.meshes)}, 68)")
        uniforms: dict[int, FrameUniforms] = {}
        for mesh in {id(mesh): mesh for mesh in self.meshes}.values():
            numbers = [number for number, other in enumerate(self.meshes) if other is mesh]
            together = frame_uniforms(mesh, with_rest(values[numbers], self.drawing.rest))
            for row, number in enumerate(numbers):
                each = {field.name: getattr(together, field.name)[row] for field in fields(FrameUniforms)}
                uniforms[number] = FrameUniforms(**each)
        return [uniforms[number] for number in range(len(self.meshes))]


class CrowdRenderer(Crowd, Renderer):
    """A crowd by OpenGL. Use it as a context manager; it holds GPU memory.

    Stateful. Parameters and errors are those of :class:`Crowd`.

    Raises
    ------
    ResourceError
        If OpenGL is not available.
    """

    def __init__(
        self, meshes: Sequence[FaceMesh], drawing: RenderOptions = DEFAULT_RENDER_OPTIONS, *, columns: int = 1
    ) -> None:
        Crowd.__init__(self, meshes, drawing, columns)
        packed = {id(mesh): packed_mesh(mesh) for mesh in self.meshes}
        Renderer.__init__(self, None)
        with self._context:
            self._programs = Programs(self._context)
            self._models = {name: Model(self._programs, each) for name, each in packed.items()}
            self._backdrop = Backdrop(self._programs, drawing)
            self._canvas = Canvas(self._programs, self.whole)

    def _resources(self) -> Iterable[Any]:
        return *self._models.values(), self._canvas, self._backdrop, self._programs

    def frames(self, faps: Iterable[ArrayLike | Sequence[Pose | Array]]) -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`. Each image is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def _draw(self, faps: ArrayLike | Sequence[Pose | Array]) -> None:
        self._canvas.begin()
        tiles = zip(self.meshes, self.cameras, self.uniforms(faps), strict=True)
        for number, (mesh, camera, uniforms) in enumerate(tiles):
            tile = replace(self.drawing, camera=camera, scale=1.0)
            self._context.viewport = (*self.corner(number), *tile.size)
            self._models[id(mesh)].draw(uniforms, tile, draw_behind=self._backdrop.draw)
