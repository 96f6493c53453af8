"""What avatars of services bring: Draco, paintings of the whole body, bones without shapes. All made here."""

import sys
from dataclasses import replace
from pathlib import Path

import DracoPy
import numpy as np
import pytest

from fapengine.app.scene_files import exported_head
from fapengine.errors import DataError, ResourceError
from fapengine.files.gltf.compression import decode_draco
from fapengine.files.gltf.document import parse_gltf
from fapengine.files.gltf.scene import read_scene
from fapengine.files.heads.folder import save_head
from fapengine.files.heads.import_file import crop_painting, import_head_file
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import deform, single_fap
from fapengine.mesh.face_mesh import Bone, FaceMesh
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh
from fapengine.mpeg4 import fap
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.ict_notice import ICT_COPYRIGHT
from fapengine.retarget.rig_weights import choose_blendshapes
from tests.unit.mesh.rigs import own_rig

from .glb import Builder, square, write_rig

DRACO = "KHR_draco_mesh_compression"
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "f4")
SQUARE = np.array([[0, 1, 2], [0, 2, 3]], "u4")


def packed() -> bytes:
    return DracoPy.encode(CORNERS, SQUARE, quantization_bits=16, preserve_order=True)


def with_draco(data: bytes, *, unique: int = 0, count: int = 4) -> Builder:
    """A square whose corners and triangles are in ``data`` alone; its shape is not packed, as Draco cannot."""
    builder = Builder()
    number = square(builder)
    builder.node(mesh=number)
    primitive = builder.doc["meshes"][number]["primitives"][0]
    for index in (primitive["attributes"]["POSITION"], primitive["indices"]):
        del builder.doc["accessors"][index]["bufferView"]
    builder.doc["accessors"][primitive["attributes"]["POSITION"]]["count"] = count
    primitive["extensions"] = {DRACO: {"bufferView": builder.view(data), "attributes": {"POSITION": unique}}}
    builder.doc["extensionsRequired"] = [DRACO]
    return builder


def read(builder: Builder) -> BlendshapeMesh:
    return read_scene(parse_gltf(builder.glb(), lambda name: b""))


def test_a_mesh_packed_by_draco_is_the_mesh() -> None:
    mesh = read(with_draco(packed()))
    np.testing.assert_allclose(mesh.vertices, CORNERS, atol=1e-4)
    np.testing.assert_array_equal(mesh.triangles, SQUARE)
    np.testing.assert_array_equal(mesh.blendshapes["rise"].vertices, [0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: with_draco(b"not it"), "do not begin with DRACO"),
        (lambda: with_draco(packed()[:20]), "cannot be decoded"),
        (lambda: with_draco(packed(), unique=7), "no attribute 7, expected it as POSITION"),
        (lambda: with_draco(packed(), count=5), r"got shape \(4, 3\), expected \(5, 3\)"),
    ],
)
def test_what_is_wrong_with_draco_is_said(make, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(make())


def test_every_cut_of_draco_is_a_data_error() -> None:
    whole = packed()
    for length in range(len(whole)):
        with pytest.raises(DataError):
            decode_draco(whole[:length], {"POSITION": 0}, "")


def test_draco_without_its_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    monkeypatch.delitem(vars(sys.modules["fapengine.files.gltf.compression"].DracoPy), "decode", raising=False)
    with pytest.raises(ResourceError, match=r"Draco.*pip install \"fapengine\[draco\]\""):
        read(with_draco(packed()))


def painted_head() -> FaceMesh:
    """Our head, squeezed into a corner of a painting four times as large: the rest is of a body that is not there."""
    head = build_head(level="coarse")
    assert head.texture is not None
    side = 256
    texture = np.full((4 * side, 4 * side, 4), 255, np.uint8)
    texture[..., 0], texture[..., 1] = np.arange(4 * side) // 4, np.arange(4 * side)[:, None] // 4
    return replace(
        head, texture=texture, uv=(0.03 + 0.2 * np.clip(head.uv, 0, 1)).astype("f4"), material=0 * head.material
    )


def colours(head: FaceMesh) -> np.ndarray:
    """The painting's colour in the middle of each triangle."""
    assert head.texture is not None
    height, width = head.texture.shape[:2]
    column, row = (head.uv[head.triangles].mean(axis=1) * (width, height)).astype(int).T
    return head.texture[row, column, :3].astype(int)


def test_a_painting_of_a_body_is_cut_to_the_head() -> None:
    head = painted_head()
    cut = crop_painting(head)
    assert cut.texture is not None
    assert cut.texture.size <= head.texture.size / 4
    assert np.abs(colours(cut) - colours(head)).max() <= 1
    assert crop_painting(cut) is cut  # nothing more is to be saved


def avatar_of_bones(*, jaw: bool, vrm: bool = False, rights: str = "") -> bytes:
    """A body with a head as services make them, without a shape: spheres that hang on nodes."""
    builder = Builder()
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 17)[:-1], np.linspace(0.05, np.pi - 0.05, 9))
    ball = np.stack([np.sin(height) * np.sin(turn), np.cos(height), np.sin(height) * np.cos(turn)], axis=-1).reshape(
        -1, 3
    )
    rows, columns = np.meshgrid(np.arange(8), np.arange(16), indexing="ij")
    corner = [(rows + down) * 16 + (columns + right) % 16 for down, right in ((0, 0), (1, 0), (1, 1), (0, 1))]
    triangles = np.stack([*corner[:3], corner[0], *corner[2:]], axis=-1).reshape(-1, 3)

    def sphere(size: float, middle: tuple[float, float, float]) -> int:
        item = {
            "attributes": {"POSITION": builder.accessor(size * ball + middle)},
            "indices": builder.accessor(triangles.ravel(), "u2"),
        }
        return builder.row("meshes", {"primitives": [item]})

    mouth = builder.node(shown=False, mesh=sphere(0.02, (0.0, 0.0, 0.1)))
    chin = builder.node(shown=False, name="Jaw", translation=[0, 0.02, 0.02], children=[mouth])
    face = builder.node(shown=False, mesh=sphere(0.12, (0.0, 0.1, 0.0)))
    head = builder.node(
        shown=False, name="mixamorig:Head", translation=[0, 0.3, 0], children=[face, *([chin] if jaw else [])]
    )
    body = builder.node(shown=False, mesh=sphere(0.2, (0.0, 0.0, 0.0)))
    builder.node(name="Hips", translation=[0, 1, 0], children=[head, body])
    builder.doc |= {"extensions": {"VRM": {}}} if vrm else {}
    builder.doc["asset"]["copyright"] = rights
    return builder.glb()


def moved(head: FaceMesh, **values: float) -> np.ndarray:
    faps = np.zeros(fap.FAP_COUNT)
    for name, value in values.items():
        faps[fap.column(int(name[1:]))] = value
    return np.linalg.norm(deform(head, faps) - head.vertices_mm, axis=1)


@pytest.mark.parametrize("jaw", [True, False])
def test_a_head_without_shapes_nods_and_moves_its_jaw(jaw: bool, tmp_path: Path) -> None:
    path = tmp_path / "robot.glb"
    path.write_bytes(avatar_of_bones(jaw=jaw))
    imported, info = import_head_file(path)
    head = imported.mesh
    assert info.used == ()
    assert imported.moved == ((3, 14, 15, 48, 49, 50) if jaw else (48, 49, 50))
    assert any("only bones move it" in note for note in imported.notes)
    nodding = moved(head, f48=20_000)
    assert (nodding[head.head_weight > 0.5] > 1).mean() > 0.9
    assert nodding[head.head_weight == 0].max(initial=0.0) == 0
    opened = moved(head, f3=500)
    assert (opened > 2).any() == jaw
    assert opened[head.bone_weight == 0].max(initial=0.0) == 0
    top_mm = head.vertices_mm[head.head_weight > 0.5, 1].max()
    assert top_mm == pytest.approx(build_head(MEASURED).vertices_mm[:, 1].max(), abs=1)


def test_what_a_file_says_about_its_licence_goes_along(tmp_path: Path) -> None:
    rights = '2026 Ada\nCC-BY 4.0; "as is"'
    (tmp_path / "robot.glb").write_bytes(avatar_of_bones(jaw=True, rights=rights))
    imported, info = import_head_file(tmp_path / "robot.glb")
    assert info.licence == rights
    save_head(tmp_path / "head", imported.mesh, info)
    asset = parse_gltf(exported_head(str(tmp_path / "head")), lambda name: b"").root.item("asset")
    assert asset.item("extras").string("license") == rights
    assert asset.string("copyright") == f"robot.glb; {rights}; {ICT_COPYRIGHT}"


def test_a_mesh_that_is_to_be_completed_needs_points_or_shapes(tmp_path: Path) -> None:
    (tmp_path / "robot.glb").write_bytes(avatar_of_bones(jaw=True))
    with pytest.raises(DataError, match=r"complete: no shape shows .* expected feature points 8.1 .*\(points=FILE\)"):
        import_head_file(tmp_path / "robot.glb", complete=True)


def test_a_head_without_shapes_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "robot.glb").write_bytes(avatar_of_bones(jaw=True))
    head = import_head_file(tmp_path / "robot.glb")[0].mesh
    with FaceRenderer(head, RenderOptions(size=(64, 64), samples=0)) as renderer:
        shut, opened = renderer.draw(np.zeros(68)).copy(), renderer.draw(single_fap(3)).copy()
    assert (shut != opened).any()


@pytest.mark.parametrize("vrm", [True, False])
def test_a_vrm_0_without_eye_bones_looks_the_other_way(vrm: bool, tmp_path: Path) -> None:
    (tmp_path / "robot.glb").write_bytes(avatar_of_bones(jaw=True, vrm=vrm))
    head = import_head_file(tmp_path / "robot.glb")[0].mesh
    mouth = head.vertices_mm[head.bone == Bone.JAW].mean(axis=0)
    middle = head.vertices_mm[head.head_weight > 0.5].mean(axis=0)
    assert (mouth[2] < middle[2]) == vrm


def test_a_mouth_without_lips_opens_as_a_whole(tmp_path: Path) -> None:
    """As one that is drawn on the face: no vertices part, so whole shapes move it."""
    rig = own_rig(("jawOpen", "eyeBlinkLeft", "eyeBlinkRight"))
    sink = np.clip((rig.vertices[:, 1:2] + 10.0) / 60.0, -1.0, 0.0) * [0.0, 20.0, 0.0]
    shapes = {**rig.blendshapes, "jawOpen": Blendshape(np.arange(len(sink)), sink)}
    builder = write_rig(replace(rig, blendshapes=shapes))
    path = tmp_path / "drawn.glb"
    path.write_bytes(builder.glb())
    with pytest.raises(DataError, match="no slit opens with the jaw"):
        import_head_file(path)
    parts, builder.doc["scenes"][0]["nodes"] = builder.doc["scenes"][0]["nodes"], []
    builder.node(name="Head", children=parts)
    path.write_bytes(builder.glb())
    imported, info = import_head_file(path)
    assert set(info.used) == {"jawOpen", "eyeBlinkLeft", "eyeBlinkRight"}
    assert {4, 5, 19, 20, 21, 22} <= set(imported.moved)
    head = imported.mesh
    wide = np.zeros(fap.FAP_COUNT)
    wide[[fap.column(4), fap.column(5)]] = -110, -440
    for share in (1.0, 0.5):
        lowered = (deform(head, share * wide) - head.vertices_mm)[:, 1].min()
        assert lowered == pytest.approx(-20.0 * share * imported.scale, rel=0.05)
    assert moved(head, f4=-200, f5=200).max() < 0.1  # lips that meet
    assert (moved(head, f19=960, f21=100) > 3).any()
    assert any("'jawOpen' as a whole opens the mouth" in note for note in imported.notes)


def test_without_a_shape_for_the_jaw_visemes_open_the_mouth() -> None:
    visemes = ["viseme_sil", "viseme_aa", "viseme_PP"]
    assert set(visemes) & set(choose_blendshapes([*ARKIT_NAMES, *visemes]).blended) == set()
    without = [name for name in ARKIT_NAMES if name != "jawOpen"]
    chosen = choose_blendshapes([*without, *visemes])
    assert {"viseme_aa", "viseme_PP"} <= set(chosen.blended)
    assert chosen.jaw[0] == "viseme_aa"
