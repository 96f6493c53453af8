"""The verdict: each threshold is seen failing, in the order of the table, and wrong names are rejected."""

import re

import numpy as np
import pytest

import fapengine
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import mouth_of
from fapengine.scoring.score import Score, score_mouth
from fapengine.scoring.thresholds import LIP_THRESHOLDS, MESH_THRESHOLDS, MINIMUM, parse_thresholds
from fapengine.scoring.verdict import CLOSURES_HEARD, MEASURES, VERTEX_MEASURES, judge
from fapengine.scoring.vertices import VertexErrors

RATE_HZ = 50.0


@pytest.fixture(scope="module")
def spoken() -> fapengine.Performance:
    return fapengine.speak("My baby fell off five boats. Bob may pay the boy.", rate_hz=RATE_HZ)


def scored(spoken: fapengine.Performance, values: np.ndarray, **options: object) -> Score:
    power = np.abs(np.sin(np.arange(1000) / 30))
    return score_mouth(
        mouth_of(FapTrack.from_values(values.astype(np.int32), rate_hz=RATE_HZ)),
        truth=mouth_of(spoken.track), phones=spoken.phones, power=power, **options,  # type: ignore[arg-type]
    )  # fmt: skip


def shifted(values: np.ndarray, frames: int) -> np.ndarray:
    return np.roll(values, frames, axis=0)


def opened(values: np.ndarray) -> np.ndarray:
    """The lower lip stays 3 mm under the upper one."""
    values = values.copy()
    gap = -(values[:, fap.column(4)] + values[:, fap.column(5)])
    values[:, fap.column(5)] -= np.maximum(140 - gap, 0)
    return values


def test_a_right_one_passes_and_says_its_figures(spoken: fapengine.Performance) -> None:
    verdict = judge(scored(spoken, spoken.track.values), MEASURES)
    assert verdict.passes
    assert re.fullmatch(r"passes: opens [\d.]+ mm, lag \S+ ms, closures 100 %", str(verdict))
    assert (verdict.checked, verdict.unchecked) == (("opens", "lag", "lead", "closures"), ())


def test_a_mouth_that_never_opens_fails_first(spoken: fapengine.Performance) -> None:
    verdict = judge(scored(spoken, 0 * spoken.track.values), MEASURES, {"explained": 60})
    assert [fault.check for fault in verdict.faults] == ["opens", "explained"]
    assert str(verdict).startswith("fails: opens 0 mm (how far the mouth opens in speech; at least 2 mm); explained")
    assert verdict.unchecked == ("lag", "lead")
    nearly = judge(scored(spoken, spoken.track.values // 12), MEASURES)
    assert [fault.check for fault in nearly.faults] == ["opens"]


@pytest.mark.parametrize(("frames", "check"), [(6, "lag"), (-12, "lead")])
def test_lips_that_are_late_fail_before_what_follows_from_it(
    spoken: fapengine.Performance, frames: int, check: str
) -> None:
    verdict = judge(scored(spoken, shifted(spoken.track.values, frames)), MEASURES)
    assert [fault.check for fault in verdict.faults] == [check, "closures"]
    in_time = judge(scored(spoken, shifted(spoken.track.values, frames // 2)), MEASURES)
    assert check not in [fault.check for fault in in_time.faults]


def test_open_lips_fail_with_their_times(spoken: fapengine.Performance) -> None:
    (fault,) = judge(scored(spoken, opened(spoken.track.values)), MEASURES).faults
    assert fault.check == "closures"
    assert fault.message == "closures 0 % (closures of p b m, or of the reference; at least 90 %)"
    assert len(fault.times_s) >= 8


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.row.name)
def test_each_threshold_can_fail_and_pass(spoken: fapengine.Performance, measure: object) -> None:
    score = scored(spoken, opened(spoken.track.values // 2))
    if measure.row.name == "explained":  # type: ignore[attr-defined]
        score = scored(spoken, spoken.track.values // 2)
    value = measure.value(score)  # type: ignore[attr-defined]
    assert value is not None
    for beyond, passes in ((-1, measure.row.side == MINIMUM), (0, True), (1, measure.row.side != MINIMUM)):  # type: ignore[attr-defined]
        verdict = judge(score, [measure], {measure.row.name: value + beyond})  # type: ignore[list-item, attr-defined]
        assert verdict.passes == passes
    assert measure.weight(score) > 0  # type: ignore[attr-defined]


def test_recognized_phones_are_trusted_less(spoken: fapengine.Performance) -> None:
    half = spoken.track.values.copy()
    half[: len(half) // 2] = opened(half[: len(half) // 2])
    score = scored(spoken, half)
    assert score.phones is not None
    assert score.phones.closures.recall is not None
    assert CLOSURES_HEARD / 100 > score.phones.closures.recall > 0.2
    for is_heard, limit in ((False, 90), (True, 60)):
        (fault,) = judge(scored(spoken, half, is_heard=is_heard), MEASURES).faults
        assert fault.message.endswith(f"at least {limit} %)")
    few = fapengine.speak("Bob.", rate_hz=RATE_HZ)
    made = mouth_of(FapTrack.from_values(opened(few.track.values), rate_hz=RATE_HZ))
    assert judge(score_mouth(made, phones=few.phones, is_heard=True), MEASURES).unchecked == ("closures",)
    assert not judge(score_mouth(made, phones=few.phones), MEASURES).passes


def test_another_recording_s_closures_count_only_by_name(spoken: fapengine.Performance) -> None:
    made = mouth_of(FapTrack.from_values(opened(spoken.track.values).astype(np.int32), rate_hz=RATE_HZ))
    score = score_mouth(made, truth=mouth_of(spoken.track))
    assert judge(score, MEASURES).checked == ("opens", "lag", "lead")
    assert [fault.check for fault in judge(score, MEASURES, {"closures": 50}).faults] == ["closures"]


def test_without_speech_or_a_reference_nothing_fails() -> None:
    still = mouth_of(FapTrack.from_values(np.zeros((50, 68), np.int32), rate_hz=RATE_HZ))
    silence = fapengine.PhoneTrack.from_phones([fapengine.Phone("_", 0.0, 1.0)])
    verdict = judge(score_mouth(still, phones=silence), MEASURES)
    assert str(verdict) == "passes: nothing could be checked; not checked: opens, lag, lead, closures"
    assert not judge(score_mouth(still), MEASURES).passes  # who gives no phones says that there is speech


@pytest.mark.parametrize(
    "text", ["closure=95", "closures", "lag=80mm", "lag=", "lag=fast", "", "lag=1;lead=2", "lag=nan"]
)
def test_wrong_thresholds_are_rejected_with_the_list(text: str) -> None:
    with pytest.raises(UsageError, match=r"fail_under: got .*expected NAME=VALUE.*opens=mm, lag=ms.*slcc=number"):
        parse_thresholds(text, LIP_THRESHOLDS)


def test_thresholds_are_read() -> None:
    assert parse_thresholds(" closures=95% , lag=80ms,r=0.5,lead=-3", LIP_THRESHOLDS) == {
        "closures": 95.0, "lag": 80.0, "r": 0.5, "lead": -3.0,
    }  # fmt: skip


def test_meshes_are_judged_by_named_thresholds_alone() -> None:
    errors = VertexErrors(frames=3, mve=0.5, lve=1.0, lve_squared=2.0)
    assert judge(errors, VERTEX_MEASURES).checked == ()
    verdict = judge(errors, VERTEX_MEASURES, {"lve": 1.5, "mve": 0.5, "fdd": 0.1})
    assert [fault.message for fault in verdict.faults] == ["lve 2 unit2 (lip vertex error, squared; at most 1.5 unit2)"]
    assert (verdict.checked, verdict.unchecked) == (("lve", "mve"), ("fdd",))


def test_every_row_has_a_value_in_its_order() -> None:
    assert [measure.row for measure in MEASURES] == list(LIP_THRESHOLDS)
    assert [measure.row for measure in VERTEX_MEASURES] == list(MESH_THRESHOLDS)
