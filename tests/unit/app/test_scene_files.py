"""Motion into an avatar's file, by the command line and by Python."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import fapengine
from fapengine.app.outputs import SaveOptions, check_output
from fapengine.app.scene_files import Into, save_scene
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.files.gltf.document import JSON_CHUNK, split_glb
from fapengine.mpeg4.track import FapTrack
from tests.unit.files.glb import Builder, square


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def avatar(tmp_path: Path) -> Path:
    builder = Builder()
    builder.node(mesh=square(builder, targets=("jawOpen", "eyeBlinkLeft")))
    builder.node(name="Head")
    (tmp_path / "avatar.glb").write_bytes(builder.glb())
    return tmp_path / "avatar.glb"


def open_mouth() -> FapTrack:
    values = np.zeros((4, 68), np.int32)
    values[:, 2] = [0, 300, 600, 0]
    values[:, 47] = [0, 5000, 9000, 0]
    return FapTrack.from_values(values, rate_hz=25.0)


def names(path: Path) -> list[str]:
    return [row["name"] for row in json.loads(dict(split_glb(path.read_bytes()))[JSON_CHUNK])["animations"]]


def test_save_and_convert_write_the_same(avatar: Path, tmp_path: Path) -> None:
    track = open_mouth()
    fapengine.save(track, tmp_path / "talk.fap")
    fapengine.save(track, tmp_path / "talk.glb", into=avatar)
    done = run("convert", tmp_path / "talk.fap", "--into", avatar, "-o", tmp_path / "other.glb")
    assert done.exit_code == 0
    assert "moves 2 shapes, and turns head" in done.stdout
    assert names(tmp_path / "talk.glb") == ["talk"]
    assert (tmp_path / "talk.glb").read_bytes() == (tmp_path / "other.glb").read_bytes()


def test_animate_writes_faps_beside_it(avatar: Path, tmp_path: Path) -> None:
    (tmp_path / "talk.pho").write_text("_ 100\nb 80\na 200\n_ 100\n")
    done = run("animate", tmp_path / "talk.pho", "--into", avatar, "-o", tmp_path / "out" / "b.glb")
    assert done.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["b.fap", "b.glb"]
    again = tmp_path / "again.glb"
    save_scene(again, fapengine.load(tmp_path / "out" / "b.fap"), Into(avatar), name="b")
    assert again.read_bytes() == (tmp_path / "out" / "b.glb").read_bytes()


@pytest.mark.parametrize(
    ("output", "into", "message"),
    [
        ("a.glb", None, "into: missing"),
        ("a.mp4", Into(Path("b.glb")), "path: got a.mp4"),
        ("a.glb", Into(Path("b.glb"), keys="few"), "keys: got 'few'"),
    ],
)
def test_what_does_not_belong_together_is_refused(output: str, into: Into | None, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        check_output(Path(output), SaveOptions(into=into), rate_hz=30.0)


def test_an_avatar_is_not_written_over(avatar: Path, tmp_path: Path) -> None:
    fapengine.save(open_mouth(), tmp_path / "talk.fap")
    done = run("convert", tmp_path / "talk.fap", "--into", avatar, "-o", avatar)
    assert "which is read" in str(done.exception)


def test_an_error_names_the_avatar(avatar: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.glb").write_bytes(avatar.read_bytes()[:100])
    with pytest.raises(DataError, match=r"cut\.glb: GLB"):
        save_scene(tmp_path / "a.glb", open_mouth(), Into(tmp_path / "cut.glb"))
    assert not (tmp_path / "a.glb").exists()


def test_a_track_without_a_frame_is_refused(avatar: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="contains no frames"):
        save_scene(tmp_path / "a.glb", FapTrack.from_values(np.zeros((0, 68), np.int32), rate_hz=25.0), Into(avatar))


def test_skipped_frames_are_held() -> None:
    track = FapTrack.from_values([[0] * 68, [0, 0, 5] + [0] * 65], rate_hz=25.0)
    uneven = FapTrack(
        values=track.values, mask=track.mask, visemes=track.visemes, expressions=track.expressions,
        frame_numbers=[3, 6], rate_hz=25.0,
    )  # fmt: skip
    assert uneven.filled_values()[:, 2].tolist() == [0, 0, 0, 5]


def test_a_head_is_exported_with_the_motion_inside(tmp_path: Path) -> None:
    fapengine.save(open_mouth(), tmp_path / "talk.glb", into="default:level=coarse")
    assert names(tmp_path / "talk.glb") == ["talk"]
    done = run("head", "export", "default:level=coarse", "-o", tmp_path / "plain.glb")
    assert "Apache-2.0" in done.stdout
    before, after = (dict(split_glb((tmp_path / f"{name}.glb").read_bytes())) for name in ("plain", "talk"))
    assert json.loads(before[JSON_CHUNK])["meshes"] == json.loads(after[JSON_CHUNK])["meshes"]


def test_a_vrm_animation_needs_no_avatar(tmp_path: Path) -> None:
    fapengine.save(open_mouth(), tmp_path / "talk.fap")
    done = run("convert", tmp_path / "talk.fap", "--shapes", "arkit", "-o", tmp_path / "talk.vrma")
    assert "expressions of arkit" in done.stdout
    assert names(tmp_path / "talk.vrma") == ["talk"]
    with pytest.raises(UsageError, match="shapes: got oculus"):
        fapengine.save(open_mouth(), tmp_path / "b.vrma", shapes="oculus")
