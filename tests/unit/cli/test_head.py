"""``fapengine head``, and --head everywhere."""

import hashlib
import io
import json
import re
import struct
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from fapengine.app import head_check
from fapengine.app.head_check import poses
from fapengine.errors import DataError, ProfileError, ResourceError, UnsupportedError, UsageError
from fapengine.files.heads import meshes
from fapengine.files.heads.import_file import import_head_file
from fapengine.files.heads.load import load_head, load_head_info, load_levels
from fapengine.files.heads.meshes import load_neutral, load_rig
from fapengine.files.motion import save_fap
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.face_mesh import Material
from fapengine.mesh.rig.blendshape_mesh import Blendshape
from fapengine.mpeg4.track import FapTrack
from tests.command import ran as run
from tests.unit.files.glb import Builder, square, write_rig
from tests.unit.mesh.rigs import own_rig

LEVEL = "coarse"
"""Of heads that are brought: few vertices, all feature points."""


@pytest.fixture(scope="module")
def brought(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("mine")
    head = build_head(MEASURED)
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


@pytest.fixture(scope="module")
def avatar(tmp_path_factory) -> Path:
    """A GLB whose shapes are ARKit's, in metres, its colours in a texture."""
    rig = own_rig(level=LEVEL)
    uv = np.clip(np.stack([rig.vertices[:, 0] / 400 + 0.5, 0.5 - rig.vertices[:, 1] / 800], axis=1), 0.01, 0.99)
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:] = np.linspace(60, 250, 64, dtype=np.uint8)[None, :, None]
    scaled = {name: Blendshape(one.vertices, one.moves / 1000) for name, one in rig.blendshapes.items()}
    builder = write_rig(replace(rig, vertices=rig.vertices / 1000, blendshapes=scaled, uv=uv, albedo=None), material=0)
    builder.row("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": builder.image(picture)}}})
    path = tmp_path_factory.mktemp("avatar") / "avatar.glb"
    path.write_bytes(builder.glb())
    return path


@pytest.fixture(scope="module")
def adopted(avatar) -> tuple[Path, dict]:
    head = avatar.parent / "head"
    return head, json.loads(run("head", "import", avatar, "-o", head, "--licence", "CC0", "--json").stdout)


def test_an_avatar_needs_nothing_but_its_shapes(adopted):
    head, found = adopted
    assert found["mm_per_unit"] == pytest.approx(1000, rel=0.05)
    assert len(found["shapes"]["used"]) == 44
    assert found["shapes"]["lacking"] == []
    assert [name for name in found["shapes"]["unused"] if not name.startswith("eyeLook")] == []
    assert set(range(3, 27)) <= set(found["faps"]["moving"])
    assert set(found["faps"]["still"]) >= {29, 30}
    assert found["texture"][0] >= 64
    mesh = load_head(str(head))
    assert mesh.texture is not None
    assert mesh.basis.mix is not None
    assert len(mesh.feature_points) == len(found["feature_points"]) >= 55
    left, right = (mesh.uv[mesh.feature_points[name]] for name in ("8.3", "8.4"))
    height, width = mesh.texture.shape[:2]
    shades = [int(mesh.texture[int(v * height), int(u * width), 0]) for u, v in (left, right)]
    assert shades[0] > shades[1] + 10  # brighter towards the subject's left
    info = load_head_info(str(head))
    assert (info.source, info.licence, len(info.used), info.lacking) == ("avatar.glb", "CC0", 44, ())
    assert load_head_info("default").source == "fapengine"


def test_an_import_ends_with_a_test_of_the_head_and_a_sheet(adopted, avatar, tmp_path):
    head, found = adopted
    assert 8.0 < found["self_test"]["lips_ɑ_mm"] < 20.0
    assert found["remarks"] == []
    assert found["contact_sheet"] == f"{head}.png"
    with Image.open(f"{head}.png") as sheet:
        assert min(sheet.size) > 600


def test_without_opengl_an_import_has_no_sheet(avatar, tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise ResourceError("OpenGL: no context (libEGL.so not loaded)")

    monkeypatch.setattr(head_check, "open_renderer", refuse)
    result = run("head", "import", avatar, "-o", tmp_path / "again")
    last = result.stdout.splitlines()[-1]
    assert "contact sheet: not drawn; OpenGL: no context" in result.stderr
    assert load_head_info(str(tmp_path / "again")).source == "avatar.glb"
    assert not (tmp_path / "again.png").exists()
    assert re.fullmatch(r"lips open \d+ mm on ɑ \(expected 8 to 20\), close on m, lids close", last)


def test_shapes_that_are_missing_are_made_on_request(avatar, tmp_path):
    data = avatar.read_bytes()
    for name in (b"mouthSmileLeft", b"mouthSmileRight"):
        data = data.replace(b'"' + name + b'"', b'"' + name[::-1] + b'"')
    (tmp_path / "b.glb").write_bytes(data)
    head = tmp_path / "head"
    found = json.loads(run("head", "import", tmp_path / "b.glb", "--complete", "-o", head, "--json").stdout)
    assert {"mouthSmileLeft", "mouthSmileRight"} <= set(found["shapes"]["used"])
    assert found["shapes"]["lacking"] == []
    assert [note for note in found["notes"] if note.startswith("completed: 2 of ARKit's 52 shapes are made from")]
    assert "completed: nothing, as no shape of the skin is missing" in import_head_file(avatar, complete=True)[0].notes
    with pytest.raises(UsageError, match="--complete: cannot be used with --adapt"):
        run("head", "import", avatar, "--complete", "--adapt", "-o", head)


def test_its_sheet_says_what_is_missing(adopted, tmp_path):
    head, found = adopted
    said = json.loads(run("head", "check", head, "-o", tmp_path / "a.png", "--json").stdout)
    assert said["pictures"] == 109
    assert set(said["still_faps"]) == set(found["faps"]["still"])
    assert said["lacking_shapes"] == []
    assert (tmp_path / "a.png").stat().st_size > 50_000


def test_a_file_s_own_names_are_mapped(avatar, tmp_path):
    data = avatar.read_bytes()
    for name in (b"jawOpen", b"eyeBlinkLeft", b"eyeBlinkRight"):
        data = data.replace(b'"' + name + b'"', b'"' + name[::-1].replace(b"n", b"_") + b'"')
    (tmp_path / "b.glb").write_bytes(data)
    with pytest.raises(DataError, match=r"missing for left lid, right lid, jaw.*b\.glb"):
        run("head", "import", tmp_path / "b.glb", "-o", tmp_path / "h")
    (tmp_path / "map.toml").write_text(
        '[shapes]\n"_epOwaj" = "jawOpen"\n"tfeLk_ilBeye" = "eyeBlinkLeft"\n"thgiRk_ilBeye" = "blinkRight"\n'
        'cheekPuff = {"65" = 300, pull_l_ear = -200}\nmouthLeft = "unused"\n'
    )
    text = run("head", "import", tmp_path / "b.glb", "--shape-map", tmp_path / "map.toml", "-o", tmp_path / "h").stdout
    assert "44 shapes" not in text
    assert "43 shapes" in text
    still = next(line for line in text.splitlines() if line.startswith("FAPs without motion"))
    assert "raise_l_ear" not in still
    assert "pull_l_ear" not in still
    assert "pull_r_ear" in still


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("[shapes]\nnose = {}", r"contains no FAP .at .*map.toml, shapes.nose"),
        ("[shapes]\nnose = {2 = 5}", "got '2', expected a FAP by number, 3 to 68"),
        ("[shapes]\nnose = {lift = 5}", "got 'lift', expected a FAP"),
        ("[shapes]\nnose = {63 = 0}", "got 0.0, expected FAPU"),
        ("[shapes]\nnose = 5", "got 5, expected a string or a table"),
        ("[shapes]\nnose = {63 = 5}", "got blendshape 'nose', which the mesh does not have"),
        ("[shape]", "'shapes' is missing"),
    ],
)
def test_mappings_that_cannot_be(avatar, tmp_path, table, message):
    (tmp_path / "map.toml").write_text(table)
    with pytest.raises(DataError, match=message):
        run("head", "import", avatar, "--shape-map", tmp_path / "map.toml", "-o", tmp_path / "h")


def test_points_correct_what_the_shapes_showed(avatar, adopted, tmp_path):
    rig = own_rig(level=LEVEL)
    place = rig.vertices[rig.triangles[:, 0]]
    far = place[np.argmax(place[:, 2])] / 1000
    (tmp_path / "p.csv").write_text("point,x,y,z\n9.3," + ",".join(map(str, far)))
    found = json.loads(
        run("head", "import", avatar, "--points", tmp_path / "p.csv", "-o", tmp_path / "h", "--json").stdout
    )
    mesh = load_head(str(tmp_path / "h"))
    assert mesh.point_mm("9.3")[2] == pytest.approx(mesh.vertices_mm[:, 2].max(), abs=1e-3)
    assert len(found["feature_points"]) >= 55


def obj(vertices: np.ndarray, faces: str = "") -> str:
    return "".join("v {:.5f} {:.5f} {:.5f}\n".format(*row) for row in vertices) + faces


@pytest.fixture(scope="module")
def ict_folder(tmp_path_factory) -> Path:
    """Laid out as ICT-FaceKit is: a neutral OBJ with materials, one more for each shape."""
    folder = tmp_path_factory.mktemp("FaceXModel")
    rig = own_rig(level=LEVEL)
    centimetres = rig.vertices / 10
    faces, last = [], -1
    for triangle, number in zip(rig.triangles, rig.surface[rig.triangles[:, 0]], strict=True):
        faces += [f"usemtl M_{rig.surfaces[number]}"] if number != last else []
        faces.append("f " + " ".join(f"{corner + 1}/1/1" for corner in triangle))
        last = number
    (folder / "generic_neutral_mesh.obj").write_text(obj(centimetres, "vt 0 0\n" + "\n".join(faces)))
    for name in rig.blendshapes:
        if name.startswith(("jawOpen", "eyeBlink", "cheekSquint")):
            spelled = name.replace("cheekSquint", "cheekRaiser").replace("Left", "_L").replace("Right", "_R")
            (folder / f"{spelled}.obj").write_text(obj(centimetres + rig.dense(name) / 10))
    (folder / "identity000.obj").write_text("v what\n")
    return folder


def test_ict_facekit_s_folder(ict_folder, tmp_path):
    found = json.loads(run("head", "import", ict_folder, "-o", tmp_path / "h", "--json").stdout)
    assert found["mm_per_unit"] == pytest.approx(10, rel=0.05)
    assert set(found["shapes"]["used"]) == {
        "jawOpen", "eyeBlink_L", "eyeBlink_R", "cheekRaiser_L", "cheekRaiser_R",
    }  # fmt: skip
    assert "mouthPucker" in found["shapes"]["lacking"]
    mesh = load_head(str(tmp_path / "h"))
    assert (mesh.material == Material.EYE).sum() > 100
    assert (mesh.material == Material.TEETH).sum() > 100
    assert (
        "missing ARKit shapes: eyeLookDownLeft" in run("head", "check", tmp_path / "h", "-o", tmp_path / "c.png").stdout
    )


@pytest.mark.parametrize(("neutral", "shape"), [("Neutral.obj", "jawOpen.obj"), ("neutral.OBJ", "jawOpen.OBJ")])
def test_a_folder_of_obj_files_in_any_case(tmp_path, neutral, shape):
    (tmp_path / neutral).write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / shape).write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\n")
    found = load_rig(tmp_path)
    assert list(found.blendshapes) == ["jawOpen"]
    assert found.blendshapes["jawOpen"].moves.tolist() == [[0, 1, 0]]


@pytest.mark.parametrize(
    ("neutral", "shape", "message"),
    [
        (None, "v 0 0 0", "contains no generic_neutral_mesh.obj"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "v 0 0 0\n", "got 1 vertices, expected 3 as in generic"),
        ("v 0 0\n", "", "not three numbers"),
        ("v 0 0 inf\nf 1 1 1\n", "", "expected finite ones, 1 or more"),
        ("v 0 0 0\nf 1 1 2\n", "", "got b'1 1 2', expected 3 or more indices of 1 to 1.*line 2"),
        ("v 0 0 0\nf 1 1 one\n", "", "expected 3 or more indices"),
        ("v 0 0 0\n", "", "contains no face"),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n",
            "shapes: no names of .* among jawOpen",
        ),
    ],
)
def test_folders_that_hold_no_face(tmp_path, neutral, shape, message):
    if neutral is not None:
        (tmp_path / "generic_neutral_mesh.obj").write_text(neutral)
    (tmp_path / "jawOpen.obj").write_text(shape)
    with pytest.raises((DataError, UsageError), match=message):
        run("head", "import", tmp_path, "-o", tmp_path / "h")


def test_meshes_without_shapes_need_points(brought, tmp_path):
    with pytest.raises(UsageError, match="has no blendshapes, so its feature points are needed"):
        run("head", "import", brought / "face.ply", "-o", tmp_path / "h")
    with pytest.raises(UsageError, match=r"got ending '\.doc'"):
        load_rig(Path("face.doc"))
    trimesh.load(brought / "face.ply", process=False).export(tmp_path / "face.glb")
    with pytest.raises(DataError, match=r"shapes: no names of .* among none"):
        run("head", "import", tmp_path / "face.glb", "-o", tmp_path / "h")
    run("head", "import", tmp_path / "face.glb", "--points", brought / "places.csv", "-o", tmp_path / "h")


def test_a_painted_mesh_keeps_its_picture(tmp_path, monkeypatch):
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:8, 8:] = (250, 10, 20)
    Image.fromarray(pixels).save(tmp_path / "skin.png")
    (tmp_path / "face.mtl").write_text("newmtl Skin\nmap_Kd skin.png\n")
    (tmp_path / "face.obj").write_text(
        "mtllib face.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.1 0.1\nvt 0.9 0.9\nvt 0.1 0.9\nusemtl Skin\nf 1/1 2/2 3/3\n"
    )
    mesh = load_neutral(tmp_path / "face.obj")
    assert mesh.albedo is None
    assert mesh.texture.shape == (16, 16, 4)
    seen = [mesh.texture[int(v * 16), int(u * 16), :3].tolist() for u, v in mesh.uv]
    assert [row == [250, 10, 20] for row in seen] == [place[0] == 1 for place in mesh.vertices.tolist()]
    monkeypatch.setattr(meshes, "MAX_PIXELS", 255)
    with pytest.raises(UnsupportedError, match=r"texture: got 16x16 pixels, expected at most 255 .at .*face\.obj"):
        load_neutral(tmp_path / "face.obj")
    (tmp_path / "skin.png").unlink()
    bare = load_neutral(tmp_path / "face.obj")
    assert (bare.texture, bare.albedo, len(bare.vertices)) == (None, None, 3)


def test_files_beside_a_document_stay_in_its_folder(avatar, tmp_path):
    builder = plain_square()
    (tmp_path / "round").symlink_to(tmp_path / "round")
    for name in ("\0.bin", "%00.bin", "\ud800.bin", "round/b.bin"):
        (tmp_path / "a.gltf").write_bytes(builder.gltf(name))
        with pytest.raises(DataError, match=r"a\.gltf"):
            load_rig(tmp_path / "a.gltf")
    (tmp_path / "a.gltf").write_bytes(builder.gltf("../b.bin"))
    with pytest.raises(DataError, match=r"expected a file in the folder of a\.gltf"):
        load_rig(tmp_path / "a.gltf")
    (tmp_path / "a.gltf").write_bytes(builder.gltf("b.bin"))
    with pytest.raises(DataError, match="cannot be read"):
        load_rig(tmp_path / "a.gltf")
    (tmp_path / "b.bin").write_bytes(builder.blob)
    assert len(load_rig(tmp_path / "a.gltf").vertices) == 4


def plain_square() -> Builder:
    builder = Builder()
    builder.node(mesh=square(builder))
    return builder


def test_a_head_goes_there_and_back(imported):
    mesh = load_head(str(imported))
    assert mesh.fapu.mw0_mm == pytest.approx(build_head(MEASURED).fapu.mw0_mm, rel=1e-3)
    assert np.ptp(mesh.albedo) > 0.5
    assert 'licence = "not stated"' in (imported / "head.toml").read_text()


def test_a_head_of_ours_has_a_coarser_level(imported):
    finest, (load_coarsest,) = load_levels("default")
    coarsest = load_coarsest()
    assert len(coarsest.vertices_mm) < 0.6 * len(finest.vertices_mm)
    assert finest.feature_points.keys() == coarsest.feature_points.keys()
    assert load_levels("default:level=coarse")[1] == []
    assert load_levels(str(imported))[1] == []


def test_points_may_be_places(brought, imported, tmp_path):
    options = ("--points", brought / "places.csv", "-o", tmp_path / "h", "--json")
    found = json.loads(run("head", "import", brought / "face.ply", *options).stdout)
    assert [note for note in found["notes"] if "complete=True makes shapes from the built-in head" in note]
    one, other = load_head(str(imported)), load_head(str(tmp_path / "h"))
    for name in one.feature_points:
        np.testing.assert_allclose(one.point_mm(name), other.point_mm(name), atol=0.01)


def test_a_profile_learned_on_one_face_drives_another(imported, tmp_path):
    run("say", "Mama.", "--head", imported, "--size", "128x128", "-o", tmp_path / "a.mp4")
    assert (tmp_path / "a.mp4").stat().st_size > 3000
    save_fap(tmp_path / "a.fap", FapTrack.from_values(np.zeros((2, 68), int), rate_hz=25.0))
    for head in ("default", imported):
        run(
            "render", tmp_path / "a.fap", "--head", head, "--size", "128x128", "-o", tmp_path / f"{Path(head).name}.png"
        )
    assert (tmp_path / "default.png").read_bytes() != (tmp_path / "head.png").read_bytes()


def test_the_sheet_shows_every_fap(imported, tmp_path):
    text = run("head", "check", imported, "-o", tmp_path / "sheet.png").stdout
    assert "109 images" in text  # rest, 66 FAPs, 36 phones, 6 expressions
    assert "FAPs without motion: 29" in text
    with pytest.raises(UsageError, match=r"ends with \.png"):
        run("head", "check", imported, "-o", tmp_path / "sheet.gif")


def test_the_sheet_has_every_fap_viseme_and_mood():
    rows, labels = poses()
    assert rows.shape == (len(labels), 68) == (109, 68)
    assert [label for label, _ in labels[1:67]] == [str(number) for number in range(3, 69)]
    assert {f"viseme {number}" for number in range(1, 15)} <= {note for _, note in labels}
    assert [label for label, note in labels if note == "expression"] == [
        "joy", "sadness", "anger", "fear", "disgust", "surprise",
    ]  # fmt: skip


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
    with pytest.raises(DataError, match="is not a table"):
        run("head", "import", brought / "face.ply", "--points", tmp_path / "p.bin", "-o", tmp_path / "h")
    with pytest.raises(UsageError, match="expected one of"):
        load_neutral(tmp_path / "face.doc")
    (tmp_path / "dots.obj").write_text("v 0 0 0\nv 1 1 1\n")
    with pytest.raises(DataError):
        load_neutral(tmp_path / "dots.obj")


def test_heads_that_are_none(imported, tmp_path):
    with pytest.raises(UsageError, match=r"expected default, woman"):
        load_head(str(tmp_path))
    toml, arrays = (imported / "head.toml").read_text(), (imported / "head.npz").read_bytes()

    def write(text: str, data: bytes = arrays) -> str:
        (tmp_path / "head.toml").write_text(text)
        (tmp_path / "head.npz").write_bytes(data)
        return str(tmp_path)

    for text, data, message in (
        (
            toml.replace("schema = 2", "schema = 1"),
            arrays,
            "got 1, expected 2; a file of another version must be made again",
        ),
        (toml.replace("[sha256]", "more = 1\n[sha256]"), arrays, "'more' is unknown"),
        (toml, arrays[:-9], "sha256.*head.npz"),
        (toml.replace('"head.npz"', '"other.npz"'), arrays, "got other.npz, expected head.npz"),
    ):
        with pytest.raises(ProfileError, match=message):
            load_head(write(text, data))
    cut = arrays[:2000]
    digests = toml.replace(hashlib.sha256(arrays).hexdigest(), hashlib.sha256(cut).hexdigest())
    with pytest.raises(ProfileError, match="arrays"):
        load_head(write(digests, cut))
    picture = io.BytesIO()
    Image.new("RGB", (2, 2)).save(picture, "BMP")
    huge = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in ((b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)), (b"IDAT", b""))
    )
    for data in (b"no picture", huge, picture.getvalue()):
        (tmp_path / "head.png").write_bytes(data)
        painted = toml + f'"head.png" = "{hashlib.sha256(data).hexdigest()}"\n'
        with pytest.raises(ProfileError, match=r"image: (cannot be read|got no PNG) .*at .*head\.png"):
            load_head(write(painted))


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("channels", np.float64(3.0)),
        ("channels", np.array([[np.inf, 0.0, 1.0]])),
        ("fapu_mm", np.ones(6)),
        ("point_names", np.array("8.1")),
        ("vertices_mm", np.float32(1.0)),
        ("normals", None),
    ],
)
def test_arrays_that_are_no_head_s(imported, tmp_path, name, array):
    with np.load(imported / "head.npz") as archive:
        arrays = dict(archive) | {name: array}
    if array is None:
        del arrays[name]
    np.savez(tmp_path / "head.npz", **arrays)
    sign(imported, tmp_path)
    with pytest.raises(ProfileError, match=r"arrays: .*at .*head\.npz"):
        load_head(str(tmp_path))


def sign(imported: Path, folder: Path) -> None:
    """Write the TOML of a head for other arrays."""
    old, new = (hashlib.sha256((place / "head.npz").read_bytes()).hexdigest() for place in (imported, folder))
    (folder / "head.toml").write_text((imported / "head.toml").read_text().replace(old, new))


def test_arrays_that_ask_for_more_than_there_is(imported, tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (1 << 55,)})
    with zipfile.ZipFile(tmp_path / "head.npz", "w") as archive:
        archive.writestr("vertices_mm.npy", header.getvalue())
    sign(imported, tmp_path)
    with pytest.raises(ProfileError, match="arrays: Unable to allocate"):
        load_head(str(tmp_path))
    data = bytearray((tmp_path / "head.npz").read_bytes())
    entry = data.index(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = struct.pack("<I", (1 << 30) + 1)  # unpacked size in the directory
    (tmp_path / "head.npz").write_bytes(data)
    sign(imported, tmp_path)
    with pytest.raises(ProfileError, match="arrays: got 1073741825 bytes unpacked, expected at most 1073741824"):
        load_head(str(tmp_path))


def test_the_default_head_may_look_otherwise() -> None:
    bald = load_head("default:hair=false,level=coarse")
    assert len(bald.vertices_mm) < 7000
    assert load_head_info("default:hair=false").source == "fapengine"
    with pytest.raises(UsageError, match="head: got 'hat=1'"):
        load_head("default:hat=1")
