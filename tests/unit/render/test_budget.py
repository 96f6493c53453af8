"""Holding a rate: the policy against a simulated machine, and once against a real renderer."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.live import MIN_WAIT_S, FrameBudget, LiveRenderer, Quality, ladder

RATE_HZ = 60.0
LADDER = ladder([15_000, 6_000], lit_at_pixels=True)


class Change(NamedTuple):
    """A change from one rung to another."""

    time_s: float
    before: int
    after: int


def simulate(
    best_s: Callable[[float], float], seconds: float, *, truth: list[float] | None = None, noise: float = 0.1
) -> tuple[FrameBudget, list[Change], list[tuple[float, float]]]:
    """A machine that draws the best rung in ``best_s(now)``, the others by ``truth``; returns times and costs too."""
    budget, rng = FrameBudget(LADDER, RATE_HZ), np.random.default_rng(5)
    relative = truth or [quality.relative_cost for quality in LADDER]
    now_s, changes, frames = 0.0, [], []
    while now_s < seconds:
        cost_s = best_s(now_s) * relative[budget.rung] * rng.lognormal(0, noise)
        now_s += max(cost_s, 1 / RATE_HZ)
        frames.append((now_s, cost_s))
        before = budget.rung
        budget.spent(cost_s, now_s)
        if budget.rung != before:
            changes.append(Change(now_s, before, budget.rung))
    return budget, changes, frames


def test_the_ladder_goes_down() -> None:
    costs = [quality.relative_cost for quality in LADDER]
    assert costs[0] == 1.0
    assert np.all(np.diff(costs) < 0)
    assert costs[-1] < 0.2
    assert [quality.samples for quality in LADDER[:3]] == [4, 0, 0]
    assert LADDER[2] == Quality(0, 1.0, "vertices", 0, LADDER[2].relative_cost)
    assert {quality.level for quality in LADDER} == {0, 1}
    assert LADDER[-1].samples == 1
    assert ladder([15_000], lit_at_pixels=False)[2].scale < 1  # light is at vertices already
    assert [quality.level for quality in ladder([9, 5, 3], lit_at_pixels=False)] == [0, 0, 0, 1, 1, 2, 2, 2, 2]


def test_a_machine_that_is_fast_enough_is_left_alone() -> None:
    budget, changes, _ = simulate(lambda now_s: 0.9 * 0.85 / RATE_HZ, 30.0, noise=0.05)
    assert changes == []
    assert budget.rung == 0


def test_a_load_is_met_within_a_second_and_forgotten_after_it() -> None:
    """From 10 s to 20 s everything takes three times as long."""
    budget, changes, frames = simulate(lambda now_s: 0.010 * (3 if 10 <= now_s < 20 else 1), 50.0)
    falls = [change for change in changes if change.after > change.before]
    assert 10 < falls[0].time_s < 11
    late = [now_s for now_s, cost_s in frames if cost_s > 1 / RATE_HZ]
    assert sum(11 < now_s < 20 for now_s in late) <= 0.03 * 9 * RATE_HZ
    assert sum(now_s < 10 or now_s > 20.5 for now_s in late) == 0
    assert budget.rung == 0
    assert len(changes) <= 2 + len(LADDER)


@pytest.mark.parametrize(("period_s", "heavy_s"), [(5.0, 1.0), (6.0, 2.0), (10.0, 1.0)])
def test_a_load_that_comes_and_goes_does_not_flicker(period_s: float, heavy_s: float) -> None:
    """Each climb is taken back; they become rare. Without the doubled waits there are 60 and more in five minutes."""
    _, changes, frames = simulate(lambda now_s: 0.010 * (3 if now_s % period_s < heavy_s else 1), 300.0)
    climbs = [change.time_s for change in changes if change.after < change.before]
    assert 3 <= len(climbs) <= 18
    assert sum(cost_s > 1 / RATE_HZ for _, cost_s in frames) < 0.01 * len(frames)


def test_what_a_rung_costs_is_learned() -> None:
    """The best two cost more than their estimates: tried, found too dear, and left alone."""
    truth = [quality.relative_cost for quality in LADDER]
    truth[0], truth[1] = 1.3, 1.15
    _, changes, frames = simulate(lambda now_s: 0.93 * 0.85 / RATE_HZ, 300.0, truth=truth)
    assert sum(change.after < change.before for change in changes) <= 3
    assert sum(cost_s > 1 / RATE_HZ for _, cost_s in frames) < 0.01 * len(frames)


def test_a_hopeless_machine_gets_the_cheapest_and_stays() -> None:
    budget, changes, _ = simulate(lambda now_s: 1.0, 60.0)
    assert budget.rung == len(LADDER) - 1
    assert len(changes) == 1
    assert changes[0].time_s < 5.0  # three frames of a second each, and the first


def test_a_single_slow_frame_is_forgiven() -> None:
    _, changes, frames = simulate(lambda now_s: 0.2 if 5 < now_s < 5.02 else 0.008, 20.0)
    assert sum(cost_s > 1 / RATE_HZ for _, cost_s in frames) == 1
    assert changes == []


@given(st.lists(st.floats(1e-5, 2.0), min_size=1, max_size=400), st.floats(0.0, 0.1))
def test_whatever_frames_cost_the_rung_is_on_the_ladder(costs: list[float], pause_s: float) -> None:
    budget, now_s, last_s = FrameBudget(LADDER, RATE_HZ), 0.0, None
    for cost_s in costs:
        before = budget.rung
        now_s += cost_s + pause_s
        budget.spent(cost_s, now_s)
        assert 0 <= budget.rung < len(LADDER)
        if budget.rung < before:
            assert budget.rung == before - 1
            assert last_s is None or now_s - last_s >= MIN_WAIT_S
        last_s = now_s if budget.rung != before else last_s


def test_words() -> None:
    assert str(Quality()) == "every pixel, the finest head"
    assert str(Quality(1, 0.5, "vertices", 1)) == (
        "50 % of the resolution, head 2, light at vertices, edges as they are"
    )


def test_refuses() -> None:
    with pytest.raises(UsageError, match="requires a level of detail"):
        ladder([], lit_at_pixels=True)
    with pytest.raises(UsageError, match="the ladder is empty"):
        FrameBudget([], 60.0)
    with pytest.raises(UsageError, match=r"got 0 Hz, expected 0\.1 to 1000"):
        FrameBudget(LADDER, 0.0)
    with pytest.raises(UsageError, match="live renderer: requires a mesh"):
        LiveRenderer([], rate_hz=60.0)


def test_a_real_renderer_obeys() -> None:
    """No machine draws this in half a millisecond without giving something up; any can in 10 seconds."""
    head, faps = build_head(), np.zeros(68)
    with LiveRenderer([head], RenderOptions(size=(1024, 1024)), rate_hz=1000.0) as live:
        best = live.draw(faps).astype(int)
        assert live.quality.shading == "auto"
        frames = 0
        while live.budget.rung + 1 < len(live.budget.qualities) and frames < 500:
            drawn = live.draw(faps)
            frames += 1
        assert live.quality.scale < 0.5
        assert drawn.shape == best.shape == (1024, 1024, 3)
        assert 0.2 < np.abs(live.draw(faps) - best).mean() < 8
        assert "35 % of the resolution" in str(live.quality)
        live.drawing = replace(live.drawing, camera=preset("profile"))
        painted = live.paint(faps)
        with live._context:  # not around paint(), which enters it, too, and then leaves it
            side = np.frombuffer(painted.read(), np.uint8).reshape(1024, 1024, 4)
        assert np.abs(side[..., :3].astype(int) - best).mean() > 5
    with LiveRenderer([head], RenderOptions(size=(64, 64)), rate_hz=0.1) as live:
        for _ in range(5):
            live.draw(faps)
        assert live.quality == live.budget.qualities[0]


def test_levels_of_detail_are_used() -> None:
    """By a clock that this test moves: frames take what it says."""
    head, now = build_head(), [0.0]

    def clock() -> float:
        now[0] += 0.02
        return now[0]

    with LiveRenderer([head, head], RenderOptions(size=(16, 16)), rate_hz=60.0, clock=clock) as live:
        for _ in range(150):
            live.draw(np.zeros(68))
        assert live.quality.level == 1
        assert set(live._renderers) == {0, 1}


def test_a_coarser_level_is_loaded_when_the_rate_asks_for_it() -> None:
    """By a clock that this test moves: frames take what it says."""
    head, now, loaded = build_head(), [0.0], []

    def clock() -> float:
        now[0] += 0.02
        return now[0]

    def load() -> FaceMesh:
        loaded.append(head)
        return head

    with LiveRenderer([head, load], RenderOptions(size=(16, 16)), rate_hz=60.0, clock=clock) as live:
        live.draw(np.zeros(68))
        assert not loaded
        for _ in range(150):
            live.draw(np.zeros(68))
        assert live.quality.level == 1
        assert loaded == [head]
