"""Principal components and the viseme space, on motion whose modes are known."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.models.viseme_space import MARKERS, VisemeSpace, fit_components, fit_viseme_space, sample_phones

RNG = np.random.default_rng(3)
BASIS = np.linalg.qr(RNG.normal(size=(42, 3)))[0].T
WEIGHTS = RNG.normal(size=(400, 3)) * [9.0, 4.0, 1.5]
MOTION: NDArray[np.float64] = (WEIGHTS @ BASIS).reshape(400, 14, 3)
FOLLOW = RNG.normal(size=(3, 6))
FOLLOWERS = (WEIGHTS @ FOLLOW).reshape(400, 2, 3)


def space() -> VisemeSpace:
    return fit_viseme_space(MOTION, MARKERS, FOLLOWERS, ("2.2", "2.3"), mode_count=3)[0]


def test_components_are_orthonormal_ordered_and_canonical() -> None:
    vectors, variances = fit_components(MOTION.reshape(400, -1))
    assert vectors @ vectors.T == pytest.approx(np.eye(42), abs=1e-12)
    assert (np.diff(variances) <= 1e-12).all()
    biggest = np.abs(vectors).argmax(axis=1)
    assert (vectors[np.arange(42), biggest] > 0).all()
    assert variances[:3].sum() == pytest.approx(variances.sum())


def test_components_do_not_depend_on_frame_order_or_offset() -> None:
    flat = MOTION.reshape(400, -1)
    one, other = fit_components(flat)[0], fit_components(flat[::-1] + 1000.0)[0]
    assert other[:3] == pytest.approx(one[:3], abs=1e-8)


def test_the_way_there_and_back_is_exact() -> None:
    there = space().to_space(MOTION)
    back = space().to_points_mm(there)
    assert back[:, :14] == pytest.approx(MOTION, abs=1e-9)
    assert back[:, 14:] == pytest.approx(FOLLOWERS, abs=1e-9)


def test_rest_is_the_origin() -> None:
    assert not space().to_space(np.zeros((14, 3))).any()
    assert not space().to_points_mm(np.zeros(3)).any()


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_batch_axes_lead(batch: tuple[int, ...]) -> None:
    assert space().to_space(np.zeros((*batch, 14, 3))).shape == (*batch, 3)
    assert space().to_points_mm(np.zeros((*batch, 3))).shape == (*batch, 16, 3)


def test_phones_are_sampled_at_a_fraction_of_their_duration() -> None:
    ramp = np.arange(50.0)[:, None]  # the value is the frame number
    at = sample_phones(ramp, 25.0, [0.0, 0.4], [1.0, 0.8], 0.3)
    assert at[:, 0] == pytest.approx([7.5, (0.4 + 0.3 * 0.4) * 25])


def test_refuses() -> None:
    with pytest.raises(UsageError, match="at least 2"):
        fit_components(np.zeros((1, 3)))
    with pytest.raises(UsageError, match="mode_count: must be 1 to 42, got 43"):
        fit_viseme_space(MOTION, MARKERS, FOLLOWERS, ("2.2", "2.3"), mode_count=43)
    with pytest.raises(UsageError, match="followers_mm"):
        fit_viseme_space(MOTION, MARKERS, FOLLOWERS[:5], ("2.2", "2.3"), mode_count=3)
    with pytest.raises(UsageError, match="marker_count"):
        VisemeSpace(points=("2.1",), marker_count=2, modes_mm=np.zeros((1, 1, 3)))
    with pytest.raises(UsageError, match="modes_mm"):
        VisemeSpace(points=("2.1",), marker_count=1, modes_mm=np.zeros((1, 2, 3)))
