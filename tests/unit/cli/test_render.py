"""The command render: FAPs in, every kind of picture out."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fapengine
from fapengine.codec.encoder import encode
from fapengine.errors import UsageError
from fapengine.files.motion import save_fap
from fapengine.files.pictures import load_picture
from fapengine.files.provenance import SYNTHETIC
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from tests import command
from tests.videos import load_video

FRAMES = 5


def run(*words: object) -> str:
    return command.run("render", *words, "--size", "96x64")


@pytest.fixture(scope="module")
def opening() -> FapTrack:
    """A jaw and a lower lip that go down frame by frame."""
    values = np.zeros((FRAMES, 68), dtype=np.int64)
    values[:, fap.column(3)] = values[:, fap.column(5)] = np.arange(FRAMES) * 150
    values[:, fap.column(5)] *= -1
    return FapTrack.from_values(values, rate_hz=25.0)


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


def test_the_mark_of_synthetic_images_can_be_left_out(fap_file: Path, tmp_path: Path) -> None:
    run(fap_file, "-o", tmp_path / "on.png")
    run(fap_file, "--without", "provenance", "-o", tmp_path / "off.png")
    fapengine.save(fapengine.load(fap_file), tmp_path / "saved.png", size=(64, 64), provenance=False)
    marked = {path.name for path in tmp_path.iterdir() if SYNTHETIC.encode() in path.read_bytes()}
    assert marked == {"on.png"}


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


def test_several_faces_stand_side_by_side(fap_file: Path, tmp_path: Path, opening: FapTrack) -> None:
    """A second track at half the rate: its frames are shown twice."""
    save_fap(tmp_path / "slow.fap", FapTrack.from_values(opening.values[::2], rate_hz=12.5))
    run(fap_file, tmp_path / "slow.fap", "-o", tmp_path / "both_%d.png")
    run(fap_file, "-o", tmp_path / "one_%d.png")
    for number, shown in enumerate((0, 0, 2, 2, 4)):
        both = load_picture(tmp_path / f"both_{number}.png").astype(int)
        assert both.shape == (64, 192, 3)
        for half, moment in ((both[:, :96], number), (both[:, 96:], shown)):
            alone = load_picture(tmp_path / f"one_{moment}.png").astype(int)
            assert np.abs(half - alone)[:, 4:-4].mean() < 0.5
    assert (tmp_path / "both_5.png").exists()  # the slow track lasts longer


def test_one_track_on_two_heads(fap_file: Path, tmp_path: Path) -> None:
    run(fap_file, "--head", "default", "--head", "default", "-o", tmp_path / "two.png")
    two = load_picture(tmp_path / "two.png").astype(int)
    assert two.shape == (64, 192, 3)
    assert np.abs(two[:, :92] - two[:, 96:188]).mean() < 0.5


def test_the_camera_walks_round(fap_file: Path, tmp_path: Path) -> None:
    run(fap_file, "--turntable", 0.16, "-o", tmp_path / "turn")
    run(fap_file, "--camera", "profile", "-o", tmp_path / "side_%d.png")
    walk = [load_picture(tmp_path / "turn" / f"frame_{number:04d}.png").astype(int) for number in range(FRAMES)]
    side = load_picture(tmp_path / "side_1.png").astype(int)
    assert np.abs(walk[1] - side).mean() < 0.5  # a quarter of the way after 0.04 s
    assert np.abs(walk[2] - side).mean() > 3


def test_backgrounds(fap_file: Path, tmp_path: Path) -> None:
    run(fap_file, "-b", "#f08", "-o", tmp_path / "flat.png")
    assert np.abs(load_picture(tmp_path / "flat.png")[2, 2].astype(int) - (255, 0, 136)).max() <= 1
    run(fap_file, "-b", tmp_path / "flat.png", "-o", tmp_path / "again.png")
    assert np.abs(load_picture(tmp_path / "again.png")[2, 2].astype(int) - (255, 0, 136)).max() <= 2
    run(fap_file, "-b", "none", "-o", tmp_path / "clear.png")
    with Image.open(tmp_path / "clear.png") as image:
        clear = np.asarray(image)
    assert clear.shape == (64, 96, 4)
    assert clear[2, 2].tolist() == [0, 0, 0, 0]
    edge = (clear[..., 3] > 40) & (clear[..., 3] < 200)
    assert edge.any()
    run(fap_file, "-b", "#000000", "-o", tmp_path / "black.png")
    black = load_picture(tmp_path / "black.png").astype(float)
    over_black = clear[..., :3] * (clear[..., 3:] / 255)
    assert np.abs(over_black - black).mean() < 1.0  # composed as other programs do it


def test_edges(fap_file: Path, tmp_path: Path) -> None:
    for edges in ("fine", "soft"):
        run(fap_file, "--antialias", edges, "-o", tmp_path / f"{edges}.png")
    fine, soft = (load_picture(tmp_path / f"{edges}.png").astype(int) for edges in ("fine", "soft"))
    assert 0.1 < np.abs(fine - soft).mean() < 4


def test_wire_and_sheet(fap_file: Path, tmp_path: Path) -> None:
    run(fap_file, "--wireframe", "-o", tmp_path / "wire.png")
    run(fap_file, "-o", tmp_path / "bare.png")
    wire, bare = (load_picture(tmp_path / f"{name}.png").astype(int).mean() for name in ("wire", "bare"))
    assert wire < bare - 3
    assert "3 moments" in run(fap_file, "--contact-sheet", 3, "-o", tmp_path / "sheet.png")
    sheet = load_picture(tmp_path / "sheet.png")
    assert sheet.shape[1] == 2 * 16 + 3 * 288 + 2 * 8


def test_refuses_what_does_not_fit(fap_file: Path, tmp_path: Path) -> None:
    for words, message in (
        (("-b", "#12345"), "--background: got '#12345', expected a colour"),
        (("-b", "nowhere.png"), "--background: got 'nowhere.png', expected studio, none"),
        (("-b", "none", "-o", "a.mp4"), "--background: got none, but .mp4 has no alpha"),
        (("--contact-sheet", 3), "--contact-sheet: requires a .png output"),
        ((fap_file, fap_file, "--head", "a", "--head", "b"), "--head: got 2; give one, or one for each of the 3"),
        ((fap_file, "--head", "a", "--head", "b", "--head", "c"), "track: got 2"),
    ):
        with pytest.raises(UsageError, match=re.escape(message)):
            run(fap_file, *words)


def test_refuses(fap_file: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"a\.avi; use .*\.mp4.*\.gif, \.webp, .* or \.png"):
        run(fap_file, "-o", tmp_path / "a.avi")
    for name in ("a.gif", "a.webp", "a.png", "%d.png"):
        with pytest.raises(UsageError, match="cannot contain sound"):
            run(fap_file, "-o", tmp_path / name, "--audio", tmp_path / "none.wav")
    with pytest.raises(UsageError, match=r"--at: 9\.0 s is past the end; the track lasts 0\.16 s"):
        run(fap_file, "-o", tmp_path / "a.png", "--at", 9)
    assert [path.name for path in tmp_path.iterdir()] == ["in.fap"]
