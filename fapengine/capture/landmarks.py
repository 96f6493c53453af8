"""Landmark tracks of video trackers: the 478-point face mesh as CSV or JSON, and OpenFace's table.

A frame of the face mesh is 468 or 478 points (the last ten are the irises) of x, y, z, normalised: x by the image
width, y downwards by its height, z negative towards the camera and scaled like x. To get millimetres, the image size
and one known distance, between the outer eye corners, must be given.

OpenFace writes a row per frame with columns by name: ``X_0`` .. ``Z_67`` in mm from the camera (right, down, away),
``timestamp`` in s, ``success``, ``gaze_angle_x`` and ``gaze_angle_y`` in rad relative to the camera (to the subject's
left, down), ``AU45_r`` and others 0..5. OpenFace wiki, "Output format"; ``-2Dfp`` alone has no depth and is refused.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.capture.conventions import decode_text, numbers, parse_json, split_rows
from fapengine.capture.marker_track import RawTrack
from fapengine.errors import DataError, TruncatedError, UsageError

COUNTS = (468, 478)
EYE_CORNERS = (33, 263)
"""Outer corners of the right and the left eye."""
_RUNS = (
    (2, 1, (152, 13, 14, 308, 78, 310, 80, 318, 88, 200, 400, 176, 397, 172)),
    (3, 1, (386, 159, 374, 145)),
    (3, 7, (263, 133, 253, 23, 362, 33, 257, 27)),
    (4, 1, (336, 107, 334, 105, 300, 70)),
    (5, 1, (425, 205, 346, 117)),
    (8, 1, (0, 17, 291, 61, 270, 40, 405, 181, 37, 267)),
    (9, 1, (358, 129, 4, 98, 327, 193, 417)),
    (9, 12, (197, 456, 236, 2)),
)
"""Group and number of a feature point, and the landmarks of this and the following points."""
FEATURE_POINTS = {
    landmark: f"{group}.{number}"
    for group, first, landmarks in _RUNS
    for number, landmark in enumerate(landmarks, start=first)
}
"""Landmark to feature point: the nearest vertices of the tracker's canonical face to a head with known points."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Image size and scale, to turn a landmark track into millimetres."""

    width_px: float
    height_px: float
    eye_corners_mm: float
    """Distance between the outer eye corners; about 90 in adults."""
    rate_hz: float

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise UsageError(f"{name}: must be positive, got {value}")


MAX_FRACTION = 1e6
"""Largest coordinate, in widths of an image."""


def parse_landmarks(data: bytes, picture: Picture) -> RawTrack:
    """Read a face-mesh track; frames without a face are gaps.

    Parameters
    ----------
    data : bytes
        CSV with 3 numbers per point after other columns (frame, time ...), or JSON: a list of frames (or one per line),
        each a list of points (``[x, y, z]`` or ``{"x": .., "y": .., "z": ..}``), or an object with such a list as
        ``landmarks``; null or an empty list where no face was found.

    Raises
    ------
    DataError
        If a frame has another number of points; ``where`` is the frame.
    """
    text = decode_text(data, "landmarks").strip()
    frames = _from_json(text) if text[:1] in "[{" else _from_table(text)
    if not len(frames):
        raise TruncatedError("landmarks: contains no frames")
    if np.isnan(frames).all():
        raise DataError("landmarks: no frame contains a face")
    if np.nanmax(np.abs(frames)) > MAX_FRACTION:
        raise DataError(f"landmarks: got {np.nanmax(np.abs(frames)):g}, expected fractions of an image")
    pixels = frames * [picture.width_px, -picture.height_px, -picture.width_px]
    right, left = (pixels[:, corner, :2] for corner in EYE_CORNERS)
    distances = np.linalg.norm(left - right, axis=-1)
    distance = np.median(distances[np.isfinite(distances)]) if np.isfinite(distances).any() else 0.0
    if not distance > 0:
        raise DataError("landmarks: both eye corners are never seen, or at the same position")
    return RawTrack(
        positions=np.where(np.isnan(pixels).any(-1, keepdims=True), np.nan, pixels) * picture.eye_corners_mm / distance,
        labels=tuple(FEATURE_POINTS.get(index, f"face{index}") for index in range(pixels.shape[1])),
        rate_hz=picture.rate_hz,
        units="mm",
        up="+y",
        notes=("points of a video tracker: uncertain by about 0.7 mm on the lips, depth is inferred",),
    )


def _from_table(text: str) -> NDArray[np.float64]:
    rows = [row for row in split_rows(text) if any(row)]
    header = 0 if rows and rows[0][-1].replace(".", "").lstrip("-").isdigit() else 1
    widths = {len(row) for row in rows[header:]}
    count = next((n for n in COUNTS[::-1] if widths and 0 <= max(widths) - 3 * n <= 12), None)
    if count is None:
        raise DataError(
            f"landmarks: must have 3 columns per point, for {COUNTS[0]} or {COUNTS[1]}, got {max(widths, default=0)}",
            where=f"line {header + 1}",
        )
    extra = max(widths) - 3 * count
    body = [row[extra:] for row in rows[header:]]
    return numbers(body, 3 * count, header + 1).reshape(len(body), count, 3)


def _from_json(text: str) -> NDArray[np.float64]:
    whole = parse_json(text, "landmarks")
    frames = whole.get("frames", [whole]) if isinstance(whole, dict) else whole
    if not isinstance(frames, list):
        raise DataError(f"landmarks: must be a list of frames, got {type(frames).__name__}")
    frames_points = [_points(frame, index) for index, frame in enumerate(frames)]
    counts = {len(points) for points in frames_points if points}
    if len(counts) > 1 or not counts <= set(COUNTS):
        raise DataError(f"landmarks: frames must have {COUNTS[0]} or {COUNTS[1]} points, got {sorted(counts)}")
    count = next(iter(counts), COUNTS[1])
    table = np.full((len(frames_points), count, 3), np.nan)
    for index, points in enumerate(frames_points):
        if points:
            table[index] = points
    table[~np.isfinite(table)] = np.nan
    return table


def _points(frame: Any, index: int) -> list[list[float]]:
    points = frame.get("landmarks") if isinstance(frame, dict) else frame
    try:
        rows = [[point[axis] for axis in "xyz"] if isinstance(point, dict) else list(point) for point in points or []]
        if any(len(row) != 3 for row in rows):
            raise ValueError("a point does not have three numbers")
        return [[float(value) for value in row] for row in rows]
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        raise DataError(f"landmarks: not a list of x, y, z: {error}", where=f"frame {index}") from error


OPENFACE_POINTS = 68
OPENFACE_HZ = 30.0
"""Rate of a table without rising times."""
OPENFACE_FEATURE_POINTS: dict[str, tuple[int, ...]] = {
    "2.1": (8,), "8.4": (48,), "8.3": (54,), "8.1": (51,), "8.2": (57,), "8.6": (49,), "8.5": (53,), "8.7": (55,),
    "8.8": (59,), "8.9": (50,), "8.10": (52,), "2.5": (60,), "2.4": (64,), "2.2": (62,), "2.3": (66,), "2.7": (61,),
    "2.6": (63,), "2.8": (65,), "2.9": (67,), "4.6": (17,), "4.4": (19,), "4.2": (21,), "4.1": (22,), "4.3": (24,),
    "4.5": (26,), "3.12": (36,), "3.8": (39,), "3.11": (42,), "3.7": (45,), "3.2": (37, 38), "3.4": (40, 41),
    "3.1": (43, 44), "3.3": (46, 47), "9.15": (33,), "9.2": (31,), "9.1": (35,), "9.3": (30,), "3.6": (36, 39),
    "3.5": (42, 45),
}  # fmt: skip
"""Points whose mean gives each feature point; pupils are taken as the middle between their eye corners."""


@dataclass(frozen=True, slots=True, eq=False)
class OpenFaceTrack:
    """A track from OpenFace."""

    rate_hz: float
    points_mm: Array
    """(T, 68, 3), to the right, down, away from the camera; NaN where the face was lost."""
    gaze_rad: Array | None
    """(T, 2): to the subject's left, and down, relative to the camera."""
    action_units: dict[str, Array]
    """(T,) each, 0..5, by name such as ``AU45``."""


def is_openface(data: bytes) -> bool:
    """Detect OpenFace's table by its header."""
    head = data[:20_000].split(b"\n", 1)[0].lower()
    return b"gaze_angle_x" in head or (b"success" in head and b"confidence" in head)


def parse_openface(data: bytes) -> OpenFaceTrack:
    """Read OpenFace's table.

    Raises
    ------
    TruncatedError
        If there is no frame.
    DataError
        If columns are missing or a cell is not a number; ``where`` is line and column.
    """
    rows = [row for row in split_rows(decode_text(data, "OpenFace")) if any(row)]
    header = [name.strip() for name in rows[0]] if rows else []
    wanted = [f"{axis}_{index}" for index in range(OPENFACE_POINTS) for axis in "XYZ"]
    missing = next((name for name in wanted if name not in header), None)
    if missing is not None:
        raise DataError(
            f"OpenFace: column {missing!r} missing (X_0 to Z_67); run FeatureExtraction with -3Dfp -gaze -aus",
            where="line 1",
        )
    if len(rows) < 2:
        raise TruncatedError("OpenFace: contains no frames", where="line 2")
    table = numbers(rows[1:], len(header), 2)
    points = table[:, [header.index(name) for name in wanted]].reshape(-1, OPENFACE_POINTS, 3)
    if "success" in header:
        points[table[:, header.index("success")] == 0] = np.nan
    times = table[:, header.index("timestamp")] if "timestamp" in header else np.zeros(0)
    gaze = [header.index(name) for name in ("gaze_angle_x", "gaze_angle_y") if name in header]
    units = {name[:4]: index for index, name in enumerate(header) if name[:2] == "AU" and name[4:] == "_r"}
    return OpenFaceTrack(
        rate_hz=_rate_hz(times),
        points_mm=points,
        gaze_rad=np.nan_to_num(table[:, gaze]) if len(gaze) == 2 else None,
        action_units={name: np.clip(np.nan_to_num(table[:, index]), 0.0, 5.0) for name, index in units.items()},
    )


def _rate_hz(times_s: Array) -> float:
    """Mean rate: times have three digits, so a single step of 0.033 s would give 30.3 Hz."""
    times_s = times_s[np.isfinite(times_s)]
    if len(times_s) < 2 or not times_s[-1] > times_s[0]:
        return OPENFACE_HZ
    return float(f"{(len(times_s) - 1) / (times_s[-1] - times_s[0]):.4g}")
