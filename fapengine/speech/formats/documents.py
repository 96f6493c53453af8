"""JSON read strictly: every value knows where it stands, and every surprise is a :class:`DataError` that says so."""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from fapengine.errors import DataError, TruncatedError
from fapengine.speech.formats.textgrid import decode_text

MAX_BYTES = 64 << 20
"""An hour of speech is a few megabytes."""
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Node:
    """A JSON value and its place."""

    value: object
    where: str = ""

    def has(self, *keys: str) -> bool:
        """Whether this is an object with all these keys, none of them null."""
        return isinstance(self.value, dict) and all(self.value.get(key) is not None for key in keys)

    def first(self, *keys: str) -> "Node":
        """Return the first of these keys that is there; tools spell one thing in several ways."""
        for key in keys:
            if self.has(key):
                return self[key]
        raise DataError(f"{keys[0]!r} is missing", where=self.where or "the top")

    def __getitem__(self, key: str) -> "Node":
        if not isinstance(self.value, dict) or key not in self.value:
            got = f"keys {sorted(map(str, self.value))[:8]}" if isinstance(self.value, dict) else self._shown()
            raise DataError(f"got {got}, expected an object with {key!r}", where=self.where or "the top")
        return Node(self.value[key], f"{self.where}.{key}" if self.where else key)

    def items(self) -> Iterator["Node"]:
        """Go through a list."""
        if not isinstance(self.value, list):
            raise DataError(f"got {self._shown()}, expected a list", where=self.where or "the top")
        for index, value in enumerate(self.value):
            yield Node(value, f"line {index + 1}" if self.where == "line" else f"{self.where}[{index}]")

    def entries(self) -> list["Node"]:
        """Return the items of a list, or this value alone."""
        return list(self.items()) if isinstance(self.value, list) else [self]

    def number(self) -> float:
        """Return a finite number, which may be spelled as a text."""
        spelled = isinstance(self.value, str) and len(self.value) < 40 and _NUMBER.fullmatch(self.value.strip())
        if (isinstance(self.value, (int, float)) and not isinstance(self.value, bool)) or spelled:
            try:
                parsed = float(self.value)  # type: ignore[arg-type]
            except OverflowError:
                parsed = math.inf
            if math.isfinite(parsed):
                return parsed
        raise DataError(f"got {self._shown()}, expected a number", where=self.where)

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise DataError(f"got {self._shown()}, expected a text", where=self.where)
        return self.value.encode("utf-8", "replace").decode()  # lone surrogates cannot be printed

    def numbers(self) -> list[float]:
        """Return a list of finite numbers."""
        return [item.number() for item in self.items()]

    def texts(self) -> list[str]:
        """Return a list of texts."""
        return [item.text() for item in self.items()]

    def _shown(self) -> str:
        return ascii(self.value)[:40]


def parse_document(data: bytes, what: str) -> Node:
    """Read JSON, or JSON lines as the list of their values."""
    if len(data) > MAX_BYTES:
        raise DataError(f"{what}: must have at most {MAX_BYTES} bytes, got {len(data)}")
    text = decode_text(data, what)
    if text.startswith(("data:", "event:", "id:", ":")):  # server-sent events: a JSON value behind each "data:"
        text = "\n".join(line[5:] for line in text.splitlines() if line.startswith("data:") and "{" in line)
    try:
        return Node(json.loads(text))
    except RecursionError as error:
        raise DataError(f"{what}: the JSON is nested too deeply") from error
    except json.JSONDecodeError as error:
        lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
        if len(lines) > 1 and lines[0][1].strip().startswith("{") and lines[0][1].strip().endswith("}"):
            return Node([_line(number, line, what) for number, line in lines], "line")
        kind = TruncatedError if error.pos >= len(text.rstrip()) else DataError
        raise kind(f"{what}: no JSON here ({error.msg})", where=f"line {error.lineno}, column {error.colno}") from error
    except ValueError as error:  # a number of more digits than Python converts
        raise DataError(f"{what}: the JSON holds a number that is too long") from error


def _line(number: int, line: str, what: str) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{what}: no JSON value in this line", where=f"line {number}") from error


def same_length(*lists: list[float] | list[str], where: str) -> None:
    """Check that parallel lists are equally long."""
    if len({len(each) for each in lists}) > 1:
        raise DataError(
            f"lists: got lengths {[len(each) for each in lists]}, expected the same", where=where or "the top"
        )
