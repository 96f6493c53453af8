"""Tracks of the 478-point face mesh that video trackers write: CSV (a row a frame) and JSON or JSON lines.

A frame is 468 or 478 points (the ten more are the irises) of x, y, z, normalised: x by the picture's width, y downwards
by its height, z towards the camera negative and about as long as x. Millimetres do not follow from that: the picture's
size and one known distance, between the outer eye corners, must be given.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.raw import RawTrack
from fapengine.capture.text import decode_text, numbers, split_rows
from fapengine.errors import DataError, TruncatedError, UsageError

COUNTS = (468, 478)
EYE_CORNERS = (33, 263)
"""Outer corners of the right and the left eye."""
FEATURE_POINTS = {
    152: "2.1",
    13: "2.2",
    14: "2.3",
    308: "2.4",
    78: "2.5",
    310: "2.6",
    80: "2.7",
    318: "2.8",
    88: "2.9",
    200: "2.10",
    400: "2.11",
    176: "2.12",
    397: "2.13",
    172: "2.14",
    386: "3.1",
    159: "3.2",
    374: "3.3",
    145: "3.4",
    263: "3.7",
    133: "3.8",
    253: "3.9",
    23: "3.10",
    362: "3.11",
    33: "3.12",
    257: "3.13",
    27: "3.14",
    336: "4.1",
    107: "4.2",
    334: "4.3",
    105: "4.4",
    300: "4.5",
    70: "4.6",
    425: "5.1",
    205: "5.2",
    346: "5.3",
    117: "5.4",
    0: "8.1",
    17: "8.2",
    291: "8.3",
    61: "8.4",
    270: "8.5",
    40: "8.6",
    405: "8.7",
    181: "8.8",
    37: "8.9",
    267: "8.10",
    358: "9.1",
    129: "9.2",
    4: "9.3",
    98: "9.4",
    327: "9.5",
    193: "9.6",
    417: "9.7",
    197: "9.12",
    456: "9.13",
    236: "9.14",
    2: "9.15",
}
"""Landmark to feature point: the nearest vertices of the tracker's canonical face and a head with known points."""


@dataclass(frozen=True, slots=True)
class Picture:
    """What turns a landmark track into millimetres."""

    width_px: float
    height_px: float
    eye_corners_mm: float
    """Distance between the outer eye corners; about 90 in adults."""
    rate_hz: float

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise UsageError(f"{name}: got {value}, expected a positive number")


def parse_landmarks(data: bytes, picture: Picture) -> RawTrack:
    """Read a track; frames without a face are gaps.

    Parameters
    ----------
    data : bytes
        CSV with 3 numbers for each point behind other columns (frame, time ...), or JSON: a list of frames (or one a
        line), each a list of points (``[x, y, z]`` or ``{"x": .., "y": .., "z": ..}``), or an object that holds it as
        ``landmarks``; null or an empty list where no face was found.

    Raises
    ------
    DataError
        If a frame holds another number of points; ``where`` is the frame.
    """
    text = decode_text(data, "landmarks").strip()
    frames = _from_json(text) if text[:1] in "[{" else _from_table(text)
    if not len(frames):
        raise TruncatedError("landmarks: got no frame, expected some")
    if np.isnan(frames).all():
        raise DataError("landmarks: got no face in any frame, expected some")
    pixels = frames * [picture.width_px, -picture.height_px, -picture.width_px]
    right, left = (pixels[:, corner, :2] for corner in EYE_CORNERS)
    distance = np.nanmedian(np.linalg.norm(left - right, axis=-1))
    if not distance > 0:
        raise DataError("landmarks: got both eye corners at one place, expected a face")
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
            f"landmarks: got {max(widths, default=0)} columns, expected 3 for each of {COUNTS[0]} or {COUNTS[1]}",
            where=f"line {header + 1}",
        )
    extra = max(widths) - 3 * count
    body = [row[extra:] for row in rows[header:]]
    return numbers(body, 3 * count, header + 1).reshape(len(body), count, 3)


def _from_json(text: str) -> NDArray[np.float64]:
    try:
        whole = json.loads(text)
        frames = whole if isinstance(whole, list) else whole.get("frames", [whole])
    except ValueError:
        try:
            frames = [json.loads(line) for line in text.splitlines() if line.strip()]
        except ValueError as error:
            raise DataError(f"landmarks: is neither JSON nor JSON lines: {error}") from error
    except RecursionError as error:
        raise DataError("landmarks: is nested too deeply") from error
    if not isinstance(frames, list):
        raise DataError(f"landmarks: got {type(frames).__name__}, expected a list of frames")
    frames_points = [_points(frame, index) for index, frame in enumerate(frames)]
    counts = {len(points) for points in frames_points if points}
    if len(counts) > 1 or not counts <= set(COUNTS):
        raise DataError(f"landmarks: got frames of {sorted(counts)} points, expected {COUNTS[0]} or {COUNTS[1]}")
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
            raise ValueError("a point has not three numbers")
        return [[float(value) for value in row] for row in rows]
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        raise DataError(f"landmarks: got no points of x, y, z: {error}", where=f"frame {index}") from error
