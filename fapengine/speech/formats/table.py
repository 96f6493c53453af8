"""Lists that no tool has a name for: CSV, TSV and JSON, with columns found by their usual names or declared.

``start=begin,end=stop,label=sound,unit=ms`` declares columns; the others are found by their names. Columns of a list
without a header are declared by their numbers, from 1. A unit in a column's name (``start_ms``) counts. Where all times
are whole numbers and no unit is given, seconds and milliseconds are both possible, so the file is refused.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from fapengine.errors import DataError, UsageError
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.formats.documents import NUMBER, Node, decode_text, parse_document
from fapengine.speech.formats.entries import LAST_S, Entry, track_of
from fapengine.speech.formats.word_lists import labelled_track, words_track
from fapengine.speech.phone_track import PhoneTrack

NAMES: dict[str, tuple[str, ...]] = {
    "start": ("starttime", "begintime", "starttimestamp", "start", "begin", "onset", "xmin", "tmin", "from", "t0",
              "time", "timestamp", "offset"),
    "end": ("endtime", "stoptime", "endtimestamp", "end", "stop", "xmax", "tmax", "to", "t1", "offset"),
    "length": ("duration", "length", "dur", "len"),
    "label": ("phone", "phoneme", "label", "segment", "text", "word", "symbol", "viseme", "value", "token", "mouth"),
    "word": ("word",),
}  # fmt: skip
"""Usual names of columns, as :func:`plain_name` writes them, the best first: a mere start may count characters."""
UNITS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "milliseconds": 1e-3,
         "us": 1e-6, "ticks": 1e-7}  # fmt: skip
"""Lengths of units in s."""
_UNIT_AT_THE_END = re.compile(rf"(?<=.)[_ ]?\(?({'|'.join(sorted(UNITS, key=len, reverse=True))})\)?$", re.IGNORECASE)
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
        elif key == "unit" and value.lower() in UNITS:
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


def plain_name(name: str) -> str:
    """Name of a column in small letters, without separators and unit.

    Examples
    --------
    >>> [plain_name(name) for name in ("start_time_ms", "Audio Offset", "visemeId", "endMs", "duration (s)")]
    ['starttime', 'audiooffset', 'visemeid', 'end', 'duration']
    """
    return re.sub("[-_ ]", "", _UNIT_AT_THE_END.sub("", name.strip())).lower()


def unit_in(name: str) -> float | None:
    """Length in s of the unit in a column's name, if any; the s of ``starts`` is not a unit."""
    match = _UNIT_AT_THE_END.search(name.strip())
    return UNITS[match[1].lower()] if match and match[0] != "s" else None


def header_of(rows: Sequence[str]) -> list[str]:
    """Names in the first row of a CSV or TSV that is not a comment; empty if it has no start and label."""
    first = next((row for row in rows if not row.startswith("#")), "")
    names = next(csv.reader([first], delimiter=_delimiter(first), skipinitialspace=True), [])
    return names if {"start", "label"} <= _found(names, Columns({})).keys() else []


def _delimiter(row: str) -> str:
    return max(",\t; ", key=lambda sign: (sign != " " and row.count(sign), sign == " "))


def _found(names: list[str], said: Columns) -> dict[str, str]:
    """Name of the column of each kind that there is; a column is of one kind, but the label may be the word."""
    found = dict(said.names)
    for what, name in found.items():
        if name not in names:
            raise DataError(f"columns: got {what}={name}, but the file has {names}")
    for what, usual in NAMES.items():
        free = [name for name in names if what == "word" or name not in found.values()]
        plain = {plain_name(name): name for name in reversed(free)}
        if what not in found and (name := next((plain[each] for each in usual if each in plain), "")):
            found[what] = name
    return found


_VISEMES = frozenset({"viseme", "visemename", "visemelabel", "mouth", "mouthshape", "shape", "mouthcue"})
_VISEME_SETS = ("oculus-visemes", "rhubarb-shapes", "preston-blair", "polly-visemes")
"""Names of columns that have visemes, and the sets that are tried."""
_PREFIX = re.compile(r"(viseme_|vrc\.v_|v_)", re.IGNORECASE)


def is_row(node: Node) -> bool:
    """Whether a JSON object is a row with start and label, by usual names."""
    if not isinstance(node.value, dict):
        return False
    return {"start", "label"} <= _found([str(key) for key in node.value], Columns({})).keys()


def parse_table(data: bytes, *, columns: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read a list; words if its label column is named word or text, or if its labels look like words.

    A row without an end lasts until the next one.
    """
    said = parse_columns(columns)
    text = decode_text(data, "table")
    is_json = text.lstrip()[:1] in ("{", "[")
    numbered = bool(said.names) and all(name.isdigit() for name in said.names.values())
    rows = _json_rows(data) if is_json else _csv_rows(text, numbered)
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    found = _found(names, said)
    if not {"start", "label"} <= found.keys():
        if not is_json and (not names or any(re.fullmatch(NUMBER, name.strip()) for name in names)):
            raise DataError("table: got no names of columns; say their numbers: columns='start=1,end=2,label=3'")
        raise DataError(
            f"table: got the columns {[name[:40] for name in names[:12]]}, expected start and label; name them with"
            " columns='start=NAME,end=NAME,label=NAME'"
        )
    units_s = _units_s(rows.values(), found, said)
    entries: list[Entry] = []
    for where, row in reversed(rows.items()):
        start_s = _time(row, found["start"], where) * units_s["start"]
        ends = next((what for what in ("end", "length") if what in found and row.get(found[what], "").strip()), "")
        if ends:
            end_s = _time(row, found[ends], where) * units_s[ends] + (0.0 if ends == "end" else start_s)
        else:
            end_s = entries[-1].start_s if entries else start_s + LAST_S
        word = row.get(found.get("word", ""), "")
        entries.append(Entry(start_s, end_s, row.get(found["label"], ""), where, word))
    entries.reverse()
    if alphabet is None and (visemes := _viseme_track(entries, plain_name(found["label"]) in _VISEMES)):
        return visemes
    if alphabet is None and plain_name(found["label"]) in _WORDS:
        return words_track(entries, "table", "one word a row")
    return labelled_track(entries, "table", alphabet, row="row")


def _viseme_track(entries: Sequence[Entry], is_named: bool) -> PhoneTrack | None:
    """Make a track of labels that are visemes by the name of their column, or by a prefix; None for others."""
    bare = [replace(entry, label=_PREFIX.sub("", entry.label.strip())) for entry in entries]
    labels = {entry.label for entry in bare} - {""}
    if not is_named and labels == {entry.label.strip() for entry in entries} - {""}:
        return None
    fitting = [name for name in _VISEME_SETS if labels <= PHONE_SETS[name].table.keys()]
    return track_of(bare, "table", alphabet=fitting[0], level="viseme") if fitting and labels else None


def _csv_rows(text: str, numbered: bool) -> dict[str, dict[str, str]]:
    """Rows by their places; columns by the names in the first line, or by their numbers, from 1."""
    lines = [line for line in text.splitlines() if line.strip(" \t,;") and not line.startswith("#")]
    names = [str(number) for number in range(1, MAX_COLUMNS)] if numbered else None
    try:
        rows = csv.DictReader(lines, names, delimiter=_delimiter("".join(lines[:1])), skipinitialspace=True)
        read = [{str(key): value for key, value in row.items() if isinstance(value, str)} for row in rows]
    except csv.Error as error:
        raise DataError(f"table: {error}") from error
    return {f"row {number}": row for number, row in enumerate(read, start=1)}


def list_in(document: Node) -> Node:
    """Return the list of objects that a document is, or the only one that it contains."""
    lists = [document] if isinstance(document.value, list) else []
    found = [document] if isinstance(document.value, dict) else []
    while found and not lists:
        nodes = [node[str(key)] for node in found if isinstance(node.value, dict) for key in node.value]
        lists = [node for node in nodes if isinstance(node.value, list) and node.value
                 and isinstance(node.value[0], dict)]  # fmt: skip
        found = nodes
    if len(lists) != 1:
        raise DataError(f"table: got {len(lists)} lists of objects, expected one", where="the top")
    return lists[0]


def _json_rows(data: bytes) -> dict[str, dict[str, str]]:
    rows: dict[str, dict[str, str]] = {}
    for item in list_in(parse_document(data, "table")).items():
        if not isinstance(item.value, dict):
            raise DataError(f"row: got {ascii(item.value)[:40]}, expected an object", where=item.where)
        rows[item.where] = {str(key): value if isinstance(value, str) else repr(value)
                            for key, value in item.value.items()
                            if isinstance(value, str | int | float) and not isinstance(value, bool)}  # fmt: skip
    return rows


def _units_s(rows: Iterable[dict[str, str]], found: dict[str, str], said: Columns) -> dict[str, float]:
    """Length in s of the unit of each column of times: declared, in its name, or in that of another column."""
    timed = {what: name for what, name in found.items() if what in ("start", "end", "length")}
    own = {what: said.unit_s or unit_in(name) for what, name in timed.items()}
    named = [unit_s for unit_s in own.values() if unit_s]
    if not named and all(re.fullmatch(r"\s*\d*\s*", row.get(name, "")) for row in rows for name in timed.values()):
        raise DataError(
            "table: got whole numbers for times, which may be seconds or milliseconds; say which with"
            " columns='unit=s' or columns='unit=ms'"
        )
    return {what: unit_s or (named[0] if named else 1.0) for what, unit_s in own.items()}


def _time(row: dict[str, str], name: str, where: str) -> float:
    text = row.get(name, "").strip()
    if not re.fullmatch(r"[-+]?\d{1,15}([.,]\d+)?([eE][-+]?\d{1,3})?", text):
        raise DataError(f"{name}: got {text[:40]!r}, expected a time", where=where)
    return float(text.replace(",", "."))
