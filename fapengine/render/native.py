"""FAP frames to images on the processor, by the package fapengine-native, without OpenGL; and which renderer is used.

The package's ``src/face.c`` draws as the shaders do: 99.9 % of the pixels are within 2/255 of OpenGL's, and at least
99.8 % in images of fewer than 200 pixels a side, where an edge within about 1/256 pixel of a pixel's centre, which may
fall to either side, counts more. It has no wireframe and no multisampling, and does not draw into windows.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array
from fapengine._late import Late
from fapengine.errors import ResourceError, UsageError
from fapengine.mesh.deform import Pose, with_rest
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import FAR_MM, NEAR_MM, Camera
from fapengine.render.canvas import WALL, cut_to_aspect
from fapengine.render.drawing import Picture, Pixels, RenderOptions, check_renderer
from fapengine.render.packed import packed_mesh
from fapengine.render.packing import FrameUniforms, PackedMesh, frame_uniforms
from fapengine.render.renderer import Crowd, CrowdRenderer, FaceRenderer

fapengine_native = Late("fapengine_native", "fapengine-native", "renderer native")

VARIABLE = "FAPENGINE_RENDERER"
"""Environment variable with the renderer that ``auto`` stands for."""
DEVICES = ("dri/renderD*", "nvidia[0-9]*")
"""Below /dev: what a GPU shows as on Linux."""
W_FROM_DEPTH = np.array([((FAR_MM + NEAR_MM) / (FAR_MM - NEAR_MM) + 1) / 2, FAR_MM * NEAR_MM / (FAR_MM - NEAR_MM)])
"""Of a depth z from 0 to 1 in the image, w is the second divided by the first less z."""
log = logging.getLogger("fapengine.render")
N = TypeVar("N")
G = TypeVar("G")


class _Native:
    """One mesh in the library, and the size and background of its images. Stateful."""

    def __init__(self, packed: PackedMesh, drawing: RenderOptions) -> None:
        self._packed, self._drawing, self._level = packed, drawing, -1
        self._face = fapengine_native.Face(packed.vertices, packed.displacements, packed.normal_deltas, packed.parts)
        self._face.canvas(drawing.drawn_size, _backdrop(drawing))
        self._look_from(drawing.camera)

    def _look_from(self, camera: Camera) -> None:
        self._drawing = drawing = replace(self._drawing, camera=camera)
        width, height = drawing.drawn_size
        self._view = [camera.clip_from_world(width / height).T, camera.position_mm, W_FROM_DEPTH]
        self._at_vertices = self._packed.is_lit_at_vertices(drawing)
        if self._packed.skin is None:
            return
        level = self._packed.skin_level(camera.pixels_per_mm(height))
        if level != self._level:
            self._face.skin(self._packed.skin_at(level))
            self._level = level

    def draw(self, uniforms: FrameUniforms, camera: Camera, pixels: Pixels = "rgb") -> Picture:
        if camera is not self._drawing.camera:
            self._look_from(camera)
        drawing = self._drawing
        picture: Picture = self._face.draw(
            self.values(uniforms),
            at_vertices=self._at_vertices,
            soft=drawing.samples == 0,
            form=pixels if drawing.components == 3 and drawing.drawn_size == drawing.size else "rgba",
        )
        if drawing.drawn_size == drawing.size:
            return picture
        return np.ascontiguousarray(fapengine_native.resized(picture, drawing.size)[..., : drawing.components])

    def values(self, uniforms: FrameUniforms) -> NDArray[np.float32]:
        """(238,): a frame as the library reads it, ``fapengine_native.UNIFORMS``."""
        mine = [uniforms.channels, uniforms.bones, uniforms.iris, uniforms.lids, self._packed.iris_albedo]
        return np.concatenate([np.ravel(each) for each in (*mine, *self._view)], dtype=np.float32)

    def close(self) -> None:
        self._face.close()


def _backdrop(drawing: RenderOptions) -> NDArray[np.uint8] | None:
    """(height, width, 4): the background as ``backdrop.frag`` draws it; None if it is transparent."""
    background, (width, height) = drawing.background, drawing.drawn_size
    if drawing.components == 4:
        return None
    if isinstance(background, np.ndarray):
        shown = cut_to_aspect(background, drawing.aspect)
        opaque = np.concatenate([shown, np.full((*shown.shape[:2], 1), 255, np.uint8)], axis=2)
        made: NDArray[np.uint8] = fapengine_native.resized(opaque, (width, height))
        return made
    wall, falloff = (WALL, 1.0) if isinstance(background, str) else ([(part / 255) ** 2 for part in background], 0.0)
    x, y = (np.arange(width) + 0.5) / width - 0.5, ((np.arange(height) + 0.5) / height - 0.45) * 0.9
    light = 1 + falloff * (0.55 - 2 * (x * x + (y * y)[:, None]))
    picture = np.full((height, width, 4), 255, dtype=np.uint8)
    for channel, part in enumerate(wall):  # one after the other: all three do not fit into the cache
        picture[..., channel] = np.round(255 * np.clip(np.sqrt(np.maximum(light * part, 0)), 0, 1))
    return picture


class NativeRenderer:
    """Draws one face per image, as :class:`~fapengine.render.renderer.FaceRenderer` does. Use it as a context manager.

    Stateful.

    Raises
    ------
    ResourceError
        If fapengine-native is not installed.
    """

    def __init__(self, mesh: FaceMesh, drawing: RenderOptions) -> None:
        self.mesh, self.drawing = mesh, drawing
        self._native = _Native(packed_mesh(mesh), drawing)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def draw(self, faps: ArrayLike, pixels: Pixels = "rgb") -> Picture:
        """Draw FAPs, (68,) FAPU; returns and raises as :meth:`FaceRenderer.draw`."""
        self.drawing.check_pixels(pixels)
        uniforms = frame_uniforms(self.mesh, with_rest(faps, self.drawing.rest))
        picture = self._native.draw(uniforms, self.drawing.camera, pixels)
        return picture.reshape(-1, self.drawing.size[0]) if pixels == "i420" else picture

    def frames(self, faps: Iterable[ArrayLike], pixels: Pixels = "rgb") -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`."""
        return (self.draw(frame, pixels) for frame in faps)

    def release(self) -> None:
        """Free the memory."""
        self._native.close()


class NativeCrowd(Crowd):
    """Faces side by side. Use it as a context manager. Stateful; parameters and errors as the base's and above.

    Each is the image of that face alone. OpenGL smooths edges across the borders of faces, and computes derivatives in
    squares of two by two pixels of the whole image: beside odd sizes it draws a face slightly differently.
    """

    def __init__(self, meshes: Sequence[FaceMesh], drawing: RenderOptions, *, columns: int = 1) -> None:
        super().__init__(meshes, drawing, columns)
        packed = {id(mesh): packed_mesh(mesh) for mesh in self.meshes}
        tile = replace(drawing, scale=1.0)
        self._natives = {name: _Native(each, tile) for name, each in packed.items()}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for native in self._natives.values():
            native.close()

    def frames(self, faps: Iterable[ArrayLike | Sequence[Pose | Array]]) -> Iterator[Picture]:
        """Draw frames one after the other; see :meth:`draw`."""
        return map(self._frame, faps)

    def _frame(self, faps: ArrayLike | Sequence[Pose | Array]) -> Picture:
        width, height = self.drawing.size
        picture = np.zeros((*self.size[::-1], self.drawing.components), dtype=np.uint8)
        for number, (mesh, camera, uniforms) in enumerate(
            zip(self.meshes, self.cameras, self.uniforms(faps), strict=True)
        ):
            left, top = self.corner(number)
            picture[top : top + height, left : left + width] = self._natives[id(mesh)].draw(uniforms, camera)
        return picture


def has_gpu() -> bool:
    """Whether there may be a GPU: a device of one on Linux; elsewhere OpenGL itself has to show it."""
    if os.environ.get("LIBGL_ALWAYS_SOFTWARE", "").lower() in ("1", "true"):
        return False
    return sys.platform != "linux" or any(any(Path("/dev").glob(pattern)) for pattern in DEVICES)


def asked_renderer(drawing: RenderOptions) -> str:
    """Return the renderer that is asked for, of :data:`~fapengine.render.drawing.RENDERERS`.

    Raises
    ------
    UsageError
        If the environment variable names another.
    """
    if drawing.renderer != "auto":
        return drawing.renderer
    asked = os.environ.get(VARIABLE) or "auto"
    check_renderer(asked, VARIABLE)
    return asked


def _cannot(drawing: RenderOptions) -> str:
    """Return what of a drawing the native renderer does not have; empty if it has all."""
    if drawing.wire:
        return "the wireframe"
    return "multisampled edges (antialias fine)" if drawing.samples > 1 else ""


def by_renderer(drawing: RenderOptions, *, native: Callable[[], N], gl: Callable[[], G]) -> N | G:
    """Call the function of the renderer that a drawing is drawn with.

    Raises
    ------
    UsageError
        If the native renderer is asked for what it does not have.
    ResourceError
        If the renderer is not available.
    """
    asked, lacking = asked_renderer(drawing), _cannot(drawing)
    if asked == "native" and lacking:
        raise UsageError(f"renderer: native does not draw {lacking}, expected gl or auto")
    if asked == "native":
        return native()
    if asked == "gl" or find_spec("fapengine_native") is None:
        return gl()
    if lacking:
        if not has_gpu():
            log.warning("renderer: OpenGL draws this image, because native does not draw %s", lacking)
        return gl()
    first, second = (gl, native) if has_gpu() else (native, gl)
    try:
        return first()
    except ResourceError as error:  # a GPU without its driver; a library for another system
        log.warning("%s; %s draws instead", error, "native" if first is gl else "OpenGL")
        return second()


def native_build() -> str:
    """Return the version of fapengine-native and the instructions that it uses. Raises ResourceError without it."""
    instructions = fapengine_native.select()
    return f"fapengine-native {version('fapengine-native')}, {instructions}"


def open_renderer(mesh: FaceMesh, drawing: RenderOptions) -> FaceRenderer | NativeRenderer:
    """Open the renderer of :attr:`RenderOptions.renderer`.

    Raises
    ------
    UsageError
        If the native renderer is asked for what it does not have, or the mesh has too many channels.
    ResourceError
        If the renderer is not available.
    """
    return by_renderer(drawing, native=lambda: NativeRenderer(mesh, drawing), gl=lambda: FaceRenderer(mesh, drawing))


def open_crowd_renderer(
    meshes: Sequence[FaceMesh], drawing: RenderOptions, *, columns: int
) -> CrowdRenderer | NativeCrowd:
    """Open the renderer of several faces; errors as :func:`open_renderer`."""
    return by_renderer(
        drawing,
        native=lambda: NativeCrowd(meshes, drawing, columns=columns),
        gl=lambda: CrowdRenderer(meshes, drawing, columns=columns),
    )
