"""The verb render: FAPs in, every kind of picture out."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.codec.encoder import encode
from fapengine.errors import UsageError
from fapengine.files.fap import save_fap
from fapengine.files.pictures import load_picture
from fapengine.files.video import load_video
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

FRAMES = 5


def run(*words: object) -> str:
    result = CliRunner().invoke(app, ["render", *map(str, words), "--size", "96x64"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def opening() -> FapTrack:
    """A jaw and a lower lip that go down frame by frame."""
    values = np.zeros((FRAMES, 68), dtype=np.int64)
    values[:, fap.column(3)] = values[:, fap.column(5)] = np.arange(FRAMES) * 150
    values[:, fap.column(5)] *= -1
    return FapTrack.of(values, rate_hz=25.0)


@pytest.fixture
def fap_file(tmp_path: Path, opening: FapTrack) -> Path:
    save_fap(tmp_path / "in.fap", opening)
    return tmp_path / "in.fap"


def test_pictures_of_one_track_agree_in_every_form(fap_file: Path, tmp_path: Path) -> None:
    assert f"{FRAMES} frames at 25 Hz" in run(fap_file, "-o", tmp_path / "f_%02d.png")
    pictures = [load_picture(tmp_path / f"f_{number:02d}.png").astype(int) for number in range(FRAMES)]
    assert not (tmp_path / f"f_{FRAMES:02d}.png").exists()
    changes = [np.abs(picture - pictures[0]).mean() for picture in pictures]
    assert np.all(np.diff(changes) > 0)  # the mouth opens
    for suffix, tolerance in ((".mp4", 6), (".gif", 8), (".webp", 6)):
        assert f"{FRAMES} frames at 25 Hz" in run(fap_file, "-o", tmp_path / f"a{suffix}")
        if suffix == ".mp4":
            frames = list(load_video(tmp_path / "a.mp4").frames)
        else:
            with Image.open(tmp_path / f"a{suffix}") as image:
                frames = [np.asarray(_at(image, number).convert("RGB")) for number in range(image.n_frames)]
        assert len(frames) == FRAMES
        for frame, picture in zip(frames, pictures, strict=True):
            assert np.abs(frame.astype(int) - picture).mean() < tolerance
    assert "one frame" in run(fap_file, "-o", tmp_path / "one.png", "--at", 0.08)
    assert np.array_equal(load_picture(tmp_path / "one.png"), pictures[2])


def _at(image: Image.Image, number: int) -> Image.Image:
    image.seek(number)
    return image


def test_streams_are_drawn_like_text(tmp_path: Path, opening: FapTrack) -> None:
    (tmp_path / "in.fba").write_bytes(encode(opening))
    save_fap(tmp_path / "in.fap", opening)
    run(tmp_path / "in.fba", "-o", tmp_path / "stream_%d.png")
    run(tmp_path / "in.fap", "-o", tmp_path / "text_%d.png")
    for number in range(FRAMES):
        stream, text = (load_picture(tmp_path / f"{name}_{number}.png").astype(int) for name in ("stream", "text"))
        assert np.abs(stream - text).mean() < 1.0  # the quantiser's steps


def test_refuses(fap_file: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"a\.avi, expected .*\.mp4.*\.gif, \.webp or \.png"):
        run(fap_file, "-o", tmp_path / "a.avi")
    for name in ("a.gif", "a.webp", "a.png", "%d.png"):
        with pytest.raises(UsageError, match="holds no sound"):
            run(fap_file, "-o", tmp_path / name, "--audio", tmp_path / "none.wav")
    with pytest.raises(UsageError, match=r"--at: got 9\.0 s, the track lasts 0\.16 s"):
        run(fap_file, "-o", tmp_path / "a.png", "--at", 9)
    assert [path.name for path in tmp_path.iterdir()] == ["in.fap"]
