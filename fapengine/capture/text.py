"""Tables of numbers in text: decoding, delimiters, decimal commas, empty cells."""

import csv
import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "."})
LIMIT = 1 << 17
"""Longest cell; longer ones are not a table's."""


def decode_text(data: bytes, name: str) -> str:
    """Decode UTF-8 (with or without BOM), UTF-16 with BOM, or Latin-1 as old systems write it.

    Raises
    ------
    DataError
        If there are NUL bytes.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        raise DataError(f"{name}: is not text, contains NUL bytes", where=f"character {text.index(chr(0))}")
    return text


def split_rows(text: str) -> list[list[str]]:
    """Split text into stripped cells; the delimiter is the most frequent of tab, ``;`` and ``,`` in the longest line.

    Raises
    ------
    DataError
        If a cell is too long.
    """
    longest = max(text.splitlines(), key=len, default="")
    delimiter = max("\t;,", key=longest.count)
    csv.field_size_limit(LIMIT)
    try:
        return [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter)]
    except csv.Error as error:
        raise DataError(f"table: {error}") from error


def numbers(rows: Sequence[Sequence[str]], width: int, first_line: int) -> NDArray[np.float64]:
    """Parse cells, (R, width) float64; empty cells, missing line ends and NA are NaN, decimal commas are points.

    Raises
    ------
    DataError
        For a cell that is not a number; ``where`` is line and column.
    """
    table = np.full((len(rows), width), np.nan)
    for index, row in enumerate(rows):
        for column, cell in enumerate(row[:width]):
            if cell.lower() in MISSING:
                continue
            try:
                table[index, column] = float(cell.replace(",", "."))
            except ValueError as error:
                raise DataError(
                    f"not a number: {cell!r:.40}", where=f"line {first_line + index}, column {column + 1}"
                ) from error
    table[~np.isfinite(table)] = np.nan
    return table


def whole(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Set all three coordinates to NaN where one is: (T, M, 3) -> (T, M, 3)."""
    return np.where(np.isnan(positions).any(axis=-1, keepdims=True), np.nan, positions)


def rate_of(times_s: NDArray[np.float64]) -> float | None:
    """Frame rate of rising times, (T,) s, to five digits; None if there are too few or they do not rise."""
    steps = np.diff(times_s[~np.isnan(times_s)])
    return float(f"{1.0 / np.median(steps):.5g}") if len(steps) and np.median(steps) > 0 else None
