"""The expression at rest: a pose for display that yields to whatever the face does."""

import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import BROWS, LIMITS, LIPS, RESTING, SMILE_FAPU, deform, with_rest
from fapengine.mpeg4 import fap


def frame(**values: float) -> np.ndarray:
    faps = np.zeros(68)
    for number, value in values.items():
        faps[fap.column(int(number[1:]))] = value
    return faps


def test_a_face_at_rest_smiles_and_lowers_its_lids() -> None:
    rested = with_rest(np.zeros((2, 68)), 1.0)
    assert (rested[:, [fap.column(number) for number in (12, 13, 19, 20, 59, 60)]] > 40).all()
    assert with_rest(np.zeros(68), 0.5) == pytest.approx(rested[0] / 2)
    assert not with_rest(np.zeros(68), 0.0).any()


@pytest.mark.parametrize(
    ("does", "untouched"),
    [
        ({"f19": 1024.0}, (19,)),
        ({"f20": -400.0}, (20,)),
        ({"f12": 250.0}, (12, 13, 53, 59, 41)),
        ({"f60": -300.0}, (12, 13, 53, 59, 42)),
        ({"f31": -250.0}, (12, 13, 59, 60, 41, 42)),
    ],
)
def test_it_yields(does: dict[str, float], untouched: tuple[int, ...]) -> None:
    faps = frame(**does)
    columns = [fap.column(number) for number in untouched]
    assert with_rest(faps, 1.0)[columns] == pytest.approx(faps[columns])
    assert with_rest(0.5 * faps, 1.0) != pytest.approx(0.5 * faps)


@pytest.mark.parametrize("number", sorted({number for rest in RESTING for number in rest.values}))
def test_a_fap_that_rises_never_falls(number: int) -> None:
    rising = np.linspace(-600, 900, 301)
    frames = rising[:, None] * frame(**{f"f{number}": 1.0})
    drawn = with_rest(frames, 1.0)[:, fap.column(number)]
    assert (np.diff(drawn)[np.abs(rising[1:]) < LIMITS.get(number, np.inf)] > 0).all()
    assert (np.diff(drawn) >= 0).all()


@pytest.mark.parametrize("number", [21, 27, 40, 61, 63, 68])
def test_no_fap_goes_where_anatomy_ends(number: int) -> None:
    column, limit = fap.column(number), LIMITS[number]
    for value, drawn in ((0.9 * limit, 0.9 * limit), (5 * limit, limit), (-5 * limit, -limit)):
        for share in (0.0, 1.0):
            assert with_rest(value * frame(**{f"f{number}": 1.0}), share)[column] == drawn


def test_a_raised_lower_lid_yields_to_a_blink() -> None:
    blink = frame(f19=963.0, f20=500.0, f21=176.0, f22=176.0)
    assert with_rest(blink, 0.0)[18:22] == pytest.approx([963, 500, 61, 176])
    assert with_rest(2 * blink, 0.0)[18:22] == pytest.approx([1926, 1000, 0, 24])
    assert with_rest(-blink, 0.0) == pytest.approx(-blink)


def test_a_smile_reaches_the_eye_of_its_side() -> None:
    half, whole = (with_rest(frame(f12=value), 1.0) - with_rest(frame(f13=value), 1.0) for value in (220.0, 500.0))
    eye, other = ([fap.column(number + side) for number in (19, 21)] for side in (0, 1))
    assert whole[eye] == pytest.approx([-60, 85])
    assert whole[other] == pytest.approx(-whole[eye])
    assert not whole[fap.columns(*BROWS)].any()
    assert half[eye] == pytest.approx(whole[eye] / 2)
    assert with_rest(frame(f12=500.0), 0.0) == pytest.approx(frame(f12=500.0))
    level = with_rest(frame(f12=SMILE_FAPU[0]), 1.0) - with_rest(frame(f12=-SMILE_FAPU[0]), 1.0)
    assert level[eye] == pytest.approx(0.0)


SMILES = {"f12": 500.0, "f13": 500.0}


def openings(faps: np.ndarray) -> np.ndarray:
    """(3, 2) FAPU: opening between the lips, by inner and by outer contours: middle, left and right."""
    return np.array([[-faps[fap.columns(*pair)].sum() for pair in (row[:2], row[2:])] for row in LIPS])


def test_open_lips_that_smile_part_farther_and_shut_ones_stay_shut() -> None:
    lips = dict.fromkeys(("f4", "f8", "f9", "f51", "f55", "f56"), -90.0)
    lips |= dict.fromkeys(("f5", "f10", "f11", "f52", "f57", "f58"), -150.0)
    whole, half, none = (openings(with_rest(frame(**does, **lips), 1.0)) for does in (SMILES, {"f12": 500.0}, {}))
    assert none == pytest.approx(240.0)
    assert (whole > 340.0).all()
    assert half == pytest.approx((whole + none) / 2)
    shut = frame(**SMILES, f4=80.0, f5=-80.0, f8=30.0, f10=-10.0)
    assert openings(with_rest(shut, 1.0))[:, 0] == pytest.approx(openings(shut)[:, 0])
    wide = [openings(with_rest(frame(**SMILES, f5=-value), 1.0))[0, 0] for value in np.linspace(0, 900, 61)]
    assert (np.diff(wide) > 0).all()


def test_lips_stay_shut() -> None:
    head = build_head()
    points = head.vertices_mm.astype(float), deform(head, with_rest(np.zeros(68), 1.0))
    for upper, lower in (("2.2", "2.3"), ("2.6", "2.8"), ("2.7", "2.9")):
        before, after = (each[head.feature_points[upper]] - each[head.feature_points[lower]] for each in points)
        assert after[1] - before[1] == pytest.approx(0.0, abs=0.05)  # mm
