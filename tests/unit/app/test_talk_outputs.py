"""What say and animate write: by the name's kind, and what stands beside it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fapengine.app.manner import Manner
from fapengine.app.outputs import OUTPUT_KINDS, TABLE_SHAPES, SaveOptions, check_output, find_kind
from fapengine.app.performance import perform
from fapengine.app.report import Report
from fapengine.app.talk import outputs_of, write_talk
from fapengine.cli.options import DrawingOptions
from fapengine.errors import UsageError
from fapengine.files.gltf.vrma import SETS
from fapengine.files.moving import FOLDER_PATTERN, FORMATS
from fapengine.files.outputs import check_outputs
from fapengine.render.drawing import Drawing
from fapengine.retarget.blend_tracks import SHAPE_SETS
from fapengine.speech.phone_track import Phone, PhoneTrack

PHONES = PhoneTrack.of([Phone("_", 0.0, 0.1), Phone("m", 0.1, 0.2), Phone("a", 0.2, 0.4), Phone("_", 0.4, 0.5)])
RATE_HZ, FRAMES = 12.5, 6


def written(out: Path, background: str = "studio") -> Report:
    report = Report()
    sound = np.zeros(8000, np.int16), 16_000
    performance = perform(PHONES, sound, Manner(rate_hz=RATE_HZ), text="ma")
    write_talk(performance, out, SaveOptions(drawing=Drawing.parse(size="64", background=background), report=report))
    assert all(path.exists() for path, _ in report.files if "%" not in path.name)
    return report


@pytest.mark.parametrize("name", ["a.webp", "a.gif", "a"])
def test_animations_and_folders(tmp_path: Path, name: str) -> None:
    report = written(tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {name, "a.fap", "a.wav", "a.png"}
    assert (tmp_path / name, "pictures") in report.files
    if name == "a":
        assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [f"frame_{n:04d}.png" for n in range(FRAMES)]
    else:
        with Image.open(tmp_path / name) as image:
            assert image.n_frames >= FRAMES - 1  # pictures that are alike may be joined


def test_a_talking_head_over_nothing(tmp_path: Path) -> None:
    written(tmp_path / "clear_%02d.png", background="none")
    with Image.open(tmp_path / "clear_03.png") as image:
        alpha = np.asarray(image)[..., 3]
    assert alpha[2, 2] == 0
    assert alpha[40, 32] == 255
    assert (tmp_path.parent / f"{tmp_path.name}.wav").exists()  # beside the folder of the pictures


def test_refuses_before_any_work(tmp_path: Path) -> None:
    for name, rate_hz, drawing, message in (
        ("a.mp4", 30.0, {"background": "none"}, "has no alpha"),
        ("a.gif", 60.0, {}, "GIF: got 60 Hz"),
        ("a.avi", 30.0, {}, r"a\.avi, expected a name that ends with \.fap, .* or a folder"),
        ("a.mp4", 30.0, {"background": "pink"}, "background: got 'pink'"),
        ("a.mp4", 30.0, {"camera": "91,91"}, "pitch"),
        ("a.mp4", 30.0, {"antialias": "hard"}, "edges: got 'hard', expected one of fine, soft"),
    ):
        with pytest.raises(UsageError, match=message):
            check_output(
                tmp_path / name, "say", SaveOptions(drawing=DrawingOptions(**drawing).value()), rate_hz=rate_hz
            )
    check_output(tmp_path / "a.fap", "say", SaveOptions(), rate_hz=60.0)


def test_a_users_own_recording_stays_as_it_is(tmp_path: Path) -> None:
    recording = tmp_path / "a.wav"
    recording.write_bytes(b"stereo, 24 bits")
    performance = perform(PHONES, (np.zeros(8000, np.int16), 16_000), Manner(rate_hz=RATE_HZ))
    report = Report()
    write_talk(performance, tmp_path / "a.fap", SaveOptions(report=report), inputs=[recording])
    assert recording.read_bytes() == b"stereo, 24 bits"
    assert (recording, "sound, as it was") in report.files
    link = tmp_path / "b.wav"
    link.symlink_to(recording)  # another name of it
    write_talk(performance, tmp_path / "b.fap", SaveOptions(), inputs=[recording])
    assert recording.read_bytes() == b"stereo, 24 bits"
    write_talk(performance, tmp_path / "a.fap", SaveOptions())
    assert recording.read_bytes() != b"stereo, 24 bits"  # what is nobody's is written over


def test_a_video_is_not_written_over_itself(tmp_path: Path) -> None:
    video = tmp_path / "talk.mp4"
    video.write_bytes(b"video")
    with pytest.raises(UsageError, match=r"talk\.mp4, which is read, and would be written over"):
        check_outputs(outputs_of(video, sound=True, inputs=[video]), [video])
    assert check_outputs(outputs_of(tmp_path / "face.mp4", sound=True), [video]) == ()


def test_every_ending_is_one_row_and_its_files_have_rows_too() -> None:
    endings = [row.ending for row in OUTPUT_KINDS]
    assert len(set(endings)) == len(endings) == 23
    assert set(FORMATS) == {row.ending for row in OUTPUT_KINDS if row.is_image} - {"", FOLDER_PATTERN}
    assert {name for row in OUTPUT_KINDS for name in row.beside} <= set(endings)
    assert (None, *SHAPE_SETS) == TABLE_SHAPES
    assert set(find_kind(Path("a.vrma")).shapes) == {None, *SETS}


@pytest.mark.parametrize(
    ("name", "command", "shapes", "message"),
    [
        ("a.mp4", "say", "rhubarb", r"path: got a\.mp4, expected a name that ends with \.json, .* for shapes=rhubarb"),
        ("a.mp4", "say", "foo", r"shapes: got foo for a\.mp4, expected shapes=arkit or"),
        ("a.json", "convert", None, r"shapes: got none for a\.json, expected shapes=rhubarb"),
        ("a.json", "convert", "oculus", r"shapes: got oculus for a\.json, expected shapes=rhubarb"),
        ("a.csv", "say", None, r"path: got a\.csv"),
        ("a.mp4", "convert", None, r"path: got a\.mp4"),
    ],
)
def test_shapes_and_commands_that_a_kind_does_not_have(
    name: str, command: str, shapes: str | None, message: str
) -> None:  # fmt: skip
    with pytest.raises(UsageError, match=message):
        check_output(Path(name), command, SaveOptions(shapes=shapes), rate_hz=30.0)
