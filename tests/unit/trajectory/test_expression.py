"""Expressions with times of their own."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import (
    ATTACK_S,
    EXPRESSIONS,
    MAX_WEIGHT,
    RELEASE_S,
    Mood,
    during_word,
    expression_faps,
    mood_ramps,
)
from fapengine.trajectory.planner import Style, plan
from fapengine.trajectory.ramps import sample_ramps
from tests.english import english

TIMES = np.arange(0, 4, 0.01)
PHONES = PhoneTrack.from_phones(
    [
        Phone("h", 0.5, 0.6, word="hello"), Phone("ə", 0.6, 0.7, word="hello"), Phone("ð", 0.7, 0.8, word="there"),
        Phone("h", 2.0, 2.1, word="Hello"), Phone("ə", 2.1, 2.3, word="Hello"),
    ]
)  # fmt: skip


def levels(moods: list[Mood], end_s: float = 4.0, times: np.ndarray = TIMES) -> np.ndarray:
    """(9, T): of every expression."""
    return sample_ramps(np.zeros(len(EXPRESSIONS)), mood_ramps(moods, english(), end_s), times)


def level(mood: Mood, end_s: float = 4.0, times: np.ndarray = TIMES) -> np.ndarray:
    return levels([mood], end_s, times)[EXPRESSIONS.index(mood.expression)]


def test_an_expression_comes_holds_and_goes_smoothly() -> None:
    joy = level(Mood(Expression.JOY, 0.5, 1.0, 3.0, attack_s=0.2, release_s=0.8))
    assert joy[TIMES <= 1.0] == pytest.approx(0)
    assert joy[(TIMES >= 1.21) & (TIMES <= 2.19)] == pytest.approx(0.5)
    assert joy[TIMES >= 3.0] == pytest.approx(0)
    assert np.abs(np.diff(joy, 2)).max() < 6 * 0.5 * 0.01**2 / 0.2**2


@pytest.mark.parametrize(
    ("start_s", "stop_s", "end_s"), [(0.0, 4.0, 1.5), (1.0, 1.2, 4.0), (0.0, 9.0, 0.1), (3.0, 4.0, 2.0)]
)
def test_an_expression_is_over_in_time_however_short(start_s: float, stop_s: float, end_s: float) -> None:
    times = np.arange(0, 12, 0.01)
    joy = level(Mood(Expression.JOY, 1.0, start_s, stop_s), end_s, times)
    assert joy[times < start_s] == pytest.approx(0)
    assert joy.max() <= 1 + 1e-12
    assert joy[times > max(min(stop_s, end_s), start_s + ATTACK_S + RELEASE_S)] == pytest.approx(0)


def test_a_half_smile_lifts_one_corner_and_leaves_lips_shut() -> None:
    faps = dict(zip(EXPRESSIONS, expression_faps(english()).T, strict=True))

    def of(mood: Expression, *numbers: int) -> np.ndarray:
        return faps[mood][[fap.column(number) for number in numbers]]

    left, right, joy = Expression.SMILE_LEFT, Expression.SMILE_RIGHT, Expression.JOY
    assert of(left, 12, 59) == pytest.approx(of(joy, 12, 59))
    assert of(left, 12, 59).min() > 200
    assert of(left, 13, 60, 7, 54, 42, 22) == pytest.approx(0)
    assert of(right, 13, 60, 7, 54, 42, 22, 9, 11, 4, 5) == pytest.approx(
        of(left, 12, 59, 6, 53, 41, 21, 8, 10, 4, 5), rel=0.05
    )
    for mood in (left, right, Expression.CONTEMPT):  # what opens the lips is the sum of both
        assert of(mood, 4, 8, 9) + of(mood, 5, 10, 11) == pytest.approx(0)
    outer, inner = of(left, 51, 52, 55, 57) / of(left, 59), of(left, 4, 5, 8, 10) / of(left, 12)
    assert outer == pytest.approx(inner)  # the contours follow each their own corner, in the same way
    assert 0.4 * of(left, 12)[0] < of(Expression.CONTEMPT, 12)[0] < 0.8 * of(left, 12)[0]
    assert of(Expression.CONTEMPT, 20)[0] > 100


def test_anger_lowers_the_inner_ends_of_the_brows_most_and_presses_the_lips() -> None:
    """Brows as low in their middle as at their inner ends are level, which strangers took for tired."""
    anger = expression_faps(english())[:, EXPRESSIONS.index(Expression.ANGER)]
    inner, middle, outer, squeeze, lower, upper_lip, lower_lip = anger[
        [fap.column(number) for number in (31, 33, 35, 37, 21, 51, 52)]
    ]
    assert inner < middle - 80 < outer - 160
    assert squeeze > 80
    assert lower > 150
    assert min(upper_lip, lower_lip) > 100


def test_a_profile_without_joy_has_no_half_smile() -> None:
    bare = replace(english(), expressions={})
    assert not expression_faps(bare).any()
    with pytest.raises(UsageError, match="smile_left"):
        mood_ramps([Mood(Expression.SMILE_LEFT)], bare, 1.0)


def test_faps_that_all_faces_of_a_profile_share_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        expression_faps(english())[:] = 0.0


def test_different_expressions_add_up() -> None:
    joy, anger = Mood(Expression.JOY, 0.5), Mood(Expression.ANGER, 0.3, 1.0, 2.0)
    both = expression_faps(english()) @ levels([joy, anger])
    parts = [expression_faps(english()) @ levels([mood]) for mood in (joy, anger)]
    np.testing.assert_allclose(both, parts[0] + parts[1])
    assert all(part.any() for part in parts)
    assert not levels([]).any()


def test_moods_of_one_expression_add_up_to_a_limit() -> None:
    both = levels([Mood(Expression.JOY, 0.5), Mood(Expression.JOY, 0.75, 1.0, 2.5)])[0]
    assert both[[90, 150, 198, 260]] == pytest.approx([0.5, 1.25, 1.25, 0.5])
    assert level(Mood(Expression.JOY, 0.5)).max() == pytest.approx(0.5)
    assert levels([Mood(Expression.JOY, 1.5), Mood(Expression.JOY, 1.5)]).max() == pytest.approx(MAX_WEIGHT)


def test_a_word_brings_its_expression_each_time() -> None:
    moods = during_word(Expression.SURPRISE, 0.8, "hello", PHONES)
    assert [(mood.start_s, mood.end_s) for mood in moods] == [
        pytest.approx((0.5 - ATTACK_S, 0.7 + RELEASE_S)), pytest.approx((2.0 - ATTACK_S, 2.3 + RELEASE_S))
    ]  # fmt: skip
    for mood in moods:
        during = (mood.start_s + ATTACK_S + 0.01 <= TIMES) & (mood.end_s - RELEASE_S - 0.01 >= TIMES)
        assert level(mood)[during] == pytest.approx(0.8)
    assert during_word(Expression.JOY, 1.0, "THERE", PHONES, attack_s=2.0)[0].start_s == 0


def test_plan_takes_moods_as_well_as_strengths() -> None:
    def values(expressions: object) -> np.ndarray:
        return plan(
            PHONES, english(), rng=np.random.default_rng(1), style=Style.speech_only(), expressions=expressions
        ).track.values  # type: ignore[arg-type]

    np.testing.assert_array_equal(values({Expression.JOY: 0.5}), values([Mood(Expression.JOY, 0.5)]))
    late = values([Mood(Expression.JOY, 0.5, 1.5, 2.3)])
    np.testing.assert_array_equal(late[:40], values(())[:40])
    assert (late != values(())).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((Expression.JOY, 5.0), "expression joy: must be 0 to 2, got strength 5.0"),
        ((Expression.JOY, 1.0, 2.0, 2.0), "got 2.0 to 2.0 s, expected 0 <= start < stop"),
        ((Expression.JOY, 1.0, -1.0), "got -1.0 to inf s"),
        ((Expression.JOY, 1.0, 0.0, 2.0, 0.0), "attack 0.0 s"),
        ((Expression.JOY, 1.0, 0.0, 2.0, 0.1, float("nan")), "release_s: got nan, expected a number"),
    ],
)
def test_refuses_moods_out_of_range(options: tuple[object, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Mood(*options)  # type: ignore[arg-type]


def test_refuses_words_that_are_not_spoken() -> None:
    with pytest.raises(UsageError, match="got word 'bye', expected one of: hello, there"):
        during_word(Expression.JOY, 1.0, "bye", PHONES)
    with pytest.raises(UsageError, match="no words at all"):
        during_word(Expression.JOY, 1.0, "bye", PhoneTrack.from_phones([Phone("a", 0.0, 1.0)]))
    with pytest.raises(UsageError, match="does not have it"):
        mood_ramps([Mood(Expression.NEUTRAL)], english(), 4.0)
