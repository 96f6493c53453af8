"""Rendering at a constant frame rate: :mod:`fapengine.render.budget` chooses the quality."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.budget import FrameBudget, Quality, ladder
from fapengine.render.context import Renderer, moderngl
from fapengine.render.drawing import DEFAULT_DRAWING, Drawing, Picture
from fapengine.render.renderer import FaceRenderer

LevelOfDetail: TypeAlias = "FaceMesh | Callable[[], FaceMesh]"
"""A head, or a function that loads it when it is first drawn."""
COARSER = 0.5
"""Vertices assumed for a level before it is loaded, relative to the next finer one."""


class LiveRenderer(Renderer):
    """Draws a face as well as the frame rate allows. Use it as a context manager; it holds GPU memory.

    Stateful: ``drawing`` may be set between frames.

    Parameters
    ----------
    meshes : sequence of FaceMesh
        The same head in levels of detail, the finest first; one is enough. Coarser ones may be functions, which are
        called when that level is first needed.
    drawing : Drawing
        Size, camera, background and wireframe; samples, shading and scale follow from the rate.
    rate_hz : float
        Frame rate to hold, 0.1 to 1000.
    context : moderngl.Context, optional
        By default a new one.
    clock : callable
        Seconds, rising; by default the process's own clock.

    Raises
    ------
    UsageError
        If there is no mesh or the rate is out of range.
    ResourceError
        If OpenGL is not available.
    """

    def __init__(
        self,
        meshes: Sequence[LevelOfDetail],
        drawing: Drawing = DEFAULT_DRAWING,
        *,
        rate_hz: float,
        context: moderngl.Context | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if not meshes:
            raise UsageError("live renderer: requires a mesh")
        super().__init__(context)
        self.drawing, self._meshes = drawing, tuple(meshes)
        self._clock = clock
        self._renderers: dict[int, FaceRenderer] = {}
        counts: list[float] = []
        for mesh in meshes:
            counts.append(len(mesh.vertices_mm) if isinstance(mesh, FaceMesh) else COARSER * counts[-1])
        lit_at_pixels = not self._renderer(Quality()).is_lit_at_vertices
        self.budget = FrameBudget(ladder(counts, lit_at_pixels=lit_at_pixels), rate_hz)

    def release(self) -> None:
        """Free all GPU memory."""
        while self._renderers:
            self._renderers.popitem()[1].release()
        super().release()

    def _resources(self) -> Iterable[Any]:
        return ()  # the renderers have released theirs: a context must not be entered twice

    @property
    def quality(self) -> Quality:
        """Quality of the next frame."""
        return self.budget.quality

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame: FAPs (68,), FAPU, to (height, width, 3 or 4) uint8."""
        started = self._clock()
        picture = self._renderer(self.quality).draw(faps)
        self._account(started)
        return picture

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw FAPs, (68,) FAPU, into a texture on the GPU, top row first, valid until the next frame."""
        started = self._clock()
        texture = self._renderer(self.quality).paint(faps)
        with self._context:
            self._context.finish()  # otherwise the next wait would include its cost
        self._account(started)
        return texture

    def _renderer(self, quality: Quality) -> FaceRenderer:
        """Return the renderer of a quality, with its options set; its mesh is loaded if necessary."""
        level = quality.level
        drawing = replace(self.drawing, scale=quality.scale, shading=quality.shading, samples=quality.samples)
        if level not in self._renderers:
            mesh = self._meshes[level]
            mesh = mesh if isinstance(mesh, FaceMesh) else mesh()
            self._renderers[level] = FaceRenderer(mesh, drawing, context=self._context)
        self._renderers[level].drawing = drawing
        return self._renderers[level]

    def _account(self, started_s: float) -> None:
        now_s = self._clock()
        self.budget.spent(now_s - started_s, now_s)
