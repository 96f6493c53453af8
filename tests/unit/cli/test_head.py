"""``fapengine head``, and --head everywhere."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import DataError, ProfileError, UsageError
from fapengine.files.fap import save_fap
from fapengine.files.heads import load_face_file, load_head
from fapengine.mesh.head import build_head
from fapengine.mpeg4.track import FapTrack


def run(*arguments: object):
    result = CliRunner().invoke(app, [*map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def brought(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("mine")
    head = build_head()
    rgb = (np.clip(head.albedo, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    mesh = trimesh.Trimesh(head.vertices_mm / 1000, head.triangles, vertex_colors=rgb, process=False)
    mesh.export(folder / "face.ply")
    on_surface = set(np.unique(head.triangles).tolist())
    points = {name: index for name, index in head.feature_points.items() if index in on_surface}
    rows = [f"{name},{index}" for name, index in points.items()]
    (folder / "points.csv").write_text("\n".join(["point,vertex", *rows]))
    places = [f"{name}," + ",".join(map(str, head.vertices_mm[index] / 1000)) for name, index in points.items()]
    (folder / "places.csv").write_text("\n".join(["point, x, y, z", *places]))
    return folder


@pytest.fixture(scope="module")
def imported(brought) -> Path:
    text = run(
        "head", "import", brought / "face.ply", "--points", brought / "points.csv", "-o", brought / "head"
    ).stdout
    assert "of 66 FAPs move it; one unit of the file is 1000 mm" in text
    return brought / "head"


def test_a_head_goes_there_and_back(imported):
    mesh = load_head(str(imported))
    assert mesh.fapu.mw0_mm == pytest.approx(build_head().fapu.mw0_mm, rel=1e-3)
    assert np.ptp(mesh.albedo) > 0.5
    assert 'licence = "not stated"' in (imported / "head.toml").read_text()


def test_points_may_be_places(brought, imported, tmp_path):
    run("head", "import", brought / "face.ply", "--points", brought / "places.csv", "-o", tmp_path / "h")
    one, other = load_head(str(imported)), load_head(str(tmp_path / "h"))
    for name in one.feature_points:
        np.testing.assert_allclose(one.point_mm(name), other.point_mm(name), atol=0.01)


def test_a_profile_learned_on_one_face_drives_another(imported, tmp_path):
    run("say", "Mama.", "--head", imported, "--size", "128x128", "-o", tmp_path / "a.mp4")
    assert (tmp_path / "a.mp4").stat().st_size > 3000
    save_fap(tmp_path / "a.fap", FapTrack.of(np.zeros((2, 68), int), rate_hz=25.0))
    for head in ("default", imported):
        run(
            "render", tmp_path / "a.fap", "--head", head, "--size", "128x128", "-o", tmp_path / f"{Path(head).name}.png"
        )
    assert (tmp_path / "default.png").read_bytes() != (tmp_path / "head.png").read_bytes()


def test_the_sheet_shows_every_fap(imported, tmp_path):
    text = run("head", "check", imported, "-o", tmp_path / "sheet.png").stdout
    assert "109 pictures" in text  # rest, 66 FAPs, 36 phones, 6 expressions
    assert "FAPs without motion: 29" in text
    with pytest.raises(UsageError, match=r"ends with \.png"):
        run("head", "check", imported, "-o", tmp_path / "sheet.gif")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("point,vertex\n8.1,0\n8.1,1\n", "expected a feature point such as 8.2, once .at .*line 3"),
        ("point,vertex\nlip,0\n", "got 'lip'"),
        ("point,vertex\n8.1,many\n", "expected a vertex, or x, y and z"),
        ("point,x,y\n8.1,1,2\n", "expected a vertex"),
        ("point,x,y,z\n8.1,90,90,90\n", "away from the mesh"),
        ("point,x,y,z\n8.1,nan,0,0\n", "away from the mesh"),
        ("point,vertex\n8.1,5\n", "expected at least 8"),
        ("", "expected at least 8"),
    ],
)
def test_tables_of_points_that_cannot_be(brought, tmp_path, table, message):
    (tmp_path / "p.csv").write_text(table)
    with pytest.raises(DataError, match=message):
        run("head", "import", brought / "face.ply", "--points", tmp_path / "p.csv", "-o", tmp_path / "h")


def test_files_that_are_no_face(brought, tmp_path):
    (tmp_path / "p.bin").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(DataError, match="is no table"):
        run("head", "import", brought / "face.ply", "--points", tmp_path / "p.bin", "-o", tmp_path / "h")
    with pytest.raises(UsageError, match="expected one of"):
        load_face_file(tmp_path / "face.doc")
    (tmp_path / "dots.obj").write_text("v 0 0 0\nv 1 1 1\n")
    with pytest.raises(DataError):
        load_face_file(tmp_path / "dots.obj")


def test_heads_that_are_none(imported, tmp_path):
    with pytest.raises(UsageError, match=r"expected 'default' or a folder"):
        load_head(str(tmp_path))
    toml, arrays = (imported / "head.toml").read_text(), (imported / "head.npz").read_bytes()

    def write(text: str, data: bytes = arrays) -> str:
        (tmp_path / "head.toml").write_text(text)
        (tmp_path / "head.npz").write_bytes(data)
        return str(tmp_path)

    for text, data, message in (
        (toml.replace("schema = 1", "schema = 7"), arrays, "got 7, expected 1"),
        (toml + "more = 1\n", arrays, "'more' is unknown"),
        (toml, arrays[:-9], "sha256"),
    ):
        with pytest.raises(ProfileError, match=message):
            load_head(write(text, data))
    import hashlib

    cut = arrays[:2000]
    digest = hashlib.sha256(cut).hexdigest()
    with pytest.raises(ProfileError, match="arrays"):
        load_head(
            write("\n".join(line if "sha" not in line else f'sha256 = "{digest}"' for line in toml.splitlines()), cut)
        )
