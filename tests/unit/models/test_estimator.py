import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, UsageError
from fapengine.models.dense import fit_estimator

MARKED = np.arange(0, 90, 5)
"""18 of 90 vertices carry markers."""


def faces(seed=0, count=8, noise=0.0):
    rng = np.random.default_rng(seed)
    fields = rng.normal(0, 1, (4, 90, 3)) * (3.0 * 0.6 ** np.arange(4))[:, None, None]
    weights = rng.normal(0, 1, (count, 4))
    rest = rng.normal(0, 50, (90, 3))
    return weights, fields, rest, rest + np.tensordot(weights, fields, axes=1) + rng.normal(0, noise, (count, 90, 3))


@given(st.integers(0, 10**9))
def test_eight_scans_answer_for_faces_that_they_span(seed):
    weights, fields, rest, scans = faces(seed)
    estimator = fit_estimator(scans, scans[:, MARKED])
    assert len(estimator.variances) == 4
    new = rest + np.tensordot(weights[0] * 0.5 + weights[3] - weights[5] * 0.2, fields, axes=1)
    np.testing.assert_allclose(estimator.faces_mm(new[MARKED]), new, atol=1e-7)
    np.testing.assert_allclose(estimator.faces_mm(scans[:, MARKED]), scans, atol=1e-7)
    flat = estimator.modes.reshape(4, -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(4), atol=1e-9)
    expected = (scans - scans.mean(0)).reshape(8, -1) @ flat.T  # equation 7
    np.testing.assert_allclose(estimator.coefficients(scans[:, MARKED]), expected, atol=1e-7)
    np.testing.assert_allclose(estimator.variances, expected.var(axis=0), rtol=1e-7)
    assert (flat[np.arange(4), np.abs(flat).argmax(1)] > 0).all()


def test_marker_motion_that_no_scan_has_shown_moves_nothing():
    _, _, _, scans = faces(1)
    estimator = fit_estimator(scans, scans[:, MARKED])
    shown = (scans - scans.mean(0))[:, MARKED].reshape(8, -1)
    other = np.random.default_rng(2).normal(0, 1, 54)
    other -= shown.T @ np.linalg.lstsq(shown.T, other, rcond=None)[0]
    np.testing.assert_allclose(estimator.matrix @ other, 0, atol=1e-9)


def test_equation_12_as_printed_fails_where_the_pseudo_inverse_does_not():
    _, _, _, scans = faces(3, noise=0.01)
    estimator = fit_estimator(scans, scans[:, MARKED])
    p = (scans - scans.mean(0))[:, MARKED].reshape(8, -1).T
    assert np.linalg.matrix_rank(p @ p.T) == 7
    assert estimator.matrix.shape == (7, 54)
    np.testing.assert_allclose(estimator.matrix @ p, estimator.coefficients(scans[:, MARKED]).T, atol=1e-9)


def test_noisy_markers_want_the_noise_said():
    _, fields, rest, scans = faces(4, count=20, noise=0.3)
    rng = np.random.default_rng(5)
    truth = rest + np.tensordot(rng.normal(0, 1, (300, 4)), fields, axes=1)
    seen = truth[:, MARKED] + rng.normal(0, 3.0, (300, 18, 3))
    off = [
        np.linalg.norm(fit_estimator(scans, scans[:, MARKED], noise_mm=noise).faces_mm(seen) - truth, axis=-1).mean()
        for noise in (0.0, 3.0)
    ]
    assert off[1] < 0.8 * off[0]


def test_bad_input_is_refused():
    _, _, _, scans = faces(8)
    with pytest.raises(DataError, match="the same face"):
        fit_estimator(np.ones((3, 5, 3)), np.ones((3, 2, 3)))
    with pytest.raises(UsageError, match="needs at least 2 scans, got 1"):
        fit_estimator(scans[:1], scans[:1])
    with pytest.raises(UsageError, match="noise_mm: must be 0 or more, got -1"):
        fit_estimator(scans, scans[:, MARKED], noise_mm=-1)
    with pytest.raises(UsageError, match="markers_mm: got shape"):
        fit_estimator(scans, scans[:7, MARKED])
