"""From phones to FAPs: promises of the planner, on made and on spoken phones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import to_codable
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.faps import DETERMINED, UPPER_GAIN, UPPER_LIP, displacements_to_faps, speech_faps
from fapengine.trajectory.planner import Style, plan, rest_s
from fapengine.trajectory.targets import CLOSEST_KEYS_S, MAX_HELD, REST_MARGIN_S, _apart, keys_of, weights_of
from tests.english import english

STILL = Style.speech_only()
RATE_HZ = 100.0


def opening_of_03_mm() -> float:
    return 0.3 / english().fapu.unit(fap.FapUnit.MNS)


def track(spelling: str, *, each_s: float = 0.12, lead_s: float = 0.3, tail_s: float = 0.5) -> PhoneTrack:
    labels = spelling.split()
    times = lead_s + each_s * np.arange(len(labels) + 1)
    spoken = [Phone(label, *span) for label, *span in zip(labels, times, times[1:], strict=False)]
    return PhoneTrack.from_phones([*spoken, Phone(SILENCE, times[-1], times[-1] + tail_s)])


def values_of(phones: PhoneTrack, **options: object) -> NDArray[np.int32]:
    settings = {"style": STILL, "rate_hz": RATE_HZ, "rng": np.random.default_rng(1), **options}
    return plan(phones, english(), **settings).track.values  # type: ignore[arg-type]


def opening(values: NDArray[np.int32]) -> NDArray[np.int32]:
    gap: NDArray[np.int32] = -(values[:, fap.column(4)] + values[:, fap.column(5)])
    return gap


def test_a_long_vowel_is_reached_as_soon_as_a_short_one_held_and_sways() -> None:
    def gap_mm(seconds: float) -> NDArray[np.float64]:
        edges = 0.3, 0.4, 0.4 + seconds, 0.5 + seconds
        phones = [Phone(*phone) for phone in zip("sɑp", edges, edges[1:], strict=False)]
        return opening(values_of(PhoneTrack.from_phones(phones))) * english().fapu.unit(fap.FapUnit.MNS)

    short, long = gap_mm(0.4), gap_mm(3.0)
    np.testing.assert_allclose(long[:48], short[:48], atol=0.5)
    np.testing.assert_allclose(long[-26:], short[-26:], atol=0.5)
    held = long[60:320]
    assert held.min() > 0.77 * held.max()
    assert 0.3 < np.ptp(held[40:240]) < 2.0
    assert np.abs(np.diff(held, 2))[::4].max() < 0.2  # mm; rounding to FAPU makes 0.04


def test_a_long_diphthong_holds_its_first_sound() -> None:
    def gap(label: str) -> float:
        return float(opening(values_of(PhoneTrack.from_phones([Phone(label, 0.3, 3.3)])))[150:250].mean())

    assert gap("aɪ") > gap("ɪ") + 0.9 * (gap("a") - gap("ɪ"))


def test_the_upper_lip_moves_farther_only_where_the_context_model_plans() -> None:
    weights = np.eye(english().space.mode_count)
    means, planned = (speech_faps(english(), weights, context=context) for context in (False, True))
    space = english().space
    np.testing.assert_array_equal(
        means, displacements_to_faps(space.to_points_mm(weights), space.points, english().fapu)
    )
    means[:, list(UPPER_LIP)] *= UPPER_GAIN
    np.testing.assert_allclose(planned, means)


def test_keys_of_a_phone_of_any_length_are_limited() -> None:
    keys = keys_of(PhoneTrack.from_phones([Phone("ɑ", 0.0, 1000.0)]), english())
    assert len(keys.times_s) == MAX_HELD + 2


def test_a_key_at_the_end_of_a_phone_is_that_phone_s() -> None:
    phones, targets = PhoneTrack.from_phones([Phone("ɑ", 0.3, 0.4), Phone("s", 0.4, 0.5)]), english().phones
    late = {name: replace(one, fractions=(*one.fractions[:-1], 1.0)) for name, one in targets.items()}
    middle, end = (keys_of(phones, replace(english(), phones=some), context=False) for some in (targets, late))
    np.testing.assert_array_equal(end.targets, middle.targets)


def test_a_long_vowel_is_held_without_a_context_model_too() -> None:
    phones, profile = PhoneTrack.from_phones([Phone("ɑ", 0.3, 3.3)]), replace(english(), context=None)
    gap = opening(plan(phones, profile, style=STILL, rate_hz=RATE_HZ, rng=np.random.default_rng(1)).track.values)
    held = gap[60:300]
    assert held.min() > 0.75 * held.max()


LABELS = st.lists(
    st.sampled_from(["p", "b", "m", "f", "s", "aɪ", "ɑː", "i", "uː", "w", "ʃ", "n", "_"]), min_size=1, max_size=9
)


@given(LABELS, st.floats(0.04, 0.25), st.sampled_from([None, Expression.JOY, Expression.SURPRISE, Expression.DISGUST]))
def test_every_bilabial_closes_the_lips_under_any_expression(
    labels: list[str], each_s: float, expression: Expression | None
) -> None:
    phones = track(" ".join(labels), each_s=each_s)
    gap = opening(values_of(phones, expressions={expression: 0.6} if expression else {}))
    assert gap.min() >= -2  # rounding of two FAPs
    for phone in phones.phones:
        if phone.label in "pbm":
            inside = gap[int(np.ceil(phone.start_s * RATE_HZ)) : int(phone.end_s * RATE_HZ) + 1]
            needed = min(4, len(inside) - 1)  # 40 ms, or the phone if shorter
            assert (inside <= opening_of_03_mm()).sum() >= needed


def test_without_the_closure_step_lips_stay_open() -> None:
    phones = track("ɑː b ɑː b ɑː", each_s=0.08)
    times = np.arange(0, phones.duration_s, 0.01)
    path = weights_of(phones, english(), times, context=False)
    faps = displacements_to_faps(english().space.to_points_mm(path), english().space.points, english().fapu)
    gap = -(faps[:, fap.column(4)] + faps[:, fap.column(5)])
    during = (times > 0.388) & (times < 0.44)
    assert gap[during].min() > opening_of_03_mm() or gap.min() < -2


def test_open_vowels_open() -> None:
    gap = opening(values_of(track("m aɪ m")))
    assert gap.max() > 8.0 / english().fapu.unit(fap.FapUnit.MNS)


def test_rest_at_both_ends() -> None:
    values = values_of(track("b aɪ t"), expressions={Expression.JOY: 1.0}, style=Style())
    assert not values[0].any()
    assert np.abs(values[-1, :22]).max() <= 5


def test_speech_at_the_very_edges_still_starts_and_ends_at_rest() -> None:
    values = values_of(track("ɑ i ɑ", lead_s=0.0, tail_s=0.01))
    assert not values[0].any()
    assert np.abs(values[-1]).max() < 60


def test_nothing_jumps() -> None:
    values = values_of(track("b ɹ aɪ t s ʌ n ʃ aɪ n m ɑː p ə"), style=Style(), expressions={Expression.JOY: 0.5})
    lips = values[:, fap.column(3) : fap.column(19)] * english().fapu.unit(fap.FapUnit.MNS)
    speed_mm_s = np.abs(np.diff(lips, axis=0)) * RATE_HZ
    assert speed_mm_s.max() < 700
    assert np.abs(np.diff(values[:, fap.column(48) : fap.column(51)], axis=0)).max() < 400  # AU in 10 ms


def test_keyframes_stand_at_30_percent_and_the_spline_passes_them() -> None:
    phones = track("s ɑ")
    assert keys_of(phones, english(), context=False).times_s == pytest.approx([0.336, 0.456])
    path = weights_of(phones, english(), np.array([0.336, 0.456, 0.0, 0.18, phones.duration_s]), context=False)
    assert path[0] == pytest.approx(english().phones["s"].targets[0])
    assert path[1] == pytest.approx(english().phones["ɑ"].targets[0])
    assert path[2:] == pytest.approx(0.0, abs=1e-9)


def test_a_time_shift_shifts_the_motion() -> None:
    one, other = values_of(track("b aɪ m")), values_of(track("b aɪ m", lead_s=0.5))
    assert np.abs(other[20:] - one[: len(other) - 20]).max() <= 1


@given(LABELS, st.floats(0.04, 0.25), st.floats(0.0, 5.0))
def test_a_time_shift_of_any_size_shifts_the_path_exactly(labels: list[str], each_s: float, shift_s: float) -> None:
    paths = []
    for lead_s in (0.3, 0.3 + shift_s):
        phones = track(" ".join(labels), each_s=each_s, lead_s=lead_s)
        paths.append(weights_of(phones, english(), np.linspace(0.1, 2.0, 60) + lead_s - 0.3))
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-8 * max(1.0, np.abs(paths[0]).max()))


def bare(name: str) -> str:
    """Name of a FAP without its side."""
    return name.replace("_l_", "_").replace("_r_", "_").replace("_lm", "_m").replace("_rm", "_m")


def test_a_mirrored_face_moves_mirrored() -> None:
    left = ("8.3", "8.5", "8.7", "5.1", "5.3", "2.4", "2.6", "2.8")
    twins = {point: f"{point[:2]}{int(point[2:]) + 1}" for point in left}
    twins |= {right: left for left, right in twins.items()}
    space = english().space
    order = [space.points.index(twins.get(point, point)) for point in space.points]
    mirrored = replace(english(), space=replace(space, modes_mm=space.modes_mm[:, order] * [-1.0, 1.0, 1.0]))
    phones = track("b aɪ t ʃ uː m ɑː")
    one, other = (
        plan(phones, profile, style=STILL, rate_hz=RATE_HZ, rng=np.random.default_rng(1)).track.values
        for profile in (english(), mirrored)
    )
    for row in fap.FAPS:
        if row.number in DETERMINED and row.point in twins:
            match = next(r for r in fap.FAPS if r.point == twins[row.point] and bare(r.name) == bare(row.name))
            np.testing.assert_allclose(one[:, fap.column(row.number)], other[:, fap.column(match.number)], atol=1)


def test_a_long_pause_rests_and_a_short_one_does_not() -> None:
    gap = opening(values_of(track("ɑ ɑ _ _ _ _ ɑ ɑ")))
    assert gap[int(0.78 * RATE_HZ)] == 0
    first = Phone("ɑ", 0.3, 0.5)
    gap = opening(values_of(PhoneTrack.from_phones([first, Phone(SILENCE, 0.5, 0.56), Phone("ɑ", 0.56, 0.8)])))
    assert gap[40:60].min() > 100


@pytest.mark.parametrize(("pause_s", "rests"), [(0.085, False), (0.105, True), (0.2, True), (0.29, True)])
def test_a_pause_from_a_tenth_of_a_second_on_passes_through_rest(pause_s: float, rests: bool) -> None:
    vowels = [Phone("ɑ", 0.3, 0.5), Phone(SILENCE, 0.5, 0.5 + pause_s), Phone("ɑ", 0.5 + pause_s, 0.8 + pause_s)]
    values = values_of(PhoneTrack.from_phones([*vowels, Phone(SILENCE, 0.8 + pause_s, 1.5)]), rate_hz=200.0)
    middle = values[round((0.5 + pause_s / 2) * 200)]
    assert (np.abs(middle).max() <= 2) == rests


def test_a_pause_of_four_tenths_of_a_second_holds_rest() -> None:
    phones = PhoneTrack.from_phones([Phone("ɑ", 0.3, 0.5), Phone(SILENCE, 0.5, 0.91), Phone("ɑ", 0.91, 1.0)])
    held = values_of(phones, rate_hz=200.0)[124:135]  # from 0.12 s behind one to 0.24 s before the other
    assert np.abs(held).max() <= 12  # a quarter of a millimetre


@pytest.mark.parametrize("begin_s", [0.3, 1.2])
def test_lips_have_the_shape_of_the_first_phone_before_it_is_heard(begin_s: float) -> None:
    """Also after a pause; until just before, the face is neutral."""
    before = [Phone(label, 0.3 + 0.1 * n, 0.4 + 0.1 * n) for n, label in enumerate("sin")] if begin_s > 1 else []
    openings = []
    for label in "bsɑ":
        spoken = [Phone(label, begin_s, begin_s + 0.1), Phone("n", begin_s + 0.1, begin_s + 0.2)]
        phones = PhoneTrack.from_phones([*before, *spoken])
        neutral, ready, heard = weights_of(phones, english(), begin_s + np.array([-0.24, -0.12, 0.02]))
        assert np.abs(neutral).max() < 1e-9
        np.testing.assert_allclose(ready, heard, atol=1e-9)
        openings.append(opening(values_of(phones))[round(100 * (begin_s - 0.12))])
    assert np.diff(openings).min() > 50


def test_a_track_lasts_until_the_face_is_at_rest_however_soon_its_phones_end() -> None:
    spoken = [Phone("ɑ", 0.3, 0.5)]
    for phones in (PhoneTrack.from_phones(spoken), PhoneTrack.from_phones([*spoken, Phone(SILENCE, 0.5, 0.51)])):
        assert rest_s(phones) == rest_s(phones, 0.4) == pytest.approx(0.5 + REST_MARGIN_S)
        values = values_of(phones)
        assert len(values) == 62
        assert np.abs(np.diff(opening(values))).max() < 150  # closes as gently as anywhere else
        assert opening(values)[-1] <= 10
    assert rest_s(phones, 2.0) == 2.0
    assert rest_s(PhoneTrack(())) == 0.0
    assert len(values_of(PhoneTrack.from_phones([Phone(SILENCE, 0.0, 1.0)]))) == 100


def test_silence_alone_is_a_still_face() -> None:
    phones = PhoneTrack.from_phones([Phone(SILENCE, 0.0, 1.0)])
    assert not values_of(phones).any()
    assert not values_of(PhoneTrack(())).any()


def test_a_label_that_is_no_ipa_is_counted() -> None:
    planned = plan(track("m %% m %%"), english(), rng=np.random.default_rng(1))
    assert planned.unknown == {"%%": 2}


@pytest.mark.parametrize("letter", sorted(ipa.SOUNDS))
def test_every_ipa_letter_has_a_target(letter: str) -> None:
    keys = keys_of(PhoneTrack.from_phones([Phone(letter, 0.0, 0.1)]), english())
    assert not keys.unknown
    assert len(keys.targets) >= 1


@pytest.mark.parametrize("letter", "pbmɸβ")
def test_what_sounds_like_a_bilabial_closes(letter: str) -> None:
    keys = keys_of(PhoneTrack.from_phones([Phone(letter, 0.0, 0.1)]), english())
    assert keys.said[0][0][1] == "lips"


def test_parts_of_a_strange_diphthong_share_its_time() -> None:
    keys = keys_of(PhoneTrack.from_phones([Phone("ɔɪ", 1.0, 1.2)]), english(), context=False)
    assert keys.times_s == pytest.approx((1.03, 1.13))


def test_the_same_seed_is_the_same_face() -> None:
    phones = track("b aɪ t s ʌ n ʃ aɪ n", each_s=0.4)
    one, same, other = (values_of(phones, style=Style(), rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_articulation_scales_speech() -> None:
    small, large = (opening(values_of(track("m ɑ m"), style=Style.speech_only(articulation=a)))
                    for a in (0.5, 1.5))  # fmt: skip
    assert large.max() > 2.2 * small.max()


def test_determined_faps_are_measured_by_unit_and_direction() -> None:
    points = english().space.points
    moved = np.zeros((1, len(points), 3))
    moved[0, points.index("8.3")] = [5.0, 2.0, 0.0]  # the left corner goes left and up
    moved[0, points.index("2.1")] = [-1.0, -8.0, 0.5]  # the chin goes right and down
    faps = displacements_to_faps(moved, points, english().fapu)[0]
    unit = english().fapu.unit
    assert faps[fap.column(53)] == pytest.approx(5.0 / unit(fap.FapUnit.MW))
    assert faps[fap.column(59)] == pytest.approx(2.0 / unit(fap.FapUnit.MNS))
    assert faps[fap.column(3)] == pytest.approx(8.0 / unit(fap.FapUnit.MNS))
    assert faps[fap.column(15)] == pytest.approx(1.0 / unit(fap.FapUnit.MW))
    assert faps[fap.column(18)] == pytest.approx(8.0 / unit(fap.FapUnit.MNS))  # the boss stays while the jaw drops
    others = set(range(1, 69)) - set(DETERMINED)
    assert not faps[[fap.column(number) for number in others]].any()


def test_codable_values_are_rounded_and_in_range() -> None:
    wild = np.full((1, 68), 1e9)
    assert to_codable(wild)[0, fap.column(3)] == 4320
    assert to_codable(-wild)[0, fap.column(3)] == 0
    assert to_codable(-wild)[0, fap.column(4)] == -1200
    assert to_codable(np.full((1, 68), 2.6))[0, fap.column(4)] == 3


def test_refuses() -> None:
    with pytest.raises(UsageError, match="rate_hz"):
        plan(track("m"), english(), rng=np.random.default_rng(1), rate_hz=0.0)
    with pytest.raises(UsageError, match="strength 5"):
        plan(track("m"), english(), rng=np.random.default_rng(1), expressions={Expression.JOY: 5})
    with pytest.raises(UsageError, match="does not have it"):
        plan(track("m"), english(), rng=np.random.default_rng(1), expressions={Expression.NEUTRAL: 0.5})


@given(st.lists(st.lists(st.integers(0, 60), min_size=1, max_size=8, unique=True), min_size=1, max_size=3))
def test_keys_of_every_track_are_far_enough_apart_and_its_ends_stay(tracks: list[list[int]]) -> None:
    step_s = CLOSEST_KEYS_S / 8.5  # no distance is the smallest itself
    times_s = [np.sort(steps) * step_s for steps in tracks]
    track_of = np.repeat(np.arange(len(tracks)), [len(steps) for steps in tracks])
    kept = np.zeros(len(track_of), bool)
    kept[_apart(np.concatenate(times_s), track_of)] = True
    for number, mine in enumerate(times_s):
        is_kept = kept[track_of == number]
        assert is_kept[[0, -1]].all()
        assert np.diff(mine[is_kept]).min(initial=CLOSEST_KEYS_S) >= CLOSEST_KEYS_S or is_kept.sum() == 2
        for time_s in mine[~is_kept]:  # each too near to one before it or to the end
            distances_s = time_s - mine[is_kept]
            assert (
                np.abs(distances_s[(distances_s > 0) | (np.arange(len(distances_s)) == len(distances_s) - 1)])
                < CLOSEST_KEYS_S
            ).any()
