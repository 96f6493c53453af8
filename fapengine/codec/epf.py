"""The ``.epf`` encoder parameter file: read, written, and carried out on a track.

A list of tags, each followed by its numbers; ``#`` at the start of a line is a comment. Each ``FBM`` starts a frame.
FMT, FQU, TC and ISI hold for later frames too; FRR, SKN and the ranges for one frame only.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fapengine.codec.fields import GROUPS, LISTS, LOW_LEVEL_COUNT, Bools, Ints, SentRanges, rows_of
from fapengine.codec.header import FACE, FrameRate, IntraHeader, TimeCode
from fapengine.codec.writer import StreamWriter, check_selects
from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

RANGE_TAGS = ("FIX", "FIN", "FPX", "FPN")
"""Tags in the order of :data:`fapengine.codec.fields.LISTS`."""
BODY_TAGS = frozenset({"BFR", "BRR", "BTC", "BSK", "BMT", "BQU", "BIX", "BIN", "BPX", "BPN"})
COUNTS = {"FBM": 1, "FFR": 1, "ISI": 1, "FRR": 3, "TC": 4, "SKN": 1, "FQU": 1, "GDR": 1, "CDM": 1}
LIMITS = {"ISI": 1, "FQU": 31, "GDR": 1, "CDM": 1, "FBM": 3}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaneOrder:
    """What to code as one plane, with everything that holds for it."""

    frame: int
    """Frame number in the .fap file; the first frame not before it is taken."""
    header: IntraHeader | None = None
    """None for a P plane."""
    skip: int = 0


@dataclass(slots=True)
class _Held:
    """Tags that outlive their frame, and those of this one.

    Stateful.
    """

    intra: bool = True
    quant: int = 1
    time_code: TimeCode | None = None
    mask: Bools | None = None
    mask_types: tuple[int, ...] = ()
    gender: int = 0
    frame: int | None = None
    rate: FrameRate | None = None
    skip: int = 0
    lists: tuple[list[int] | None, ...] = (None,) * 4
    line: int = 0

    def order(self) -> PlaneOrder:
        where = f"line {self.line}"
        if self.frame is None:
            raise DataError("frame: FFR is missing", where=where)
        if not self.intra:
            return PlaneOrder(frame=self.frame, skip=self.skip)
        if self.mask is None:
            raise DataError("first I plane: FMT is missing", where=where)
        try:
            ranges = SentRanges.covering(*self.lists)
        except UsageError as error:
            raise DataError(str(error), where=where, clause="FBA section 5") from error
        header = IntraHeader(
            self.quant, self.mask, self.mask_types, self.gender, ranges, self.rate, self.time_code, self.skip
        )
        return PlaneOrder(frame=self.frame, header=header, skip=self.skip)

    def next_frame(self, line: int) -> None:
        self.frame, self.rate, self.skip, self.lists, self.line = None, None, 0, (None,) * 4, line


class _Words:
    """Words with their lines.

    Stateful.
    """

    def __init__(self, data: bytes) -> None:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise DataError("parameter file: got bytes that are no text", where=f"byte {error.start}") from error
        self._words = [
            (word, number)
            for number, line in enumerate(text.splitlines(), start=1)
            if not line.lstrip().startswith("#")
            for word in line.split()
        ]
        self._at = 0

    def __bool__(self) -> bool:
        return self._at < len(self._words)

    @property
    def line(self) -> int:
        return self._words[min(self._at, len(self._words) - 1)][1] if self._words else 1

    def word(self) -> str:
        word, _ = self._words[self._at]
        self._at += 1
        return word

    def numbers(self, count: int, what: str, low: int = -(2**31), high: int = 2**31) -> list[int]:
        taken_words = self._words[self._at : self._at + count]
        if len(taken_words) < count:
            raise TruncatedError(f"{what}: got {len(taken_words)} numbers, expected {count}", where=f"line {self.line}")
        numbers = []
        for word, line in taken_words:
            if not word.lstrip("+-").isascii() or not word.lstrip("+-").isdigit() or len(word) > 11:
                raise DataError(f"{what}: got {word[:20]!r}, expected a whole number", where=f"line {line}")
            number = int(word) if word[1:].isdigit() or word.isdigit() else high + 1
            if not low <= number <= high:
                raise DataError(f"{what}: must be {low} to {high}, got {word[:20]}", where=f"line {line}")
            numbers.append(number)
        self._at += count
        return numbers


def parse_epf(data: bytes) -> tuple[PlaneOrder, ...]:
    """Read a parameter file."""
    words = _Words(data)
    held = _Held()
    orders: list[PlaneOrder] = []
    started = False
    while words:
        line = words.line
        tag = words.word()
        if tag == "FBM":
            if started:
                orders.append(held.order())
            held.next_frame(line)
            started = True
        elif not started:
            raise DataError(f"got {tag[:20]!r}, expected FBM first", where=f"line {line}")
        _read_tag(tag, words, held, line)
    if not started:
        raise TruncatedError("parameter file: contains no frame; FBM is missing", where="line 1")
    orders.append(held.order())
    return tuple(orders)


def _read_tag(tag: str, words: _Words, held: _Held, line: int) -> None:
    if tag in BODY_TAGS:
        raise UnsupportedError(f"got {tag}, body parameters", where=f"line {line}", clause="FBA section 2")
    if tag == "FMT":
        held.mask, held.mask_types = _read_masks(words)
        return
    if tag in RANGE_TAGS:
        row = RANGE_TAGS.index(tag)
        bounds = words.numbers(LOW_LEVEL_COUNT, tag)
        held.lists = (*held.lists[:row], bounds, *held.lists[row + 1 :])
        return
    if tag not in COUNTS:
        raise DataError(f"got unknown tag {tag[:20]!r}", where=f"line {line}", clause=".epf")
    numbers = words.numbers(COUNTS[tag], tag, 0, LIMITS.get(tag, 2**31 - 1))
    try:
        _set_tag(tag, numbers, held, line)
    except UsageError as error:
        raise DataError(str(error), where=f"line {line}") from error


def _set_tag(tag: str, numbers: list[int], held: _Held, line: int) -> None:
    first = numbers[0]
    if tag == "FBM" and first != FACE:
        raise UnsupportedError(f"FBM: got {first}, body parameters", where=f"line {line}", clause="FBA section 2")
    if tag == "CDM" and first:
        raise UnsupportedError("CDM: got 1, DCT mode", where=f"line {line}", clause="FBA section 13")
    if tag == "FFR":
        held.frame = first
    elif tag == "ISI":
        held.intra = bool(first)
    elif tag == "FRR":
        held.rate = FrameRate(first, numbers[1], bool(numbers[2]))
    elif tag == "TC":
        held.time_code = TimeCode(first, numbers[1], numbers[3])
    elif tag == "SKN":
        held.skip = first
    elif tag == "FQU":
        held.quant = first
    elif tag == "GDR":
        held.gender = first


def _read_masks(words: _Words) -> tuple[Bools, tuple[int, ...]]:
    mask = np.zeros(fap.FAP_COUNT, bool)
    types = []
    for index, group in enumerate(GROUPS, start=1):
        (kind,) = words.numbers(1, f"FMT, type of group {index}", 0, 3)
        digits = words.numbers(len(group), f"FMT, group {index}", 0, 1) if kind in (1, 2) else [kind == 3] * len(group)
        for number, digit in zip(group, digits, strict=True):
            mask[fap.column(number)] = digit
        types.append(kind)
    return mask, tuple(types)


def format_epf(orders: Sequence[PlaneOrder]) -> str:
    """Write a parameter file that :func:`parse_epf` reads back; ranges come out as multiples of 60.

    Deviation: a gender of 1 is written as GDR, which the reference encoder does not know.
    """
    lines: list[str] = []
    for order in orders:
        lines += ["FBM 1", f"FFR {order.frame}", f"ISI {int(order.header is not None)}"]
        if order.skip:
            lines.append(f"SKN {order.skip}")
        if order.header is not None:
            lines += _header_lines(order.header)
    return "\n".join(lines) + "\n"


def _header_lines(header: IntraHeader) -> Iterator[str]:
    if header.rate is not None:
        yield f"FRR {header.rate.whole} {header.rate.sixteenths} {int(header.rate.ntsc)}"
    if header.time_code is not None:
        yield f"TC {header.time_code.hours} {header.time_code.minutes} 1 {header.time_code.seconds}"
    groups = []
    for group, kind in zip(GROUPS, header.mask_types, strict=True):
        digits = [str(int(header.mask[fap.column(number)])) for number in group] if kind in (1, 2) else []
        groups.append(" ".join([str(kind), *digits]))
    yield f"FMT {' '.join(groups)}"
    yield f"FQU {header.quant}"
    if header.gender:
        yield f"GDR {header.gender}"
    signs = dict(zip(LISTS, (60, -60, 60, -60), strict=True))
    for tag, name, magnitudes in zip(RANGE_TAGS, LISTS, header.ranges.lists, strict=True):
        if magnitudes is not None:
            yield f"{tag} {' '.join(str(int(m) * signs[name]) for m in magnitudes)}"


def encode_orders(
    orders: Sequence[PlaneOrder], track: FapTrack, *, clamp: bool = False, plane_start_codes: bool = False
) -> bytes:
    """Code a track as a parameter file says, bit for bit as the reference family does (FBA section 12).

    Parameters
    ----------
    clamp : bool
        Code the nearest symbol for values out of range, instead of an error.
    plane_start_codes : bool
        Write a start code before each I plane, the first included.
    """
    if not orders or orders[0].header is None:
        raise UsageError("orders: expected an I plane first")
    places = np.searchsorted(track.frame_numbers, [order.frame for order in orders])
    if len(places) and places.max() >= len(track):
        missing = orders[int(np.argmax(places))].frame
        raise UsageError(f"frame {missing}: the track ends at {track.frame_numbers[-1] if len(track) else 'nothing'}")
    values, flags = rows_of(track)
    values[:, :3] *= track.mask[:, :1]
    values[:, 3:7] *= track.mask[:, 1:2]
    flags = flags * track.mask[:, [0, 1, 1]]
    values[:, 7:] = np.where(track.mask[:, 2:], values[:, 7:], 0)
    writer = StreamWriter(clamp=clamp)
    starts = [index for index, order in enumerate(orders) if order.header is not None]
    for first, behind in zip(starts, [*starts[1:], len(orders)], strict=True):
        header = orders[first].header
        assert header is not None
        if plane_start_codes:
            writer.plane_start_code()
        check_selects(values[places[first:behind]], bool(header.mask[0]), bool(header.mask[1]))
        writer.intra(header, values[places[first]], flags[places[first]])
        run: Ints = places[first + 1 : behind]
        skips = np.array([order.skip for order in orders[first + 1 : behind]], np.int64)
        writer.predicted(values[run], flags[run], skips)
    writer.finish()
    return writer.take()
