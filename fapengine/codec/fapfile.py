"""The ``.fap`` text format, version 2.1: one mask line and one value line per frame.

Existing files differ in two places, and both forms are read: FAP 1 and 2 as four and six numbers (the standard form) or
as a single number each; 68 mask digits or 69. Numbers may be floats. Line breaks do not matter between numbers.
"""

from array import array
from collections import deque
from collections.abc import Iterator

import numpy as np

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FULL_WEIGHT
from fapengine.mpeg4.track import FapTrack

LINES_KEPT = 256
"""Number of lines whose word counts are kept: the digits of a frame may be on one line each."""


def text_lines(data: bytes, what: str) -> Iterator[tuple[int, str]]:
    """Return the number and the text of each line that is neither empty nor a comment (``#``).

    Raises
    ------
    DataError
        If the data are not UTF-8 text; ``what`` is the kind of file, for the message.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{what}: is not UTF-8 text", where=f"byte {error.start}") from error
    numbered = enumerate(text.splitlines(), start=1)
    return ((number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#"))


class Words:
    """The words of numbered lines, which are split when they are needed.

    Stateful.
    """

    def __init__(self, lines: Iterator[tuple[int, str]]) -> None:
        self._lines = lines
        self._ready: deque[tuple[int, list[str]]] = deque()
        self._taken = 0
        """Words of the first of these lines that were taken."""
        self._count = 0
        self._last_line = 1
        self.per_line: dict[int, int] = {}
        """Number of words in each of the last lines."""

    def has(self, count: int) -> bool:
        """Split lines until ``count`` words are ready; False at the end of the file."""
        while self._count < count:
            number, line = next(self._lines, (0, ""))
            if not number:
                return False
            words = line.split()
            self._ready.append((number, words))
            self._count += len(words)
            self._last_line = number
            self.per_line[number] = len(words)
            if len(self.per_line) > LINES_KEPT:
                del self.per_line[next(iter(self.per_line))]
        return True

    def line(self) -> int:
        """Line of the next word."""
        return self._ready[0][0] if self.has(1) else self._last_line

    def take_lines(self, count: int, what: str) -> list[tuple[int, list[str]]]:
        """Next ``count`` words: the number of each line, and what it has of them."""
        if not self.has(count):
            where = f"line {self.line()}, the end"
            raise TruncatedError(f"{what}: got {self._count} numbers, expected {count}", where=where)
        self._count -= count
        taken = []
        while count:
            number, words = self._ready[0]
            part = words[self._taken : self._taken + count]
            taken.append((number, part))
            count -= len(part)
            self._taken += len(part)
            if self._taken == len(words):
                self._ready.popleft()
                self._taken = 0
        return taken

    def take(self, count: int, what: str) -> list[tuple[str, int]]:
        """Next ``count`` words and their lines."""
        return [(word, number) for number, words in self.take_lines(count, what) for word in words]


VERSIONS = ("1.1", "2.0", "2.1", "2.2")
"""Their syntax is the same, as far as is known."""
VISEME_NUMBERS, EXPRESSION_NUMBERS = 4, 6
WIDTHS = (1, VISEME_NUMBERS, EXPRESSION_NUMBERS)
"""Numbers of a frame before FAP 3: frame number, FAP 1, FAP 2."""
MAX_VALUE = 2**31 - 1


def format_fap(track: FapTrack, *, single_numbers: bool = False) -> str:
    """Format a track: version 2.1, LF line ends, single spaces.

    FAP 1 and 2 are written in their standard form, as four and six numbers. With ``single_numbers`` each is one number,
    the first select, as Greta writes them: the rest of a viseme or expression is lost.

    Examples
    --------
    >>> track = FapTrack.from_values([[0] * 68], rate_hz=25.0)
    >>> print(format_fap(track).splitlines()[0])
    2.1 fapengine 25 1
    """
    rate = f"{track.rate_hz:.15g}"
    lines = [f"2.1 {'_'.join(track.name.split()) or 'fapengine'} {rate} {len(track)}"]
    digits = np.full((len(track), 2 * fap.FAP_COUNT - 1), ord(" "), np.uint8)
    digits[:, ::2] = ord("0") + track.mask
    low_level = slice(fap.column(3), None)
    for mask_line, mask, number, viseme, expression, values in zip(
        digits, track.mask, track.frame_numbers, track.visemes, track.expressions, track.values, strict=True
    ):
        lines.append(mask_line.tobytes().decode())
        numbers = [number]
        for is_sent, row in zip(mask[:2], (viseme, expression), strict=True):
            numbers += row[: 1 if single_numbers else None].tolist() if is_sent else []
        lines.append(" ".join(map(str, numbers + values[low_level][mask[low_level]].tolist())))
    return "\n".join(lines) + "\n"


def _integers(words: Words, count: int, what: str) -> list[int]:
    """Next ``count`` numbers, rounded."""
    numbers = []
    for line, texts in words.take_lines(count, what):
        try:
            whole = list(map(int, texts))
        except ValueError:
            whole = []
        if not whole or max(whole) > MAX_VALUE or min(whole) < -MAX_VALUE:
            whole = [_rounded(text, line) for text in texts]
        numbers += whole
    return numbers


def _rounded(text: str, line: int) -> int:
    try:
        value = float(text)
    except ValueError as error:
        raise DataError(f"got {text[:20]!r}, expected a number", where=f"line {line}") from error
    if not abs(value) <= MAX_VALUE:
        raise DataError(f"got {text[:20]}, expected a finite 32-bit number", where=f"line {line}")
    return round(value)


def parse_fap(data: bytes) -> FapTrack:
    """Read a ``.fap`` file."""
    lines = text_lines(data, "FAP file")
    header = next(lines, None)
    if header is None:
        raise TruncatedError("FAP file: header is missing ('2.1 name rate frames')", where="line 1")
    name, rate_hz = _header(*header)
    masks, heads, sent = bytearray(), array("i"), array("i")  # arrays: an hour as lists takes a gigabyte
    words = Words(lines)
    while words.has(1):
        mask = _mask(words)
        masks.extend(mask)
        heads.extend(_head(words, mask))
        sent.extend(_integers(words, sum(mask[fap.column(3) :]), "FAP values"))
    if not masks:
        raise TruncatedError("FAP file: contains no frames", where=f"line {header[0]}")
    is_sent = np.frombuffer(masks, np.bool_).reshape(-1, fap.FAP_COUNT)
    values = np.zeros(is_sent.shape, np.int32)
    values[:, fap.column(3) :][is_sent[:, fap.column(3) :]] = np.frombuffer(sent, np.int32)
    frame_numbers, visemes, expressions = np.split(
        np.frombuffer(heads, np.int32).reshape(len(values), sum(WIDTHS)), np.cumsum(WIDTHS[:-1]), axis=1
    )
    try:
        return FapTrack(
            mask=is_sent,
            values=values,
            visemes=visemes,
            expressions=expressions,
            frame_numbers=frame_numbers[:, 0].astype(np.int64),
            rate_hz=rate_hz,
            name=name,
        )
    except UsageError as error:
        raise DataError(f"FAP file: {error}") from error


def _header(number: int, line: str) -> tuple[str, float]:
    fields = line.split()
    where = f"line {number}"
    if len(fields) < 3 or fields[0] not in VERSIONS:
        raise DataError(f"header: got {line.strip()[:60]!r}, expected '2.1 name rate frames'", where=where)
    try:
        rate_hz = float(fields[-2])
    except ValueError as error:
        raise DataError(f"frame rate: got {fields[-2][:20]!r}, expected a number", where=where) from error
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise DataError(f"frame rate: must be a positive number, got {fields[-2]}", where=where)
    return " ".join(fields[1:-2]) or "unnamed", rate_hz


def _head(words: Words, mask: list[bool]) -> list[int]:
    """Read what comes before the values of a frame: its number, viseme and expression; 0 where nothing is sent."""
    line = words.line()
    numbers = _integers(words, 1, "frame number")
    is_single = words.per_line[line] == sum(mask) + 1 and (mask[0] or mask[1])
    for is_sent, width, weight, what in (
        (mask[0], VISEME_NUMBERS, 2, "viseme"), (mask[1], EXPRESSION_NUMBERS, 1, "expression"),
    ):  # fmt: skip
        sent = _integers(words, 1 if is_single else width, what) if is_sent else []
        sent += [0] * (width - len(sent))
        if is_single and sent[0]:
            sent[weight] = FULL_WEIGHT  # a single number is shown alone
        numbers += sent
    return numbers


def _mask(words: Words) -> list[bool]:
    line = words.line()
    parts = words.take_lines(fap.FAP_COUNT, "mask")
    if parts[-1][0] == line and words.per_line[line] == fap.FAP_COUNT + 1:
        ((digit, _),) = words.take(1, "mask")
        if digit != "0":
            raise DataError(f"mask: got a 69th digit {digit!r}, expected 0", where=f"line {line}")
    digits = [digit for _, part in parts for digit in part]
    if not set(digits) <= {"0", "1"}:
        index = next(index for index, digit in enumerate(digits) if digit not in ("0", "1"))
        line = [number for number, part in parts for _ in part][index]
        raise DataError(f"mask: digit {index + 1} is {digits[index][:20]!r}, expected 0 or 1", where=f"line {line}")
    return [digit == "1" for digit in digits]
