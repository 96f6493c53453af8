"""People by name and by number: within bounds, different, and with every promise of the default head."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.colours import EYE_COLOURS
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.people import PEOPLE, parse_person, somebody
from fapengine.mesh.default_head.relief_table import RELIEF_TENTHS_MM
from fapengine.mesh.default_head.style import HeadStyle, parse_look
from fapengine.mesh.default_head.surface import position, radius
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import BROWN_IRIS, FaceMesh, Material
from fapengine.mpeg4 import fap

MOVING = [row for row in fap.FAPS if row.positive in fap.HEAD_AXES and row.unit is not fap.FapUnit.AU]


@pytest.fixture(autouse=True)
def unpainted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Painting takes longer than a coarse head."""
    monkeypatch.setattr("fapengine.mesh.default_head.head.paint", lambda style: np.full((1, 1, 3), 255, dtype=np.uint8))


def moves_its_points(head: FaceMesh) -> bool:
    """Whether every FAP moves its feature point by its value to 2 %."""
    faps = np.zeros((len(MOVING), 68))
    faps[np.arange(len(MOVING)), [fap.column(row.number) for row in MOVING]] = 100.0
    vertices = [head.feature_points[row.point] for row in MOVING]
    went = [
        (deform(head, values)[vertex] - head.vertices_mm[vertex]) @ np.array(fap.HEAD_AXES[row.positive])
        for values, vertex, row in zip(faps, vertices, MOVING, strict=True)
    ]
    return np.allclose(went, [100.0 * head.fapu.unit(row.unit) for row in MOVING], rtol=0.02)


@pytest.mark.parametrize("name", [*PEOPLE, *(f"random:{seed}" for seed in (1, 5, 9))])
def test_a_person_keeps_what_the_default_head_promises(name: str) -> None:
    person = parse_person(name)
    assert person is not None
    head = build_head(person[0], level="coarse")
    assert moves_its_points(head)
    assert head.iris_albedo == pytest.approx(EYE_COLOURS[person[0].eye_colour])
    shut = np.zeros(68)
    shut[[fap.column(19), fap.column(20)]] = 1024
    moved = deform(head, shut)
    for side, (upper, lower) in enumerate((("3.1", "3.3"), ("3.2", "3.4"))):
        assert moved[head.feature_points[upper], 1] == pytest.approx(moved[head.feature_points[lower], 1], abs=0.7)
        lids = (head.material == Material.SKIN) & (
            np.linalg.norm(moved - head.eye_pivots_mm[side], axis=1) < 18  # mm; the ball's radius is 14.2
        )
        assert np.linalg.norm(moved[lids] - head.eye_pivots_mm[side], axis=1).min() > 14.2


def test_the_usual_iris_is_brown() -> None:
    assert EYE_COLOURS["brown"] == BROWN_IRIS


def test_numbers_make_people_that_differ() -> None:
    people = [somebody(seed) for seed in range(200)]
    assert len(set(people)) == 200
    assert somebody(7) == people[7]
    weights = np.array([person.relief for person in people])
    assert np.abs(weights.mean(axis=0)).max() < 0.25
    assert weights.std(axis=0) == pytest.approx(np.ones(len(RELIEF_TENTHS_MM)), abs=0.15)
    assert {person.haircut for person in people} == {"short", "long"}
    assert any(not person.hair for person in people)
    assert {person.eye_colour for person in people} == set(EYE_COLOURS)


def test_relief_changes_the_face_between_its_features_alone() -> None:
    usual, other = HeadStyle(), HeadStyle(relief=(2.0, -2.0, 2.0))
    angle = np.linspace(-1.2, 1.2, 49)
    forehead, eyes = np.full(49, 70.0), np.full(49, 36.0)
    change = radius(angle, forehead, other) - radius(angle, forehead, usual)
    assert np.abs(change).max() > 1.0  # mm
    assert change == pytest.approx(change[::-1])  # both sides alike
    assert np.abs(np.diff(change, 2)).max() < 0.3  # smooth, in the middle too
    points = position(angle, eyes, usual)
    on_lid = np.hypot(np.abs(points[:, 0]) - 31.4, points[:, 1] - 36.0) < 12
    assert on_lid.any()
    assert (radius(angle, eyes, other) == radius(angle, eyes, usual))[on_lid].all()


def test_a_person_is_read_from_text() -> None:
    assert parse_person("woman") == (PEOPLE["woman"], "normal")
    assert parse_person("man:age=0.9,level=fine") == (replace(PEOPLE["man"], age=0.9), "fine")
    assert parse_person("random:7,haircut=long") == (replace(somebody(7), haircut="long"), "normal")
    assert parse_person("heads/anna") is None
    assert parse_look("relief=0.5/-1/2")[0].relief == (0.5, -1.0, 2.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("random", "head: got 'random', expected random:NUMBER such as random:7"),
        ("random:x", "head: got 'random:x', expected random:NUMBER"),
        ("woman:age=9", r"age: got 9\.0, expected 0\.\.1"),
        ("woman:haircut=mohawk", "haircut: got 'mohawk', expected one of short, long"),
        ("man:eye_colour=pink", "eye_colour: got 'pink', expected one of brown"),
        ("man:relief=9", r"relief: got 9, expected at most 8 numbers of -2\.5\.\.2\.5"),
        ("man:relief=" + "/".join("0" * 9), "relief: got 0/0/0/0/0/0/0/0/0, expected at most 8"),
        ("man:relief=a", "relief: got 'a', expected a number"),
    ],
)
def test_a_person_that_is_none_is_refused(name: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_person(name)


def test_long_hair_hangs_past_the_jaw_and_leaves_the_face_free() -> None:
    head = build_head(HeadStyle(haircut="long"), level="coarse")
    hairs = head.vertices_mm[head.material == Material.HAIR]
    assert hairs[:, 1].min() < -100
    face = (np.abs(hairs[:, 0]) < 45) & (hairs[:, 1] < 62) & (hairs[:, 2] > 65)
    assert not face.any()
