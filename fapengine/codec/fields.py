"""The 73 coded fields of a plane, in the order of the stream, and tracks laid out in them.

Three fields of FAP 1 (select1, select2, blend), four of FAP 2 (select1, intensity1, select2, intensity2), then FAP 3 to
68 (FBA section 8). Beside them run three plain bits: viseme_def, init_face, expression_def.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FIELD_COUNT = 73
VISEME_FIELDS = slice(0, 3)
EXPRESSION_FIELDS = slice(3, 7)
LOW_LEVEL_FIELDS = slice(7, 73)
LOW_LEVEL_COUNT = 66

FIELD_FAPS: tuple[int, ...] = (1, 1, 1, 2, 2, 2, 2, *range(3, fap.FAP_COUNT + 1))
"""FAP number of each field."""
FIELD_NAMES: tuple[str, ...] = (
    "viseme_select1", "viseme_select2", "viseme_blend",
    "expression_select1", "expression_intensity1", "expression_select2", "expression_intensity2",
    *(row.name for row in fap.FAPS),
)  # fmt: skip

GROUPS = fap.GROUPS
"""FAP numbers of the ten groups in which masks are sent (FBA section 4)."""


def rows_of(track: FapTrack) -> tuple[Ints, Ints]:
    """Lay a track out in fields.

    Returns
    -------
    values : (T, 73) int64
    flags : (T, 3) int64
        viseme_def, init_face, expression_def.
    """
    values = np.zeros((len(track), FIELD_COUNT), np.int64)
    values[:, VISEME_FIELDS] = track.visemes[:, :3]
    values[:, EXPRESSION_FIELDS] = track.expressions[:, :4]
    values[:, LOW_LEVEL_FIELDS] = track.values[:, fap.column(3) :]
    flags = np.column_stack([track.visemes[:, 3], track.expressions[:, 4], track.expressions[:, 5]]).astype(np.int64)
    return values, flags


def track_of(
    values: Ints, flags: Ints, mask: Bools, frame_numbers: Ints, *, rate_hz: float, name: str = "decoded"
) -> FapTrack:
    """Undo :func:`rows_of`; what ``mask`` (T, 68) does not select becomes 0."""
    count = len(values)
    out: NDArray[Any] = np.zeros((count, fap.FAP_COUNT), np.int64)
    out[:, fap.column(3) :] = np.where(mask[:, fap.column(3) :], values[:, LOW_LEVEL_FIELDS], 0)
    visemes: NDArray[Any] = np.column_stack([values[:, VISEME_FIELDS], flags[:, :1]]) * mask[:, :1]
    expressions: NDArray[Any] = np.column_stack([values[:, EXPRESSION_FIELDS], flags[:, 1:]]) * mask[:, 1:2]
    return FapTrack(
        values=out, mask=mask, visemes=visemes, expressions=expressions, frame_numbers=frame_numbers,
        rate_hz=rate_hz, name=name,
    )  # fmt: skip
