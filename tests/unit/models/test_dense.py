import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.geometry.surface import Surface, continue_smoothly, edges_of
from fapengine.models import dense as dense_modes
from fapengine.models.dense import bind, fit_dense_modes, remesh, sparse_facets

INNER = np.arange(41 * 41).reshape(41, 41)[2:-2:3, 2:-2:3].ravel()
"""Every third vertex of the mask each way is a marker."""


def postures(mask, scores):
    vertices, triangles, modes = mask()
    return vertices + np.tensordot(scores, modes, axes=1), triangles


def test_a_bound_vertex_comes_back_in_its_own_posture_and_turns_with_it(mask):
    faces, triangles = postures(mask, np.array([[0.0, 0, 0], [1.0, -1, 0.5]]))
    facets = sparse_facets(faces[:, INNER])
    binding = bind(Surface(faces[0], triangles), faces[0, INNER], facets)
    assert binding.bound.mean() > 0.9
    turn = Rotation.from_rotvec([0.4, 1.0, -0.3]).as_matrix()
    for move in (np.eye(3), turn):
        feet, directions = binding.lines(faces[0, INNER] @ move.T + 5, facets)
        back = feet + binding.height_mm[:, None] * directions
        np.testing.assert_allclose(back[binding.bound], (faces[0] @ move.T + 5)[binding.bound], atol=1e-6)
    np.testing.assert_allclose(binding.weights.sum(axis=1), 1)


def test_a_scan_with_other_vertices_gets_those_of_the_reference(mask):
    scores = np.array([[0.0, 0, 0], [1.5, -1, 1], [-1, 1, -1]])
    faces, triangles = postures(mask, scores)
    facets = sparse_facets(faces[:, INNER])
    reference = Surface(faces[0], triangles)
    binding = bind(reference, faces[0, INNER], facets)
    rng = np.random.default_rng(1)
    other = rng.permutation(len(faces[0]))  # the scanner numbers its vertices as it likes
    place = np.argsort(other)
    scan = Surface(faces[1][other], place[triangles])
    found, met = remesh(binding, reference, scan, faces[1, INNER], facets)
    assert met.mean() > 0.8
    off = np.linalg.norm(found - faces[1], axis=1)
    moved = np.linalg.norm(faces[1] - faces[0], axis=1)
    assert off[met].mean() < 0.25  # mm; the deformation is up to 13
    assert off.mean() < 0.06 * moved.max()
    np.testing.assert_allclose(remesh(binding, reference, reference, faces[0, INNER], facets)[0], faces[0], atol=1e-6)


def test_a_hole_in_the_scan_is_closed_from_its_neighbours(mask):
    faces, triangles = postures(mask, np.array([[0.0, 0, 0], [1.5, -1, 1]]))
    facets = sparse_facets(faces[:, INNER])
    reference = Surface(faces[0], triangles)
    hole = np.linalg.norm(faces[1] - faces[1, 41 * 12 + 20], axis=1) < 15
    scan = Surface(faces[1], triangles[~hole[triangles].any(axis=1)])
    binding = bind(reference, faces[0, INNER], facets)
    found, met = remesh(binding, reference, scan, faces[1, INNER], facets)
    assert not met[hole].any()
    assert np.linalg.norm(found - faces[1], axis=1)[hole].mean() < 1.0


def test_a_scan_elsewhere_is_refused(mask):
    faces, triangles = postures(mask, np.array([[0.0, 0, 0], [1.5, -1, 1]]))
    facets = sparse_facets(faces[:, INNER])
    reference = Surface(faces[0], triangles)
    with pytest.raises(DataError, match="only 0 of"):
        remesh(
            bind(reference, faces[0, INNER], facets),
            reference,
            Surface(faces[0] + 500, triangles),
            faces[0, INNER],
            facets,
        )


def test_facets_do_not_bridge_the_mouth(mask):
    vertices, _, _ = mask()
    markers = vertices[INNER]
    opened = markers.copy()
    lower = (markers[:, 1] < -20) & (np.abs(markers[:, 0]) < 40)
    opened[lower] -= [0, 25, 0]
    edges = {False: 0, True: 0}
    for open_too in edges:
        facets = sparse_facets(np.stack([markers, opened]) if open_too else markers[None])
        mixed = lower[facets].any(axis=1) & ~lower[facets].all(axis=1)
        edges[open_too] = int((mixed & (np.abs(markers[facets][..., 0]) < 30).all(axis=1)).sum())
    a, b, c = (markers[sparse_facets(markers[None])[:, index]] for index in range(3))
    assert (np.cross(b - a, c - a) * [1, 0, 1] * (a + b + c)).sum(axis=1).min() > 0  # all face outwards
    assert edges[False] > 0
    assert edges[True] == 0
    with pytest.raises(DataError, match="facets stays together"):
        sparse_facets(50 * markers[None])


def test_lips_that_touch_on_the_reference_part_on_other_scans(mask):
    """The markers of the lower lip are farther from its rim than those of the upper lip, through the air."""
    vertices, triangles, _ = mask()
    at = np.arange(len(vertices)).reshape(41, 41)
    rows, lips = np.indices(at.shape)[0].ravel(), np.abs(vertices[:, 0]) < 35
    vertices[(rows == 13) & lips, 1] = vertices[at[14, 20], 1] - 0.4  # the rim of the lower lip; row 14 is the upper's
    slit = np.isin(triangles, at[13]).any(axis=1) & np.isin(triangles, at[14]).any(axis=1) & lips[triangles].any(axis=1)
    triangles = triangles[~slit]
    opened = vertices.copy()
    opened[:, 1] -= np.where((rows < 14) & lips, 12 * np.cos(vertices[:, 0] / 35 * np.pi / 2), 0)
    reference, scan = Surface(vertices, triangles), Surface(opened, triangles)
    along = reference.distances_along(vertices[at[14, 20]][None])[0]
    assert along[at[13, 20]] > 60  # round the corner of the mouth
    assert along[at[15, 20]] == pytest.approx(4.5, abs=1.5)
    facets = sparse_facets(np.stack([vertices[INNER], opened[INNER]]))
    found, _ = remesh(bind(reference, vertices[INNER], facets), reference, scan, opened[INNER], facets)
    edges = edges_of(triangles)
    before, after, truth = (
        np.linalg.norm(face[edges[:, 0]] - face[edges[:, 1]], axis=1) for face in (vertices, found, opened)
    )
    assert not ((after > 6) & (after > 1.6 * before) & (after > 1.6 * truth)).any()
    rim = (rows == 13) & lips
    assert np.linalg.norm(found - opened, axis=1)[rim].max() < 3.0
    found, _ = remesh(bind(scan, opened[INNER], facets), scan, reference, vertices[INNER], facets)  # an open reference
    assert np.linalg.norm(found - vertices, axis=1)[rim].max() < 3.0


def test_smooth_continuation_continues_straight_and_does_not_cross_a_slit(mask):
    vertices, triangles, _ = mask()
    linear = vertices @ np.array([[0.1, 0, 0], [0, 0.05, 0], [0, 0, 0]])
    known = np.random.default_rng(2).random(len(vertices)) < 0.5
    found = continue_smoothly(np.where(known[:, None], linear, 0.0), known, triangles)
    assert np.array_equal(found[known], linear[known])
    assert np.linalg.norm(found - linear, axis=1).max() < 0.5
    upper = vertices[:, 1] > 0
    slit = triangles[upper[triangles].all(axis=1) | (~upper)[triangles].all(axis=1)]
    step = np.where(upper[:, None], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0])
    sparse = np.random.default_rng(3).random(len(vertices)) < 0.1
    apart = continue_smoothly(np.where(sparse[:, None], step, 0.0), sparse, slit)
    np.testing.assert_allclose(apart, step, atol=1e-4)
    lonely = continue_smoothly(np.where((sparse & upper)[:, None], step, 0.0), sparse & upper, slit)
    np.testing.assert_allclose(lonely[~upper], np.broadcast_to([0.0, 1.0, 0.0], lonely[~upper].shape), atol=1e-4)
    assert np.array_equal(continue_smoothly(linear, np.ones(len(linear), bool), triangles), linear)
    with pytest.raises(UsageError, match="known: contains no vertex"):
        continue_smoothly(linear, np.zeros(len(linear), bool), triangles)


@settings(max_examples=15)
@given(st.integers(0, 10**9))
def test_exact_faces_give_exact_modes(seed):
    rng = np.random.default_rng(seed)
    z, mean, modes = rng.normal(0, 1, (15, 7)), rng.normal(0, 50, (30, 3)), rng.normal(0, 2, (7, 30, 3))
    dense = fit_dense_modes(mean + np.tensordot(z, modes, axes=1), z)
    assert dense.ridge <= 1e-3
    np.testing.assert_allclose(dense.mean_mm, mean, atol=1e-6)
    np.testing.assert_allclose(dense.modes_mm, modes, atol=1e-6)
    np.testing.assert_allclose(dense.faces_mm(z[3]), mean + np.tensordot(z[3], modes, axes=1), atol=1e-6)
    assert dense.left_out_mm < 1e-3  # products of numbers lose half the digits


def test_the_ridge_is_chosen_by_left_out_postures_and_spares_the_mean(monkeypatch):
    def with_ridge(faces, z, ridge):
        with monkeypatch.context() as patch:
            patch.setattr(dense_modes, "RIDGES", (ridge,))
            return fit_dense_modes(faces, z)

    rng = np.random.default_rng(4)
    z, mean, modes = rng.normal(0, 1, (12, 7)), rng.normal(0, 50, (30, 3)), rng.normal(0, 1, (7, 30, 3))
    faces = mean + np.tensordot(z, modes, axes=1) + rng.normal(0, 2.0, (12, 30, 3))
    chosen, plain = fit_dense_modes(faces, z), with_ridge(faces, z, 0.0)
    assert chosen.ridge > 0
    new = rng.normal(0, 1, (200, 7))
    truth = mean + np.tensordot(new, modes, axes=1)
    off = [np.linalg.norm(dense.faces_mm(new) - truth, axis=-1).mean() for dense in (chosen, plain)]
    assert off[0] < off[1]
    far = fit_dense_modes(faces + 100, z)
    np.testing.assert_allclose(far.mean_mm, chosen.mean_mm + 100, atol=1e-6)
    np.testing.assert_allclose(far.modes_mm, chosen.modes_mm, atol=1e-6)
    left = []
    for out in range(12):
        rest = np.arange(12) != out
        other = with_ridge(faces[rest], z[rest], chosen.ridge)
        left.append(((other.faces_mm(z[out]) - faces[out]) ** 2).sum(-1))
    assert chosen.left_out_mm == pytest.approx(np.sqrt(np.mean(left)), rel=1e-6)


def test_fewer_postures_than_modes_stay_finite():
    rng = np.random.default_rng(5)
    z = rng.normal(0, 1, (6, 7))
    faces = 50 + np.tensordot(z, rng.normal(0, 1, (7, 30, 3)), axes=1)
    dense = fit_dense_modes(faces, z)
    assert np.abs(dense.faces_mm(rng.normal(0, 1, (20, 7))) - 50).max() < 30
    with pytest.raises(UsageError, match="at least 2 postures, got 1"):
        fit_dense_modes(faces[:1], z[:1])
