"""A clip in somebody's scene: what is written, what stays, and what is refused."""

import copy
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pygltflib
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from fapengine.errors import DataError
from fapengine.files.gltf.clip import FaceMotion, add_clip
from fapengine.files.gltf.document import BINARY_CHUNK, JSON_CHUNK, split_glb
from fapengine.files.gltf.writing import TURN_TOLERANCE, WEIGHT_TOLERANCE
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import OCULUS_NAMES, VRM1_NAMES, approximate_presets, approximate_visemes
from tests.unit.files.glb import Builder

RATE_HZ = 30.0
FRAMES = 60


def nothing(name: str) -> bytes:
    raise DataError(f"no file {name}")


def speech() -> np.ndarray:
    """(60, 68): a mouth that opens and shuts twice, a blink, a glance."""
    faps = np.zeros((FRAMES, 68))
    swing = np.sin(np.arange(FRAMES) / FRAMES * 4 * np.pi) ** 2
    for number, value in ((3, 400), (5, -350), (10, -330), (11, -330), (19, 800), (20, 800), (23, 9000), (24, 9000)):
        faps[:, fap.column(number)] = value * swing
    return faps


def nod() -> dict[str, np.ndarray]:
    """Head that turns left by up to 0.3 rad and nods, a jaw that falls, eyes that look left."""
    swing = np.sin(np.arange(FRAMES) / FRAMES * 2 * np.pi)[:, None]
    return {
        "head": Rotation.from_rotvec(swing * [0.1, 0.3, 0.0]).as_matrix(),
        "jaw": Rotation.from_rotvec(np.abs(swing) * [0.2, 0.0, 0.0]).as_matrix(),
        "left eye": Rotation.from_rotvec(swing * [0.0, 0.2, 0.0]).as_matrix(),
        "right eye": Rotation.from_rotvec(swing * [0.0, 0.2, 0.0]).as_matrix(),
    }


def motion() -> FaceMotion:
    return FaceMotion(faps=speech(), turns=nod(), rate_hz=RATE_HZ, name="talk")


def mesh(builder: Builder, names: Sequence[str], *, lifted: Sequence[str] = (), empty: Sequence[str] = ()) -> int:
    """Add a triangle with a target for each name, of which those of ``lifted`` move it as a whole."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    small = np.array([[0, 0, 0], [0, 0, 0], [0, 1e-6, 0]])
    rows = [np.full((3, 3), float(name in lifted)) + (name not in empty) * small for name in names]
    targets = [{"POSITION": builder.accessor(row)} for row in rows]
    item: dict[str, Any] = {"attributes": {"POSITION": builder.accessor(corners)}, "targets": targets}
    return builder.row("meshes", {"primitives": [item], "extras": {"targetNames": list(names)}})


def curves(data: bytes, folder: Any) -> dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]]:
    """Times, output and interpolation by node and path, as pygltflib reads them."""
    path = folder / "clip.glb"
    path.write_bytes(data)
    scene = pygltflib.GLTF2().load(str(path))
    blob = scene.binary_blob()
    assert scene.animations[-1].name == "talk"

    def numbers(index: int) -> np.ndarray:
        row = scene.accessors[index]
        view = scene.bufferViews[row.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[row.type]
        found = np.frombuffer(blob, "<f4", row.count * width, view.byteOffset)
        return found if width == 1 else found.reshape(-1, width)

    clip = scene.animations[-1]
    return {
        (channel.target.node, channel.target.path): (
            numbers(clip.samplers[channel.sampler].input),
            numbers(clip.samplers[channel.sampler].output),
            clip.samplers[channel.sampler].interpolation or "LINEAR",
        )
        for channel in clip.channels
    }


def frames(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(60, W): a linear curve at the frames; frames of no use are left out of it."""
    at = np.arange(FRAMES) / RATE_HZ
    return np.stack([np.interp(at, times, column) for column in values.T], axis=1)


def test_arkit_s_shapes_get_their_weights(tmp_path: Any) -> None:
    builder = Builder()
    names = [*ARKIT_NAMES, "somethingElse"]
    node = builder.node(mesh=mesh(builder, names))
    found, reached = add_clip(builder.glb(), nothing, motion())
    times, weights, way = curves(found, tmp_path)[node, "weights"]
    assert way == "LINEAR"
    shown = frames(times, weights.reshape(len(times), len(names)))
    np.testing.assert_allclose(shown[:, :-1], approximate_arkit(speech()), atol=1e-6)  # float32
    assert not shown[:, -1].any()
    assert "jawOpen" in reached.shapes
    assert "cheekPuff" not in reached.shapes


def test_spellings_and_two_meshes_are_known(tmp_path: Any) -> None:
    builder = Builder()
    one = builder.node(mesh=mesh(builder, [f"blendShape1.{name[0].upper()}{name[1:]}" for name in ARKIT_NAMES]))
    other = builder.node(mesh=mesh(builder, ["mouthOpen", "still"]))  # Ready Player Me's jawOpen, on the teeth
    found = curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)
    jaw = approximate_arkit(speech())[:, ARKIT_NAMES.index("jawOpen")]
    for node, width, column in ((one, 52, ARKIT_NAMES.index("jawOpen")), (other, 2, 0)):
        times, weights, _ = found[node, "weights"]
        np.testing.assert_allclose(frames(times, weights.reshape(-1, width))[:, column], jaw, atol=1e-6)


def test_visemes_move_the_mouth_and_arkit_s_lids_the_eyes(tmp_path: Any) -> None:
    builder = Builder()
    names = [f"viseme_{name}" for name in ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "I")]
    names += ["eyeBlinkLeft", "jawOpen"]
    node = builder.node(mesh=mesh(builder, names))
    times, weights, _ = curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)[node, "weights"]
    shown = frames(times, weights.reshape(-1, len(names)))
    visemes = approximate_visemes(speech(), RATE_HZ)
    np.testing.assert_allclose(shown[:, 12], visemes[:, OCULUS_NAMES.index("ih")], atol=1e-6)
    assert shown[:, names.index("eyeBlinkLeft")].max() > 0.5
    assert not shown[:, names.index("jawOpen")].any()  # else the mouth would open twice


def test_expressions_of_a_vrm_move_what_they_bind(tmp_path: Any) -> None:
    builder = Builder()
    node = builder.node(mesh=mesh(builder, ["M_A", "M_Blink"]))
    bind = {"ih": ("preset", 0, 0.5), "blink": ("preset", 1, 1.0)}
    builder.doc["extensions"] = {
        "VRMC_vrm": {
            "expressions": {
                "preset": {
                    name: {"morphTargetBinds": [{"node": node, "index": target, "weight": weight}]}
                    for name, (_, target, weight) in bind.items()
                }
            }
        }
    }
    found, reached = add_clip(builder.glb(), nothing, motion())
    times, weights, _ = curves(found, tmp_path)[node, "weights"]
    vowel = approximate_presets(speech(), RATE_HZ)[:, VRM1_NAMES.index("ih")]
    np.testing.assert_allclose(frames(times, weights.reshape(-1, 2))[:, 0], 0.5 * vowel, atol=1e-6)
    assert set(reached.shapes) == {"ih", "blink"}


def test_an_expression_of_textures_alone_moves_no_shape() -> None:
    builder = Builder()
    node = builder.node(mesh=mesh(builder, ["M_A"]))
    preset = {
        "ih": {"morphTargetBinds": [{"node": node, "index": 0, "weight": 1.0}]},
        "blink": {"textureTransformBinds": [{"material": 0}]},
    }
    builder.doc["extensions"] = {"VRMC_vrm": {"expressions": {"preset": preset}}}
    assert add_clip(builder.glb(), nothing, motion())[1].shapes == ("ih",)


def test_a_mapping_tells_what_other_names_mean(tmp_path: Any) -> None:
    builder = Builder()
    node = builder.node(mesh=mesh(builder, ["Auf", "Kiefer", "jawOpen"]))
    meanings = {"Auf": "jawOpen", "Kiefer": {3: 800.0}, "jawOpen": "unused"}
    found, reached = add_clip(builder.glb(), nothing, motion(), meanings=meanings)
    times, weights, _ = curves(found, tmp_path)[node, "weights"]
    shown = frames(times, weights.reshape(-1, 3))
    np.testing.assert_allclose(shown[:, 1], speech()[:, 2] / 800, atol=2e-3)  # less the ridge of the fit
    assert shown[:, 0].max() > 0.2
    assert not shown[:, 2].any()
    assert set(reached.shapes) == {"Auf", "Kiefer"}


PARENT = Rotation.from_euler("xyz", [0.2, -0.4, 0.7])
REST = Rotation.from_euler("xyz", [-0.3, 0.5, 0.1])


def with_bones(
    *names: str, extensions: dict[str, Any] | None = None, as_matrix: bool = False, **form: Any
) -> tuple[bytes, list[int]]:
    """A rig of bones alone below a node that is turned and twice as large."""
    builder = Builder()
    mesh(builder, [])
    matrix = np.eye(4)
    matrix[:3, :3] = REST.as_matrix() * 2.0
    form |= {"matrix": matrix.T.ravel().tolist()} if as_matrix else {"rotation": REST.as_quat().tolist()}
    nodes = [builder.node(shown=False, name=name, **copy.deepcopy(form)) for name in names]
    builder.node(rotation=PARENT.as_quat().tolist(), scale=[2, 2, 2], children=nodes)
    if extensions:
        builder.doc["extensions"] = extensions
    return builder.glb(), nodes


@pytest.mark.parametrize(
    ("extensions", "facing"), [(None, np.eye(3)), ({"VRM": {}}, np.diag([-1.0, 1.0, -1.0]))], ids=["+z", "VRM 0"]
)
@pytest.mark.parametrize("as_matrix", [False, True])
def test_a_head_turns_about_the_face_s_own_axes(
    tmp_path: Any, extensions: Any, facing: np.ndarray, as_matrix: bool
) -> None:
    data, (node, _) = with_bones("mixamorig:Head", "Jaw", extensions=extensions, as_matrix=as_matrix)
    found, reached = add_clip(data, nothing, motion())
    times, local, _ = curves(found, tmp_path)[node, "rotation"]
    world = PARENT * Rotation.from_quat(local) * (PARENT * REST).inv()  # what it does to what hung there at rest
    assert len(times) == FRAMES
    np.testing.assert_allclose(world.as_matrix(), facing @ nod()["head"] @ facing.T, atol=1e-6)
    assert reached.bones == ("head", "jaw")
    row = json.loads(split_glb(found)[0][1])["nodes"][node]
    assert "matrix" not in row
    assert not as_matrix or row["scale"] == pytest.approx([2, 2, 2])


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, -2, 1], [-1, -1, -1]])
def test_a_mirrored_head_turns_as_others(tmp_path: Any, scale: list[int]) -> None:
    turns = []
    for form in ({}, {"scale": scale}):
        data, (node,) = with_bones("Head", **form)
        turns.append(curves(add_clip(data, nothing, motion())[0], tmp_path)[node, "rotation"][1])
    np.testing.assert_allclose(*turns, atol=1e-6)


def test_eyes_tell_where_a_face_looks(tmp_path: Any) -> None:
    builder = Builder()
    builder.node(name="LeftEye", translation=[0.0, 1.6, -0.03])  # a face that looks along +x
    right = builder.node(name="RightEye", translation=[0.0, 1.6, 0.03])
    builder.row("meshes", {"primitives": [{"attributes": {"POSITION": builder.accessor(np.eye(3))}}]})
    _, local, _ = curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)[right, "rotation"]
    facing = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_allclose(Rotation.from_quat(local).as_matrix(), facing @ nod()["right eye"] @ facing.T, atol=1e-6)


@pytest.mark.parametrize(("lifted", "turned"), [((), True), (("eyeLookDownLeft",), False)])
def test_eyes_turn_once(tmp_path: Any, lifted: tuple[str, ...], turned: bool) -> None:
    builder = Builder()
    shown = builder.node(shown=False, mesh=mesh(builder, [*ARKIT_NAMES], lifted=lifted))
    eye = builder.node(name="LeftEye", children=[shown])
    found = curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)
    assert ((eye, "rotation") in found) == turned
    assert (shown, "weights") in found


def test_eyes_of_a_compressed_mesh_are_left_to_its_shapes() -> None:
    """What Draco packed and nothing can unpack has accessors without bytes: nothing is read of them."""
    builder = Builder()
    shown = builder.node(shown=False, mesh=mesh(builder, ARKIT_NAMES, lifted=("eyeLookDownLeft",)))
    builder.node(name="LeftEye", children=[shown])
    for row in builder.doc["meshes"][0]["primitives"]:
        row["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
        row["attributes"] |= {
            "JOINTS_0": builder.row("accessors", {"componentType": 5121, "count": 3, "type": "VEC4"}),
            "WEIGHTS_0": builder.row("accessors", {"componentType": 5126, "count": 3, "type": "VEC4"}),
        }
    builder.doc["nodes"][shown]["skin"] = builder.row("skins", {"joints": [1]})
    _, reached = add_clip(builder.glb(), nothing, motion())
    assert "left eye" not in reached.bones
    assert "eyeBlinkLeft" in reached.shapes


def test_the_jaw_s_bone_is_left_to_shapes_that_open_the_mouth(tmp_path: Any) -> None:
    builder = Builder()
    node = builder.node(mesh=mesh(builder, [*ARKIT_NAMES]))
    builder.node(name="jaw")
    assert set(curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)) == {(node, "weights")}


def test_few_keys_keep_to_the_frames(tmp_path: Any) -> None:
    builder = Builder()
    node = builder.node(mesh=mesh(builder, [*ARKIT_NAMES]))
    head = builder.node(name="Head")
    found, reached = add_clip(builder.glb(), nothing, motion(), keys="cubic")
    at = np.arange(FRAMES) / RATE_HZ
    wanted = {
        (node, "weights"): approximate_arkit(speech()),
        (head, "rotation"): Rotation.from_matrix(nod()["head"]).as_quat(),
    }
    for key, (times, out, way) in curves(found, tmp_path).items():
        assert way == "CUBICSPLINE"
        assert len(times) < 0.6 * FRAMES
        before, values, behind = out.reshape(len(times), 3, -1).transpose(1, 0, 2)
        assert (before == behind).all()
        shown = CubicHermiteSpline(times, values, behind)(at)
        tolerance = WEIGHT_TOLERANCE if key[1] == "weights" else TURN_TOLERANCE
        assert np.abs(shown - wanted[key]).max() < tolerance + 1e-5  # float32
    assert reached.keys < FRAMES  # of both curves


def test_all_else_of_the_scene_stays() -> None:
    builder = Builder()
    builder.node(mesh=mesh(builder, [*ARKIT_NAMES]), name="Gesicht ü", extras={"mine": [1.5, None]})
    builder.row("animations", {"name": "wave", "samplers": [], "channels": []})
    plain = builder.glb()
    extra = (0x41424344, b"of another")
    data = plain[:8] + (len(plain) + 8 + 12).to_bytes(4, "little") + plain[12:]
    data += (12).to_bytes(4, "little") + extra[0].to_bytes(4, "little") + extra[1] + b"\0\0"
    old, new = (dict(split_glb(each)) for each in (data, add_clip(data, nothing, motion())[0]))
    before, after = json.loads(old[JSON_CHUNK]), json.loads(new[JSON_CHUNK])
    assert new[BINARY_CHUNK].startswith(old[BINARY_CHUNK])
    assert new[extra[0]] == old[extra[0]]
    assert after["buffers"][0]["byteLength"] == len(new[BINARY_CHUNK])
    for key, value in before.items():
        if key in ("accessors", "bufferViews", "animations"):
            assert after[key][: len(value)] == value
        elif key != "buffers":
            assert after[key] == value
    assert [row["name"] for row in after["animations"]] == ["wave", "talk"]


def test_files_that_a_document_names_go_into_the_result() -> None:
    builder = Builder()
    builder.node(mesh=mesh(builder, [*ARKIT_NAMES]))
    builder.image(np.zeros((2, 2, 3)))
    document = json.loads(builder.gltf("face.bin"))
    document["images"] = [{"uri": "skin.jpg"}]
    files = {"face.bin": bytes(builder.blob), "skin.jpg": b"\xff\xd8"}
    found, _ = add_clip(json.dumps(document).encode(), files.__getitem__, motion())
    after = json.loads(dict(split_glb(found))[JSON_CHUNK])
    assert after["images"] == [{"uri": "data:image/jpeg;base64,/9g="}]
    assert [row["buffer"] for row in after["bufferViews"][: len(document["bufferViews"])]] == [1] * len(
        document["bufferViews"]
    )
    again, _ = add_clip(found, nothing, motion())  # and so it can be read again
    assert len(json.loads(dict(split_glb(again))[JSON_CHUNK])["animations"]) == 2


def test_a_scene_without_a_face_is_refused() -> None:
    builder = Builder()
    builder.node(mesh=mesh(builder, ["lid", "box"]))
    with pytest.raises(DataError, match="no shape named as in ARKit"):
        add_clip(builder.glb(), nothing, motion())


def test_targets_that_move_nothing_do_not_count(tmp_path: Any) -> None:
    """As of services that give all names and fill in few: the mouth then opens by what does move."""
    builder = Builder()
    names = [*ARKIT_NAMES, "Fcl_MTH_I"]
    node = builder.node(mesh=mesh(builder, names, empty=ARKIT_NAMES))
    times, weights, _ = curves(add_clip(builder.glb(), nothing, motion())[0], tmp_path)[node, "weights"]
    shown = frames(times, weights.reshape(-1, len(names)))
    assert not shown[:, :-1].any()
    wanted = approximate_presets(speech(), RATE_HZ)[:, VRM1_NAMES.index("ih")]
    np.testing.assert_allclose(shown[:, -1], wanted, atol=1e-6)
