"""Tracks of the 478-point face mesh."""

import json

import numpy as np
import pytest

from fapengine.capture.conventions import understand
from fapengine.capture.landmarks import EYE_CORNERS, FEATURE_POINTS, Picture, parse_landmarks
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES

PICTURE = Picture(width_px=640, height_px=480, eye_corners_mm=90.0, rate_hz=30.0)


def face(frames: int = 3) -> np.ndarray:
    shares = np.random.default_rng(2).uniform(0.3, 0.7, (frames, 478, 3)).round(6)
    shares[:, EYE_CORNERS[0]] = [0.4, 0.45, 0.0]
    shares[:, EYE_CORNERS[1]] = [0.6, 0.45, 0.0]
    return shares


def as_csv(shares: np.ndarray) -> bytes:
    header = "frame,time," + ",".join(f"{axis}{n}" for n in range(478) for axis in "xyz")
    rows = [f"{n},{n / 30}," + ",".join(map(repr, map(float, row.ravel()))) for n, row in enumerate(shares)]
    return "\n".join([header, *rows]).encode()


def points(shares: np.ndarray) -> list:
    return [[dict(zip("xyz", point, strict=True)) for point in frame] for frame in shares.tolist()]


@pytest.mark.parametrize(
    "spell",
    [
        as_csv,
        lambda s: json.dumps(s.tolist()).encode(),
        lambda s: json.dumps({"frames": [{"landmarks": frame} for frame in points(s)]}).encode(),
        lambda s: "\n".join(json.dumps({"t": 1, "landmarks": frame}) for frame in points(s)).encode(),
    ],
)
def test_every_spelling_gives_millimetres(spell):
    shares = face()
    track, notes = understand(parse_landmarks(spell(shares), PICTURE))
    right, left = (track.positions_mm[:, corner] for corner in EYE_CORNERS)
    assert np.linalg.norm(left - right, axis=-1) == pytest.approx(90.0)
    assert (left[:, 0] > right[:, 0]).all()
    scale = 90.0 / (0.2 * 640)
    np.testing.assert_allclose(track.positions_mm[1, 7], shares[1, 7] * [640, -480, -640] * scale)
    assert "0.7 mm" in notes[0]
    assert track.rate_hz == 30.0


def test_frames_without_a_face_are_gaps():
    shares = face().tolist()
    shares[1] = None
    track = understand(parse_landmarks(json.dumps(shares).encode(), PICTURE))[0]
    assert track.valid.all(axis=1).tolist() == [True, False, True]


def test_landmarks_are_named_after_feature_points():
    assert set(FEATURE_POINTS.values()) <= set(FEATURE_POINT_NAMES)
    assert len(set(FEATURE_POINTS.values())) == len(FEATURE_POINTS) >= 55
    assert FEATURE_POINTS[152] == "2.1"
    assert FEATURE_POINTS[13] == "2.2"


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (b"[]", TruncatedError, "no frame"),
        (b"[null]", DataError, "landmarks: no frame contains a face"),
        (b"{", DataError, "neither JSON nor JSON lines"),
        (b"{}\n" + b"[" * 200_000, DataError, "nested too deeply"),
        (b'{"frames": 3}', DataError, "landmarks: must be a list of frames, got int"),
        (b"[[[1, 2]]]", DataError, "frame 0"),
        (b'[[[1, 2, "x"]]]', DataError, "frame 0"),
        (b"[[[1, 2, 3]]]", DataError, r"landmarks: frames must have 468 or 478 points, got \[1\]"),
        (b"[" * 100_000, DataError, "nested|neither"),
        (b"1,2,3\n", DataError, r"landmarks: must have 3 columns per point, for 468 or 478, got 3"),
        (
            json.dumps(np.zeros((1, 468, 3)).tolist()).encode(),
            DataError,
            "or at the same position",
        ),
    ],
)
def test_what_is_no_track_is_refused(data, error, message):
    with pytest.raises(error, match=message):
        parse_landmarks(data, PICTURE)


def test_a_picture_has_a_size():
    with pytest.raises(UsageError, match="width_px: must be positive, got 0"):
        Picture(width_px=0, height_px=480, eye_corners_mm=90.0, rate_hz=30.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("corner", "message"), [(1e299, r"got 1e\+299, expected fractions"), (np.nan, "corners are never seen")]
)
def test_eyes_that_are_nowhere_are_refused(corner: float, message: str) -> None:
    shares = face()
    shares[:, EYE_CORNERS[0]] = corner
    with pytest.raises(DataError, match=message):
        parse_landmarks(json.dumps(shares.tolist()).encode(), PICTURE)
