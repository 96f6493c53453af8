"""Our own head on a scan: of our own making, and of a measured face."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fapengine.errors import DataError, UsageError
from fapengine.files.heads.load import load_head, load_head_info
from fapengine.geometry.rigid import fit_rigid
from fapengine.geometry.surface import Surface
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MEASURED, PEOPLE
from fapengine.mesh.deform import deform, still_faps
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.models import scans
from fapengine.models.adapted_head import adapt_head
from fapengine.models.scans import has_colours, paint_from_scan
from fapengine.mpeg4 import fap
from tests.command import ran as run

BLUE, RED = np.array([40, 60, 200]), np.array([200, 50, 40])
"""sRGB of the left and the right half of the scanned face."""
MAN = replace(PEOPLE["man"], charm=0.0)
"""Of measured anatomy, as scanned people are."""


def skin_of(head: FaceMesh) -> np.ndarray:
    """Triangles of the face's skin, without the back of the head and the neck."""
    skin = (head.material == Material.SKIN) | (head.material == Material.LIP)
    front = skin & (head.vertices_mm[:, 2] > 0) & (head.vertices_mm[:, 1] > -105)
    return head.triangles[front[head.triangles].all(axis=1)]


@pytest.fixture(scope="module")
def scanned(tmp_path_factory) -> tuple[Path, np.ndarray]:
    """Another person's face: cut out, shuffled, in metres, turned away, its triangles clockwise; and its points, mm."""
    folder = tmp_path_factory.mktemp("scan")
    man = build_head(MAN)
    triangles = skin_of(man)
    kept = np.unique(triangles)
    order = np.random.default_rng(3).permutation(len(kept))
    number = np.full(len(man.vertices_mm), -1)
    number[kept] = order
    place = np.empty((len(kept), 3))
    place[order] = man.vertices_mm[kept]
    colours = np.where(place[:, :1] > 0, BLUE, RED).astype(np.uint8)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 0.5])[:3, :3]
    vertices = place @ turn.T / 1000 + [1, 2, 3]
    mesh = trimesh.Trimesh(vertices, number[triangles][:, ::-1], vertex_colors=colours, process=False)
    mesh.export(folder / "scan.ply")
    points = {name: number[vertex] for name, vertex in man.feature_points.items() if number[vertex] >= 0}
    rows = [f"{name}," + ",".join(f"{x:.7f}" for x in vertices[vertex]) for name, vertex in points.items()]
    (folder / "face.csv").write_text("\n".join(["point,x,y,z", *rows]))
    (folder / "three.csv").write_text("\n".join(["point,x,y,z", *rows[:3]]))
    return folder, place


@pytest.fixture(scope="module")
def adapted(scanned) -> tuple[FaceMesh, dict, str]:
    folder, _ = scanned
    points, out = folder / "face.csv", folder / "head"
    told = run("head", "import", folder / "scan.ply", "--points", points, "--adapt", "-o", out, "--json").stdout
    return load_head(str(out)), json.loads(told), str(out)


def test_it_comes_nearer_to_the_scan_and_to_points_that_were_left_out(scanned, adapted):
    head, told, _ = adapted
    before, after = told["nearness"]["front_mm"]
    assert before > 1.0
    assert after < 0.05 * before
    assert told["nearness"]["left_out"] >= 30
    before, after = told["nearness"]["left_out_mm"]
    assert after < 0.5 * before
    # The figures are those of the head that was written, up to scale and place, which the file's axes hid.
    man, ours = build_head(MAN), build_head(MEASURED)
    names = [name for name in told["feature_points"] if name[:2] in ("4.", "5.", "8.", "9.")]
    theirs, own, was = (np.stack([one.point_mm(name) for name in names]) for one in (man, head, ours))
    off = [np.linalg.norm(fit_rigid(points, theirs).apply(points) - theirs, axis=1).mean() for points in (was, own)]
    assert off[1] < 0.5 * off[0]


def test_it_is_a_head_of_ours_with_all_faps(adapted):
    head, told, folder = adapted
    ours = build_head(MEASURED)
    assert len(head.vertices_mm) == len(ours.vertices_mm)
    assert head.feature_points.keys() == ours.feature_points.keys()
    steps = {name: abs(vertex - ours.feature_points[name]) for name, vertex in head.feature_points.items()}
    assert max(steps.values()) <= 1, steps  # the middle of another person's lids may lie at the next vertex
    assert tuple(told["faps"]["still"]) == still_faps(ours) == still_faps(head)
    assert head.fapu != ours.fapu
    for number in (4, 5, 31, 53):  # each moves its point by its own unit
        frame = np.zeros(68)
        frame[fap.column(number)] = 200.0
        row = fap.spec(number)
        moved = (deform(head, frame) - head.vertices_mm)[head.feature_points[row.point]]
        along = moved @ np.array(fap.HEAD_AXES[row.positive])  # corners of the lips also go back, round the teeth
        assert along == pytest.approx(200 * head.fapu.unit(row.unit), rel=0.02)
    assert load_head_info(folder).source == "fapengine's head on scan.ply"


def test_lids_shut_and_never_sink_into_the_ball(adapted):
    head, _, _ = adapted
    for upper, lower, upper_fap, lower_fap, eye in (("3.1", "3.3", 19, 21, 0), ("3.2", "3.4", 20, 22, 1)):
        frame = np.zeros(68)
        open_mm = head.point_mm(upper)[1] - head.point_mm(lower)[1]
        frame[[fap.column(upper_fap), fap.column(lower_fap)]] = 512.0  # half of the opening each
        shut = deform(head, frame)
        gap = shut[head.feature_points[upper], 1] - shut[head.feature_points[lower], 1]
        assert open_mm > 8.0
        assert abs(gap) < 0.1 * open_mm
        centre = head.eye_pivots_mm[eye]
        ball = np.linalg.norm(head.vertices_mm - centre, axis=1)
        radius = ball[(head.material == Material.EYE) & (ball < 20)].max()
        around = (head.material == Material.SKIN) & (ball < 25)
        assert ball[around].min() > radius
        assert np.linalg.norm(shut[around] - centre, axis=1).min() > radius


def test_the_scan_s_colours_are_carried(adapted):
    head, told, _ = adapted
    assert told["notes"][-1] == "colours: those of the scan's vertices"
    for name, colour in (("5.3", BLUE), ("5.4", RED)):  # left and right cheek
        vertex = head.feature_points[name]
        height, width = head.texture.shape[:2]
        column, row = (head.uv[vertex] * (width, height)).astype(int)
        linear = head.albedo[vertex] * (head.texture[row, column, :3] / 255.0) ** 2  # as the shaders develop it
        np.testing.assert_allclose(linear, (colour / 255.0) ** 2.2, atol=0.04)
    eyes = head.material == Material.EYE
    np.testing.assert_array_equal(head.albedo[eyes], build_head().albedo[eyes])


def test_a_picture_is_carried_across_its_seams(monkeypatch):
    monkeypatch.setattr(scans, "STRIDE", 6)
    ours = build_head(MEASURED)
    triangles, vertices = skin_of(ours), ours.vertices_mm.astype(float)
    left = (vertices[triangles].mean(axis=1)[:, 0] > 0).astype(int)
    picture = np.full((8, 16, 4), 255, np.uint8)
    picture[:, :8, :3], picture[:, 8:, :3] = RED, BLUE
    uv = np.full((2 * len(vertices), 2), 0.5)
    uv[:, 0] = np.repeat([0.25, 0.75], len(vertices))  # the halves have their own islands, and meet at a seam
    source = BlendshapeMesh(
        vertices=np.concatenate([vertices, vertices]), triangles=triangles + (left * len(vertices))[:, None],
        blendshapes={}, texture=picture, uv=uv,
    )  # fmt: skip
    drawn = set(np.unique(source.triangles).tolist())
    points = {
        name: next((v for v in (at, at + len(vertices)) if v in drawn), -1) for name, at in ours.feature_points.items()
    }
    placed = place_mesh(source, {name: at for name, at in points.items() if at >= 0}, ours)
    painted = paint_from_scan(ours, placed)
    for name, colour in (("5.3", BLUE), ("5.4", RED)):
        height, width = painted.texture.shape[:2]
        column, row = (painted.uv[ours.feature_points[name]] * (width, height)).astype(int)
        np.testing.assert_allclose(painted.texture[row, column] / 255.0, (colour / 255.0) ** 1.1, atol=0.06)
    plain = replace(placed, source=replace(source, texture=None, uv=None))
    assert not has_colours(plain)
    assert paint_from_scan(ours, plain) is ours


def test_what_cannot_be_adapted_is_refused(scanned, tmp_path):
    folder, _ = scanned
    for arguments, kind, said in (
        (("--points", folder / "three.csv"), DataError, r"feature points: got 3 .*expected at least 8.*scan\.ply"),
        ((), UsageError, "its feature points are needed"),
    ):
        with pytest.raises(kind, match=said):
            run("head", "import", folder / "scan.ply", *arguments, "--adapt", "-o", tmp_path / "head")
    (tmp_path / "profile.toml").touch()
    with pytest.raises(UsageError, match=r"has no dense face"):
        run("head", "import", tmp_path, "--adapt", "-o", tmp_path / "head")
    assert not (tmp_path / "head").exists()


@pytest.mark.shared
def test_it_comes_nearer_to_a_measured_face(shared):
    face, ours = np.load(shared / "data" / "dense_face.npz"), build_head()
    vertices, triangles = face["vertices"].astype(float), face["triangles"]
    with (shared / "data" / "markers.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["layout"] == "mpeg4" and int(row["vertex"]) < 9409]
    goals = {row["marker"]: vertices[int(row["vertex"])] for row in rows}
    common = [name for name in goals if name in ours.feature_points]
    turn = fit_rigid(np.stack([goals[name] for name in common]), np.stack([ours.point_mm(name) for name in common]))
    scan = Surface(turn.apply(vertices[:9409]), triangles[(triangles < 9409).all(axis=1)])
    _, near = adapt_head(scan, {name: turn.apply(place[None])[0] for name, place in goals.items()})
    assert near.front_mm[1] < 0.1 * near.front_mm[0]
    assert near.left_out_mm is not None
    assert near.left_out_mm[1] < near.left_out_mm[0]
