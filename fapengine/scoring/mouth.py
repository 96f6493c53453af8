"""``Mouth``: what the measures look at, in mm and rad, from a track of FAPs.

Whoever made a motion, and for whatever face, it is shown by one adult (:data:`fapengine.retarget.blend.ADULT`), so that
millimetres of two recordings mean the same. All lengths count from the face at rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ADULT

Array = NDArray[np.float64]

LIP_POINTS = tuple(
    f"{group}.{number}"
    for group, last in ((2, 9), (8, 8))
    for number in range(1, last + 1)
    if (group, number) != (2, 1)
)
"""Feature points of the lips that FAPs move: 2.2 to 2.9 inside, 8.1 to 8.8 outside."""
LID_FAPS = ((19, 21), (20, 22))
"""Upper and lower lid, left and right; together they close the eye by a lid distance, 1024 steps."""
HEAD_FAPS = (48, 49, 50)
"""Pitch, yaw, roll."""


@dataclass(frozen=True, slots=True, eq=False)
class Mouth:
    """A mouth, two lids and a head over time. Arrays are read-only."""

    times_s: Array
    """(T,) s, rising, from 0."""
    lips_mm: Array
    """(T, 16, 3) mm: how far each of :data:`LIP_POINTS` is from its place at rest."""
    opening_mm: Array
    """(T,) mm between the inner lips; negative where they are pressed together."""
    width_mm: Array
    """(T,) mm between the corners."""
    lower_mm: Array
    """(T,) mm: height of the lower lip's inner edge."""
    shut: Array
    """(T, 2): how far the left and the right eye are shut, 0..1."""
    head_rad: Array
    """(T, 3) rad: pitch, yaw, roll."""

    def __post_init__(self) -> None:
        count = len(self.times_s)
        for name, shape in (
            ("times_s", (count,)), ("lips_mm", (count, len(LIP_POINTS), 3)), ("opening_mm", (count,)),
            ("width_mm", (count,)), ("lower_mm", (count,)), ("shut", (count, 2)), ("head_rad", (count, 3)),
        ):  # fmt: skip
            object.__setattr__(self, name, frozen(getattr(self, name), name, shape, np.float64))

    @property
    def end_s(self) -> float:
        """Time of the last frame."""
        return float(self.times_s[-1])

    def at(self, times_s: ArrayLike) -> "Mouth":
        """Look at other times, (N,) s: between frames linearly, outside at the first and the last."""
        wanted = np.asarray(times_s, dtype=np.float64)

        def moved(values: Array) -> Array:
            flat = values.reshape(len(values), -1)
            columns = [np.interp(wanted, self.times_s, column) for column in flat.T]
            return np.stack(columns, axis=1).reshape(len(wanted), *values.shape[1:])

        return Mouth(
            wanted, moved(self.lips_mm), moved(self.opening_mm), moved(self.width_mm), moved(self.lower_mm),
            moved(self.shut), moved(self.head_rad),
        )  # fmt: skip


def mouth_of(track: FapTrack, *, offset_s: float = 0.0) -> Mouth:
    """Look at a track.

    Parameters
    ----------
    track : FapTrack
        Two frames or more.
    offset_s : float
        Time at which its first frame is shown; frames before 0 are left out.

    Raises
    ------
    UsageError
        If fewer than two frames are left.
    """
    times_s = track.times_s - (track.times_s[0] if len(track) else 0.0) + offset_s
    kept = times_s >= -1e-9
    if kept.sum() < 2:
        raise UsageError(f"track: got {int(kept.sum())} frames from 0 s on, expected two or more")
    values = track.values[kept].astype(np.float64)
    moved = values * ADULT.steps()

    def column(number: int) -> Array:
        found: Array = moved[:, fap.column(number)]
        return found

    lips = np.zeros((len(values), len(LIP_POINTS), 3))
    for row in fap.FAPS:
        if row.point in LIP_POINTS:
            lips[:, LIP_POINTS.index(row.point)] += column(row.number)[:, None] * np.array(fap.HEAD_AXES[row.positive])
    closing = [values[:, fap.column(upper)] + values[:, fap.column(lower)] for upper, lower in LID_FAPS]
    return Mouth(
        times_s[kept],
        lips,
        -(column(4) + column(5)),
        column(6) + column(7),
        column(5),
        np.clip(np.stack(closing, axis=1) / 1024, 0.0, 1.0),
        np.stack([column(number) for number in HEAD_FAPS], axis=1),
    )
