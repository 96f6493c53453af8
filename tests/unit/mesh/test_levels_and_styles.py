"""The head in other sizes and other looks: the same face to every FAP."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.mesh.colours import HAIR_COLOURS
from fapengine.mesh.default_head import mesh_builder, painting
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import LEVELS, HeadStyle, palette_of, parse_look
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from tests.unit.mesh.above_skin import above_skin
from tests.unit.mesh.unpainted import unpainted

Array = NDArray[np.float64]
Moved = Callable[[FaceMesh, NDArray[np.int64], Array], Array]

VERTICES = {
    "coarse": (5_000, 9_000),
    "calls": (9_000, 12_900),
    "normal": (12_000, 18_500),
    "fine": (23_000, 30_000),
    "finest": (64_000, 78_000),
}
MOVING = [row for row in fap.FAPS if row.positive in fap.HEAD_AXES and row.unit is not fap.FapUnit.AU]


@pytest.fixture(scope="module")
def heads() -> dict[str, FaceMesh]:
    with unpainted():
        return {level: build_head(level=level) for level in LEVELS}


@pytest.mark.parametrize("level", VERTICES)
def test_levels_have_their_size_and_all_points(heads: dict[str, FaceMesh], level: str) -> None:
    head, low_high = heads[level], VERTICES[level]
    assert low_high[0] <= len(head.vertices_mm) <= low_high[1]
    assert set(head.feature_points) == set(FEATURE_POINT_NAMES)
    assert head.basis.channels == heads["normal"].basis.channels


@pytest.mark.parametrize("level", VERTICES)
def test_levels_are_the_same_face(heads: dict[str, FaceMesh], level: str) -> None:
    head, normal = heads[level], heads["normal"]
    for name in ("2.1", "2.2", "2.4", "3.1", "3.7", "8.1", "8.3", "9.3", "4.3", "5.1"):
        assert np.linalg.norm(head.point_mm(name) - normal.point_mm(name)) < 6.4, name  # mm: a coarse step
    for unit in fap.FapUnit:
        assert head.fapu.unit(unit) == pytest.approx(normal.fapu.unit(unit), rel=0.06)


@pytest.mark.parametrize("level", ["coarse", "calls", "fine", "finest"])
def test_every_level_moves_exactly(heads: dict[str, FaceMesh], level: str, moved: Moved) -> None:
    head = heads[level]
    faps = np.zeros((len(MOVING), 68))
    faps[np.arange(len(MOVING)), [fap.column(row.number) for row in MOVING]] = 100.0
    vertices = np.array([head.feature_points[row.point] for row in MOVING])
    off = moved(head, vertices, faps) - head.vertices_mm[vertices]
    for row, own in zip(MOVING, off[np.arange(len(MOVING)), np.arange(len(MOVING))], strict=True):
        went = own @ np.array(fap.HEAD_AXES[row.positive])
        assert went == pytest.approx(100.0 * head.fapu.unit(row.unit), rel=0.02), row.name


def test_calls_are_divided_less_but_have_all_hair(heads: dict[str, FaceMesh]) -> None:
    calls, normal = heads["calls"], heads["normal"]
    for kind in (Material.HAIR, Material.STRAND):
        assert (calls.material == kind).sum() == (normal.material == kind).sum(), kind.name
    assert (calls.material == Material.SKIN).sum() < 0.55 * (normal.material == Material.SKIN).sum()


def test_an_unknown_level_is_refused() -> None:
    with pytest.raises(UsageError, match="level: got 'huge', expected one of coarse, calls, normal, fine, finest"):
        build_head(level="huge")


STYLES = {
    "jaw_width": 1.08, "cheek_fullness_mm": 4.0, "chin_mm": 4.0, "nose_length": 1.15, "nose_width": 1.15,
    "eye_opening_mm": 9.5, "lip_fullness": 1.3, "mouth_width": 1.1, "age": 0.9, "sex": 1.0,
    "build": -1.0, "childlike": 1.0,
}  # fmt: skip


def width(head: FaceMesh, one: str, other: str) -> float:
    return float(np.linalg.norm(head.point_mm(one) - head.point_mm(other)))


@pytest.mark.usefixtures("no_paint")
@pytest.mark.parametrize("name", STYLES)
def test_a_style_changes_what_it_names(heads: dict[str, FaceMesh], name: str) -> None:
    usual, other = heads["coarse"], build_head(replace(HeadStyle(), **{name: STYLES[name]}), level="coarse")
    if name == "nose_length":
        assert other.point_mm("9.3")[2] > usual.point_mm("9.3")[2] + 2
    elif name == "nose_width":
        skin = usual.material == Material.SKIN
        assert np.abs(other.vertices_mm[skin] - usual.vertices_mm[skin]).max() > 1
    elif name == "mouth_width":
        assert width(other, "8.3", "8.4") == pytest.approx(1.1 * width(usual, "8.3", "8.4"), rel=0.03)
    elif name == "eye_opening_mm":
        assert width(other, "3.1", "3.3") < width(usual, "3.1", "3.3") - 1
    elif name == "lip_fullness":
        assert width(other, "8.1", "8.2") > 1.15 * width(usual, "8.1", "8.2")
    elif name == "childlike":  # the eyes are low on a child's head: the skull is larger, the face below it shorter
        low = (other.point_mm("11.4") - other.point_mm("2.1"))[1] - (usual.point_mm("11.4") - usual.point_mm("2.1"))[1]
        assert low < -10
        assert width(other, "3.8", "2.1") < 0.9 * width(usual, "3.8", "2.1")
    elif name == "chin_mm":
        assert other.point_mm("2.10")[2] > usual.point_mm("2.10")[2] + 1
    else:
        assert max(np.linalg.norm(other.point_mm(one) - usual.point_mm(one)) for one in usual.feature_points) > 0.8
    faps = np.zeros(68)
    faps[fap.column(3)] = 200
    chin = other.feature_points["2.1"]
    drop = other.vertices_mm[chin, 1] - deform(other, faps)[chin, 1]
    assert drop == pytest.approx(200 * other.fapu.unit(fap.FapUnit.MNS), rel=0.02)


@pytest.mark.usefixtures("no_paint")
def test_skin_and_hair_have_their_colours() -> None:
    light, dark = (palette_of(HeadStyle(skin_tone=tone)).base for tone in (0.0, 1.0))
    assert (light > 3 * dark).all()
    grey = build_head(HeadStyle(hair_colour="grey"), level="coarse")
    brown = build_head(level="coarse")
    assert grey.albedo[grey.material == Material.HAIR].mean() > 3 * brown.albedo[brown.material == Material.HAIR].mean()
    assert set(HAIR_COLOURS) >= {"black", "brown", "blond", "red", "grey"}


@pytest.mark.usefixtures("no_paint")
def test_without_hair_the_scalp_is_whole() -> None:
    bald = build_head(HeadStyle(hair=False), level="coarse")
    assert not (bald.material == Material.HAIR).any()
    hairs = bald.vertices_mm[bald.material == Material.STRAND]
    assert hairs[:, 1].max() < 70  # brows and lashes
    skin = bald.vertices_mm[bald.material == Material.SKIN]
    assert skin[:, 1].max() > 140
    assert bald.point_mm("11.5")[1] == pytest.approx(bald.point_mm("11.4")[1])


@pytest.mark.parametrize(
    ("name", "value"),
    [*((name, 99.0) for name in STYLES), ("skin_tone", -0.1), ("freckles", 4.0), ("brow_thickness", 0.0)],
)
def test_a_style_out_of_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=rf"{name}: must be .*, got {value}"):
        replace(HeadStyle(), **{name: value})


def test_an_unknown_hair_colour_is_refused() -> None:
    with pytest.raises(UsageError, match="hair_colour: got 'green', expected one of black, brown"):
        HeadStyle(hair_colour="green")


def test_the_painting_darkens_what_it_should() -> None:
    picture = painting.paint(HeadStyle()).astype(float)
    assert picture.shape == (*mesh_builder.TEXTURE_SIZE, 3)

    def at(angle_deg: float, y: float) -> Array:
        u, v = mesh_builder.skin_uv(np.deg2rad(angle_deg), y)
        row, column = int(v * mesh_builder.TEXTURE_SIZE[0]), int(u * mesh_builder.TEXTURE_SIZE[1])
        return picture[row - 2 : row + 3, column - 2 : column + 3].mean(axis=(0, 1))

    forehead = at(0, 75)
    assert (forehead > 225).all()
    assert at(17, 54).mean() < 190  # a brow
    assert at(80, 90).mean() < 180  # under the hair
    again = painting.paint(HeadStyle())
    assert again is painting.paint(HeadStyle())
    assert not again.flags.writeable
    u, v = mesh_builder.PLAIN_UV
    assert (picture[int(v * mesh_builder.TEXTURE_SIZE[0]), int(u * mesh_builder.TEXTURE_SIZE[1])] == 255).all()


def test_freckles_and_baldness_are_painted() -> None:
    freckled = painting.paint(HeadStyle(freckles=3.0)).astype(float)
    plain = painting.paint(HeadStyle(freckles=0.0)).astype(float)
    assert (freckled <= plain).all()
    assert 1000 < (plain - freckled > 3).any(axis=-1).sum() < 60_000  # texels
    bald = painting.paint(HeadStyle(hair=False)).astype(float)
    assert bald[-20:, 100:700].mean() > painting.paint(HeadStyle()).astype(float)[-20:, 100:700].mean() + 40


def test_grain_is_even_and_the_same_everywhere() -> None:
    grain = painting.grain((256, 256), 5)
    assert abs(grain.mean()) < 0.01
    assert grain.std() == pytest.approx(3**-0.5, abs=0.01)
    assert np.abs(np.corrcoef(grain[:, :-1].ravel(), grain[:, 1:].ravel())[0, 1]) < 0.02
    assert grain[:2, :2].tolist() == painting.grain((2, 2), 5).tolist()
    assert not np.array_equal(grain, painting.grain((256, 256), 6))


def test_hair_lies_on_the_head(heads: dict[str, FaceMesh]) -> None:
    head = heads["normal"]
    hairs = head.vertices_mm[head.material == Material.HAIR].astype(float)
    above = above_skin(hairs[hairs[:, 1] > 75], build_head(HeadStyle(hair=False)))
    assert 15 < above.max() < 30  # mm: swept hair has volume
    assert above.min() > -3
    front = hairs[(np.abs(hairs[:, 0]) < 30) & (hairs[:, 2] > 80)]
    assert front[:, 1].min() > 65  # no fringe over brows or eyes


def test_hair_fades_into_the_skin() -> None:
    """Where the hair is above the hairline, at a sideburn, its colour comes within millimetres."""
    picture = painting.paint(HeadStyle()).astype(float)
    y = np.arange(18.0, 52.0)
    u, v = mesh_builder.skin_uv(np.deg2rad(78.0), y).T
    rows, columns = (v * mesh_builder.TEXTURE_SIZE[0]).astype(int), (u * mesh_builder.TEXTURE_SIZE[1]).astype(int)
    grey = np.array([picture[row, column - 8 : column + 9].mean() for row, column in zip(rows, columns, strict=True)])
    share = (grey - grey.min()) / np.ptp(grey)
    assert (np.diff(grey) < 4.0).all()  # darker upwards
    assert ((share > 0.1) & (share < 0.9)).sum() >= 8  # mm; 4 before


def test_a_look_is_read_from_text() -> None:
    assert parse_look("") == (HeadStyle(), "normal")
    assert parse_look("hair_colour=red, age=0.8,hair=false,level=fine") == (
        HeadStyle(hair_colour="red", age=0.8, hair=False),
        "fine",
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour=red", "head: got 'colour=red', expected NAME=VALUE with level, jaw_width"),
        ("age", "head: got 'age', expected NAME=VALUE"),
        ("age=old", "age: got 'old', expected a number"),
        ("age=7", r"age: must be 0 to 1, got 7\.0"),
        ("hair=1", "hair: got '1', expected true or false"),
    ],
)
def test_a_look_that_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_look(text)


@pytest.mark.parametrize("colour", ["grey", "blond"])
def test_light_hair_has_one_tone(colour: str) -> None:
    """Locks by the face were lighter than the cap by half, and looked dyed."""
    head = build_head(HeadStyle(hair_colour=colour))
    hair = head.albedo[(head.material == Material.HAIR) & (head.vertices_mm[:, 1] > 70)].mean(axis=1)
    low, high = np.percentile(hair, (10, 90))
    assert high / low < 1.35  # 1.57 before
