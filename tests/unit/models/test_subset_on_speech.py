"""Paper 000 on speech, made and captured: 57 points; the captured ones are good to about 0.7 mm."""

import numpy as np
import pytest

from fapengine.models.subset import factorise_gram, fit_weights, search_swaps, select
from fapengine.models.subset_study import (
    coordinate_gram,
    diagonals_by_amount,
    error_curve,
    fit_full_map,
    pivots_of_trials,
    sentence_grams,
    stability,
)
from tests.unit.models.full_swaps import search_full_swaps

GREEDY_MM = {"captured": 0.356, "made": 0.29}
"""Error of the 48 driven markers; the paper on its own capture: 1.05 mm."""
SWAPPED_MM, FULL_MM = {"captured": 0.337, "made": 0.275}, {"captured": 0.140, "made": 0.145}
TOLERANCE_MM = {"captured": 0.36, "made": 0.29}


@pytest.fixture(scope="module")
def sentences(speech):
    points = speech.motion_mm[:, speech.columns["lucero57"]]
    return [points[speech.sentence == index] for index in range(speech.sentence[-1] + 1)]


@pytest.fixture(scope="module")
def grams(sentences):
    return sentence_grams(sentences)


def test_nine_markers_drive_the_other_48(speech, sentences, grams):
    training = np.setdiff1d(np.arange(len(grams)), speech.held_out)
    frames = np.concatenate([sentences[index] for index in speech.held_out])
    seen = grams[training].sum(0)
    greedy = select(factorise_gram(seen), 9)
    best = search_swaps(seen, greedy)
    rng = np.random.default_rng(0)
    lucky = min(fit_weights(seen, rng.choice(57, 9, replace=False)).error_mm(frames) for _ in range(20))
    assert greedy.error_mm(frames) < GREEDY_MM[speech.kind] < lucky
    assert best.error_mm(frames) < SWAPPED_MM[speech.kind]
    coordinates = coordinate_gram([sentences[index] for index in training])
    full = fit_full_map(coordinates, search_full_swaps(coordinates, best.primary))
    driven = np.setdiff1d(np.arange(57), full.primary)
    assert (
        np.linalg.norm(full.synthesise(frames[:, full.primary]) - frames, axis=-1)[:, driven].mean()
        < FULL_MM[speech.kind]
    )


def test_the_selection_is_stable_as_in_table_1_and_figure_3(grams):
    pivots = pivots_of_trials(grams[:40], training=30, count=12, trials=10, rng=np.random.default_rng(1))
    assert stability(pivots, 9) > 0.7
    curves = diagonals_by_amount(grams[:40])
    assert np.abs(curves[-1] - curves[14]).max() < 0.02


def test_k_is_chosen_by_the_uncertainty_of_the_points(speech, sentences):
    curve = error_curve(sentences[::5], [3, 6, 9, 12], folds=5, rng=np.random.default_rng(2))
    assert (np.diff(curve.mean_mm) < 0).all()
    assert curve.choose(tolerance_mm=TOLERANCE_MM[speech.kind]) == 9
