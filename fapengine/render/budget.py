"""How good a live face may be drawn, so that frames keep coming at the rate asked for.

Theory of operation
-------------------
A *ladder* lists qualities from the best to the cheapest; the *rung* is the one in use. Each frame's cost is told to
:meth:`FrameBudget.spent`; time is an argument. While the median of the last half second fits the budget, nothing
happens. When it does not, the rung falls at once to the first that is estimated to fit: a rung's estimate is the
median, scaled by the ratio of relative costs, and these are learned from what the rungs turn out to cost. When the next
better rung is estimated to fit with room to spare for a while, the rung climbs by one. A climb that has to be taken
back doubles the wait before the next one, so that a load between two rungs does not make the picture flicker; five
minutes without a fall forgive.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan

from fapengine.errors import UsageError
from fapengine.render.model import Shading

RATES_HZ = (0.1, 1000.0)
SHARE = 0.85
"""Of a frame's time that drawing may take; the rest is for what else a frame needs."""
ROOM = 0.85
"""Of the budget that a better rung may be estimated to take."""
PATIENCE_S, AT_LEAST = 0.5, 3
"""Over what time, and how many frames, costs are looked at before the rung falls."""
SETTLE_S, LONGEST_WAIT_S, PEACE_S = 2.0, 64.0, 300.0
"""How long the rung stays before it climbs, at first and at most; and how long without a fall forgives."""
TAKEN_BACK_S = 15.0
"""A fall so soon after a climb takes it back."""
VERTEX_SHARE, LIGHT_SHARE, SOFTENING_SHARE, MULTISAMPLING = 0.35, 0.28, 0.18, 1.3
"""On llvmpipe, 512 x 512: of a frame with softened edges, work on vertices; of the rest, light at pixels and softening;
and what multisampling adds, as a multiple of that rest."""
EDGES = {0: "softened edges", 1: "edges as they are"}
SCALES = (1.0, 0.85, 0.7, 0.5, 0.35)


@dataclass(frozen=True, slots=True)
class Quality:
    """One rung."""

    level: int = 0
    """Which head, 0 the finest."""
    scale: float = 1.0
    """Drawn sides to shown sides."""
    shading: Shading = "auto"
    samples: int = 4
    """How edges are smoothed: 4 multisampled, 0 softened after drawing, 1 not at all."""
    relative_cost: float = 1.0
    """Estimate: to that of the best."""

    def __str__(self) -> str:
        """Say what is given up."""
        parts = [
            "every pixel" if self.scale == 1 else f"{100 * self.scale:.0f} % of the resolution",
            "the finest head" if self.level == 0 else f"head {self.level + 1}",
            *(["light at vertices"] if self.shading == "vertices" else []),
            *([] if self.samples > 1 else [EDGES[self.samples]]),
        ]
        return ", ".join(parts)


def ladder(vertices: Sequence[int], *, lit_at_pixels: bool) -> tuple[Quality, ...]:
    """Qualities from the best to the cheapest.

    Parameters
    ----------
    vertices : sequence of int
        Of each level of detail, the finest first.
    lit_at_pixels : bool
        Whether the finest is lit at pixels by its own choice; if so, light at vertices is given up first.

    Raises
    ------
    UsageError
        If there is no level.
    """
    if not vertices:
        raise UsageError("ladder: got no level of detail, expected one or more")
    wishes: list[tuple[int, float, Shading, int]] = [(0, 1.0, "auto", 4), (0, 1.0, "auto", 0)]
    if lit_at_pixels:
        wishes.append((0, 1.0, "vertices", 0))
    shading = wishes[-1][2]
    coarsest = len(vertices) - 1
    for step, scale in enumerate(SCALES[1:], start=1):
        wishes.append((min(step - 1, coarsest), scale, shading, 0))
        if min(step, coarsest) != min(step - 1, coarsest):
            wishes.append((min(step, coarsest), scale, shading, 0))
    wishes.append((coarsest, SCALES[-1], shading, 1))
    costs = [_cost(*wish, vertices, lit_at_pixels=lit_at_pixels) for wish in wishes]
    return tuple(Quality(*wish, relative_cost=cost / costs[0]) for wish, cost in zip(wishes, costs, strict=True))


def _cost(
    level: int, scale: float, shading: Shading, samples: int, vertices: Sequence[int], *, lit_at_pixels: bool
) -> float:
    """In frames of the finest head with softened edges."""
    saved = LIGHT_SHARE * (shading == "vertices" and lit_at_pixels) + SOFTENING_SHARE * (samples == 1)
    pixels = scale**2 * (1 - saved + MULTISAMPLING * (samples > 1))
    return VERTEX_SHARE * vertices[level] / vertices[0] + (1 - VERTEX_SHARE) * pixels


@dataclass(frozen=True, slots=True)
class Change:
    """The rung moved."""

    time_s: float
    before: int
    after: int
    cost_s: float
    """Median of a frame before."""
    budget_s: float

    @property
    def is_worse(self) -> bool:
        """Whether quality was given up."""
        return self.after > self.before


class FrameBudget:
    """Stateful: holds a rate by choosing a rung.

    Parameters
    ----------
    qualities : sequence of Quality
        The ladder, best first.
    rate_hz : float
        Frames a second to hold, 0.1..1000.

    Raises
    ------
    UsageError
        If the ladder is empty or the rate out of range.
    """

    def __init__(self, qualities: Sequence[Quality], rate_hz: float) -> None:
        if not qualities:
            raise UsageError("budget: got an empty ladder, expected one quality or more")
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            raise UsageError(f"budget: got {rate_hz:g} Hz, expected {RATES_HZ[0]:g} to {RATES_HZ[1]:g}")
        self.qualities, self.rate_hz, self.rung = tuple(qualities), rate_hz, 0
        self.late = 0
        """Frames that took longer than a frame's time."""
        self._relative = [quality.relative_cost for quality in qualities]
        self._costs: deque[tuple[float, float]] = deque()
        self._since_s = float("nan")
        self._fell_s = float("-inf")
        self._wait_s, self._climbed = SETTLE_S, False
        self._before: tuple[int, float] | None = None

    @property
    def budget_s(self) -> float:
        """What drawing a frame may cost."""
        return SHARE / self.rate_hz

    @property
    def quality(self) -> Quality:
        """The rung in use."""
        return self.qualities[self.rung]

    def spent(self, cost_s: float, now_s: float) -> Change | None:
        """Tell what a frame cost, drawn with :attr:`quality` and ready at ``now_s``; return what changed."""
        self.late += cost_s > 1 / self.rate_hz
        if isnan(self._since_s):
            self._since_s = now_s
        self._costs.append((now_s, cost_s))
        while now_s - self._costs[0][0] > SETTLE_S and len(self._costs) > AT_LEAST:
            self._costs.popleft()
        recent = [cost for time_s, cost in self._costs if now_s - time_s <= PATIENCE_S]
        if len(recent) < AT_LEAST:
            recent = [cost for _, cost in self._costs][-AT_LEAST:]
        stays_s = now_s - self._since_s
        if len(recent) >= AT_LEAST and (stays_s >= PATIENCE_S or sum(recent) >= PATIENCE_S):
            median = _median(recent)
            self._learn(median)
            if median > self.budget_s and self.rung + 1 < len(self.qualities):
                return self._fall(median, now_s)
        if now_s - self._fell_s > PEACE_S:
            self._wait_s = SETTLE_S
        if self.rung and stays_s >= self._wait_s:
            return self._climb(_median([cost for _, cost in self._costs]), now_s)
        return None

    def _estimate(self, rung: int, median: float) -> float:
        return median * self._relative[rung] / self._relative[self.rung]

    def _fall(self, median: float, now_s: float) -> Change:
        """To the first rung that is estimated to fit, or the last."""
        below = range(self.rung + 1, len(self.qualities))
        chosen = next((rung for rung in below if self._estimate(rung, median) <= self.budget_s), below[-1])
        if self._climbed and now_s - self._since_s <= TAKEN_BACK_S:
            self._wait_s = min(2 * self._wait_s, LONGEST_WAIT_S)
        self._fell_s = now_s
        return self._move(chosen, median, now_s)

    def _climb(self, median: float, now_s: float) -> Change | None:
        """By one rung, if it is estimated to fit with room."""
        if self._estimate(self.rung - 1, median) > ROOM * self.budget_s:
            return None
        return self._move(self.rung - 1, median, now_s)

    def _move(self, rung: int, median: float, now_s: float) -> Change:
        change = Change(now_s, self.rung, rung, median, self.budget_s)
        self._before = self.rung, median
        self._climbed, self.rung, self._since_s = rung < self.rung, rung, now_s
        self._costs.clear()
        return change

    def _learn(self, median: float) -> None:
        """Compare the first median on a rung with the last one on the rung before, and move half-way to that ratio."""
        if self._before is None:
            return
        rung, cost = self._before
        self._before = None
        seen = self._relative[rung] * median / max(cost, 1e-9)
        nominal = self.qualities[self.rung].relative_cost
        self._relative[self.rung] = min(max((self._relative[self.rung] + seen) / 2, nominal / 2), nominal * 2)


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]
