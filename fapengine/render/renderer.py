"""FAP frames to pictures on the GPU.

Theory of operation
-------------------
The mesh is uploaded once (:mod:`fapengine.render.packing`, :mod:`fapengine.render.model`). A frame sends its channel
weights and five bone matrices; the vertex shader does the rest. :mod:`fapengine.render.canvas` holds what is drawn
into, softens edges and reads pictures back.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from types import TracebackType

import moderngl
from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.canvas import SIZES as SIZES
from fapengine.render.canvas import Backdrop, Background, Canvas, Picture, check_size
from fapengine.render.context import create_context
from fapengine.render.model import SHADINGS, Model, Programs, Shading
from fapengine.render.packing import frame_uniforms, pack

SCALES = (0.1, 1.0)


class FaceRenderer:
    """Stateful: one mesh in one picture size. Use it as a context manager; it holds GPU memory.

    ``camera``, ``shading``, ``wire``, ``scale`` and ``samples`` may be set between frames.

    Parameters
    ----------
    mesh : FaceMesh
        Whose face.
    size : (int, int)
        Width and height in pixels, 16..4096.
    camera : Camera, optional
        By default from the front.
    background : "studio", (int, int, int), (H, W, 3) uint8 or None
        Behind the head: a lit wall, one colour (sRGB 0..255), a picture, or nothing; then pictures have an alpha
        channel, premultiplied.
    transparent : bool
        Another way to say that there is no background.
    samples : int
        0 softens edges by a second pass; 2, 4 or 8 use multisampling instead (finer and slower); 1 leaves stairs.
    shading : "auto", "pixels" or "vertices"
        Where light is worked out; by itself it chooses vertices while they stand close together.
    wire : bool
        Draw the edges of the triangles over the face.
    context : moderngl.Context, optional
        By default a new one.

    Raises
    ------
    UsageError
        If a value is out of range, or the mesh has too many channels.
    ResourceError
        If there is no OpenGL.
    """

    def __init__(
        self,
        mesh: FaceMesh,
        *,
        size: tuple[int, int] = (512, 512),
        camera: Camera | None = None,
        background: Background = "studio",
        transparent: bool = False,
        samples: int = 0,
        shading: Shading = "auto",
        wire: bool = False,
        context: moderngl.Context | None = None,
    ) -> None:
        check_size(size)
        if shading not in SHADINGS:
            raise UsageError(f"shading: got {shading!r}, expected one of {', '.join(SHADINGS)}")
        packed = pack(mesh)
        self.mesh, self.size, self.shading, self.wire = mesh, size, shading, wire
        self.camera = camera or PRESETS["front"]
        behind = None if transparent else background
        self._samples, self._scale = samples, 1.0
        self._components = 4 if behind is None else 3
        self._owns_context = context is None
        self._context = context or create_context()
        with self._context:
            self._programs = Programs(self._context)
            self._model = Model(self._programs, packed)
            self._backdrop = Backdrop(self._programs, behind, size[0] / size[1])
            self._canvas = self._new_canvas()

    def __enter__(self) -> "FaceRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give all GPU memory back."""
        with self._context:
            for resource in (self._canvas, self._backdrop, self._model, self._programs):
                resource.release()
        if self._owns_context:
            self._context.release()

    @property
    def scale(self) -> float:
        """What is drawn, as a share of each side of what is handed over; 1 draws every pixel."""
        return self._scale

    @scale.setter
    def scale(self, share: float) -> None:
        if not SCALES[0] <= share <= SCALES[1]:
            raise UsageError(f"scale: got {share:g}, expected {SCALES[0]:g} to {SCALES[1]:g}")
        if share != self._scale:
            self._scale = share
            with self._context:
                self._canvas.release()
                self._canvas = self._new_canvas()

    @property
    def samples(self) -> int:
        """How edges are smoothed: see the constructor."""
        return self._samples

    @samples.setter
    def samples(self, count: int) -> None:
        if count != self._samples:
            with self._context:
                self._canvas.release()
                self._samples = count
                self._canvas = self._new_canvas()

    def is_lit_at_vertices(self, camera: Camera) -> bool:
        """Tell what ``shading`` comes to with a camera."""
        return self._model.is_lit_at_vertices(camera, self._canvas.drawn, self.shading)

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame.

        Parameters
        ----------
        faps : (68,) array_like, FAPU

        Returns
        -------
        (height, width, 3) uint8
            sRGB, top row first; 4 components without a background.
        """
        return next(self.frames([faps]))

    def frames(self, faps: Iterable[ArrayLike]) -> Iterator[Picture]:
        """Draw frames in turn; see :meth:`draw`. The picture before is read while the next is drawn."""
        return self._canvas.frames(partial(self._draw, frame) for frame in faps)

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw one frame and leave it on the GPU: the texture, top row first, is good until the next frame."""
        return self._canvas.paint(partial(self._draw, faps))

    def _draw(self, faps: ArrayLike) -> None:
        uniforms = frame_uniforms(self.mesh, faps)
        self._model.draw(uniforms, self.camera, self._canvas.drawn, shading=self.shading, wire=self.wire)
        self._backdrop.draw()

    def _new_canvas(self) -> Canvas:
        drawn = (max(1, round(self.size[0] * self._scale)), max(1, round(self.size[1] * self._scale)))
        return Canvas(self._programs, self.size, components=self._components, samples=self._samples, drawn=drawn)
