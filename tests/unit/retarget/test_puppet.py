"""A head for other programs: its shapes and joints move it as FAPs do."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fapengine.files.gltf.document import JSON_CHUNK, parse_gltf, split_glb
from fapengine.files.gltf.head_file import format_head
from fapengine.files.gltf.scene import bindings, read_scene
from fapengine.files.heads.built import load_built
from fapengine.files.provenance import SYNTHETIC
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.ict_notice import ICT_COPYRIGHT
from fapengine.retarget.moods import MOODS
from fapengine.retarget.puppet import EYE_TEXELS, HEAD, JAW, JOINTS, Puppet, eye_texture, make_puppet
from fapengine.retarget.rig_weights import OCULUS
from fapengine.retarget.skeleton import CHEST, EXTRAS, arkit_shapes, extra_shapes, mood_shapes
from fapengine.retarget.visemes import VRM1_NAMES, presets_to_faps

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
    faps = arkit_shapes()[name]
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
    assert asset.extras().string("digitalSourceType") == SYNTHETIC


def test_joints_have_the_names_that_others_look_for() -> None:
    assert JOINTS == ("Neck", "Head", "Jaw", "LeftEye", "RightEye")


# What TalkingHead 1.7.0 turns: `posePropNames` of its `talkinghead.mjs`, without "Head" and "Neck" of the head itself.
SPINE = ("Hips", "Spine", "Spine1", "Spine2")
LIMBS = ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")
FINGERS = tuple(
    f"Hand{finger}{number}" for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky") for number in (1, 2, 3)
)
VRM_REQUIRED = {
    "hips", "spine", "head", *(f"{side}{bone}" for side in ("left", "right") for bone in (
        "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")),
}  # fmt: skip


@pytest.fixture(scope="module")
def standing(head: FaceMesh) -> Puppet:
    return make_puppet(head, shape_faps=extra_shapes() | mood_shapes()).on_body()


def test_a_body_has_the_joints_of_mixamo(standing: Puppet) -> None:
    names = {joint.name for joint in standing.skeleton}
    limbs = {side + bone for side in ("Left", "Right") for bone in (*LIMBS, *FINGERS)}
    assert names == {*JOINTS, *SPINE, *limbs}
    assert len(names - {"Jaw", "LeftEye", "RightEye"}) == 52


def test_a_body_stands_in_a_t_and_its_right_side_mirrors_its_left(standing: Puppet) -> None:
    at = {joint.name: place for joint, place in zip(standing.skeleton, standing.joints, strict=True)}
    for name, place in at.items():
        if name.startswith("Left"):
            np.testing.assert_allclose(at[name.replace("Left", "Right")], place * (-1, 1, 1), atol=1e-9)
    for far, near in (("LeftHandMiddle3", "LeftHand"), ("LeftHand", "LeftForeArm"), ("LeftForeArm", "LeftArm")):
        np.testing.assert_allclose((at[far] - at[near])[1], 0.0, atol=1e-9)  # level
        assert at[far][0] > at[near][0] + 0.05
    assert at["LeftHandThumb3"][2] > at["LeftHand"][2] + 0.05  # thumbs to the front
    assert at["Hips"][1] > at["LeftLeg"][1] > at["LeftFoot"][1] > at["LeftToeBase"][1] > 0.0
    assert at["LeftToeBase"][2] > at["LeftFoot"][2] + 0.1
    assert 1.5 < at["LeftEye"][1] < 1.7


def test_a_head_on_a_body_keeps_its_form(puppet: Puppet, standing: Puppet) -> None:
    up = standing.joints[HEAD] - puppet.joints[HEAD]
    np.testing.assert_allclose(standing.joints[: len(JOINTS)] - puppet.joints, np.tile(up, (5, 1)), atol=1e-9)
    for part, same in zip(puppet.parts, standing.parts, strict=False):
        np.testing.assert_allclose(same.vertices - part.vertices, np.tile(up, (len(part.vertices), 1)), atol=1e-6)
        np.testing.assert_allclose(same.weights[:, HEAD:5], part.weights[:, HEAD:], atol=1e-6)
        np.testing.assert_allclose(same.weights.sum(axis=1), 1.0, atol=1e-6)
    clothes = next(part for part in standing.parts if part.name == "Clothes")
    chest = [joint.name for joint in standing.skeleton].index(CHEST)
    assert clothes.weights[clothes.vertices[:, 1].argmin(), chest] == 1.0
    feet = standing.parts[-1]
    assert np.abs(feet.vertices[:, 1]).max() == 0.0  # TalkingHead puts the lowest point on the ground
    assert [standing.skeleton[joint].name for joint in feet.weights.argmax(axis=1)[::3]] == [
        "LeftToeBase", "RightToeBase",
    ]  # fmt: skip


def test_a_skin_on_a_body_leaves_the_head_at_rest_where_it_is(standing: Puppet) -> None:
    data = format_head(standing, licence="Apache-2.0", source="fapengine")
    back = read_scene(parse_gltf(data, lambda _: b""))
    np.testing.assert_allclose(back.vertices, np.concatenate([part.vertices for part in standing.parts]), atol=2e-6)
    assert set(EXTRAS) <= set(back.blendshapes)


def test_extra_shapes_are_their_mixtures(standing: Puppet) -> None:
    face = standing.parts[0].shapes
    mixed = 0.8 * (face["mouthSmileLeft"].moves + face["mouthSmileRight"].moves)
    np.testing.assert_allclose(face["mouthSmile"].moves, mixed, atol=5e-4)  # skin over lips and lids bends
    assert np.abs(mixed).max() > 2e-3


def test_a_vrm_has_bones_expressions_gaze_and_licences(standing: Puppet) -> None:
    data = format_head(standing, licence="Apache-2.0", source="fapengine", vrm="ada")
    document = json.loads(dict(split_glb(data))[JSON_CHUNK])
    vrm = document["extensions"]["VRMC_vrm"]
    assert document["extensionsUsed"] == ["VRMC_vrm"]
    bones = {name: document["nodes"][bone["node"]]["name"] for name, bone in vrm["humanoid"]["humanBones"].items()}
    assert set(bones) > VRM_REQUIRED
    assert (bones["leftEye"], bones["upperChest"], bones["leftLittleProximal"]) == (
        "LeftEye", "Spine2", "LeftHandPinky1",
    )  # fmt: skip
    assert set(vrm["expressions"]["preset"]) == set(VRM1_NAMES)
    assert set(vrm["expressions"]["custom"]) == set(ARKIT_NAMES)
    assert vrm["lookAt"]["type"] == "bone"
    assert vrm["meta"]["commercialUsage"] == "corporation"
    assert [name for name in vrm["meta"] if re.search("Sexual|Violent|Hate", name)] == []  # VRM's default: not allowed
    assert ICT_COPYRIGHT in vrm["meta"]["thirdPartyLicenses"]
    other = format_head(standing, licence="not stated", source="x.glb", vrm="ada")
    meta = json.loads(dict(split_glb(other))[JSON_CHUNK])["extensions"]["VRMC_vrm"]["meta"]
    assert "commercialUsage" not in meta  # VRM's defaults: the author alone, not for sale


def test_presets_of_a_vrm_move_what_they_stand_for(head: FaceMesh, standing: Puppet) -> None:
    gltf = parse_gltf(format_head(standing, licence="x", source="x", vrm="ada"), lambda _: b"")
    bound = bindings(gltf)
    rows = dict(zip(VRM1_NAMES, presets_to_faps(np.eye(len(VRM1_NAMES))), strict=True))
    face = standing.parts[0]
    used = rows_of(head, Material.SKIN, Material.LIP)
    for name in (*MOODS, "relaxed", "aa", "ih", "ou", "ee", "oh"):
        shown = face.vertices.astype(np.float64)
        for bind in bound[name]:
            if bind.mesh == 0:
                shown = shown + bind.weight * list(face.shapes.values())[bind.target].moves
        wanted = (deform(head, rows[name]) - head.vertices_mm)[used] / 1000
        np.testing.assert_allclose(shown - face.vertices, wanted, atol=6e-5, err_msg=name)
        assert np.abs(wanted).max() > 1e-3, name


@pytest.mark.parametrize(("name", "lids"), [("eyeBlinkLeft", ("3.1", "3.3")), ("eyeBlinkRight", ("3.2", "3.4"))])
def test_a_blink_closes_the_eye(head: FaceMesh, name: str, lids: tuple[str, str]) -> None:
    upper, lower = (head.feature_points[point] for point in lids)
    shown = deform(head, arkit_shapes()[name])
    assert abs(shown[upper, 1] - shown[lower, 1]) < 0.3  # mm; 2 by the measured row alone
    assert head.vertices_mm[upper, 1] - head.vertices_mm[lower, 1] > 8


def test_shapes_have_the_names_that_programs_look_for(puppet: Puppet) -> None:
    """Unreal's and Unity's in their lists; Godot compares without case, and has one inner brow for each side."""
    wanted: dict[str, list[str]] = {}
    with (ROOT / "tests" / "vectors" / "names_of_programs.csv").open() as file:
        for row in csv.DictReader(file):
            wanted.setdefault(row["program"], []).append(row["name"])
    names = [name for name in ARKIT_NAMES if any(name in part.shapes for part in puppet.parts)]
    spelled = [name[0].upper() + name[1:] for name in names]
    assert spelled == wanted["unreal"]
    assert sorted(spelled) == sorted(wanted["unity"])
    assert {name.lower() for name in names} - set(wanted["godot"]) == {"browinnerup"}
