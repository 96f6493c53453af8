"""Moving pictures by the name's kind, and alpha in those that have it."""

from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from fapengine.errors import UsageError
from fapengine.files.moving import beside, check_moving, is_moving, write_moving
from fapengine.files.pictures import contact_sheet, straight


def clear_frames(count: int) -> list[np.ndarray]:
    """A square that walks over nothing; at odd places, for libwebp leaves alpha out where a box can say the same."""
    frames = []
    for number in range(count):
        frame = np.zeros((64, 96, 4), np.uint8)
        frame[17:48, 21 + 4 * number : 52 + 4 * number] = (200, 60, 30, 255)
        frames.append(frame)
    return frames


@pytest.mark.parametrize(("name", "file"), [("a", "a/frame_0002.png"), ("b/f_%d.png", "b/f_2.png")])
def test_folders_and_patterns_get_pictures(tmp_path: Path, name: str, file: str) -> None:
    assert write_moving(tmp_path / name, clear_frames(3), rate_hz=25.0) == 3
    with Image.open(tmp_path / file) as image:
        assert np.array_equal(np.asarray(image), clear_frames(3)[2])


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif", ".webp"])
def test_files_get_all_frames(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "of %d ü" / f"a{suffix}"
    path.parent.mkdir()
    frames = [frame[..., :3] for frame in clear_frames(4)]
    assert write_moving(path, frames, rate_hz=25.0) == 4
    assert path.stat().st_size > 200


def test_webm_keeps_alpha(tmp_path: Path) -> None:
    write_moving(tmp_path / "a.webm", clear_frames(4), rate_hz=25.0)
    decoder, seen = av.CodecContext.create("libvpx-vp9", "r"), []  # FFmpeg's own decoder leaves alpha out
    with av.open(str(tmp_path / "a.webm")) as container:
        assert container.streams.video[0].metadata["ALPHA_MODE"] == "1"
        for packet in container.demux(video=0):
            seen += [frame.to_ndarray(format="rgba") for frame in decoder.decode(packet if packet.size else None)]
    assert len(seen) == 4
    for frame, expected in zip(seen, clear_frames(4), strict=True):
        assert np.abs(frame[..., 3].astype(int) - expected[..., 3]).mean() < 4
        assert np.abs(frame[30, 40].astype(int) - expected[30, 40]).max() < 12


def test_webp_keeps_alpha(tmp_path: Path) -> None:
    write_moving(tmp_path / "a.webp", clear_frames(3), rate_hz=25.0)
    with Image.open(tmp_path / "a.webp") as image:
        image.seek(2)
        frame = np.asarray(image.convert("RGBA"))
    assert np.abs(frame[..., 3].astype(int) - clear_frames(3)[2][..., 3]).mean() < 2
    assert np.abs(frame[30, 40].astype(int) - (200, 60, 30, 255)).max() < 12


def test_alpha_where_there_is_none(tmp_path: Path) -> None:
    for suffix in (".mp4", ".gif"):
        with pytest.raises(UsageError, match=rf"\{suffix} has no alpha; expected \.webm"):
            write_moving(tmp_path / f"a{suffix}", clear_frames(1), rate_hz=25.0)


def test_what_is_refused_beforehand() -> None:
    def check(name: str, rate_hz: float = 25.0, size: tuple[int, int] = (64, 64), alpha: bool = False) -> None:
        check_moving(Path(name), rate_hz=rate_hz, size=size, alpha=alpha)

    for name in ("a.mp4", "a.webm", "a.gif", "a.webp", "folder", "f_%04d.png"):
        check(name)
        assert is_moving(Path(name))
    for name in ("a.webm", "a.webp", "folder", "f_%04d.png"):
        check(name, alpha=True)
    check("a.webp", rate_hz=60.0, size=(63, 63))
    with pytest.raises(UsageError, match=r"path: got a\.avi, expected a name that ends with \.mp4"):
        check("a.avi")
    with pytest.raises(UsageError, match="GIF: got 60 Hz, expected at most 50"):
        check("a.gif", rate_hz=60.0)
    with pytest.raises(UsageError, match="size: got 63x64, expected even sides for video"):
        check("a.mkv", size=(63, 64))
    for name in ("a.mp4", "a.mkv", "a.gif"):
        with pytest.raises(UsageError, match=r"background: got none, but .* has no alpha"):
            check(name, alpha=True)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("o/talk.mp4", "o/talk.wav"), ("o/talk", "o/talk.wav"), ("o/f/%d.png", "o/f.wav"), ("%d.png", "frames.wav")],
)
def test_what_stands_beside(name: str, expected: str) -> None:
    assert beside(Path(name), ".wav") == Path(expected)


def test_straight_colours() -> None:
    picture = np.array([[[100, 50, 0, 128], [10, 20, 30, 255], [0, 0, 0, 0], [255, 9, 9, 200]]], np.uint8)
    found = straight(picture)
    assert found[0].tolist() == [[199, 100, 0, 128], [10, 20, 30, 255], [0, 0, 0, 0], [255, 11, 11, 200]]
    assert np.array_equal(straight(picture[..., :3]), picture[..., :3])


def test_a_sheet_keeps_shapes() -> None:
    """A wide red picture stays twice as wide as high."""
    wide = np.zeros((50, 100, 3), np.uint8)
    wide[:] = (255, 0, 0)
    sheet = contact_sheet([wide], [("", "")]).astype(int)
    red = (sheet[..., 0] > 200) & (sheet[..., 1] < 60)
    assert np.ptp(np.flatnonzero(red.any(axis=0))) + 1 == 384
    assert np.ptp(np.flatnonzero(red.any(axis=1))) + 1 == 192


def test_a_sheet_of_clear_pictures_shows_its_paper() -> None:
    frame = clear_frames(1)[0]
    tile = contact_sheet([frame], [("", "")])[16 : 16 + 192, 16 : 16 + 192]
    assert tile[60, 5].tolist() == [250, 249, 246]
    assert np.abs(tile[96, 80].astype(int) - (200, 60, 30)).max() <= 1


def test_prores_keeps_alpha_and_sound(tmp_path: Path) -> None:
    frame = np.zeros((32, 48, 4), np.uint8)
    frame[..., 0], frame[8:24, 8:40, 3], frame[:4, :, 3] = 200, 255, 128
    path = tmp_path / "a.mov"
    write_moving(path, [frame] * 3, rate_hz=25.0, sound=(np.zeros(1920, np.int16), 16000))
    with av.open(str(path)) as film:
        video, sound = film.streams.video[0], film.streams.audio[0]
        assert (video.codec.name, video.profile, sound.codec.name) == ("prores", "4444", "pcm_s16le")
        shown = next(film.decode(video=0)).to_ndarray(format="rgba").astype(int)
    assert np.abs(shown[..., 3] - frame[..., 3]).max() <= 3  # ten bits of colour, but alpha is kept in 16
    assert np.abs(shown[12:20, 12:36, 0] - 200).max() <= 3
