"""The ``.fap`` text format, version 2.1: one mask line and one value line a frame.

Readers in the wild differ in two places, and both are read: FAP 1 and 2 as four and six numbers (the standard form) or
as a single number each; 68 mask digits or 69. Numbers may be floats. Line ends do not matter between numbers.
"""

from array import array
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

VERSIONS = ("1.1", "2.0", "2.1", "2.2")
"""No difference of syntax between them is known."""
VISEME_NUMBERS, EXPRESSION_NUMBERS = 4, 6
MAX_VALUE = 2**31 - 1
LINES_KEPT = 256
"""Number of lines whose counts are remembered: a frame's digits may stand one a line."""


def format_fap(track: FapTrack, *, single_numbers: bool = False) -> str:
    """Write a track: version 2.1, LF, single blanks.

    FAP 1 and 2 are written in their standard form, as four and six numbers. With ``single_numbers`` each is one, the
    first select, as Greta writes them: the rest of a viseme or expression is lost.

    Examples
    --------
    >>> track = FapTrack.of([[0] * 68], rate_hz=25.0)
    >>> print(format_fap(track).splitlines()[0])
    2.1 fapengine 25 1
    """
    rate = f"{track.rate_hz:.15g}"
    lines = [f"2.1 {'_'.join(track.name.split()) or 'fapengine'} {rate} {len(track)}"]
    for index in range(len(track)):
        mask = track.mask[index]
        lines.append(" ".join("1" if bit else "0" for bit in mask))
        numbers: list[int] = [int(track.frame_numbers[index])]
        if mask[fap.column(fap.VISEME_FAP)]:
            numbers += track.visemes[index].tolist()[: 1 if single_numbers else None]
        if mask[fap.column(fap.EXPRESSION_FAP)]:
            numbers += track.expressions[index].tolist()[: 1 if single_numbers else None]
        low_level = mask.copy()
        low_level[: fap.column(3)] = False
        numbers += track.values[index][low_level].tolist()
        lines.append(" ".join(map(str, numbers)))
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class _Token:
    text: str
    line: int


class _Tokens:
    """The numbers behind the header, with their lines; comments left out. Only what was asked for is taken apart.

    Stateful.
    """

    def __init__(self, lines: Iterable[tuple[int, str]]) -> None:
        self._lines = iter(lines)
        self._ready: deque[_Token] = deque()
        self._last_line = 1
        self.per_line: dict[int, int] = {}
        """Count of numbers in the lines that were looked at last."""

    def __bool__(self) -> bool:
        return self._has(1)

    def _has(self, count: int) -> bool:
        while len(self._ready) < count:
            number, line = next(self._lines, (0, ""))
            if not number:
                return False
            texts = line.split()
            self._ready.extend(_Token(text, number) for text in texts)
            self._last_line = number
            self.per_line[number] = len(texts)
            if len(self.per_line) > LINES_KEPT:
                del self.per_line[next(iter(self.per_line))]
        return True

    def peek_line(self) -> int:
        return self._ready[0].line if self._has(1) else self._last_line

    def take(self, count: int, what: str) -> list[_Token]:
        if not self._has(count):
            where = f"line {self.peek_line()}, the end"
            raise TruncatedError(f"{what}: got {len(self._ready)} numbers, expected {count}", where=where)
        return [self._ready.popleft() for _ in range(count)]


def parse_fap(data: bytes) -> FapTrack:
    """Read a ``.fap`` file."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError("FAP file: got bytes that are no text", where=f"byte {error.start}") from error
    lines = ((number, line) for number, line in enumerate(text.splitlines(), start=1) if _says_something(line))
    header = next(lines, None)
    if header is None:
        raise TruncatedError("FAP file: header is missing ('2.1 name rate frames')", where="line 1")
    name, rate_hz = _header(*header)
    masks, numbers = bytearray(), array("i")  # a frame's rows one behind the other: an hour as lists takes a gigabyte
    count = 0
    for frame in _frames(_Tokens(lines)):
        masks.extend(frame.mask)
        numbers.extend((frame.number, *frame.values, *frame.viseme, *frame.expression))
        count += 1
    if not count:
        raise TruncatedError("FAP file: contains no frames", where=f"line {header[0]}")
    table = np.frombuffer(numbers, np.int32).reshape(count, -1)
    first, visemes, expressions = np.split(table[:, 1:], np.cumsum([fap.FAP_COUNT, VISEME_NUMBERS]), axis=1)
    try:
        return FapTrack(
            mask=np.frombuffer(masks, np.bool_).reshape(count, fap.FAP_COUNT),
            values=first,
            visemes=visemes,
            expressions=expressions,
            frame_numbers=table[:, 0].astype(np.int64),
            rate_hz=rate_hz,
            name=name,
        )
    except UsageError as error:
        raise DataError(f"FAP file: {error}") from error


def _says_something(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _header(number: int, line: str) -> tuple[str, float]:
    fields = line.split()
    where = f"line {number}"
    if len(fields) < 3 or fields[0] not in VERSIONS:
        raise DataError(f"header: got {line.strip()[:60]!r}, expected '2.1 name rate frames'", where=where)
    try:
        rate_hz = float(fields[-2])
    except ValueError as error:
        raise DataError(f"frame rate: got {fields[-2]!r}, expected a number", where=where) from error
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise DataError(f"frame rate: must be a positive number, got {fields[-2]}", where=where)
    return " ".join(fields[1:-2]) or "unnamed", rate_hz


@dataclass(frozen=True, slots=True)
class _Frame:
    number: int
    mask: list[bool]
    values: list[int]
    viseme: list[int]
    expression: list[int]


def _frames(tokens: _Tokens) -> Iterator[_Frame]:
    while tokens:
        mask = _mask(tokens)
        line = tokens.peek_line()
        number, *_ = _integers(tokens.take(1, "frame number"))
        low_level = sum(mask[fap.column(3) :])
        has_viseme, has_expression = mask[0], mask[1]
        single = low_level + has_viseme + has_expression
        short = tokens.per_line[line] == single + 1 and (has_viseme or has_expression)
        viseme, expression = [0] * VISEME_NUMBERS, [0] * EXPRESSION_NUMBERS
        if has_viseme:
            viseme = _integers(tokens.take(1 if short else VISEME_NUMBERS, "viseme")) + [0] * (3 * short)
        if has_expression:
            expression = _integers(tokens.take(1 if short else EXPRESSION_NUMBERS, "expression")) + [0] * (5 * short)
        sent = iter(_integers(tokens.take(low_level, "FAP values")))
        values = [0, 0] + [next(sent) if bit else 0 for bit in mask[fap.column(3) :]]
        yield _Frame(number, mask, values, viseme, expression)


def _mask(tokens: _Tokens) -> list[bool]:
    line = tokens.peek_line()
    digits = tokens.take(fap.FAP_COUNT, "mask")
    if digits[-1].line == line and tokens.per_line[line] == fap.FAP_COUNT + 1:
        digits = digits + tokens.take(1, "mask")
        if digits[-1].text != "0":
            raise DataError(f"mask: got a 69th digit {digits[-1].text!r}, expected 0", where=f"line {line}")
    for index, digit in enumerate(digits, start=1):
        if digit.text not in ("0", "1"):
            raise DataError(f"mask: digit {index} is {digit.text[:20]!r}, expected 0 or 1", where=f"line {digit.line}")
    return [digit.text == "1" for digit in digits[: fap.FAP_COUNT]]


def _integers(tokens: list[_Token]) -> list[int]:
    numbers = []
    for token in tokens:
        try:
            value = float(token.text)
        except ValueError as error:
            raise DataError(f"got {token.text[:20]!r}, expected a number", where=f"line {token.line}") from error
        if not abs(value) <= MAX_VALUE:
            raise DataError(f"got {token.text[:20]}, expected a finite 32-bit number", where=f"line {token.line}")
        numbers.append(round(value))
    return numbers
