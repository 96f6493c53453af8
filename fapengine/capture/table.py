"""Recordings as CSV and TSV: a row a marker (long), a row a frame (wide), and exports of Vicon, Qualisys, OptiTrack.

The header decides:

* long: columns named marker (or label), x, y, z and frame or time;
* wide: columns ``NAME_x NAME_y NAME_z`` (or ``NAME.x``, ``NAME:X``, ``NAME X``);
* Vicon Nexus: a row of names, each over its first column, a row ``Frame, Sub Frame, X, Y, Z ...``, a row of units;
* OptiTrack Motive: ``Format Version`` in the first cell, rows ``Type``, ``Name`` ..., then ``Frame, Time (Seconds)``;
* Qualisys QTM: lines ``NO_OF_FRAMES``, ``FREQUENCY``, ``MARKER_NAMES`` ..., then numbers.
"""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.raw import RawTrack
from fapengine.capture.text import decode_text, numbers, rate_of, split_rows, whole
from fapengine.errors import DataError, TruncatedError

Rows = list[list[str]]

MARKER_WORDS, FRAME_WORDS, TIME_WORDS = (
    {"marker", "label", "name"},
    {"frame", "frame#"},
    {"time", "time_s", "t", "time (seconds)"},
)
AXIS = re.compile(r"^(?P<name>.+?)[\s_.:\-]*(?P<axis>[xyz])(?:\s*[\[(](?P<unit>\w+)[\])])?$", re.IGNORECASE)
LENGTH_UNITS = {"mm", "cm", "m", "in", "inch"}
SEARCHED = 40
"""Lines in which a header is looked for."""


def parse_table(data: bytes) -> RawTrack:
    """Read a recording.

    Raises
    ------
    TruncatedError
        If there is a header, but no frame.
    DataError
        If no header is understood, or a cell is no number; ``where`` is line and column.
    """
    rows = split_rows(decode_text(data, "table"))
    if not any(any(row) for row in rows):
        raise DataError("table: got nothing, expected a header and numbers", where="line 1")
    first = rows[0][0].lower() if rows[0] else ""
    if first == "format version":
        return _optitrack(rows)
    if any(row and row[0].upper() == "MARKER_NAMES" for row in rows[:SEARCHED]):
        return _qualisys(rows)
    for line, row in enumerate(rows[:SEARCHED]):
        words = [cell.lower() for cell in row]
        if MARKER_WORDS & set(words) and {"x", "y", "z"} <= set(words):
            return _long(rows, line, words)
        if "sub frame" in words and words.count("x") >= 1:
            return _vicon(rows, line)
        axis_matches = [AXIS.match(cell) for cell in row]
        if sum(match is not None for match in axis_matches) >= 3 and words.count("x") == 0:
            return _wide(rows, line, axis_matches, words)
    raise DataError(
        "table: got no header that names markers, expected columns marker, x, y, z or NAME_x, NAME_y, NAME_z",
        where="line 1",
    )


def _body(rows: Rows, line: int) -> Rows:
    body = [row for row in rows[line:] if any(row)]
    if not body:
        raise TruncatedError("table: got a header and no frame", where=f"line {line + 1}")
    return body


def _column(words: Sequence[str], wanted: set[str]) -> int | None:
    return next((index for index, word in enumerate(words) if word in wanted), None)


def _long(rows: Rows, line: int, words: list[str]) -> RawTrack:
    body = _body(rows, line + 1)
    marker, frame, time = (_column(words, wanted) for wanted in (MARKER_WORDS, FRAME_WORDS, TIME_WORDS))
    assert marker is not None
    when = frame if frame is not None else time
    if when is None:
        raise DataError("table: got no column frame or time, expected one", where=f"line {line + 1}")
    short = next((n for n, row in enumerate(body) if len(row) <= marker or not row[marker]), None)
    if short is not None:
        raise DataError("table: got no marker name", where=f"line {line + 2 + short}, column {marker + 1}")
    labels = tuple(dict.fromkeys(row[marker] for row in body))
    cells = [[row[c] if c < len(row) else "" for c in (when, time or 0, *map(words.index, "xyz"))] for row in body]
    table = numbers(cells if time is not None else [[c[0], "", *c[2:]] for c in cells], 5, line + 2)
    moments, places = np.unique(table[:, 0], return_inverse=True)
    if np.isnan(moments).any():
        bad = int(np.isnan(table[:, 0]).argmax())
        raise DataError("table: got an empty frame or time", where=f"line {line + 2 + bad}, column {when + 1}")
    positions = np.full((len(moments), len(labels), 3), np.nan)
    index = {name: number for number, name in enumerate(labels)}
    columns = np.array([index[row[marker]] for row in body])
    twice = np.bincount(places * len(labels) + columns, minlength=1)
    if twice.max() > 1:
        at = int(twice.argmax())
        raise DataError(
            f"table: got marker {labels[at % len(labels)]!r} twice at {moments[at // len(labels)]:g}, expected once"
        )
    positions[places, columns] = table[:, 2:]
    times = np.full(len(moments), np.nan)
    times[places] = table[:, 1]
    return RawTrack(
        positions=whole(positions), labels=labels, rate_hz=rate_of(times if time is not None else moments[:0])
    )


def _wide(rows: Rows, line: int, axis_matches: list[re.Match[str] | None], words: list[str]) -> RawTrack:
    columns: dict[str, dict[str, int]] = {}
    units = set()
    for index, match in enumerate(axis_matches):
        if match is not None and words[index] not in FRAME_WORDS | TIME_WORDS:
            columns.setdefault(match["name"].strip(), {})[match["axis"].lower()] = index
            units |= {match["unit"].lower()} if match["unit"] else set()
    partial = next((name for name, axes in columns.items() if len(axes) < 3), None)
    if partial is not None:
        raise DataError(
            f"table: got {'/'.join(sorted(columns[partial]))} of marker {partial!r}, expected x, y and z",
            where=f"line {line + 1}",
        )
    body = _body(rows, line + 1)
    table = numbers(body, len(rows[line]), line + 2)
    order = [axes[axis] for axes in columns.values() for axis in "xyz"]
    time = _column(words, TIME_WORDS)
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=tuple(columns),
        rate_hz=None if time is None else rate_of(table[:, time]),
        units=next(iter(units)) if len(units) == 1 else None,
    )


def _spread(names: Sequence[str], axes: Sequence[str]) -> tuple[tuple[str, ...], list[int]]:
    """Names stand over the first of their three columns: labels, and the columns of all coordinates in order."""
    labels, order, name = [], [], ""
    for index, axis in enumerate(axes):
        name = names[index] if index < len(names) and names[index] else name
        if axis.lower() == "x" and [a.lower() for a in axes[index : index + 3]] == ["x", "y", "z"]:
            labels.append(name)
            order += [index, index + 1, index + 2]
    return tuple(labels), order


def _vicon(rows: Rows, line: int) -> RawTrack:
    """Blocks follow each other in the file; the trajectories are the one whose axes are X, Y, Z."""
    labels, order = _spread(rows[line - 1] if line else [], rows[line])
    if not labels or not all(labels):
        raise DataError("table: got no marker names over X, Y, Z", where=f"line {line}")
    units = rows[line + 1] if line + 1 < len(rows) else []
    unit = next((cell.lower() for cell in units if cell.lower() in LENGTH_UNITS), None)
    stop = next((n for n in range(line + 1, len(rows)) if not any(rows[n])), len(rows))
    body = [row for row in rows[line + 1 : stop] if row[0].lstrip("-").isdigit()]
    if not body:
        raise TruncatedError("table: got a header and no frame", where=f"line {line + 1}")
    table = numbers(body, len(rows[line]), line + 2 + bool(unit))
    rates = [row[0] for row in rows[:line] if len([c for c in row if c]) == 1 and row[0].replace(".", "").isdigit()]
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=labels,
        rate_hz=float(rates[-1]) if rates and float(rates[-1]) > 0 else None,
        units=unit,
        up="+z",  # of Nexus
    )


def _optitrack(rows: Rows) -> RawTrack:
    facts = dict(zip((cell.lower() for cell in rows[0][::2]), rows[0][1::2], strict=False))
    line = next((n for n, row in enumerate(rows[:SEARCHED]) if row and row[0].lower() == "frame"), None)
    names = next((row for row in rows[:SEARCHED] if "Name" in row[:2]), None)
    kinds = next((row for row in rows[:SEARCHED] if "Type" in row[:2]), None)
    if line is None or names is None:
        raise DataError("table: got no rows Name and Frame, expected those of Motive", where="line 1")
    labels, order = _spread(names, rows[line])
    if kinds is not None:  # bones and rigid bodies have positions too
        kept = [
            n
            for n in range(len(labels))
            if kinds[order[3 * n] : order[3 * n] + 1] and "marker" in kinds[order[3 * n]].lower()
        ]
        labels, order = tuple(labels[n] for n in kept), [c for n in kept for c in order[3 * n : 3 * n + 3]]
    if not labels:
        raise DataError("table: got no column of a marker, expected some", where=f"line {line + 1}")
    table = numbers(_body(rows, line + 1), len(rows[line]), line + 2)
    units = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "inch"}
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=labels,
        rate_hz=rate_of(table[:, 1]),
        units=units.get(facts.get("length units", "").lower()),
        up="+y",  # of Motive
    )


def _qualisys(rows: Rows) -> RawTrack:
    facts = {row[0].upper(): row[1:] for row in rows[:SEARCHED] if row and not _is_number(row[0])}
    labels = tuple(name for name in facts["MARKER_NAMES"] if name)
    line = next((n for n, row in enumerate(rows) if row and _is_number(row[0])), None)
    if not labels or line is None:
        raise TruncatedError("table: got no frame under MARKER_NAMES", where=f"line {len(rows)}")
    body = _body(rows, line)
    extra = max(len(row) for row in body) - 3 * len(labels)
    if extra < 0 or extra > 3:
        raise DataError(
            f"table: got {3 * len(labels) + extra} columns, expected {3 * len(labels)}, or frame and time before them",
            where=f"line {line + 1}",
        )
    skipped = 2 if extra >= 2 else 0  # frame and time; a tab behind the last column makes one more
    table = numbers(body, skipped + 3 * len(labels), line + 1)
    rate = facts.get("FREQUENCY", [""])
    return RawTrack(
        positions=whole(table[:, skipped:].reshape(len(table), len(labels), 3)),
        labels=labels,
        rate_hz=float(rate[0]) if rate and _is_number(rate[0]) and float(rate[0]) > 0 else None,
        units="mm",  # of QTM
        up="+z",
    )


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell.replace(",", "."))))
    except ValueError:
        return False


def format_table(track: MarkerTrack, *, long: bool = False, delimiter: str = ",") -> bytes:
    """Write a recording, mm: a row a frame, or with ``long`` a row a marker that was seen."""
    times: NDArray[np.float64] = np.arange(track.frame_count) / track.rate_hz
    if long:
        lines = [delimiter.join(("frame", "time", "marker", "x", "y", "z"))]
        for frame, marker in np.argwhere(track.valid):
            cells = (f"{value:.5f}" for value in track.positions_mm[frame, marker])
            lines.append(delimiter.join((str(frame), f"{times[frame]:.6f}", track.labels[marker], *cells)))
    else:
        names = (f"{name}_{axis} [mm]" for name in track.labels for axis in "xyz")
        lines = [delimiter.join(("frame", "time", *names))]
        for index, frame in enumerate(track.positions_mm):
            cells = ("" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel())
            lines.append(delimiter.join((str(index), f"{times[index]:.6f}", *cells)))
    return ("\n".join(lines) + "\n").encode()
