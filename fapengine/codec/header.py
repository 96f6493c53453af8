"""The plane header: values, and their bits both ways (FBA sections 2, 4 and 5)."""

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from fapengine.codec.bits import BitReader, BitWriter
from fapengine.codec.fields import GROUPS, LOW_LEVEL_COUNT, Bools, SentRanges
from fapengine.codec.kernels import SKIP_LIMIT
from fapengine.errors import ConformanceError, UnsupportedError, UsageError
from fapengine.mpeg4 import fap

FACE, BODY = 1, 2
"""Bits of the object mask."""
LIST_MARKER_EVERY = 4


@dataclass(frozen=True, slots=True)
class FrameRate:
    """Frames a second: ``whole + sixteenths / 16``, times 1000/1001 where ``ntsc``."""

    whole: int
    sixteenths: int = 0
    ntsc: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.whole <= 255 and 0 <= self.sixteenths <= 15 and (self.whole or self.sixteenths)):
            raise UsageError(f"frame rate: got {self.whole} + {self.sixteenths}/16, expected 1/16 to 255 15/16")

    @property
    def hz(self) -> float:
        """Frames a second."""
        rate = self.whole + Fraction(self.sixteenths, 16)
        return float(rate * Fraction(1000, 1001) if self.ntsc else rate)

    @classmethod
    def nearest(cls, rate_hz: float) -> "FrameRate":
        """Find the rate that can be sent nearest to ``rate_hz``.

        Examples
        --------
        >>> FrameRate.nearest(29.97)
        FrameRate(whole=30, sixteenths=0, ntsc=True)
        """
        choices = []
        for ntsc in (False, True):
            steps = round(rate_hz * (1.001 if ntsc else 1.0) * 16)
            if 1 <= steps <= 255 * 16 + 15:
                choices.append(cls(steps // 16, steps % 16, ntsc))
        best = min(choices, key=lambda rate: abs(rate.hz - rate_hz), default=None)
        if best is None or abs(best.hz - rate_hz) > 0.01 * rate_hz:
            raise UsageError(f"rate_hz: got {rate_hz}, expected a rate near a multiple of 1/16 up to 255.94")
        return best


@dataclass(frozen=True, slots=True)
class TimeCode:
    """Time of an I plane."""

    hours: int
    minutes: int
    seconds: int

    def __post_init__(self) -> None:
        if not (0 <= self.hours < 24 and 0 <= self.minutes < 60 and 0 <= self.seconds < 60):
            raise UsageError(f"time code: got {self.hours}:{self.minutes}:{self.seconds}, expected 0:0:0 to 23:59:59")

    @property
    def total_s(self) -> int:
        """Seconds since 0:0:0."""
        return 3600 * self.hours + 60 * self.minutes + self.seconds


@dataclass(frozen=True, slots=True)
class PlaneStart:
    """What an I plane begins with, whatever it carries."""

    objects: int
    """:data:`FACE`, :data:`BODY` or both."""
    rate: FrameRate | None
    time_code: TimeCode | None
    skip: int


@dataclass(frozen=True, slots=True, eq=False)
class IntraHeader:
    """What only I planes carry, for a face."""

    quant: int
    """fap_quant, 0..31."""
    mask: Bools
    """(68,) bool: coded FAPs."""
    mask_types: tuple[int, ...]
    """(10,) 0..3, one a group."""
    gender: int = 0
    ranges: SentRanges = field(default_factory=SentRanges)
    rate: FrameRate | None = None
    time_code: TimeCode | None = None
    skip: int = 0


def mask_types_of(mask: Bools, unsent: int = 1) -> tuple[int, ...]:
    """Choose the shortest mask types: 3 for whole groups, 0 for empty ones (values kept), else ``unsent``."""
    types = []
    for group in GROUPS:
        coded = [bool(mask[fap.column(number)]) for number in group]
        types.append(3 if all(coded) else unsent if any(coded) or unsent == 2 else 0)
    return tuple(types)


def write_intra_header(header: IntraHeader, out: BitWriter) -> None:
    """Append everything from ``is_intra`` to the ranges."""
    out.write(1, 1)
    out.write(FACE, 2)
    out.write(header.rate is not None, 1)
    if header.rate is not None:
        out.write(header.rate.whole, 8)
        out.write(header.rate.sixteenths, 4)
        out.write(header.rate.ntsc, 1)
    out.write(header.time_code is not None, 1)
    if header.time_code is not None:
        out.write(header.time_code.hours, 5)
        out.write(header.time_code.minutes, 6)
        out.write(1, 1)
        out.write(header.time_code.seconds, 6)
    write_skip(header.skip, out)
    out.write(header.quant, 5)
    for group, kind in zip(GROUPS, header.mask_types, strict=True):
        out.write(1, 1)
        out.write(kind, 2)
        if kind in (1, 2):
            for number in group:
                out.write(header.mask[fap.column(number)], 1)
    out.write(header.gender, 1)
    out.write(0, 1)  # predictive, not DCT
    lists = header.ranges.lists
    for magnitudes in lists:
        out.write(magnitudes is not None, 1)
    for magnitudes in lists:
        if magnitudes is not None:
            for index, marker in _list_places():
                if marker:
                    out.write(1, 1)
                if header.mask[index + 2]:
                    out.write(int(magnitudes[index]), 5)


def write_skip(skip: int, out: BitWriter) -> None:
    """Append the skip flag and its numbers: 15 means that another follows (FBA section 10)."""
    out.write(skip > 0, 1)
    while skip >= 15:
        out.write(15, 4)
        skip -= 15
        if skip < 15:
            out.write(skip, 4)
            return
    if skip:
        out.write(skip, 4)


def _list_places() -> list[tuple[int, bool]]:
    """Index 0..65 of each FAP, and whether a marker bit comes before it."""
    return [(number - 3, nth % LIST_MARKER_EVERY == 0) for group in GROUPS[1:] for nth, number in enumerate(group)]


def read_skip(reader: BitReader) -> int:
    """Read the skip flag and its numbers."""
    if not reader.read(1, "skip_frames"):
        return 0
    total, part = 0, 15
    while part == 15:
        part = reader.read(4, "number_of_frames_to_skip")
        total += part
        if total > SKIP_LIMIT:
            raise ConformanceError(f"frames to skip: got more than {SKIP_LIMIT}", where=reader.where())
    return total


def read_plane_start(reader: BitReader) -> PlaneStart:
    """Read what follows ``is_intra`` = 1, up to the fields of the face or of the body."""
    where = reader.where()
    objects = reader.read(2, "fba_object_mask")
    if not objects:
        raise ConformanceError("fba_object_mask: got 0, expected 1 to 3", where=where, clause="FBA section 2")
    rate = _read_rate(reader) if reader.read(1, "is_frame_rate") else None
    time_code = _read_time_code(reader) if reader.read(1, "is_time_code") else None
    return PlaneStart(objects, rate, time_code, read_skip(reader))


def read_face_header(reader: BitReader, start: PlaneStart) -> IntraHeader:
    """Read the fields of the face, up to the arithmetic data."""
    quant = reader.read(5, "fap_quant")
    mask, types = _read_masks(reader)
    gender = reader.read(1, "suggested_gender")
    expect_predictive(reader)
    flags = [reader.read(1, f"is_{name}") for name in ("i_new_max", "i_new_min", "p_new_max", "p_new_min")]
    ranges = SentRanges(*[_read_list(reader, mask) if flag else None for flag in flags])
    return IntraHeader(quant, mask, types, gender, ranges, start.rate, start.time_code, start.skip)


def expect_predictive(reader: BitReader) -> None:
    """Read the coding type, which must not be DCT."""
    where = reader.where()
    if reader.read(1, "coding type"):
        raise UnsupportedError("coding type: got 1, DCT mode", where=where, clause="FBA section 13")


def _read_rate(reader: BitReader) -> FrameRate:
    where = reader.where()
    whole, sixteenths, ntsc = reader.read(8, "frame_rate"), reader.read(4, "seconds"), reader.read(1, "offset")
    try:
        return FrameRate(whole, sixteenths, bool(ntsc))
    except UsageError as error:
        raise ConformanceError(str(error), where=where, clause="FBA section 10") from error


def _read_time_code(reader: BitReader) -> TimeCode:
    where = reader.where()
    hours, minutes = reader.read(5, "hours"), reader.read(6, "minutes")
    reader.expect_marker("time code", "FBA section 2")
    try:
        return TimeCode(hours, minutes, reader.read(6, "seconds"))
    except UsageError as error:
        raise ConformanceError(str(error), where=where, clause="FBA section 2") from error


def _read_masks(reader: BitReader) -> tuple[Bools, tuple[int, ...]]:
    mask = np.zeros(fap.FAP_COUNT, bool)
    types = []
    for index, group in enumerate(GROUPS, start=1):
        reader.expect_marker(f"mask of group {index}", "FBA section 4")
        kind = reader.read(2, f"mask type of group {index}")
        for number in group:
            mask[fap.column(number)] = kind == 3 or (kind in (1, 2) and reader.read(1, f"mask of FAP {number}"))
        types.append(kind)
    return mask, tuple(types)


def _read_list(reader: BitReader, mask: Bools) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    magnitudes = np.zeros(LOW_LEVEL_COUNT, np.int64)
    for index, marker in _list_places():
        if marker:
            reader.expect_marker(f"ranges at FAP {index + 3}", "FBA section 5")
        if mask[index + 2]:
            magnitudes[index] = reader.read(5, f"range of FAP {index + 3}")
    return magnitudes
