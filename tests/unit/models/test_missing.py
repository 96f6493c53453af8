import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.models.missing import choose_rank, fit_gaps
from fapengine.models.viseme_space import fit_components

RANK = 4
TIGHT = {"tolerance_mm": 1e-7, "max_steps": 200}


def face(seed=0, frames=300, markers=20, noise=0.0, offset=0.0):
    """Frames of exactly four modes, and the first mode's weight, the jaw."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None]
    z = np.sin(time * rng.uniform(0.05, 0.5, RANK) + rng.uniform(0, 6, RANK)) + 0.3 * rng.normal(0, 1, (frames, RANK))
    modes = rng.normal(0, 1, (RANK, markers, 3)) * (4.0 * 0.7 ** np.arange(RANK))[:, None, None]
    truth = rng.normal(0, 50, (markers, 3)) + offset + np.tensordot(z, modes, axes=1)
    return truth + rng.normal(0, noise, truth.shape) if noise else truth, z[:, 0]


def hidden_by_the_jaw(jaw, markers, hidden, seed=0):
    """The last markers hide when the jaw is low: what is seen of them has another mean than what is not."""
    seen = np.ones((len(jaw), markers), bool)
    noise = np.random.default_rng(seed).normal(0, 0.3, (len(jaw), hidden))
    seen[:, markers - hidden :] = jaw[:, None] + noise > 0
    return seen


@settings(max_examples=12)
@given(st.integers(0, 10**9), st.sampled_from([5, 13, 18]))
def test_gaps_of_low_rank_frames_come_back_though_they_depend_on_the_pose(seed, hidden):
    truth, jaw = face(seed)
    seen = hidden_by_the_jaw(jaw, 20, hidden)
    model = fit_gaps(truth, seen, RANK, **TIGHT)
    filled = model.fill(np.where(seen[..., None], truth, np.nan), seen)
    assert np.abs(filled - truth).max() < 1e-3
    assert np.array_equal(filled[seen], truth[seen])
    assert model.noise_mm < 1e-3


def test_the_mean_is_not_that_of_the_seen_frames():
    truth, jaw = face(1)
    seen = hidden_by_the_jaw(jaw, 20, 8)
    naive = np.where(seen[..., None], truth, 0).sum(0) / seen.sum(0)[:, None]
    model = fit_gaps(truth, seen, RANK, **TIGHT)
    assert np.linalg.norm(naive - truth.mean(0), axis=1)[12:].mean() > 1.0
    np.testing.assert_allclose(model.mean_mm, truth.mean(0), atol=1e-3)


def test_a_marker_seen_in_a_tenth_of_the_frames_and_frames_with_few_markers():
    truth, _ = face(2, noise=0.05)
    rng = np.random.default_rng(3)
    seen = rng.random((300, 20)) < 0.5
    seen[:, 7] = rng.random(300) < 0.1
    seen[11] = False
    seen[12] = False
    seen[12, :2] = True
    model = fit_gaps(truth, seen, RANK)
    filled = model.fill(truth, seen)
    rest = ~seen
    rest[11:13] = False
    assert np.sqrt(((filled - truth)[rest] ** 2).mean()) < 0.12
    np.testing.assert_allclose(filled[11], model.mean_mm)  # nothing seen: the mean, not an extrapolation
    spread = np.linalg.norm(truth - truth.mean(0), axis=-1).mean()
    assert np.linalg.norm(filled[12] - truth[12], axis=-1).mean() < 2 * spread


def test_what_stands_in_a_gap_does_not_matter():
    truth, jaw = face(4)
    seen = hidden_by_the_jaw(jaw, 20, 5)
    models = [fit_gaps(np.where(seen[..., None], truth, junk), seen, 3) for junk in (np.nan, 0.0, 1e6, np.inf)]
    for model in models[1:]:
        assert np.array_equal(model.modes_mm, models[0].modes_mm)
        assert np.array_equal(model.mean_mm, models[0].mean_mm)


@settings(max_examples=5)
@given(st.integers(0, 10**9))
def test_units_turns_offsets_and_orders_change_nothing(seed):
    truth, jaw = face(seed, noise=0.05)
    seen = hidden_by_the_jaw(jaw, 20, 6)
    model = fit_gaps(truth, seen, 3, **TIGHT)
    far = fit_gaps(truth + 1000.0, seen, 3, **TIGHT)
    np.testing.assert_allclose(far.modes_mm, model.modes_mm, atol=1e-5)
    np.testing.assert_allclose(far.mean_mm, model.mean_mm + 1000.0, atol=1e-5)
    order = np.random.default_rng(seed).permutation(20)
    shuffled = fit_gaps(truth[:, order], seen[:, order], 3, **TIGHT)
    np.testing.assert_allclose(shuffled.modes_mm, model.modes_mm[:, order], atol=1e-4)
    backwards = fit_gaps(truth[::-1], seen[::-1], 3, **TIGHT)
    np.testing.assert_allclose(backwards.modes_mm, model.modes_mm, atol=1e-4)
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    turned = fit_gaps(truth @ turn.T, seen, 3, **TIGHT)
    signs = np.sign(np.einsum("kja,kja->k", turned.modes_mm @ turn, model.modes_mm))[:, None, None]
    np.testing.assert_allclose(turned.modes_mm @ turn * signs, model.modes_mm, atol=1e-4)


def test_without_gaps_it_is_the_ordinary_pca():
    truth, _ = face(5, noise=0.1)
    model = fit_gaps(truth, np.ones((300, 20), bool), 3)
    plain, _ = fit_components(truth.reshape(300, -1))
    flat = model.modes_mm.reshape(3, -1)
    lengths = np.linalg.norm(flat, axis=1)
    np.testing.assert_allclose(flat / lengths[:, None], plain[:3], atol=1e-6)
    assert (np.diff(lengths) < 0).all()


def test_one_shot_is_close_and_em_closer():
    truth, jaw = face(6, noise=1.0, markers=10)
    seen = hidden_by_the_jaw(jaw, 10, 6)
    clean, _ = face(6, markers=10)
    off = [
        np.sqrt(((fit_gaps(truth, seen, RANK, max_steps=steps).fill(truth, seen) - clean)[~seen] ** 2).mean())
        for steps in (0, 50)
    ]
    assert off[1] < off[0] < 1.5 * off[1]


def test_hidden_entries_find_the_rank():
    truth, jaw = face(7, noise=0.2, frames=400)
    seen = hidden_by_the_jaw(jaw, 20, 6)
    rank, errors = choose_rank(truth, seen, [1, 2, 3, 4, 6, 9, 14], rng=np.random.default_rng(1))
    assert rank == RANK
    assert errors[-1] > errors[3]
    with pytest.raises(UsageError, match="ranks: empty"):
        choose_rank(truth, seen, [], rng=np.random.default_rng(1))


def test_filling_at_full_rank_and_reducing_beats_one_rank_for_both():
    truth, jaw = face(8, noise=0.05)
    seen = hidden_by_the_jaw(jaw, 20, 8)
    complete, _ = fit_components(truth.reshape(300, -1))
    filled = fit_gaps(truth, seen, RANK, max_steps=3).fill(truth, seen)
    components, _ = fit_components(filled.reshape(300, -1))
    assert np.abs((filled - truth)[~seen]).max() < 0.5

    def angle(vectors):
        return np.linalg.svd(vectors @ complete[:2].T)[1].min()

    direct = fit_gaps(truth, seen, 2).modes_mm.reshape(2, -1)
    direct = direct / np.linalg.norm(direct, axis=1)[:, None]
    assert 1 - angle(components[:2]) < 0.1 * (1 - angle(direct))


def test_what_cannot_be_known_is_said():
    truth, _ = face(9)
    seen = np.ones((300, 20), bool)
    seen[4:, 13] = False
    with pytest.raises(DataError, match=r"needs at least 5 sightings in 300 frames .*got 4 .*\(at marker 13"):
        fit_gaps(truth, seen, 3)
    seen[:, 13] = False
    with pytest.raises(DataError, match=r"needs at least 5 sightings.*got 0"):
        fit_gaps(truth, seen, 3)
    spoilt = truth.copy()
    spoilt[5, 6, 1] = np.nan
    with pytest.raises(DataError, match="at frame 5, marker 6"):
        fit_gaps(spoilt, np.ones((300, 20), bool), 3)
    for rank in (0, 60):
        with pytest.raises(UsageError, match=f"rank: must be 1 to 59, got {rank}"):
            fit_gaps(truth, np.ones((300, 20), bool), rank)
    with pytest.raises(UsageError, match=r"got shapes \(300, 20, 3\) and \(20, 300\)"):
        fit_gaps(truth, np.ones((20, 300), bool), 3)
    with pytest.raises(UsageError, match="tolerance_mm: must be a positive length, got 0"):
        fit_gaps(truth, np.ones((300, 20), bool), 3, tolerance_mm=0)
