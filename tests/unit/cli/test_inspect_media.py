"""``inspect`` of the project's own files: motion, sound, film, picture, avatar, head."""

import json
import struct
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from fapengine.app.inspection.faces import _mesh, shape_sets
from fapengine.app.inspection.feature_points import MOVED, SIDE, TITLE_PX, VIEWS, _is_named
from fapengine.cli.main import app
from fapengine.errors import DataError, FapEngineError
from fapengine.files.heads.load import load_head
from fapengine.files.motion import save_fap
from fapengine.files.moving import write_moving
from fapengine.files.pictures import load_picture, save_png
from fapengine.files.sound import save_wav
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh, RigBone
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.blend_tracks import format_blend_csv
from fapengine.retarget.rig_weights import OCULUS
from tests.projection import project
from tests.unit.files.glb import Builder, square

RATE_HZ = 8000


def inspected(*words: object) -> str:
    done = CliRunner().invoke(app, ["inspect", *map(str, words)])
    assert done.exit_code == 0, done.output
    return done.output


def as_json(*words: object) -> dict[str, Any]:
    return dict(json.loads(inspected(*words, "--json")))


def refused(*words: object, where: bool = False) -> str:
    error = CliRunner().invoke(app, ["inspect", *map(str, words)]).exception
    assert isinstance(error, FapEngineError)
    return str(error) if where or not isinstance(error, DataError) else error.message


@pytest.fixture
def tone(tmp_path: Path) -> Path:
    """One second: half of it at a tenth of full scale, half silent."""
    wave = 3276.8 * np.sin(2 * np.pi * 200 * np.arange(RATE_HZ) / RATE_HZ)
    wave[RATE_HZ // 2 :] = 0
    path = tmp_path / "tone.wav"
    save_wav(path, wave.astype(np.int16), RATE_HZ)
    return path


def test_a_fap_file(tmp_path: Path) -> None:
    values = np.zeros((30, 68))
    values[10:20, fap.column(3)] = np.arange(10) * 50
    values[:, fap.column(49)] = -900
    path = tmp_path / "talk.fap"
    save_fap(path, FapTrack.from_values(values, rate_hz=25.0))
    report = as_json(path)
    assert (report["frames"], report["seconds"], report["skipped"]) == (30, 1.2, 0)
    assert report["faps"]["open_jaw"] == {"number": 3, "low": 0, "high": 450, "unit": "MNS"}
    assert set(report["faps"]) == {"open_jaw", "head_yaw"}
    told = inspected(path, "--plot", tmp_path / "plot.png")
    assert "FAPs: 30 frames at 25 Hz" in told
    assert "2 FAPs move" in told
    assert load_picture(tmp_path / "plot.png").shape[2] == 3


def test_a_sound(tone: Path, tmp_path: Path) -> None:
    report = as_json(tone)["sound"]
    assert report["seconds"] == pytest.approx(1.0)
    assert (report["sample_rate_hz"], report["channels"], report["clipped"]) == (RATE_HZ, 1, 0)
    assert report["peak_db"] == pytest.approx(-20.0, abs=0.1)
    assert report["level_db"] == pytest.approx(-20.0 - 3.0 - 3.0, abs=0.1)  # a sine, half of the time
    inspected(tone, "--plot", tmp_path / "plot.png")
    inked = (load_picture(tmp_path / "plot.png").astype(int).min(axis=-1) < 200).sum(axis=0)
    left, right = np.array_split(inked, 2)
    assert left.sum() > 3 * right.sum()  # the second half is silent


def box(kind: bytes, *content: bytes) -> bytes:
    body = b"".join(content)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def test_a_cover_is_no_film(tone: Path, tmp_path: Path) -> None:
    with av.open(str(tone)) as source, av.open(str(tmp_path / "plain.m4a"), "w") as out:
        stream = out.add_stream("aac", rate=RATE_HZ)
        for frame in source.decode(audio=0):
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    save_png(tmp_path / "cover.png", np.zeros((8, 8, 3), np.uint8))
    cover = box(b"data", struct.pack(">II", 14, 0), (tmp_path / "cover.png").read_bytes())
    handler = box(b"hdlr", bytes(8), b"mdirappl", bytes(9))
    tags = box(b"udta", box(b"meta", bytes(4), handler, box(b"ilst", box(b"covr", cover))))
    data = (tmp_path / "plain.m4a").read_bytes()
    last = data.rindex(b"moov") - 4
    assert last + int.from_bytes(data[last : last + 4], "big") == len(data)
    (tmp_path / "cover.m4a").write_bytes(data[:last] + box(b"moov", data[last + 8 :], tags))
    with av.open(str(tmp_path / "cover.m4a")) as container:
        assert len(container.streams.video) == 1
    assert as_json(tmp_path / "cover.m4a") == as_json(tmp_path / "plain.m4a")


def test_a_film_with_and_without_sound(tmp_path: Path) -> None:
    pictures = [np.full((32, 48, 3), 8 * number, np.uint8) for number in range(10)]
    loud = np.full(RATE_HZ, np.iinfo(np.int16).max, np.int16)
    with_sound, silent = tmp_path / "talk.mp4", tmp_path / "mute.mp4"
    write_moving(with_sound, pictures, rate_hz=10.0, sound=(loud, RATE_HZ))
    write_moving(silent, pictures, rate_hz=10.0)
    report = as_json(with_sound)
    assert report["film"] == {"width": 48, "height": 32, "rate_hz": 10.0, "codec": "h264"}
    assert report["sound"]["seconds"] == pytest.approx(1.0, abs=0.1)
    assert "no sound" in inspected(silent)
    done = CliRunner().invoke(app, ["inspect", str(silent), "--plot", str(tmp_path / "plot.png")])
    assert done.exit_code != 0
    assert not (tmp_path / "plot.png").exists()


@pytest.mark.parametrize("shapes", ["arkit", "oculus"])
def test_a_table_of_shapes(tmp_path: Path, shapes: str) -> None:
    values = np.zeros((30, 68))
    values[:, fap.column(3)] = np.arange(30) * 20
    path = tmp_path / "talk.csv"
    path.write_bytes(format_blend_csv(FapTrack.from_values(values, rate_hz=25.0), shapes))
    report = as_json(path)
    assert (report["frames"], report["rate_hz"]) == (30, 25.0)
    assert "open_jaw" in report["faps"]
    assert "shapes, as FAPs" in inspected(path, "--plot", tmp_path / "plot.png")


def test_pictures_and_animations(tmp_path: Path) -> None:
    frames = [Image.new("RGB", (48, 32), (8 * number, 0, 0)) for number in range(5)]
    for name in ("a.gif", "a.webp"):
        frames[0].save(tmp_path / name, save_all=True, append_images=frames[1:], duration=40)
        report = as_json(tmp_path / name)
        assert [report[key] for key in ("width", "height", "frames", "seconds")] == [48, 32, 5, 0.2]
        assert "48x32, 5 frames, 0.20 s" in inspected(tmp_path / name)
    frames[0].save(tmp_path / "a.png")
    assert inspected(tmp_path / "a.png").strip() == "PNG: 48x32"
    (tmp_path / "bad.png").write_text("not a picture")
    assert refused(tmp_path / "bad.png") == "image: got no GIF or WEBP or PNG or JPEG"
    assert "nothing to plot" in refused(tmp_path / "a.png", "--plot", tmp_path / "plot.png")


def test_an_avatar(tmp_path: Path) -> None:
    builder = Builder()
    builder.node(mesh=square(builder, targets=("jawOpen", "eyeBlinkLeft", "hat")))
    clip = {
        "name": "hello",
        "samplers": [{"input": builder.accessor([0.0, 1.5], max=[1.5], min=[0.0]), "output": 0}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
    }
    builder.row("animations", clip)
    builder.doc["asset"]["copyright"] = "Anna; CC0"
    path = tmp_path / "anna.glb"
    path.write_bytes(builder.glb())
    report = as_json(path)
    assert (report["vertices"], report["triangles"], report["licence"]) == (4, 2, "Anna; CC0")
    assert report["shapes"] == ["jawOpen", "eyeBlinkLeft", "hat"]
    assert len(report["lacking"]) == 50
    assert report["shape_sets"]["ARKit"]["state"] == "partial"
    assert "ARKit: partial, 2 of 52 shapes move; missing: eyeLookDownLeft, " in inspected(path)
    assert "VRM: missing (18 shapes)" in inspected(path)
    assert report["clips"] == [{"name": "hello", "seconds": 1.5, "channels": 1}]
    assert f"head import {path} -o heads/anna" in inspected(path)
    path.write_bytes(builder.glb()[:-9])
    assert str(path) in refused(path, where=True)


@pytest.mark.parametrize(
    ("meta", "licence"),
    [
        ({"copyrightInformation": "Anna", "otherLicenseUrl": "https://a.example"}, "https://a.example"),
        ({"copyrightInformation": "Anna; CC0"}, "Anna; CC0"),
        ({}, "https://vrm.dev/licenses/1.0/"),
    ],
)
def test_the_licence_of_a_vrm_is_not_the_one_that_all_state(tmp_path: Path, meta: dict, licence: str) -> None:
    builder = Builder()
    builder.node(mesh=square(builder))
    builder.doc["extensions"] = {"VRMC_vrm": {"meta": {"licenseUrl": "https://vrm.dev/licenses/1.0/"} | meta}}
    (tmp_path / "a.vrm").write_bytes(builder.glb())
    assert as_json(tmp_path / "a.vrm")["licence"] == licence


def test_sets_of_shapes_are_complete_partial_empty_or_missing() -> None:
    """VRoid names ARKit's shapes that move nothing; those of rest move nothing anywhere."""
    oculus = [f"viseme_{name}" for name in OCULUS]
    sets = shape_sets([*ARKIT_NAMES, *oculus, "A", "Blink_L", "happy"], [*ARKIT_NAMES[:50], *oculus[1:]])
    assert {title: one["state"] for title, one in sets.items()} == {
        "ARKit": "partial", "Oculus": "complete", "VRM": "empty", "MPEG-4 visemes": "missing",
    }  # fmt: skip
    assert sets["ARKit"]["empty"] == list(ARKIT_NAMES[50:])
    assert sets["VRM"]["empty"] == ["happy", "aa", "blinkLeft"]
    assert "neutral" in sets["VRM"]["missing"]
    assert shape_sets(["viseme_0", "viseme 14"], ["viseme 14"])["MPEG-4 visemes"]["missing"] == [
        f"viseme{number}" for number in range(1, 14)
    ]
    assert shape_sets(["sil"], [])["Oculus"]["state"] == "missing"
    mixamo = [*ARKIT_NAMES, *oculus, "mouthOpen", "mouthSmile", "eyesClosed", "eyesLookUp", "eyesLookDown"]
    assert shape_sets(mixamo, mixamo)["VRM"]["state"] == "missing"
    assert shape_sets(["viseme_sil"], [])["Oculus"]["state"] == "empty"


def test_a_scan_says_what_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "scan.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    told = inspected(path)
    assert "3 vertices, 1 triangles" in told
    assert "--points FILE" in told


def test_a_head(tmp_path: Path) -> None:
    report = as_json("default:hair=false,level=coarse")
    assert report["feature_points"] == 84
    assert report["licence"] == "Apache-2.0"
    assert 3 in report["faps_by_surface"]
    assert "84 feature points" in inspected("default:hair=false,level=coarse", "--plot", tmp_path / "head.png")
    picture = load_picture(tmp_path / "head.png")
    assert picture.shape == (2 * SIDE + TITLE_PX, 2 * SIDE, 3)
    nose = load_head("default:hair=false,level=coarse").point_mm("9.3")
    x, y = project(VIEWS[0].camera, nose, (SIDE, SIDE)).round().astype(int)
    beside = picture[TITLE_PX + y - 2, x - 1]  # the line to its name begins in the middle
    assert np.abs(beside - np.array(MOVED)).max() < 10


def test_each_feature_point_is_named_in_some_view():
    named = {name for view in VIEWS for name in FEATURE_POINT_NAMES if _is_named(name, view)}
    assert set(FEATURE_POINT_NAMES) == named


def test_what_is_none_of_them_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.wav"
    path.write_text("not a sound")
    done = CliRunner().invoke(app, ["inspect", str(path)])
    assert done.exit_code != 0


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("talk.wav", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "a pointer of Git LFS"),
        ("face.fbx", b"Kaydara FBX Binary  \0\x1a\0", "FBX, expected a file that was exported as .glb"),
        (
            "face.fbx",
            b"; FBX 7.4.0 project file\nFBXHeaderExtension:  {\n}\n",
            "FBX, expected a file that was exported as .glb",
        ),
    ],
)
def test_well_known_files_of_other_kinds_are_named(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    assert message in refused(tmp_path / name)


@pytest.mark.parametrize(("weight", "told"), [(0.0, "needs feature points"), (1.0, "bones alone move a head")])
def test_a_head_of_bones_is_promised_only_if_they_carry_vertices(weight: float, told: str) -> None:
    """Headwear has the bones of its skeleton, and none of them is a head's."""
    flat = BlendshapeMesh(
        vertices=np.eye(3), triangles=np.array([[0, 1, 2]]), blendshapes={},
        bones={"head": RigBone(np.full(3, weight), np.zeros(3))},
    )  # fmt: skip
    assert told in _mesh(flat, Path("cap.glb"))["next"]
