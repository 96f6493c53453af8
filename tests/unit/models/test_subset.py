import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.models.subset import factorise_gram, fit_weights, gram, search_swaps, select
from fapengine.models.subset_study import (
    ErrorCurve,
    coordinate_gram,
    diagonals_by_amount,
    error_curve,
    fit_full_map,
    pivots_of_trials,
    sentence_grams,
    stability,
)
from tests.unit.models.full_swaps import search_full_swaps


def motion(seed, frames=60, markers=12, sources=5, noise=0.1):
    """Displacements of markers that a few sources move, mm."""
    rng = np.random.default_rng(seed)
    sizes = 3.0 * 0.7 ** np.arange(sources)
    moved = np.einsum(
        "tsa,sm->tma", rng.normal(0, 1, (frames, sources, 3)) * sizes[:, None], rng.normal(0, 1, (sources, markers))
    )
    return moved + rng.normal(0, noise, (frames, markers, 3))


def tall(data):
    return np.swapaxes(data, 1, 2).reshape(-1, data.shape[1])


@given(st.integers(0, 10**9))
def test_pivots_and_factor_are_those_of_qr(seed):
    data = motion(seed)
    r, order = qr(tall(data), mode="r", pivoting=True)
    factor = factorise_gram(gram(data))
    assert factor.order.tolist() == order.tolist()
    np.testing.assert_allclose(np.abs(factor.r), np.abs(r[: len(order)]), atol=1e-8)
    assert factor.order[0] == np.linalg.norm(tall(data), axis=0).argmax()
    assert factor.rank() == 12


def test_a_duplicate_is_never_chosen_twice():
    data = motion(3)
    data[:, 5] = data[:, 2]
    factor = factorise_gram(gram(data))
    assert factor.rank() == 11
    assert np.isinf(factor.gaps()[-1])
    assert len({2, 5} & set(factor.order[:11].tolist())) == 1
    with pytest.raises(UsageError, match=r"k: must be 1 to 11 .*, got 12"):
        select(factor, 12)
    with pytest.raises(UsageError, match="linearly dependent"):
        fit_weights(gram(data), [2, 5])


@given(st.integers(0, 10**9), st.integers(1, 11))
def test_weights_are_the_least_squares_ones(seed, k):
    data = motion(seed)
    subset = select(factorise_gram(gram(data)), k)
    a = tall(data)
    best, *_ = np.linalg.lstsq(a[:, subset.primary], a, rcond=None)
    np.testing.assert_allclose(subset.weights, best, atol=1e-7)
    np.testing.assert_array_equal(subset.weights[:, subset.primary], np.eye(k))
    off = a - a[:, subset.primary] @ subset.weights
    assert subset.residual_mm == pytest.approx(np.linalg.norm(off), rel=1e-6)
    other = fit_weights(gram(data), subset.primary)
    np.testing.assert_allclose(other.weights, subset.weights, atol=1e-7)
    assert other.residual_mm == pytest.approx(subset.residual_mm, rel=1e-5)
    np.testing.assert_allclose(subset.synthesise(data[:, subset.primary])[:, subset.primary], data[:, subset.primary])
    missed = np.linalg.norm(subset.synthesise(data[:, subset.primary]) - data, axis=-1)[:, subset.secondary]
    assert subset.error_mm(data) == pytest.approx(missed.mean())


@given(st.integers(0, 10**9))
def test_neither_order_of_markers_nor_turn_of_the_head_matters(seed):
    data = motion(seed)
    rng = np.random.default_rng(seed)
    shuffle = rng.permutation(12)
    plain, shuffled = factorise_gram(gram(data)), factorise_gram(gram(data[:, shuffle]))
    assert shuffle[shuffled.order].tolist() == plain.order.tolist()
    turned = factorise_gram(gram(data @ Rotation.random(rng=rng).as_matrix().T))
    assert turned.order.tolist() == plain.order.tolist()
    np.testing.assert_allclose(turned.diagonal, plain.diagonal, rtol=1e-6)


@given(st.integers(0, 10**9))
def test_swaps_only_improve_and_stop_where_no_swap_helps(seed):
    g = gram(motion(seed, noise=0.5))
    greedy = select(factorise_gram(g), 3)
    best = search_swaps(g, greedy)
    assert best.residual_mm <= greedy.residual_mm * (1 + 1e-9)
    for place in range(3):
        for successor in set(range(12)) - set(best.primary.tolist()):
            tried = best.primary.copy()
            tried[place] = successor
            assert fit_weights(g, tried).residual_mm >= best.residual_mm * (1 - 1e-6)


def test_a_single_marker_is_swapped_too():
    g = gram(motion(5, noise=0.5))
    best = min(fit_weights(g, [marker]).residual_mm for marker in range(12))
    assert search_swaps(g, select(factorise_gram(g), 1)).residual_mm == pytest.approx(best)


def test_the_whole_basis_leaves_nothing():
    data = motion(4)
    assert select(factorise_gram(gram(data)), 12).error_mm(data) == 0.0


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: gram(np.zeros((4, 3))), UsageError, r"got shape \(4, 3\)"),
        (lambda: gram(np.zeros((0, 4, 3))), UsageError, r"got shape \(0, 4, 3\)"),
        (lambda: gram(np.where(np.arange(36).reshape(3, 4, 3) == 20, np.nan, 1.0)), DataError, "at frame 1, marker 2"),
        (lambda: factorise_gram(np.zeros((4, 4))), DataError, "only zeros"),
        (lambda: fit_weights(np.eye(4), [1, 1]), UsageError, "different markers 0 to 3"),
        (lambda: fit_weights(np.eye(4), [4]), UsageError, "different markers 0 to 3"),
        (lambda: fit_weights(np.eye(4), [-1]), UsageError, "different markers 0 to 3"),
        (lambda: fit_weights(np.eye(4), []), UsageError, "different markers 0 to 3"),
        (lambda: select(factorise_gram(np.eye(4)), 0), UsageError, "k: must be 1 to 4 .*, got 0"),
        (lambda: select(factorise_gram(np.eye(4)), 2).error_mm(np.zeros((3, 5, 3))), UsageError, "got 5 markers"),
        (lambda: sentence_grams([np.zeros((3, 4, 3)), np.zeros((3, 5, 3))]), UsageError, r"counts \[4, 5\]"),
        (lambda: sentence_grams([]), UsageError, r"counts \[\]"),
        (
            lambda: pivots_of_trials(np.zeros((2, 3, 3)), training=3, count=1, trials=1, rng=None),
            UsageError,
            "must be 1 to 2",
        ),
    ],
)
def test_what_cannot_be_done_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def sentences(count=12):
    rng = np.random.default_rng(0)
    mix = rng.normal(0, 1, (4, 12))
    return [
        np.einsum("tsa,sm->tma", rng.normal(0, 2, (40, 4, 3)), mix) + rng.normal(0, 0.3, (40, 12, 3))
        for _ in range(count)
    ]


def test_cross_validation_finds_the_number_of_sources():
    curve = error_curve(sentences(), range(1, 9), folds=4, rng=np.random.default_rng(1))
    assert curve.fold_mm.shape == (8, 4)
    assert curve.choose(tolerance_mm=0.9) == 4  # four sources; the noise alone is 0.48 mm long
    assert curve.mean_mm[3] < 0.4 * curve.mean_mm[2]
    with pytest.raises(UsageError, match=r"tolerance_mm: got 0\.01"):
        curve.choose(tolerance_mm=0.01)
    assert curve.choose_within(0.9) == (4, "the first whose error is within 0.9 mm")
    chosen, reason = curve.choose_within(0.01)
    assert (chosen, reason) == (curve.choose(), "none comes within 0.01 mm: the first near the least")


def test_one_standard_error_rule():
    curve = ErrorCurve(np.array([3, 5, 7, 9]), np.array([[2.0, 2.0], [1.1, 1.2], [1.0, 1.2], [1.2, 1.3]]))
    np.testing.assert_allclose(curve.standard_error_mm, [0, 0.05, 0.1, 0.05])
    assert curve.choose() == 5


def test_folds_and_sizes_are_checked():
    for folds in (1, 13):
        with pytest.raises(UsageError, match="must be 2 to 12"):
            error_curve(sentences(), [2], folds=folds, rng=np.random.default_rng(1))
    for ks in ([], [0], [12]):
        with pytest.raises(UsageError, match=r"expected numbers 1 to 11"):
            error_curve(sentences(), ks, rng=np.random.default_rng(1))


def test_trials_and_amounts():
    grams = sentence_grams(sentences(40))
    pivots = pivots_of_trials(grams, training=30, count=6, trials=5, rng=np.random.default_rng(1))
    assert pivots.shape == (5, 6)
    assert pivots[0].tolist() == factorise_gram(grams[:30].sum(0)).order[:6].tolist()
    assert stability(pivots, 4) > 0.7
    assert stability([[1, 2, 3], [2, 1, 4]], 3) == pytest.approx(2 / 3)
    assert stability([[1, 2]], 2) == 1.0
    curves = diagonals_by_amount(grams, count=5)
    assert curves.shape == (40, 5)
    np.testing.assert_allclose(curves[-1], factorise_gram(grams.sum(0)).diagonal[:5] / np.sqrt(grams.sum(0).trace()))
    late, early = np.abs(np.diff(curves[15:], axis=0)).max(), np.abs(np.diff(curves[:10], axis=0)).max()
    assert late < early / 3  # figure 3: stable from some fifteen sentences on


def test_the_full_map_knows_turns_that_scalar_weights_do_not():
    data = motion(6, frames=200, markers=6, sources=2, noise=0.0)
    data[:, 5] = data[:, 0] @ Rotation.from_rotvec([0.4, 0.9, 0]).as_matrix().T
    subset = select(factorise_gram(gram(data)), 2)
    full = fit_full_map(coordinate_gram([data]), subset.primary)
    assert subset.error_mm(data) > 0.1
    np.testing.assert_allclose(full.synthesise(data[:, subset.primary]), data, atol=1e-4)
    np.testing.assert_allclose(full.synthesise(data[3, subset.primary]), data[3], atol=1e-4)


def test_swaps_for_the_full_map_stop_where_no_swap_helps():
    data = motion(7, noise=0.5) @ np.diag([1.0, 0.3, 2.0])
    gram = coordinate_gram([data])

    def left(primary):
        return ((fit_full_map(gram, primary).synthesise(data[:, list(primary)]) - data) ** 2).sum()

    best = search_full_swaps(gram, [0, 1, 2])
    assert left(best) < left([0, 1, 2])
    for place in range(3):
        for successor in set(range(12)) - set(best.tolist()):
            tried = best.copy()
            tried[place] = successor
            assert left(tried) > left(best) * (1 - 1e-6)


@pytest.mark.parametrize("primary", [[], [1, 1], [4], [-1]])
def test_the_full_map_wants_different_markers(primary):
    with pytest.raises(UsageError, match="different markers 0 to 3"):
        fit_full_map(np.eye(12), primary)
    with pytest.raises(UsageError, match="got 4 rows"):
        fit_full_map(np.eye(4), [0])


def test_no_marker_is_taken_twice_where_nothing_is_left_to_gain():
    data = np.zeros((60, 5, 3))
    data[:, 3] = motion(8, markers=1)[:, 0]  # one marker moves, and explains itself
    assert len(set(search_full_swaps(coordinate_gram([data]), [3, 1, 2]).tolist())) == 3


def test_groups_of_sentences_add_up():
    parts = [np.random.default_rng(n).normal(size=(6, 4, 3)) for n in range(7)]
    grouped = sentence_grams(parts, at_most=3)
    assert grouped.shape == (3, 4, 4)
    np.testing.assert_allclose(grouped.sum(axis=0), gram(np.concatenate(parts)))
