"""Steps and bumps: values at the joints, and C2 by differences."""

import numpy as np
import pytest

from fapengine.geometry.smooth import bump, smoothstep, soft_positive

STEP = 1e-4
CURVES = {
    "smoothstep": (smoothstep, 12.0, 70.0),
    "bump": (lambda x: bump(x, 0.4, 0.6, 0.4, 0.3), 130.0, 2400.0),
    "soft_positive": (lambda x: soft_positive(x - 0.5, 0.4), 6.0, 90.0),
}


@pytest.mark.parametrize("name", CURVES)
def test_curvature_does_not_jump(name: str) -> None:
    curve, most, steepest = CURVES[name]
    x = np.arange(-0.5, 1.5, STEP)
    curvature = np.diff(curve(x), 2) / STEP**2
    assert np.abs(curvature).max() < most
    assert (
        np.abs(np.diff(curvature)).max() < steepest * STEP * 20
    )  # a jump would be of the size of the curvature itself


def test_smoothstep_is_monotone_and_symmetric() -> None:
    x = np.linspace(0, 1, 501)
    assert (np.diff(smoothstep(x)) > 0).all()
    assert smoothstep(x) + smoothstep(1 - x) == pytest.approx(1.0)


def test_soft_positive_never_exceeds_its_input_and_never_falls_below_zero() -> None:
    x = np.linspace(-2, 2, 801)
    soft = soft_positive(x, 0.5)
    assert (soft >= 0).all()
    assert (soft <= np.maximum(x, 0)).all()
    assert soft[x >= 0.5] == pytest.approx(x[x >= 0.5] - 0.25)
