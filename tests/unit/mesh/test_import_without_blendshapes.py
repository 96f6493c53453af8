"""A mesh that is not ours, moved by FAPs: here our own head's surface, as a stranger would bring it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import Material
from fapengine.mpeg4 import fap

from .rigs import import_plain

BONES = (3, 14, 15, *range(23, 29), 43, 44, 45, 48, 49, 50)
"""FAPs of jaw, eyes, tongue and head, which have tests of their own."""


@pytest.fixture(scope="module")
def standard():
    return build_head(HeadStyle(charm=0))


@pytest.fixture(scope="module")
def stranger(standard):
    """The same surface in metres, turned, its vertices shuffled."""
    on_surface = set(np.unique(standard.triangles).tolist())  # the spine's top and the skull under the hair are not
    order = np.random.default_rng(0).permutation(len(standard.vertices_mm))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    turn = Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix()
    vertices = (standard.vertices_mm[order].astype(float) @ turn.T + [1, 2, 3]) / 1000
    points = {name: int(place[index]) for name, index in standard.feature_points.items() if index in on_surface}
    return vertices, place[standard.triangles], points


@pytest.fixture(scope="module")
def imported(standard, stranger):
    return import_plain(*stranger, standard)


def test_it_lies_where_the_standard_face_lies(standard, stranger, imported):
    assert imported.scale == pytest.approx(1000.0, rel=1e-3)
    for name in stranger[2]:
        np.testing.assert_allclose(imported.mesh.point_mm(name), standard.point_mm(name), atol=0.05)
    assert imported.mesh.fapu.mw0_mm == pytest.approx(standard.fapu.mw0_mm, rel=1e-3)
    assert imported.notes == ()


def test_each_fap_moves_its_own_point_by_its_step_and_no_other(imported):
    mesh = imported.mesh
    skin = [name for name, index in mesh.feature_points.items() if mesh.material[index] == Material.SKIN]
    checked = 0
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.number not in imported.moved or row.number in BONES:
            continue
        value = 100.0
        frame = np.zeros(68)
        frame[fap.column(row.number)] = value
        moved = deform(mesh, frame) - mesh.vertices_mm
        own = moved[mesh.feature_points[row.point]] @ np.array(axis)
        assert own == pytest.approx(value * mesh.fapu.unit(row.unit), rel=0.02), row.name
        others = [mesh.feature_points[name] for name in skin if name != row.point]
        assert np.abs(moved[others]).max() < 0.02 * abs(own) + 0.01, row.name
        checked += 1
    assert checked >= 43


def test_lips_part_at_the_slit(imported):
    mesh = imported.mesh
    frame = np.zeros(68)
    for number in (5, 10, 11, 52, 57, 58):
        frame[fap.column(number)] = -300
    moved = deform(mesh, frame) - mesh.vertices_mm
    assert moved[mesh.feature_points["2.3"], 1] < -3
    assert np.abs(moved[mesh.feature_points["2.2"]]).max() < 0.05


def test_the_jaw_lowers_the_chin_and_leaves_lips_and_nose(imported):
    mesh = imported.mesh
    frame = np.zeros(68)
    frame[fap.column(3)] = 300
    moved = deform(mesh, frame) - mesh.vertices_mm
    assert -moved[mesh.feature_points["2.1"], 1] == pytest.approx(300 * mesh.fapu.unit(fap.FapUnit.MNS), rel=0.03)
    for name in ("8.1", "8.2", "2.3", "9.3", "3.1"):
        assert np.abs(moved[mesh.feature_points[name]]).max() < 0.05


def test_eyes_are_found_and_turn(imported):
    mesh = imported.mesh
    assert (mesh.material == Material.EYE).sum() > 200
    frame = np.zeros(68)
    frame[fap.column(23)] = 20_000
    moved = deform(mesh, frame) - mesh.vertices_mm
    pupil = moved[mesh.feature_points["3.5"]]
    assert pupil[0] == pytest.approx(0.2 * 12, abs=0.8)  # 0.2 rad on a ball of about 12 mm
    assert np.abs(moved[mesh.feature_points["3.6"]]).max() < 1e-3


@pytest.fixture(scope="module")
def joined(standard):
    """Our head with gums before the teeth of both jaws, which hang on the root of its tongue; and their vertices."""
    tongue = np.flatnonzero(standard.material == Material.TONGUE)
    root = int(tongue[standard.vertices_mm[tongue, 2].argmin()])
    upper = [(-24, 50), (-16, 60), (-12, 75), (-14, 90), (-16, 104.5), (-20, 105), (-26, 105)]
    lower = [(-44, 50), (-50, 60), (-54, 75), (-56, 90), (-54, 103), (-50, 103), (-42, 103)]
    vertices, triangles, gums = [standard.vertices_mm.astype(float)], [standard.triangles], []
    for height_and_depth in (upper, lower):
        first = sum(map(len, vertices))
        vertices.append(np.array([(x, y, z) for y, z in height_and_depth for x in (-9.0, 9.0)]))
        strip = first + np.arange(len(vertices[-1]))
        triangles += [np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1), np.array([[root, strip[0], strip[1]]])]
        gums.append(strip[-6:])
    on_surface = set(np.unique(standard.triangles).tolist())
    points = {name: index for name, index in standard.feature_points.items() if index in on_surface}
    found = import_plain(np.concatenate(vertices), np.concatenate(triangles), points, standard)
    return found, [np.searchsorted(found.placed.kept, strip) for strip in gums]


def test_gums_that_hang_on_the_tongue_stay_when_it_is_asked_out(joined):
    found, (upper, lower) = joined
    mesh = found.mesh
    frame = np.zeros(68)
    frame[[fap.column(44), fap.column(45)]] = 200, 500
    moved = deform(mesh, frame) - mesh.vertices_mm
    tip = moved[mesh.feature_points["6.1"]]
    assert tip[2] == pytest.approx(500 * mesh.fapu.unit(fap.FapUnit.MW), rel=0.02)
    assert np.abs(moved[np.concatenate([upper, lower])]).max() < 0.02 * tip[2]


def test_gums_of_one_part_go_each_with_its_jaw(joined):
    found, (upper, lower) = joined
    mesh = found.mesh
    frame = np.zeros(68)
    frame[fap.column(3)] = 400
    moved = deform(mesh, frame) - mesh.vertices_mm
    teeth = moved[mesh.feature_points["9.11"]]
    assert teeth[1] < -8
    assert np.abs(moved[upper]).max() < 0.05
    np.testing.assert_allclose(moved[lower, 1], teeth[1], atol=1.0)
    assert moved[mesh.feature_points["6.1"], 1] == pytest.approx(teeth[1], abs=1.0)


def test_fewer_points_move_less_and_say_so(standard, stranger):
    vertices, triangles, points = stranger
    few = {name: points[name] for name in ("8.1", "8.2", "8.3", "8.4", "2.1", "2.2", "2.3", "9.3")}
    found = import_plain(vertices, triangles, few, standard)
    assert {4, 5, 16, 17, 51, 52, 53, 54} <= set(found.moved)
    assert {19, 20, 23, 31, 41} <= set(found.missing)
    assert found.notes[0].startswith("FAPU")
    assert (found.mesh.material == Material.SKIN).all()


def test_colours_are_kept(standard, stranger):
    vertices, triangles, points = stranger
    colours = np.random.default_rng(1).random((len(vertices), 3))
    found = import_plain(vertices, triangles, points, standard, colours)
    np.testing.assert_allclose(found.mesh.albedo[found.mesh.feature_points["9.3"]], colours[points["9.3"]], atol=1e-6)


def test_vertices_of_no_triangle_are_dropped(standard, stranger):
    vertices, triangles, points = stranger
    more = np.concatenate([vertices, [[5.0, 5.0, 5.0]]])
    fewer = import_plain(vertices, triangles, points, standard).mesh
    assert len(import_plain(more, triangles, points, standard).mesh.vertices_mm) == len(fewer.vertices_mm)
    assert len(fewer.vertices_mm) <= len(np.unique(triangles)) < len(vertices)
    with pytest.raises(DataError, match=r"9\.3: got vertex"):
        import_plain(more, triangles, points | {"9.3": len(vertices)}, standard)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v, t, p: (v, t, {k: p[k] for k in ("8.1", "8.2")}), "expected at least 8"),
        (lambda v, t, p: (v, t, p | {"8.1": p["8.2"]}), "one vertex for both"),
        (lambda v, t, p: (v, t, p | {"8.1": -1}), "got vertex -1"),
        (lambda v, t, p: (v * [-1, 1, 1], t, p), "left and right are exchanged"),
        (lambda v, t, p: (v, t, p | {"3.8": p["3.12"], "3.12": p["3.8"]}), "3.8 and 3.12 are exchanged"),
        (lambda v, t, p: (v, t, p | {"4.5": p["4.1"], "4.1": p["4.5"]}), "4.5 and 4.1 are exchanged"),
        (lambda v, t, p: (v * 0, t, p), "got all within"),
        (lambda v, t, p: (v * [0, 1, 0], t, p), "on one line"),
        (lambda v, t, p: (v, t[:0], p), "triangles: got 0"),
        (lambda v, t, p: (v, t + len(v), p), "triangles: vertices must be"),
    ],
)
def test_what_is_no_face_is_refused(standard, stranger, change, message):
    with pytest.raises((DataError, UsageError), match=message):
        import_plain(*change(*stranger), standard)
