"""A face drawn at a rate that is held: :mod:`fapengine.render.budget` decides, this obeys and tells."""

import time
from collections.abc import Callable, Sequence
from types import TracebackType

import moderngl
from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.budget import FrameBudget, Quality, ladder
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.canvas import Background, Picture
from fapengine.render.context import create_context
from fapengine.render.renderer import FaceRenderer


class LiveRenderer:
    """Stateful: draws a face as well as the rate allows. Use it as a context manager; it holds GPU memory.

    ``camera`` may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        The same head in levels of detail, the finest first; one is enough.
    rate_hz : float
        Frames a second to hold, 0.1..1000.
    size, camera, background, context
        As of :class:`fapengine.render.renderer.FaceRenderer`.
    on_change : callable
        Told in words what changed and why, as ``"70 % of the resolution, the finest head: a frame took 21.3 ms, 14.2 ms
        are there (60 Hz)"``.
    clock : callable
        Seconds, rising; by default the process's own clock.

    Raises
    ------
    UsageError
        If there is no mesh or a value is out of range.
    ResourceError
        If there is no OpenGL.
    """

    def __init__(
        self,
        meshes: Sequence[FaceMesh],
        *,
        rate_hz: float,
        size: tuple[int, int] = (512, 512),
        camera: Camera | None = None,
        background: Background = "studio",
        context: moderngl.Context | None = None,
        on_change: Callable[[str], None] = lambda text: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if not meshes:
            raise UsageError("live renderer: got no mesh, expected one or more")
        self.camera, self.size = camera or PRESETS["front"], size
        self._meshes, self._background = tuple(meshes), background
        self._on_change, self._clock = on_change, clock
        self._owns_context = context is None
        self._context = context or create_context()
        self._renderers: dict[int, FaceRenderer] = {}
        finest = self._renderer(0)
        qualities = ladder(
            [len(mesh.vertices_mm) for mesh in meshes], lit_at_pixels=not finest.is_lit_at_vertices(self.camera)
        )
        self.budget = FrameBudget(qualities, rate_hz)

    def __enter__(self) -> "LiveRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give all GPU memory back."""
        while self._renderers:
            self._renderers.popitem()[1].release()
        if self._owns_context:
            self._context.release()

    @property
    def quality(self) -> Quality:
        """How the next frame will be drawn."""
        return self.budget.quality

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame: FAPs (68,), FAPU, to (height, width, 3 or 4) uint8."""
        started = self._clock()
        picture = self._ready().draw(faps)
        self._account(started)
        return picture

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw one frame and leave it on the GPU: the texture, top row first, is good until the next frame."""
        started = self._clock()
        texture = self._ready().paint(faps)
        with self._context:
            self._context.finish()  # or its cost would fall on whoever waits for it
        self._account(started)
        return texture

    def _ready(self) -> FaceRenderer:
        quality = self.quality
        renderer = self._renderer(quality.level)
        renderer.camera, renderer.scale = self.camera, quality.scale
        renderer.shading, renderer.samples = quality.shading, quality.samples
        return renderer

    def _renderer(self, level: int) -> FaceRenderer:
        if level not in self._renderers:
            self._renderers[level] = FaceRenderer(
                self._meshes[level], size=self.size, background=self._background, context=self._context
            )
        return self._renderers[level]

    def _account(self, started_s: float) -> None:
        now_s = self._clock()
        change = self.budget.spent(now_s - started_s, now_s)
        if change is not None:
            self._on_change(
                f"{self.quality}: a frame took {1000 * change.cost_s:.1f} ms,"
                f" {1000 * change.budget_s:.1f} ms are there ({self.budget.rate_hz:g} Hz)"
            )
