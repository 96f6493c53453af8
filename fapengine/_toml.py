"""Strict reading of TOML, and its strings: a missing, unknown or wrongly typed key is an error that names it."""

import json
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, UsageError


def parse_toml(data: bytes, name: str, error: type[DataError] = DataError) -> "TomlTable":
    """Read a whole document.

    Parameters
    ----------
    data : bytes
    name : str
        Of the file, for messages.
    error : type
        What to raise.

    Raises
    ------
    DataError
        If it is no TOML.
    """
    try:
        return TomlTable(tomllib.loads(data.decode()), f"{name}, ", error)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as trouble:
        raise error(f"is not TOML: {trouble}", where=name) from trouble


def quoted(text: str) -> str:
    """Spell a TOML basic string; JSON's escapes are among TOML's, DEL alone must be added."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class TomlTable:
    """Stateful: one table, read key by key; :meth:`finish` refuses what is left over."""

    def __init__(self, values: object, where: str, error: type[DataError] = DataError) -> None:
        if not isinstance(values, dict):
            raise error(f"got {type(values).__name__}, expected a table", where=where.rstrip("., "))
        self._values = dict(values)
        self._where = where
        self._error = error

    def where(self, key: str) -> str:
        """File and full key, for messages."""
        return f"{self._where}{key}"

    def fail(self, key: str, message: str) -> DataError:
        """Make the error for a key."""
        return self._error(message, where=self.where(key))

    def has(self, key: str) -> bool:
        """Whether the key is there and not yet taken."""
        return key in self._values

    def is_table(self, key: str) -> bool:
        """Whether the key is there and holds a table."""
        return isinstance(self._values.get(key), dict)

    def __iter__(self) -> Iterator[str]:
        """Keys not yet taken; they may be taken meanwhile."""
        return iter(list(self._values))

    def take(self, key: str, kind: type, default: Any = ...) -> Any:
        """Value of a key, of this type; whole numbers are floats too where floats are wanted."""
        if key not in self._values:
            if default is not ...:
                return default
            raise self.fail(key, f"key {key!r} is missing")
        value = self._values.pop(key)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind) or isinstance(value, bool) is not (kind is bool):
            raise self.fail(key, f"got {value!r:.60}, expected a {kind.__name__}")
        return value

    def table(self, key: str, *, needed: bool = True) -> "TomlTable":
        """Table under a key; an empty one where it is absent and not needed."""
        return TomlTable(self.take(key, dict, ... if needed else {}), self.where(f"{key}."), self._error)

    def tables(self, key: str, *, needed: bool = True) -> list["TomlTable"]:
        """Array of tables under a key; none where it is absent and not needed."""
        rows = self.take(key, list, ... if needed else [])
        return [TomlTable(row, self.where(f"{key}[{index}]."), self._error) for index, row in enumerate(rows)]

    def strings(self, key: str) -> tuple[str, ...]:
        """List of strings; empty where the key is absent."""
        values = self.take(key, list, [])
        if not all(isinstance(value, str) for value in values):
            raise self.fail(key, f"got {values!r:.60}, expected strings")
        return tuple(values)

    def numbers(self, key: str, shape: tuple[str | int, ...]) -> NDArray[np.float64]:
        """Nested list of finite numbers, of this shape."""
        try:
            return frozen(self.take(key, list), key, shape, np.float64)
        except UsageError as trouble:
            raise self.fail(key, str(trouble)) from trouble

    def finish(self) -> None:
        """Refuse what nobody took."""
        if self._values:
            key = next(iter(self._values))
            raise self.fail(key, f"key {key!r} is unknown")
