"""Points from two cameras, where the points are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.errors import UsageError
from fapengine.geometry.rigid import triangulate

FOCAL_PX, AWAY_MM = 1400.0, 1000.0


def cameras(*angles_deg: float) -> np.ndarray:
    """Cameras a metre away on a circle around the face, (C, 3, 4)."""
    inner = np.array([[FOCAL_PX, 0, 640], [0, FOCAL_PX, 360], [0, 0, 1.0]])
    turns = [Rotation.from_euler("y", angle, degrees=True).as_matrix() for angle in angles_deg]
    return np.stack([inner @ np.column_stack([turn, [0, 0, AWAY_MM]]) for turn in turns])


def images_of(points: np.ndarray, views: np.ndarray) -> np.ndarray:
    shown = np.einsum("cij,tmj->ctmi", views[:, :, :3], points) + views[:, None, None, :, 3]
    return shown[..., :2] / shown[..., 2:]


def face(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 60, (20, 12, 3))


@pytest.mark.parametrize("angles", [(-10, 10), (-25, 5, 30)])
def test_points_are_found_exactly(angles):
    points, views = face(1), cameras(*angles)
    found, residual = triangulate(images_of(points, views), views)
    np.testing.assert_allclose(found, points, atol=1e-8)
    assert residual.max() < 1e-8


def test_noise_of_an_image_stays_small_and_shows_in_the_residual():
    points, views = face(2), cameras(-20, 20)
    noise = np.random.default_rng(3).normal(0, 0.2, (2, 20, 12, 2))
    found, residual = triangulate(images_of(points, views) + noise, views)
    assert np.linalg.norm(found - points, axis=-1).mean() < 0.5  # 0.2 px are 0.14 mm here, and more along the view
    assert 0.05 < residual.mean() < 0.2


def test_a_point_that_one_camera_sees_is_a_gap():
    points, views = face(4), cameras(-20, 0, 20)
    seen = images_of(points, views)
    seen[0, 3, 5] = seen[:2, 7, 1] = seen[:, 9, 2] = np.nan
    seen[2, 3, 6] = np.inf
    found, residual = triangulate(seen, views)
    np.testing.assert_allclose(found[3, 5:7], points[3, 5:7], atol=1e-8)
    gaps = [[7, 1], [9, 2]]
    assert np.argwhere(np.isnan(found).all(axis=-1)).tolist() == np.argwhere(np.isnan(residual)).tolist() == gaps


def test_what_cannot_be_is_told():
    points, views = face(5), cameras(-20, 20)
    seen = images_of(points, views)
    with pytest.raises(UsageError, match="got 1, expected at least 2"):
        triangulate(seen[:1], views[:1])
    with pytest.raises(UsageError, match="cameras: got shape"):
        triangulate(seen, views[:1])
    seen[1] = np.nan
    with pytest.raises(UsageError, match="camera 1 sees no point"):
        triangulate(seen, views)
