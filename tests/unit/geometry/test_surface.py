import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.geometry.surface import Surface, ambient_light, vertex_normals


def hill(count=21, size=100.0):
    """A smooth sheet over a square grid, counter-clockwise seen from +z."""
    x, y = np.meshgrid(np.linspace(-size, size, count), np.linspace(-size, size, count))
    vertices = np.stack([x.ravel(), y.ravel(), 30 * np.exp(-(x**2 + y**2) / 4000).ravel()], axis=1)
    at = np.arange(count * count).reshape(count, count)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@settings(max_examples=8)
@given(st.integers(0, 10**9))
def test_closest_places_are_the_closest(seed):
    surface = Surface(*hill())
    rng = np.random.default_rng(seed)
    points = rng.uniform([-80, -80, -10], [80, 80, 50], (10, 3))
    places, _, _ = surface.closest(points)
    corners = surface.vertices_mm[surface.triangles]
    weights = rng.dirichlet([1, 1, 1], (200, len(corners)))
    tried = np.einsum("sfc,fca->sfa", weights, corners).reshape(-1, 3)
    for point, place in zip(points, places, strict=True):
        best = np.linalg.norm(tried - point, axis=1).min()
        assert best - 0.6 < np.linalg.norm(place - point) <= best + 1e-9  # the sample is not quite dense


def test_points_on_the_surface_are_their_own_places():
    surface = Surface(*hill())
    rng = np.random.default_rng(1)
    corners = surface.vertices_mm[surface.triangles[rng.integers(0, len(surface.triangles), 50)]]
    points = np.einsum("nc,nca->na", rng.dirichlet([1, 1, 1], 50), corners)
    places, normals, on_rim = surface.closest(points)
    np.testing.assert_allclose(places, points, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-9)
    assert (normals[:, 2] > 0.5).all()
    assert not on_rim.any()


def test_beyond_the_edge_the_rim_answers():
    surface = Surface(*hill())
    places, _, on_rim = surface.closest([[150.0, 3.0, 0.0], [0.0, 0.0, 40.0], [130.0, 130.0, 0.0]])
    assert on_rim.tolist() == [True, False, True]
    assert places[0, 0] == pytest.approx(100.0)
    np.testing.assert_allclose(places[2, :2], [100, 100])


def test_lines_meet_the_surface_on_either_side_within_reach():
    surface = Surface(*hill())
    up = np.array([[12.0, 7.0, 60.0], [12.0, 7.0, -10.0], [12.0, 7.0, 60.0], [300.0, 0.0, 0.0]])
    places, met = surface.meet(up, np.tile([0.0, 0.0, 2.0], (4, 1)), 45.0)
    assert met.tolist() == [True, True, True, False]
    assert places[0, 2] == pytest.approx(places[1, 2])
    assert places[0, 2] == pytest.approx(30 * np.exp(-(144 + 49) / 4000), abs=0.5)
    np.testing.assert_array_equal(places[3], up[3])
    assert not surface.meet(up[:1], [[0.0, 0.0, 1.0]], 5.0)[1].any()


def test_normals_of_a_batch():
    vertices, triangles = hill(5)
    one = vertex_normals(vertices, triangles)
    two = vertex_normals(np.stack([vertices, vertices * [1, 1, -1]]), triangles)
    np.testing.assert_allclose(two[0], one)
    np.testing.assert_allclose(two[1], one * [-1, -1, 1])
    unused = vertex_normals(np.concatenate([vertices, [[0, 0, 0]]]), triangles)
    assert unused[-1].tolist() == [0, 0, 1]
    assert vertex_normals(vertices[:2], np.zeros((0, 3), int)).tolist() == [[0, 0, 1]] * 2


def test_triangles_must_name_vertices():
    for triangles in (np.zeros((0, 3), int), [[0, 1, 3]], [[-1, 0, 1]]):
        with pytest.raises(UsageError, match="vertex indices 0 to 2"):
            Surface(np.eye(3), triangles)
    with pytest.raises(UsageError, match="points_mm"):
        Surface(np.eye(3), [[0, 1, 2]]).closest([[np.nan, 0, 0]])


def test_values_are_carried_linearly():
    vertices, triangles = hill()
    values = np.stack([vertices[:, 0] / 100, vertices[:, 1] / 50], axis=1)
    points = np.random.default_rng(2).uniform(-60, 60, (30, 3)) * [1, 1, 0] + [0, 0, 30]
    surface = Surface(vertices, triangles)
    places = surface.closest(points)[0]
    np.testing.assert_allclose(surface.carry(values, points), places[:, :2] / [100, 50], atol=1e-9)


def test_some_vertices_get_the_same_ambient_light_as_with_all_others():
    vertices, triangles = hill(81)
    vertices = np.concatenate([vertices, vertices + np.array([0, 0, 40.0])])  # the upper sheet shades the lower one
    normals = vertex_normals(vertices, np.concatenate([triangles, triangles + len(vertices) // 2]))
    light = ambient_light(vertices, normals)
    chosen = np.arange(3, len(vertices), 7)
    np.testing.assert_allclose(ambient_light(vertices, normals, chosen), light[chosen], atol=1e-12)
    lower, upper = np.split(light, 2)
    assert upper.mean() > 2 * lower.mean()
