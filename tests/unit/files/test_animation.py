"""Animated GIF and WebP and numbered PNG files: what another reader (Pillow) finds in them, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fapengine.errors import ResourceError, UsageError
from fapengine.files import moving as moving_files
from fapengine.files.moving import is_sequence, write_moving
from fapengine.files.pictures import load_picture

HEIGHT, WIDTH = 65, 96  # an odd side is fine


def moving(count: int) -> list[NDArray[np.uint8]]:
    """A warm gradient with two boxes, in opposite corners, that move."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    still = np.stack([120 + x, 100 + y, 90 + 0 * x], axis=-1).astype(np.uint8)
    pictures = [still.copy() for _ in range(count)]
    for number, picture in enumerate(pictures):
        picture[5:20, 2 * number : 2 * number + 20] = (20, 40, 220)
        picture[58:62, 90 - 2 * number :] = (250, 250, 250)
    return pictures


def read_back(path: Path) -> tuple[list[NDArray[np.int64]], list[int], int]:
    """Frames, their durations in ms, and how often they are shown (0: for ever)."""
    frames, durations = [], []
    with Image.open(path) as image:
        for number in range(image.n_frames):
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB")).astype(np.int64))
            durations.append(round(image.info["duration"]))
        return frames, durations, image.info["loop"]


@pytest.mark.parametrize(("suffix", "tolerance"), [(".gif", 6.0), (".webp", 4.0)])
def test_every_frame_at_its_time_for_ever(tmp_path: Path, suffix: str, tolerance: float) -> None:
    path, pictures, steps = tmp_path / "deep" / f"moving{suffix}", moving(30), []
    assert write_moving(path, iter(pictures), rate_hz=30.0, on_frame=lambda: steps.append(1)) == 30
    assert len(steps) == 30
    frames, durations, loop = read_back(path)
    assert len(frames) == 30
    assert frames[0].shape == (HEIGHT, WIDTH, 3)
    assert sum(durations) == pytest.approx(1000, abs=34)  # the last frame's time is the muxer's to choose
    starts = np.cumsum([0, *durations[:-1]])
    assert np.abs(starts - 1000 / 30 * np.arange(30)).max() <= 10  # GIF counts hundredths
    assert loop == 0
    for frame, picture in zip(frames, pictures, strict=True):
        assert np.abs(frame - picture).mean() < tolerance


def test_a_gif_s_still_parts_stand_still(tmp_path: Path) -> None:
    write_moving(tmp_path / "a.gif", moving(12), rate_hz=25.0)
    frames, _, _ = read_back(tmp_path / "a.gif")
    still = np.ones((HEIGHT, WIDTH), dtype=bool)
    still[5:20] = still[58:62] = False
    assert all(np.array_equal(frame[still], frames[0][still]) for frame in frames)
    assert len(np.unique(np.concatenate(frames).reshape(-1, 3), axis=0)) <= 256


def test_frames_after_the_palette_s_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moving_files, "PALETTE_FRAMES", 2)
    assert write_moving(tmp_path / "a.gif", iter(moving(9)), rate_hz=10.0) == 9
    frames, durations, _ = read_back(tmp_path / "a.gif")
    assert len(frames) == 9
    assert durations == [100] * 9
    assert np.abs(frames[8] - moving(9)[8]).mean() < 6.0


def test_a_single_frame_is_an_animation_too(tmp_path: Path) -> None:
    for suffix in (".gif", ".webp"):
        path = tmp_path / f"one{suffix}"
        assert write_moving(path, moving(1), rate_hz=25.0) == 1
        assert np.abs(load_picture(path).astype(int) - moving(1)[0]).mean() < 6.0


def test_sequences_are_numbered_from_0_and_exact(tmp_path: Path) -> None:
    pictures, steps = moving(11), []
    assert (
        write_moving(tmp_path / "f" / "a_%04d.png", iter(pictures), on_frame=lambda: steps.append(1), rate_hz=25.0)
        == 11
    )
    assert len(steps) == 11
    assert sorted(path.name for path in (tmp_path / "f").iterdir()) == [f"a_{n:04d}.png" for n in range(11)]
    assert np.array_equal(load_picture(tmp_path / "f" / "a_0007.png"), pictures[7])
    assert write_moving(tmp_path / "%d.png", pictures[:2], rate_hz=25.0) == 2
    assert (tmp_path / "1.png").exists()


def test_sequences_keep_alpha(tmp_path: Path) -> None:
    picture = np.zeros((8, 9, 4), np.uint8)
    picture[2:5, 3:6] = (10, 20, 30, 128)
    write_moving(tmp_path / "%02d.png", [picture], rate_hz=25.0)
    with Image.open(tmp_path / "00.png") as image:
        assert np.array_equal(np.asarray(image), picture)


def test_names_of_sequences() -> None:
    assert is_sequence(Path("out/frame_%04d.png"))
    assert not is_sequence(Path("out%d/frame.png"))


@pytest.mark.parametrize("name", ["a_%s.png", "a_%d_%d.png", "a_%d%%.png", "a_%4d.png", "a_%d.jpg", "%"])
def test_refuses_other_patterns(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=re.escape(f"got {name}, expected one number")):
        write_moving(tmp_path / name, moving(1), rate_hz=25.0)
    assert not list(tmp_path.iterdir())


def test_refuses(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"got .*a\.png, expected a name that ends with \.mp4, \.webm"):
        write_moving(tmp_path / "a.png", moving(1), rate_hz=25)
    with pytest.raises(UsageError, match="got 60 Hz, expected at most 50"):
        write_moving(tmp_path / "a.gif", moving(1), rate_hz=60)
    with pytest.raises(UsageError, match="got no frame"):
        write_moving(tmp_path / "a.webp", [], rate_hz=60)
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_bytes(b"not a folder")
    for write in (
        lambda: write_moving(tmp_path / "file" / "a.gif", moving(1), rate_hz=25),
        lambda: write_moving(tmp_path / "file" / "%d.png", moving(1), rate_hz=25.0),
    ):
        with pytest.raises(ResourceError, match="cannot be written"):
            write()
