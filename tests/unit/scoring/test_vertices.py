"""Errors of meshes, by hand and against a plain program."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.scoring.vertices import FRAMES_AT_ONCE, vertex_errors

REST = np.zeros((4, 3))
TRUE = np.zeros((3, 4, 3))
TRUE[:, 3, 1] = (0.0, 3.0, 0.0)  # a brow: distances 0 3 0 from rest
MADE = TRUE.copy()
MADE[0, 0, 0] = 1.0  # a lip is 1 away in the first frame,
MADE[1, 1] = (3.0, 0.0, 4.0)  # another 5 in the second
MADE[1, 3, 1] = 1.5  # the brow moves half as far: 0 1.5 0


def test_by_hand() -> None:
    found = vertex_errors(MADE, TRUE, lips=[0, 1], upper=[3], neutral=REST)
    assert found.frames == 3
    assert found.lve == pytest.approx((1 + 5 + 0) / 3)
    assert found.lve_squared == pytest.approx((1 + 25 + 0) / 3)
    assert found.mve == pytest.approx((1 + 5 + 1.5) / 12)
    assert found.fdd == pytest.approx(np.sqrt(2) * (1 - 0.5))  # the deviation of 0 a 0 is a sqrt(2) / 3
    assert found.fdd_squared == pytest.approx(np.sqrt(2) / 3 * (9 - 2.25))


def test_as_the_programs_of_the_papers() -> None:
    """CodeTalker's main/cal_metric.py and FaceDiffuser's compute_objective_metrics.py, frame by frame."""
    rng = np.random.default_rng(4)
    rest = rng.normal(size=(9, 3))
    true = rest + rng.normal(size=(FRAMES_AT_ONCE + 3, 9, 3))
    made = true + rng.normal(size=true.shape)
    lips, upper = [5, 0, 2], [8, 3]
    found = vertex_errors(made.reshape(len(made), -1), true, lips=lips, upper=upper, neutral=rest.reshape(-1))
    squared = ((made - true) ** 2).sum(axis=2)
    assert found.lve_squared == pytest.approx(np.mean([max(frame[v] for v in lips) for frame in squared]))
    assert found.mve == pytest.approx(np.sqrt(squared).mean(axis=1).mean())
    dynamics = [np.mean([((each[:, v] - rest[v]) ** 2).sum(axis=1).std() for v in upper]) for each in (true, made)]
    assert found.fdd_squared == pytest.approx(dynamics[0] - dynamics[1])


def test_the_longer_one_is_cut_and_absent_vertices_give_none() -> None:
    found = vertex_errors(MADE[:1].astype(np.float32), TRUE)
    assert (found.frames, found.mve, found.lve, found.lve_squared, found.fdd) == (1, 0.25, None, None, None)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"made": MADE[:, :3]}, r"made: got shape \(3, 3, 3\), expected \(T, 4, 3\)"),
        ({"made": MADE[..., :2]}, r"made: got shape"),
        ({"against": np.zeros((0, 4, 3))}, r"against: got shape \(0, 4, 3\)"),
        ({"made": np.full((3, 4, 3), np.nan)}, "not finite"),
        ({"lips": [4]}, "lips: got vertices 4 to 4, expected 0 to 3"),
        ({"lips": [-1]}, "lips: got vertices -1"),
        ({"lips": [0.5]}, "lips: got float64"),
        ({"upper": [3]}, "upper: requires neutral"),
        ({"upper": [], "neutral": REST}, "upper: got"),
        ({"neutral": REST[:3]}, "neutral: got shape"),
    ],
)
def test_what_does_not_fit_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        vertex_errors(**{"made": MADE, "against": TRUE, **options})  # type: ignore[arg-type]
