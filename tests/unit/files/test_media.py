"""Sound, video and picture files: there and back, and what they refuse."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fapengine.errors import DataError, ResourceError, TruncatedError, UnsupportedError, UsageError
from fapengine.files import pictures, video
from fapengine.files.fba import read_fba_film
from fapengine.files.moving import write_moving
from fapengine.files.paths import write_bytes
from fapengine.files.pictures import TILE, bar_chart, contact_sheet, load_picture, save_png
from fapengine.files.sound import load_sound, save_wav
from fapengine.files.video import inspect_film, stream_pictures
from tests.videos import load_video

TONE = (np.sin(np.arange(22050) * 2 * np.pi * 440 / 22050) * 9000).astype(np.int16)


def frames(count: int) -> list[NDArray[np.uint8]]:
    return [np.full((64, 96, 3), 8 * index, np.uint8) for index in range(count)]


def decode_all(path: Path) -> None:
    list(stream_pictures(path, max_side=64))


def test_wav_there_and_back(tmp_path: Path) -> None:
    save_wav(tmp_path / "deep" / "tone.wav", TONE, 22050)
    samples, rate_hz = load_sound(tmp_path / "deep" / "tone.wav")
    assert rate_hz == 22050
    assert np.array_equal(samples, TONE)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_video_has_every_frame_and_its_sound(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"video{suffix}"
    assert write_moving(path, frames(30), rate_hz=30.0, sound=(TONE, 22050)) == 30
    video = load_video(path)
    assert video.frames.shape == (30, 64, 96, 3)
    assert video.rate_hz == pytest.approx(30.0)
    assert video.frames.mean(axis=(1, 2, 3)) == pytest.approx(8 * np.arange(30), abs=6)
    assert video.sound_duration_s == pytest.approx(1.0, abs=1 / 30)
    samples, _ = load_sound(path)
    assert np.abs(samples[4000:20000]).max() > 5000


def test_a_video_of_an_unknown_codec_holds_no_picture(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    write_moving(path, frames(3), rate_hz=25.0)
    path.write_bytes(path.read_bytes().replace(b"avc1", b"qqq1"))
    assert inspect_film(path) is None
    assert read_fba_film(path) is None
    with pytest.raises(DataError, match="contains no image"):
        decode_all(path)


@pytest.mark.parametrize("box", ["stsz", "trun"])
def test_a_video_that_states_more_samples_than_bytes_is_refused(tmp_path: Path, box: str) -> None:
    """55 million of them in 1.7 kB took 914 MB."""
    path = tmp_path / "video.mp4"
    write_moving(path, frames(3), rate_hz=25.0)
    data = path.read_bytes()
    at = data.index(b"stsz")
    decode_all(path)
    if box == "stsz":
        path.write_bytes(data[: at + 8] + bytes.fromhex("00000001034c6d6f") + data[at + 16 :])
    else:
        moof = bytes.fromhex("00000024 6d6f6f66 0000001c 74726166 00000014 7472756e 00000000 034c6d6f 00000000")
        path.write_bytes(data + moof)
    with pytest.raises(DataError, match="states more samples than it has bytes"):
        decode_all(path)
    path.write_bytes(data[: at - 4] + b"\0\0\0\1" + data[at:])  # a box of a wrong length ends the walk
    inspect_film(path)


def test_a_video_without_its_index_says_that_it_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    write_moving(path, frames(3), rate_hz=25.0)
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(TruncatedError, match=r"video\.mp4: its index, moov, is not complete: cut off"):
        decode_all(path)


def test_a_video_of_huge_frames_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "film.gif"
    write_moving(path, frames(3), rate_hz=25.0)
    monkeypatch.setattr(video, "MAX_PIXELS", 96 * 64 - 1)
    with pytest.raises(DataError, match="got 96x64 pixels, expected at most 6143"):
        decode_all(path)


def test_video_without_sound(tmp_path: Path) -> None:
    write_moving(tmp_path / "mute.mp4", frames(3), rate_hz=25.0)
    assert load_video(tmp_path / "mute.mp4").sound_duration_s == 0
    with pytest.raises(DataError, match="holds no sound"):
        load_sound(tmp_path / "mute.mp4")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_a_large_picture_is_scaled_down(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MAX_SIDE", 100)
    path = tmp_path / f"picture{suffix}"
    Image.new("RGB", (300, 150), (200, 100, 50)).save(path)
    picture = load_picture(path)
    assert picture.shape == (50, 100, 3)
    assert np.abs(picture.astype(int) - [200, 100, 50]).max() <= 4


def test_a_webp_is_refused_by_its_stated_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unpacked it is four times in memory: 7,000 x 7,000 pixels in 87 kB took 786 MB."""
    monkeypatch.setattr(pictures, "MAX_PIXELS_WEBP", 300 * 150 - 1)
    image = Image.new("RGB", (300, 150))
    for suffix in (".png", ".webp"):
        image.save(tmp_path / f"picture{suffix}")
    assert load_picture(tmp_path / "picture.png").shape == (150, 300, 3)
    with pytest.raises(UnsupportedError, match="got 300x150 pixels of WebP, expected at most 44999"):
        load_picture(tmp_path / "picture.webp")


def test_png_there_and_back(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 255, (20, 30, 3), dtype=np.uint8)
    save_png(tmp_path / "picture.png", picture)
    assert np.array_equal(load_picture(tmp_path / "picture.png"), picture)


def test_contact_sheet_shows_every_frame_and_ipa_labels() -> None:
    one = contact_sheet(frames(5), [("aɪ", "0.1 s")] * 5, title="Hello")
    other = contact_sheet(frames(5), [("ʃ", "0.1 s")] * 5, title="Hello")
    assert one.shape == other.shape
    assert not np.array_equal(one, other)
    boxes = contact_sheet(frames(5), [("\ufffe", "0.1 s")] * 5, title="Hello")
    assert not np.array_equal(other, boxes)  # a missing glyph would be the same box
    assert contact_sheet(frames(23), [("a", "")] * 23).shape[0] > one.shape[0]


def test_faces_side_by_side_are_as_high_in_a_contact_sheet_as_one() -> None:
    red = np.full((100, 300, 3), (255, 0, 0), np.uint8)
    for width in (100, 300):
        sheet = contact_sheet([red[:, :width]] * 4, [("a", "")] * 4)
        column = (sheet == (255, 0, 0)).all(-1)[:, sheet.shape[1] // 8]
        assert np.diff(np.flatnonzero(np.diff(column.astype(int)))).max() >= TILE - 1


def test_bars_are_as_high_as_their_values() -> None:
    chart = bar_chart([1.0, 2.0, 4.0], title="x", marked=[False, False, True], first="a", last="c").astype(int)
    blue = (np.abs(chart - [86, 128, 176]).max(axis=-1) == 0).sum()
    red = (np.abs(chart - [200, 84, 60]).max(axis=-1) == 0).sum()
    assert red == pytest.approx(4 / 3 * blue, rel=0.02)
    with pytest.raises(UsageError, match="3 values and 1 marks"):
        bar_chart([1, 2, 3], title="", marked=[True], first="", last="")


def test_refuses(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ends with \.mp4"):
        write_moving(tmp_path / "video.avi", frames(1), rate_hz=30)
    with pytest.raises(UsageError, match="even sides"):
        write_moving(tmp_path / "odd.mp4", [np.zeros((63, 64, 3), np.uint8)], rate_hz=30)
    with pytest.raises(UsageError, match="5 frames and 1 labels"):
        contact_sheet(frames(5), [("a", "b")])
    (tmp_path / "file").write_bytes(b"not a folder, not a video")
    for write in (
        lambda: write_moving(tmp_path / "file" / "x.mp4", frames(1), rate_hz=30),
        lambda: save_png(tmp_path / "file" / "x.png", frames(1)[0]),
        lambda: write_bytes(tmp_path / "file" / "x", b""),
    ):
        with pytest.raises(ResourceError, match="cannot be written"):
            write()
    for load in (decode_all, load_picture, load_sound):
        with pytest.raises(DataError, match="file"):
            load(tmp_path / "file")
    with pytest.raises(UsageError, match="cannot be read"):
        load_sound(tmp_path / "none.wav")
    save_wav(tmp_path / "sound.wav", TONE, 22050)
    with pytest.raises(DataError, match="cannot be decoded as video"):
        decode_all(tmp_path / "sound.wav")
    save_wav(tmp_path / "empty.wav", TONE[:0], 22050)
    with pytest.raises(DataError, match="sound"):
        load_sound(tmp_path / "empty.wav")
