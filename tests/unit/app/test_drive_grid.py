"""``fapengine drive``: a face moved by a few markers, where it is known how the others follow."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fapengine import lab
from fapengine.app.drive_grid import face_faps
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import load_markers, save_markers
from fapengine.mpeg4 import fap
from tests.command import ran, run
from tests.videos import load_video

RATE_HZ = 50.0
SKULL = {"H1": (60.0, 90.0, 30.0), "H2": (-60.0, 90.0, 30.0), "H3": (0.0, 120.0, 0.0)}


def mask(columns: int, rows: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-60, 60, columns), np.linspace(-80, 60, rows))
    return np.stack([x, y, 70 - x**2 / 60 - y**2 / 400], axis=-1).reshape(-1, 3)


def motion(rest: np.ndarray, frames: int, seed: int) -> np.ndarray:
    """Three muscles, each with its own place, so that three markers tell all."""
    rng = np.random.default_rng(seed)
    times = np.arange(frames) / RATE_HZ
    centres = np.array([[0, -50, 50], [40, -10, 45], [-40, -10, 45]])
    reach = np.exp(-((rest[:, None] - centres) ** 2).sum(axis=-1) / 2500)
    pull = np.sin(times[:, None, None] * rng.uniform(4, 9, (3, 3)) + rng.uniform(0, 6, (3, 3))) * 6
    return np.einsum("mk,tka->tma", reach, pull - pull[:1])


@pytest.fixture
def talk(tmp_path: Path) -> Path:
    rest = mask(6, 7)
    for name, seed in (("talk", 1), ("other", 2)):
        moved = rest + motion(rest, 160, seed)
        turn = 0.1 * np.sin(np.arange(160) / 30)
        everything = np.concatenate([moved, np.tile(np.array([*SKULL.values()]), (160, 1, 1))], axis=1)
        x, z = everything[..., 0].copy(), everything[..., 2].copy()
        everything[..., 0] = x * np.cos(turn)[:, None] + z * np.sin(turn)[:, None]
        everything[..., 2] = z * np.cos(turn)[:, None] - x * np.sin(turn)[:, None]
        if name == "talk":
            everything[40:50, 5] = np.nan
        labels = (*(f"m{n}" for n in range(len(rest))), *SKULL)
        save_markers(tmp_path / f"{name}.npz", MarkerTrack(positions_mm=everything, labels=labels, rate_hz=RATE_HZ))
    return tmp_path / "talk.npz"


def test_three_markers_drive_a_face_of_three_muscles(talk):
    out = talk.with_name("out.npz")
    words = ("drive", talk, "--skull", "H1,H2,H3", "--take", talk.with_name("other.npz"), "-o", out, "--json")
    found = json.loads(ran(*words).stdout)
    assert len(found["markers"]) <= 3
    found = json.loads(ran(*words, "--markers", "3").stdout)
    assert found["mean_mm"] < 0.01 * found["still_mm"]
    assert (found["learned_frames"], found["driven_frames"]) == (160, 160)
    with np.load(out) as arrays:
        assert arrays["driving"].tolist() == found["markers"]
        assert arrays["weights"].shape == (3, 42)
        assert arrays["grid_weights"].shape == (3, found["points"])
        assert np.isfinite(arrays["error_mm"]).all()
        lowest = arrays["positions"][0][:, 1].argmin()
        near = np.linalg.norm(arrays["grid_mm"] - arrays["positions"][0][lowest], axis=1).argmin()
        np.testing.assert_allclose(arrays["grid_weights"][:, near], arrays["weights"][:, lowest], atol=0.1)
    back = load_markers(out).markers
    rest = mask(6, 7)
    moved = motion(rest, 160, 2)
    shown = back.positions_mm - back.positions_mm[:1]
    np.testing.assert_allclose(np.linalg.norm(shown, axis=-1), np.linalg.norm(moved, axis=-1), atol=0.2)


def test_the_laboratory_may_choose_and_the_rest_of_the_take_judges(talk, tmp_path):
    told = run(
        "drive", talk, "--skull", "H1,H2,H3", "--markers", "m8,m1", "-o", tmp_path / "out.npz", "--film",
        tmp_path / "film.mp4", "--size", "64x64",
    )  # fmt: skip
    assert "2 markers drive the face (asked for): m8, m1" in told
    assert "learned from 120 frames; 40 driven" in told
    film = load_video(tmp_path / "film.mp4").frames
    assert len(film) == 40
    assert np.abs(film[0].astype(int) - film[20].astype(int)).max() > 10


def test_a_mesh_is_moved_vertex_by_vertex(tmp_path):
    rest = mask(20, 20)
    at = np.arange(400).reshape(20, 20)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    (tmp_path / "scans").mkdir()
    for number, moved in enumerate(motion(rest, 24, 3)):
        trimesh.Trimesh(rest + moved, triangles, process=False).export(tmp_path / "scans" / f"f{number}.ply")
    words = ("drive", tmp_path / "scans", "--fps", "25", "--markers", "3", "-o", tmp_path / "out.npz", "--json")
    found = json.loads(ran(*words).stdout)
    assert found["points"] == 400
    assert found["mean_mm"] < 0.02 * found["still_mm"]


def test_a_session_drives_and_its_markers_are_edited(talk, tmp_path):
    """Of four takes the last is driven; a marker is scaled, delayed or removed, and no other."""
    folder = tmp_path / "S"
    folder.mkdir()
    for number in range(4):
        moved = mask(6, 7) + motion(mask(6, 7), 60, number)
        save_markers(
            folder / f"t{number}.npz",
            MarkerTrack(positions_mm=moved, labels=tuple(f"m{n}" for n in range(42)), rate_hz=RATE_HZ),
        )
    words = ("drive", folder, "--markers", "m8,m1,m4", "-o", tmp_path / "out.npz", "--json")
    found = json.loads(ran(*words).stdout)
    assert (found["learned_takes"], found["learned_frames"], found["driven_frames"]) == (3, 180, 60)
    plain = load_markers(tmp_path / "out.npz").markers
    run(*words, "--scale", "m8=1.5", "--delay", "m1=40ms", "--remove", "m4")
    edited = load_markers(tmp_path / "out.npz").markers
    moved, changed = (track.positions_mm - plain.positions_mm[:1] for track in (plain, edited))
    np.testing.assert_allclose(changed[:, 8], 1.5 * moved[:, 8], atol=1e-4)
    np.testing.assert_allclose(changed[2:, 1], moved[:-2, 1], atol=1e-4)
    np.testing.assert_allclose(changed[:, 4], 0.0, atol=1e-4)
    driven = lab.drive(lab.read(folder), options=lab.DriveOptions(markers=("m8", "m1", "m4"), scale={"m8": 1.5}))
    assert driven.driving == ("m8", "m1", "m4")
    np.testing.assert_allclose(driven.driving_mm[:, 0], 1.5 * driven.recorded_mm[:, 8], atol=1e-9)
    for option, text, message in (
        ("--scale", "m5=2", "'m5' does not drive the face"), ("--delay", "m8=soon", "must be NAME=NUMBERms"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=message):
            run(*words, option, text)


def test_a_head_shows_what_was_driven(tmp_path):
    """Feature points move a head beside the surface; the marker of the jaw opens its mouth by as much."""
    head, folder = load_head("default"), tmp_path / "S"
    folder.mkdir()
    points = load_profile("grid_s1_en").space.markers
    rest = 0.9 * np.array([head.point_mm(point) for point in points])
    lower = np.isin(points, ("2.1", "2.10", "8.2", "8.7", "8.8"))
    open_mm = 12 * np.sin(np.arange(40) / 10) ** 2
    moved = rest - 0.9 * (open_mm[:, None] * lower)[..., None] * np.array([0.0, 1.0, 0.0])
    labels = tuple(f"m{index}" for index in range(len(points)))
    save_markers(folder / "t.npz", MarkerTrack(positions_mm=moved, labels=labels, rate_hz=RATE_HZ))
    named = "\n".join(f'{label} = "{point}"' for label, point in zip(labels, points, strict=True))
    (folder / "session.toml").write_text(f"[points]\n{named}\n")
    jaw = labels[points.index("2.1")]
    words = ("drive", folder, "--markers", jaw, "-o", tmp_path / "out.npz", "--film", tmp_path / "film.mp4")
    assert "(a head, and the surface with its markers)" in run(*words, "--size", "64x64")
    assert load_video(tmp_path / "film.mp4").frames.shape == (10, 64, 128, 3)
    session = lab.read(folder)
    driven = lab.drive(session, options=lab.DriveOptions(markers=(jaw,)))
    faps = face_faps(driven, session.setup.points, load_profile("grid_s1_en"), head)
    opened = faps[:, fap.column(3)] * load_profile("grid_s1_en").fapu.mns0_mm / 1024
    np.testing.assert_allclose(opened, open_mm[30:], atol=0.1)
    assert face_faps(driven, {}, load_profile("grid_s1_en"), head) is None


def test_what_cannot_drive_is_told(talk, tmp_path):
    skull = ("--skull", "H1,H2,H3")
    track = load_markers(talk).markers
    save_markers(tmp_path / "few.npz", track.select(("m0", "m1", "H1", "H2", "H3")))
    for words, kind, message in (
        (("-o", tmp_path / "a.csv"), UsageError, r"ends with \.npz"),
        ((*skull, "--film", tmp_path / "a.txt"), UsageError, "film: got"),
        ((*skull, "--markers", "nose"), UsageError, "markers: unknown marker 'nose'"),
        ((*skull, "--markers", "99"), UsageError, "fewer than the face has"),
        (("--skull", "H9,H2,H3"), UsageError, "skull: unknown marker 'H9'"),
        ((*skull, "--markers", "m8,m9", "--take", tmp_path / "few.npz"), DataError, "lacks m8, m9"),
    ):
        output = () if "-o" in words else ("-o", tmp_path / "out.npz")
        with pytest.raises(kind, match=message):
            run("drive", talk, *words, *output)
    with pytest.raises(DataError, match="got 2 on the face, a surface needs 4 or more"):
        run("drive", tmp_path / "few.npz", *skull, "-o", tmp_path / "out.npz")
