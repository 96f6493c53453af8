"""Manners of speaking: gains of jaw and lips, loudness, ways to a path."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.speaking import METHOD_NAMES
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.closures import CONTACTS, settle
from fapengine.trajectory.faps import Composer
from fapengine.trajectory.methods import SPLINES, dominance, sample_path
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from fapengine.trajectory.targets import keys_of
from tests.english import english

PHONES = PhoneTrack.from_phones(
    [Phone(label, 0.3 + 0.12 * n, 0.42 + 0.12 * n) for n, label in enumerate(["m", "ɑ", "s", "uː", "f", "aɪ", "p"])]
    + [Phone("_", 0.3 + 0.12 * 7, 1.6)]
)


def values(style: Style) -> NDArray[np.int32]:
    return plan(PHONES, english(), rng=np.random.default_rng(1), rate_hz=100.0, style=style).track.values


def still(**options: object) -> Style:
    off = dict.fromkeys(("blinks", "head_motion", "gaze", "idle", "emphasis"), False)
    return Style(**off, **options)  # type: ignore[arg-type]


def test_gains_of_one_change_nothing() -> None:
    np.testing.assert_allclose(Style().gains(english()), np.eye(english().space.mode_count), atol=1e-15)
    np.testing.assert_allclose(Style(1.7).gains(english()), 1.7 * np.eye(english().space.mode_count), atol=1e-12)


@pytest.mark.parametrize(("jaw", "share"), [(0.5, 0.5), (1.0, 1.0), (2.0, 1.0)])
def test_an_open_vowel_is_held_as_open_as_the_jaw_allows_and_no_wider(jaw: float, share: float) -> None:
    hold = (np.array(CONTACTS) == "open").astype(float)[:, None]
    shown = Composer(english(), Style(jaw)).faps(np.zeros((english().space.mode_count + WIDTH, 1)), hold.copy(), None)
    np.testing.assert_allclose(shown, settle(np.zeros((1, fap.FAP_COUNT)), share * hold), atol=1e-9)


def test_the_jaw_gain_scales_the_drop_of_the_chin_and_leaves_the_lips_their_part() -> None:
    chin = english().space.points.index("2.1")
    poses = np.random.default_rng(3).normal(size=(20, english().space.mode_count))
    plain = english().space.to_points_mm(poses)
    for style, jaw in (
        (Style(jaw=0.5), 0.5),
        (Style(jaw=2.0), 2.0),
        (Style(lips=0.3), 1.0),
        (Style(loudness_db=12), 2.0),
    ):
        moved = english().space.to_points_mm(poses @ style.gains(english()))
        np.testing.assert_allclose(moved[:, chin, 1], jaw * plain[:, chin, 1], atol=1e-9)
    stiff = english().space.to_points_mm(poses @ Style(jaw=0.0, lips=1.0).gains(english()))
    slack = english().space.to_points_mm(poses @ Style(jaw=1.0, lips=0.0).gains(english()))
    np.testing.assert_allclose(stiff + slack, plain, atol=1e-9)
    assert np.abs(stiff).max() > 1


def test_jaw_and_lips_show_in_different_faps() -> None:
    plain, jaw, lips = values(still()), values(still(jaw=0.3)), values(still(lips=0.3))
    drop, wide = fap.column(3), [fap.column(53), fap.column(54)]
    assert jaw[:, drop].max() < 0.4 * plain[:, drop].max()
    assert lips[:, drop].max() > 0.9 * plain[:, drop].max()
    assert np.ptp(lips[:, wide]) < 0.75 * np.ptp(plain[:, wide])


def test_louder_opens_farther() -> None:
    drops = [values(still(loudness_db=db))[:, fap.column(3)].max() for db in (-12, 0, 12, 15, 20)]
    assert 1.7 * drops[0] < drops[1] < drops[2] / 1.7
    assert drops[2] < drops[3] == drops[4]


def test_louder_lips_draw_wider_and_rounder_and_quieter_ones_less() -> None:
    for label, number in (("i", 6), ("u", 16)):
        said = PhoneTrack.from_phones([Phone(label, 0.2, 0.5)])
        quiet, plain, loud = (
            plan(said, english(), rng=np.random.default_rng(1), rate_hz=100.0, style=still(jaw=jaw, loudness_db=db))
            .track.values[:, fap.column(number)].max()
            for db, jaw in ((-12, 2.0), (0, 1.0), (12, 0.5))
        )  # fmt: skip
        assert 1.02 * quiet < plain < loud / 1.02


@pytest.mark.parametrize(
    "style", [still(articulation=0.0), still(jaw=0.0, lips=3.0), still(articulation=3.0), still(jaw=3.0)]
)
def test_contacts_are_made_in_every_style(style: Style) -> None:
    faps = values(style)
    opening = -(faps[:, fap.column(4)] + faps[:, fap.column(5)])
    assert opening.min() >= -2
    assert (opening[30:37] <= 14).sum() >= 4  # m
    assert (faps[78:90, fap.column(5)] >= -1).sum() >= 4  # f


def test_a_face_that_does_not_articulate_holds_no_vowel_open() -> None:
    assert Style(articulation=0.0).openness == 0
    assert Style(jaw=0.5).openness == 0.5
    assert Style(jaw=2.0).openness == 1
    assert values(still(articulation=0.0))[:, fap.column(3)].max() == 0


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_every_method_makes_speech_that_rests_at_both_ends(method: str) -> None:
    faps = values(Style.speech_only(method=method))  # type: ignore[arg-type]
    opening = -(faps[:, fap.column(4)] + faps[:, fap.column(5)])
    assert opening.max() > 150
    tolerance = 60 if method == "dominance" else 1  # which never quite rests
    assert np.abs(faps[[0, -1]]).max() <= tolerance
    if method != "published":  # paper 001 itself closes no lips
        assert (opening[30:37] <= 14).sum() >= 4


def test_methods_differ_and_pass_their_keys() -> None:
    times = np.arange(0, 1.6, 0.01)
    paths = {}
    for method in (name for name in METHOD_NAMES if name != "published"):  # which leaves the phonetic layer out
        keys = keys_of(PHONES, english(), context=method == "context")
        paths[method] = sample_path(method, keys, times)
        if method != "dominance":
            met = sample_path(method, keys, keys.keyframes().times_s)
            np.testing.assert_allclose(met, keys.keyframes().weights, atol=1e-9)
    assert {*SPLINES, "dominance"} == {*METHOD_NAMES}
    assert all(np.abs(paths[a] - paths[b]).max() > 0.05 for a in paths for b in paths if a != b)
    assert not sample_path("minimum-jerk", keys_of(PhoneTrack(()), english()), times).any()


def test_minimum_jerk_has_less_jerk_than_the_local_path() -> None:
    keys = keys_of(PHONES, english(), context=False)
    frames = keys.keyframes()
    times = np.arange(frames.times_s[0], frames.times_s[-1], 0.001)
    jerk = [
        (np.diff(sample_path(method, keys, times)[:, :-WIDTH], 3, axis=0) ** 2).sum()
        for method in ("minimum-jerk", "context")
    ]  # type: ignore[arg-type]
    assert jerk[0] < jerk[1]


def test_dominance_is_the_mean_of_two_equal_neighbours_halfway() -> None:
    phones = PhoneTrack.from_phones([Phone("s", 5.0, 5.2), Phone("uː", 5.2, 5.4)])
    keys = keys_of(phones, english(), context=False)
    halfway = dominance(keys, np.array([5.2]), rate_hz=60.0)[0]
    middle = (keys.targets[0] + keys.targets[1]) / 2
    np.testing.assert_allclose(halfway, middle, atol=0.02 * np.abs(middle).max())
    np.testing.assert_allclose(dominance(keys, np.array([5.1]), 500.0)[0], keys.targets[0], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"articulation": 9.0}, "articulation: must be 0 to 3, got 9.0"),
        ({"jaw": -0.1}, "jaw: must be 0 to 3, got -0.1"),
        ({"lips": float("nan")}, "lips: got nan, expected a number"),
        ({"loudness_db": 30.0}, "loudness_db: must be -20 to 20, got 30.0"),
        ({"method": "magic"}, "method: got 'magic', expected one of context, paper"),
    ],
)
def test_refuses(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Style(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize("loudness_db", [8.0, 3.0])
def test_phones_said_louder_move_as_a_louder_style_does(loudness_db: float) -> None:
    louder = PhoneTrack(tuple(replace(phone, loudness_db=loudness_db) for phone in PHONES.phones))
    of_phones = plan(louder, english(), rng=np.random.default_rng(1), rate_hz=100.0, style=still()).track.values
    louder_style = values(still(loudness_db=loudness_db))
    np.testing.assert_allclose(of_phones, louder_style, atol=3)  # a path's slopes are not linear
    assert np.abs(of_phones - values(still())).max() > 50


def test_a_whispered_word_opens_less_and_still_closes() -> None:
    quiet = PhoneTrack(tuple(replace(phone, loudness_db=-12.0) for phone in PHONES.phones))
    whispered = plan(quiet, english(), rng=np.random.default_rng(1), rate_hz=100.0, style=still()).track.values
    opening, plain = (-(faps[:, 3] + faps[:, 4]) for faps in (whispered, values(still())))
    assert 150 < opening.max() < 0.6 * plain.max()
    for phone in PHONES.phones:
        if phone.label in ("m", "p"):
            assert opening[round(100 * phone.start_s) : round(100 * phone.end_s)].min() < 15
