"""Struct arrays of MATLAB files, version 5 to 7: as much of the format as recordings need.

A header of 128 bytes, then elements: type, size, data, padded to eight bytes; small ones have four bytes of data within
the tag. A variable is an element of type 14, or one of type 15 that contains it compressed. Layout: "MAT-File Format"
of The MathWorks. scipy.io reads more of it, and ends the process on some damaged files.
"""

import math
import zlib
from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, TruncatedError

HEADER, MATRIX, COMPRESSED = 128, 14, 15
NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8", 16: "u1", 17: "u2",
}  # fmt: skip
"""NumPy's name for each type of element."""
STRUCT, CHARACTERS = 2, 4
MAX_DIMENSIONS = 32
MAX_RATIO = 100
"""Largest ratio of a variable's size to that of the whole file; real ones pack to a half."""

Value = str | NDArray[np.float64]


def struct_arrays(data: bytes, wanted: Collection[str]) -> Iterator[list[dict[str, Value]]]:
    """Yield each struct array that has the wanted fields: of every element these fields, texts or numbers (...).

    Raises
    ------
    TruncatedError
        If an element runs past the end.
    DataError
        If it is not such a file.
    """
    marks = {b"IM": "<", b"MI": ">"}
    if len(data) < HEADER or data[126:128] not in marks:
        raise DataError("MAT: not a MATLAB file of version 5 to 7", where="byte 126")
    order = marks[data[126:128]]
    for kind, body in _elements(data[HEADER:], order, padded=False):
        if kind == COMPRESSED:
            inflate = zlib.decompressobj()
            try:
                plain = inflate.decompress(body, MAX_RATIO * len(data))
            except zlib.error as error:
                raise DataError(f"MAT: damaged: {error}") from error
            if inflate.unconsumed_tail:
                raise DataError(f"MAT: a variable is more than {MAX_RATIO} times as large as the file")
            kind, body = next(_elements(plain, order), (0, b""))
        if kind == MATRIX and (found := _structs(body, order, wanted)):
            yield found


def _elements(data: bytes, order: str, *, padded: bool = True) -> Iterator[tuple[int, bytes]]:
    """Types and contents of the elements in some bytes."""
    at = 0
    while at + 8 <= len(data):
        kind, size = np.frombuffer(data, f"{order}u4", 2, at).tolist()
        begin = at + 8
        if kind >> 16:  # small
            kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
        if begin + size > len(data) or (begin == at + 4 and size > 4):
            raise TruncatedError(f"MAT: an element has {size} bytes, of which {len(data) - begin} are there")
        yield kind, data[begin : begin + size]
        at = at + 8 if begin == at + 4 else begin + size + (-size % 8 if padded or kind != COMPRESSED else 0)


def _structs(body: bytes, order: str, wanted: Collection[str]) -> list[dict[str, Value]]:
    """Wanted fields of the elements of a struct array; empty for another variable."""
    parts = _elements(body, order)
    kind, shape = _head(parts, order)
    if kind != STRUCT:
        return []
    width = sum(_integers(next(parts, (0, b"")), order)[:1])
    names = next(parts, (0, b""))[1]
    if not 0 < width <= len(names):
        raise DataError(f"MAT: field names must have 1 to {len(names)} bytes, got {width}")
    fields = [names[n : n + width].split(b"\0")[0].decode("latin-1") for n in range(0, len(names), width)]
    if not set(wanted) <= set(fields):
        return []
    found: list[dict[str, Value]] = []
    for index, (_, part) in enumerate(parts):
        if index % len(fields) == 0:
            found.append({})
        if fields[index % len(fields)] in wanted:
            found[-1][fields[index % len(fields)]] = _value(part, order)
    if len(found) != math.prod(shape) or any(len(one) < len(wanted) for one in found):
        raise TruncatedError(f"MAT: a struct array has {len(found)} of {math.prod(shape)} elements")
    return found


def _head(parts: Iterator[tuple[int, bytes]], order: str) -> tuple[int, list[int]]:
    """Class and shape of a variable, whose name is passed over."""
    flags, dimensions, _ = (next(parts, (0, b"")) for _ in range(3))
    return sum(_integers(flags, order)[:1]) & 0xFF, _integers(dimensions, order)


def _value(body: bytes, order: str) -> Value:
    """A text, or numbers; empty for structs and cells."""
    parts = _elements(body, order)
    kind, shape = _head(parts, order)
    if not shape or kind <= 3:
        return np.zeros(0)
    values = _numbers(next(parts, (0, b"")), order)
    if kind == CHARACTERS:
        return "".join(chr(int(code)) for code in values if 0 < code < 0xD800)
    if len(values) != math.prod(shape) or min(shape) < 0 or len(shape) > MAX_DIMENSIONS:
        raise DataError(f"MAT: got {len(values)} numbers, expected shape {tuple(shape[:MAX_DIMENSIONS])}")
    return values.reshape(shape, order="F")


def _integers(element: tuple[int, bytes], order: str) -> list[int]:
    return [int(number) for number in _numbers(element, order)] if element[0] <= 6 else []


def _numbers(element: tuple[int, bytes], order: str) -> NDArray[np.float64]:
    kind, body = element
    if kind not in NUMBERS:
        return np.zeros(0)
    count = len(body) // np.dtype(NUMBERS[kind]).itemsize
    with np.errstate(invalid="ignore"):  # of NaNs that signal, which a damaged file may hold
        return np.frombuffer(body, order + NUMBERS[kind], count).astype(np.float64)
