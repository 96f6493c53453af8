"""A mesh with shapes of its own: its points found by what the shapes move, its shapes blended for each FAP."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError, UsageError
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import Bone, Channel, DeformationBasis, Material
from fapengine.mesh.rig.blendshape_basis import MAX_ROWS, RowCollector
from fapengine.mesh.rig.blendshape_mesh import BOTH, JAW, LEFT, RIGHT, Blendshape, BlendshapeMesh, RigBone
from fapengine.mesh.rig.feature_points import locate
from fapengine.mesh.rig.import_head import import_head
from fapengine.mesh.rig.parts import Eyeball, blank_eyes
from fapengine.mesh.rig.placed_mesh import PlacedMesh
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.rig_weights import choose_blendshapes, plain, viseme

from .rigs import import_plain, own_rig, skin_of

NOT_ON_SKIN = (23, 24, 25, 26, 27, 28, 43, 44, 45, 48, 49, 50)


@pytest.fixture(scope="module")
def standard():
    return build_head(HeadStyle(charm=0))


@pytest.fixture(scope="module")
def rig():
    return own_rig()


@pytest.fixture(scope="module")
def marked(standard):
    on_surface = set(np.unique(standard.triangles).tolist())
    return {name: index for name, index in standard.feature_points.items() if index in on_surface}


@pytest.fixture(scope="module")
def imported(rig, marked, standard):
    choice = choose_blendshapes(rig.blendshapes)
    return import_head(rig, choice.blended, marked, standard, choice.own_faps)


def roles(rig: BlendshapeMesh) -> dict[str, np.ndarray]:
    return {LEFT: rig.dense("eyeBlinkLeft"), RIGHT: rig.dense("eyeBlinkRight"), JAW: rig.dense("jawOpen")}


def moved(rig: BlendshapeMesh, turn: np.ndarray, scale: float, shift: np.ndarray) -> BlendshapeMesh:
    """The same rig in other axes and units."""
    shapes = {name: Blendshape(one.vertices, scale * one.moves @ turn.T) for name, one in rig.blendshapes.items()}
    return replace(rig, vertices=scale * rig.vertices @ turn.T + shift, blendshapes=shapes)


def test_points_are_found_wherever_the_face_looks(rig, standard):
    here = locate(rig, roles(rig), standard)
    off = [np.linalg.norm(rig.vertices[index] - standard.point_mm(name)) for name, index in here.items()]
    assert len(here) >= 55
    assert np.mean(off) < 3.5  # mm
    assert here["2.2"] != here["2.3"]
    sunk = -rig.dense("jawOpen")[:, 1]
    for upper, lower in (
        ("2.2", "2.3"),
        ("2.6", "2.8"),
        ("2.7", "2.9"),
        ("8.1", "8.2"),
        ("8.5", "8.7"),
        ("8.6", "8.8"),
    ):
        assert sunk[here[lower]] > sunk[here[upper]] + 10.0, (upper, lower)  # mm: each on its own lip
    turn = Rotation.from_rotvec([0.4, -2.0, 0.9]).as_matrix()
    there = moved(rig, turn, 0.001, np.array([3.0, -1.0, 2.0]))
    same = locate(there, roles(there), standard)
    apart = [np.linalg.norm(rig.vertices[here[name]] - rig.vertices[same[name]]) for name in here if name in same]
    assert len(apart) >= 55
    assert np.mean(apart) < 0.5  # rounding may choose a neighbour


def test_points_lie_on_the_outside_of_a_skin_that_has_an_inside(rig, standard):
    """A shell of 1 mm: the inside is as near as the outside, and moves with it; only its normals tell it apart."""
    count, inwards = len(rig.vertices), -1.0 * vertex_normals(rig.vertices, rig.triangles)
    skin = rig.triangles[rig.surface[rig.triangles[:, 0]] == 0]
    edge = skin[rig.vertices[skin][..., 1].max(axis=1).argmin()]  # at the foot of the neck, where both sides meet
    rim = [[edge[0], edge[1], edge[0] + count], [edge[1], edge[1] + count, edge[0] + count]]
    shell = replace(
        rig,
        vertices=np.concatenate([rig.vertices, rig.vertices + inwards]),
        triangles=np.concatenate([rig.triangles, skin[:, ::-1] + count, rim]),
        surface=np.tile(rig.surface, 2),
        albedo=None,
        blendshapes={
            name: Blendshape(np.concatenate([one.vertices, one.vertices + count]), np.tile(one.moves, (2, 1)))
            for name, one in rig.blendshapes.items()
        },
    )
    found = locate(shell, roles(shell), standard)
    assert len(found) >= 55
    bent = [name for name in found if name.startswith(("2.1", "4.", "5.", "8.", "9."))]
    assert [name for name in bent if found[name] >= count] == []


def test_skin_that_stretches_above_the_lips_is_not_a_slit(rig, standard):
    """As of VRoid's vowels, which stretch the skin below the nose: it lies in front of the lips that open."""
    here = locate(rig, roles(rig), standard)
    tip = standard.point_mm("9.3")
    above = (np.abs(rig.vertices[:, 0]) < 12) & (np.abs(rig.vertices[:, 1] - tip[1] + 12) < 3)
    stretched = rig.dense("jawOpen") + np.where(above[:, None], [0.0, 12.0, 0.0], 0.0)
    there = locate(rig, roles(rig) | {JAW: stretched}, standard)
    assert [(name, there[name]) for name in ("2.2", "2.3")] == [(name, here[name]) for name in ("2.2", "2.3")]


def test_units_that_no_face_has_are_replaced(rig, marked, standard):
    """As of a VRoid avatar whose point 9.15 lay at its lip: FAPs of the mouth were a tenth of what they should be."""
    above = standard.point_mm("8.1") + np.array([0.0, 2.0, 0.0])
    free = np.setdiff1d(np.unique(rig.triangles), list(marked.values()))
    at_lip = int(free[np.linalg.norm(rig.vertices[free] - above, axis=1).argmin()])
    found = import_head(rig, ["jawOpen"], marked | {"9.15": at_lip}, standard)
    expected = found.mesh.fapu.es0_mm * standard.fapu.mns0_mm / standard.fapu.es0_mm
    assert found.mesh.fapu.mns0_mm == pytest.approx(expected)
    (note,) = (note for note in found.notes if note.startswith("FAPU: MNS0 is"))
    assert "as on the standard face" in note
    assert not [note for note in import_head(rig, ["jawOpen"], marked, standard).notes if "FAPU" in note]


def test_a_mouth_that_is_open_at_rest_is_closed(rig, marked, standard):
    lower = np.abs(rig.dense("jawOpen")[:, 1]) > 5.0
    lower &= rig.surface == 0
    ajar = replace(rig, vertices=rig.vertices - np.where(lower[:, None], [0.0, 1.5, 0.0], 0.0))
    head = import_head(ajar, ["jawOpen"], marked, standard)
    for upper, under in (("2.2", "2.3"), ("2.6", "2.8"), ("2.7", "2.9")):
        assert abs(head.mesh.point_mm(upper)[1] - head.mesh.point_mm(under)[1]) < 0.3, upper  # mm
    assert [note for note in head.notes if "1.5 mm apart at rest" in note]
    assert not [note for note in import_head(rig, ["jawOpen"], marked, standard).notes if "apart at rest" in note]


def test_a_flat_eye_with_a_joint_far_away_stays_in_its_lids(rig, marked, standard):
    """As VRoid's, 73 mm in front of their joint: they moved 18 mm in a glance."""
    eye = (rig.surface == rig.surfaces.index("Eyeball")) & (rig.vertices[:, 0] > 0)
    glance = np.zeros(68)
    glance[fap.column(23)] = 25_000.0
    for behind_mm in (0.0, 61.0):
        joint = standard.eye_pivots_mm[0] - [0.0, 0.0, behind_mm]
        mesh = import_head(
            replace(rig, bones={"left eye": RigBone(eye.astype(float), joint)}), ["jawOpen"], marked, standard
        ).mesh
        gone = deform(mesh, glance)[mesh.feature_points["3.5"]] - mesh.point_mm("3.5")
        assert 2.0 < np.linalg.norm(gone) < 8.0, behind_mm  # mm


def test_a_blink_of_both_eyes_is_parted_at_the_nose(rig, standard):
    apart = locate(rig, roles(rig), standard)
    both = rig.dense("eyeBlinkLeft") + rig.dense("eyeBlinkRight")
    together = locate(rig, {BOTH: both, JAW: rig.dense("jawOpen")}, standard)
    for name in ("3.1", "3.2", "3.5", "3.6", "8.3"):
        assert together[name] == apart[name]


def sinking(rig: BlendshapeMesh) -> np.ndarray:
    """A chin that sinks and tears nothing."""
    return np.clip((rig.vertices[:, 1:2] + 10.0) / 60.0, -1.0, 0.0) * [0.0, 20.0, 0.0]


def test_eye_bones_stand_in_for_blinks(rig, standard):
    limbs = {}
    for name, sign in (("left eye", 1.0), ("right eye", -1.0)):
        ball = (rig.surface == rig.surfaces.index("Eyeball")) & (sign * rig.vertices[:, 0] > 0)
        limbs[name] = RigBone(ball.astype(float), rig.vertices[ball].mean(axis=0))
    found = locate(replace(rig, bones=limbs), {JAW: rig.dense("jawOpen")}, standard)
    off = [np.linalg.norm(rig.vertices[index] - standard.point_mm(name)) for name, index in found.items()]
    assert len(found) >= 50
    assert np.mean(off) < 5.0  # mm
    with pytest.raises(DataError, match="missing for right lid"):
        locate(
            replace(rig, bones={"left eye": limbs["left eye"]}),
            {LEFT: rig.dense("eyeBlinkLeft"), JAW: rig.dense("jawOpen")},
            standard,
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rig, own: {JAW: own[JAW]}, "missing for left lid, right lid"),
        (lambda rig, own: {BOTH: own[LEFT]}, "missing for left lid, right lid, jaw"),
        (lambda rig, own: own | {JAW: 0 * own[JAW]}, "missing for jaw"),
        (lambda rig, own: own | {LEFT: own[RIGHT], RIGHT: own[LEFT]}, "left and right are exchanged"),
        (lambda rig, own: {LEFT: own[JAW], RIGHT: own[JAW], JAW: own[JAW]}, "two eyes above a mouth"),
        (lambda rig, own: own | {JAW: sinking(rig)}, "no slit opens"),
    ],
)
def test_shapes_that_show_no_face(rig, standard, change, message):
    with pytest.raises(DataError, match=message):
        locate(rig, change(rig, roles(rig)), standard)


def test_each_fap_moves_its_point_by_its_step_and_no_other(imported):
    mesh = imported.mesh
    skin = [name for name, index in mesh.feature_points.items() if mesh.material[index] == Material.SKIN]
    lids = {19: 21, 20: 22, 21: 19, 22: 20}
    checked = 0
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.number in NOT_ON_SKIN or row.number not in imported.moved:
            continue
        for value in (100.0, 300.0):
            frame = np.zeros(68)
            frame[fap.column(row.number)] = value
            gone = deform(mesh, frame) - mesh.vertices_mm
            own = gone[mesh.feature_points[row.point]] @ np.array(axis)
            assert own == pytest.approx(value * mesh.fapu.unit(row.unit), rel=0.02), row.name
            for other in fap.FAPS:
                along = fap.HEAD_AXES.get(other.positive)
                if along is None or other.point not in skin or other.number not in imported.moved:
                    continue
                if other.number in (row.number, 18, lids.get(row.number)):
                    continue
                off = gone[mesh.feature_points[other.point]] @ np.array(along)
                assert abs(off) < 0.03 * abs(own) + 0.02, (row.name, other.name)
        checked += 1
    assert checked >= 45


def test_poses_of_the_rig_come_back(rig, imported, standard):
    """FAP to shapes to vertices, against the rig itself and against a head that has nothing but feature points."""
    mesh, shapes = imported.mesh, arkit_map()
    points_alone = import_plain(rig.vertices, rig.triangles, mesh_points(mesh, rig), standard).mesh
    theirs = cKDTree(rig.vertices).query(mesh.vertices_mm)[1]
    skin = np.isin(theirs, skin_of(standard))
    rng = np.random.default_rng(0)
    ours, plain_ones, motion = [], [], []
    for _ in range(8):
        weights = np.where(rng.random(52) < 0.15, rng.uniform(0, 0.6, 52), 0.0)
        weights[[name.startswith(("eyeLook", "tongue")) for name in shapes.names]] = 0.0
        wanted = sum(weight * rig.dense(name) for name, weight in zip(shapes.names, weights, strict=True))
        faps = shapes.to_faps(weights)
        ours.append(np.linalg.norm(deform(mesh, faps) - mesh.vertices_mm - wanted[theirs], axis=1)[skin])
        motion.append(np.linalg.norm(wanted[theirs], axis=1)[skin])
        there = cKDTree(points_alone.vertices_mm).query(mesh.vertices_mm)[1]
        gone = (deform(points_alone, faps) - points_alone.vertices_mm)[there]
        plain_ones.append(np.linalg.norm(gone - wanted[theirs], axis=1)[skin])
    error, without, size = np.mean(ours), np.mean(plain_ones), np.mean(motion)
    assert error < 0.25 * size
    assert error < 0.6 * without


def mesh_points(mesh, rig: BlendshapeMesh) -> dict[str, int]:
    at = cKDTree(rig.vertices[np.unique(rig.triangles)])
    names = list(mesh.feature_points)
    found = at.query(np.stack([mesh.point_mm(name) for name in names]))[1]
    return dict(zip(names, np.unique(rig.triangles)[found].tolist(), strict=True))


def test_lids_go_round_the_ball(imported):
    mesh = imported.mesh
    centre, point = mesh.eye_pivots_mm[0], mesh.feature_points["3.1"]
    radius = np.linalg.norm(mesh.vertices_mm[point] - centre)
    frame = np.zeros(68)
    for value in range(0, 1025, 128):
        frame[fap.column(19)] = value
        there = deform(mesh, frame)[point]
        assert 0.97 * radius < np.linalg.norm(there - centre) < 1.035 * radius
    frame[fap.column(19)] = 2000
    assert np.linalg.norm(deform(mesh, frame)[point] - there) < 1.0  # mm: shut is shut


def test_eyes_jaw_and_head(imported, rig, marked, standard):
    mesh = imported.mesh
    assert (mesh.material == Material.EYE).sum() > 100
    assert set(imported.missing) >= {29, 30}
    frame = np.zeros(68)
    frame[fap.column(23)] = 20_000
    gone = deform(mesh, frame) - mesh.vertices_mm
    assert gone[mesh.feature_points["3.5"], 0] > 1.0
    assert np.abs(gone[mesh.feature_points["3.6"]]).max() < 1e-3
    teeth = mesh.feature_points["9.11"]
    frame = np.zeros(68)
    frame[fap.column(3)] = 300
    assert deform(mesh, frame)[teeth, 1] < mesh.vertices_mm[teeth, 1] - 2.0
    jawless = [name for name in rig.blendshapes if name.startswith(("mouthSmile", "brow", "eyeBlink"))]
    boned = import_head(rig, jawless, marked, standard).mesh
    assert (boned.bone == Bone.JAW).any()
    assert deform(boned, frame)[boned.feature_points["2.1"], 1] < boned.point_mm("2.1")[1] - 4.0


def test_no_shape_moves_an_eyeball(rig, marked, standard):
    ball = np.flatnonzero(rig.surface == rig.surfaces.index("Eyeball"))
    lids = rig.dense("eyeBlinkLeft")
    lids[ball] = [0.0, -5.0, 0.0]
    blink = Blendshape(np.arange(len(lids)), lids)
    mesh = import_head(
        replace(rig, blendshapes={**rig.blendshapes, "Blink": blink}), ["Blink", "jawOpen"], marked, standard
    ).mesh
    frame = np.zeros(68)
    frame[fap.column(19)] = 1000.0
    gone = deform(mesh, frame) - mesh.vertices_mm
    assert gone[mesh.feature_points["3.1"], 1] < -8.0
    assert np.abs(gone[mesh.material == Material.EYE]).max() < 1e-3


def test_bones_of_the_rig_are_heeded(rig, marked, standard):
    count = len(rig.vertices)
    half = np.full(count, 0.5)
    eye = (rig.surface == rig.surfaces.index("Eyeball")) & (rig.vertices[:, 0] > 0)
    limbs = {
        "head": RigBone(half, np.array([0.0, -100.0, 10.0])),
        "jaw": RigBone(np.where(rig.vertices[:, 1] < -50, 0.25, 0.0), np.array([0.0, 5.0, 20.0])),
        "left eye": RigBone(eye.astype(float), np.array([31.0, 36.0, 80.0])),
    }
    with_bones = replace(rig, bones=limbs)
    blended = ["mouthSmileLeft", "mouthSmileRight"]
    mesh = import_head(with_bones, blended, marked, standard).mesh
    assert np.unique(mesh.head_weight).tolist() == [0.5]
    np.testing.assert_allclose(mesh.head_pivot_mm, [0, -100, 10], atol=0.01)
    np.testing.assert_allclose(mesh.eye_pivots_mm[0], [31, 36, 80], atol=0.01)
    np.testing.assert_allclose(mesh.jaw_pivot_mm, [0, 5, 20], atol=0.01)
    chin = mesh.feature_points["2.1"]
    assert (mesh.bone[chin], mesh.bone_weight[chin]) == (Bone.JAW, 0.25)


def test_an_iris_is_drawn_on_balls_that_have_none(rig, marked, standard):
    ball = np.flatnonzero(rig.surface == rig.surfaces.index("Eyeball"))
    front = ball[rig.vertices[ball, 2] > rig.vertices[ball, 2].max() - 1.5]
    colours = np.array(rig.albedo)
    colours[front] = [0.1, 0.2, 0.6]
    uv, texture = np.zeros((len(rig.vertices), 2)), np.full((8, 8, 4), 255, np.uint8)
    texture[7, 7] = [20, 40, 120, 255]
    uv[front] = 1.0
    for more, kind in (
        ({}, Material.EYE),
        ({"albedo": colours}, Material.BALL),
        ({"albedo": None}, Material.EYE),
        ({"uv": uv, "texture": texture}, Material.BALL),
        ({"uv": 0 * uv, "texture": texture}, Material.EYE),
    ):
        mesh = import_head(replace(rig, **more), ["jawOpen"], marked, standard).mesh
        eye = mesh.feature_points["3.5"]
        assert mesh.material[eye] == kind
        on_plane = np.linalg.norm(mesh.uv[eye] - 0.5) < 0.05
        assert on_plane == (kind == Material.EYE)
        assert (mesh.texture is None) == ("texture" not in more)


def test_no_iris_is_drawn_on_an_eye_that_is_a_flat_piece_with_one() -> None:
    """As VRoid's: its joint is 73 mm behind it, so its front and what is round it are the same places."""
    across = np.linspace(-30.0, 30.0, 21)
    flat = np.array([(x, y, 73.0) for x in across for y in across])
    colours = np.where((np.arange(len(flat)) % 2 == 0)[:, None], [0.1, 0.2, 0.6], [0.9, 0.9, 0.9])
    for albedo, has_iris in ((colours, True), (np.full_like(colours, 0.9), False)):
        source = BlendshapeMesh(vertices=flat, triangles=np.array([[0, 1, 21]]), blendshapes={}, albedo=albedo)
        mesh = PlacedMesh(
            source=source, vertices_mm=flat, triangles=source.triangles, kept=np.arange(len(flat)), points={},
            scale=1.0, rotation=np.eye(3), node=np.arange(len(flat)), part=np.zeros(len(flat), int),
        )  # fmt: skip
        eyes = {"3.5": Eyeball(np.arange(len(flat)), np.zeros(3))}
        assert (not blank_eyes(mesh, eyes)) == has_iris


def test_eyeballs_are_where_their_bones_are(rig, standard):
    here = locate(rig, roles(rig), standard)
    nose = np.zeros(len(rig.vertices))
    nose[np.linalg.norm(rig.vertices - standard.point_mm("9.3"), axis=1) < 8] = 1.0
    odd = replace(rig, bones={"left eye": RigBone(nose, np.zeros(3))})
    there = locate(odd, roles(rig), standard)
    assert nose[there["3.5"]] == 1.0
    assert there["3.6"] == here["3.6"]
    blind = replace(rig, triangles=rig.triangles[rig.surface[rig.triangles[:, 0]] != rig.surfaces.index("Eyeball")])
    assert not {"3.5", "3.6"} & set(locate(blind, roles(rig), standard))


def test_what_hangs_far_below_is_left_out(rig, marked, standard):
    more = BlendshapeMesh(
        vertices=np.concatenate([rig.vertices, [[0, -900, 0], [9, -900, 0], [0, -909, 0]]]),
        triangles=np.concatenate([rig.triangles, [[len(rig.vertices) + k for k in range(3)]]]),
        blendshapes=rig.blendshapes,
    )
    mesh = import_head(more, ["jawOpen"], marked, standard).mesh
    assert mesh.vertices_mm[:, 1].min() > -300
    aside = replace(
        more,
        vertices=np.where(
            np.arange(len(more.vertices))[:, None] >= len(rig.vertices), [[2000.0, -40.0, 0.0]], more.vertices
        ),
    )
    with pytest.raises(DataError, match=r"got 8\.3 far from the face"):
        import_head(aside, ["jawOpen"], marked | {"8.3": len(rig.vertices)}, standard)


def test_a_shape_may_mean_faps(rig, marked, standard):
    tip, crown = marked["9.3"], int(np.unique(rig.triangles)[rig.vertices[np.unique(rig.triangles), 1].argmax()])
    lift = Blendshape(np.array([tip, crown]), np.array([[0.0, 6.0, 0.0], [0.0, 3.0, 0.0]]))
    found = import_head(
        replace(rig, blendshapes={**rig.blendshapes, "Ear": lift}),
        ["jawOpen"],
        marked,
        standard,
        {"Ear": {67: 200.0, 64: 400.0}},
    )
    assert 67 in found.moved
    mesh, frame = found.mesh, np.zeros(68)
    nose, top = mesh.feature_points["9.3"], int(cKDTree(mesh.vertices_mm).query(rig.vertices[crown])[1])

    def risen(vertex: int) -> float:
        return float(deform(mesh, frame)[vertex, 1] - mesh.vertices_mm[vertex, 1])

    for value, height in ((0.0, 0.0), (200.0, 6.0), (100.0, 3.0), (-100.0, 0.0)):
        frame[fap.column(67)] = value
        assert risen(nose) == pytest.approx(height, abs=0.01)
    frame[:] = 0.0
    frame[fap.column(64)] = 200.0  # half the shape; but the nose goes sideways by its step, and no other way
    assert risen(top) == pytest.approx(1.5, abs=0.01)
    assert risen(nose) == pytest.approx(0.0, abs=0.01)
    gone = deform(mesh, frame)[nose] - mesh.vertices_mm[nose]
    step = mesh.fapu.unit(fap.spec(64).unit)
    assert gone @ np.array(fap.HEAD_AXES[fap.spec(64).positive]) == pytest.approx(200 * step, rel=0.02)
    with pytest.raises(DataError, match=r"got \['Nose'\], expected some of"):
        import_head(rig, ["jawOpen"], marked, standard, {"Nose": {64: 1.0}})


def test_without_shapes_points_do_all(rig, marked, standard):
    found = import_head(rig, [], marked, standard)
    assert len(found.moved) >= 50
    assert found.used == ()
    frame = np.zeros(68)
    frame[fap.column(12)] = 200.0
    corner = found.mesh.feature_points["2.4"]
    gone = deform(found.mesh, frame)[corner] - found.mesh.vertices_mm[corner]
    np.testing.assert_allclose(gone, [0, 200 * found.mesh.fapu.unit(fap.spec(12).unit), 0], atol=0.05)
    frame[:] = 0.0
    frame[fap.column(3)] = 300.0
    chin, lip = (found.mesh.feature_points[name] for name in ("2.1", "2.3"))
    gone = deform(found.mesh, frame) - found.mesh.vertices_mm
    assert gone[chin, 1] < -5.0
    assert np.abs(gone[lip]).max() < 0.05


def test_lashes_and_brows_of_their_own_go_with_the_skin(rig, marked, standard):
    lid, brow = rig.vertices[marked["3.1"]], rig.vertices[marked["4.3"]]
    count = len(rig.vertices)
    more = BlendshapeMesh(
        vertices=np.concatenate([rig.vertices, lid + np.eye(3) + [0, 0, 2], brow + np.eye(3) + [0, 0, 30]]),
        triangles=np.concatenate([rig.triangles, count + np.arange(6).reshape(2, 3)]),
        blendshapes={},
        surfaces=(*rig.surfaces, "Eyebrow_02"),
        surface=np.concatenate([rig.surface, [0] * 3, [len(rig.surfaces)] * 3]),
    )
    by_points = import_plain(more.vertices, more.triangles, marked, standard).mesh
    for mesh in (import_head(more, [], marked, standard).mesh, by_points):
        lash, card = (cKDTree(mesh.vertices_mm).query(place)[1] for place in more.vertices[[count, count + 3]])
        frame = np.zeros(68)
        frame[fap.column(19)] = 600.0
        gone = deform(mesh, frame) - mesh.vertices_mm
        assert gone[lash, 1] < 0.7 * gone[mesh.feature_points["3.1"], 1] < -2.0
        frame[:] = 0.0
        frame[fap.column(33)] = 100.0
        gone = deform(mesh, frame) - mesh.vertices_mm
        if mesh is not by_points:  # so far away it is told by its name alone
            assert gone[card, 1] > 0.7 * gone[mesh.feature_points["4.3"], 1] > 1.0


def test_the_weakest_rows_go_where_there_are_too_many():
    collector = RowCollector(3)
    for row in range(MAX_ROWS + 5):
        collector.add(
            np.array([0, 1]), np.full((2, 3), 0.2 + row), {collector.channel(Channel(5, 0.0, float(row + 1))): 1.0}
        )
    collector.add(np.array([2]), np.full((1, 3), 0.01), {0: 1.0})  # nothing that could be seen
    basis = collector.basis()
    assert basis.width == MAX_ROWS
    assert basis.entry_mm.min() == pytest.approx(5.2e-3)
    assert basis.offsets.tolist() == [0, MAX_ROWS, 2 * MAX_ROWS, 2 * MAX_ROWS]


def test_meshes_that_contradict_themselves():
    triangle = {"vertices": np.eye(3), "triangles": [[0, 1, 2]]}
    for more, message in (
        ({"triangles": [[0, 1, 3]]}, "triangles: vertices must be 0 to 2"),
        ({"blendshapes": {"a": Blendshape(np.array([3]), np.zeros((1, 3)))}}, "blendshape a: vertices must be 0 to 2"),
        ({"bones": {"toe": RigBone(np.zeros(3), np.zeros(3))}}, r"got .'toe'., expected some of head, jaw"),
        ({"uv": np.zeros((2, 2))}, "uv: got shape"),
    ):
        with pytest.raises(UsageError, match=message):
            BlendshapeMesh(**({"blendshapes": {}} | triangle | more))
    with pytest.raises(UsageError, match="got 'b', this mesh has a"):
        BlendshapeMesh(**triangle, blendshapes={"a": Blendshape(np.array([0]), np.ones((1, 3)))}).dense("b")
    with pytest.raises(UsageError, match="entry_channels: must be 0 to 0"):
        DeformationBasis(
            channels=(Channel(3, 0.0, 1.0),) * 3, offsets=[0, 1], entry_channels=[1], entry_mm=[[0, 0, 0]],
            mix=np.ones((1, 3)),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "means"),
    [
        ("eyeBlinkLeft", "eyeblinkleft"), ("EyeBlink_L", "eyeblinkleft"), ("blendShape1.eyeBlink_R", "eyeblinkright"),
        ("mouthUpperUpL", "mouthupperupleft"), ("Blink_L", "eyeblinkleft"), ("Fcl_EYE_Close_R", "eyeblinkright"),
        ("cheekRaiser_L", "cheekraiserleft"), ("eyesClosed", "blink"), ("mouthOpen", "jawopen"),
        ("Jaw Open", "jawopen"), ("CTRL_expressions_jawOpen", "jawopen"), ("vrc.blink_left", "eyeblinkleft"),
        ("EyeClosedRight", "eyeblinkright"), ("まばたき", "blink"), ("あ", "a"),
    ],
)  # fmt: skip
def test_names_of_many_houses(name, means):
    assert plain(name) == means


def test_shapes_are_chosen_by_name():
    assert [viseme(name) for name in ("vrc.v_ou", "viseme_nn", "U", "Fcl_MTH_O", "v_TH", "smile")] == [
        "U", "nn", "ou", "oh", "TH", None,
    ]  # fmt: skip
    full = choose_blendshapes([*ARKIT_NAMES, "viseme_aa", "Belly"])
    assert len(full.blended) == 43  # without gaze and tongue
    assert full.own_faps == {"tongueOut": {45: 1024.0}}
    assert (full.left, full.right, full.jaw) == (("eyeBlinkLeft",), ("eyeBlinkRight",), ("jawOpen", "viseme_aa"))
    assert full.missing == ()
    few = choose_blendshapes(["A", "I", "Blink", "Joy", "viseme_sil", "jawOpen"])
    assert few.blended == ("jawOpen", "A", "I", "Blink")
    assert (few.both, few.jaw) == (("Blink",), ("jawOpen", "A"))
    assert len(few.missing) == 51
    told = choose_blendshapes(
        ["Kiefer", "jawOpen", "Lid", "Ohr", "A", "I"],
        {"Kiefer": "jawOpen", "Lid": "blink", "Ohr": {65: 300.0}, "A": "unused", "I": "viseme_aa"},
    )  # fmt: skip
    assert told.blended == ("Kiefer", "I", "Lid")
    assert told.own_faps == {"Ohr": {65: 300.0}}
    assert told.jaw == ("Kiefer", "I")
    sure = choose_blendshapes(["mouthOpen", "mouthSmile", "jawOpen"])
    assert sure.jaw == ("jawOpen",)
    assert sure.blended == ("jawOpen", "mouthSmile")
    assert choose_blendshapes(["mouthSmile", "mouthSmile_L", "mouthSmile_R"]).blended == (
        "mouthSmile_L",
        "mouthSmile_R",
    )
    ict = choose_blendshapes(["browInnerUp_L", "browInnerUp_R", "cheekRaiser_L", "cheekSquint_L", "cheekRaiser_R"])
    assert set(ict.blended) == {"browInnerUp_L", "browInnerUp_R", "cheekRaiser_L", "cheekSquint_L", "cheekRaiser_R"}
    assert not {"browInnerUp", "cheekSquintLeft", "cheekSquintRight"} & set(ict.missing)
    assert len(ict.missing) == 49
