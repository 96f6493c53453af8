import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fapengine.errors import UsageError
from fapengine.geometry.rigid import (
    RigidMotion,
    fit_rigid,
    fit_rigid_robust,
    fit_template,
    quaternions_from_rotations,
    rotations_about,
    rotations_from_quaternions,
    yaw_pitch_roll,
)

BAND = np.array([[70.0, 20.0, 0.0], [40.0, 24.0, 55.0], [0.0, 28.0, 75.0], [-42.0, 23.0, 54.0], [-70.0, 19.0, 2.0]])
"""A head band, mm; about 8 mm high."""


def angle_deg(a, b):
    return np.degrees((Rotation.from_matrix(a) * Rotation.from_matrix(b).inv()).magnitude())


@given(st.integers(0, 10**9), st.sampled_from([(), (1,), (3, 1, 2)]))
def test_any_motion_is_undone(seed, batch):
    rng = np.random.default_rng(seed)
    count = int(np.prod(batch, dtype=int))
    rotation = Rotation.random(count, rng=rng).as_matrix().reshape(*batch, 3, 3)
    points = rng.normal(0, 40, (*batch, 5, 3))
    truth = RigidMotion(rotation, rng.normal(0, 1e4, (*batch, 3)))
    motion = fit_rigid(points, truth.apply(points))
    assert motion.rotation.shape == (*batch, 3, 3)
    np.testing.assert_allclose(motion.apply(points), truth.apply(points), atol=1e-6)
    np.testing.assert_allclose(motion.inverse().apply(truth.apply(points)), points, atol=1e-6)


@given(st.integers(0, 10**9), st.sampled_from([(), (1,), (3, 1, 2)]))
def test_turns_about_three_axes_are_told_from_their_rotation(seed, batch):
    turns = np.random.default_rng(seed).uniform(-1.5, 1.5, (*batch, 3)) * [2.0, 1.0, 2.0]
    rotations = rotations_about("YXZ", turns)
    scipys = Rotation.from_euler("YXZ", turns.reshape(-1, 3)).as_matrix().reshape(*batch, 3, 3)
    np.testing.assert_allclose(rotations, scipys, atol=1e-12)
    np.testing.assert_allclose(yaw_pitch_roll(rotations), turns, atol=1e-9)


@given(st.integers(0, 10**9), st.sampled_from([(), (1,), (3, 1, 2)]), st.booleans())
def test_quaternions_of_rotations(seed, batch, is_half_turn):
    wanted = np.random.default_rng(seed).normal(0, 1, (*batch, 4)) * [not is_half_turn, 1.0, 1.0, 1.0]
    wanted /= np.linalg.norm(wanted, axis=-1, keepdims=True)
    wanted *= np.sign(np.take_along_axis(wanted, np.abs(wanted).argmax(axis=-1)[..., None], axis=-1))
    found = quaternions_from_rotations(rotations_from_quaternions(wanted))
    np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize(
    "turn", [[np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [2.0, 2.0, 1.40], [1e-7, 0, 0], [0, 0, 0]]
)
def test_half_turns_and_no_turn(turn):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    motion = fit_rigid(BAND, BAND @ rotation.T)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-7)


def test_a_flat_noisy_band_is_never_mirrored():
    rng = np.random.default_rng(1)
    flat = BAND * [1, 0, 1]
    rotation = Rotation.random(300, rng=rng).as_matrix()
    motion = fit_rigid(flat, flat @ np.swapaxes(rotation, 1, 2) + rng.normal(0, 1.0, (300, 5, 3)))
    np.testing.assert_allclose(np.linalg.det(motion.rotation), 1.0, atol=1e-9)
    assert angle_deg(motion.rotation, rotation).max() < 4.0


def test_the_quaternion_method_is_the_least_squares_one():
    rng = np.random.default_rng(2)
    target = BAND @ Rotation.from_rotvec([0.3, -0.8, 0.2]).as_matrix().T + rng.normal(0, 3.0, BAND.shape)

    def miss(motion):
        return ((motion.apply(BAND) - target) ** 2).sum()

    best = fit_rigid(BAND, target)
    for turn in rng.normal(0, 0.01, (20, 3)):
        nudged = RigidMotion(Rotation.from_rotvec(turn).as_matrix() @ best.rotation, best.translation_mm)
        assert miss(best) < miss(nudged)


def test_a_point_without_weight_may_be_anything():
    target = BAND + np.array([1.0, 2.0, 3.0])
    weights = np.array([1, 1, 0, 1, 1])
    expected = fit_rigid(BAND, target, weights)
    for junk in (np.nan, np.inf, 1e6):
        spoilt = target.copy()
        spoilt[2] = junk
        assert np.array_equal(fit_rigid(BAND, spoilt, weights).rotation, expected.rotation)


def test_weights_pull_towards_the_heavy_points():
    target = BAND.copy()
    target[2] += [0, 0, 10.0]
    light, heavy = (fit_rigid(BAND, target, [1, 1, w, 1, 1]).apply(BAND) - target for w in (0.01, 100.0))
    assert np.linalg.norm(heavy[2]) < 1.0 < 9.0 < np.linalg.norm(light[2])


@pytest.mark.parametrize(
    ("points", "target", "weights", "message"),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), None, r"got shapes \(3, 2\)"),
        (np.zeros((4, 3)), np.zeros((3, 3)), None, r"got shapes \(4, 3\), \(3, 3\)"),
        (np.eye(3)[:2], np.eye(3)[:2], None, "fewer than 3"),
        (BAND, BAND, [1, 1, 0, 0, 0], "fewer than 3"),
        (BAND, BAND, [1, 1, 1, -1, 1], "must be 0 or more"),
        (BAND, BAND * np.nan, None, "must be finite"),
        (np.outer([1, 2, 3, 4], [1, 2, 3]), np.outer([1, 2, 3, 4], [1, 2, 3]), None, "on one line"),
        (np.stack([BAND, np.ones((5, 3))]), np.stack([BAND, BAND]), None, r"element \(1,\): all on one line"),
    ],
)
def test_points_that_fix_no_motion_are_refused(points, target, weights, message):
    with pytest.raises(UsageError, match=message):
        fit_rigid(points, target, weights)


def test_batches_of_a_motion_must_agree():
    with pytest.raises(UsageError, match="got batch"):
        RigidMotion(np.zeros((2, 3, 3)) + np.eye(3), np.zeros((3, 3)))


def test_a_slipped_marker_is_distrusted():
    rng = np.random.default_rng(3)
    band = np.concatenate([BAND, [[0.0, 60.0, 40.0], [30.0, 50.0, 40.0]]])
    rotation = Rotation.random(200, rng=rng).as_matrix()
    target = band @ np.swapaxes(rotation, 1, 2) + rng.normal(0, 0.2, (200, 7, 3))
    target[:, 3] += rng.normal(0, 8, (200, 3))
    motion, trust = fit_rigid_robust(band, target)
    plain = fit_rigid(band, target)
    assert angle_deg(motion.rotation, rotation).mean() < 0.3 * angle_deg(plain.rotation, rotation).mean()
    assert trust[:, 3].mean() < 0.2 < 0.7 < np.delete(trust, 3, axis=1).mean()


def test_the_template_is_the_body_without_its_noise():
    rng = np.random.default_rng(4)
    frames = BAND @ np.swapaxes(Rotation.random(400, rng=rng).as_matrix(), 1, 2) + rng.normal(0, 50, (400, 1, 3))
    frames += rng.normal(0, 0.3, frames.shape)
    template = fit_template(frames)
    assert np.linalg.norm(fit_rigid(template, BAND).apply(template) - BAND, axis=1).max() < 0.1  # a third of the noise
    with pytest.raises(UsageError, match=r"expected \(T, M, 3\)"):
        fit_template(BAND)


@given(st.integers(0, 10**9))
def test_quaternions_are_those_of_scipy(seed):
    rotation = Rotation.random(20, rng=np.random.default_rng(seed))
    q = np.roll(rotation.as_quat(), 1, axis=1)  # scipy puts w last
    np.testing.assert_allclose(rotations_from_quaternions(q), rotation.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotations_from_quaternions(-q), rotation.as_matrix(), atol=1e-12)


@given(st.integers(0, 10**9))
def test_a_product_of_motions_does_the_right_one_first(seed):
    rng = np.random.default_rng(seed)
    one = RigidMotion(Rotation.random(rng=rng).as_matrix(), rng.normal(0, 100, 3))
    many = RigidMotion(Rotation.random(7, rng=rng).as_matrix(), rng.normal(0, 100, (7, 3)))
    for first, second in ((one, many), (many, one), (many, many)):
        np.testing.assert_allclose((second @ first).apply(BAND), second.apply(first.apply(BAND)), atol=1e-9)
    np.testing.assert_allclose((many @ many.inverse()).apply(BAND), np.tile(BAND, (7, 1, 1)), atol=1e-9)
