"""The steps from tracked points to speech data: on made input, and, where it is there, on the recorded data."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from design import make_speech_data as steps
from fapengine.errors import DataError, UsageError

POINTS = np.random.default_rng(4).normal(0, 40, (478, 3)) * [1.0, 1.2, 0.6]
LIPS = (13, 14)
EYES_MM = 89.2


def opening(frames: int) -> np.ndarray:
    """(T, 478, 3) mm: the lips part and meet, all else rests; the last third is silent."""
    moves = np.zeros((frames, 478, 3))
    gap = np.maximum(np.sin(np.linspace(0, 3 * np.pi, frames)), 0) * (np.arange(frames) < 2 * frames // 3)
    moves[:, LIPS[0], 1], moves[:, LIPS[1], 1] = 4 * gap, -8 * gap
    return moves


def test_a_name_spells_its_sentence() -> None:
    assert steps.text_of("swiz9a") == "set white in z nine again"
    for name in ("bbaf2", "bbaw2n", "xbaf2n"):
        with pytest.raises(DataError, match=name):
            steps.text_of(name)


def test_deltas_come_back_within_half_a_step_and_do_not_drift() -> None:
    moves = np.cumsum(np.random.default_rng(1).normal(0, 0.3, (75, 229, 3)), axis=0)
    deltas = np.concatenate([steps.encode_deltas(moves), steps.encode_deltas(-moves[:40])], axis=1)
    assert deltas.shape == (687, 115)
    back = steps.decode_deltas(deltas, [75, 40])
    assert np.abs(back - np.concatenate([moves, -moves[:40]])).max() <= steps.STEP_MM / 2 + 1e-9


def test_head_motion_and_size_go_and_the_lips_stay() -> None:
    moves, rng = opening(60), np.random.default_rng(2)
    apart = np.linalg.norm(POINTS[steps.EYE_CORNERS[1]] - POINTS[steps.EYE_CORNERS[0]])
    rest = POINTS * EYES_MM / apart
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (60, 3)))
    head = np.einsum("tij,tmj->tmi", turns.as_matrix(), rest + moves) + rng.normal(0, 30, (60, 1, 3))
    pixels = head * [0.7, -0.7, -0.7]
    points, poses = steps.remove_head_motion(steps.scale_to_mm(pixels, EYES_MM), rest[list(steps.RIGID)])
    np.testing.assert_allclose(points, rest + moves, atol=1e-6)
    np.testing.assert_allclose(poses, turns.as_rotvec(), atol=1e-9)
    assert len(set(steps.RIGID)) == 26


def test_the_bias_of_turned_heads_goes_by_what_silence_shows() -> None:
    moves, rng = opening(300), np.random.default_rng(3)
    poses = rng.normal(0, 0.2, (300, 3))
    bias = (steps.pose_features(poses) @ rng.normal(0, 2, (10, 478 * 3))).reshape(300, 478, 3)
    silent = np.abs(moves).max(axis=(1, 2)) == 0
    found, rest = steps.remove_pose_bias(POINTS + moves + bias, poses, silent)
    np.testing.assert_allclose(found, moves, atol=1e-6)
    np.testing.assert_allclose(rest, (POINTS + bias)[silent].mean(axis=0), atol=1e-9)
    with pytest.raises(DataError, match="silent frames: got 3, expected at least 20"):
        steps.remove_pose_bias(POINTS + moves, poses, np.arange(300) < 3)


def test_weights_come_back_and_stay_in_their_box() -> None:
    rng = np.random.default_rng(5)
    fields = rng.normal(0, 3, (12, 80, 3))
    wanted = rng.uniform(0, 1, (20, 12))
    moves = np.tensordot(wanted, fields, axes=1)
    importance = np.where(np.arange(80) < 20, steps.LIP_WEIGHT, 1.0)
    np.testing.assert_allclose(steps.solve_weights(moves, fields, importance), wanted, atol=0.01)
    boxed = steps.solve_weights(3 * moves, fields, importance)
    assert boxed.min() >= 0
    assert boxed.max() <= 1
    assert np.abs(steps.solve_weights(moves, fields, importance, ridge=1e6)).max() < 0.01


def test_silence_keeps_its_distance_from_phones() -> None:
    silent = steps.frames_in([("sil", 0, 1), ("B", 1, 1.2), ("sil", 1.2, 3)], 75, 25.0)
    assert np.flatnonzero(~silent).tolist() == list(range(23, 33))


def test_frames_without_a_face_are_bridged() -> None:
    points = np.tile(np.arange(5.0)[:, None, None], (1, 478, 3))
    points[2] = np.nan
    np.testing.assert_allclose(steps.fill_gaps(points, "x")[2], 2.0)
    with pytest.raises(DataError, match="no frame with a face"):
        steps.fill_gaps(np.full((5, 478, 3), np.nan), "x")


def test_the_whole_of_assemble_on_made_tracks(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    apart = np.linalg.norm(POINTS[steps.EYE_CORNERS[1]] - POINTS[steps.EYE_CORNERS[0]])
    rest = (POINTS * EYES_MM / apart)[:468]
    field = opening(75)[12:13, :468]
    np.savez(
        tmp_path / "face.npz", vertices=rest, mediapipe468=np.arange(468), expr=field, expr_names=np.array(["open"])
    )
    rows = [f"berger209,{n},{n},{n},0,0,0,{'lip' if n in LIPS else ''}" for n in range(209)]
    (tmp_path / "layouts.csv").write_text(
        "\n".join(["layout,marker,vertex,mediapipe,x_mm,y_mm,z_mm,description", *rows])
    )
    for name in ("bbaf2n", "lgwm5s"):
        turns = Rotation.from_rotvec(rng.normal(0, 0.02, (75, 3))).as_matrix()
        head = np.einsum("tij,tmj->tmi", turns, POINTS * EYES_MM / apart + opening(75))
        np.savez(tmp_path / f"{name}.points.npz", points_px=head * [1.0, -1.0, -1.0], rate_hz=25.0)
        (tmp_path / f"{name}.phones.json").write_text(json.dumps([["B", 0.0, 2.0], ["sil", 2.0, 3.0]]))
    output = tmp_path / "speech.npz"
    face, layouts = tmp_path / "face.npz", tmp_path / "layouts.csv"
    assert (
        steps.main(["assemble", str(tmp_path), "--face", str(face), "--layouts", str(layouts), "-o", str(output)]) == 0
    )
    data = np.load(output)
    assert data["text"].tolist() == ["bin blue at f two now", "lay green with m five soon"]
    moves = steps.decode_deltas(data["marker_delta"], data["n_frames"])
    np.testing.assert_allclose(moves[:75, LIPS[0]], opening(75)[:, LIPS[0]], atol=0.1)
    np.testing.assert_allclose(data["ict_w"][:75, 0], np.minimum(opening(75)[:, 13, 1] / field[0, 13, 1], 1), atol=0.05)


def test_what_is_missing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert steps.main(["phones", str(tmp_path)]) == 2
    assert "expected the videos of one GRID speaker" in capsys.readouterr().err
    (tmp_path / "bbaf2n.mpg").touch()
    assert steps.main(["track", str(tmp_path), "--detector", str(tmp_path / "python")]) == 2
    assert "expected a Python with mediapipe" in capsys.readouterr().err
    assert steps.main(["assemble", str(tmp_path), "--face", "x.npz", "--layouts", "y.csv"]) == 2
    assert "run track and phones" in capsys.readouterr().err
    with pytest.raises(UsageError, match="mpg"):
        steps.find_videos(tmp_path / "none")


@pytest.mark.shared
def test_the_recorded_data_have_this_layout(shared: Path) -> None:
    """Its deltas come back, its points are those that are kept, its weights are what the solver finds."""
    data = np.load(shared / "data" / "speech_train.npz")
    moves = steps.decode_deltas(data["marker_delta"][:, :1500], data["n_frames"][:20])
    again = [steps.encode_deltas(clip) for clip in np.split(moves, 20)]
    np.testing.assert_array_equal(np.concatenate(again, axis=1), data["marker_delta"][:, :1500])
    chosen, is_lip = steps.read_layouts(shared / "data" / "markers.csv")
    np.testing.assert_array_equal(chosen, data["marker_mediapipe"])
    np.testing.assert_array_equal(is_lip, data["marker_is_lip"])
    assert [steps.text_of(str(name)) for name in data["ids"]] == data["text"].tolist()
    face = np.load(shared / "data" / "dense_face.npz")
    kept = chosen < 468
    fields = face["expr"][:, face["mediapipe468"][chosen[kept]]].astype(np.float64)
    weights = steps.solve_weights(moves[::15][:, kept], fields, np.where(is_lip[kept], steps.LIP_WEIGHT, 1.0))
    lips = is_lip[kept]
    left, theirs = (
        np.linalg.norm((np.tensordot(w, fields, axes=1) - moves[::15][:, kept])[:, lips, :2], axis=-1).mean()
        for w in (weights, data["ict_w"][:1500:15].astype(np.float64))
    )
    assert left < 1.1 * theirs
