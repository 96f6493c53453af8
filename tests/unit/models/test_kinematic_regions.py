import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.models.subset import MarkerSubset
from fapengine.models.subset_study import interpolate_regions

GRID = np.stack(
    [axis.ravel() for axis in np.meshgrid(np.linspace(-50, 50, 7), np.linspace(-60, 60, 8))] + [np.zeros(56)], 1
)


def subset():
    """Marker 10 moves its neighbourhood with it and the far corner against it; marker 40 all the rest."""
    x, y, _ = GRID.T
    weight = np.exp(-((x - x[10]) ** 2 + (y - y[10]) ** 2) / 900) - 0.5 * np.exp(-((x - 50) ** 2 + (y - 60) ** 2) / 900)
    return MarkerSubset(np.array([10, 40]), np.stack([weight, 1 - weight]), 0.0)


def test_weights_are_kept_at_markers_and_smooth_between():
    regions = interpolate_regions(subset(), GRID, GRID)
    np.testing.assert_allclose(regions.weights, subset().weights, atol=1e-9)
    between = GRID[:-1] / 2 + GRID[1:] / 2
    x, y, _ = between.T
    at = GRID[10]
    truth = np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / 900) - 0.5 * np.exp(-((x - 50) ** 2 + (y - 60) ** 2) / 900)
    assert np.abs(interpolate_regions(subset(), GRID, between).weights[0] - truth).max() < 0.06


def test_markers_at_one_place_count_by_their_mean():
    """As those of lips that are shut."""
    markers, weights = np.vstack([GRID, GRID[10]]), np.column_stack([subset().weights, [0.0, 0.0]])
    regions = interpolate_regions(MarkerSubset(np.array([10, 40]), weights, 0.0), markers, GRID)
    expected = subset().weights.copy()
    expected[:, 10] /= 2
    np.testing.assert_allclose(regions.weights, expected, atol=1e-9)


def test_lips_that_are_shut_leave_no_spikes():
    """Two rims nearly at one place that move against each other: a function through both leaves all bounds."""
    markers = np.vstack([GRID, GRID[10] + [0.0, 0.05, 0.0], GRID[10] - [0.0, 0.05, 0.0]])
    weights = np.column_stack([subset().weights, [1.0, 0.0], [-1.0, 0.0]])
    points = np.stack(
        [*map(np.ravel, np.meshgrid(np.linspace(-50, 50, 40), np.linspace(-60, 60, 40))), np.zeros(1600)], 1
    )
    found = interpolate_regions(MarkerSubset(np.array([10, 40]), weights, 0.0), markers, points).weights
    assert np.abs(found).max() < 1.5 * np.abs(weights).max()


def test_negative_regions_and_the_hull():
    points = np.array([GRID[10] + [3, 3, 20], [45.0, 55, 0], [-45, 55, 0], [200, 0, 0]])
    regions = interpolate_regions(subset(), GRID, points)
    assert regions.inside.tolist() == [True, True, True, False]
    assert regions.weights[0, 1] < -0.1 < 0.1 < regions.weights[0, 0]  # a negative region
    assert np.isfinite(regions.weights).all()


def test_points_follow_their_markers():
    regions = interpolate_regions(subset(), GRID, GRID[:5])
    primary = np.random.default_rng(0).normal(0, 1, (6, 2, 3))
    np.testing.assert_allclose(regions.weights.T @ primary, subset().synthesise(primary)[:, :5], atol=1e-9)


def test_too_few_or_other_markers_are_refused():
    with pytest.raises(UsageError, match="at least 4 markers, got 3"):
        interpolate_regions(MarkerSubset(np.array([0]), np.ones((1, 3)), 0.0), np.eye(3), np.eye(3))
    with pytest.raises(UsageError, match="markers_mm: got shape"):
        interpolate_regions(subset(), GRID[:-1], GRID)
