"""The finer heads of bench/render: more vertices, the same face."""

import numpy as np
import pytest

from bench.finer import finer, only_faps
from bench.render import PARTS, Draw, cases, growth, interleaved, spread
from bench.render_goals import FINE, REFERENCE, STAIRS
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def area_mm2(points: np.ndarray, triangles: np.ndarray) -> float:
    corners = points[triangles].astype(float)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(sides, axis=1).sum() / 2)


def test_a_finer_head_moves_as_the_head_does(head: FaceMesh) -> None:
    """Twice beyond one halving: every pattern of halved edges is there."""
    fine = finer(head, 71_000)
    assert len(fine.vertices_mm) == 71_000
    assert area_mm2(fine.vertices_mm, fine.triangles) == pytest.approx(area_mm2(head.vertices_mm, head.triangles), 1e-5)
    assert len(np.unique(np.sort(fine.triangles, axis=1), axis=0)) > 4.4 * len(head.triangles)
    faps = np.zeros(68)
    for number, value in {3: 300, 5: -250, 10: -200, 19: 500, 20: 900, 31: 150, 49: 9000}.items():
        faps[fap.column(number)] = value
    coarse_moved, fine_moved = deform(head, faps), deform(fine, faps)
    assert fine_moved[: len(coarse_moved)] == pytest.approx(coarse_moved, abs=1e-4)
    # Bones turn and halves do not: an arc of 5 mm at the chin is 0.05 mm high.
    assert area_mm2(fine_moved, fine.triangles) == pytest.approx(area_mm2(coarse_moved, head.triangles), rel=2e-3)


def test_only_some_faps(head: FaceMesh) -> None:
    still = only_faps(head, {19})
    jaw_and_lid = np.zeros((2, 68))
    jaw_and_lid[0, fap.column(5)] = -300
    jaw_and_lid[1, fap.column(19)] = 700
    moved = np.abs(deform(still, jaw_and_lid) - head.vertices_mm).max(axis=(1, 2))
    assert moved[0] < 1e-4
    assert moved[1] > 3
    assert deform(still, jaw_and_lid[1]) == pytest.approx(deform(head, jaw_and_lid[1]))


def test_every_case_is_on_its_curve(head: FaceMesh) -> None:
    made = cases(head, finer(head, 20_000), finer(head, 30_000))
    assert len(made["26,000 vertices"].mesh.vertices_mm) == 26_000
    curves = growth(made, dict.fromkeys(made, 1.0))
    assert {kind: len(points) for kind, points in curves.items()} == {"vertices": 6, "faps": 7, "pixels": 7}
    assert [count for count, _ in curves["vertices"]][-1] == 71_000
    assert curves["faps"][0][0] == 0
    unusual = sum(not case.is_usual for case in made.values())
    both = {STAIRS, FINE}  # other light and other edges, as peers draw
    assert unusual == len(PARTS) - 1 + len(both & set(made))
    assert sum(map(len, curves.values())) == len(made) - unusual + 2  # the default head is on all three


def test_a_busy_machine_slows_both_sides_of_a_ratio() -> None:
    """A neighbour that comes and goes in waves: the contender takes three times as long throughout."""
    now = [0.0]

    def contender(cost_s: float) -> Draw:
        def draw(count: int) -> float:
            took = 0.0
            for _ in range(count):
                frame = cost_s * (1.0 + 2.0 * (np.sin(now[0] * 0.7) > 0))
                now[0] += frame
                took += frame
            return took

        return draw

    times, ratios = interleaved({"slow": contender(0.03), REFERENCE: contender(0.01)}, 41)
    assert spread(ratios["slow"])["ratio"] == pytest.approx(3.0, rel=0.1)
    assert spread(ratios["slow"])["low"] <= spread(ratios["slow"])["ratio"] <= spread(ratios["slow"])["high"]
    assert min(times[REFERENCE]) == pytest.approx(10.0)  # ms
    assert ratios[REFERENCE] == []
    assert len(times[REFERENCE]) == 82
