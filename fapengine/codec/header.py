"""The plane header: its values, and reading and writing its bits (FBA sections 2, 4 and 5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fapengine.codec.bits import BitReader
from fapengine.codec.fields import LISTS, Bools, SentRanges
from fapengine.codec.kernels import SKIP_LIMIT
from fapengine.errors import ConformanceError, UnsupportedError, UsageError
from fapengine.mpeg4 import fap

FACE, BODY = 1, 2
"""Bits of the object mask."""
LIST_MARKER_EVERY = 4
"""Ranges of a group after which a marker bit follows."""


@dataclass(frozen=True, slots=True)
class FrameRate:
    """Frames per second: ``whole + sixteenths / 16``, times 1000/1001 where ``ntsc``."""

    whole: int
    sixteenths: int = 0
    ntsc: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.whole <= 255 and 0 <= self.sixteenths <= 15 and (self.whole or self.sixteenths)):
            raise UsageError(f"frame rate: got {self.whole} + {self.sixteenths}/16, expected 1/16 to 255 15/16")

    @property
    def hz(self) -> float:
        """Frames per second."""
        rate = self.whole + Fraction(self.sixteenths, 16)
        return float(rate * Fraction(1000, 1001) if self.ntsc else rate)

    @classmethod
    def nearest(cls, rate_hz: float) -> "FrameRate":
        """Return the codable rate nearest to ``rate_hz``.

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
    """First fields of an I plane, before those of the face or the body."""

    objects: int
    """:data:`FACE`, :data:`BODY` or both."""
    rate: FrameRate | None
    time_code: TimeCode | None
    skip: int


NOTHING_SENT = SentRanges()


@dataclass(frozen=True, slots=True, eq=False)
class IntraHeader:
    """Header of an I plane with a face."""

    quant: int
    """fap_quant, 0 to 31."""
    mask: Bools
    """(68,) bool: coded FAPs."""
    mask_types: tuple[int, ...]
    """(10,) 0 to 3, one per group."""
    gender: int = 0
    ranges: SentRanges = NOTHING_SENT
    rate: FrameRate | None = None
    time_code: TimeCode | None = None
    skip: int = 0


def mask_types_of(mask: Bools, unsent: int = 1) -> tuple[int, ...]:
    """Return the shortest mask types: 3 for whole groups, 0 for empty ones (values kept), else ``unsent``."""
    types = []
    for group in fap.GROUPS:
        coded = [bool(mask[fap.column(number)]) for number in group]
        types.append(3 if all(coded) else unsent if any(coded) or unsent == 2 else 0)
    return tuple(types)


def intra_header_bits(header: IntraHeader) -> list[int]:
    """Bits of a header, from ``is_intra`` to the ranges."""
    rate, time_code, mask = header.rate, header.time_code, header.mask
    fields: list[tuple[int, int]] = [(1, 1), (FACE, 2), (rate is not None, 1)]  # value, width in bits
    if rate is not None:
        fields += [(rate.whole, 8), (rate.sixteenths, 4), (rate.ntsc, 1)]
    fields.append((time_code is not None, 1))
    if time_code is not None:
        fields += [(time_code.hours, 5), (time_code.minutes, 6), (1, 1), (time_code.seconds, 6)]
    fields.append((header.skip > 0, 1))
    if header.skip > 0:  # 15 means that another number follows (FBA section 10)
        fields += [(15, 4)] * (header.skip // 15) + [(header.skip % 15, 4)]
    fields.append((header.quant, 5))
    for group, kind in zip(fap.GROUPS, header.mask_types, strict=True):
        fields += [(1, 1), (kind, 2)]
        if kind in (1, 2):
            fields += [(mask[fap.column(number)], 1) for number in group]
    fields += [(header.gender, 1), (0, 1)]  # predictive, not DCT
    fields += [(magnitudes is not None, 1) for magnitudes in header.ranges]
    for magnitudes in header.ranges:
        if magnitudes is not None:
            for number, has_marker in list_places(fap.GROUPS[1:]):
                fields += [(1, 1)] * has_marker + [(magnitudes[number - 3], 5)] * int(mask[fap.column(number)])
    return [int(value) >> shift & 1 for value, width in fields for shift in reversed(range(width))]


def list_places(groups: Sequence[Sequence[int]]) -> list[tuple[int, bool]]:
    """Numbers in the order of a list of ranges, each with whether a marker bit precedes it."""
    return [(number, nth % LIST_MARKER_EVERY == 0) for group in groups for nth, number in enumerate(group)]


def read_skip(reader: BitReader) -> int:
    """Read the skip flag and its numbers (FBA section 10)."""
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


@dataclass(frozen=True, slots=True)
class ParameterFields:
    """Quantiser, masks and ranges in an I plane. Faces and bodies have them in the same order."""

    quant: int
    mask: dict[int, bool]
    """For each FAP or BAP number, whether it is coded."""
    mask_types: tuple[int, ...]
    gender: int
    ranges: tuple[dict[int, int] | None, ...]
    """Magnitude of each coded number in units of 60, in the order of :data:`LISTS`; None where not sent."""


def read_parameter_fields(
    reader: BitReader,
    groups: Sequence[Sequence[int]],
    ranged_groups: Sequence[Sequence[int]],
    *,
    prefix: str = "",
    name: str = "FAP",
    clauses: tuple[str, str] = ("FBA section 4", "FBA section 5"),
) -> ParameterFields:
    """Read the fields of a face or a body, up to the arithmetic data.

    Parameters
    ----------
    groups, ranged_groups : sequences of numbers
        Those with a mask, and those with ranges.
    prefix, name, clauses : str
        For error messages; the clauses of masks and of ranges.
    """
    quant = reader.read(5, f"{name.lower()}_quant")
    mask: dict[int, bool] = {}
    types = []
    for index, group in enumerate(groups, start=1):
        reader.expect_marker(f"mask of {prefix}group {index}", clauses[0])
        where = reader.where()
        kind = reader.read(2, f"mask type of {prefix}group {index}")
        if kind == 2 and prefix:
            what = f"mask type of {prefix}group {index}: got 2, expected 0, 1 or 3"
            raise ConformanceError(what, where=where, clause=clauses[0])
        for number in group:
            mask[number] = kind == 3 or (kind > 0 and bool(reader.read(1, f"mask of {name} {number}")))
        types.append(kind)
    gender = reader.read(1, "suggested_gender")
    where = reader.where()
    if reader.read(1, "coding type"):
        raise UnsupportedError("coding type: got 1, DCT mode", where=where, clause="FBA section 13")
    ranges: list[dict[int, int] | None] = []
    for is_sent in [reader.read(1, f"is_{side[0]}_new_{side[2:]}") for side in LISTS]:
        magnitudes: dict[int, int] = {}
        for number, has_marker in list_places(ranged_groups) if is_sent else ():
            if has_marker:
                reader.expect_marker(f"ranges at {name} {number}", clauses[1])
            if mask[number]:
                magnitudes[number] = reader.read(5, f"range of {name} {number}")
        ranges.append(magnitudes if is_sent else None)
    return ParameterFields(quant, mask, tuple(types), gender, tuple(ranges))


def read_face_header(reader: BitReader, start: PlaneStart) -> IntraHeader:
    """Read the fields of the face, up to the arithmetic data."""
    read = read_parameter_fields(reader, fap.GROUPS, fap.GROUPS[1:])
    numbers = range(1, fap.FAP_COUNT + 1)
    ranges = SentRanges(
        *(None if sent is None else np.array([sent.get(number, 0) for number in numbers[2:]]) for sent in read.ranges)
    )
    mask = np.array([read.mask[number] for number in numbers])
    return IntraHeader(read.quant, mask, read.mask_types, read.gender, ranges, start.rate, start.time_code, start.skip)


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
