"""FAPs off points whose motion is known: a tracker without errors, on our own head."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.capture.held_face import FACE_68, FACE_MESH, FACE_MESH_468, hold_face
from fapengine.capture.landmarks import FEATURE_POINTS, is_openface, parse_openface
from fapengine.capture.landmarks import OPENFACE_FEATURE_POINTS as OPENFACE_POINTS
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.laboratory.watched import WatchedFace, faps_of_points, openface_faps, resting_face, watched_faps
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.blend_tracks import parse_blend_track

RATE_HZ, FRAMES = 30.0, 240
SPEAKS = slice(60, 200)


def values(track, number):
    return track.values[:, fap.column(number)]


@pytest.fixture(scope="module")
def motion():
    """Opening of the mouth in mm, a blink, looks in rad, and turns of the head, frame by frame."""
    time = np.arange(FRAMES) / RATE_HZ
    opening, blink = np.zeros(FRAMES), np.zeros(FRAMES)
    opening[SPEAKS] = 6 * np.sin(np.linspace(0, 8 * np.pi, 140)) ** 2
    blink[100:106] = 1.0
    look = 0.2 * np.sin(1.7 * time)
    turns = Rotation.from_euler("YXZ", np.stack([0.15 * np.sin(time), 0.08 * np.sin(2 * time), 0 * time], 1))
    return opening, blink, look, turns


@pytest.fixture(scope="module")
def places(face_mm, motion):
    """Feature points of the moving face, (T, 3) mm each, before the head turns."""
    opening, blink, *_ = motion
    points = {name: np.tile(place, (FRAMES, 1)) for name, place in face_mm.items()}
    for name in ("2.3", "8.2", "2.1", "2.8", "2.9", "8.7", "8.8", "2.10"):
        points[name][:, 1] -= opening
    for upper, lower in (("3.1", "3.3"), ("3.2", "3.4")):
        points[upper][:, 1] -= blink * (face_mm[upper][1] - face_mm[lower][1])
    return points


def in_picture(head_mm, turns):
    """Head axes to pixels: turned, to the right, down, away, and moved."""
    return 3.0 * np.einsum("tij,tnj->tni", turns.as_matrix(), head_mm) * [1, -1, -1] + [320, 240, 900]


@pytest.fixture(scope="module")
def mesh(places, face_mm, motion):
    """Landmarks of the face mesh: those that are feature points move, the steady ones lie on an ellipsoid."""
    _, _, look, turns = motion
    rng = np.random.default_rng(0)
    found = np.tile(rng.normal(0, 40, (FACE_MESH.count, 3)) * [1, 1.4, 0.5], (FRAMES, 1, 1))
    for index, name in FEATURE_POINTS.items():
        if name in places:
            found[:, index] = places[name]
    found[:, 10] = (0.0, 90.0, 60.0)
    for iris, corners in ((468, ("3.12", "3.8")), (473, ("3.7", "3.11"))):
        middle = (face_mm[corners[0]] + face_mm[corners[1]]) / 2
        radius = 12 / 62 * np.linalg.norm(face_mm["3.5"] - face_mm["3.6"])
        found[:, iris] = middle + np.stack([radius * np.sin(look), 0 * look, 0 * look], axis=1)
    return in_picture(found, turns)


def check_mouth_and_head(track, motion):
    opening, _, _, turns = motion
    assert np.corrcoef(-values(track, 5), opening)[0, 1] > 0.999
    assert np.corrcoef(values(track, 3), opening)[0, 1] > 0.999
    assert np.abs(values(track, 18)).max() <= 20  # the chin goes with the jaw
    yaw, pitch, _ = turns.as_euler("YXZ").T
    assert np.abs(values(track, 49) * AU_RAD - yaw).max() < 0.01
    assert np.abs(values(track, 48) * AU_RAD - (pitch - np.median(pitch))).max() < 0.01


def test_landmarks_become_faps(mesh, motion):
    times = np.arange(FRAMES) / RATE_HZ
    track = watched_faps(hold_face(times, mesh, pupils_mm=62.0), RATE_HZ)
    check_mouth_and_head(track, motion)
    _, blink, look, _ = motion
    for number in (19, 20):
        np.testing.assert_allclose(values(track, number)[blink == 0], 0, atol=30)
        np.testing.assert_allclose(values(track, number)[blink == 1], 1024, atol=40)
    shown = blink == 0
    for number in (23, 24):
        assert np.abs(values(track, number) * AU_RAD - (look - np.median(look)))[shown].max() < 0.03
        assert np.abs(np.diff(values(track, number)[98:108] * AU_RAD)).max() < 0.02  # it goes on through the blink


def test_a_mesh_without_irises_has_no_gaze(mesh, motion):
    times = np.arange(FRAMES) / RATE_HZ
    track = watched_faps(hold_face(times, mesh[:, :468], pupils_mm=62.0, model=FACE_MESH_468), RATE_HZ)
    check_mouth_and_head(track, motion)
    assert not values(track, 23).any()


def test_frames_without_a_face_lie_between_their_neighbours(mesh):
    times = np.arange(FRAMES) / RATE_HZ
    lost = mesh.copy()
    lost[20:23] = np.nan
    held = hold_face(times, lost, pupils_mm=62.0)
    assert held.seen.sum() == FRAMES - 3
    assert np.isfinite(watched_faps(held, RATE_HZ).values).all()
    lost[10:] = np.nan
    with pytest.raises(DataError, match="only 10 of 240 frames show a face"):
        hold_face(times, lost, pupils_mm=62.0)


def openface_table(places, motion, *, lost=()):
    _, blink, look, turns = motion
    points = np.tile(np.random.default_rng(1).normal(0, 40, (68, 3)), (FRAMES, 1, 1))
    for name, rows in OPENFACE_POINTS.items():
        if name in places and name not in ("3.5", "3.6"):
            points[:, list(rows)] = places[name][:, None]
    points[:, [27, 28, 29]] = [(0, 20, 75), (0, 12, 80), (0, 5, 85)]
    points[:, [30]] = (0, -2, 90)
    points[:, [0, 16]] = [(-70, 10, 0), (70, 10, 0)]
    seen = in_picture(points, turns) / 3.0
    yaw, pitch, _ = turns.as_euler("YXZ").T
    header = ["frame", "timestamp", "confidence", "success", "gaze_angle_x", "gaze_angle_y"]
    header += [f"{axis}_{n}" for axis in "XYZ" for n in range(68)] + ["AU45_r", "AU06_r"]
    rows = [
        [
            n,
            n / RATE_HZ,
            0.98,
            int(n not in lost),
            look[n] + yaw[n],
            pitch[n],
            *seen[n].T.ravel(),
            4 * blink[n],
            2.5 * (n >= 200),
        ]
        for n in range(FRAMES)
    ]
    return "\n".join([", ".join(header), *(", ".join(f"{value:.3f}" for value in row) for row in rows)]).encode()


def test_openface_is_read(places, motion):
    data = openface_table(places, motion, lost=(5, 6))
    assert is_openface(data)
    table = parse_openface(data)
    assert table.rate_hz == RATE_HZ
    assert np.isnan(table.points_mm[5]).all()
    track = openface_faps(table)
    check_mouth_and_head(track, motion)
    _, blink, look, _ = motion
    assert (values(track, 19)[blink == 1] >= 840).all()
    assert np.corrcoef(values(track, 23), look)[0, 1] > 0.99
    assert hold_face(np.arange(FRAMES), table.points_mm, pupils_mm=62.0, model=FACE_68).still_mm.shape == (240, 68, 3)


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (b"frame, success, confidence, x_0\n1, 1, 1, 2\n", DataError, "column 'X_0' missing"),
        (b", ".join(f"{a}_{n}".encode() for n in range(68) for a in "XYZ") + b"\n", TruncatedError, "no frame"),
    ],
)
def test_openface_that_cannot_be_read(data, error, message):
    with pytest.raises(error, match=message):
        parse_openface(data)


def test_points_that_measure_no_face_are_refused(places):
    turns = np.tile(np.eye(3), (FRAMES, 1, 1))
    with pytest.raises(UsageError, match=r"missing 9\.15"):
        faps_of_points({name: place for name, place in places.items() if name != "9.15"}, turns, RATE_HZ)
    with pytest.raises(DataError, match="cannot be measured"):
        faps_of_points({name: np.zeros_like(place) for name, place in places.items()}, turns, RATE_HZ)


SCORES = {"jawOpen": 0.5, "eyeBlinkLeft": 1.0, "eyeBlinkRight": 0.0, "mouthSmileLeft": 0.1, "mouthSmileRight": 0.1,
          "browInnerUp": 0.0, "mouthFunnel": 0.0, "mouthPucker": 0.0, "_neutral": 0.0}  # fmt: skip


@pytest.mark.parametrize(
    "frames",
    [
        [SCORES, SCORES],
        [{"time": 0.0, "blendshapes": SCORES}, {"time": 0.04, "blendshapes": SCORES}],
        [[{"categoryName": name, "score": score} for name, score in SCORES.items()]] * 2,
        {"frames": [{"timestamp_ms": n * 40, "faceBlendshapes": [[{"categoryName": k, "score": v}
                     for k, v in SCORES.items()]]} for n in range(2)]},
    ],
)  # fmt: skip
def test_mediapipe_scores_are_read(frames):
    track = parse_blend_track(json.dumps(frames).encode())
    assert len(track) == 2
    assert track.rate_hz == (25.0 if "time" in json.dumps(frames) else 30.0)
    assert values(track, 19)[0] > 700 > 100 > values(track, 20)[0]
    assert values(track, 3)[0] > 500


def test_what_are_no_scores_is_told_in_words():
    with pytest.raises(DataError, match="expected scores by name, or Azure's FrameIndex"):
        parse_blend_track(b'[{"blendshapes": [1, 2]}]')
    with pytest.raises(DataError, match="names of arkit in the header"):
        parse_blend_track(b'[[{"categoryName": "jawOpen", "score": 1}]]')


def watched_live(mesh, *, lost=()):
    """FAPs at the time of each frame, and the face that gave them."""
    face = WatchedFace()
    shown = []
    for number, points in enumerate(mesh):
        face.see(number / RATE_HZ, np.full_like(points, np.nan) if number in lost else points)
        shown.append(face.faps(number / RATE_HZ))
    return face, np.array(shown)


def test_a_face_that_is_watched_now_moves_like_one_in_a_film(mesh, motion):
    face, shown = watched_live(mesh)
    assert face.is_known
    assert face.calibrations == 1 + int((FRAMES / RATE_HZ - 1.5) / 3.0)
    assert not shown[: int(1.5 * RATE_HZ)].any()  # at rest until its neutral pose is known
    film = watched_faps(hold_face(np.arange(FRAMES) / RATE_HZ, mesh, pupils_mm=62.0), RATE_HZ).values
    settled = slice(75, None)  # 2.5 s: it is known, and has eased in
    for number in (3, 5, 19, 20, 23, 24, 49):
        one, other = (track[settled, fap.column(number)].astype(float) for track in (shown, film))
        least = 0.9 if number in (23, 24) else 0.999  # straight ahead is the median of what was seen so far
        assert np.corrcoef(one, other)[0, 1] > least, number
    off = np.abs(shown - film)[settled]
    assert off[:, [fap.column(number) for number in (3, 5)]].max() < 25  # of 300: the same places, another neutral pose
    assert off[:, fap.column(49)].max() * AU_RAD < 0.01


def test_a_face_that_begins_with_an_open_mouth_is_at_rest_later(mesh):
    still = np.tile(mesh[:1], (240, 1, 1))
    open_mouth = still[:60].copy()
    open_mouth[:, list(FEATURE_POINTS)] += mesh[69, list(FEATURE_POINTS)] - mesh[0, list(FEATURE_POINTS)]
    face, shown = watched_live(np.concatenate([open_mouth, still]))
    opening = -shown[:, fap.column(5)]
    assert opening[70:100].min() < -60  # the open mouth was taken for rest
    assert face.calibrations >= 3
    assert abs(opening[-60:]).max() < 12
    assert np.abs(np.diff(opening[65:])).max() < 25  # and nothing jumps


def test_a_face_that_is_lost_eases_to_rest_and_back(mesh):
    whole = watched_live(mesh)[1]
    lost = watched_live(mesh, lost=range(120, 180))[1]
    missed = watched_live(mesh, lost=(120, 121))[1]
    np.testing.assert_array_equal(missed[:120], whole[:120])
    assert np.abs(missed[122:134] - whole[122:134]).max() <= 1  # two frames: nothing is seen of it
    turned = fap.column(49)
    np.testing.assert_array_equal(lost[121:125, turned], lost[120, turned])
    assert not lost[120 + int(0.8 * RATE_HZ) : 180].any()
    assert np.abs(np.diff(lost[118:, turned])).max() < 2.5 * np.abs(lost[120, turned]) / (0.5 * RATE_HZ)
    settled = 180 + int(0.6 * RATE_HZ)
    assert np.abs(lost[settled:, turned] - whole[settled:, turned]).max() * AU_RAD < 0.02
    never = WatchedFace()
    never.see(0.0, np.full((FACE_MESH.count, 3), np.nan))
    assert not never.faps(10.0).any()
    with pytest.raises(UsageError, match="landmarks"):
        never.see(1.0, np.zeros((68, 3)))


def test_two_frames_are_enough_for_lids(places):
    few = {name: place[[0, 103]] for name, place in places.items()}  # one open, one shut: none near the quantile
    rest = resting_face(few, np.tile(np.eye(3), (2, 1, 1)), RATE_HZ)
    assert np.isfinite(rest.points["3.1"]).all()
    assert rest.points["3.1"][1] > rest.points["3.3"][1]


def test_openface_lifts_the_cheeks_by_its_action_unit(places, motion):
    table = parse_openface(openface_table(places, motion))
    track = openface_faps(table)
    assert set(table.action_units) == {"AU06", "AU45"}
    for number in (41, 42):
        assert not values(track, number)[:200].any()
        assert (values(track, number)[200:] > 0).all()
    half = values(track, 41)[-1]
    most = openface_faps(replace(table, action_units={"AU06": np.full(FRAMES, 5.0)}))
    assert values(most, 41)[-1] == pytest.approx(2 * half, abs=2)
    assert not values(openface_faps(replace(table, action_units={})), 41).any()
