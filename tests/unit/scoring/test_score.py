"""Known answers: a lip sync against itself, late, half as wide, without its closures, and shut."""

from itertools import pairwise

import numpy as np
import pytest

import fapengine
from fapengine.errors import DataError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ADULT
from fapengine.scoring.mouth import LIP_POINTS, Contacts, mouth_of
from fapengine.scoring.score import Intensity, Score, score_mouth
from fapengine.speech.phone_track import Phone, PhoneTrack, is_bilabial, is_labiodental

RATE_HZ = 60.0
DELAY_FRAMES = 5
"""83 ms."""
TEXT = "Bright sunshine shimmers on the ocean. My baby fell off a boat. Five very big umbrellas."


@pytest.fixture(scope="module")
def spoken() -> fapengine.Performance:
    return fapengine.speak(TEXT, rate_hz=RATE_HZ)


def track(values: np.ndarray, rate_hz: float = RATE_HZ) -> FapTrack:
    return FapTrack.from_values(values, rate_hz=rate_hz)


def late(made: FapTrack) -> FapTrack:
    first = np.repeat(made.values[:1], DELAY_FRAMES, axis=0)
    return track(np.concatenate([first, made.values[:-DELAY_FRAMES]]))


def never_shut(made: FapTrack) -> FapTrack:
    """The lower lip stays 120 steps, 2.6 mm, under the upper one."""
    values = made.values.copy()
    opening = -(values[:, fap.column(4)] + values[:, fap.column(5)])
    values[:, fap.column(5)] -= np.maximum(120 - opening, 0)
    return track(values)


def score_motion(made: FapTrack, *, truth: FapTrack | None = None, offset_s: float = 0.0, **options: object) -> Score:
    reference = None if truth is None else mouth_of(truth)
    return score_mouth(mouth_of(made, offset_s=offset_s), truth=reference, **options)  # type: ignore[arg-type]


def both(score: Score) -> tuple[Contacts, Contacts]:
    assert score.phones is not None
    assert score.truth is not None
    return score.phones.closures, score.truth.closures


def test_a_recording_is_itself(spoken: fapengine.Performance) -> None:
    score = score_motion(spoken.track, truth=spoken.track, phones=spoken.phones)
    for closures, wanted in zip(both(score), (9, 7), strict=True):  # of the motion, m b is one closure
        assert closures.wanted >= wanted
        assert (closures.recall, closures.missed_s) == (1.0, ())
    assert score.phones is not None
    assert score.truth is not None
    assert score.truth.closures.precision == 1.0
    assert score.phones.closures.precision > 0.9  # varied lips may nearly meet beside a rounded vowel
    assert score.phones.teeth.met == score.phones.teeth.wanted >= 5
    assert abs(score.phones.timing.lag_ms or 99) < 10  # what phones lead to expect is not what a plan does
    timing, like = score.truth.timing, score.truth.likeness
    assert (timing.lag_ms, timing.mtm_ms, timing.met) == (pytest.approx(0, abs=0.1), 0.0, 1.0)
    assert (like.opening_r, like.opening_slope, like.width_r) == pytest.approx((1.0, 1.0, 1.0))
    assert (like.opening_mm, like.lips_mm, like.lve_mm2, like.lve_root_mm) == (0.0, 0.0, 0.0, 0.0)
    assert score.behaviour == score.truth.behaviour


def test_a_late_one_is_late_by_what_it_is(spoken: fapengine.Performance) -> None:
    before = score_motion(spoken.track, phones=spoken.phones).phones
    score = score_motion(late(spoken.track), truth=spoken.track, phones=spoken.phones)
    assert score.truth is not None
    assert score.phones is not None
    assert before is not None
    assert score.truth.timing.lag_ms == pytest.approx(83.3, abs=2)
    assert score.truth.timing.mtm_ms == pytest.approx(83.3, abs=3)
    assert score.phones.timing.lag_ms - before.timing.lag_ms == pytest.approx(83.3, abs=5)  # type: ignore[operator]
    for closures in both(score):
        assert closures.recall is not None
        assert closures.precision is not None
        assert closures.recall < 1
        assert closures.precision < 0.85
    assert score.truth.likeness.opening_r is not None
    assert score.truth.likeness.opening_r < 0.6


def test_the_offset_takes_a_delay_away(spoken: fapengine.Performance) -> None:
    score = score_motion(late(spoken.track), truth=spoken.track, offset_s=-DELAY_FRAMES / RATE_HZ)
    assert score.truth is not None
    assert score.truth.likeness.opening_r == pytest.approx(1.0)
    assert score.truth.timing.lag_ms == pytest.approx(0, abs=0.1)


def test_half_the_opening_has_half_the_slope_and_is_in_time(spoken: fapengine.Performance) -> None:
    score = score_motion(track(spoken.track.values // 2), truth=spoken.track, phones=spoken.phones)
    assert score.truth is not None
    like = score.truth.likeness
    assert like.opening_r == pytest.approx(1, abs=1e-3)
    assert like.opening_slope == pytest.approx(0.5, abs=0.01)
    assert like.width_slope == pytest.approx(0.5, abs=0.03)
    assert score.truth.timing.mtm_ms == pytest.approx(0, abs=1)
    assert both(score)[1].recall == 1.0
    assert both(score)[1].precision < 1.0  # type: ignore[operator]


def test_without_closures_none_is_met_and_all_are_named(spoken: fapengine.Performance) -> None:
    for closures in both(score_motion(never_shut(spoken.track), truth=spoken.track, phones=spoken.phones)):
        assert (closures.met, closures.recall, closures.precision) == (0, 0.0, None)
        assert len(closures.missed_s) == closures.wanted
        assert all(one < other for one, other in pairwise(closures.missed_s))


def test_a_mouth_that_never_opens_has_recall_but_no_precision(spoken: fapengine.Performance) -> None:
    score = score_motion(track(0 * spoken.track.values), truth=spoken.track, phones=spoken.phones)
    for closures in both(score):
        assert closures.recall == 1.0
        assert closures.precision is not None
        assert closures.precision < 0.6
    assert score.truth is not None
    assert (score.truth.likeness.opening_r, score.truth.timing.lag_ms, score.truth.timing.mtm_ms) == (None, None, None)
    assert (score.behaviour.blinks, score.behaviour.head_deg_s, score.behaviour.blink_ms) == (0, 0.0, None)


def test_one_phone_decides_with_tolerance() -> None:
    phones = PhoneTrack.from_phones(
        [Phone("ɑ", 0, 0.4), Phone("m", 0.4, 0.5), Phone("f", 0.5, 0.6), Phone("ɑ", 0.6, 1.0)]
    )
    values = np.zeros((101, fap.FAP_COUNT), np.int32)
    values[:, fap.column(5)] = -400  # 8.6 mm
    wide = score_motion(track(values, 100.0), phones=phones).phones
    assert wide is not None
    assert (wide.closures.missed_s, wide.teeth.missed_s) == ((0.45,), (0.55,))
    assert wide.timing.lag_ms is None
    for frames, met in ((slice(38, 39), 1), (slice(37, 38), 0), (slice(51, 52), 1), (slice(54, 55), 0)):
        shut = values.copy()
        shut[frames, fap.column(5)] = 0
        found = score_motion(track(shut, 100.0), phones=phones).phones
        assert found is not None
        assert found.closures.met == met
        assert found.closures.precision == 1.0


def test_a_mouth_opens_where_phones_are_spoken() -> None:
    values = np.zeros((101, fap.FAP_COUNT), np.int32)
    values[50:, fap.column(5)] = -400  # 8.6 mm, in the pause
    phones = PhoneTrack.from_phones([Phone("ɑ", 0, 0.49), Phone("_", 0.49, 1.0)])
    assert score_motion(track(values, 100.0), phones=phones).opens_mm == 0.0
    assert score_motion(track(values, 100.0)).opens_mm == pytest.approx(400 * ADULT.mns0_mm / 1024)
    silence = PhoneTrack.from_phones([Phone("_", 0, 1.0)])
    assert score_motion(track(values, 100.0), phones=silence).opens_mm is None


def test_lve_is_that_of_its_definition(spoken: fapengine.Performance) -> None:
    """TorchMetrics 1.9, ``LipVertexError``: mean over frames of the maximum over vertices of the squared distance."""
    rng = np.random.default_rng(3)
    values = spoken.track.values.copy()
    values[:, fap.column(4) : fap.column(14)] += rng.integers(-90, 90, (len(values), 10), dtype=np.int32)
    one, other = mouth_of(track(values)), mouth_of(spoken.track)
    total = 0.0
    for frame in range(len(values)):
        total += max(
            sum(float(d) ** 2 for d in one.lips_mm[frame, n] - other.lips_mm[frame, n]) for n in range(len(LIP_POINTS))
        )
    score = score_motion(track(values), truth=spoken.track)
    assert score.truth is not None
    assert score.truth.likeness.lve_mm2 == pytest.approx(total / len(values))


def test_a_mouth_counts_in_millimetres_of_an_adult() -> None:
    pose = FapTrack.pose(raise_b_midlip=-512, stretch_l_cornerlip=1024)
    mouth = mouth_of(track(np.repeat(pose.values, 2, axis=0)))
    assert mouth.opening_mm == pytest.approx(ADULT.mns0_mm / 2)
    assert mouth.width_mm == pytest.approx(ADULT.mw0_mm)
    assert mouth.lips_mm[0, LIP_POINTS.index("2.3")].tolist() == pytest.approx([0, -ADULT.mns0_mm / 2, 0])
    assert mouth.lips_mm[0, LIP_POINTS.index("2.4")].tolist() == pytest.approx([ADULT.mw0_mm, 0, 0])


def test_phones_that_touch() -> None:
    labels = ("p", "b", "m", "f", "v", "w", "t͡ʃ", "m̩", "p͡f", "u")
    assert [label for label in labels if is_bilabial(Phone(label, 0, 1))] == ["p", "b", "m", "m̩", "p͡f"]
    assert [label for label in ("p", "f", "v", "ʋ", "θ") if is_labiodental(Phone(label, 0, 1))] == ["f", "v", "ʋ"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: score_motion(FapTrack.pose()), "expected two or more"),
        (lambda: score_motion(track(np.zeros((5, 68), int)), offset_s=-9.0), "got 0 frames"),
        (lambda: score_motion(track(np.zeros((5, 68), int)), closed_mm=0.0), "closed_mm: must be above 0, got 0"),
        (
            lambda: score_motion(
                track(np.zeros((5, 68), int)), phones=PhoneTrack((Phone("hi", 0, 1),), "word", spelled=True)
            ),
            "spelled words",
        ),
    ],
)
def test_what_cannot_be_scored_is_refused(make: object, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make()  # type: ignore[operator]


def test_a_piece_is_judged_by_what_is_said_while_it_runs(spoken: fapengine.Performance) -> None:
    first = 150
    score = score_motion(
        spoken.track[first:], truth=spoken.track, phones=spoken.phones, power=np.ones(600), offset_s=first / RATE_HZ
    )
    assert score.truth is not None
    assert score.intensity is not None
    for closures in both(score):
        assert closures.recall == 1.0
        assert 0 < closures.wanted < 9
    assert score.truth.likeness.lips_mm == pytest.approx(0.0, abs=1e-9)
    assert score.truth.timing.mtm_ms == 0.0
    assert score.intensity.windows == int((score.duration_s - 1.0) / 0.5) + 1
    with pytest.raises(DataError, match="has no frame from 60"):
        score_motion(spoken.track[first:], truth=spoken.track, offset_s=60.0)


def test_two_frames_and_the_shortest_sound_have_a_score(spoken: fapengine.Performance) -> None:
    score = score_motion(spoken.track[:2], truth=spoken.track, phones=spoken.phones, power=np.zeros(0))
    assert score.truth is not None
    assert (score.truth.timing.lag_ms, score.intensity) == (None, Intensity(None, 0, None))
