"""The ``.epf`` encoder parameter file: reading it, and encoding a track as it says.

A list of tags, each followed by its numbers; ``#`` at the start of a line is a comment. Each ``FBM`` starts a frame.
FMT, FQU, TC and ISI hold for later frames too; FRR, SKN and the ranges hold for one frame.

Deviation: GDR sets the gender; the reference encoder does not know it.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fapengine.codec.fapfile import Words, text_lines
from fapengine.codec.fields import FIELD_FAPS, LOW_LEVEL_COUNT, Bools, Ints, SentRanges, rows_of
from fapengine.codec.header import FACE, FrameRate, IntraHeader, TimeCode
from fapengine.codec.writer import StreamWriter, check_selects
from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

RANGE_TAGS = ("FIX", "FIN", "FPX", "FPN")
"""Tags in the order of :data:`fapengine.codec.fields.LISTS`."""
BODY_TAGS = frozenset({"BFR", "BRR", "BTC", "BSK", "BMT", "BQU", "BIX", "BIN", "BPX", "BPN"})
COUNTS = {"FBM": 1, "FFR": 1, "ISI": 1, "FRR": 3, "TC": 4, "SKN": 1, "FQU": 1, "GDR": 1, "CDM": 1}
"""Number of numbers after each tag."""
LIMITS = {"ISI": 1, "FQU": 31, "GDR": 1, "CDM": 1, "FBM": 3}
"""Largest number after each tag."""
SINGLE_TAGS = {"FFR": "frame", "ISI": "intra", "SKN": "skip", "FQU": "quant", "GDR": "gender"}
"""Tags that set one field of :class:`_Tags`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaneOrder:
    """A plane to code, and its parameters."""

    frame: int
    """Frame number in the .fap file; the first frame with this or a greater number is coded."""
    header: IntraHeader | None = None
    """None for a P plane."""
    skip: int = 0


@dataclass(slots=True)
class _Tags:
    """The tags in force, and those of the current frame.

    Stateful.
    """

    intra: int = 1
    quant: int = 1
    time_code: TimeCode | None = None
    mask: Bools | None = None
    mask_types: tuple[int, ...] = ()
    gender: int = 0
    frame: int | None = None
    rate: FrameRate | None = None
    skip: int = 0
    bounds: dict[str, list[int]] = field(default_factory=dict)
    """Bounds of FAP 3 to 68 by tag."""
    line: int = 0
    """First line of the frame."""

    def order(self) -> PlaneOrder:
        """Build the order of the current frame."""
        where = f"line {self.line}"
        if self.frame is None:
            raise DataError("frame: FFR is missing", where=where)
        if not self.intra:
            return PlaneOrder(frame=self.frame, skip=self.skip)
        if self.mask is None:
            raise DataError("first I plane: FMT is missing", where=where)
        try:
            ranges = SentRanges.covering(*map(self.bounds.get, RANGE_TAGS))
        except UsageError as error:
            raise DataError(str(error), where=where, clause="FBA section 5") from error
        header = IntraHeader(
            self.quant, self.mask, self.mask_types, self.gender, ranges, self.rate, self.time_code, self.skip
        )
        return PlaneOrder(frame=self.frame, header=header, skip=self.skip)

    def read(self, tag: str, words: Words, line: int) -> None:
        """Read the numbers of one tag."""
        where = f"line {line}"
        if tag in BODY_TAGS:
            raise UnsupportedError(f"got {tag}, body parameters", where=where, clause="FBA section 2")
        if tag == "FMT":
            self.mask, self.mask_types = _read_masks(words)
            return
        if tag in RANGE_TAGS:
            self.bounds[tag] = _numbers(words, LOW_LEVEL_COUNT, tag)
            return
        if tag not in COUNTS:
            raise DataError(f"got unknown tag {tag[:20]!r}", where=where, clause=".epf")
        numbers = _numbers(words, COUNTS[tag], tag, 0, LIMITS.get(tag, 2**31 - 1))
        first = numbers[0]
        if tag == "FBM" and first != FACE:
            raise UnsupportedError(f"FBM: got {first}, body parameters", where=where, clause="FBA section 2")
        if tag == "CDM" and first:
            raise UnsupportedError("CDM: got 1, DCT mode", where=where, clause="FBA section 13")
        try:
            if tag in SINGLE_TAGS:
                setattr(self, SINGLE_TAGS[tag], first)
            elif tag == "FRR":
                self.rate = FrameRate(first, numbers[1], bool(numbers[2]))
            elif tag == "TC":
                self.time_code = TimeCode(first, numbers[1], numbers[3])
        except UsageError as error:
            raise DataError(str(error), where=where) from error


def _numbers(words: Words, count: int, what: str, low: int = -(2**31), high: int = 2**31) -> list[int]:
    """Next ``count`` whole numbers from ``low`` to ``high``."""
    numbers = []
    for word, line in words.take(count, what):
        if not word.lstrip("+-").isascii() or not word.lstrip("+-").isdigit() or len(word) > 11:
            raise DataError(f"{what}: got {word[:20]!r}, expected a whole number", where=f"line {line}")
        number = int(word) if word[1:].isdigit() or word.isdigit() else high + 1
        if not low <= number <= high:
            raise DataError(f"{what}: must be {low} to {high}, got {word[:20]}", where=f"line {line}")
        numbers.append(number)
    return numbers


def parse_epf(data: bytes) -> tuple[PlaneOrder, ...]:
    """Read a parameter file."""
    words, tags = Words(text_lines(data, "parameter file")), _Tags()
    orders: list[PlaneOrder] = []
    while words.has(1):
        ((tag, line),) = words.take(1, "tag")
        if tag == "FBM":
            if tags.line:
                orders.append(tags.order())
            tags.frame, tags.rate, tags.skip, tags.bounds, tags.line = None, None, 0, {}, line
        elif not tags.line:
            raise DataError(f"got {tag[:20]!r}, expected FBM first", where=f"line {line}")
        tags.read(tag, words, line)
    if not tags.line:
        raise TruncatedError("parameter file: contains no frame; FBM is missing", where="line 1")
    return (*orders, tags.order())


def _read_masks(words: Words) -> tuple[Bools, tuple[int, ...]]:
    mask = np.zeros(fap.FAP_COUNT, bool)
    types = []
    for index, group in enumerate(fap.GROUPS, start=1):
        (kind,) = _numbers(words, 1, f"FMT, type of group {index}", 0, 3)
        count = len(group)
        digits = _numbers(words, count, f"FMT, group {index}", 0, 1) if kind in (1, 2) else [kind == 3] * count
        mask[fap.columns(*group)] = digits
        types.append(kind)
    return mask, tuple(types)


def encode_orders(
    orders: Sequence[PlaneOrder], track: FapTrack, *, clamp: bool = False, plane_start_codes: bool = False
) -> bytes:
    """Encode a track as a parameter file says, bit for bit as the reference family does (FBA section 12).

    Parameters
    ----------
    clamp : bool
        Code the nearest symbol for values out of range, instead of an error.
    plane_start_codes : bool
        Write a start code before each I plane, including the first.
    """
    if not orders or orders[0].header is None:
        raise UsageError("orders: expected an I plane first")
    places = np.searchsorted(track.frame_numbers, [order.frame for order in orders])
    if places.max() >= len(track):
        missing = orders[int(np.argmax(places))].frame
        raise UsageError(f"frame {missing}: the track ends at {track.frame_numbers[-1] if len(track) else 'nothing'}")
    values, flags = rows_of(track)
    values *= track.mask[:, np.array(FIELD_FAPS) - 1]  # FAPs that the track does not have are coded as 0
    flags *= track.mask[:, [0, 1, 1]]
    writer = StreamWriter(clamp=clamp)
    starts = [index for index, order in enumerate(orders) if order.header is not None]
    for first, end in itertools.pairwise([*starts, len(orders)]):
        header = orders[first].header
        assert header is not None
        if plane_start_codes:
            writer.plane_start_code()
        check_selects(values[places[first:end]], bool(header.mask[0]), bool(header.mask[1]))
        writer.intra(header, values[places[first]], flags[places[first]])
        run: Ints = places[first + 1 : end]
        skips = np.array([order.skip for order in orders[first + 1 : end]], np.int64)
        writer.predicted(values[run], flags[run], skips)
    writer.finish()
    return writer.take()
