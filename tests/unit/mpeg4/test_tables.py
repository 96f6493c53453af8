"""The standard's tables against a second transcription, and FAPU, and FapTrack."""

import csv
from pathlib import Path

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES, FEATURE_POINTS, VISEMES
from fapengine.mpeg4.fapu import AU_RAD, Fapu, faps_of_displacements, measure_distances
from fapengine.mpeg4.track import FapTrack

pytestmark = pytest.mark.conformance

VECTORS = Path(__file__).parent.parent.parent / "vectors"
ROWS = list(csv.DictReader((VECTORS / "fap_table.csv").read_text(encoding="utf-8").splitlines()))
FACE = Fapu(irisd0_mm=10.24, es0_mm=61.44, ens0_mm=51.2, mns0_mm=20.48, mw0_mm=51.2)


def test_both_transcriptions_are_whole() -> None:
    assert len(ROWS) == len(fap.FAPS) == 66
    assert [row.number for row in fap.FAPS] == list(range(3, 69))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["number"])
def test_fap_row_agrees_with_the_second_transcription(row: dict[str, str]) -> None:
    spec = fap.spec(int(row["number"]))
    mine = (spec.name, str(spec.unit), "B" if spec.bidirectional else "U", str(spec.positive), spec.point)
    assert mine == (row["name"], row["unit"], row["uni_bi"], row["positive"], row["point"])
    numbers = (spec.group, spec.quantiser_step, spec.intra_limit, spec.predicted_limit)
    assert numbers == tuple(int(row[key]) for key in ("group", "step", "intra", "predicted"))


def test_groups_have_the_standards_sizes() -> None:
    assert [len(group) for group in fap.GROUPS] == [2, 16, 12, 8, 4, 5, 3, 10, 4, 4]
    assert sum(fap.GROUPS, ()) == tuple(range(1, 69))


def test_column_is_the_one_place_that_subtracts() -> None:
    assert (fap.column(1), fap.column(68)) == (0, 67)
    for wrong in (0, 69, -1):
        with pytest.raises(UsageError, match=f"got {wrong}"):
            fap.column(wrong)
    for wrong in (1, 2, 69):
        with pytest.raises(UsageError, match=r"must be 3 to 68"):
            fap.spec(wrong)
    with pytest.raises(UsageError, match="'open_jar'"):
        fap.by_name("open_jar")
    assert all(fap.by_name(row.name) is row for row in fap.FAPS)


def test_feature_points_are_84_and_paired() -> None:
    assert len(FEATURE_POINTS) == len(set(FEATURE_POINT_NAMES)) == 84
    sides = [point.place.split()[-1] for point in FEATURE_POINTS]
    assert sides.count("left") == sides.count("right") > 20
    assert {row.point for row in fap.FAPS} <= set(FEATURE_POINT_NAMES)


def test_visemes_are_15_and_share_no_phoneme() -> None:
    assert [viseme.number for viseme in VISEMES] == list(range(15))
    phonemes = [phoneme for viseme in VISEMES for phoneme in viseme.phonemes]
    assert len(phonemes) == len(set(phonemes)) == 24


def test_fapu_is_a_1024th_and_au_an_angle() -> None:
    assert FACE.unit(fap.FapUnit.MNS) == pytest.approx(0.02)
    assert FACE.unit(fap.FapUnit.AU) == AU_RAD == 1e-5
    steps = FACE.steps()
    assert steps.shape == (68,)
    assert not steps[:2].any()
    assert (steps[2:] > 0).all()


def test_fapu_is_measured_from_feature_points() -> None:
    points = {
        "2.2": (0, -32.48, 0), "9.15": (0, -12, 0), "3.1": (31, 41, 0), "3.2": (-31, 41, 0), "3.3": (31, 30.76, 0),
        "3.4": (-31, 30.76, 0), "3.5": (30.72, 39.2, 0), "3.6": (-30.72, 39.2, 0), "8.3": (25.6, -34, 0),
        "8.4": (-25.6, -34, 0),
    }  # fmt: skip
    face = Fapu.measure(points)
    assert [getattr(face, name) for name in face.__slots__] == pytest.approx([10.24, 61.44, 51.2, 20.48, 51.2])
    with pytest.raises(UsageError, match=r"missing feature points \['8.4'\]"):
        Fapu.measure({name: point for name, point in points.items() if name != "8.4"})
    assert measure_distances({}) == {}
    some = {name: points[name] for name in ("3.2", "3.4", "3.5", "3.6", "8.3", "8.4")}
    assert measure_distances(some) == pytest.approx({"irisd0_mm": 10.24, "es0_mm": 61.44, "mw0_mm": 51.2})


def test_displaced_points_become_faps_in_their_units() -> None:
    moved = np.array([[0.4, -1.0, 0.2], [0.0, 0.5, 0.0]])
    faps = faps_of_displacements({"2.1": moved, "2.10": moved + np.array([0.0, 0.3, 0.0]), "3.5": moved}, FACE)
    unit = FACE.unit(fap.FapUnit.MNS)
    assert faps[:, fap.column(3)] == pytest.approx(np.array([1.0, -0.5]) / unit)  # down
    assert faps[:, fap.column(14)] == pytest.approx(np.array([0.2, 0.0]) / unit)
    assert faps[:, fap.column(18)] == pytest.approx(0.3 / unit)  # against the jaw
    assert not faps[:, [fap.column(number) for number in (4, 23, 25, 29)]].any()  # other points, angles, pupils
    alone = faps_of_displacements({"2.10": moved}, FACE)
    assert alone[:, fap.column(18)] == pytest.approx(moved[:, 1] / unit)


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan"), float("inf")])
def test_fapu_refuses_what_is_no_length(length: float) -> None:
    with pytest.raises(UsageError, match="es0_mm"):
        Fapu(irisd0_mm=10, es0_mm=length, ens0_mm=50, mns0_mm=20, mw0_mm=50)


def test_track_of_values_sends_every_low_level_fap() -> None:
    track = FapTrack.from_values(np.zeros((3, 68), int), rate_hz=25.0)
    assert len(track) == 3
    assert track.mask.sum() == 3 * 66
    assert track.times_s.tolist() == [0.0, 0.04, 0.08]
    assert track.equals(FapTrack.from_values(np.zeros((3, 68), int), rate_hz=25.0))
    assert not track.equals(FapTrack.from_values(np.zeros((3, 68), int), rate_hz=30.0))


def test_track_refuses() -> None:
    with pytest.raises(UsageError, match="rate_hz"):
        FapTrack.from_values(np.zeros((1, 68)), rate_hz=0)
    high_level = np.zeros((1, 68), int)
    high_level[0, 0] = 3
    with pytest.raises(UsageError, match="FAP 1 and 2"):
        FapTrack.from_values(high_level, rate_hz=25)
    with pytest.raises(UsageError, match=r"values: got \[\[0, 0\], \[0\]\], expected \(T, 68\) numbers"):
        FapTrack.from_values([[0, 0], [0]], rate_hz=25)
    good = FapTrack.from_values(np.zeros((2, 68)), rate_hz=25)
    parts = {name: getattr(good, name) for name in ("values", "mask", "visemes", "expressions")}
    with pytest.raises(UsageError, match="strictly rising"):
        FapTrack(**parts, frame_numbers=np.array([1, 1]), rate_hz=25)
    with pytest.raises(UsageError, match="visemes"):
        FapTrack(**(parts | {"visemes": np.zeros((2, 3))}), frame_numbers=np.array([0, 1]), rate_hz=25)
