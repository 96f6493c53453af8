"""Recordings and scans from paths."""

import json

import numpy as np
import pytest
from PIL import Image

from fapengine.capture.landmarks import Picture
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.heads.meshes import load_neutral, load_rig
from fapengine.files.recordings import load_markers, load_mesh, load_painted, load_surface, save_markers

TRIANGLE = "v 0 0 90\nv 60 0 90\nv 0 {y} 90\nv 60 60 80\nf 1 2 3\nf 2 4 3\n"


@pytest.fixture
def track() -> MarkerTrack:
    positions = np.random.default_rng(0).normal(0, 60, (6, 4, 3)).round(3)
    positions[2, 1] = np.nan
    return MarkerTrack(positions_mm=positions, labels=("8.1", "8.2", "8.3", "8.4"), rate_hz=100.0)


@pytest.mark.parametrize("ending", [".c3d", ".trc", ".csv", ".tsv", ".npz", ".CSV"])
def test_every_ending_goes_there_and_back(track, tmp_path, ending):
    save_markers(tmp_path / f"take{ending.lower()}", track)
    path = (tmp_path / f"take{ending.lower()}").rename(tmp_path / f"again{ending}")
    found = load_markers(path)
    assert found.markers.equals(track, atol_mm=1e-4)
    assert not any("units" in text for text in found.warnings)


def test_wrong_endings_and_files(track, tmp_path):
    with pytest.raises(UsageError, match=r"'\.doc', expected one of \.c3d"):
        load_markers(tmp_path / "take.doc")
    with pytest.raises(UsageError, match=r"expected \.c3d"):
        save_markers(tmp_path / "take.doc", track)
    for name in ("none.c3d", "none.csv"):
        with pytest.raises(UsageError, match="cannot be read"):
            load_markers(tmp_path / name)
    (tmp_path / "empty.c3d").write_bytes(b"")
    (tmp_path / "bad.csv").write_text("A_x,A_y,A_z\n1,2,q\n")
    with pytest.raises(DataError, match="must have a header"):
        load_markers(tmp_path / "empty.c3d")
    with pytest.raises(DataError) as caught:
        load_markers(tmp_path / "bad.csv")
    assert caught.value.where == f"{tmp_path / 'bad.csv'}, line 2, column 3"


def test_landmarks_need_a_picture(tmp_path):
    shares = np.random.default_rng(2).uniform(0.3, 0.7, (3, 478, 3))
    shares[:, 33], shares[:, 263] = [0.4, 0.45, 0.0], [0.6, 0.45, 0.0]
    (tmp_path / "face.json").write_text(json.dumps(shares.tolist()))
    with pytest.raises(DataError, match=r"\[landmarks\] in session\.toml"):
        load_markers(tmp_path / "face.json")
    picture = Picture(width_px=640, height_px=480, eye_corners_mm=90, rate_hz=30)
    assert load_markers(tmp_path / "face.json", picture=picture).markers.frame_count == 3


@pytest.mark.parametrize("ending", ["obj", "ply", "glb"])
def test_a_folder_of_meshes_is_a_recording(tmp_path, ending):
    import trimesh

    for number in (10, 9, 11):
        vertices = [[0, 0, 90], [60, 0, 90], [0, number, 90], [60, 60, 80]]
        mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [1, 3, 2]], process=False)
        mesh.export(tmp_path / f"face_{number}.{ending}")
    found = load_markers(tmp_path, units="mm", rate_hz=25.0)
    assert found.markers.positions_mm[:, 2, 1].tolist() == [9, 10, 11]
    assert found.markers.labels == ("v0", "v1", "v2", "v3")
    assert "map some to feature points" in found.warnings[0]


def test_meshes_of_a_sequence_have_the_same_vertices(tmp_path):
    (tmp_path / "a1.obj").write_text(TRIANGLE.format(y=50))
    (tmp_path / "a2.obj").write_text(TRIANGLE.format(y=50).replace("v 60 60 80\n", "").replace("f 2 4 3\n", ""))
    with pytest.raises(DataError, match=r"got 3 vertices, expected 4 as in a1\.obj"):
        load_markers(tmp_path, rate_hz=25.0)
    (tmp_path / "sub").mkdir()
    with pytest.raises(DataError, match="no mesh"):
        load_markers(tmp_path / "sub")


def test_a_recording_that_is_not_there_has_no_wrong_ending(tmp_path):
    with pytest.raises(UsageError, match="S03: cannot be read"):
        load_markers(tmp_path / "S03")
    (tmp_path / "S03").write_text("")
    with pytest.raises(UsageError, match="got ending ''"):
        load_markers(tmp_path / "S03")


def test_scans(tmp_path, monkeypatch):
    (tmp_path / "scan.obj").write_text(TRIANGLE.format(y=50))
    surface = load_surface(tmp_path / "scan.obj", units="cm")
    assert surface.vertices_mm[2].tolist() == [0, 500, 900]
    assert len(surface.triangles) == 2
    with pytest.raises(UsageError, match="units: got 'ell'"):
        load_surface(tmp_path / "scan.obj", units="ell")
    with pytest.raises(UsageError, match="cannot be read"):
        load_surface(tmp_path / "none.obj")
    for name, text in (
        ("bad.ply", "ply\nnonsense"),
        ("points.obj", "v 1 2 3\n"),
        ("nan.obj", "v nan 0 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\n"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(DataError):
            load_surface(tmp_path / name)
    monkeypatch.setitem(__import__("sys").modules, "trimesh", None)
    with pytest.raises(ResourceError, match=r"fapengine\[lab\]"):
        load_surface(tmp_path / "scan.obj")


MATERIALS = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"
TWO_MATERIALS = """mtllib scan.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 2 0
usemtl red
f 2 3 4
usemtl blue
f 1 2 4
f 4 3 5
"""


def test_an_obj_of_several_materials_has_its_vertices_once(tmp_path):
    (tmp_path / "scan.obj").write_text(TWO_MATERIALS)
    vertices, triangles, _ = load_mesh(tmp_path / "scan.obj")
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 2, 0]]
    assert sorted(map(sorted, triangles.tolist())) == [[0, 1, 3], [1, 2, 3], [2, 3, 4]]
    (tmp_path / "scan.mtl").write_text(MATERIALS)
    surface, paint = load_painted(tmp_path / "scan.obj")
    assert surface.vertices_mm.shape == (5, 3)
    assert paint is not None
    assert paint.albedo[[0, 4]].tolist() == [[0, 0, 1], [0, 0, 1]]
    coloured = TWO_MATERIALS.replace("v 0 2 0\n", "v 0 2 0\nvt 0.1 0.5\nvt 0.9 0.5\n")
    for face, painted in (("2 3 4", "2/2 3/2 4/1"), ("1 2 4", "1/1 2/2 4/1"), ("4 3 5", "4/1 3/2 5/2")):
        coloured = coloured.replace(f"f {face}", f"f {painted}")
    (tmp_path / "scan.obj").write_text(coloured)
    (tmp_path / "scan.mtl").write_text(MATERIALS.replace("Kd 0 0 1", "map_Kd halves.png"))
    Image.fromarray(np.repeat(np.uint8([[[0, 255, 0], [0, 0, 255]]]), 2, axis=0)).save(tmp_path / "halves.png")
    surface, paint = load_painted(tmp_path / "scan.obj")
    assert surface.vertices_mm.shape == (5, 3)
    assert paint is not None
    assert paint.albedo[[0, 4]].tolist() == [[0, 1, 0], [0, 0, 1]]
    (tmp_path / "points.obj").write_text("v 1 2 3\nv 2 3 4\n")
    with pytest.raises(DataError, match="contains no triangles"):
        load_surface(tmp_path / "points.obj")


SQUARE = """mtllib scan.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0.1 0.5
vt 0.9 0.5
f 1/1 2/2 3/2 4/1
"""


def test_an_obj_that_uses_no_material_has_the_image_of_its_library(tmp_path):
    """As FLAME's and VOCA's templates; without the image, one colour is no paint."""
    (tmp_path / "scan.obj").write_text(SQUARE)
    assert load_painted(tmp_path / "scan.obj")[1] is None
    for name in (".", "..", "\0", 300 * "x", "\\1"):
        (tmp_path / "odd.obj").write_text(SQUARE.replace("scan.mtl", name))
        assert load_neutral(tmp_path / "odd.obj").texture is None
    (tmp_path / "scan.mtl").write_text("newmtl skin\nmap_Kd halves.png\n")
    Image.fromarray(np.repeat(np.uint8([[[0, 255, 0], [0, 0, 255]]]), 2, axis=0)).save(tmp_path / "halves.png")
    paint = load_neutral(tmp_path / "scan.obj")
    assert paint.texture[0, :, :3].tolist() == [[0, 255, 0], [0, 0, 255]]
    assert paint.uv[:, 0].tolist() == [0.1, 0.9, 0.9, 0.1]


def test_along_a_seam_of_the_image_vertices_have_copies(tmp_path):
    (tmp_path / "neutral.obj").write_text(SQUARE.replace("f 1/1 2/2 3/2 4/1", "f 1/1 2/1 3/1\nf 1/2 3/2 4/2"))
    (tmp_path / "jawOpen.obj").write_text(SQUARE.replace("v 1 1 0", "v 1 3 0"))
    (tmp_path / "scan.mtl").write_text("newmtl skin\nmap_Kd halves.png\n")
    Image.fromarray(np.repeat(np.uint8([[[0, 255, 0], [0, 0, 255]]]), 2, axis=0)).save(tmp_path / "halves.png")
    rig = load_rig(tmp_path)
    assert rig.vertices[:, :2].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [1, 1]]
    assert rig.uv[rig.triangles][..., 0].tolist() == [[0.1] * 3, [0.9] * 3]
    assert rig.dense("jawOpen")[:, 1].tolist() == [0, 0, 2, 0, 0, 2]


def test_a_folder_of_obj_shapes_has_the_image_of_its_neutral_face(tmp_path):
    (tmp_path / "neutral.obj").write_text(SQUARE)
    (tmp_path / "jawOpen.obj").write_text(SQUARE.replace("v 0 1 0", "v 0 2 0"))
    assert load_rig(tmp_path).texture is None
    (tmp_path / "scan.mtl").write_text("newmtl skin\nmap_Kd halves.png\n")
    Image.fromarray(np.repeat(np.uint8([[[0, 255, 0], [0, 0, 255]]]), 2, axis=0)).save(tmp_path / "halves.png")
    rig = load_rig(tmp_path)
    assert rig.texture.shape == (2, 2, 4)
    assert rig.uv[:, 0].tolist() == [0.1, 0.9, 0.9, 0.1]


def test_an_index_beyond_all_vertices_is_refused_before_it_costs_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("trimesh.load", lambda *_, **__: pytest.fail("trimesh allocates 8 GB"))
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1111111111/1/1 2/1/1 3/1/1\n")
    with pytest.raises(DataError, match="mesh: got index 1111111111 in 53 bytes"):
        load_surface(tmp_path / "a.obj")
