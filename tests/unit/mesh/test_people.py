"""People by name and by number: within bounds, different, and with every promise of the default head."""

import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import cKDTree

from fapengine.errors import UsageError
from fapengine.mesh.colours import CLOTH_COLOURS, EYE_COLOURS
from fapengine.mesh.default_head.faces import cubic_surface, displacement
from fapengine.mesh.default_head.head import build_head, build_parts
from fapengine.mesh.default_head.style import (
    BROW_SHAPES,
    GARMENTS,
    HAIRCUTS,
    LEVELS,
    MODES,
    PEOPLE,
    HeadStyle,
    parse_look,
    parse_person,
    random_person,
)
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import BROWN_IRIS, FaceMesh, Material
from fapengine.mpeg4 import fap
from tests.unit.mesh.above_skin import above_skin

pytestmark = pytest.mark.usefixtures("no_paint")

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Moved = Callable[[FaceMesh, Indices, Array], Array]

RANDOM_PEOPLE = int(os.environ.get("RANDOM_PEOPLE", "15"))
"""Number of random people that are tried, the first of them at every change; ``make people`` tries 200."""
AT_EVERY_CHANGE = 5
MOVING = [row for row in fap.FAPS if row.positive in fap.HEAD_AXES and row.unit is not fap.FapUnit.AU]


def moves_its_points(head: FaceMesh, moved: Moved) -> bool:
    """Whether every FAP moves its feature point by its value to 2 %."""
    faps = np.zeros((len(MOVING), 68))
    faps[np.arange(len(MOVING)), [fap.column(row.number) for row in MOVING]] = 100.0
    vertices = np.array([head.feature_points[row.point] for row in MOVING])
    number = np.arange(len(MOVING))
    went = (moved(head, vertices, faps)[number, number] - head.vertices_mm[vertices]) * [
        fap.HEAD_AXES[row.positive] for row in MOVING
    ]
    return np.allclose(went.sum(axis=1), [100.0 * head.fapu.unit(row.unit) for row in MOVING], rtol=0.02)


def rims(head: FaceMesh, style: HeadStyle) -> tuple[Indices, Indices]:
    """Vertices of the line between the lips: of the upper and of the lower one."""
    measured = replace(style, charm=0, childlike=0)  # where they are known; the vertices are the same
    template = build_head(measured, level="coarse")
    builder, parts = build_parts(style, LEVELS["coarse"])
    rim = parts.mouth.indices[np.flatnonzero(parts.mouth.level == 0)[0]]
    points = builder.column("points_mm")[rim] + displacement(builder.column("place")[rim], style.weights)
    away, vertices = cKDTree(template.vertices_mm[template.material == Material.LIP]).query(points)
    assert away.max() < 1e-3
    lips = np.flatnonzero(head.material == Material.LIP)[vertices]
    return lips[parts.mouth.upper], lips[~parts.mouth.upper]


def smallest_gap(head: FaceMesh, style: HeadStyle, moved: Moved, frames: Array) -> float:
    """Smallest height of the upper lip over the lower one where they touch at rest, mm."""
    upper, lower = (moved(head, rim, frames) for rim in rims(head, style))
    along = np.linspace(-15.0, 15.0, 31)

    def heights(rim: Array) -> Array:
        order = np.argsort(rim[:, 0])
        return np.interp(along, rim[order, 0], rim[order, 1])

    return min(float((heights(a) - heights(b)).min()) for a, b in zip(upper, lower, strict=True))


@pytest.mark.parametrize(
    "name",
    [
        *PEOPLE,
        *(
            pytest.param(f"random:{seed}", marks=[pytest.mark.nightly] * (seed >= AT_EVERY_CHANGE))
            for seed in range(RANDOM_PEOPLE)
        ),
    ],
)
def test_a_person_keeps_what_the_default_head_promises(name: str, moved: Moved, frames: Array) -> None:
    person = parse_person(name)
    assert person is not None
    head = build_head(person[0], level="coarse")
    assert moves_its_points(head, moved)
    assert smallest_gap(head, person[0], moved, frames[::25]) > -0.03  # mm; between polylines with other corners
    assert head.iris_albedo == pytest.approx(EYE_COLOURS[person[0].eye_colour])
    shut = np.zeros(68)
    shut[[fap.column(19), fap.column(20)]] = 1024
    shut_lids = deform(head, shut)
    eyes = head.vertices_mm[head.material == Material.EYE]
    ball_mm = np.linalg.norm(eyes[:, None] - head.eye_pivots_mm, axis=-1).min(axis=1).max()
    for side, (upper, lower) in enumerate((("3.1", "3.3"), ("3.2", "3.4"))):
        margins = shut_lids[[head.feature_points[upper], head.feature_points[lower]], 1]
        assert margins[0] == pytest.approx(margins[1], abs=0.7)
        lids = (head.material == Material.SKIN) & (
            np.linalg.norm(shut_lids - head.eye_pivots_mm[side], axis=1) < ball_mm + 4
        )
        assert np.linalg.norm(shut_lids[lids] - head.eye_pivots_mm[side], axis=1).min() > ball_mm


def test_the_usual_iris_is_brown() -> None:
    assert EYE_COLOURS["brown"] == BROWN_IRIS


def test_numbers_make_people_that_differ() -> None:
    people = [random_person(seed) for seed in range(200)]
    assert len(set(people)) == 200
    assert random_person(7) == people[7]
    weights = np.array([person.identity for person in people])
    assert np.abs(weights.mean(axis=0)).max() < 0.25
    assert weights.std(axis=0) == pytest.approx(np.full(MODES, 0.96), abs=0.15)
    assert {person.haircut for person in people} == set(HAIRCUTS)
    assert {person.brow_shape for person in people} == set(BROW_SHAPES)
    assert {person.garment for person in people} == set(GARMENTS)
    assert {person.cloth_colour for person in people} == set(CLOTH_COLOURS)
    assert any(not person.hair for person in people)
    assert {person.eye_colour for person in people} == set(EYE_COLOURS)


def test_every_mode_changes_the_face_smoothly_and_leaves_the_eyes() -> None:
    height, angle = np.meshgrid(np.linspace(-80.0, 80.0, 81), np.linspace(-1.2, 1.2, 121))
    places = np.stack([angle, height], axis=-1)
    usual = displacement(places)
    x = 95.0 * np.sin(angle)
    on_lid = np.hypot((np.abs(x) - 31.4) / 15.0, (height - 36.0) / 10.0) < 0.8
    for mode in range(MODES):
        change = displacement(places, (0.0,) * mode + (2.0,)) - usual
        size = np.linalg.norm(change, axis=-1)
        assert size.max() > 1.0  # mm
        assert size[on_lid].max() < 0.3
        assert np.linalg.norm(np.diff(change, axis=1), axis=-1).max() < 3.0  # mm: rows are 2 mm apart
        assert change[::-1] * [-1, 1, 1] == pytest.approx(change)  # both sides alike


def test_a_person_is_read_from_text() -> None:
    assert parse_person("woman") == (PEOPLE["woman"], "normal")
    assert parse_person("man:age=0.9,level=fine") == (replace(PEOPLE["man"], age=0.9), "fine")
    assert parse_person("random:7,haircut=long") == (replace(random_person(7), haircut="long"), "normal")
    assert parse_person("heads/anna") is None
    assert parse_look("identity=0.5/-1/2")[0].identity == (0.5, -1.0, 2.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("random", "head: got 'random', expected random:NUMBER such as random:7"),
        ("random:x", "head: got 'random:x', expected random:NUMBER"),
        ("woman:age=9", r"age: must be 0 to 1, got 9\.0"),
        ("woman:haircut=mohawk", "haircut: got 'mohawk', expected one of short, cropped"),
        ("man:eye_colour=pink", "eye_colour: got 'pink', expected one of brown"),
        ("man:identity=9", r"identity: got 9, expected at most 16 numbers from -2\.5 to 2\.5"),
        ("man:identity=" + "/".join("0" * 17), "identity: got 0(/0)*, expected at most 16"),
        ("man:identity=a", "identity: got 'a', expected a number"),
    ],
)
def test_a_person_that_is_none_is_refused(name: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_person(name)


def test_long_hair_hangs_past_the_jaw_and_leaves_the_face_free() -> None:
    head = build_head(HeadStyle(haircut="long"), level="coarse")
    hairs = head.vertices_mm[head.material == Material.HAIR]
    assert hairs[:, 1].min() < -100
    chin_mm = head.vertices_mm[head.feature_points["2.1"], 1]
    face = (np.abs(hairs[:, 0]) < 45) & (hairs[:, 1] > chin_mm) & (hairs[:, 1] < 62) & (hairs[:, 2] > 65)
    assert not face.any()


@pytest.mark.parametrize("haircut", ["long", "bob"])
@pytest.mark.parametrize("person", ["woman", "man", "random:3"])
def test_locks_of_long_hair_lie_over_head_and_ears(haircut: str, person: str) -> None:
    parsed = parse_person(f"{person},haircut={haircut},hair,level=coarse")
    assert parsed is not None
    head, style = build_head(parsed[0], level=parsed[1]), parsed[0]
    hair = head.material == Material.HAIR
    hairs = head.vertices_mm[hair].astype(float)
    hairs = hairs[(hairs[:, 1] > 30) & (hairs[:, 1] < 140)]
    above = above_skin(hairs, build_head(replace(style, hair=False), level=parsed[1]))
    assert above.min() > -2.6  # mm; the cap's rim is sunk into the skin by 2
    assert 10 < above.max() < 24
    # Hair lies over the ears.
    beside = np.abs(head.vertices_mm[:, 1:] - [10, -4]).max(axis=1) < 20
    for side in (1.0, -1.0):
        hairs, skin = (side * head.vertices_mm[beside & (head.material == kind), 0] for kind in (Material.HAIR, 0))
        assert hairs.max() > skin.max() + 0.5


def _hairs(head: FaceMesh, low_mm: float, high_mm: float) -> Indices:
    """Vertices of single hairs beside the left eye or above it."""
    x, y, z = head.vertices_mm.T
    near = (head.material == Material.STRAND) & (z > 60) & (np.abs(x - 34) < 26) & (y > low_mm) & (y < high_mm)
    return np.flatnonzero(near)


@pytest.mark.parametrize("seed", [5, 12])
def test_temples_of_narrow_faces_do_not_fold(seed: int) -> None:
    head = build_head(random_person(seed))
    skin = head.triangles[(head.material[head.triangles] == Material.SKIN).all(axis=1)]
    corners = head.vertices_mm.astype(np.float64)[skin]
    middle = corners.mean(axis=1)
    temples = (np.abs(middle[:, 0]) > 60) & (middle[:, 2] > 30) & (middle[:, 1] > 0) & (middle[:, 1] < 60)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert temples.sum() > 200
    assert (np.sum(faces * middle * [1, 0, 1], axis=1)[temples] > 0).all()


def test_a_frown_lowers_a_brow_without_flattening_it() -> None:
    head, frown = build_head(PEOPLE["man"], level="coarse"), np.zeros(fap.FAP_COUNT)
    for number, value in ((31, -148.0), (33, -221.0), (35, -52.0)):
        frown[fap.column(number)] = value
    x, y, _ = head.vertices_mm[_hairs(head, 50, 72)].T
    middle = np.abs(x - 34) < 5
    lowered = deform(head, frown)[_hairs(head, 50, 72), 1][middle]
    assert lowered.std() > 0.75 * y[middle].std()
    assert (y[middle] - lowered).min() > 6


def test_lashes_of_a_shut_eye_point_down() -> None:
    head, shut = build_head(level="coarse"), np.zeros(fap.FAP_COUNT)
    shut[fap.column(19)] = 1024
    moved = deform(head, shut)
    strands = _hairs(head, 20, 60)
    way_mm = np.linalg.norm(moved[strands] - head.vertices_mm[strands], axis=1)
    lashes = strands[way_mm > 2].reshape(-1, 6)
    rise = moved[lashes[:, 4:], 1].mean(axis=1) - moved[lashes[:, :2], 1].mean(axis=1)
    assert len(lashes) > 5
    assert np.median(rise) < -1.0  # mm
    outer = lashes[np.argsort(moved[lashes, 0].mean(axis=1))[-4:]]
    way = moved[outer[:, 4:]].mean(axis=1) - moved[outer[:, :2]].mean(axis=1)
    assert (-way[:, 1] > 0.8 * way[:, 0]).all()  # at the corner, too


@pytest.mark.parametrize("level", ["coarse", "calls", "normal"])
def test_a_closing_lid_does_not_stretch_the_line_of_lashes(level: str) -> None:
    head = build_head(level=level)
    shut = np.zeros(68)
    shut[[fap.column(19), fap.column(20)]] = 1024
    kinds = head.material[head.triangles]
    edge = head.triangles[(kinds == Material.LASH).any(axis=1) & (kinds == Material.SKIN).any(axis=1)]
    assert len(edge) > 20
    assert np.ptp(deform(head, shut)[edge, 1], axis=1).max() < 4.0  # mm


def test_surface_of_several_values_is_the_interpolating_cubic_spline_of_each() -> None:
    rng = np.random.default_rng(7)
    across, along = np.sort(rng.uniform(0.0, 3.0, 9)), np.sort(rng.uniform(-50.0, 50.0, 11))
    table = rng.normal(size=(9, 11, 3))
    places = np.stack([rng.uniform(across[0], across[-1], 500), rng.uniform(along[0], along[-1], 500)], axis=-1)
    values = cubic_surface(across, along, table)(places)
    for axis in range(3):
        expected = RectBivariateSpline(across, along, table[..., axis]).ev(*places.T)
        np.testing.assert_allclose(values[:, axis], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
