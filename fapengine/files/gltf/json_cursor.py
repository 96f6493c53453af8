"""JSON objects whose values are checked when they are read, so that an error names the place in the file."""

import json
from collections.abc import Iterator
from typing import Any

from fapengine.errors import DataError

MAX_NUMBER = 1e30
"""Larger numbers are mistakes; no position or factor is so large."""


def parse_json(data: bytes, where: str) -> "Item":
    """Read a whole document.

    Raises
    ------
    DataError
        If it is not a JSON object, or contains numbers that are not finite.
    """
    try:
        value = json.loads(data.decode("utf-8"), parse_constant=_refuse)
        if b"\\u" in data:
            json.dumps(value, ensure_ascii=False).encode()  # rejects half a surrogate pair, which no path may contain
    except (ValueError, RecursionError) as error:  # Unicode's errors are ValueErrors
        raise DataError(f"is not JSON: {str(error)[:120]}", where=where) from error
    if not isinstance(value, dict):
        raise DataError(f"got {type(value).__name__}, expected a JSON object", where=where)
    return Item(value, "")


def _refuse(name: str) -> float:
    raise ValueError(f"got {name}, expected a number")


class Item:
    """A JSON object and its place, e.g. ``accessors[3].sparse``. The methods raise DataError for wrong types."""

    def __init__(self, values: dict[str, Any], where: str) -> None:
        self._values = values
        self.where = where

    def __contains__(self, key: str) -> bool:
        return self._values.get(key) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def fail(self, key: str, expected: str) -> DataError:
        """Return the error for a key."""
        return DataError(f"{key}: got {self._values.get(key)!r:.60}, expected {expected}", where=self._place(key))

    def item(self, key: str) -> "Item":
        """Object under a key; empty if it is missing."""
        value = self._values.get(key)
        if value is None:
            value = {}
        if not isinstance(value, dict):
            raise self.fail(key, "an object")
        return Item(value, self._place(key))

    def extras(self) -> "Item":
        """Application-specific data; empty if they are not an object, as glTF allows any JSON there."""
        value = self._values.get("extras")
        return Item(value if isinstance(value, dict) else {}, self._place("extras"))

    def items(self, key: str) -> "list[Item]":
        """Array of objects under a key; empty if it is missing."""
        place, values = self._place(key), self._list(key, dict, "objects")
        return [Item(value, f"{place}[{number}]") for number, value in enumerate(values)]

    def strings(self, key: str) -> list[str]:
        """Array of strings under a key; empty if it is missing."""
        return self._list(key, str, "strings")

    def indices(self, key: str, below: int) -> list[int]:
        """Array of indices under a key, each 0 to ``below`` - 1; empty if it is missing."""
        values = self._list(key, int, "indices")
        if not all(0 <= value < below and value is not True for value in values):
            raise self.fail(key, f"indices 0..{below - 1}")
        return values

    def numbers(self, key: str, default: list[float]) -> list[float]:
        """Array of finite numbers under a key, of the same length as the default."""
        values = self._values.get(key, default)
        if not isinstance(values, list) or len(values) != len(default):
            raise self.fail(key, f"{len(default)} numbers")
        if not all(isinstance(value, int | float) and abs(value) < MAX_NUMBER for value in values):
            raise self.fail(key, f"{len(default)} finite numbers")
        return [float(value) for value in values]

    def number(self, key: str, default: float) -> float:
        """Finite number under a key."""
        value = self._values.get(key, default)
        if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < MAX_NUMBER:
            raise self.fail(key, "a finite number")
        return float(value)

    def index(self, key: str, below: int, default: int | None = None) -> int:
        """Whole number under a key, 0 to ``below`` - 1."""
        value = self._values.get(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < below:
            raise self.fail(key, f"a whole number, 0..{below - 1}")
        return value

    def string(self, key: str, default: str | None = None) -> str:
        """Text under a key."""
        value = self._values.get(key, default)
        if not isinstance(value, str):
            raise self.fail(key, "a string")
        return value

    def flag(self, key: str) -> bool:
        """Return the boolean under a key; false if it is missing."""
        value = self._values.get(key, False)
        if not isinstance(value, bool):
            raise self.fail(key, "true or false")
        return value

    def _list(self, key: str, kind: type, what: str) -> list[Any]:
        values = self._values.get(key)
        if values is None:
            return []
        if not isinstance(values, list) or not all(isinstance(value, kind) for value in values):
            raise self.fail(key, f"an array of {what}")
        return values

    def _place(self, key: str) -> str:
        return f"{self.where}.{key}" if self.where else key
