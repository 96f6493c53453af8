"""A dense face moved by recorded markers and by FAPs, against faces whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, ProfileError, UsageError
from fapengine.laboratory.dense_face import make_dense_head, moved_by_modes, poses
from fapengine.laboratory.dense_file import ARRAYS_NAME, TOML_NAME, format_dense, format_rig, parse_dense, parse_rig
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import HEAD, deform
from fapengine.mpeg4 import fap

from .dense_made import MOVING, SKULL


@pytest.fixture(scope="module")
def placed(made):
    return make_dense_head(made.dense, build_head())


@pytest.mark.parametrize(("way", "most_mm"), [("estimator", 0.005), ("modes", 0.02)])
def test_a_take_moves_the_dense_face_as_the_true_one_moved(made, way, most_mm):
    track, truth = made.take()
    driven = made.dense.driver().follow(track, way)
    still = np.linalg.norm(truth - made.dense.neutral_face_mm, axis=-1)
    off = np.linalg.norm(made.dense.faces_mm(driven.weights) - truth, axis=-1)[:, still.max(axis=0) > 1.0]
    still = still[:, still.max(axis=0) > 1.0]
    assert off.mean() < most_mm < 0.02 * still.mean()
    assert not driven.notes


def test_the_head_goes_back_to_where_it_was(made):
    track, _ = made.take(gaps=False)
    driven = made.dense.driver().follow(track)
    moved = np.einsum("tij,tmj->tmi", driven.head.rotation, driven.markers_mm) + driven.head.translation_mm[:, None]
    at = [track.labels.index(name) for name in made.labels]
    pairs = (moved[:, :, None] - moved[:, None]), (track.positions_mm[:, at, None] - track.positions_mm[:, None, at])
    np.testing.assert_allclose(*(np.linalg.norm(pair, axis=-1) for pair in pairs), atol=1e-6)
    room = track.positions_mm[:, at] - track.positions_mm[:1, at]  # paths are as long as in the room
    np.testing.assert_allclose(np.linalg.norm(moved - moved[:1], axis=-1), np.linalg.norm(room, axis=-1), atol=1e-6)


def test_markers_that_are_not_there_are_filled_and_told(made):
    track, truth = made.take(gaps=False)
    fewer = track.select([name for name in track.labels if name not in ("8.2", "2.10")])
    driven = made.dense.driver().follow(fewer)
    assert driven.notes == ("2 markers are not in the take, and filled: 2.10, 8.2",)
    assert np.linalg.norm(made.dense.faces_mm(driven.weights) - truth, axis=-1).mean() < 0.1


def test_takes_that_show_another_face_are_refused(made):
    track, _ = made.take()
    driver = made.dense.driver()
    for labels, message in (
        (made.labels, "missing LFHD, RFHD, LBHD, RBHD of the skull's markers"),
        (tuple(SKULL), "contains none of the face's markers"),
        ((*made.labels[:4], *SKULL), "median frame shows"),
    ):
        with pytest.raises(DataError, match=message):
            driver.follow(track.select(labels))
    with pytest.raises(UsageError, match="expected estimator or modes"):
        driver.follow(track, "both")


def test_files_bring_the_face_back(made):
    files = format_dense(made.dense)
    back = parse_dense(files)
    assert (back.labels, back.points, back.subject) == (made.labels, made.dense.points, "made")
    np.testing.assert_allclose(back.neutral_face_mm, made.dense.neutral_face_mm, atol=1e-3)
    np.testing.assert_allclose(back.take_weights["one"], made.dense.take_weights["one"], atol=1e-5)
    np.testing.assert_array_equal(back.paint.texture, made.dense.paint.texture)
    track, _ = made.take()
    ours, theirs = (face.driver().follow(track) for face in (made.dense, back))
    np.testing.assert_allclose(ours.weights, theirs.weights, atol=1e-3)


def test_damaged_files_are_told(made):
    files = format_dense(made.dense)
    for change, message in (
        ({TOML_NAME: b"schema = 9\n"}, "schema"),
        ({ARRAYS_NAME: files[ARRAYS_NAME][:-9]}, "sha256"),
        ({TOML_NAME: files[TOML_NAME] + b"more = 1\n"}, "more"),
    ):
        with pytest.raises(ProfileError, match=message):
            parse_dense(files | change)
    with pytest.raises(ProfileError, match=r"expected dense\.npz"):
        parse_dense({TOML_NAME: files[TOML_NAME]})
    for data in (b"", b"PK\x03\x04", files[ARRAYS_NAME]):  # the last has other arrays
        with pytest.raises(ProfileError):
            parse_rig(data, "x")
    with pytest.raises(UsageError, match="must have vertices"):
        replace(made.dense, triangles=[[0, 1, 10**6]])
    with pytest.raises(UsageError, match="points: got 1"):
        replace(made.dense, points=("8.1",))


def test_feature_points_are_found_where_they_are(made, placed):
    imported, _ = placed
    source = imported.placed.kept[[*imported.mesh.feature_points.values()]]
    expected = [made.head.feature_points[name] for name in imported.mesh.feature_points]
    off = np.linalg.norm(made.head.vertices_mm[made.used[source]] - made.head.vertices_mm[expected], axis=1)
    assert np.median(off) < 0.1
    assert off.max() < 4.0


def test_faps_move_their_points_on_the_dense_head(made, placed):
    mesh = placed[0].mesh
    for number, most in MOVING.items():
        faps = np.zeros(fap.FAP_COUNT)
        faps[fap.column(number)] = most
        row = fap.spec(number)
        moved = deform(mesh, faps)[mesh.feature_points[row.point]] - mesh.point_mm(row.point)
        wanted = most * mesh.fapu.unit(row.unit) * np.array(fap.HEAD_AXES[row.positive])
        np.testing.assert_allclose(moved @ wanted / (wanted @ wanted), 1.0, atol=0.05, err_msg=str(number))


def test_poses_of_a_take_are_the_estimated_face_in_the_heads_space(made, placed):
    imported, rig = placed
    track, _ = made.take(gaps=False)
    driven = made.dense.driver().follow(track)
    mesh = moved_by_modes(imported.mesh, rig)
    frame, pose = 17, poses(rig, driven)[17]
    shown = mesh.vertices_mm + np.tensordot(pose.weights, mesh.basis.entry_mm.reshape(-1, len(rig.names), 3), (0, 1))
    shown = shown @ pose.bones[HEAD, :3, :3].T + pose.bones[HEAD, :3, 3]
    face = made.dense.faces_mm(driven.weights[frame])[imported.placed.kept]
    face = face @ driven.head.rotation[frame].T + driven.head.translation_mm[frame]
    np.testing.assert_allclose(shown, rig.scale * face @ rig.axes.T + rig.origin_mm, atol=1e-2)
    assert (poses(rig, driven, still_head=True)[17].bones[HEAD] == np.eye(4)).all()
    back = parse_rig(format_rig(rig), "x")
    np.testing.assert_allclose(back.head_transforms(driven.head), rig.head_transforms(driven.head))
    with pytest.raises(UsageError, match="vertices"):
        moved_by_modes(made.head, rig)


def test_a_head_without_skull_markers_stands_in_the_sessions_room(made):
    turned = replace(made.dense, reference=replace(made.dense.reference, labels=(), markers_mm=np.zeros((0, 3))))
    _, truth = made.take()
    at = [int(np.flatnonzero(made.used == made.head.feature_points[name])[0]) for name in made.labels]
    track = MarkerTrack(positions_mm=truth[:, at], labels=made.labels, rate_hz=50.0)
    driven = turned.driver().follow(track)
    assert np.linalg.norm(made.dense.faces_mm(driven.weights) - truth, axis=-1).mean() < 0.1
