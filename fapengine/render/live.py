"""Rendering at a constant frame rate: a live face has the best quality that holds it.

Theory of operation
-------------------
A *ladder* lists qualities from the best to the cheapest; the *rung* is the one in use. The cost of each frame is passed
to :meth:`FrameBudget.spent`; time is an argument. While the median of the last half second fits the budget, nothing
happens. When it does not, the rung falls at once to the first that is estimated to fit: a rung's estimate is the
median, scaled by the ratio of relative costs, which are learned from the measured costs of the rungs. When the next
better rung is estimated to fit with a margin for a while, the rung climbs by one. A climb that is reverted doubles the
wait before the next one, so that a load between two rungs does not make the image flicker; five minutes without a fall
reset the wait.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import isnan
from statistics import median_high
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.context import Renderer, moderngl
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, Picture, RenderOptions, Shading
from fapengine.render.renderer import FaceRenderer

RATES_HZ = (0.1, 1000.0)
DRAWING_SHARE = 0.85
"""Fraction of a frame's time that drawing may take; the rest is for other work."""
MAX_CLIMB_SHARE = 0.85
"""Largest fraction of the budget that a better rung may be estimated to take for a climb."""
WINDOW_S, MIN_FRAMES = 0.5, 3
"""Time and number of frames for the median that decides whether the rung falls."""
MIN_WAIT_S, MAX_WAIT_S, FORGIVEN_S = 2.0, 64.0, 300.0
"""Time on a rung before it climbs, initial and longest; and time without a fall that resets it."""
TAKEN_BACK_S = 15.0
"""Time after a climb in which a fall counts as reverting it."""
VERTEX_SHARE, LIGHT_SHARE, SOFTENING_SHARE, MULTISAMPLING = 0.35, 0.28, 0.18, 1.3
"""Costs on llvmpipe at 512 x 512: the vertices' fraction of a frame with smoothed edges; of the rest, the fractions of
light at pixels and of smoothing; and the additional cost of multisampling, relative to that rest.
"""
EDGE_WORDS = {0: "softened edges", 1: "edges as they are"}
SCALES = (1.0, 0.85, 0.7, 0.5, 0.35)


@dataclass(frozen=True, slots=True)
class Quality:
    """One rung of the ladder."""

    level: int = 0
    """Level of detail of the head, 0 the finest."""
    scale: float = 1.0
    """Ratio of drawn sides to shown sides."""
    shading: Shading = "auto"
    samples: int = 4
    """Antialiasing: 4 multisampled, 0 smoothed after drawing, 1 none."""
    relative_cost: float = 1.0
    """Estimated cost of a frame, relative to the best quality."""

    def __str__(self) -> str:
        """Describe the quality, for example ``"70 % of the resolution, the finest head"``."""
        parts = [
            "every pixel" if self.scale == 1 else f"{100 * self.scale:.0f} % of the resolution",
            "the finest head" if self.level == 0 else f"head {self.level + 1}",
            "light at vertices" if self.shading == "vertices" else "",
            EDGE_WORDS.get(self.samples, ""),
        ]
        return ", ".join(filter(None, parts))


def ladder(vertices: Sequence[float], *, lit_at_pixels: bool) -> tuple[Quality, ...]:
    """Return the qualities from the best to the cheapest.

    Parameters
    ----------
    vertices : sequence of float
        Number of vertices of each level of detail, the finest first.
    lit_at_pixels : bool
        Whether the finest is lit at pixels with ``shading="auto"``; if so, that is given up first.

    Raises
    ------
    UsageError
        If there is no level.
    """
    if not vertices:
        raise UsageError("ladder: requires a level of detail")
    choices: list[tuple[int, float, Shading, int]] = [(0, 1.0, "auto", 4), (0, 1.0, "auto", 0)]
    if lit_at_pixels:
        choices.append((0, 1.0, "vertices", 0))
    shading = choices[-1][2]
    coarsest = len(vertices) - 1
    for step, scale in enumerate(SCALES[1:]):
        levels = dict.fromkeys((min(step, coarsest), min(step + 1, coarsest)))
        choices += [(level, scale, shading, 0) for level in levels]
    choices.append((coarsest, SCALES[-1], shading, 1))
    costs = [_cost(*choice, vertices, lit_at_pixels=lit_at_pixels) for choice in choices]
    return tuple(Quality(*choice, relative_cost=cost / costs[0]) for choice, cost in zip(choices, costs, strict=True))


def _cost(
    level: int, scale: float, shading: Shading, samples: int, vertices: Sequence[float], *, lit_at_pixels: bool
) -> float:
    """Estimate the cost of a frame, relative to the finest head with smoothed edges."""
    saved = LIGHT_SHARE * (shading == "vertices" and lit_at_pixels) + SOFTENING_SHARE * (samples == 1)
    pixels = scale**2 * (1 - saved + MULTISAMPLING * (samples > 1))
    return VERTEX_SHARE * vertices[level] / vertices[0] + (1 - VERTEX_SHARE) * pixels


class FrameBudget:
    """Chooses the rung that holds a frame rate.

    Stateful.

    Parameters
    ----------
    qualities : sequence of Quality
        The ladder, best first.
    rate_hz : float
        Frame rate to hold, 0.1 to 1000.

    Raises
    ------
    UsageError
        If the ladder is empty or the rate out of range.
    """

    def __init__(self, qualities: Sequence[Quality], rate_hz: float) -> None:
        if not qualities:
            raise UsageError("budget: the ladder is empty")
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            raise UsageError(f"budget: got {rate_hz:g} Hz, expected {RATES_HZ[0]:g} to {RATES_HZ[1]:g}")
        self.qualities, self.rate_hz, self.rung = tuple(qualities), rate_hz, 0
        self._relative = [quality.relative_cost for quality in qualities]
        self._costs: deque[tuple[float, float]] = deque()
        self._since_s = float("nan")
        self._fell_s = float("-inf")
        self._wait_s, self._climbed = MIN_WAIT_S, False
        self._before: tuple[int, float] | None = None

    @property
    def budget_s(self) -> float:
        """Time available for drawing a frame."""
        return DRAWING_SHARE / self.rate_hz

    @property
    def quality(self) -> Quality:
        """The rung in use."""
        return self.qualities[self.rung]

    def spent(self, cost_s: float, now_s: float) -> None:
        """Record the cost of a frame drawn with :attr:`quality` and done at ``now_s``; this may change the rung."""
        if isnan(self._since_s):
            self._since_s = now_s
        self._costs.append((now_s, cost_s))
        while now_s - self._costs[0][0] > MIN_WAIT_S and len(self._costs) > MIN_FRAMES:
            self._costs.popleft()
        recent = [cost for time_s, cost in self._costs if now_s - time_s <= WINDOW_S]
        if len(recent) < MIN_FRAMES:
            recent = [cost for _, cost in self._costs][-MIN_FRAMES:]
        stays_s = now_s - self._since_s
        if len(recent) >= MIN_FRAMES and (stays_s >= WINDOW_S or sum(recent) >= WINDOW_S):
            median = median_high(recent)
            self._learn(median)
            if median > self.budget_s and self.rung + 1 < len(self.qualities):
                self._fall(median, now_s)
                return
        if now_s - self._fell_s > FORGIVEN_S:
            self._wait_s = MIN_WAIT_S
        if self.rung and stays_s >= self._wait_s:
            median = median_high(cost for _, cost in self._costs)
            if self._estimate(self.rung - 1, median) <= MAX_CLIMB_SHARE * self.budget_s:
                self._move(self.rung - 1, median, now_s)

    def _estimate(self, rung: int, median: float) -> float:
        return median * self._relative[rung] / self._relative[self.rung]

    def _fall(self, median: float, now_s: float) -> None:
        """Go to the first rung that is estimated to fit, or the last."""
        below = range(self.rung + 1, len(self.qualities))
        chosen = next((rung for rung in below if self._estimate(rung, median) <= self.budget_s), below[-1])
        if self._climbed and now_s - self._since_s <= TAKEN_BACK_S:
            self._wait_s = min(2 * self._wait_s, MAX_WAIT_S)
        self._fell_s = now_s
        self._move(chosen, median, now_s)

    def _move(self, rung: int, median: float, now_s: float) -> None:
        self._before = self.rung, median
        self._climbed, self.rung, self._since_s = rung < self.rung, rung, now_s
        self._costs.clear()

    def _learn(self, median: float) -> None:
        """Compare the first median on a rung with the last on the previous rung; move half-way to that ratio."""
        if self._before is None:
            return
        rung, cost = self._before
        self._before = None
        measured = self._relative[rung] * median / max(cost, 1e-9)
        nominal = self.qualities[self.rung].relative_cost
        self._relative[self.rung] = min(max((self._relative[self.rung] + measured) / 2, nominal / 2), nominal * 2)


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
    drawing : RenderOptions
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
        drawing: RenderOptions = DEFAULT_RENDER_OPTIONS,
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
