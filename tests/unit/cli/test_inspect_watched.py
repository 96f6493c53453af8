"""``fapengine inspect`` of what face trackers write, and what ``doctor`` says of the face detector."""

import json
import stat
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fapengine.cli._doctor_live import LackError, detector
from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.outputs import check_outputs


def inspect(path: Path, *words: str) -> str:
    result = CliRunner().invoke(app, ["inspect", str(path), *words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


@pytest.fixture
def frames() -> list:
    rng = np.random.default_rng(1)
    return [rng.random((478, 3)).round(4).tolist() if n not in (3, 4, 7) else None for n in range(10)]


@pytest.mark.parametrize("lines", [False, True])
def test_landmarks_are_known_by_their_number(frames, lines, tmp_path):
    path = tmp_path / f"marks.json{'l' * lines}"
    path.write_text("\n".join(map(json.dumps, frames)) if lines else json.dumps(frames))
    told = json.loads(inspect(path, "--json"))
    assert (told["format"], told["points"], told["frames"]) == ("landmarks of a face mesh", 478, 10)
    assert (told["seen"], told["longest"]) == (0.7, "2 frames")
    text = inspect(path)
    assert "with irises" in text
    assert f"fapengine capture {path} --size WIDTHxHEIGHT --fps N" in " ".join(text.split())


def test_a_table_of_landmarks_and_of_openface_are_known(frames, tmp_path):
    path = tmp_path / "marks.csv"
    rows = [[*np.ravel(frame)] for frame in frames if frame is not None]
    path.write_text("\n".join(",".join(map(str, row)) for row in ([f"c{n}" for n in range(3 * 478)], *rows)))
    assert json.loads(inspect(path, "--json"))["frames"] == 7
    header = ["frame", "timestamp", "confidence", "success", "gaze_angle_x", "gaze_angle_y"]
    header += [f"{axis}_{n}" for axis in "XYZ" for n in range(68)] + ["AU06_r", "AU45_r"]
    rows = [[n, n / 25, 0.9, int(n != 2), 0, 0, *range(204), 1, 2] for n in range(5)]
    path.write_text("\n".join(",".join(map(str, row)) for row in (header, *rows)))
    told = json.loads(inspect(path, "--json"))
    assert (told["points"], told["frames"], told["rate_hz"], told["seen"]) == (68, 5, 25.0, 0.8)
    assert told["action_units"] == ["AU06", "AU45"]
    assert "gaze; 2 action units: AU06, AU45" in inspect(path)
    path.write_text(",".join(header[:8]) + "\n1,2,3,4,5,6,7,8")
    with pytest.raises(DataError, match=r"column .* missing"):
        inspect(path)


def test_other_json_is_not_taken_for_landmarks(tmp_path):
    path = tmp_path / "mouth.json"
    path.write_text(json.dumps({"mouthCues": [{"start": 0.0, "end": 0.5, "value": "A"}]}))
    assert "landmarks" not in inspect(path)


def python(folder: Path, says: str) -> str:
    """A program that answers as the detector's Python would."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\necho '{says}'\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def test_doctor_says_where_the_detector_has_its_model(tmp_path, monkeypatch):
    monkeypatch.setenv("FAPENGINE_DETECTOR", python(tmp_path, "0.10.21 True"))
    assert detector() == "mediapipe 0.10.21, with its face model"
    monkeypatch.setenv("FAPENGINE_DETECTOR", python(tmp_path, "1.2.2 False"))
    with pytest.raises(LackError) as lack:
        detector()
    found, mend = lack.value.args
    assert "mediapipe 1.2.2" in found
    assert "has no face model" in found
    assert mend.startswith("face_landmarker.task from https://ai.google.dev/edge/mediapipe")
    assert "--model" in mend
    monkeypatch.setenv("FAPENGINE_DETECTOR", python(tmp_path, ""))
    with pytest.raises(LackError) as lack:
        detector()
    assert "pip install --no-deps mediapipe==0.10.21" in lack.value.args[1]
    monkeypatch.setenv("FAPENGINE_DETECTOR", str(tmp_path / "none"))
    with pytest.raises(ResourceError, match="make detector"):
        detector()


def test_scans_that_stand_elsewhere_are_read_and_not_written_over(tmp_path):
    session, other = tmp_path / "S03", tmp_path / "other"
    session.mkdir()
    other.mkdir()
    for name in ("a.ply", "b.obj", "b.mtl", "b.png"):
        (other / name).write_text("")
    (other / "b.obj").write_text("mtllib b.mtl\n")
    (other / "b.mtl").write_text("map_Kd b.png\n")
    toml = f"[[scan]]\nfile = '../other/a.ply'\n[[scan]]\nfile = '{other / 'b.obj'}'\n"
    (session / "session.toml").write_text(toml)
    for name in ("a.ply", "b.obj", "b.mtl", "b.png"):
        with pytest.raises(UsageError, match="which is read, and would be written over"):
            check_outputs([other / name], [session])
    assert check_outputs([other / "c.ply"], [session]) == ()
    for wrong in ("[[scan", "scan = 3", "scan = [3]", "[[scan]]\nfile = 3"):
        (session / "session.toml").write_text(wrong)
        assert check_outputs([other / "a.ply"], [session]) == (other / "a.ply",)
