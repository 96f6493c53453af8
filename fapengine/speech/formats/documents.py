"""Text, numbers and JSON of a file, read strictly: every error is a :class:`DataError` that says where.

:class:`Node` is a JSON value with its place; :func:`walk` follows a path into it.
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

from fapengine.errors import DataError, TruncatedError, UnsupportedError

MAX_BYTES = 64 << 20
"""An hour of speech is a few megabytes."""
NUMBER = r"[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?"
"""Pattern of a number in a line."""
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", re.ASCII)


def decode_text(data: bytes, what: str) -> str:
    """Decode UTF-8, or UTF-16 with a byte-order mark."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise DataError(
            f"{what}: got bytes that are neither UTF-8 nor UTF-16 with a byte-order mark", where=f"byte {error.start}"
        ) from error


def number_of(text: str, what: str, where: str, low: float = -1e300, high: float = 1e300) -> float:
    """Read a finite number, ``low`` to ``high``, from a text field; its decimal sign may be a comma.

    Examples
    --------
    >>> number_of("1e3", "length", "line 1")
    1000.0
    """
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        limits = "" if low == -1e300 else f" from {low:g} to {high:g}"
        raise DataError(f"{what}: got {text[:40]!r}, expected a number{limits}", where=where)
    return value


def only_name(names: set[str], wanted: str | None, what: str, kind: str) -> str:
    """Return the wanted name, or the only one; DataError if there are several."""
    if len(names) > 1 and wanted not in names:
        shown = sorted(name[:40] for name in names)[:8]
        raise DataError(f"{what}: got the {kind} {shown}, expected one; name one with tier=NAME")
    return wanted if len(names) > 1 and wanted else next(iter(names), "")


@dataclass(frozen=True, slots=True)
class Node:
    """A JSON value and its place."""

    value: object
    where: str = ""
    """Place in the document, for messages; empty for the top."""

    def has(self, *keys: str) -> bool:
        """Whether this is an object with all these keys, none of them null."""
        return isinstance(self.value, dict) and all(self.value.get(key) is not None for key in keys)

    def first(self, *keys: str) -> "Node":
        """Return the value of the first of these keys that exists; tools name one thing in several ways."""
        for key in keys:
            if self.has(key):
                return self[key]
        raise DataError(f"{keys[0]!r} is missing", where=self.where or "the top")

    def number_or(self, key: str, default: float) -> float:
        """Return the number of a key, or a default for a missing or null one."""
        return self[key].number() if self.has(key) else default

    def text_or(self, key: str, default: str = "") -> str:
        """Return the text of a key, or a default for a missing or null one."""
        return self[key].text() if self.has(key) else default

    def __getitem__(self, key: str) -> "Node":
        if not isinstance(self.value, dict) or key not in self.value:
            keys = sorted(str(name)[:40] for name in self.value) if isinstance(self.value, dict) else []
            got = f"keys {keys[:8]}" if isinstance(self.value, dict) else self._shown()
            raise DataError(f"got {got}, expected an object with {key!r}", where=self.where or "the top")
        return Node(self.value[key], f"{self.where}.{key}" if self.where else key)

    def items(self) -> Iterator["Node"]:
        """Iterate over a list."""
        if not isinstance(self.value, list):
            raise DataError(f"got {self._shown()}, expected a list", where=self.where or "the top")
        for index, value in enumerate(self.value):
            yield Node(value, f"line {index + 1}" if self.where == "line" else f"{self.where}[{index}]")

    def entries(self) -> list["Node"]:
        """Return the items of a list, or this value alone."""
        return list(self.items()) if isinstance(self.value, list) else [self]

    def number(self) -> float:
        """Return a finite number; a text that holds one counts."""
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
    if text.startswith(("data:", "event:", "id:", ":")):  # server-sent events: a JSON value after each "data:"
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
        raise kind(f"{what}: invalid JSON ({error.msg})", where=f"line {error.lineno}, column {error.colno}") from error
    except ValueError as error:  # a number of more digits than Python converts
        raise DataError(f"{what}: the JSON holds a number that is too long") from error


def parse_xml(data: bytes, what: str) -> ElementTree.Element:
    """Read XML without a document type or entities."""
    if len(data) > MAX_BYTES:
        raise DataError(f"{what}: must have at most {MAX_BYTES} bytes, got {len(data)}")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise UnsupportedError(f"{what} XML: got a document type or entities, expected none")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DataError(f"{what} XML: no XML here ({error!s:.50})") from error


def _line(number: int, line: str, what: str) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{what}: invalid JSON in this line", where=f"line {number}") from error


def rows_of_lists(node: Node, texts: str, starts: str = "start", ends: str = "end") -> list[tuple[float, float, str]]:
    """Read parallel lists, named by their keys, as rows (start, end, text)."""
    lists = node[starts].numbers(), node[ends].numbers(), node[texts].texts()
    if len({len(each) for each in lists}) > 1:
        raise DataError(
            f"lists: got lengths {[len(each) for each in lists]}, expected the same", where=node.where or "the top"
        )
    return list(zip(*lists, strict=True))


def walk(node: Node, path: str) -> Iterator[Node]:
    """Follow a path; a missing key yields nothing.

    Examples
    --------
    >>> [item.value for item in walk(Node({"a": [{"b": 1}, {"b": 2}, {}]}), "a[].b")]
    [1, 2]
    """
    first, _, rest = path.partition(".")
    name, bracket, index = first.partition("[")
    if name:
        if not node.has(name):
            return
        node = node[name]
    found = [node]
    if bracket:
        if not isinstance(node.value, list):
            return
        number = index.rstrip("]")
        found = [item for at, item in enumerate(node.items()) if not number or at == int(number)]
    for item in found:
        yield from walk(item, rest) if rest else [item]
