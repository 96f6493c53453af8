"""Lists that no tool has a name for: CSV, TSV and JSON, with columns found by their usual names or declared.

``start=begin,end=stop,label=sound,unit=ms`` declares columns; the others are found by their names. Columns of a list
without a header are declared by their numbers, from 1. A unit in a column's name (``start_ms``) counts. Where all times
are whole numbers and no unit is given, seconds and milliseconds are both possible, so the file is refused.
"""

import csv
import io
import re
from collections.abc import Iterable
from dataclasses import dataclass

from fapengine.errors import DataError, UsageError
from fapengine.speech.formats.documents import Node, decode_text, parse_document
from fapengine.speech.formats.entries import Entry
from fapengine.speech.formats.word_lists import labelled_track, words_track
from fapengine.speech.phone_track import PhoneTrack

NAMES: dict[str, tuple[str, ...]] = {
    "start": ("start", "begin", "onset", "xmin", "start_time", "begin_time", "starttime", "tmin", "from", "t0"),
    "end": ("end", "stop", "offset", "xmax", "end_time", "endtime", "stop_time", "tmax", "to", "t1"),
    "length": ("duration", "length", "dur", "len"),
    "label": ("phone", "phoneme", "label", "segment", "text", "word", "symbol", "viseme", "value", "token"),
    "word": ("word",),
}
"""Usual names of columns, the best first, in small letters and without a unit."""
UNITS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "milliseconds": 1e-3,
         "us": 1e-6, "ticks": 1e-7, "samples": None, "frames": None}  # fmt: skip
"""Lengths of units in s; samples and frames need ``hz`` or ``fps``."""
_UNIT_AT_THE_END = re.compile(r"[_ ]?\(?(seconds|secs|sec|s|milliseconds|msec|ms|us)\)?$", re.IGNORECASE)
MAX_COLUMNS = 100
"""Columns of a list without names, at most."""
_WORDS = frozenset({"word", "text", "token"})


@dataclass(frozen=True, slots=True)
class Columns:
    """Declared columns and unit of a list."""

    names: dict[str, str]
    """Name of the column by what it is: start, end, length, label, word."""
    unit_s: float | None = None
    """Length of the unit of times in s; None to find out."""
    rate_hz: float | None = None
    """Frames or samples per second."""


def parse_columns(text: str | None) -> Columns:
    """Read ``start=begin,label=sound,unit=ms`` or ``fps=24``.

    Examples
    --------
    >>> parse_columns("start=begin, unit=ms").names, parse_columns("fps=24").unit_s == 1 / 24
    ({'start': 'begin'}, True)
    """
    names: dict[str, str] = {}
    unit_s = rate_hz = None
    for piece in filter(None, (piece.strip() for piece in (text or "").split(","))):
        key, equals, value = (part.strip() for part in piece.partition("="))
        if key in NAMES and equals and value:
            names[key] = value
        elif key == "unit" and UNITS.get(value.lower()) is not None:
            unit_s = UNITS[value.lower()]
        elif key in ("fps", "hz") and re.fullmatch(r"\d{1,7}(\.\d{1,6})?", value) and float(value) > 0:
            rate_hz = float(value)
            unit_s = 1 / rate_hz
        else:
            raise UsageError(
                f"columns: got {piece!r}, expected start=, end=, length=, label=, word= with a name,"
                " unit=s|ms|us|ticks, or fps= or hz= with a number"
            )
    return Columns(names, unit_s, rate_hz)


def header_of(rows: tuple[str, ...]) -> list[str]:
    """Names in the first row of a CSV or TSV; empty if it has no start and label."""
    if not rows:
        return []
    names = next(csv.reader([rows[0]], delimiter=_delimiter(rows[0])), [])
    return names if _is_whole(_found(names, Columns({}))) else []


def _delimiter(row: str) -> str:
    return max(",\t;", key=row.count)


def _found(names: list[str], said: Columns) -> dict[str, str]:
    """Name of each column that there is."""
    plain = {_UNIT_AT_THE_END.sub("", name.strip()).lower().replace(" ", "_"): name for name in reversed(names)}
    found: dict[str, str] = {}
    for what, usual in NAMES.items():
        if what in said.names:
            if said.names[what] not in names:
                raise DataError(f"columns: got {what}={said.names[what]}, but the file has {names}")
            found[what] = said.names[what]
        elif name := next((plain[each] for each in usual if each in plain), ""):
            found[what] = name
    return found


def is_row(node: Node) -> bool:
    """Whether a JSON object is a row with start, end or length, and label, by usual names."""
    if not isinstance(node.value, dict):
        return False
    return _is_whole(_found([str(key) for key in node.value], Columns({})))


def _is_whole(found: dict[str, str]) -> bool:
    return {"start", "label"} <= found.keys() and not found.keys().isdisjoint(("end", "length"))


def parse_table(data: bytes, *, columns: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read a list; words if its label column is named word or text, or if its labels look like words."""
    said = parse_columns(columns)
    text = decode_text(data, "table")
    is_json = text.lstrip()[:1] in ("{", "[")
    numbered = bool(said.names) and all(name.isdigit() for name in said.names.values())
    rows = _json_rows(data) if is_json else _csv_rows(text, numbered)
    names = list(next(iter(rows.values()), {}))
    found = _found(names, said)
    if not _is_whole(found):
        raise DataError(
            f"table: got the columns {names[:12]}, expected start, end and label;"
            " name them with columns='start=NAME,end=NAME,label=NAME'"
        )
    unit_s = said.unit_s or _unit_s(rows.values(), found)
    entries: list[Entry] = []
    for where, row in rows.items():
        start_s = _time(row, found["start"], where) * unit_s
        ends = "end" if "end" in found else "length"
        end_s = _time(row, found[ends], where) * unit_s + (0.0 if ends == "end" else start_s)
        word = row.get(found.get("word", ""), "")
        entries.append(Entry(start_s, end_s, row.get(found["label"], ""), where, word))
    if alphabet is None and _UNIT_AT_THE_END.sub("", found["label"]).lower() in _WORDS:
        return words_track(entries, "table", "one word a row")
    return labelled_track(entries, "table", alphabet, hint="one word a row")


def _csv_rows(text: str, numbered: bool) -> dict[str, dict[str, str]]:
    """Rows by their places; columns by the names in the first line, or by their numbers, from 1."""
    lines = [line for line in text.splitlines() if line.strip()]
    names = [str(number) for number in range(1, MAX_COLUMNS)] if numbered else None
    try:
        rows = list(csv.DictReader(io.StringIO("\n".join(lines)), names, delimiter=_delimiter("".join(lines[:1]))))
    except csv.Error as error:
        raise DataError(f"table: {error}") from error
    return {
        f"row {number}": {str(key): value for key, value in row.items() if isinstance(value, str)}
        for number, row in enumerate(rows, start=1)
    }


def _json_rows(data: bytes) -> dict[str, dict[str, str]]:
    document = parse_document(data, "table")
    if isinstance(document.value, dict):
        lists = [document[str(key)] for key, value in document.value.items() if isinstance(value, list) and value
                 and isinstance(value[0], dict)]  # fmt: skip
        if len(lists) != 1:
            raise DataError(f"table: got {len(lists)} lists of objects, expected one", where="the top")
        document = lists[0]
    rows: dict[str, dict[str, str]] = {}
    for item in document.items():
        if not isinstance(item.value, dict):
            raise DataError(f"row: got {ascii(item.value)[:40]}, expected an object", where=item.where)
        rows[item.where] = {str(key): value if isinstance(value, str) else repr(value)
                            for key, value in item.value.items()
                            if isinstance(value, str | int | float) and not isinstance(value, bool)}  # fmt: skip
    return rows


def _unit_s(rows: Iterable[dict[str, str]], found: dict[str, str]) -> float:
    named = [match[1].lower() for name in (found["start"], found.get("end", found.get("length", "")))
             if (match := _UNIT_AT_THE_END.search(name)) and match.start() > 0]  # fmt: skip
    if named and UNITS[named[0]] is not None and len({UNITS[name] for name in named}) == 1:
        return UNITS[named[0]] or 1.0
    times = [row.get(found[what], "") for row in rows for what in ("start", "end", "length") if what in found]
    if all(re.fullmatch(r"\s*\d+\s*", time) for time in times):
        raise DataError(
            "table: got whole numbers for times, which may be seconds or milliseconds; say which with"
            " columns='unit=s' or columns='unit=ms'"
        )
    return 1.0


def _time(row: dict[str, str], name: str, where: str) -> float:
    text = row.get(name, "").strip()
    if not re.fullmatch(r"[-+]?\d{1,15}([.,]\d+)?([eE][-+]?\d{1,3})?", text):
        raise DataError(f"{name}: got {text[:40]!r}, expected a time", where=where)
    return float(text.replace(",", "."))
