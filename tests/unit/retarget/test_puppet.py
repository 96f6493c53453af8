"""A head for other programs: its shapes and joints move it as FAPs do."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fapengine.files.gltf.document import parse_gltf
from fapengine.files.gltf.head_file import format_head
from fapengine.files.gltf.scene import read_scene
from fapengine.files.heads.built import load_built
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.blendshape_names import OCULUS
from fapengine.retarget.notice import ICT_COPYRIGHT
from fapengine.retarget.puppet import EYE_TEXELS, HEAD, JAW, JOINTS, Puppet, eye_texture, make_puppet

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return load_built(HeadStyle(), "coarse")


@pytest.fixture(scope="module")
def puppet(head: FaceMesh) -> Puppet:
    return make_puppet(head)


@pytest.fixture(scope="module")
def glb(puppet: Puppet) -> bytes:
    return format_head(puppet, licence="Apache-2.0", source="fapengine")


def part_of(puppet: Puppet, name: str) -> tuple[np.ndarray, np.ndarray, object]:
    part = next(part for part in puppet.parts if part.name == name)
    return part.vertices.astype(np.float64), part.weights.astype(np.float64), part


def rows_of(head: FaceMesh, *materials: Material) -> np.ndarray:
    """Vertices of a part in the head: those that its triangles use."""
    triangles = head.triangles[np.isin(head.material[head.triangles[:, 0]], materials)]
    return np.unique(triangles)


def test_every_shape_is_there(puppet: Puppet) -> None:
    names = {name for part in puppet.parts for name in part.shapes}
    assert names == {*ARKIT_NAMES, *(f"viseme_{name}" for name in OCULUS)}


@pytest.mark.parametrize("name", ["jawOpen", "mouthSmileLeft", "eyeBlinkRight"])
def test_a_shape_moves_the_face_as_its_faps_do(head: FaceMesh, puppet: Puppet, name: str) -> None:
    vertices, _, part = part_of(puppet, "Face")
    rows = rows_of(head, Material.SKIN, Material.LIP)
    faps = arkit_map().faps[ARKIT_NAMES.index(name)]
    shown = 1000 * (vertices + part.shapes[name].moves)
    np.testing.assert_allclose(shown, deform(head, faps)[rows], atol=0.021)  # mm: what is left out as negligible
    assert np.abs(part.shapes[name].moves).max() > 3e-3


@pytest.mark.parametrize(("joint", "number", "value"), [(HEAD, 49, 30000), (JAW, 3, 500)])
def test_joints_turn_what_bones_turn(head: FaceMesh, puppet: Puppet, joint: int, number: int, value: int) -> None:
    faps = np.zeros(68)
    faps[fap.column(number)] = value
    name, materials = ("Face", (Material.SKIN, Material.LIP)) if joint == HEAD else ("Tongue", (Material.TONGUE,))
    vertices, weights, _ = part_of(puppet, name)
    wanted = deform(head, faps)[rows_of(head, *materials)] / 1000
    pivot = puppet.joints[joint]
    turned = (vertices - pivot) @ rotation_of(head, faps, joint).T + pivot
    share = weights[:, [joint]] if joint == JAW else weights[:, HEAD:].sum(axis=1, keepdims=True)  # the jaw hangs on it
    np.testing.assert_allclose(vertices + share * (turned - vertices), wanted, atol=2e-5)


def rotation_of(head: FaceMesh, faps: np.ndarray, joint: int) -> np.ndarray:
    from fapengine.mesh.deform import bone_transforms

    return bone_transforms(head, faps)[{HEAD: 4, JAW: 1}[joint], :3, :3]


def test_parts_are_whole(head: FaceMesh, puppet: Puppet) -> None:
    assert sum(len(part.triangles) for part in puppet.parts) == len(head.triangles)
    for part in puppet.parts:
        assert part.triangles.max() == len(part.vertices) - 1
        np.testing.assert_allclose(part.weights.sum(axis=1), 1.0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-5)


def test_hairs_are_as_narrow_as_they_are(head: FaceMesh, puppet: Puppet) -> None:
    brows, _, part = part_of(puppet, "Brows")
    rows = rows_of(head, Material.STRAND, Material.LASH)
    pairs = np.flatnonzero(head.material[rows] == Material.STRAND).reshape(-1, 2)
    widths = 1000 * np.linalg.norm(brows[pairs[:, 1]] - brows[pairs[:, 0]], axis=1)
    np.testing.assert_allclose(widths, 2 * head.uv[rows[pairs[:, 0]], 1], atol=1e-4)
    assert part.texture is None


def test_an_eye_has_a_pupil_in_an_iris_in_white(head: FaceMesh) -> None:
    texture = eye_texture(head)
    middle, iris, white = (texture[EYE_TEXELS // 2, EYE_TEXELS // 2 + at].astype(int).sum() for at in (0, 40, 90))
    assert middle < 60 < iris < white
    assert white > 500


def test_others_read_it(glb: bytes, puppet: Puppet) -> None:
    scene = trimesh.load(io.BytesIO(glb), file_type="glb")
    assert set(scene.geometry) == {part.name for part in puppet.parts}
    for part in puppet.parts:
        assert len(scene.geometry[part.name].vertices) == len(part.vertices)
    back = read_scene(parse_gltf(glb, lambda _: b""))
    np.testing.assert_allclose(back.vertices, np.concatenate([part.vertices for part in puppet.parts]), atol=1e-7)
    assert set(back.bones) == {"head", "jaw", "left eye", "right eye"}
    assert set(back.blendshapes) == {name for part in puppet.parts for name in part.shapes}
    np.testing.assert_allclose(back.bones["jaw"].joint, puppet.joints[JAW], atol=1e-6)


def test_the_licences_stand_in_the_file(glb: bytes) -> None:
    asset = parse_gltf(glb, lambda _: b"").root.item("asset")
    assert asset.string("copyright") == f"fapengine; Apache-2.0; {ICT_COPYRIGHT}"
    assert asset.extras().string("license") == "Apache-2.0"
    told = asset.extras().string("notice")
    assert told.split("MIT License")[1] in (ROOT / "NOTICE").read_text()
    assert "USC Institute" in told


def test_joints_have_the_names_that_others_look_for() -> None:
    assert JOINTS == ("Neck", "Head", "Jaw", "LeftEye", "RightEye")
