"""Scores with intervals, and the sentence of paper 001."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from fapengine.expressions import Expression
from fapengine.laboratory import predict
from fapengine.profiles import ExpressionTarget


def pieces_of(rng: np.random.Generator, noise: float, count: int = 12) -> list[np.ndarray]:
    """Lip error, error of the mean pose, captured and predicted opening."""
    pieces = []
    for _ in range(count):
        captured = rng.normal(0, 3, 40)
        predicted = 0.8 * captured + rng.normal(0, noise, 40)
        pieces.append(np.stack([rng.uniform(1, 2, 40), rng.uniform(2, 3, 40), captured, predicted], axis=1))
    return pieces


def test_scores_are_those_of_all_frames_and_their_intervals_narrow_with_the_noise() -> None:
    widths = []
    for noise in (0.1, 2.0):
        pieces = pieces_of(np.random.default_rng(4), noise)
        score, whole = predict._score("all", pieces), np.concatenate(pieces)
        assert score.lips_mm.value == pytest.approx(whole[:, 0].mean())
        assert score.opening_r.value == pytest.approx(np.corrcoef(whole[:, 2], whole[:, 3])[0, 1])
        assert score.opening_slope.value == pytest.approx(np.polyfit(whole[:, 2], whole[:, 3], 1)[0])
        for each in (score.lips_mm, score.mean_pose_mm, score.opening_r, score.opening_slope):
            assert each.low <= each.value <= each.high
        by_hand = [np.concatenate([pieces[index] for index in rows])[:, 0].mean() for rows in DRAWS]
        np.testing.assert_allclose(score.lips_mm[1:], np.percentile(by_hand, [2.5, 97.5]), atol=0.01)
        widths.append(score.opening_slope.high - score.opening_slope.low)
    assert widths[0] < 0.2 * widths[1]


DRAWS = np.random.default_rng(9).integers(0, 12, (4000, 12))


def test_what_does_not_move_has_no_correlation() -> None:
    still = [np.stack([np.ones(20), np.ones(20), np.zeros(20), np.arange(20.0)], axis=1)]
    assert predict._score("a", still * 2).opening_r == (0.0, 0.0, 0.0)


def test_a_single_take_has_no_interval() -> None:
    score = predict._score("all", pieces_of(np.random.default_rng(4), 0.1, count=1))
    assert np.isnan([score.lips_mm.low, score.lips_mm.high, score.opening_r.low]).all()
    assert np.isfinite(score.lips_mm.value)


def test_the_sentence_adds_expressions_and_names_the_component_that_each_moves_most(standard) -> None:
    """As figures 6 and 7: the path of figure 5 and a constant."""
    weights = np.eye(standard.space.mode_count)
    faces = {
        mood: ExpressionTarget(target=3.0 * weights[component] + 0.5, fap=np.zeros(68))
        for mood, component in ((Expression.JOY, 1), (Expression.SADNESS, 5))
    }
    profile = replace(standard, expressions=MappingProxyType(faces))
    sentence = predict.say_sentence(profile)
    assert sentence.dominant == {Expression.JOY: 1, Expression.SADNESS: 5}
    for mood, face in faces.items():
        np.testing.assert_allclose(
            sentence.moods[mood] - sentence.plain, np.tile(face.target, (len(sentence.plain), 1))
        )
    times_s = np.arange(len(sentence.plain)) / predict.SENTENCE_RATE_HZ
    for phone in sentence.phones.phones:
        if phone.label in profile.phones:
            key_s = phone.start_s + 0.3 * (phone.end_s - phone.start_s)
            shown = [np.interp(key_s, times_s, column) for column in sentence.plain.T]
            np.testing.assert_allclose(shown, profile.phones[phone.label].targets[0], atol=0.1)
