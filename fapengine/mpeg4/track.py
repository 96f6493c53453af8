"""``FapTrack``: FAP values over time, the type that all parts of fapengine exchange.

Remarks on tracks whose values look wrong, as by another unit: :func:`motion_remarks`.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Rebuilt, frozen
from fapengine._strict_toml import check_value, checked
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FapTrack(Rebuilt):
    """FAP values over time, in FAPU; independent of any face. Arrays are read-only.

    Build one from low-level values with :meth:`from_values`; the constructor takes every field.
    """

    values: NDArray[np.int32]
    """(T, 68) int32, FAPU (AU for angles). Column ``fap.column(n)`` is FAP ``n``. Columns of FAP 1 and 2 are 0: their
    values are ``visemes`` and ``expressions``."""
    mask: NDArray[np.bool_]
    """(T, 68) bool: the FAP is sent in this frame."""
    visemes: NDArray[np.int32]
    """(T, 4) int32, FAP 1: viseme_select1 0..14, viseme_select2 0..14, viseme_blend 0..63, viseme_def 0..1."""
    expressions: NDArray[np.int32]
    """(T, 6) int32, FAP 2: expression_select1 0..6, expression_intensity1 0..63, expression_select2 0..6,
    expression_intensity2 0..63, init_face 0..1, expression_def 0..1."""
    frame_numbers: NDArray[np.int64]
    """(T,) int64, strictly rising; gaps are skipped frames."""
    rate_hz: float
    """Frame rate."""
    name: str = "fapengine"
    """Free text of the ``.fap`` header."""
    remarks: tuple[str, ...] = ()
    """Sentences on what looks wrong or was assumed when it was read from a file."""
    __array_ufunc__ = None  # a NumPy number times a track is a track, too

    def __post_init__(self) -> None:
        for field, kind in (("rate_hz", float), ("name", str), ("remarks", tuple[str, ...])):
            check_value(field, getattr(self, field), kind)
        count = _rows(self.values)
        for field, shape, dtype in (
            ("values", (count, fap.FAP_COUNT), np.int32),
            ("mask", (count, fap.FAP_COUNT), np.bool_),
            ("visemes", (count, 4), np.int32),
            ("expressions", (count, 6), np.int32),
            ("frame_numbers", (count,), np.int64),
        ):
            object.__setattr__(self, field, frozen(getattr(self, field), field, shape, dtype))
        if not 0 < self.rate_hz < np.inf:
            raise UsageError(f"rate_hz: must be positive, got {self.rate_hz}")
        if count and (np.diff(self.frame_numbers) <= 0).any():
            raise UsageError("frame_numbers: must be strictly rising")
        if self.values[:, : fap.column(3)].any():
            raise UsageError("values: columns of FAP 1 and 2 must be 0; their values go into visemes and expressions")

    @classmethod
    @checked
    def from_values(cls, values: ArrayLike, *, rate_hz: float, name: str = "fapengine") -> "FapTrack":
        """Make a track of the 66 low-level FAPs, all sent, without visemes and expressions.

        Parameters
        ----------
        values : (T, 68) array_like of int, FAPU
            Columns of FAP 1 and 2 must be 0.
        rate_hz : float
            Frame rate.
        """
        count = _rows(values)
        mask = np.ones((count, fap.FAP_COUNT), dtype=bool)
        mask[:, : fap.column(3)] = False
        return cls(
            values=np.asarray(values),
            mask=mask,
            visemes=np.zeros((count, 4), np.int32),
            expressions=np.zeros((count, 6), np.int32),
            frame_numbers=np.arange(count),
            rate_hz=rate_hz,
            name=name,
        )

    @classmethod
    @checked
    def pose(cls, *, rate_hz: float = 25.0, **faps: int) -> "FapTrack":
        """Make a track of one frame from FAPs by name; all others are 0.

        Parameters
        ----------
        rate_hz : float
            Frame rate.
        **faps : int, FAPU (AU for angles)
            As Table C.1 names them: ``open_jaw=300``.

        Raises
        ------
        UsageError
            If there is no FAP of that name.

        Examples
        --------
        >>> int(FapTrack.pose(open_jaw=300).values[0, fap.column(3)])
        300
        """
        values = np.zeros((1, fap.FAP_COUNT), np.int32)
        for name, value in faps.items():
            check_value(name, value, int)
            values[0, fap.column(fap.by_name(name).number)] = value
        return cls.from_values(values, rate_hz=rate_hz)

    def __len__(self) -> int:
        return len(self.values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the values: ``np.asarray(track)`` is (T, 68) int32, FAPU."""
        wanted = self.values.astype(dtype, copy=False)
        return wanted.copy() if copy else wanted

    def __repr__(self) -> str:
        return f"FapTrack({len(self)} frames, {self.duration_s:.2f} s at {self.rate_hz:g} Hz, {self.name!r})"

    def __getitem__(self, frames: slice) -> "FapTrack":
        """Return some frames, as ``track[10:20]``: those of these rows. The first becomes frame 0."""
        check_value("frames", frames, slice)
        if frames.step not in (None, 1):
            raise UsageError(f"frames: got a step of {frames.step}, expected 1")
        try:
            numbers = self.frame_numbers[frames]
        except TypeError as error:
            raise UsageError(f"frames: got {frames}, expected whole numbers; cut() takes seconds") from error
        return replace(
            self, values=self.values[frames], mask=self.mask[frames], visemes=self.visemes[frames],
            expressions=self.expressions[frames], frame_numbers=numbers - numbers[:1].sum(),
        )  # fmt: skip

    @checked
    def cut(self, start_s: float, end_s: float) -> "FapTrack":
        """Return the frames that are shown from one time until before another."""
        if not 0 <= start_s < end_s:
            raise UsageError(f"start_s, end_s: got {start_s} and {end_s} s, expected 0 <= start_s < end_s")
        first, last = np.searchsorted(self.times_s, (start_s - 1e-9, end_s - 1e-9))
        return self[int(first) : int(last)]

    def __add__(self, after: "FapTrack") -> "FapTrack":
        """Join two tracks of one rate: the second begins a frame after the last of the first."""
        check_value("+", after, FapTrack)
        if after.rate_hz != self.rate_hz:
            raise UsageError(f"+: got {self.rate_hz:g} and {after.rate_hz:g} Hz, expected one rate")
        begins = self.frame_numbers[-1:].sum() + (len(self) > 0)
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(after, name)])
            for name in ("values", "mask", "visemes", "expressions")
        }
        numbers = np.concatenate([self.frame_numbers, after.frame_numbers - after.frame_numbers[:1].sum() + begins])
        return replace(self, frame_numbers=numbers, **joined)

    def __mul__(self, factor: float) -> "FapTrack":
        """Scale the low-level FAPs; they are rounded, and limited as :func:`to_codable` does."""
        check_value("*", factor, float)
        return replace(self, values=to_codable(np.asarray(self.values * float(factor), np.float64)))

    __rmul__ = __mul__

    @checked
    def blend(self, other: "FapTrack", weight: float) -> "FapTrack":
        """Mix with a track of as many frames: its low-level FAPs count ``weight``, 0..1, and these the rest."""
        if len(other) != len(self) or other.rate_hz != self.rate_hz:
            raise UsageError(f"other: got {other!r}, expected {len(self)} frames at {self.rate_hz:g} Hz")
        if not 0 <= weight <= 1:
            raise UsageError(f"weight: got {weight}, expected 0 to 1")
        mixed = to_codable((1 - weight) * self.values + weight * other.values)
        mask = self.mask | other.mask
        mask[:, : fap.column(3)] = self.mask[:, : fap.column(3)]
        return replace(self, values=mixed, mask=mask)

    @checked
    def column(self, name: str) -> NDArray[np.int32]:
        """(T,) int32, FAPU: values of a FAP by the name of Table C.1, such as ``"open_jaw"``."""
        return self.values[:, fap.column(fap.by_name(name).number)]

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the end of the last."""
        return float(self.frame_numbers[-1] - self.frame_numbers[0] + 1) / self.rate_hz if len(self) else 0.0

    @property
    def times_s(self) -> NDArray[np.float64]:
        """(T,) float64, s: time at which each frame is shown."""
        return self.frame_numbers / self.rate_hz

    def filled_values(self) -> NDArray[np.int32]:
        """(N, 68) int32, FAPU: a row for every frame from the first to the last; skipped ones repeat the last row."""
        numbers = self.frame_numbers
        every = np.arange(numbers[0], numbers[-1] + 1) if len(self) else numbers
        return self.values[np.searchsorted(numbers, every, side="right") - 1]

    def equals(self, other: "FapTrack") -> bool:
        """Whether values, masks, frame numbers and rate are equal; name and remarks do not count."""
        check_value("other", other, FapTrack)
        return self.rate_hz == other.rate_hz and all(
            np.array_equal(getattr(self, field), getattr(other, field))
            for field in ("values", "mask", "visemes", "expressions", "frame_numbers")
        )


def _rows(values: ArrayLike) -> int:
    try:
        return len(np.asarray(values))
    except (TypeError, ValueError) as error:
        raise UsageError(f"values: got {values!r:.60}, expected (T, 68) numbers") from error


def to_codable(faps: NDArray[np.float64]) -> NDArray[np.int32]:
    """Round and clip to the range of the standard's default intra planes: (T, 68) int32.

    FAPs that act in one direction only (3, 14, 41, 42, 47) do not go below 0.
    """
    low, high = _codable_range()
    return np.rint(np.minimum(np.maximum(faps, low), high)).astype(np.int32)  # np.clip takes three times as long


@cache
def limits(number: int) -> tuple[float, float]:
    """Smallest and largest value of a FAP after :func:`to_codable`, FAPU."""
    low, high = _codable_range()
    return float(low[fap.column(number)]), float(high[fap.column(number)])


@cache
def _codable_range() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low = np.zeros(fap.FAP_COUNT)
    high = np.zeros(fap.FAP_COUNT)
    for row in fap.FAPS:
        limit = row.intra_limit * row.quantiser_step
        low[fap.column(row.number)] = -limit if row.bidirectional else 0
        high[fap.column(row.number)] = limit
    low.flags.writeable = high.flags.writeable = False
    return low, high


MOUTH = fap.columns(*range(3, 19), *range(51, 61))
"""Columns of jaw, lips and chin."""
UPPER_LIP, LOWER_LIP = fap.columns(4, 5)
FAPU_STEPS = 1024
"""Steps of a distance of the face."""
STILL_FAPU = 16
"""Largest movement of a mouth that cannot be seen: 0.3 mm of an adult face."""
APART_FAPU, APART_S = 94, 2.0
"""Distance of lips that do not meet, 2 mm, and length of speech in which lips meet: read English closes them 2 to 3
times a second."""
LIMIT_SHARE = 0.2
"""Share of frames at a limit of the standard from which the unit is doubtful."""


def motion_remarks(track: FapTrack) -> tuple[str, ...]:
    """Remark on a track that does not move, moves too little or too much, or whose lips never meet.

    Examples
    --------
    >>> motion_remarks(FapTrack.pose(open_jaw=3))
    ('motion: the mouth moves by 3 FAPU at most (0.3 % of a distance of the face); is the unit right?',)
    """
    values = track.values
    largest = int(np.abs(values[:, MOUTH]).max(initial=0))
    if not len(track):
        return ()
    if not (values.any() or track.visemes.any() or track.expressions.any()):
        return (f"motion: no FAP moves in {len(track)} frames",)
    if 0 < largest < STILL_FAPU:
        share = 100 * largest / FAPU_STEPS
        return (f"motion: the mouth moves by {largest} FAPU at most ({share:.1f} % of a distance of the face); is the"
                " unit right?",)  # fmt: skip
    remarks = []
    highest = np.array([limits(column + 1)[1] for column in MOUTH])
    share = float((np.abs(values[:, MOUTH]) >= highest).any(axis=1).mean())
    if share >= LIMIT_SHARE:
        remarks.append(
            f"motion: in {100 * share:.0f} % of the frames the mouth is at a limit of the standard; is the unit right?"
        )
    least = int((-values[:, UPPER_LIP] - values[:, LOWER_LIP]).min())
    if least > APART_FAPU and track.duration_s >= APART_S:
        remarks.append(
            f"motion: the lips never meet in {track.duration_s:.1f} s, and stay {100 * least / FAPU_STEPS:.0f} % of the"
            " distance from mouth to nose apart"
        )
    return tuple(remarks)
