"""The default head: whole, symmetric, measured as the standard asks, and moved exactly as FAPs say."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.errors import UsageError
from fapengine.mesh.default_head import head as head_builder
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import HEAD, bone_transforms, channel_weights, deform
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES, FEATURE_POINTS

MOVING = [row for row in fap.FAPS if row.positive in fap.HEAD_AXES and row.unit is not fap.FapUnit.AU]
MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def frame(**values: float) -> NDArray[np.float64]:
    """FAPs by name, ``frame(open_jaw=300)``."""
    faps = np.zeros(68)
    for name, value in values.items():
        faps[fap.column(fap.by_name(name).number)] = value
    return faps


def test_size_and_determinism(head: FaceMesh) -> None:
    assert 8_000 <= len(head.vertices_mm) <= 18_500
    head_builder._built.cache_clear()
    again = build_head()
    assert again is not head
    assert build_head(HeadStyle(), level="normal") is again  # remembered; its arrays are read-only
    assert np.array_equal(head.vertices_mm, again.vertices_mm)
    assert np.array_equal(head.triangles, again.triangles)
    assert {Material(kind) for kind in np.unique(head.material)} == set(Material) - {Material.BALL}


def test_every_feature_point_is_there_and_on_its_side(head: FaceMesh) -> None:
    assert set(head.feature_points) == set(FEATURE_POINT_NAMES)
    for point in FEATURE_POINTS:
        x = float(head.point_mm(point.name)[0])
        expected = {"left": x > 1, "right": x < -1}.get(point.place.split()[-1], abs(x) < 0.6)
        assert expected, (point.name, x)


def test_fapu_is_an_adults() -> None:
    head = build_head(HeadStyle(charm=0))
    # Farkas 1994, adults: eye to eye 59-67, nose base to mouth 19-25 (stomion), mouth width 45-58 mm.
    assert 58 <= head.fapu.es0_mm <= 67
    assert 45 <= head.fapu.mw0_mm <= 58
    assert 18 <= head.fapu.mns0_mm <= 26
    assert 9 <= head.fapu.irisd0_mm <= 13
    assert 40 <= head.fapu.ens0_mm <= 52


def test_neutral_face_is_the_standards(head: FaceMesh) -> None:
    assert np.linalg.norm(head.point_mm("2.2") - head.point_mm("2.3")) < 0.1  # lips touch
    for upper, lower in (("2.6", "2.8"), ("2.7", "2.9")):  # half way along, give or take a vertex
        assert head.point_mm(upper)[1:] == pytest.approx(head.point_mm(lower)[1:], abs=0.6)
    line = [head.point_mm(name)[1] for name in ("2.4", "2.2", "2.5")]
    assert np.ptp(line) < 0.5  # and their line is horizontal
    for lid, pupil, side in (("3.1", "3.5", 1), ("3.3", "3.5", -1)):
        iris_edge = head.point_mm(pupil)[1] + side * head.fapu.irisd0_mm / 2
        assert head.point_mm(lid)[1] == pytest.approx(iris_edge, abs=0.6)  # lids are tangent to the iris


def test_the_head_is_symmetric() -> None:
    head = build_head(HeadStyle(hair=False))  # hair is parted, and cloth has folds
    points = head.vertices_mm[head.material != Material.CLOTH].astype(float)
    distance, _ = cKDTree(points).query(points * MIRROR)
    assert distance.max() < 0.05


def test_triangles_are_sound(head: FaceMesh) -> None:
    corners = head.vertices_mm[head.triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert (areas > 1e-6).mean() > 0.995
    assert len(np.unique(head.triangles, axis=0)) == len(head.triangles)
    closed = head.triangles[head.material[head.triangles[:, 0]] != Material.HAIR]  # tips of hair have two sides
    edges = np.sort(np.concatenate([closed[:, pair] for pair in ((0, 1), (1, 2), (2, 0))]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 2  # no edge has three faces


def test_normals_point_outwards(head: FaceMesh) -> None:
    skin = (head.material == Material.SKIN) & (head.vertices_mm[:, 2] > 60) & (head.vertices_mm[:, 1] > -70)
    away = head.vertices_mm[skin] - np.array([0, 20, 0])
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    assert ((head.normals[skin] * away).sum(axis=1) > 0).mean() > 0.93
    assert np.linalg.norm(head.normals, axis=1) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("row", MOVING, ids=lambda row: f"{row.number}-{row.name}")
@pytest.mark.parametrize("value", [1.0, 120.0, -120.0])
def test_a_fap_moves_its_feature_point_by_exactly_its_value(head: FaceMesh, row: fap.FapSpec, value: float) -> None:
    if value < 0 and not row.bidirectional:
        value = -value  # it acts in one direction only
    faps = np.zeros(68)
    faps[fap.column(row.number)] = value
    vertex = head.feature_points[row.point]
    moved = deform(head, faps)[vertex] - head.vertices_mm[vertex]
    expected = value * head.fapu.unit(row.unit)
    assert moved @ np.array(fap.HEAD_AXES[row.positive]) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", ["open_jaw", "raise_b_midlip", "raise_b_lip_lm", "raise_b_midlip_o", "push_b_lip"])
def test_what_moves_the_lower_lip_leaves_the_upper(head: FaceMesh, name: str) -> None:
    moved = np.linalg.norm(
        deform(head, frame(**{name: 300 if name == "open_jaw" else -300})) - head.vertices_mm, axis=1
    )
    for point in ("2.2", "2.6", "2.7", "8.1", "8.5", "8.6", "9.15", "9.3", "3.3"):
        assert moved[head.feature_points[point]] < 1e-6, point


@pytest.mark.parametrize("name", ["lower_t_midlip", "lower_t_lip_rm", "lower_t_midlip_o", "push_t_lip"])
def test_what_moves_the_upper_lip_leaves_the_lower(head: FaceMesh, name: str) -> None:
    moved = np.linalg.norm(deform(head, frame(**{name: 200})) - head.vertices_mm, axis=1)
    for point in ("2.3", "2.8", "2.9", "8.2", "8.7", "8.8", "2.1", "2.10"):
        assert moved[head.feature_points[point]] < 1e-6, point


def test_the_jaw_leaves_the_lips_where_their_faps_say(head: FaceMesh) -> None:
    moved = np.linalg.norm(deform(head, frame(open_jaw=600)) - head.vertices_mm, axis=1)
    for point in ("2.3", "2.4", "2.5", "8.2", "8.3", "8.4"):
        assert moved[head.feature_points[point]] < 0.2, point
    for point in ("2.1", "2.10", "9.11", "6.1"):
        assert moved[head.feature_points[point]] > 5, point


def test_lips_pushed_far_forward_purse(head: FaceMesh) -> None:
    """Their corners come in by more than their own FAPs say, and closed lips stay closed."""
    corner, push = head.feature_points["8.3"], {value: deform(head, frame(push_b_lip=value)) for value in (0, 200, 550)}
    assert push[200][corner] == pytest.approx(head.vertices_mm[corner])
    assert push[550][corner] - push[0][corner] == pytest.approx([-3.0, 0.0, 7.2], abs=0.2)
    for upper, lower in (("2.2", "2.3"), ("2.6", "2.8"), ("2.7", "2.9")):
        apart = [moved[head.feature_points[upper], 1] - moved[head.feature_points[lower], 1] for moved in push.values()]
        assert apart == pytest.approx([apart[0]] * 3, abs=0.05)


def test_lids_close_fully_and_lie_on_the_ball(head: FaceMesh) -> None:
    closed = deform(head, frame(close_t_l_eyelid=1024))
    upper, lower = head.feature_points["3.1"], head.feature_points["3.3"]
    assert np.linalg.norm(closed[upper, 1] - head.vertices_mm[lower, 1]) < 0.05
    for value in (0, 256, 512, 768, 1024):
        lid = deform(head, frame(close_t_l_eyelid=value))[upper] - head.eye_pivots_mm[0]
        rest = head.vertices_mm[upper] - head.eye_pivots_mm[0]
        assert np.linalg.norm(lid[1:]) == pytest.approx(np.linalg.norm(rest[1:]), abs=0.15)
    other = head.feature_points["3.2"]
    assert np.allclose(closed[other], head.vertices_mm[other], atol=1e-4)


def test_a_closed_lid_is_a_dome_below_a_furrow(head: FaceMesh) -> None:
    off = deform(head, frame(close_t_l_eyelid=1024)) - head.eye_pivots_mm[0]
    lid = (head.material == Material.SKIN) & (np.abs(off[:, 0]) < 4) & (off[:, 2] > 10)
    height, elevation = np.linalg.norm(off[lid, 1:], axis=1), np.rad2deg(np.arctan2(off[lid, 1], off[lid, 2]))
    dome, furrow = height[np.abs(elevation) < 8], height[np.abs(elevation - 20) < 6]
    assert dome.min() > furrow.min() + 0.5  # mm


def test_skin_stands_beside_the_far_eye_in_three_quarter_view(head: FaceMesh) -> None:
    to_contour = np.array([np.cos(np.deg2rad(35)), 0.0, np.sin(np.deg2rad(35))])
    corner = head.point_mm("3.7")
    level = (head.material == Material.SKIN) & (np.abs(head.vertices_mm[:, 1] - corner[1]) < 3)
    assert (head.vertices_mm[level] @ to_contour).max() > corner @ to_contour + 2  # mm


def test_mirrored_faps_mirror_the_face(head: FaceMesh) -> None:
    pairs = [(number, number + 1) for number in (6, 8, 10, 12, 19, 21, 31, 33, 35, 37, 39, 53, 55, 57, 59)]
    for left, right in pairs:
        one, other = np.zeros(68), np.zeros(68)
        one[fap.column(left)] = other[fap.column(right)] = 150
        a, b = deform(head, one), deform(head, other)
        for point in FEATURE_POINTS:
            if point.place.split()[-1] not in ("left", "right") and point.name not in ("7.1", "11.5"):
                vertex = head.feature_points[point.name]
                assert a[vertex] * MIRROR == pytest.approx(b[vertex], abs=0.05), (left, point.name)


def test_turns_go_where_the_standard_says(head: FaceMesh) -> None:
    nose = head.feature_points["9.3"]
    rest = head.vertices_mm[nose]
    right_angle = np.pi / 2 / 1e-5
    assert deform(head, frame(head_yaw=right_angle))[nose][0] > 100  # to the left
    assert deform(head, frame(head_pitch=right_angle / 3))[nose][1] < rest[1] - 20  # down
    assert deform(head, frame(head_roll=right_angle / 3))[nose][0] < -10  # towards the right shoulder
    pupil = head.feature_points["3.5"]
    assert deform(head, frame(yaw_l_eyeball=30_000))[pupil][0] > head.vertices_mm[pupil][0] + 2
    assert deform(head, frame(pitch_l_eyeball=30_000))[pupil][1] < head.vertices_mm[pupil][1] - 2
    assert deform(head, frame(thrust_l_eyeball=100))[pupil][2] > head.vertices_mm[pupil][2] + 1
    shoulder = head.vertices_mm[:, 1] < -150
    assert np.allclose(deform(head, frame(head_yaw=50_000))[shoulder], head.vertices_mm[shoulder], atol=1e-4)


def test_bones_at_rest_do_nothing_and_batch(head: FaceMesh) -> None:
    assert bone_transforms(head, np.zeros(68)) == pytest.approx(np.broadcast_to(np.eye(4), (5, 4, 4)), abs=1e-12)
    assert bone_transforms(head, np.zeros((3, 2, 68))).shape == (3, 2, HEAD + 1, 4, 4)
    assert deform(head, np.zeros((2, 68))).shape == (2, len(head.vertices_mm), 3)
    assert channel_weights(head.basis, np.zeros((4, 68))).shape == (4, len(head.basis.channels))


def test_channels_are_clipped_linear_functions() -> None:
    channels = (
        Channel(3, -np.inf, np.inf),
        Channel(19, 100.0, 300.0),
        Channel(19, 0.0, -50.0),
        Channel(47, 0.0, np.inf),
    )
    basis = DeformationBasis(channels=channels, offsets=[0], entry_channels=np.zeros(0, int), entry_mm=np.zeros((0, 3)))  # type: ignore[arg-type]
    faps = np.zeros((3, 68))
    faps[:, fap.column(3)] = [-5, 0, 7]
    faps[:, fap.column(19)] = [-80, 250, 900]
    faps[:, fap.column(47)] = [-1, 4, 5e6]
    assert channel_weights(basis, faps).tolist() == [[-5, 0, 50, 0], [0, 150, 0, 4], [7, 200, 0, 5e6]]


def test_shapes_with_other_proportions_are_heads_too() -> None:
    wide = build_head(HeadStyle(jaw_width=1.05, eye_opening_mm=10.0, lip_fullness=1.3, charm=0))
    assert wide.fapu.irisd0_mm < 10.6
    assert set(wide.feature_points) == set(FEATURE_POINT_NAMES)


def test_refuses(head: FaceMesh) -> None:
    with pytest.raises(UsageError, match=r"got '1\.1'"):
        head.point_mm("1.1")
    with pytest.raises(UsageError, match="offsets"):
        DeformationBasis(channels=(), offsets=[0, 2, 1], entry_channels=[0], entry_mm=np.zeros((1, 3)))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="entry_channels: must be 0 to 0"):
        DeformationBasis(channels=(Channel(3, 0, 1),), offsets=[0, 1], entry_channels=[4], entry_mm=np.zeros((1, 3)))  # type: ignore[arg-type]
    parts = {name: getattr(head, name) for name in FaceMesh.__slots__}
    with pytest.raises(UsageError, match="unknown names"):
        FaceMesh(**(parts | {"feature_points": {"1.1": 0}}))
    for field, value in (
        ("triangles", [[0, 1, 10**6]]), ("feature_points", {"2.1": -1}), ("feature_points", {"2.1": 10**6}),
        ("material", np.full_like(head.material, len(Material))), ("bone", np.full_like(head.bone, 4)),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=f"{field}: must be 0 to"):
            FaceMesh(**(parts | {field: value}))
    with pytest.raises(UsageError, match=r"channels: must be of FAP 3 to 68"):
        DeformationBasis(channels=(Channel(2, 0, 1),), offsets=[0], entry_channels=[], entry_mm=np.zeros((0, 3)))  # type: ignore[arg-type]
    empty = DeformationBasis(channels=(), offsets=[0], entry_channels=np.zeros(0, int), entry_mm=np.zeros((0, 3)))  # type: ignore[arg-type]
    parts["folds"] = None
    with pytest.raises(UsageError, match=r"basis\.offsets"):
        FaceMesh(**(parts | {"basis": empty}))


def test_a_vertex_has_one_entry_of_a_channel(head: FaceMesh) -> None:
    basis = head.basis
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    pairs = vertex * basis.width + basis.entry_channels
    assert len(np.unique(pairs)) == len(pairs)
