"""Expressions with times of their own."""

import numpy as np
import pytest

from fapengine._resources import profile_files
from fapengine.errors import UsageError
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import parse_profile
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import ATTACK_S, RELEASE_S, Mood, blend, during_word
from fapengine.trajectory.planner import Style, plan

PROFILE = parse_profile(profile_files("grid_s1_en"))
TIMES = np.arange(0, 4, 0.01)
PHONES = PhoneTrack.of(
    [
        Phone("h", 0.5, 0.6, word="hello"), Phone("ə", 0.6, 0.7, word="hello"), Phone("ð", 0.7, 0.8, word="there"),
        Phone("h", 2.0, 2.1, word="Hello"), Phone("ə", 2.1, 2.3, word="Hello"),
    ]
)  # fmt: skip


def test_an_envelope_comes_holds_and_goes_smoothly() -> None:
    envelope = Mood(Expression.JOY, 0.5, 1.0, 3.0, attack_s=0.2, release_s=0.8).envelope(TIMES, 4.0)
    assert envelope[TIMES <= 1.0] == pytest.approx(0)
    assert envelope[(TIMES >= 1.21) & (TIMES <= 2.19)] == pytest.approx(1)
    assert envelope[TIMES >= 3.0] == pytest.approx(0)
    assert np.abs(np.diff(envelope, 2)).max() < 6 * 0.01**2 / 0.2**2


@pytest.mark.parametrize(
    ("start_s", "stop_s", "end_s"), [(0.0, 4.0, 1.5), (1.0, 1.2, 4.0), (0.0, 9.0, 0.1), (3.0, 4.0, 2.0)]
)
def test_an_envelope_is_over_in_time_however_short(start_s: float, stop_s: float, end_s: float) -> None:
    mood = Mood(Expression.JOY, 1.0, start_s, stop_s)
    times = np.arange(0, 12, 0.01)
    envelope = mood.envelope(times, end_s)
    assert envelope[times < start_s] == pytest.approx(0)
    assert envelope.max() <= 1 + 1e-12
    assert envelope[times > max(min(stop_s, end_s), start_s + ATTACK_S + RELEASE_S)] == pytest.approx(0)


def test_moods_add_up() -> None:
    joy, anger = Mood(Expression.JOY, 0.5), Mood(Expression.ANGER, 0.3, 1.0, 2.0)
    both, parts = blend([joy, anger], PROFILE, TIMES, 4.0), [blend([one], PROFILE, TIMES, 4.0) for one in (joy, anger)]
    for whole, one, other in zip(both, *parts, strict=True):
        np.testing.assert_allclose(whole, one + other)
        assert one.any()
    assert blend([], PROFILE, TIMES, 4.0)[0].shape == (400, PROFILE.space.mode_count)


def test_a_word_brings_its_expression_each_time() -> None:
    moods = during_word(Expression.SURPRISE, 0.8, "hello", PHONES)
    assert [(mood.start_s, mood.stop_s) for mood in moods] == [
        pytest.approx((0.5 - ATTACK_S, 0.7 + RELEASE_S)), pytest.approx((2.0 - ATTACK_S, 2.3 + RELEASE_S))
    ]  # fmt: skip
    for mood in moods:
        during = (mood.start_s + ATTACK_S + 0.01 <= TIMES) & (mood.stop_s - RELEASE_S - 0.01 >= TIMES)
        assert mood.envelope(TIMES, 4.0)[during] == pytest.approx(1)
    assert during_word(Expression.JOY, 1.0, "THERE", PHONES, attack_s=2.0)[0].start_s == 0


def test_plan_takes_moods_as_well_as_strengths() -> None:
    def values(expressions: object) -> np.ndarray:
        return plan(
            PHONES, PROFILE, rng=np.random.default_rng(1), style=Style.still(), expressions=expressions
        ).track.values  # type: ignore[arg-type]

    np.testing.assert_array_equal(values({Expression.JOY: 0.5}), values([Mood(Expression.JOY, 0.5)]))
    late = values([Mood(Expression.JOY, 0.5, 1.5, 2.3)])
    np.testing.assert_array_equal(late[:40], values(())[:40])
    assert (late != values(())).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((Expression.JOY, 5.0), "expression joy: got strength 5.0, expected 0..2"),
        ((Expression.JOY, 1.0, 2.0, 2.0), "got 2.0 to 2.0 s, expected 0 <= start < stop"),
        ((Expression.JOY, 1.0, -1.0), "got -1.0 to inf s"),
        ((Expression.JOY, 1.0, 0.0, 2.0, 0.0), "attack 0.0 s"),
        ((Expression.JOY, 1.0, 0.0, 2.0, 0.1, float("nan")), "release nan s"),
    ],
)
def test_refuses_moods_out_of_range(options: tuple[object, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Mood(*options)  # type: ignore[arg-type]


def test_refuses_words_that_are_not_spoken() -> None:
    with pytest.raises(UsageError, match="got word 'bye', expected one of: hello, there"):
        during_word(Expression.JOY, 1.0, "bye", PHONES)
    with pytest.raises(UsageError, match="no words at all"):
        during_word(Expression.JOY, 1.0, "bye", PhoneTrack.of([Phone("a", 0.0, 1.0)]))
    with pytest.raises(UsageError, match="does not have it"):
        blend([Mood(Expression.NEUTRAL)], PROFILE, TIMES, 4.0)
