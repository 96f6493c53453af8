"""FAP 1 and 2: blends, precedence of low-level FAPs, definitions, and visemes chosen for a planned sentence."""

from dataclasses import replace

import numpy as np
import pytest

from design.high_level_faces import TARGET, source
from fapengine.errors import DataError
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import MOUTH, FapTrack, to_codable
from fapengine.profiles import Profile
from fapengine.scoring.mouth import closures_of_truth, mouth_of
from fapengine.trajectory.high_level import HighLevelFaps, expand, expression_faces, to_visemes, viseme_faces
from fapengine.trajectory.planner import plan
from tests.unit.trajectory.test_planner import track as phones_of

JAW, LIP = fap.column(3), fap.column(4)
SENTENCE = "m aɪ b oʊ t f l oʊ t s oʊ v ə ð i oʊ ʃ ə n"


@pytest.fixture(scope="module")
def profile() -> Profile:
    return load_profile("grid_s1_en")


def track_of(
    visemes: list[tuple[int, ...]] | None = None,
    expressions: list[tuple[int, ...]] | None = None,
    faps: dict[int, int] | None = None,
) -> FapTrack:
    """A track whose every frame sends what is given."""
    count = len(visemes or expressions or [()])
    values, mask = np.zeros((count, 68), int), np.zeros((count, 68), bool)
    mask[:, 0], mask[:, 1] = visemes is not None, expressions is not None
    for number, value in (faps or {}).items():
        values[:, fap.column(number)], mask[:, fap.column(number)] = value, True
    empty = FapTrack.from_values(values, rate_hz=25.0)
    return replace(
        empty, mask=mask, visemes=empty.visemes if visemes is None else np.array(visemes),
        expressions=empty.expressions if expressions is None else np.array(expressions),
    )  # fmt: skip


def test_faces_of_visemes_do_what_their_phones_do(profile: Profile) -> None:
    faces = viseme_faces(profile)
    opening = -(faces[:, LIP] + faces[:, fap.column(5)]) * profile.fapu.mns0_mm / 1024
    assert np.argmax(opening) == 10  # ɑː
    assert abs(opening[1]) < 0.1  # p b m
    assert opening[10] > 8
    assert faces[14, fap.column(16)] > 400  # ʊ: lips forward
    assert faces[3, fap.column(45)] > 200  # θ: tongue between the teeth
    assert not faces[0].any()


def test_a_blend_is_the_standard_s_mixture(profile: Profile) -> None:
    faces = viseme_faces(profile)
    shown = expand(track_of(visemes=[(10, 1, 63, 0), (10, 1, 0, 0), (10, 1, 21, 0)]), profile)
    expected = [faces[10], faces[1], faces[10] / 3 + faces[1] * 2 / 3]
    np.testing.assert_array_equal(shown.values, np.rint(expected))
    assert shown.mask[:, 2:].all()
    assert not shown.mask[:, :2].any()
    assert expand(shown, profile) is shown


def test_expressions_have_an_intensity_each_and_add_to_the_viseme(profile: Profile) -> None:
    joy, surprise = expression_faces(profile)[[1, 6]]
    shown = expand(track_of([(10, 0, 63, 0)], [(1, 21, 6, 42, 0, 0)]), profile)
    added = viseme_faces(profile)[10] + joy / 3 + surprise * 2 / 3
    np.testing.assert_array_equal(shown.values[0], to_codable(added[None])[0])


def test_a_low_level_fap_that_is_sent_takes_precedence(profile: Profile) -> None:
    shown = expand(track_of([(10, 0, 63, 0)], faps={3: 5, 19: 0}), profile)
    assert shown.values[0, JAW] == 5
    assert shown.values[0, LIP] == round(viseme_faces(profile)[10][LIP])


def test_a_viseme_that_is_not_sent_again_is_held(profile: Profile) -> None:
    sent = track_of([(10, 0, 63, 0), (0, 0, 0, 0)])
    mask = sent.mask.copy()
    mask[1, 0] = False
    shown = expand(replace(sent, mask=mask), profile)
    np.testing.assert_array_equal(shown.values[1], shown.values[0])


def test_init_face_lays_low_level_faps_over_the_expression(profile: Profile) -> None:
    joy = expression_faces(profile)[1]
    shown = expand(track_of(expressions=[(1, 63, 0, 0, 1, 0)], faps={3: 100}), profile)
    assert shown.values[0, JAW] == round(100 + joy[JAW])
    assert shown.values[0, fap.column(12)] == round(joy[fap.column(12)])


def test_definitions_are_kept_for_later_frames(profile: Profile) -> None:
    state = HighLevelFaps(profile)
    values, mask = np.zeros(68, np.int32), np.zeros(68, bool)
    mask[[0, 1, JAW]], values[JAW] = True, 250
    state.show(values, mask, np.array([4, 0, 63, 1]), np.array([2, 21, 0, 0, 0, 1]))
    only_viseme = np.arange(68) == 0
    shown, _ = state.show(values * 0, only_viseme, np.array([4, 0, 63, 0]), np.zeros(6, int))
    assert shown[JAW] == 250 + 250  # the viseme, and the expression at the intensity of its definition
    other = HighLevelFaps(profile)
    other.show(values, mask, np.array([4, 5, 10, 1]), np.zeros(6, int))
    shown, _ = other.show(values * 0, only_viseme, np.array([4, 5, 0, 0]), np.zeros(6, int))
    assert shown[JAW] == 250  # the second weighs more


def test_nothing_happens_before_the_first_viseme(profile: Profile) -> None:
    values, mask = np.zeros(68, np.int32), np.arange(68) == JAW
    shown, known = HighLevelFaps(profile).show(values + 7 * mask, mask, np.zeros(4, int), np.zeros(6, int))
    assert known.tolist() == mask.tolist()
    assert shown.sum() == 7


def test_visemes_follow_a_planned_sentence_to_less_than_a_millimetre(profile: Profile) -> None:
    planned = plan(phones_of(SENTENCE), profile, rng=np.random.default_rng(1)).track
    visemes = to_visemes(planned, profile)
    assert visemes.mask.sum() == len(planned)
    unit_mm = profile.fapu.steps()[MOUTH]
    still_mm = planned.values[:, MOUTH] * unit_mm
    off_mm = still_mm - expand(visemes, profile).values[:, MOUTH] * unit_mm
    rms = np.sqrt([(off_mm**2).mean(), (still_mm**2).mean()])
    assert rms[0] < 0.8
    assert rms[0] < rms[1] / 3


@pytest.mark.parametrize("rate_hz", [60.0, 240.0])
def test_visemes_close_lips_and_do_not_jump(profile: Profile, rate_hz: float) -> None:
    phones = phones_of("m a p i b u m o _ b e m")
    planned = plan(phones, profile, rng=np.random.default_rng(1), rate_hz=rate_hz).track
    visemes = to_visemes(planned, profile)
    closures = closures_of_truth(mouth_of(expand(visemes, profile)), mouth_of(planned), closed_mm=0.5)
    assert closures.met == closures.wanted >= 4  # 2 of 6 where each frame is chosen alone
    first, second, blend, _ = visemes.visemes.T
    shares = blend[:, None] / 63 * np.eye(15)[first] + (1 - blend[:, None] / 63) * np.eye(15)[second]
    assert np.abs(np.diff(shares, axis=0)).max() < 0.3  # measured 0.22


def test_pages_have_the_same_faces() -> None:
    assert TARGET.read_text() == source()


@pytest.mark.parametrize(
    ("visemes", "expressions", "said"),
    [
        ([(15, 0, 63, 0)], None, "viseme_select: got 15, expected 0 to 14"),
        ([(0, -1, 63, 0)], None, "viseme_select: got -1"),
        (None, [(0, 0, 7, 1, 0, 0)], "expression_select: got 7, expected 0 to 6"),
    ],
)
def test_faces_that_do_not_exist_are_data_errors(
    profile: Profile, visemes: list[tuple[int, ...]] | None, expressions: list[tuple[int, ...]] | None, said: str
) -> None:
    with pytest.raises(DataError, match=said):
        expand(track_of(visemes, expressions), profile)


def test_weights_beyond_their_range_are_clipped(profile: Profile) -> None:
    shown = expand(track_of([(10, 1, 500, 0)], [(1, -5, 0, 10**6, 0, 0)]), profile)
    np.testing.assert_array_equal(shown.values[0], np.rint(viseme_faces(profile)[10]))


def test_what_goes_before_counts_as_much_as_what_follows(profile: Profile) -> None:
    """The cheapest way there is the cheapest way back."""
    planned = plan(phones_of(SENTENCE), profile, rng=np.random.default_rng(1)).track.values[20:]
    there, back = (to_visemes(FapTrack.from_values(one, rate_hz=60.0), profile) for one in (planned, planned[::-1]))
    np.testing.assert_array_equal(there.visemes, back.visemes[::-1])
