from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion
from fapengine.geometry.surface import Surface
from fapengine.models import scans
from fapengine.models.missing import GapModel
from fapengine.models.scans import fit_scan

CORNERS = [2, 18, 40, 60, 100, 118]


@pytest.fixture
def case(mask):
    return partial(make_case, mask)


def make_case(mask, seed=0, noise=0.0, nose_mm=25.0, size=1.0):
    """A sparse model on a dense mask, and a scan of it in a known pose and face."""
    rng = np.random.default_rng(seed)
    vertices, triangles, modes = mask(nose_mm)
    inner = np.arange(41 * 41).reshape(41, 41)[3:-3:3, 3:-3:3].ravel()
    model = GapModel(vertices[inner], modes[:, inner], 0.1)
    scores = rng.normal(0, 1, 3) * size
    motion = RigidMotion(Rotation.from_rotvec(rng.normal(0, 0.5, 3)).as_matrix(), rng.normal(0, 300, 3))
    face = motion.apply(vertices + np.tensordot(scores, modes, axes=1))
    return model, Surface(face + rng.normal(0, noise, face.shape), triangles), motion, scores, face[inner]


def shown(fit, model):
    """Points of the model where the fit puts them, mm."""
    return fit.scan_from_model.apply(model.rebuild(fit.scores))


@pytest.mark.parametrize("seed", range(4))
def test_a_known_face_in_a_known_pose_is_found(case, seed):
    model, scan, motion, scores, truth = case(seed)
    fit = fit_scan(model, scan, CORNERS, truth[CORNERS], noise_mm=0.01, landmark_noise_mm=0.01)
    assert fit.settled
    assert np.linalg.norm(shown(fit, model) - truth, axis=1).max() < 0.1
    np.testing.assert_allclose(fit.scores, scores, atol=0.02)
    np.testing.assert_allclose(fit.scan_from_model.rotation, motion.rotation, atol=2e-3)
    assert fit.surface_rms_mm < 0.1
    assert fit.landmark_rms_mm < 0.1


def test_noise_outliers_and_a_hole_cost_little(case):
    model, scan, _, _, truth = case(5, noise=0.3)
    rng = np.random.default_rng(6)
    spoilt = scan.vertices_mm.copy()
    far = rng.random(len(spoilt)) < 0.05
    spoilt[far] += rng.normal(0, 15, (far.sum(), 3))
    hole = np.linalg.norm(spoilt - truth[70], axis=1) < 20
    kept = scan.triangles[~hole[scan.triangles].any(axis=1)]
    fit = fit_scan(model, Surface(spoilt, kept), CORNERS, truth[CORNERS] + rng.normal(0, 1, (6, 3)))
    assert np.linalg.norm(shown(fit, model) - truth, axis=1).mean() < 1.0


def test_the_surface_does_not_show_sliding_but_the_landmarks_do(case):
    model, scan, motion, _, truth = case(7, nose_mm=0.0, size=0.0)  # a plain half cylinder
    slid = truth[CORNERS] + motion.rotation @ [0.0, 6.0, 0.0]
    loose, held = (
        fit_scan(model, scan, CORNERS, marks, landmark_noise_mm=noise)
        for marks, noise in ((slid, 1000.0), (truth[CORNERS], 1.0))
    )
    off = [np.linalg.norm(shown(fit, model) - truth, axis=1).mean() for fit in (loose, held)]
    assert off[1] < 0.3 < 3.0 < off[0]
    assert loose.surface_rms_mm < 0.5  # looks good, is not
    assert held.surface_rms_mm < 0.5
    right = np.linalg.norm(shown(loose, model)[CORNERS] - truth[CORNERS], axis=1)
    assert np.sqrt((right**2).mean()) > 3.0  # what landmarks in the right places would have said


def test_steps_can_run_out(case, monkeypatch):
    monkeypatch.setattr(scans, "MAX_STEPS", 1)
    model, scan, _, _, truth = case(8)
    assert not fit_scan(model, scan, CORNERS, truth[CORNERS]).settled


def test_bad_input_is_refused(case):
    model, scan, _, _, truth = case(9)
    for marks in ([0, 1], [0, 1, 1], [0, 1, 999], [-1, 0, 1]):
        with pytest.raises(UsageError, match="at least 3 different points"):
            fit_scan(model, scan, marks, np.zeros((len(marks), 3)))
    for noise in ({"noise_mm": 0}, {"landmark_noise_mm": -1}):
        with pytest.raises(UsageError, match="expected positive lengths"):
            fit_scan(model, scan, CORNERS, truth[CORNERS], **noise)
    shred = Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    few = GapModel(np.random.default_rng(0).normal(0, 30, (4, 3)), np.ones((5, 4, 3)), 0.1)
    with pytest.raises(DataError, match="points that find it"):
        fit_scan(few, shred, [0, 1, 2], few.mean_mm[:3])


def test_weights_that_the_scan_cannot_tell_stay_near_the_mean_face(case):
    model, scan, _, scores, truth = case(3)
    vague = fit_scan(model, scan, CORNERS, truth[CORNERS], noise_mm=100.0, landmark_noise_mm=100.0)
    assert np.linalg.norm(vague.scores) < 0.3 * np.linalg.norm(scores)
