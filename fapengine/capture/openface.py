"""OpenFace's table: a row a frame, with 68 points in 3-D, the gaze and action units of one face.

Columns by name: ``X_0`` .. ``Z_67`` in mm from the camera (right, down, away), ``timestamp`` in s, ``success``,
``gaze_angle_x`` and ``gaze_angle_y`` in rad against the camera (to the subject's left, down), ``AU45_r`` and others
0..5. OpenFace wiki, "Output format"; ``-2Dfp`` alone has no depth and is refused.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.text import decode_text, numbers, split_rows
from fapengine.errors import DataError, TruncatedError

Array = NDArray[np.float64]

POINTS = 68
DEFAULT_HZ = 30.0
"""Rate of a table without rising times."""
FEATURE_POINTS: dict[str, tuple[int, ...]] = {
    "2.1": (8,), "8.4": (48,), "8.3": (54,), "8.1": (51,), "8.2": (57,), "8.6": (49,), "8.5": (53,), "8.7": (55,),
    "8.8": (59,), "8.9": (50,), "8.10": (52,), "2.5": (60,), "2.4": (64,), "2.2": (62,), "2.3": (66,), "2.7": (61,),
    "2.6": (63,), "2.8": (65,), "2.9": (67,), "4.6": (17,), "4.4": (19,), "4.2": (21,), "4.1": (22,), "4.3": (24,),
    "4.5": (26,), "3.12": (36,), "3.8": (39,), "3.11": (42,), "3.7": (45,), "3.2": (37, 38), "3.4": (40, 41),
    "3.1": (43, 44), "3.3": (46, 47), "9.15": (33,), "9.2": (31,), "9.1": (35,), "9.3": (30,), "3.6": (36, 39),
    "3.5": (42, 45),
}  # fmt: skip
"""Points whose mean each feature point is; pupils are taken for the middle of their eye's corners."""


@dataclass(frozen=True, slots=True, eq=False)
class OpenFaceTrack:
    """What OpenFace saw."""

    rate_hz: float
    points_mm: Array
    """(T, 68, 3), to the right, down, away from the camera; NaN where the face was lost."""
    gaze_rad: Array | None
    """(T, 2): to the subject's left, and down, against the camera."""
    action_units: dict[str, Array]
    """(T,) each, 0..5, by name such as ``AU45``."""


def is_openface(data: bytes) -> bool:
    """Tell OpenFace's table by its header."""
    head = data[:20_000].split(b"\n", 1)[0].lower()
    return b"gaze_angle_x" in head or (b"success" in head and b"confidence" in head)


def parse_openface(data: bytes) -> OpenFaceTrack:
    """Read a table.

    Raises
    ------
    TruncatedError
        If there is no frame.
    DataError
        If columns are missing or a cell is no number; ``where`` is line and column.
    """
    rows = [row for row in split_rows(decode_text(data, "OpenFace")) if any(row)]
    header = [name.strip() for name in rows[0]] if rows else []
    wanted = [f"{axis}_{index}" for index in range(POINTS) for axis in "XYZ"]
    missing = next((name for name in wanted if name not in header), None)
    if missing is not None:
        raise DataError(
            f"OpenFace: got no column {missing!r}, expected X_0 .. Z_67: run FeatureExtraction with -3Dfp -gaze -aus",
            where="line 1",
        )
    if len(rows) < 2:
        raise TruncatedError("OpenFace: got a header and no frame", where="line 2")
    table = numbers(rows[1:], len(header), 2)
    points = table[:, [header.index(name) for name in wanted]].reshape(-1, POINTS, 3)
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
    """Mean rate: times have three digits, so that a single step of 0.033 s would say 30.3 Hz."""
    times_s = times_s[np.isfinite(times_s)]
    if len(times_s) < 2 or not times_s[-1] > times_s[0]:
        return DEFAULT_HZ
    return float(f"{(len(times_s) - 1) / (times_s[-1] - times_s[0]):.4g}")
